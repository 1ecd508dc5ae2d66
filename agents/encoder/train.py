"""Trains the bundled encoder: motions and captions, state and text towers, then the image tower, then export.

All stages keep their result in the run folder and are skipped when it is there, so that a stopped run goes on.
"""

from __future__ import annotations

import logging
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional
from tqdm import tqdm

from agents.encoder.captions import Caption, CaptionSet, write_captions
from agents.encoder.concepts import CONCEPTS, Concept
from agents.encoder.dataset import MotionSet, generate, join_sets
from agents.encoder.exemplars import exemplar_concepts
from agents.encoder.networks import StateTower, TextHead
from anyskill_envs.observation import MIRROR_INDEX, MIRROR_SIGN, OBSERVATION_LAYOUT
from motion_data.authored import authored_clips
from motion_data.clip import MotionClip
from motion_data.deepmimic import pybullet_clips
from rewards.minilm import load_minilm

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class EncoderConfig:
    """Settings of a training run of the encoder."""

    run: Path = Path("runs/encoder")
    """Folder of the run: data, checkpoints, report."""
    seed: int = 0
    """Seed of all randomness."""
    rounds: int = 10
    """Rounds of data; each has about 2,000 motions per source and 4,000 simulated ones."""
    tracks: int = 128
    """Tracks per source and round."""
    per_track: int = 16
    """Short motions cut from each track."""
    caption_pairs: int = 700
    """Captions that join two concepts; as many mirrored ones come with them."""
    feature_size: int = 256
    """Size of the shared space."""
    state_batch: int = 384
    """Motions per step of the state and text towers."""
    caption_batch: int = 256
    """Captions per step."""
    steps: int = 6000
    """Steps of the state and text towers."""
    learning_rate: float = 1e-3
    """Highest learning rate; it rises for 200 steps and then falls along a cosine."""
    image_size: int = 64
    """Pixels per side of the image tower's frames."""
    image_motions: int = 12000
    """Motions that are rendered for the image tower."""
    image_epochs: int = 12
    """Passes over the rendered motions."""
    image_batch: int = 64
    """Films per step of the image tower."""
    threads: int = 1
    """Threads of torch."""
    out: Path | None = None
    """Folder to export to; that of the bundled encoder if None."""


def motion_library() -> list[MotionClip]:
    """Authored and captured clips and their mirror images."""
    clips = authored_clips() + pybullet_clips()
    names = {clip.name for clip in clips}
    # Sided authored clips come in both kinds already.
    return clips + [clip.mirrored() for clip in clips if not _partner_names(clip.name) & names]


def _partner_names(name: str) -> set[str]:
    swapped = {name.replace("right", "left"), name.replace("left", "right")} - {name}
    return swapped | {f"{name}_mirrored"}


def all_concepts(clips: list[MotionClip]) -> tuple[Concept, ...]:
    """Ruled concepts, then those that clips show."""
    return (*CONCEPTS.values(), *exemplar_concepts(clips))


def mirrored_concepts(concepts: tuple[Concept, ...]) -> NDArray[np.int64]:
    """Index of each concept's mirror image."""
    names = [concept.name for concept in concepts]
    swap = {"left": "right", "right": "left"}
    partners = []
    for index, name in enumerate(names):
        base, _, side = name.rpartition(".")
        partners.append(names.index(f"{base}.{swap[side]}") if side in swap else index)
    return np.array(partners)


def encode_tokens(texts: list[str], cache: Path) -> tuple[NDArray[np.float16], NDArray[np.float16]]:
    """Token states (k, tokens, 384) and masks (k, tokens) of texts, kept in a file."""
    if cache.is_file():
        with np.load(cache, allow_pickle=False) as archive:
            if archive["texts"].tolist() == texts:
                return archive["states"], archive["mask"]
    model = load_minilm()
    parts = [model.token_states([text]) for text in tqdm(texts, desc="reading captions", unit="text")]
    length = max(states.shape[1] for states, _ in parts)
    states = np.zeros((len(texts), length, parts[0][0].shape[-1]), np.float16)
    mask = np.zeros((len(texts), length), np.float16)
    for row, (state, _) in enumerate(parts):
        states[row, : state.shape[1]] = state[0]
        mask[row, : state.shape[1]] = 1
    cache.parent.mkdir(parents=True, exist_ok=True)
    np.savez(cache, texts=np.array(texts), states=states, mask=mask)
    return states, mask


