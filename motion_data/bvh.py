"""Reader for BVH motion capture files: parsing, and retargeting to our skeleton.

A BVH file may have any joint names, rest pose, units, up axis and frame rate. So nothing but the joints' paths in space
and the rotation of their bones is used: limbs are compared by their direction and by the axis in which they bend.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from motion_data.clip import MotionClip
from motion_data.inverse_kinematics import SHIN, SIDES, THIGH
from motion_data.retarget import fit_hinges, place_feet
from motion_data.skeleton import QPOS_SIZE, joint_index, joint_limits

UpAxis = Literal["y", "z"]

# Names of each role after lower case and without separators, most telling first. CMU, Mixamo, SFU, LaFAN and Unreal.
_CENTRE_ROLES = {
    "pelvis": ("hips", "hip", "pelvis", "root"),
    "neck": ("neck", "neck1", "neck01"),
    "head": ("head",),
}
_SIDE_ROLES = {
    "shoulder": ("arm", "upperarm", "uparm", "shoulder"),
    "elbow": ("forearm", "lowerarm", "lowarm", "elbow"),
    "wrist": ("hand", "wrist"),
    "hip": ("upleg", "upperleg", "thigh", "hip", "hipjoint"),
    "knee": ("leg", "lowerleg", "lowleg", "knee", "shin", "calf"),
    "ankle": ("foot", "ankle"),
    "toe": ("toebase", "toe", "toes", "ball"),
}
_OPTIONAL = {"right_toe", "left_toe"}
ROLES = (*_CENTRE_ROLES, *(f"{side}_{role}" for side in SIDES for role in _SIDE_ROLES))
"""Joints of a BVH file that retargeting looks for; toes may be missing."""


@dataclass(frozen=True)
class BvhMotion:
    """Content of a BVH file.

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


