"""What `info` holds, in Gymnasium's format of vector environments: arrays beside boolean masks."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from anyskill_envs.actions import FloatArray
from anyskill_envs.objects.state import object_states
from anyskill_envs.simulation import HumanoidSimulation
from rewards import RewardOutput


def reward_entries(output: RewardOutput) -> dict[str, NDArray[np.float32]]:
    """The entries of `info` that a reward makes, ``(n,)`` each."""
    entries = {f"reward_{name}": value for name, value in output.terms.items()}
    if output.similarity is not None:
        entries["similarity"] = output.similarity
    return entries


def state_entries(simulation: HumanoidSimulation, object_vectors: FloatArray) -> dict[str, NDArray[Any]]:
    """The entries of `info` that describe the present state, new arrays ``(n,)``.

    Args:
        simulation: the simulation.
        object_vectors: states of the objects, ``(n, m)``; see :func:`anyskill_envs.objects.state.object_vectors`.
    """
    qpos = simulation.qpos
    entries: dict[str, NDArray[Any]] = {
        "x_position": qpos[:, 0].copy(),
        "x_velocity": simulation.qvel[:, 0].copy(),
        "distance_from_origin": np.hypot(qpos[:, 0], qpos[:, 1]),
        "head_height": simulation.head_height,
    }
    for name, state in object_states(simulation.scene, object_vectors).items():
        entries[f"{name}_distance"] = np.hypot(state.position[:, 0], state.position[:, 1])
        entries[f"{name}_speed"] = np.linalg.norm(state.linear_velocity, axis=1)
        if state.angle.shape[1]:
            entries[f"{name}_angle"] = state.angle[:, 0].copy()
    return entries


def with_masks(info: dict[str, NDArray[Any]], mask: NDArray[np.bool_]) -> dict[str, Any]:
    """Put beside each key, as ``_key``, the humanoids that have it."""
    return info | {f"_{key}": mask.copy() for key in info}


def final_entries(observation: FloatArray, info: dict[str, NDArray[Any]], done: NDArray[np.bool_]) -> dict[str, Any]:
    """Last observation and info of the episodes that are done, in the format of the "SameStep" autoreset mode."""
    final_obs = np.full(len(done), None, dtype=object)
    for index in np.flatnonzero(done):
        final_obs[index] = observation[index].copy()
    final_info = with_masks({key: value.copy() for key, value in info.items()}, done)
    return {"final_obs": final_obs, "_final_obs": done.copy(), "final_info": final_info, "_final_info": done.copy()}
