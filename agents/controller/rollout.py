"""Running a controller on many humanoids at once: under given latents until they fall, or performing clips on record."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from agents.controller.reference import ReferenceMotions
from anyskill_envs.simulation import CONTROLLER_STEPS, HumanoidSimulation
from motion_data.skeleton import FRAME_RATE

FALL_HEIGHT = 0.6
"""Height of the centre of the head (metres) below which a humanoid that should be on its feet has fallen."""

LatentAt = Callable[[int], np.ndarray]
"""Latents ``(n, 64)`` of a controller step."""


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


def start(
    motions: ReferenceMotions, frames: np.ndarray, rng: np.random.Generator | None, joint_noise: float = 0.01
) -> HumanoidSimulation:
    """Humanoids in the states of some reference frames.

    Args:
        motions: The reference motions.
        frames: Frames, ``(n,)``.
        rng: Source of noise on joint angles and velocities; no noise if None.
        joint_noise: Standard deviation of the noise on joint angles, radians; that on velocities is five times as large.

    Returns:
        The simulation of n humanoids.
    """
    simulation = HumanoidSimulation(len(frames))
    qpos, qvel = motions.qpos[frames].copy(), motions.qvel[frames].copy()
    if rng is not None:
        qpos[:, 7:] += joint_noise * rng.standard_normal((len(frames), 28))
        qvel += 5 * joint_noise * rng.standard_normal(qvel.shape)
    simulation.reset(np.arange(len(frames)), qpos, qvel)
    return simulation


def held(latents: np.ndarray) -> LatentAt:
    """Latents that never change."""
    return lambda step: latents


def renewed(latents: Callable[[int], np.ndarray]) -> LatentAt:
    """Latents that are computed anew at 6 Hz, and held in between."""
    current = np.zeros(0)

    def latent_at(step: int) -> np.ndarray:
        nonlocal current
        if step % CONTROLLER_STEPS == 0:
            current = latents(step)
        return current

    return latent_at


def repeated_clip(encoder: Encoder, motions: ReferenceMotions, frames: np.ndarray) -> LatentAt:
    """Latents of the reference from some frames on, at 6 Hz; the first two seconds of its clip again and again.

    A loop repeats in whole cycles, so that the motion goes on for ever.
    """
    first = motions.starts[motions.clip_of_frame[frames]]
    cycle = np.minimum(motions.period[frames], motions.last[frames] - first)
    return renewed(lambda step: encoder.encode(motions.windows(first + (frames - first + step) % np.maximum(cycle, 1))))


def falls(
    controller: Controller,
    simulation: HumanoidSimulation,
    latent_at: LatentAt,
    seconds: float,
    before_step: Callable[[int], None] | None = None,
) -> np.ndarray:
    """Runs humanoids that should stay on their feet; those that fall are no longer simulated.

    Args:
        controller: The controller.
        simulation: Humanoids in their first states.
        latent_at: Latents by controller step.
        seconds: How long.
        before_step: Called with the number of each step before it, such as to push.

    Returns:
        Which fell (head below 0.6 m, or diverged), ``(n,)`` bool.
    """
    fell = np.zeros(len(simulation), bool)
    targets = np.zeros((len(simulation), 28), np.float32)
    for step in range(round(seconds * FRAME_RATE)):
        running = np.flatnonzero(~fell)
        if not len(running):
            break
        if before_step is not None:
            before_step(step)
        targets[running] = controller.act(simulation.observation()[running], latent_at(step)[running])
        diverged = simulation.step(targets, active=~fell)
        fell |= diverged | (simulation.head_height < FALL_HEIGHT)
    return fell


@dataclass(frozen=True)
class Performance:
    """What humanoids did that performed clips from their first frames, and what they should have done.

    Attributes:
        clips: Clip of each performance, ``(n,)``.
        lengths: Frames of each, ``(n,)``; what comes after is no part of it.
        qpos: Poses, ``(n, T, 35)``.
        positions: World positions of the bodies, ``(n, T, 15, 3)``.
        quaternions: World orientations of the bodies, w first, ``(n, T, 15, 4)``.
    """

    clips: np.ndarray
    lengths: np.ndarray
    qpos: np.ndarray
    positions: np.ndarray
    quaternions: np.ndarray


def perform(
    controller: Controller,
    encoder: Encoder,
    motions: ReferenceMotions,
    clips: np.ndarray,
    rng: np.random.Generator | None = None,
    limit: int = 300,
) -> Performance:
    """Performs clips through the encoder: z = E(window), renewed at 6 Hz; the policy sees no reference.

    Args:
        controller: The controller.
        encoder: Its encoder.
        motions: Reference motions.
        clips: Indices of the clips, ``(n,)``; one may come several times.
        rng: Source of small noise on the first states; none if None.
        limit: Longest performance, controller steps.

    Returns:
        The record, beginning with the first states.
    """
    first = motions.starts[clips]
    steps = np.minimum(motions.lengths[clips] - 1, limit)
    simulation = start(motions, first, rng)
    frames = int(steps.max()) + 1
    qpos = np.empty((len(clips), frames, 35), np.float32)
    positions = np.empty((len(clips), frames, 15, 3), np.float32)
    quaternions = np.empty((len(clips), frames, 15, 4), np.float32)
    latent_at = renewed(lambda step: encoder.encode(motions.windows(motions.ahead(first, step))))
    for step in range(frames):
        qpos[:, step] = simulation.qpos
        positions[:, step] = simulation.body_positions
        quaternions[:, step] = simulation.body_quaternions
        if step + 1 < frames:
            targets = controller.act(simulation.observation(), latent_at(step))
            simulation.step(targets, active=step < steps)
    return Performance(clips, steps + 1, qpos, positions, quaternions)
