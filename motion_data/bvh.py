"""Reader for BVH motion capture files.

A BVH file may have any joint names, rest pose, units, up axis and frame rate; :mod:`motion_data.joint_retarget` copes.
"""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from motion_data.clip import MotionClip
from motion_data.joint_motion import JointMotion, UpAxis, place_joints
from motion_data.joint_retarget import retarget


def parse_bvh(path: str | Path) -> JointMotion:
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
    return JointMotion(tuple(names), tuple(parents), offsets, *_place(frames, parents, offsets, channels), fps)


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
    translations = np.tile(offsets, (len(frames), 1, 1))
    rotations = np.tile(np.eye(3), (len(frames), len(parents), 1, 1))
    column = 0
    for joint, names in enumerate(channels):
        for name in names:
            kind, axis = _CHANNELS[name]
            if kind == "position":
                translations[:, joint, axis] = frames[:, column]
            else:
                turn = Rotation.from_euler("xyz"[axis], frames[:, column, None], degrees=True).as_matrix()
                rotations[:, joint] = rotations[:, joint] @ turn
            column += 1
    return place_joints(parents, translations, rotations)


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

    Args:
        path: The file.
        name: Name of the clip; the file's name if None.
        up: Axis that points up; found from the motion if None (say it for motions that lie on the floor).
        joints: Names of the file's joints by role (:data:`motion_data.joint_motion.ROLES`) where they are unusual.
        labels: Sentences that describe the motion.
        categories: Categories for balanced sampling.
        licence: Licence of the motion.

    Returns:
        The clip; see :func:`motion_data.joint_retarget.retarget`.

    Raises:
        FileNotFoundError: If there is no such file.
        ValueError: If it cannot be read, or its joints cannot be mapped.
    """
    return retarget(
        parse_bvh(path), path, name, up=up, joints=joints, labels=labels, categories=categories, licence=licence
    )