def make_motions(config: EncoderConfig, clips: list[MotionClip], concepts: tuple[Concept, ...]) -> MotionSet:
    """The motions to train on, made once per run folder."""
    path = config.run / "motions.npz"
    if path.is_file():
        motions = MotionSet.load(path)
        if motions.truths.shape[1] == len(concepts):
            return motions
    rng = np.random.default_rng(config.seed)
    sets = generate(clips, concepts, rng, config.rounds, config.tracks, config.per_track)
    motions = join_sets(list(tqdm(sets, desc="making motions", unit="set")))
    motions.save(path)
    return motions


class MotionSampler:
    """Draws batches in which rare concepts are seen often, half of them mirrored.

    Args:
        motions: what to draw from.
        mirror: index of each concept's mirror image.
        rng: all randomness.
    """

    def __init__(self, motions: MotionSet, mirror: NDArray[np.int64], rng: np.random.Generator) -> None:
        self.motions = motions
        self.mirror = mirror
        self.rng = rng
        self._fulfilling = [np.flatnonzero(column > 0.6) for column in motions.truths.T]
        velocities = [OBSERVATION_LAYOUT["body_linear_velocities"], OBSERVATION_LAYOUT["body_angular_velocities"]]
        self._noise = np.full(motions.observations.shape[1], 0.005, np.float32)
        self._noise[velocities[0]], self._noise[velocities[1]] = 0.08, 0.3

    def index(self, size: int) -> NDArray[np.int64]:
        """Half uniform, half from the motions that fulfil a random concept."""
        index = self.rng.integers(len(self.motions), size=size)
        for place in range(size // 2):
            fulfilling = self._fulfilling[self.rng.integers(len(self._fulfilling))]
            if len(fulfilling):
                index[place] = fulfilling[self.rng.integers(len(fulfilling))]
        return index

    def draw(self, size: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Observations (size, 223) and truths (size, concepts)."""
        index = self.index(size)
        observations = self.motions.observations[index]
        truths = self.motions.truths[index].astype(np.float32)
        turned = self.rng.random(size) < 0.5
        observations[turned] = observations[turned][:, MIRROR_INDEX] * MIRROR_SIGN
        truths[turned] = truths[turned][:, self.mirror]
        noise = self.rng.normal(size=observations.shape).astype(np.float32) * self._noise
        return observations + noise * self.rng.random((size, 1), np.float32), truths


class CaptionSampler:
    """Draws captions so that every concept is named often, whatever the number of its wordings."""

    def __init__(self, captions: CaptionSet, rng: np.random.Generator) -> None:
        self.rng = rng
        self.pairs = np.array([i for i, caption in enumerate(captions.training) if len(caption.concepts) > 1])
        self.singles: list[NDArray[np.int64]] = []
        for concept in range(len(captions.concepts)):
            chosen = [i for i, caption in enumerate(captions.training) if caption.concepts == (concept,)]
            self.singles.append(np.array(chosen))

    def draw(self, size: int) -> NDArray[np.int64]:
        """Indices of captions, three quarters about one concept."""
        count = size if not len(self.pairs) else size * 3 // 4
        concepts = self.rng.permutation(np.arange(count) % len(self.singles))
        singles = [self.rng.choice(self.singles[concept]) for concept in concepts if len(self.singles[concept])]
        pairs = self.rng.choice(self.pairs, size=size - count) if len(self.pairs) else []
        return np.concatenate([singles, pairs]).astype(np.int64)


def grading_loss(similarity: Tensor, truth: Tensor, scale: Tensor, bias: Tensor) -> tuple[Tensor, Tensor]:
    """How badly similarities grade.

    The first part is a sigmoid loss over all pairs of motion and caption (Zhai et al. 2023), with graded targets: no true
    pair is ever a negative. The second is one minus the correlation of similarity and truth over the motions, for each
    caption: what a policy that climbs the similarity cares for.

    Args:
        similarity: cosines, `(n, c)`.
        truth: from 0 to 1, `(n, c)`.
        scale: factor of the cosine in the logit.
        bias: offset of the logit.

    Returns:
        Both parts.
    """
    pairs = functional.binary_cross_entropy_with_logits(similarity * scale + bias, truth, weight=1.0 + 3.0 * truth)
    centred = similarity - similarity.mean(0)
    wanted = truth - truth.mean(0)
    spread = wanted.norm(dim=0)
    correlation = (centred * wanted).sum(0) / (centred.norm(dim=0) * spread + 1e-4)
    counts = (spread > 0.5).float()
    return pairs, ((1.0 - correlation) * counts).sum() / counts.sum().clamp(min=1.0)


def learning_rate_at(step: int, steps: int, highest: float) -> float:
    """Rises for 200 steps, then falls along a cosine."""
    return float(highest * min(1.0, (step + 1) / 200) * 0.5 * (1.0 + np.cos(np.pi * min(1.0, step / steps))) + 1e-6)


@dataclass
class Towers:
    """State and text towers with the logit's scale and bias."""

    state: StateTower
    text: TextHead
    logit: nn.ParameterDict


def build_towers(config: EncoderConfig, motions: MotionSet) -> Towers:
    """Untrained towers, normalised to the motions."""
    torch.manual_seed(config.seed)
    both = np.concatenate([motions.observations, motions.observations[:, MIRROR_INDEX] * MIRROR_SIGN])
    scale = np.maximum(both.std(0), 0.02).astype(np.float32)
    state = StateTower(both.mean(0).astype(np.float32), scale, config.feature_size)
    logit = nn.ParameterDict({"scale": nn.Parameter(torch.tensor(10.0)), "bias": nn.Parameter(torch.tensor(-3.0))})
    return Towers(state, TextHead(config.feature_size), logit)


def train_towers(config: EncoderConfig, motions: MotionSet, captions: CaptionSet, tokens_path: Path) -> Towers:
    """Trains state and text towers together.

    Args:
        config: settings.
        motions: training motions.
        captions: captions.
        tokens_path: where the token states of the captions are kept.

    Returns:
        The trained towers; the last checkpoint is `towers.pt` in the run folder.
    """
    states, mask = encode_tokens([caption.text for caption in captions.training], tokens_path)
    towers = build_towers(config, motions)
    mirror = mirrored_concepts(captions.concepts)
    sampler = MotionSampler(motions, mirror, np.random.default_rng(config.seed + 1))
    caption_sampler = CaptionSampler(captions, np.random.default_rng(config.seed + 2))
    modules = nn.ModuleDict({"state": towers.state, "text": towers.text, "logit": towers.logit})
    optimiser = torch.optim.AdamW(modules.parameters(), lr=config.learning_rate, weight_decay=1e-3)
    checkpoint = config.run / "towers.pt"
    first = 0
    if checkpoint.is_file():
        stored = torch.load(checkpoint, weights_only=True)
        modules.load_state_dict(stored["modules"])
        optimiser.load_state_dict(stored["optimiser"])
        first = int(stored["step"])
    progress = tqdm(range(first, config.steps), desc="state and text towers", initial=first, total=config.steps)
    modules.train()
    saved = time.monotonic()
    for step in progress:
        for group in optimiser.param_groups:
            group["lr"] = learning_rate_at(step, config.steps, config.learning_rate)
        observations, truths = sampler.draw(config.state_batch)
        chosen = caption_sampler.draw(config.caption_batch)
        length = int(mask[chosen].sum(1).max())
        truth = captions.truth([captions.training[index] for index in chosen], truths)
        with torch.autocast("cpu", dtype=torch.bfloat16):
            text = towers.text(
                torch.from_numpy(states[chosen, :length].astype(np.float32)),
                torch.from_numpy(mask[chosen, :length].astype(np.float32)),
            )
            state = towers.state(torch.from_numpy(observations))
        similarity = state.float() @ text.float().T
        pairs, order = grading_loss(similarity, torch.from_numpy(truth), towers.logit["scale"], towers.logit["bias"])
        optimiser.zero_grad()
        (pairs + order).backward()
        nn.utils.clip_grad_norm_(modules.parameters(), 1.0)
        optimiser.step()
        if step % 50 == 0:
            progress.set_postfix(pairs=f"{pairs.item():.3f}", correlation=f"{1 - order.item():.3f}")
        if time.monotonic() - saved > 60 or step + 1 == config.steps:
            saved = time.monotonic()
            stored = {"modules": modules.state_dict(), "optimiser": optimiser.state_dict(), "step": step + 1}
            torch.save(stored, checkpoint.with_suffix(".tmp"))
            checkpoint.with_suffix(".tmp").replace(checkpoint)
    modules.eval()
    return towers


def prepare(config: EncoderConfig) -> tuple[MotionSet, CaptionSet]:
    """The motions and captions of a run."""
    clips = motion_library()
    concepts = all_concepts(clips)
    captions = write_captions(np.random.default_rng(config.seed + 3), config.caption_pairs, concepts=concepts)
    return make_motions(config, clips, concepts), captions


def single_captions(captions: CaptionSet) -> list[Caption]:
    """The first wording of each concept."""
    return [Caption(concept.phrases[0], (index,)) for index, concept in enumerate(captions.concepts)]
