"""Retargeting of named joints that move in space (:class:`motion_data.joint_motion.JointMotion`) to our skeleton.

A file may have any joint names, rest pose, units and frame rate. So nothing but the joints' paths in space and the rotation
of their bones is used: limbs are compared by their direction and by the axis in which they bend.
"""

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from motion_data.clip import MotionClip
from motion_data.inverse_kinematics import SHIN, SIDES, THIGH
from motion_data.joint_motion import Y_UP_TO_OURS, JointMotion, UpAxis, detect_up_axis, map_joints
from motion_data.retarget import fit_hinges, place_feet
from motion_data.skeleton import FRAME_RATE, QPOS_SIZE, joint_index, joint_limits


def clip_name(stem: str) -> str:
    """Name of a clip from that of its file: lower case, with underscores."""
    return re.sub(r"[^a-z0-9]+", "_", stem.lower()).strip("_") or "imported"


def retarget(
    motion: JointMotion,
    path: str | Path,
    name: str | None = None,
    *,
    up: UpAxis | None = None,
    joints: Mapping[str, str] | None = None,
    labels: tuple[str, ...] = (),
    categories: tuple[str, ...] = ("imported",),
    licence: str = "unknown",
) -> MotionClip:
    """Makes a clip of our skeleton at 30 frames per second.

    The size of the body is taken from its legs, so the file's units do not matter. The feet are placed on the floor frame
    by frame; the clip starts above the origin and keeps its heading.

    Args:
        motion: The joints of the file and their motion.
        path: The file, for the clip's source and name.
        name: Name of the clip; the file's name if None.
        up: Axis that points up; found from the motion if None (say it for motions that lie on the floor). A file with y
            up faces z.
        joints: Names of the file's joints by role (:data:`motion_data.joint_motion.ROLES`) where they are unusual.
        labels: Sentences that describe the motion.
        categories: Categories for balanced sampling.
        licence: Licence of the motion.

    Returns:
        The clip.

    Raises:
        ValueError: If joints cannot be mapped, or there are too few frames.
    """
    path = Path(path)
    found = map_joints(motion.names, joints)
    axis = up or detect_up_axis(motion, found)
    if axis not in ("y", "z"):
        raise ValueError(f"The up axis is y or z, not '{axis}'.")
    # Thinning comes first: fitting the hinges costs by the frame.
    motion = motion.thinned(FRAME_RATE)
    if len(motion.positions) < 2:
        raise ValueError(f"'{path}' is shorter than two frames at {FRAME_RATE:g} per second; a motion needs more.")
    qpos = _retarget(_Source(motion, found, Y_UP_TO_OURS if axis == "y" else np.eye(3)))
    name = name or clip_name(path.stem)
    clip = MotionClip(
        name=name,
        qpos=qpos,
        fps=motion.fps,
        source=path.name,
        licence=licence,
        labels=labels or (name.replace("_", " "),),
        categories=categories,
    ).resampled()
    placed = place_feet(clip.qpos)
    placed[:, :2] -= placed[0, :2].copy()
    return replace(clip, qpos=placed)


class _Source:
    """Paths and orientations of the joints by role, in our axes."""

    def __init__(self, motion: JointMotion, joints: Mapping[str, int], to_ours: np.ndarray):
        self.motion = motion
        self.joints = joints
        self.to_ours = to_ours

    def has(self, role: str) -> bool:
        return role in self.joints

    def position(self, role: str) -> np.ndarray:
        return self.motion.positions[:, self.joints[role]] @ self.to_ours.T

    def rotation(self, role: str) -> np.ndarray:
        return self._turned(self.joints[role])

    def parent_rotation(self, role: str) -> np.ndarray:
        return self._turned(self.motion.parents[self.joints[role]])

    def _turned(self, joint: int) -> np.ndarray:
        return self.to_ours @ self.motion.rotations[:, joint] @ self.to_ours.T

    def between(self, start: str, end: str) -> np.ndarray:
        return self.position(end) - self.position(start)

    def chest_up(self) -> np.ndarray:
        """From the joint half-way up the spine to the neck, ``(T, 3)``: our only spine joint sits there."""
        neck, pelvis = self.joints["neck"], self.joints["pelvis"]
        chain = [neck]
        while chain[-1] != pelvis and self.motion.parents[chain[-1]] >= 0:
            chain.append(self.motion.parents[chain[-1]])
        lengths = np.linalg.norm(self.motion.offsets[chain[:-1]], axis=1)
        below_neck = np.cumsum(lengths)
        middle = chain[1 + int(np.abs(below_neck - 0.5 * below_neck[-1]).argmin())]
        return (self.motion.positions[:, neck] - self.motion.positions[:, middle]) @ self.to_ours.T

    def rest_is_upright(self) -> bool:
        """Whether the pose with all angles zero stands upright, as a T-pose does; in LaFAN it does not."""
        rest = np.zeros_like(self.motion.offsets)
        for joint, parent in enumerate(self.motion.parents):
            rest[joint] = self.motion.offsets[joint] + (rest[parent] if parent >= 0 else 0)
        rest = rest @ self.to_ours.T
        head, hip, ankle = (rest[self.joints[role]] for role in ("head", "right_hip", "right_ankle"))
        up_body, up_leg = head - hip, hip - ankle
        return bool(up_body[2] > 0.8 * np.linalg.norm(up_body) and up_leg[2] > 0.8 * np.linalg.norm(up_leg))


