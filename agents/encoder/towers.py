"""Trains state and text towers together."""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional
from tqdm import tqdm

from agents.encoder.captions import CaptionSet
from agents.encoder.config import EncoderConfig
from agents.encoder.dataset import MotionSet
from agents.encoder.material import mirrored_concepts
from agents.encoder.networks import StateTower, TextHead
from agents.encoder.sampling import CaptionSampler, MotionSampler
from agents.encoder.scenes import ObjectLayout
from anyskill_envs.observation import MIRROR_INDEX, MIRROR_SIGN
from motion_data.files import write_whole
from rewards.minilm import load_minilm


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


def input_scales(motions: MotionSet, layout: ObjectLayout) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Mean and scale of the inputs of the state tower, `(223 + m,)`.

    Zero stays zero for objects: it says that there is none. Their scale is that of the scenes in which they are.
    """
    both = np.concatenate([motions.observations, motions.observations[:, MIRROR_INDEX] * MIRROR_SIGN])
    mean, scale = both.mean(0), np.maximum(both.std(0), 0.02)
    spread = np.ones(layout.size)
    start = 0
    for size in layout.sizes.values():
        block = motions.objects[motions.objects[:, start] > 0, start : start + 1 + size]
        if len(block):
            spread[start : start + 1 + size] = np.maximum(np.sqrt((block**2).mean(0)), 0.05)
        start += 1 + size
    return (
        np.concatenate([mean, np.zeros(layout.size)]).astype(np.float32),
        np.concatenate([scale, spread]).astype(np.float32),
    )


def build_towers(config: EncoderConfig, motions: MotionSet, layout: ObjectLayout) -> Towers:
    """Untrained towers, normalised to the motions."""
    torch.manual_seed(config.seed)
    state = StateTower(*input_scales(motions, layout), config.feature_size, config.hidden)
    logit = nn.ParameterDict({"scale": nn.Parameter(torch.tensor(10.0)), "bias": nn.Parameter(torch.tensor(-3.0))})
    return Towers(state, TextHead(config.feature_size), logit)


def train_towers(
    config: EncoderConfig, motions: MotionSet, captions: CaptionSet, layout: ObjectLayout, tokens_path: Path
) -> Towers:
    """Trains state and text towers together.

    Args:
        config: settings.
        motions: training motions.
        captions: captions.
        layout: objects that the motions' scenes hold.
        tokens_path: where the token states of the captions are kept.

    Returns:
        The trained towers; the last checkpoint is `towers.pt` in the run folder.
    """
    states, mask = encode_tokens([caption.text for caption in captions.training], tokens_path)
    towers = build_towers(config, motions, layout)
    mirror = mirrored_concepts(captions.concepts)
    sampler = MotionSampler(motions, mirror, np.random.default_rng(config.seed + 1), layout)
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
        observations, objects, truths = sampler.draw(config.state_batch)
        chosen = caption_sampler.draw(config.caption_batch)
        length = int(mask[chosen].sum(1).max())
        truth = captions.truth([captions.training[index] for index in chosen], truths)
        with torch.autocast("cpu", dtype=torch.bfloat16):
            text = towers.text(
                torch.from_numpy(states[chosen, :length].astype(np.float32)),
                torch.from_numpy(_without_some(mask[chosen, :length].astype(np.float32), sampler.rng)),
            )
            state = towers.state(torch.from_numpy(observations), torch.from_numpy(objects))
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
            write_whole(checkpoint, partial(torch.save, stored))
    modules.eval()
    return towers
