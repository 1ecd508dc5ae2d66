"""How a controller keeps its balance: under frozen, random and mixed latents, under pushes, and getting up."""

from collections.abc import Callable
from typing import Any

import numpy as np

from agents.controller.reference import ReferenceMotions
from agents.controller.rollout import Controller, Encoder, LatentAt, falls, held, renewed, repeated_clip, start
from agents.controller.selection import (
    get_up_clips,
    quiet_clips,
    standing_clips,
    upright_clips,
    walking_clips,
    window_frames,
)
from anyskill_envs.simulation import HumanoidSimulation
from motion_data.skeleton import FRAME_RATE

PUSH_STEPS = 6
"""Controller steps of a push: 0.2 s."""
STANDING_HEIGHT = 1.2
"""Height of the centre of the head (metres) above which a humanoid that got up stands; 1.5 m is upright."""

_LYING_NOISE = 0.05  # radians: no two humanoids lie alike
_SETTLE_STEPS = 15  # controller steps on the floor before they get up


def evaluate_frozen(
    controller: Controller, encoder: Encoder, motions: ReferenceMotions, seconds: float = 10.0, episodes: int = 8
) -> dict[str, float]:
    """Falls under one latent that never changes, for each upright clip; starts in the clip's own state.

    Returns:
        Share of episodes with a fall, by clip name.
    """
    clips = np.repeat(upright_clips(motions), episodes)
    if not len(clips):
        return {}
    room = np.maximum(motions.lengths[clips] - 31, 0)
    phase = np.tile(np.linspace(0, 0.9, episodes), len(clips) // episodes)
    frame = motions.starts[clips] + (phase * room).astype(int)
    latent = encoder.encode(motions.windows(frame))
    simulation = start(motions, frame, np.random.default_rng(0))
    fell = falls(controller, simulation, held(latent), seconds)
    return {motions.names[clip]: float(fell[clips == clip].mean()) for clip in np.unique(clips)}


def evaluate_random(
    controller: Controller,
    encoder: Encoder,
    motions: ReferenceMotions,
    seconds: float = 10.0,
    episodes: int = 200,
    uniform: bool = False,
    seed: int = 0,
    clips: np.ndarray | None = None,
) -> float:
    """Falls while the latent is renewed at random at 6 Hz.

    Args:
        controller: The controller.
        encoder: Its encoder.
        motions: Reference motions.
        seconds: Length of an episode.
        episodes: Number of episodes.
        uniform: Draw latents uniformly from the sphere instead of from the clips.
        seed: Seed of the draws.
        clips: Clips whose windows give the latents and first states, ``(k,)`` indices; the standing ones if None.

    Returns:
        Share of episodes with a fall.

    Raises:
        ValueError: If there is no such clip.
    """
    rng = np.random.default_rng(seed)
    frames = window_frames(motions, standing_clips(motions) if clips is None else clips)
    if not len(frames):
        raise ValueError("There is no clip to draw latents from: no clip stands with both feet planted.")
    bank = encoder.encode(motions.windows(frames))
    simulation = start(motions, rng.choice(frames, episodes), rng)

    def draw(step: int) -> np.ndarray:
        if not uniform:
            return bank[rng.integers(len(bank), size=episodes)]
        latent = rng.standard_normal((episodes, bank.shape[1])).astype(np.float32)
        return latent / np.linalg.norm(latent, axis=1, keepdims=True)

    return float(falls(controller, simulation, renewed(draw), seconds).mean())


def evaluate_interpolation(
    controller: Controller,
    encoder: Encoder,
    motions: ReferenceMotions,
    seconds: float = 10.0,
    episodes: int = 100,
    seed: int = 0,
) -> float | None:
    """Falls under the latent half-way between those of two standing clips, on the sphere, frozen.

    Returns:
        Share of episodes with a fall; None with fewer than two standing clips.
    """
    clips = standing_clips(motions)
    if len(clips) < 2:
        return None
    rng = np.random.default_rng(seed)
    one = rng.integers(len(clips), size=episodes)
    other = (one + rng.integers(1, len(clips), size=episodes)) % len(clips)
    frames = [
        np.array([rng.choice(window_frames(motions, clips[[clip]])) for clip in chosen]) for chosen in (one, other)
    ]
    ends = [encoder.encode(motions.windows(chosen)) for chosen in frames]
    middle = ends[0] + ends[1]
    middle /= np.maximum(np.linalg.norm(middle, axis=1, keepdims=True), 1e-6)
    simulation = start(motions, frames[0], rng)
    return float(falls(controller, simulation, held(middle), seconds).mean())


def evaluate_pushes(
    controller: Controller,
    encoder: Encoder,
    motions: ReferenceMotions,
    force: float = 150.0,
    episodes: int = 100,
    seed: int = 0,
) -> dict[str, float | None]:
    """Falls after a push of 0.2 s on the torso, in a random horizontal direction.

    The latent is that of the clip, renewed at 6 Hz from the reference; the clip repeats. The push comes after 1 to 2 s of
    an episode of 5 s.

    Args:
        controller: The controller.
        encoder: Its encoder.
        motions: Reference motions.
        force: Newtons.
        episodes: Episodes standing, and as many walking.
        seed: Seed of the draws.

    Returns:
        Share of episodes with a fall, ``standing`` (the standing clip that moves least) and ``walking`` (loops at 0.3 to
        2 m/s); None where there is no such clip.
    """
    rng = np.random.default_rng(seed)
    result: dict[str, float | None] = {}
    for kind, clips in (("standing", quiet_clips(motions)), ("walking", walking_clips(motions))):
        if not len(clips):
            result[kind] = None
            continue
        first = motions.starts[rng.choice(clips, episodes)]
        frames = first + rng.integers(np.minimum(motions.period[first], motions.last[first] - first))
        simulation = start(motions, frames, rng)
        angle = rng.uniform(-np.pi, np.pi, episodes)
        forces = force * np.stack([np.cos(angle), np.sin(angle), np.zeros(episodes)], 1)
        push = _pusher(simulation, forces, rng.integers(30, 60, episodes))
        latent_at = repeated_clip(encoder, motions, frames)
        result[kind] = float(falls(controller, simulation, latent_at, 5.0, push).mean())
    return result


def _pusher(simulation: HumanoidSimulation, forces: np.ndarray, begin: np.ndarray) -> Callable[[int], None]:
    """Pushes each humanoid's torso with its force ``(n, 3)`` for 0.2 s from its step ``(n,)`` on."""

    def push(step: int) -> None:
        during = (step >= begin) & (step < begin + PUSH_STEPS)
        simulation.push("torso", np.where(during[:, None], forces, 0.0))

    return push


def evaluate_get_up(
    controller: Controller,
    encoder: Encoder,
    motions: ReferenceMotions,
    seconds: float = 6.0,
    episodes: int = 50,
    seed: int = 0,
) -> dict[str, Any]:
    """Getting up: the latents of a get-up clip, renewed at 6 Hz, then the standing clip's.

    Humanoids lie as the clip begins, joints up to 0.1 rad off, and settle for half a second.

    Args:
        controller: The controller.
        encoder: Its encoder.
        motions: Reference motions.
        seconds: When they must stand; the head stays above 1.2 m for the last half second.
        episodes: Episodes of each clip.
        seed: Seed of the draws.

    Returns:
        Share that stands by the best of the clips that get up from lying on the ``front`` and on the ``back`` (None where
        there is none, or no clip that stands), and by each, ``clips``.
    """
    rng = np.random.default_rng(seed)
    quiet, sides = quiet_clips(motions), get_up_clips(motions)
    chosen = np.concatenate(list(sides.values()))
    if not len(chosen) or not len(quiet):
        return {**dict.fromkeys(sides), "clips": {}}
    first = motions.starts[np.repeat(chosen, episodes)]
    stand = encoder.encode(motions.windows(np.full(len(first), motions.starts[quiet[0]])))
    simulation = start(motions, first, rng, _LYING_NOISE)
    lying = simulation.qpos[:, 7:].copy()
    for _ in range(_SETTLE_STEPS):
        simulation.step(lying)
    latent_at = _clip_then(encoder, motions, first, stand)
    steps = round(seconds * FRAME_RATE)
    up = np.ones(len(first), bool)
    for step in range(steps):
        up &= ~simulation.step(controller.act(simulation.observation(), latent_at(step)))
        if step >= steps - 15:
            up &= simulation.head_height > STANDING_HEIGHT
    rates = {clip: float(share) for clip, share in zip(chosen, up.reshape(-1, episodes).mean(1), strict=True)}
    best = {side: max((rates[clip] for clip in clips), default=None) for side, clips in sides.items()}
    return {**best, "clips": {motions.names[clip]: rate for clip, rate in rates.items()}}


def _clip_then(encoder: Encoder, motions: ReferenceMotions, first: np.ndarray, then: np.ndarray) -> LatentAt:
    """Latents of clips from their first frames ``(n,)`` on, and others ``(n, 64)`` when they have ended."""

    def latents(step: int) -> np.ndarray:
        clip = encoder.encode(motions.windows(motions.ahead(first, step)))
        return np.where((first + step < motions.last[first])[:, None], clip, then)

    return renewed(latents)