def _retarget(source: _Source) -> np.ndarray:
    """Poses ``(T, 35)`` at the frame rate of the source, feet not yet placed."""
    frames = len(source.motion.positions)
    qpos = np.zeros((frames, QPOS_SIZE))
    limits = joint_limits()

    def set_joint(joint: str, parent: np.ndarray, child: np.ndarray) -> None:
        columns = [joint_index(f"{joint}_{axis}") for axis in "xzy"]
        angles = fit_hinges(np.swapaxes(parent, 1, 2) @ child, limits[columns])
        qpos[:, [7 + column for column in columns]] = angles

    def set_hinge(joint: str, angle: np.ndarray) -> None:
        column = joint_index(joint)
        qpos[:, 7 + column] = np.clip(angle, *limits[column])

    pelvis = _pelvis(source)
    torso = _frame(up=source.chest_up(), left=source.between("right_shoulder", "left_shoulder"))
    set_joint("abdomen", pelvis, torso)
    set_joint("neck", torso, _head(source, torso))
    for side in SIDES:
        upper, bend = _limb(source, f"{side}_shoulder", f"{side}_elbow", f"{side}_wrist", torso, sign=-1)
        set_joint(f"{side}_shoulder", torso, upper)
        set_hinge(f"{side}_elbow", -bend)
        thigh, bend = _limb(source, f"{side}_hip", f"{side}_knee", f"{side}_ankle", pelvis, sign=1)
        set_joint(f"{side}_hip", pelvis, thigh)
        set_hinge(f"{side}_knee", bend)
        shin = thigh @ Rotation.from_euler("y", bend[:, None]).as_matrix()
        set_joint(f"{side}_ankle", shin, _foot(source, side, shin))
    qpos[:, :3] = _scale(source) * 0.5 * (source.position("right_hip") + source.position("left_hip"))
    quaternions = Rotation.from_matrix(pelvis).as_quat(scalar_first=True)
    # Neighbouring quaternions of the same sign interpolate the short way.
    flips = np.cumprod(np.where((quaternions[1:] * quaternions[:-1]).sum(1) < 0, -1, 1))
    qpos[:, 3:7] = quaternions * np.concatenate([[1], flips])[:, None]
    return qpos


def _scale(source: _Source) -> float:
    """Metres of our body per unit of the source, by the length of the legs."""
    lengths = [
        np.linalg.norm(source.between(f"{side}_{start}", f"{side}_{end}"), axis=1).mean()
        for side in SIDES
        for start, end in (("hip", "knee"), ("knee", "ankle"))
    ]
    if min(lengths) < 1e-9:
        raise ValueError("A leg of the skeleton has no length: hip, knee and ankle must be apart.")
    return 2 * (THIGH + SHIN) / sum(lengths)


def _frame(up: np.ndarray, left: np.ndarray) -> np.ndarray:
    """Orientations whose z is along ``up`` and whose y is nearest to ``left``, ``(T, 3, 3)``."""
    z = up / np.linalg.norm(up, axis=1, keepdims=True)
    y = left - (left * z).sum(1, keepdims=True) * z
    y /= np.linalg.norm(y, axis=1, keepdims=True)
    return np.stack([np.cross(y, z), y, z], -1)


