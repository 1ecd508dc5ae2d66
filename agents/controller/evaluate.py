"""How good a controller is: per clip through the encoder, under frozen latents, under random latents."""

from typing import Any, Protocol

import numpy as np

from agents.controller.reference import ReferenceMotions
from agents.controller.tracking import tracking_distance
from anyskill_envs.simulation import CONTROLLER_STEPS, HumanoidSimulation
from motion_data.skeleton import body_index, kinematics

FAILURE_DISTANCE = 0.4
"""Mean distance of the bodies from the reference (metres) at which an episode counts as not survived."""
FALL_HEIGHT = 0.6
"""Height of the centre of the head (metres) below which a humanoid that should be on its feet has fallen."""

ACROBATIC = {"backflip", "cartwheel", "roll", "spin", "spinkick"}
"""Clips with flight or acrobatics, reported apart."""
FLIGHT = {"jump", "run"}
"""Clips with a phase of flight, reported apart from those without."""


class Controller(Protocol):
    """What is evaluated: latents and observations to PD targets."""

    def act(self, observation: np.ndarray, latent: np.ndarray) -> np.ndarray:
        """PD targets ``(n, 28)``."""
        ...


class Encoder(Protocol):
    """Motion windows to latents."""

    def encode(self, windows: np.ndarray) -> np.ndarray:
        """Latents ``(n, 64)``."""
        ...


def evaluate_clips(
    controller: Controller, encoder: Encoder, motions: ReferenceMotions, episodes: int = 20, limit: int = 300
) -> dict[str, dict[str, float]]:
    """Performs each clip through the encoder: z = E(window), renewed at 6 Hz; the policy sees no reference.

    Episodes start from evenly spaced phases of the first half of the clip, with small noise, and last to its end (at most
    ``limit`` controller steps).

    Returns:
        For each clip: ``survival`` (share of episodes whose mean body distance from the reference stays below 0.4 m),
        ``frames`` (share of frames until then), ``error_mm`` (mean body distance in the heading frame, root-relative with
        height, while it survives).
    """
    clips = np.repeat(np.arange(len(motions.names)), episodes)
    room = np.maximum(motions.lengths[clips] - 1 - 30, 0) / 2
    frame = motions.starts[clips] + (np.tile(np.linspace(0, 1, episodes), len(motions.names)) * room).astype(int)
    length = np.minimum(motions.last[frame] - frame, limit)
    simulation = _start(motions, frame, np.random.default_rng(0))
    alive = np.ones(len(clips), bool)
    survived, error = np.zeros(len(clips)), np.zeros(len(clips))
    for step in range(int(length.max())):
        if step % CONTROLLER_STEPS == 0:
            latent = encoder.encode(motions.windows(frame))
        simulation.step(controller.act(simulation.observation(), latent))
        frame = motions.ahead(frame, 1)
        distance = tracking_distance(simulation.observation(), motions.observations[frame])
        running = step < length
        alive &= ~(running & ~(distance < FAILURE_DISTANCE))
        survived += alive & running
        error += np.where(alive & running, distance, 0)
    result = {}
    for clip, name in enumerate(motions.names):
        mine = clips == clip
        result[name] = {
            "survival": float(alive[mine].mean()),
            "frames": float((survived / length)[mine].mean()),
            "error_mm": float(1000 * error[mine].sum() / max(1, survived[mine].sum())),
        }
    return result


def standing_clips(motions: ReferenceMotions) -> np.ndarray:
    """Clips that stand: upright with both feet planted (neither ankle moves by 6 cm), ``(k,)`` indices."""
    return np.array([clip for clip in upright_clips(motions) if _ankle_travel(motions, clip) < 0.06], int)


def upright_clips(motions: ReferenceMotions) -> np.ndarray:
    """Clips that stay on their feet, or on one of them, without travelling (0.6 m), ``(k,)`` indices."""
    chosen = []
    for clip, (start, length) in enumerate(zip(motions.starts, motions.lengths, strict=True)):
        frames = slice(start, start + length)
        travel = np.ptp(motions.qpos[frames, :2], axis=0).max()
        if motions.upright[frames].all() and travel < 0.6:
            chosen.append(clip)
    return np.array(chosen, int)


def _ankle_travel(motions: ReferenceMotions, clip: int) -> float:
    frames = slice(motions.starts[clip], motions.starts[clip] + motions.lengths[clip])
    ankles = kinematics(motions.qpos[frames]).positions[:, [body_index("right_foot"), body_index("left_foot")]]
    return float(np.ptp(ankles, axis=0).max())


def upright_frames(motions: ReferenceMotions, clips: np.ndarray) -> np.ndarray:
    """Frames of some clips that begin a window of at least 1 s, every 1/6 s."""
    frames = [
        np.arange(motions.starts[c], max(motions.starts[c] + 1, motions.last[motions.starts[c]] - 30), 5) for c in clips
    ]
    return np.concatenate(frames)


