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
from agents.encoder.evaluate import evaluate_encoder
from agents.encoder.exemplars import exemplar_concepts
from agents.encoder.export import export_image_tower, export_towers
from agents.encoder.networks import StateTower, TextHead
from agents.encoder.pictures import picture_index, render_films, train_image_tower
from agents.encoder.sanity import SanityRow, sanity_table
from anyskill_envs.observation import MIRROR_INDEX, MIRROR_SIGN, OBSERVATION_LAYOUT
from motion_data.authored import authored_clips
from motion_data.clip import MotionClip
from motion_data.deepmimic import pybullet_clips
from rewards.bundled import WEIGHTS_FOLDER, BundledEncoder
from rewards.minilm import load_minilm

log = logging.getLogger(__name__)

HELD_OUT_PICTURES = 1000
"""Films that the image tower is measured on."""


@dataclass(frozen=True)
class EncoderConfig:
    """Settings of a training run of the encoder."""

    only: tuple[str, ...] = ()
    """Names of the concepts to train on, for quick trials; all of them if none is given."""
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
        if not len(self.pairs):
            return np.array(singles, dtype=np.int64)
        return np.concatenate([singles, self.rng.choice(self.pairs, size=size - count)]).astype(np.int64)


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


def _without_some(mask: NDArray[np.float32], rng: np.random.Generator) -> NDArray[np.float32]:
    """Hides one token state in twelve, never all: the text tower must not hang on one of them."""
    hidden = mask * (rng.random(mask.shape) > 1 / 12)
    return np.where(hidden.sum(1, keepdims=True) > 0, hidden, mask).astype(np.float32)


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
                torch.from_numpy(_without_some(mask[chosen, :length].astype(np.float32), sampler.rng)),
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
    unknown = set(config.only) - {concept.name for concept in concepts}
    if unknown:
        raise ValueError(f"Unknown concepts: {', '.join(sorted(unknown))}.")
    if config.only:
        concepts = tuple(concept for concept in concepts if concept.name in config.only)
    captions = write_captions(np.random.default_rng(config.seed + 3), config.caption_pairs, concepts=concepts)
    return make_motions(config, clips, concepts), captions


def single_captions(captions: CaptionSet) -> list[Caption]:
    """The first wording of each concept."""
    return [Caption(concept.phrases[0], (index,)) for index, concept in enumerate(captions.concepts)]


def write_card(
    folder: Path, config: EncoderConfig, figures: dict[str, dict[str, float]], rows: list[SanityRow]
) -> None:
    """Writes `MODEL_CARD.md` beside the weights.

    Args:
        folder: the encoder's folder.
        config: settings of the training.
        figures: held-out figures of the "state" and the "image" tower.
        rows: the sanity table.
    """
    names = list(figures["state"])
    table = [
        f"| {name} | {figures['state'][name]:.3f} | {figures['image'].get(name, float('nan')):.3f} |" for name in names
    ]
    sanity = [
        f"| {row.text} | {row.matching:.2f} | {row.best_other[0]:.2f} ({row.best_other[1]}) | {row.mirrored:.2f} | "
        f"{row.idle:.2f} | {row.fallen:.2f} |"
        for row in rows
    ]
    text = (Path(__file__).parent / "model_card_template.md").read_text()
    folder.joinpath("MODEL_CARD.md").write_text(
        text.replace("{{figures}}", "\n".join(table))
        .replace("{{sanity}}", "\n".join(sanity).replace("nan", "-"))
        .replace("{{cosine}}", f"{figures['image']['cosine with state projection']:.3f}")
        .replace("{{seed}}", str(config.seed))
        .replace("{{steps}}", str(config.steps))
        .replace("{{feature_size}}", str(config.feature_size))
        .replace("{{image_motions}}", str(config.image_motions))
        .replace("{{image_size}}", str(config.image_size))
    )


def train(config: EncoderConfig) -> int:
    """Trains the bundled encoder and writes its files and model card.

    A run that was stopped goes on from its last checkpoint.

    Args:
        config: settings.

    Returns:
        0.
    """
    torch.set_num_threads(config.threads)
    out = WEIGHTS_FOLDER if config.out is None else config.out
    config.run.mkdir(parents=True, exist_ok=True)
    motions, captions = prepare(config)
    towers = train_towers(config, motions, captions, config.run / "tokens.npz")
    trained_on = f"{len(motions)} short motions, {len(captions.training)} captions by rules, seed {config.seed}"
    export_towers(out, towers.state, towers.text, config.feature_size, trained_on)
    rng = np.random.default_rng(config.seed + 4)
    index = picture_index(motions, config.image_motions, rng)
    films = render_films(motions.films[index], config.image_size, rng, config.run / "films.npy")
    with torch.no_grad():
        features = towers.state(torch.from_numpy(motions.observations[index])).numpy()
    # The files are read back, so that what is measured is what a user gets.
    encoder = BundledEncoder(out, cache="")
    text_features = encoder.encode_text([concept.phrases[0] for concept in captions.concepts])
    image = train_image_tower(
        films,
        features,
        text_features,
        config.run / "image_tower.pt",
        config.image_epochs,
        config.image_batch,
        config.learning_rate,
        config.seed,
    )
    export_image_tower(out, image, config.image_size, config.feature_size, f"{len(films)} films of 4 frames")
    figures, rows = measure(config, encoder, captions)
    write_card(out, config, figures, rows)
    for tower, values in figures.items():
        for name, value in values.items():
            print(f"{tower:6s} {name:32s} {value:.3f}")
    return 0


def measure(
    config: EncoderConfig, encoder: BundledEncoder, captions: CaptionSet
) -> tuple[dict[str, dict[str, float]], list[SanityRow]]:
    """Figures of both towers on motions of another seed, and the sanity table."""
    clips = motion_library()
    rng = np.random.default_rng(config.seed + 1000)
    tracks = max(8, config.tracks // 2)
    held = join_sets(list(generate(clips, captions.concepts, rng, 1, tracks, config.per_track)))
    figures = {"state": evaluate_encoder(encoder, held, captions, rng)}
    drawn = held.take(picture_index(held, min(HELD_OUT_PICTURES, len(held)), rng))
    # 224 pixels as an environment draws them, in portions that fit into memory
    parts = np.array_split(np.arange(len(drawn)), len(drawn) // 250 + 1)
    feature = np.concatenate(
        [encoder.encode_image(render_films(drawn.films[part], 224, rng, front=True)) for part in parts]
    )
    cosine = (feature * encoder.encode_state(drawn.observations)).sum(1)
    figures["image"] = evaluate_encoder(encoder, drawn, captions, rng, feature)
    figures["image"]["cosine with state projection"] = float(cosine.mean())
    rows = sanity_table(encoder, [clip for clip in clips if not clip.name.endswith("_mirrored")], rng)
    return figures, rows