def _pelvis(source: _Source) -> np.ndarray:
    """Orientation of the pelvis, ``(T, 3, 3)``: left from the hip joints, up from the rest pose or the spine."""
    rotation = source.rotation("pelvis")
    left = source.between("right_hip", "left_hip")
    if source.rest_is_upright():
        up = rotation[:, :, 2]
    else:
        hips = 0.5 * (source.position("right_hip") + source.position("left_hip"))
        to_neck = source.position("neck") - hips
        # Fixed in the pelvis: where the neck is on average.
        local = np.einsum("tji,tj->ti", rotation, to_neck).mean(0)
        up = rotation @ local
    y = left / np.linalg.norm(left, axis=1, keepdims=True)
    z = up - (up * y).sum(1, keepdims=True) * y
    z /= np.linalg.norm(z, axis=1, keepdims=True)
    return np.stack([np.cross(y, z), y, z], -1)


def _head(source: _Source, torso: np.ndarray) -> np.ndarray:
    """Orientation of the head, ``(T, 3, 3)``: its turn against the chest since the rest pose."""
    chest, head = source.parent_rotation("neck"), source.rotation("head")
    relative = np.swapaxes(chest, 1, 2) @ head
    # Where the rest pose is not upright, the mean of the clip counts as looking ahead.
    neutral = np.eye(3) if source.rest_is_upright() else Rotation.from_matrix(relative).mean().as_matrix()
    return head @ np.swapaxes(chest @ neutral, 1, 2) @ torso


def _limb(
    source: _Source, start: str, middle: str, end: str, parent: np.ndarray, sign: int
) -> tuple[np.ndarray, np.ndarray]:
    """Orientation of a limb's upper bone ``(T, 3, 3)`` and the bend of its hinge ``(T,)``, radians.

    The hinge's axis is fixed in the bone. It is the mean normal of the plane in which the limb bends, weighted by how much
    it bends; a limb that never bends takes the axis that it would have after swinging there from hanging down.
    """
    upper, lower = source.between(start, middle), source.between(middle, end)
    upper = upper / np.linalg.norm(upper, axis=1, keepdims=True)
    lower = lower / np.linalg.norm(lower, axis=1, keepdims=True)
    normal = sign * np.cross(upper, lower)  # its length is the sine of the bend
    bend = np.arctan2(np.linalg.norm(normal, axis=1), (upper * lower).sum(1))
    rotation = source.rotation(start)
    weight = np.linalg.norm(normal, axis=1, keepdims=True)
    axis = np.einsum("tji,tj->ti", rotation, normal * weight).mean(0)
    if np.linalg.norm(axis) < 1e-3:
        axis = np.einsum("tji,tj->ti", rotation, _carried_left(upper, parent)).mean(0)
    left = rotation @ axis
    return _frame(up=-upper, left=left), bend


def _carried_left(direction: np.ndarray, parent: np.ndarray) -> np.ndarray:
    """The parent's left after the shortest rotation that leads its downward direction to another, ``(T, 3)``."""
    down, left = -parent[:, :, 2], parent[:, :, 1]
    between = down + direction
    cosine = (down * direction).sum(1, keepdims=True)
    return left - (direction * left).sum(1, keepdims=True) / np.maximum(1 + cosine, 1e-6) * between


def _foot(source: _Source, side: str, shin: np.ndarray) -> np.ndarray:
    """Orientation of a foot, ``(T, 3, 3)``, level in the fifth of the frames in which it is lowest."""
    ankle = source.position(f"{side}_ankle")
    if not source.has(f"{side}_toe"):
        standing = ankle[:, 2] <= np.quantile(ankle[:, 2], 0.2)
        upward = np.tile([0.0, 0.0, 1.0], (int(standing.sum()), 1))
        level = _frame(up=upward, left=shin[standing, :, 1])
        rotation = source.rotation(f"{side}_ankle")
        fixed = Rotation.from_matrix(np.swapaxes(rotation[standing], 1, 2) @ level).mean().as_matrix()
        return rotation @ fixed
    toe = source.position(f"{side}_toe")
    toes = (toe - ankle) / np.linalg.norm(toe - ankle, axis=1, keepdims=True)
    height = ankle[:, 2] + toe[:, 2]
    standing = height <= np.quantile(height, 0.2)
    slope = np.median(np.arcsin(np.clip(toes[standing, 2], -1, 1)))
    y = shin[:, :, 1] - (shin[:, :, 1] * toes).sum(1, keepdims=True) * toes
    y /= np.linalg.norm(y, axis=1, keepdims=True)
    along = np.stack([toes, y, np.cross(toes, y)], -1)
    # The line from ankle to toes slopes down by this much while the sole is level.
    return along @ Rotation.from_euler("y", slope).as_matrix()