def evaluate_frozen(
    controller: Controller, encoder: Encoder, motions: ReferenceMotions, seconds: float = 10.0, episodes: int = 8
) -> dict[str, float]:
    """Falls under one latent that never changes, for each upright clip; starts in the clip's own state.

    Returns:
        Share of episodes with a fall, by clip name.
    """
    clips = np.repeat(upright_clips(motions), episodes)
    room = np.maximum(motions.lengths[clips] - 31, 0)
    phase = np.tile(np.linspace(0, 0.9, episodes), len(clips) // episodes)
    frame = motions.starts[clips] + (phase * room).astype(int)
    latent = encoder.encode(motions.windows(frame))
    simulation = _start(motions, frame, np.random.default_rng(0))
    fell = _falls(controller, simulation, lambda step: latent, seconds)
    return {motions.names[clip]: float(fell[clips == clip].mean()) for clip in np.unique(clips)}


def evaluate_random(
    controller: Controller,
    encoder: Encoder,
    motions: ReferenceMotions,
    seconds: float = 10.0,
    episodes: int = 200,
    uniform: bool = False,
    seed: int = 0,
) -> float:
    """Falls while the latent is renewed at random at 6 Hz.

    Args:
        controller: The controller.
        encoder: Its encoder.
        motions: Reference motions; latents come from their standing clips.
        seconds: Length of an episode.
        episodes: Number of episodes.
        uniform: Draw latents uniformly from the sphere instead.
        seed: Seed of the draws.

    Returns:
        Share of episodes with a fall.
    """
    rng = np.random.default_rng(seed)
    frames = upright_frames(motions, standing_clips(motions))
    bank = encoder.encode(motions.windows(frames))
    simulation = _start(motions, rng.choice(frames, episodes), rng)
    latent = bank[:0]

    def renew(step: int) -> np.ndarray:
        nonlocal latent
        if step % CONTROLLER_STEPS == 0:
            if uniform:
                latent = rng.standard_normal((episodes, bank.shape[1])).astype(np.float32)
                latent /= np.linalg.norm(latent, axis=1, keepdims=True)
            else:
                latent = bank[rng.integers(len(bank), size=episodes)]
        return latent

    return float(_falls(controller, simulation, renew, seconds).mean())


def _start(motions: ReferenceMotions, frame: np.ndarray, rng: np.random.Generator) -> HumanoidSimulation:
    simulation = HumanoidSimulation(len(frame))
    qpos, qvel = motions.qpos[frame].copy(), motions.qvel[frame].copy()
    qpos[:, 7:] += 0.01 * rng.standard_normal((len(frame), 28))
    qvel += 0.05 * rng.standard_normal(qvel.shape)
    simulation.reset(np.arange(len(frame)), qpos, qvel)
    return simulation


def _falls(controller: Controller, simulation: HumanoidSimulation, latent_at: Any, seconds: float) -> np.ndarray:
    fell = np.zeros(len(simulation), bool)
    for step in range(round(seconds * 30)):
        diverged = simulation.step(controller.act(simulation.observation(), latent_at(step)))
        fell |= diverged | (simulation.head_height < FALL_HEIGHT)
    return fell


def evaluate_controller(
    controller: Controller, encoder: Encoder, motions: ReferenceMotions, episodes: int = 20
) -> dict[str, Any]:
    """All measurements of the controller, ready for JSON.

    Returns:
        ``clips`` (see :func:`evaluate_clips`); ``frozen_falls`` by upright clip, their mean and highest over the standing
        ones and their mean over the others; ``random_falls``, ``uniform_falls``; and ``summary``: survival and error of
        in-place authored clips, of real clips without flight or acrobatics, and so on.
    """
    clips = evaluate_clips(controller, encoder, motions, episodes)
    frozen = evaluate_frozen(controller, encoder, motions, episodes=episodes)
    standing = {motions.names[clip] for clip in standing_clips(motions)}
    stepping = [rate for name, rate in frozen.items() if name not in standing]
    by_name = {clip.name: clip for clip in motions.clips}

    def group(name: str) -> str:
        clip, base = by_name[name], name.removesuffix("_mirrored")
        if "authored" in clip.source.lower():
            return "authored_in_place" if "act_in_place" in clip.categories else "authored_moving"
        if base in ACROBATIC:
            return "real_acrobatic"
        return "real_with_flight" if base in FLIGHT else "real_without_flight"

    groups: dict[str, list[str]] = {}
    for name in clips:
        groups.setdefault(group(name), []).append(name)
    summary = {
        kind: {
            "clips": len(names),
            "survival": float(np.mean([clips[name]["survival"] for name in names])),
            "lowest_survival": float(np.min([clips[name]["survival"] for name in names])),
            "error_mm": float(np.mean([clips[name]["error_mm"] for name in names])),
        }
        for kind, names in sorted(groups.items())
    }
    return {
        "summary": summary,
        "frozen_falls_mean": float(np.mean([frozen[name] for name in standing])),
        "frozen_falls_highest": float(np.max([frozen[name] for name in standing])),
        "frozen_falls_stepping": float(np.mean(stepping)) if stepping else 0.0,
        "random_falls": evaluate_random(controller, encoder, motions),
        "uniform_falls": evaluate_random(controller, encoder, motions, uniform=True),
        "frozen_falls": frozen,
        "clips": clips,
    }
