"""States of the objects of a scene as the humanoid sees them, and the observation that is made of them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from anyskill_envs.objects.scene import Scene
from anyskill_envs.observation import heading_direction, rotation_axes, turn_to_heading
from rewards.object_state import BLOCKS, ObjectState

if TYPE_CHECKING:
    from anyskill_envs.simulation import HumanoidSimulation

FloatArray = NDArray[np.float32]

BOUNDS = {
    "position": 100.0,  # m from the pelvis
    "rotation": 1.0,
    "facing": 1.0,
    "linear_velocity": 100.0,  # m/s
    "angular_velocity": 500.0,  # rad/s
    "angle": 10.0,  # rad or m
    "angle_velocity": 500.0,  # rad/s or m/s
}
"""Bounds of the observation, far outside of what an object does."""


def object_vectors(simulation: HumanoidSimulation, ids: NDArray[np.int64] | slice = slice(None)) -> FloatArray:
    """States of all objects, one after the other, in the heading frames of their humanoids.

    Args:
        simulation: a simulation of a scene.
        ids: the scenes, k of them.

    Returns:
        float32 ``(k, scene.state_size)``; :func:`object_states` names what is in them.
    """
    scene = simulation.scene
    positions = simulation.world_positions[ids]
    if not scene:
        return np.zeros((len(positions), 0), np.float32)
    quaternions = simulation.world_quaternions[ids]
    cosine, sine = heading_direction(quaternions[:, 1])
    blocks: list[FloatArray] = []
    for part in scene.parts.values():
        state = np.zeros((len(positions), part.state_size), np.float32)
        vectors = state[:, : sum(BLOCKS.values())].reshape(len(positions), 5, 3)
        turn_to_heading(vectors[:, 0], (positions[:, part.body] - positions[:, 1]).T, cosine, sine)
        for place, axis in enumerate(rotation_axes(quaternions[:, part.body].T.astype(np.float32))):
            turn_to_heading(vectors[:, 1 + place], axis, cosine, sine)
        if part.qvel is not None:  # of a free body: origin in the world, angular in its own frame
            turn_to_heading(vectors[:, 3], simulation.qvel[ids, part.qvel][:, :3].T, cosine, sine)
            turn_to_heading(vectors[:, 4], simulation.angular_velocities(part.body)[ids].T, cosine, sine)
        joints = len(part.angles)
        if joints:
            state[:, -2 * joints : -joints] = simulation.qpos[ids][:, part.angles]
            state[:, -joints:] = simulation.qvel[ids][:, part.angle_velocities]
        blocks.append(state)
    return np.concatenate(blocks, axis=1)


def object_states(scene: Scene, vectors: FloatArray) -> dict[str, ObjectState]:
    """What the numbers of :func:`object_vectors` ``(k, scene.state_size)`` mean, by name of the object."""
    sizes = [part.state_size for part in scene.parts.values()]
    pieces = np.split(vectors, np.cumsum(sizes), axis=1)
    return {name: ObjectState.from_vector(piece) for name, piece in zip(scene.parts, pieces, strict=False)}


def observation_layout(scene: Scene) -> dict[str, slice]:
    """Name of each observed block, such as "ball.position", and its place in what is seen of the objects.

    In the observation of an environment these numbers follow the 223 of the proprioception.
    """
    layout: dict[str, slice] = {}
    offset = 0
    for part in scene.parts.values():
        sizes: Mapping[str, int] = BLOCKS | {
            "facing": 2,
            "angle": len(part.angles),
            "angle_velocity": len(part.angles),
        }
        for block in part.observed:
            layout[f"{part.name}.{block}"] = slice(offset, offset + sizes[block])
            offset += sizes[block]
    return layout


def observation_bounds(scene: Scene) -> FloatArray:
    """Bound of each observed number of the objects."""
    pieces = [
        np.full(place.stop - place.start, BOUNDS[name.split(".")[1]], np.float32)
        for name, place in observation_layout(scene).items()
    ]
    return np.concatenate([np.zeros(0, np.float32), *pieces])


def observe_objects(scene: Scene, vectors: FloatArray) -> FloatArray:
    """What a policy observes of the objects whose states are `vectors`, ``(k, m)``; see :func:`observation_layout`."""
    states = object_states(scene, vectors)
    pieces = [np.zeros((len(vectors), 0), np.float32)]  # for a scene whose objects show nothing
    for name, part in scene.parts.items():
        for block in part.observed:
            state = states[name]
            pieces.append(state.rotation[:, :2] if block == "facing" else getattr(state, block))
    return np.concatenate(pieces, axis=1)
