"""Motion of a skeleton of any kind, as motion capture files hold it: named joints that move and turn in space.

Every reader of such a format (:mod:`motion_data.bvh`, :mod:`motion_data.asf_amc`, :mod:`motion_data.amass`) ends here;
:func:`motion_data.joint_retarget.retarget` makes a clip of our skeleton from it.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from motion_data.inverse_kinematics import SIDES

UpAxis = Literal["y", "z"]

Y_UP_TO_OURS = np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0]], float)
"""Matrix from axes with y up, z forward, x left to ours."""

# Names of each role after lower case and without separators, most telling first: BVH files of CMU, Mixamo, SFU, LaFAN and
# Unreal, and the bones of ASF files.
_CENTRE_ROLES = {
    "pelvis": ("hips", "hip", "pelvis", "root"),
    "neck": ("neck", "neck1", "neck01", "lowerneck"),
    "head": ("head",),
}
_SIDE_ROLES = {
    "shoulder": ("arm", "upperarm", "uparm", "humerus", "shoulder"),
    "elbow": ("forearm", "lowerarm", "lowarm", "radius", "elbow"),
    "wrist": ("hand", "wrist"),
    "hip": ("upleg", "upperleg", "thigh", "femur", "hip", "hipjoint"),
    "knee": ("leg", "lowerleg", "lowleg", "knee", "shin", "calf", "tibia"),
    "ankle": ("foot", "ankle"),
    "toe": ("toebase", "toe", "toes", "ball"),
}
_OPTIONAL = {"right_toe", "left_toe"}
ROLES = (*_CENTRE_ROLES, *(f"{side}_{role}" for side in SIDES for role in _SIDE_ROLES))
"""Joints of a file that retargeting looks for; toes may be missing."""


@dataclass(frozen=True)
class JointMotion:
    """Content of a motion capture file.

    Attributes:
        names: Joints, parents before children; without end sites.
        parents: Index of each joint's parent, -1 for the root.
        offsets: Place of each joint in the frame of its parent, ``(J, 3)`` in the file's units.
        positions: Place of each joint in space, ``(T, J, 3)``.
        rotations: Orientation of each joint in space, ``(T, J, 3, 3)``.
        fps: Frames per second.
    """

    names: tuple[str, ...]
    parents: tuple[int, ...]
    offsets: np.ndarray
    positions: np.ndarray
    rotations: np.ndarray
    fps: float

    def thinned(self, fps: float) -> "JointMotion":
        """Every k-th frame, where the frame rate is k times ``fps``; unchanged where it is no whole multiple."""
        step = round(self.fps / fps)
        if step < 2 or abs(self.fps / fps - step) > 1e-3:
            return self
        return replace(self, positions=self.positions[::step], rotations=self.rotations[::step], fps=self.fps / step)


def place_joints(
    parents: Sequence[int], translations: np.ndarray, rotations: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Forward kinematics of a tree of joints.

    Args:
        parents: Index of each joint's parent, which comes before it; -1 for the root.
        translations: Place of each joint in the frame of its parent, ``(T, J, 3)``.
        rotations: Rotation of each joint against its parent, ``(T, J, 3, 3)``.

    Returns:
        Positions ``(T, J, 3)`` and orientations ``(T, J, 3, 3)`` in space.
    """
    positions, orientations = np.array(translations, float), np.array(rotations, float)
    for joint, parent in enumerate(parents):
        if parent >= 0:
            turned = np.einsum("tij,tj->ti", orientations[:, parent], translations[:, joint])
            positions[:, joint] = positions[:, parent] + turned
            orientations[:, joint] = orientations[:, parent] @ rotations[:, joint]
    return positions, orientations


def map_joints(names: Sequence[str], given: Mapping[str, str] | None = None) -> dict[str, int]:
    """Finds the joints of the body among those of a file.

    Args:
        names: Joints of the file.
        given: Names for some of :data:`ROLES`, where the file's own are unusual.

    Returns:
        Index of the joint by role.

    Raises:
        ValueError: If joints cannot be found; the message lists them and those of the file.
    """
    given = dict(given or {})
    wrong = [role for role in given if role not in ROLES] + [name for name in given.values() if name not in names]
    if wrong:
        raise ValueError(
            f"Unknown in the joint mapping: {wrong}. Roles: {', '.join(ROLES)}. Joints: {', '.join(names)}."
        )
    plain = [re.sub(r"[^a-z0-9]", "", name.lower().split(":")[-1].removeprefix("mixamorig")) for name in names]
    found = {role: names.index(name) for role, name in given.items()}
    for role in ROLES:
        if role not in found:
            index = next((plain.index(alias) for alias in _aliases(role) if alias in plain), None)
            if index is not None:
                found[role] = index
    missing = [role for role in ROLES if role not in found and role not in _OPTIONAL]
    if missing:
        raise ValueError(
            f"No joint found for {', '.join(missing)}. The file's joints are: {', '.join(names)}. Rename them, or say "
            f'which is which: `--joints {missing[0]} NAME`, or joints={{"{missing[0]}": "NAME"}} in Python.'
        )
    return found


def _aliases(role: str) -> list[str]:
    if role in _CENTRE_ROLES:
        return list(_CENTRE_ROLES[role])
    side, part = role.split("_")
    return [
        form for alias in _SIDE_ROLES[part] for form in (side + alias, side[0] + alias, alias + side, alias + side[0])
    ]


def detect_up_axis(motion: JointMotion, joints: Mapping[str, int]) -> UpAxis:
    """The axis along which the head is above the feet for most of the motion."""
    ankles = 0.5 * (motion.positions[:, joints["right_ankle"]] + motion.positions[:, joints["left_ankle"]])
    height = np.median(motion.positions[:, joints["head"]] - ankles, axis=0)
    return "z" if height[2] > height[1] else "y"