def parse_bvh(path: str | Path) -> BvhMotion:
    """Reads a BVH file and computes where its joints are.

    Args:
        path: The file.

    Returns:
        Its joints and their motion, in the file's own axes and units.

    Raises:
        FileNotFoundError: If there is no such file.
        ValueError: If it is no BVH file, is cut short, or has NaN or no frames.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"No BVH file at '{path}'.")
    try:
        head, motion = re.split(r"\bMOTION\b", path.read_text(encoding="utf-8", errors="replace"), maxsplit=1)
        names, parents, offsets, channels = _hierarchy(head.split())
        count, fps, numbers = _motion(motion)
    except (ValueError, IndexError) as error:
        raise ValueError(f"'{path}' is not a whole BVH file ({error}). Export it again.") from error
    width = sum(map(len, channels))
    if count == 0 or numbers.size == 0:
        raise ValueError(f"'{path}' has no frames. Export it with its animation.")
    if numbers.size != count * width:
        raise ValueError(
            f"'{path}' announces {count} frames of {width} channels ({count * width} numbers) but has {numbers.size}. "
            "The file was cut short or edited; export it again."
        )
    if not np.isfinite(numbers).all():
        bad = np.flatnonzero(~np.isfinite(numbers))[0] // width
        raise ValueError(f"'{path}' has NaN or infinite numbers, first in frame {bad}. Repair or cut these frames.")
    frames = numbers.reshape(count, width)
    return BvhMotion(tuple(names), tuple(parents), offsets, *_place(frames, parents, offsets, channels), fps)


def _hierarchy(tokens: Sequence[str]) -> tuple[list[str], list[int], np.ndarray, list[list[str]]]:
    """Names, parents, offsets and channels of the joints."""
    names: list[str] = []
    parents: list[int] = []
    offsets: list[list[float]] = []
    channels: list[list[str]] = []
    open_joints: list[int] = []  # -1 stands for an end site
    position = 0
    while position < len(tokens):
        word = tokens[position]
        if word in ("ROOT", "JOINT"):
            parents.append(open_joints[-1] if open_joints else -1)
            # A name may contain spaces; it ends at the brace.
            brace = tokens.index("{", position)
            names.append(" ".join(tokens[position + 1 : brace]))
            offsets.append([0.0] * 3)
            channels.append([])
            open_joints.append(len(names) - 1)
            position = brace + 1
        elif word == "End":
            open_joints.append(-1)
            position = tokens.index("{", position) + 1
        elif word == "OFFSET":
            if open_joints[-1] >= 0:
                offsets[open_joints[-1]] = [float(number) for number in tokens[position + 1 : position + 4]]
            position += 4
        elif word == "CHANNELS":
            number = int(tokens[position + 1])
            channels[open_joints[-1]] = list(tokens[position + 2 : position + 2 + number])
            position += 2 + number
        else:
            if word == "}":
                open_joints.pop()
            elif word != "HIERARCHY":
                raise ValueError(f"unexpected word '{word}' in the hierarchy")
            position += 1
    if not names:
        raise ValueError("it has no joints")
    unknown = sorted({name for row in channels for name in row} - set(_CHANNELS))
    if unknown:
        raise ValueError(f"unknown channels {unknown}")
    return names, parents, np.array(offsets), channels


_CHANNELS = {f"{axis}{kind}": (kind, index) for kind in ("position", "rotation") for index, axis in enumerate("XYZ")}


def _motion(text: str) -> tuple[int, float, np.ndarray]:
    """Announced number of frames, frames per second, and all numbers in one row."""
    header = re.search(r"Frames:\s*(\d+)\s+Frame\s+Time:\s*(\S+)", text)
    if header is None:
        raise ValueError("'Frames:' and 'Frame Time:' are missing")
    frame_time = float(header[2])
    if not frame_time > 0:
        raise ValueError(f"the frame time is {frame_time}")
    fps = 1 / frame_time
    # Files write 0.0333 or 0.033333 for 30 frames per second.
    fps = round(fps) if abs(fps - round(fps)) < 0.05 else fps
    return int(header[1]), float(fps), np.array(text[header.end() :].split(), dtype=np.float64)


def _place(
    frames: np.ndarray, parents: Sequence[int], offsets: np.ndarray, channels: Sequence[Sequence[str]]
) -> tuple[np.ndarray, np.ndarray]:
    """Positions ``(T, J, 3)`` and orientations ``(T, J, 3, 3)`` of all joints in space."""
    positions = np.empty((len(frames), len(parents), 3))
    rotations = np.empty((len(frames), len(parents), 3, 3))
    column = 0
    for joint, (parent, names) in enumerate(zip(parents, channels, strict=True)):
        local = np.tile(offsets[joint], (len(frames), 1))
        turn = np.tile(np.eye(3), (len(frames), 1, 1))
        for name in names:
            kind, axis = _CHANNELS[name]
            if kind == "position":
                local[:, axis] = frames[:, column]
            else:
                turn = turn @ Rotation.from_euler("xyz"[axis], frames[:, column, None], degrees=True).as_matrix()
            column += 1
        if parent < 0:
            positions[:, joint], rotations[:, joint] = local, turn
        else:
            positions[:, joint] = positions[:, parent] + np.einsum("tij,tj->ti", rotations[:, parent], local)
            rotations[:, joint] = rotations[:, parent] @ turn
    return positions, rotations


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
            f'which is which: read_bvh(path, joints={{"{missing[0]}": "NAME"}}).'
        )
    return found


def _aliases(role: str) -> list[str]:
    if role in _CENTRE_ROLES:
        return list(_CENTRE_ROLES[role])
    side, part = role.split("_")
    return [
        form for alias in _SIDE_ROLES[part] for form in (side + alias, side[0] + alias, alias + side, alias + side[0])
    ]


def detect_up_axis(motion: BvhMotion, joints: Mapping[str, int]) -> UpAxis:
    """The axis along which the head is above the feet for most of the motion."""
    ankles = 0.5 * (motion.positions[:, joints["right_ankle"]] + motion.positions[:, joints["left_ankle"]])
    height = np.median(motion.positions[:, joints["head"]] - ankles, axis=0)
    return "z" if height[2] > height[1] else "y"


def read_bvh(
    path: str | Path,
    name: str | None = None,
    *,
    up: UpAxis | None = None,
    joints: Mapping[str, str] | None = None,
    labels: tuple[str, ...] = (),
    categories: tuple[str, ...] = ("imported",),
    licence: str = "unknown",
) -> MotionClip:
    """Reads a BVH file and retargets it to our skeleton at 30 frames per second.

    The size of the body is taken from its legs, so the file's units do not matter. The feet are placed on the floor frame
    by frame; the clip starts above the origin and keeps its heading.

    Args:
        path: The file.
        name: Name of the clip; the file's name if None.
        up: Axis that points up; found from the motion if None (say it for motions that lie on the floor).
        joints: Names of the file's joints by role (:data:`ROLES`) where they are unusual.
        labels: Sentences that describe the motion.
        categories: Categories for balanced sampling.
        licence: Licence of the motion.

    Returns:
        The clip.

    Raises:
        FileNotFoundError: If there is no such file.
        ValueError: If it cannot be read, or its joints cannot be mapped.
    """
    motion = parse_bvh(path)
    found = map_joints(motion.names, joints)
    axis = up or detect_up_axis(motion, found)
    if axis not in ("y", "z"):
        raise ValueError(f"The up axis is y or z, not '{axis}'.")
    # A file with y up faces z: x is left.
    to_ours = np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0]], float) if axis == "y" else np.eye(3)
    qpos = _retarget(_Source(motion, found, to_ours))
    stem = re.sub(r"[^a-z0-9]+", "_", Path(path).stem.lower()).strip("_") or "imported"
    clip = MotionClip(
        name=name or stem,
        qpos=qpos,
        fps=motion.fps,
        source=Path(path).name,
        licence=licence,
        labels=labels or ((name or stem).replace("_", " "),),
        categories=categories,
    ).resampled()
    placed = place_feet(clip.qpos)
    placed[:, :2] -= placed[0, :2].copy()
    return MotionClip(clip.name, placed, clip.fps, clip.source, clip.licence, clip.labels, clip.categories, clip.loop)


class _Source:
    """Paths and orientations of the joints by role, in our axes."""

    def __init__(self, motion: BvhMotion, joints: Mapping[str, int], to_ours: np.ndarray):
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
        raise ValueError("A leg of the BVH file has no length: hip, knee and ankle must be apart.")
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
    it bends; a limb that never bends takes the axis of its parent.
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
        axis = np.einsum("tji,tj->ti", rotation, parent[:, :, 1]).mean(0)
    left = rotation @ axis
    return _frame(up=-upper, left=left), bend


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
