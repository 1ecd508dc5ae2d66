"""What a retriever observes: proprioception, the goal, and the clip that the humanoid follows."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from anyskill_envs.actions import FloatArray
from anyskill_envs.goals import FASTEST_GOAL
from anyskill_envs.observation import OBSERVATION_BOUNDS, OBSERVATION_LAYOUT, OBSERVATION_SIZE
from anyskill_envs.retrieved_clips import RetrievedClips
from motion_data.retrieval_keys import CLIP_FRAMES, STATE_SIZE, turned
from motion_data.skeleton import heading

_BLOCKS = {
    "goal_direction": (2, 1.0),  # cosine and sine in the heading frame
    "goal_speed": (1, FASTEST_GOAL),  # m/s
    "clip_state": (STATE_SIZE, OBSERVATION_BOUNDS["body_linear_velocities"]),  # m/s and m, in the clip's heading frame
    "clip_place": (2, 100.0),  # m, in the heading frame
    "clip_heading": (2, 1.0),  # cosine and sine of the turn to the clip's heading
    "clip_time": (1, 1.0),  # share of the clip that is over
}
RETRIEVAL_LAYOUT: dict[str, slice] = dict(OBSERVATION_LAYOUT)
"""Name of each block of the observation and its place, without objects: proprioception comes first."""
_offset = OBSERVATION_SIZE
for _name, (_size, _) in _BLOCKS.items():
    RETRIEVAL_LAYOUT[_name] = slice(_offset, _offset + _size)
    _offset += _size
RETRIEVAL_OBSERVATION_SIZE = _offset
"""258."""
STEERING_BOUNDS = np.concatenate([np.full(size, bound, np.float32) for size, bound in _BLOCKS.values()])
"""Bound of each number that follows proprioception."""


def observe_steering(
    qpos: NDArray[np.float64], goals: NDArray[np.float64], clips: RetrievedClips, ids: NDArray[np.int64] | slice
) -> FloatArray:
    """Goal and clip of k humanoids as they see them, within bounds.

    Args:
        qpos: their poses, ``(k, 35)``.
        goals: their goals, ``(k, 2)`` m/s in the world.
        clips: the clips of all humanoids.
        ids: which of them these are.

    Returns:
        float32 ``(k, 35)``: the blocks of `RETRIEVAL_LAYOUT` after proprioception.
    """
    yaw = heading(qpos[:, 3:7])
    goal = turned(goals, -yaw)
    speed = np.linalg.norm(goal, axis=1, keepdims=True)
    turn = clips.headings[ids] - yaw
    steering = np.concatenate(
        [
            np.where(speed > 0, goal / np.maximum(speed, 1e-9), (1.0, 0.0)),
            speed,
            clips.states[ids],
            turned(clips.places[ids] - qpos[:, :2], -yaw),
            np.stack([np.cos(turn), np.sin(turn), clips.age[ids] / CLIP_FRAMES], 1),
        ],
        axis=1,
    )
    return np.clip(steering, -STEERING_BOUNDS, STEERING_BOUNDS).astype(np.float32)
