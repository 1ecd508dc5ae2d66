"""What the tests of the environments share: which ids there are, and arguments that make them small and quick."""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from small_models import write_controller

import anyskill_envs  # noqa: F401  (registers the environments)
from anyskill_envs.controller import ENCODER_FILE
from motion_data.clip import MotionClip
from motion_data.retrieval import MotionDatabase
from motion_data.skeleton import joint_index, rest_qpos
from rewards import encoder_names, register_encoder

IDS = sorted(id for id, spec in gym.registry.items() if str(spec.entry_point).startswith("anyskill_envs."))
# Lying on the back, head and pelvis on the floor.
LYING = np.concatenate([[0, 0, 0.12, np.sqrt(0.5), 0, -np.sqrt(0.5), 0], np.zeros(28)])

if "small" not in encoder_names():
    register_encoder("small", "small_models:SmallEncoder")


def arguments(environment_id: str, controller: Path) -> dict[str, Any]:
    """Arguments that need no bundled weights."""
    if environment_id == "HumanoidJoints-v0":
        return {"num_threads": 1}
    if environment_id == "HumanoidLatent-v0":
        return {"num_threads": 1, "controller": str(controller)}
    if environment_id == "RetrievalLocomotion-v0":
        folder = controller.parent / "retrieval"
        file = folder / "walk.npz"
        if not file.is_file():
            MotionDatabase.from_clips([walk_clip()]).save(file)
            # zero is no idle latent here: to stand for a whole episode takes a controller that does nothing else
            write_controller(folder, swing=0)
        return {
            "num_threads": 1,
            "controller": str(folder / controller.name),
            "motion_encoder": str(ENCODER_FILE),
            "databases": {"walk": str(file)},
        }
    return {"num_threads": 1, "controller": str(controller), "encoder": "small"}


def walk_clip(name: str = "glide", speed: float = 1.0, turn: float = 0.3, frames: int = 90) -> MotionClip:
    """Feet that swing under a pelvis on its way along an arc: speed in m/s, turn in rad/s."""
    time = np.arange(frames) / 30
    yaw = turn * time
    qpos = np.tile(rest_qpos(), (frames, 1))
    qpos[:, 0] = np.cumsum(speed * np.cos(yaw)) / 30
    qpos[:, 1] = np.cumsum(speed * np.sin(yaw)) / 30
    qpos[:, 3], qpos[:, 6] = np.cos(yaw / 2), np.sin(yaw / 2)
    for joint, sign in (("right_hip_y", 1), ("left_hip_y", -1), ("right_shoulder_y", -1), ("left_shoulder_y", 1)):
        qpos[:, 7 + joint_index(joint)] = sign * 0.4 * np.sin(2 * np.pi * time)
    return MotionClip(name, qpos)


@contextmanager
def warnings_are_errors() -> Iterator[None]:
    """Gymnasium's and SB3's checkers complain with warnings."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


def assert_same(first: Any, second: Any) -> None:
    """Exact equality of nested observations and infos, arrays bit for bit."""
    assert type(first) is type(second)
    if isinstance(first, dict):
        assert first.keys() == second.keys()
        for key in first:
            assert_same(first[key], second[key])
    elif isinstance(first, (list, tuple)) or (isinstance(first, np.ndarray) and first.dtype == object):
        assert len(first) == len(second)
        for one, other in zip(first, second, strict=True):
            assert_same(one, other)
    else:
        np.testing.assert_array_equal(first, second)
