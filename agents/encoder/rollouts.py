"""What simulated bodies do: they follow motions and fall, or are driven by the frozen controller, beside objects or not."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from agents.text.candidates import library_candidates
from agents.text.steering import SteeredCandidates
from anyskill_envs.controller import LowLevelController
from anyskill_envs.objects import Placement
from anyskill_envs.objects.scene import Scene
from anyskill_envs.objects.state import object_vectors
from anyskill_envs.simulation import CONTROLLER_STEPS, HumanoidSimulation
from motion_data.clip import MotionClip

FloatArray = NDArray[np.float64]
Tracks = tuple[FloatArray, FloatArray]
"""Poses `(frames, n, 35)`, or those of a scene, and velocities `(frames, n, 34)`, or those of a scene."""

_PUSH = 120.0  # N, standard deviation in each direction, for a third of a second
_ROLLING = 4.0  # m/s, fastest object that rolls at the start


def simulated_tracks(rng: np.random.Generator, poses: FloatArray, velocities: FloatArray) -> Tracks:
    """What bodies do that follow motions by their joint targets alone, with pushes: they sway, stumble, fall and lie.

    Args:
        rng: draws pushes.
        poses: motions to follow, `(frames, n, 35)`.
        velocities: their velocities, `(frames, n, 34)`.

    Returns:
        Simulated poses and velocities, of the same shapes.
    """
    frames, count, _ = poses.shape
    simulation = HumanoidSimulation(count, num_threads=1)
    simulation.reset(np.arange(count), poses[0], velocities[0])
    record_poses, record_velocities = np.empty_like(poses), np.empty_like(velocities)
    for frame in range(frames):
        record_poses[frame], record_velocities[frame] = simulation.qpos, simulation.qvel
        if frame % 10 == 0:
            _push(rng, simulation)
        simulation.step(poses[frame, :, 7:] + 0.05 * velocities[frame, :, 6:])
    return record_poses, record_velocities


def controller_tracks(
    rng: np.random.Generator,
    count: int,
    frames: int,
    controller: LowLevelController,
    clips: Sequence[MotionClip] = (),
    scene: Scene | None = None,
    placements: Mapping[str, Placement] | None = None,
    favoured: Sequence[str] = (),
    pushed: bool | None = None,
    rolling: bool = False,
) -> Tracks:
    """What the frozen controller does with latents of clips, between clips and at random, renewed at random times.

    With clips, two bodies in three begin in the midst of one, lying and sitting ones too. Pushed bodies fall at times, and
    what the controller does with a fallen body is among the motions.

    Args:
        rng: draws latents, starts, pushes and places of objects.
        count: how many.
        frames: how long, at 30 per second.
        controller: the frozen controller.
        clips: where bodies may begin; all stand in the rest pose if there is none.
        scene: objects beside each humanoid.
        placements: where these are put, by name; their own placements if None.
        favoured: parts of names of clips whose latents half of the draws take.
        pushed: whether bodies are pushed now and then; by default where there are clips.
        rolling: whether the object of the scene rolls anywhere at the start.

    Returns:
        Poses `(frames, count, pose_size)` and velocities `(frames, count, nv)`.
    """
    scene = Scene() if scene is None else scene
    simulation = HumanoidSimulation(count, num_threads=1, scene=scene)
    library = controller.latents
    wanted = np.flatnonzero([any(part in str(name) for part in favoured) for name in controller.clip_names])

    def draw(size: int) -> FloatArray:
        first, second = library[rng.integers(len(library), size=(2, size))]
        if len(wanted):
            first = np.where(rng.random((size, 1)) < 0.5, library[rng.choice(wanted, size)], first)
        mixed = np.where(rng.random((size, 1)) < 0.6, first, first + second * rng.random((size, 1)))
        mixed = mixed + rng.normal(0, 0.3, mixed.shape) * (rng.random((size, 1)) < 0.3)
        return mixed / np.linalg.norm(mixed, axis=1, keepdims=True)

    _begin(rng, simulation, clips, placements, rolling)
    latents = draw(count)

    def drive(frame: int) -> FloatArray:
        renewed = np.flatnonzero(rng.random(count) < 0.04)
        latents[renewed] = draw(len(renewed))
        if (bool(clips) if pushed is None else pushed) and frame % 10 == 0:
            _push(rng, simulation)
        return latents

    return _driven(simulation, controller, frames, drive)


def seeking_tracks(
    rng: np.random.Generator,
    count: int,
    frames: int,
    controller: LowLevelController,
    scene: Scene,
    placements: Mapping[str, Placement],
    favoured: Sequence[str],
    rolling: bool = False,
) -> Tracks:
    """What the frozen controller does when it walks to the object of a scene and does something there, again and again.

    That is where a policy that is rewarded for a relation to the object will be. See :mod:`agents.text.steering`.

    Args:
        rng: draws who does what, starts and places.
        count: how many.
        frames: how long, at 30 per second.
        controller: the frozen controller.
        scene: the object beside each humanoid.
        placements: where it is put.
        favoured: parts of names of the clips whose latents are played at the object.
        rolling: see :func:`controller_tracks`.

    Returns:
        Poses `(frames, count, pose_size)` and velocities `(frames, count, nv)`.
    """
    simulation = HumanoidSimulation(count, num_threads=1, scene=scene)
    _begin(rng, simulation, (), placements, rolling)
    library = library_candidates(controller.latents, controller.clip_names)
    doings = [candidate for candidate in library if any(part in candidate.name for part in favoured)]
    candidates = SteeredCandidates(controller.latents, controller.clip_names, doings or library, rng)
    seekers = [candidates.draw() for _ in range(count)]
    latents = np.zeros((count, controller.latent_size))

    def drive(frame: int) -> FloatArray:
        if frame % CONTROLLER_STEPS == 0:
            places = object_vectors(simulation)[:, :2]
            decision = frame // CONTROLLER_STEPS
            latents[:] = np.concatenate([seeker.act(decision, places[[row]]) for row, seeker in enumerate(seekers)])
        return latents

    return _driven(simulation, controller, frames, drive)


def _driven(
    simulation: HumanoidSimulation, controller: LowLevelController, frames: int, drive: Callable[[int], FloatArray]
) -> Tracks:
    """What the controller does with the latents `(n, 64)` that `drive` gives for each frame."""
    poses = np.empty((frames, len(simulation), simulation.pose_size))
    velocities = np.empty((frames, len(simulation), simulation.qvel.shape[1]))
    for frame in range(frames):
        latents = drive(frame)
        poses[frame], velocities[frame] = simulation.poses, simulation.qvel
        simulation.step(controller.act(simulation.observation(), latents.astype(np.float32)))
    return poses, velocities


def _push(rng: np.random.Generator, simulation: HumanoidSimulation) -> None:
    count = len(simulation)
    simulation.push("torso", rng.normal(0, _PUSH, (count, 3)) * (rng.random((count, 1)) < 0.15))


def _begin(
    rng: np.random.Generator,
    simulation: HumanoidSimulation,
    clips: Sequence[MotionClip],
    placements: Mapping[str, Placement] | None,
    rolling: bool,
) -> None:
    """Puts bodies into the rest pose or into frames of clips, and objects around them, at rest or rolling."""
    count, scene = len(simulation), simulation.scene
    qpos = np.repeat(scene.rest_pose[None, :35], count, 0)
    qvel = np.zeros((count, 34))
    for row in np.flatnonzero(rng.random(count) < 2 / 3) if clips else ():
        clip = clips[int(rng.integers(len(clips)))]
        frame = rng.integers(len(clip))
        qpos[row], qvel[row] = clip.qpos[frame], clip.qvel[frame]
    if scene:
        qpos, qvel = scene.place(qpos, qvel, placements or scene.placements(None), 0.0, rng)
    if rolling:
        direction = rng.uniform(-np.pi, np.pi, count)
        speed = rng.uniform(0.0, _ROLLING, count)
        # The velocity of the object follows the 34 numbers of the humanoid.
        qvel[:, 34:36] = speed[:, None] * np.stack([np.cos(direction), np.sin(direction)], axis=1)
    simulation.reset(np.arange(count), qpos, qvel)
