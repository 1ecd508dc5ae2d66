"""Clips on the floor, authored by key poses: lying, sitting, rolling over, getting up.

``assets/floor.yaml`` gives the angles of all joints and the orientation of the pelvis. The body rests on the floor with
whatever is lowest; where the feet are planted, the legs follow by inverse kinematics. The motion is slow and supported
at all times, so that a simulated body can follow it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from motion_data.authored import interpolate
from motion_data.balance import FootPath
from motion_data.clip import MotionClip
from motion_data.clip_table import clip_and_twin, read_table
from motion_data.inverse_kinematics import LEG_COLUMNS, SIDES, centre_of_mass, solve_leg
from motion_data.retarget import place_feet
from motion_data.skeleton import (
    FRAME_RATE,
    JOINT_NAMES,
    QPOS_SIZE,
    body_index,
    joint_index,
    joint_limits,
    kinematics,
    lowest_point,
)

FLOOR_YAML = Path(__file__).parent / "assets" / "floor.yaml"
"""The file of key poses."""

_ROOT_FIELDS = ("x", "y", "height", "turn", "pitch", "roll", "spin")
_FEET_FIELDS = ("ahead", "apart", "toe_out")
_BALANCE_STEPS = 12
_TRUNK = np.array([body_index(name) for name in ("pelvis", "torso", "head")])
_LIMBS = [
    (np.array([body_index(f"{side}_{part}") for part in parts]), [f"{side}_{joint}_x", f"{side}_{joint}_y"])
    for side in SIDES
    for joint, parts in (("hip", ("thigh", "shin", "foot")), ("shoulder", ("upper_arm", "lower_arm", "hand")))
]
_GIVE_WAY_STEPS = 6
_PROBE = 0.01  # radians
_DAMPING = 0.02  # square metres per square radian: a hinge that hardly lifts the limb turns little
_SMOOTHING = 1.5  # frames


@dataclass(frozen=True)
class FloorKey:
    """One key pose.

    Attributes:
        time: Seconds since the start of the clip.
        root: Values of ``x, y, height`` in metres and ``turn, pitch, roll, spin`` in radians.
        joints: The 28 hinge angles in radians.
        feet: Values of ``ahead, apart`` in metres and ``toe_out`` in radians of the planted soles; None if they are not.
    """

    time: float
    root: np.ndarray
    joints: np.ndarray
    feet: np.ndarray | None

    def channels(self) -> np.ndarray:
        """All numbers of the key in one row, ``(38,)``."""
        return np.concatenate([self.root, self.joints, np.zeros(3) if self.feet is None else self.feet])


def _poses(rows: np.ndarray, planted: np.ndarray) -> np.ndarray:
    """Poses ``(T, 35)`` of rows of channels ``(T, 38)``; legs by inverse kinematics where the feet are planted."""
    root, joints, feet = np.split(rows, [7, 35], axis=1)
    qpos = np.zeros((len(rows), QPOS_SIZE))
    qpos[:, :3], qpos[:, 7:] = root[:, :3], joints
    # Spin is the turn about the body's own long axis: what a lying body does when it rolls over.
    rotation = Rotation.from_euler("ZYX", root[:, 3:6]) * Rotation.from_euler("z", root[:, 6:])
    qpos[:, 3:7] = rotation.as_quat(scalar_first=True)
    if planted.any():
        ahead, apart, toe_out = feet[planted].T
        zero = np.zeros_like(ahead)
        for side, sign in zip(SIDES, (-1, 1), strict=True):
            places = np.stack([ahead, 0.5 * sign * apart, sign * toe_out, zero, zero, zero], 1)
            foot = FootPath.place(side, places)
            matrix = rotation.as_matrix()[planted]
            leg = solve_leg(side, root[planted, :3], matrix, foot.ankle, foot.rotation, foot.leftward, zero)
            qpos[np.ix_(planted, 7 + np.array(LEG_COLUMNS[side]))] = leg.angles
    return qpos


def _rest_trunk(qpos: np.ndarray, free: np.ndarray) -> None:
    """Lays the trunk on the floor, in place; limbs that would be under the floor give way.

    Args:
        qpos: Poses, ``(T, 35)``.
        free: Frames in which the feet are not planted, ``(T,)`` bool; in the others only the arms give way.
    """
    poses = qpos.copy()
    poses[free, 2] -= kinematics(poses[free]).clearance[:, _TRUNK].min(1)
    for bodies, hinges in _LIMBS:
        columns = [7 + joint_index(name) for name in hinges]
        moves = free if "hip" in hinges[0] else np.ones(len(qpos), bool)
        for _ in range(_GIVE_WAY_STEPS):
            height = kinematics(poses).clearance[:, bodies].min(1)
            slopes = np.zeros((len(poses), len(columns)))
            for number, column in enumerate(columns):
                moved = poses.copy()
                moved[:, column] += _PROBE
                slopes[:, number] = (kinematics(moved).clearance[:, bodies].min(1) - height) / _PROBE
            steep = (slopes**2).sum(1) + _DAMPING
            poses[:, columns] += slopes * (moves * np.maximum(-height, 0) / steep)[:, None]
    limits = joint_limits()
    change = np.clip(poses[:, 7:], limits[:, 0], limits[:, 1]) - qpos[:, 7:]
    legs = np.concatenate([LEG_COLUMNS[side] for side in SIDES])
    # Each frame has found its own way: smooth what was changed.
    change = gaussian_filter1d(change, _SMOOTHING, axis=0, mode="nearest")
    change[np.ix_(~free, legs)] = 0
    qpos[:, 7:] += change
    qpos[:, 2] = poses[:, 2]


def _read_key(clip: str, time: float, entry: dict[str, Any], feet: np.ndarray | None) -> FloorKey:
    """A key whose missing numbers are found: the height from the floor, x from the balance over planted feet."""
    joints = np.zeros(len(JOINT_NAMES))
    for column, name in enumerate(JOINT_NAMES):
        both = "both_" + name.removeprefix("right_").removeprefix("left_")
        if name in entry:
            joints[column] = entry[name]
        elif both in entry and name.startswith(("right_", "left_")):
            opposite = name.startswith("left_") and name.endswith(("_x", "_z"))
            joints[column] = -entry[both] if opposite else entry[both]
    known = {*_ROOT_FIELDS, "feet", "balanced", *JOINT_NAMES}
    known |= {name.replace("right_", "both_") for name in JOINT_NAMES}
    unknown = sorted(set(entry) - known)
    if unknown:
        raise ValueError(f"Clip '{clip}': unknown fields {unknown}. A key knows {', '.join(sorted(known))}.")
    root = np.array([float(entry.get(name, 0.0)) for name in _ROOT_FIELDS])
    root[3:] = np.radians(root[3:])
    key = FloorKey(time, root, np.radians(joints), feet)
    planted = np.array([feet is not None])
    pose = _poses(key.channels()[None], planted)
    if entry.get("balanced"):
        if feet is None:
            raise ValueError(f"Clip '{clip}': a balanced key needs planted feet.")
        for _ in range(_BALANCE_STEPS):
            root[0] += feet[0] - centre_of_mass(pose)[0, 0]
            pose = _poses(key.channels()[None], planted)
    if "height" not in entry:
        root[2] -= lowest_point(pose)[0]
    return replace(key, joints=pose[0, 7:].copy())


def _clip_poses(name: str, entry: Mapping[str, Any], poses: Mapping[str, Mapping[str, Any]]) -> np.ndarray:
    """Poses of a clip of the file, ``(T, 35)``."""
    keys: list[FloorKey] = []
    time = 0.0
    for given in entry["keys"]:
        fields = dict(given)
        pose = fields.pop("pose", None)
        if pose is not None and pose not in poses:
            raise ValueError(f"Clip '{name}': unknown pose '{pose}'. The poses are: {', '.join(poses)}.")
        fields = {**(poses[pose] if pose else {}), **fields}
        seconds, hold = float(fields.pop("seconds", 0.6 if keys else 0.0)), float(fields.pop("hold", 0.0))
        if keys and seconds <= 0:
            raise ValueError(f"Clip '{name}': `seconds` must be positive in every entry but the first.")
        time += seconds
        feet = None
        if "feet" in fields:
            ahead, apart, toe_out = fields["feet"]
            feet = np.array([ahead, apart, np.radians(toe_out)])
        keys.append(_read_key(name, time, fields, feet))
        if hold:
            time += hold
            keys.append(replace(keys[-1], time=time))
    if len(keys) < 2:
        raise ValueError(f"Clip '{name}' needs at least two key poses, or one with `hold`.")
    times, planted = np.array([key.time for key in keys]), np.array([key.feet is not None for key in keys])
    rows = interpolate(times, np.stack([key.channels() for key in keys]))
    # Feet are planted between two keys that plant them.
    segment = np.clip(np.searchsorted(times, np.arange(len(rows)) / FRAME_RATE, side="right") - 1, 0, len(keys) - 2)
    stands = planted[segment] & planted[segment + 1]
    qpos = _poses(rows, stands)
    if entry.get("trunk_rests"):
        _rest_trunk(qpos, ~stands)
    return place_feet(qpos, np.zeros(len(rows), bool))


def read_floor(path: str | Path = FLOOR_YAML) -> list[MotionClip]:
    """Builds the clips of a file of key poses on the floor.

    Args:
        path: YAML file with ``poses`` and ``clips``; the header of the bundled one explains the fields.

    Returns:
        The clips, in the order of the file; a mirrored twin follows its original.

    Raises:
        FileNotFoundError: If there is no such file.
        ValueError: If an entry cannot be understood; the message names the clip.
    """
    content = read_table(path, "clips")
    clips = []
    for name, entry in content["clips"].items():
        qpos = _clip_poses(name, entry, content.get("poses", {}))
        clips += clip_and_twin(name, entry, qpos, "authored by this project", bool(entry.get("loop", False)))
    return clips


@cache
def _bundled() -> tuple[MotionClip, ...]:
    return tuple(read_floor())


def floor_clips() -> list[MotionClip]:
    """The bundled clips on the floor at 30 frames per second."""
    return list(_bundled())
