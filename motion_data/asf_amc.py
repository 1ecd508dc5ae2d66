"""Reader for Acclaim motion capture: an ASF file holds the skeleton, AMC files hold motions of it (CMU's format).

A bone starts where its parent ends. Its angles count in axes of its own, ``C`` (the ASF file's ``axis``): with the rotation
``M`` of an AMC frame, the bone turns against its parent by ``C M C^-1``. In the ASF file's pose all angles are zero.
Of ``rx ry rz``, the first turns first, about an axis that stands still.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from motion_data.clip import MotionClip
from motion_data.joint_motion import JointMotion, UpAxis, place_joints
from motion_data.joint_retarget import retarget

AMC_FRAME_RATE = 120.0
"""Frames per second of nearly all of CMU's motions; an AMC file does not say its own."""

_ROOT = "root"


@dataclass(frozen=True)
class AcclaimSkeleton:
    """Content of an ASF file.

    Attributes:
        names: Bones, parents before children; the first is ``root``.
        parents: Index of each bone's parent, -1 for the root.
        ends: Place of each bone's end, seen from its start in the pose with all angles zero, ``(B, 3)``.
        axes: The frame ``C`` in which each bone's angles count, ``(B, 3, 3)``.
        channels: What an AMC file holds for each bone, such as ``("rx", "rz")``.
        degrees: Whether angles are in degrees.
    """

    names: tuple[str, ...]
    parents: tuple[int, ...]
    ends: np.ndarray
    axes: np.ndarray
    channels: tuple[tuple[str, ...], ...]
    degrees: bool


def parse_asf(path: str | Path) -> AcclaimSkeleton:
    """Reads the skeleton of Acclaim files.

    Args:
        path: The ASF file.

    Returns:
        Its bones, in the file's own axes and units.

    Raises:
        FileNotFoundError: If there is no such file.
        ValueError: If it is no whole ASF file.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"No ASF file at '{path}'.")
    try:
        return _skeleton(_sections(path.read_text(encoding="utf-8", errors="replace")))
    except (ValueError, IndexError, KeyError) as error:
        raise ValueError(f"'{path}' is not a whole ASF file ({error}). Get the original again.") from error


def _sections(text: str) -> dict[str, list[list[str]]]:
    """Words of each line, by section (``:root`` and so on)."""
    sections: dict[str, list[list[str]]] = {}
    lines: list[list[str]] = []
    for line in text.splitlines():
        words = line.split("#")[0].split()
        if words and words[0].startswith(":"):
            lines = sections.setdefault(words[0][1:].lower(), [])
            words = words[1:]
        if words:
            lines.append(words)
    missing = [name for name in ("root", "bonedata", "hierarchy") if name not in sections]
    if missing:
        raise ValueError(f"it has no section {', '.join(':' + name for name in missing)}")
    return sections


def _skeleton(sections: Mapping[str, Sequence[Sequence[str]]]) -> AcclaimSkeleton:
    units = {line[0].lower(): line[1] for line in sections.get("units", []) if len(line) > 1}
    degrees = units.get("angle", "deg").lower().startswith("deg")
    root = {line[0].lower(): list(line[1:]) for line in sections["root"]}
    bones = {bone["name"][0]: bone for bone in _bones(sections["bonedata"])}
    names, parents = _tree([line for line in sections["hierarchy"] if line[0].lower() not in ("begin", "end")])
    unknown = [name for name in names if name != _ROOT and name not in bones]
    if unknown:
        raise ValueError(f"the hierarchy has bones without data: {', '.join(unknown)}")
    ends, axes, channels = [np.zeros(3)], [_axes(root["orientation"], root["axis"][0], degrees)], [root["order"]]
    for name in names[1:]:
        bone = bones[name]
        direction = np.array(bone["direction"], float)
        ends.append(direction / np.linalg.norm(direction) * float(bone["length"][0]))
        axes.append(_axes(bone["axis"][:3], bone["axis"][3], degrees))
        channels.append(bone.get("dof", []))
    lower = tuple(tuple(channel.lower() for channel in row) for row in channels)
    strange = sorted({channel for row in lower for channel in row} - {"tx", "ty", "tz", "rx", "ry", "rz"})
    if strange:
        raise ValueError(f"bones with the degrees of freedom {', '.join(strange)} are not supported")
    result = AcclaimSkeleton(tuple(names), tuple(parents), np.array(ends), np.array(axes), lower, degrees)
    if not (np.isfinite(result.ends).all() and np.isfinite(result.axes).all()):
        raise ValueError("a bone has NaN or no direction")
    return result


def _bones(lines: Sequence[Sequence[str]]) -> Iterator[dict[str, list[str]]]:
    """What the file says of each bone, by keyword; further lines of limits are skipped."""
    bone: dict[str, list[str]] = {}
    for line in lines:
        keyword = line[0].lower()
        if keyword == "begin":
            bone = {}
        elif keyword == "end":
            lacking = [word for word in ("name", "direction", "length", "axis") if word not in bone]
            if lacking:
                raise ValueError(f"the bone {bone.get('name', ['without a name'])[0]} has no {', '.join(lacking)}")
            yield bone
        else:
            bone[keyword] = list(line[1:])


def _tree(lines: Sequence[Sequence[str]]) -> tuple[list[str], list[int]]:
    """Bones with parents before children, and each one's parent; a line is a parent and its children."""
    children = {line[0]: list(line[1:]) for line in lines}
    names, parents = [_ROOT], [-1]
    for index, name in enumerate(names):  # names grows while it is read: breadth first
        for child in children.get(name, []):
            if child in names:
                raise ValueError(f"the bone {child} has two parents")
            names.append(child)
            parents.append(index)
    lost = sorted(set(children) - set(names))
    if lost:
        raise ValueError(f"bones that do not hang on the root: {', '.join(lost)}")
    return names, parents


def _axes(angles: Sequence[str], order: str, degrees: bool) -> np.ndarray:
    return Rotation.from_euler(order.lower(), np.array(angles, float), degrees=degrees).as_matrix()


def parse_amc(path: str | Path, skeleton: AcclaimSkeleton, fps: float = AMC_FRAME_RATE) -> JointMotion:
    """Reads a motion of a skeleton.

    Args:
        path: The AMC file.
        skeleton: The skeleton of its ASF file.
        fps: Frames per second; the file does not say.

    Returns:
        The starts of the bones as joints, in the file's own axes and units.

    Raises:
        FileNotFoundError: If there is no such file.
        ValueError: If it is no AMC file, does not fit the skeleton, is cut short, or has NaN or no frames.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"No AMC file at '{path}'.")
    if not fps > 0:
        raise ValueError(f"The frame rate must be positive, got {fps}.")
    text = path.read_text(encoding="utf-8", errors="replace")
    degrees = skeleton.degrees and not re.search(r"^:RADIANS", text, re.MULTILINE | re.IGNORECASE)
    values = _frames(path, text, skeleton)
    count = len(next(iter(values.values())))
    bones = len(skeleton.names)
    # A bone starts where its parent ends.
    offsets = np.array([skeleton.ends[parent] if parent >= 0 else np.zeros(3) for parent in skeleton.parents])
    translations, rotations = np.tile(offsets, (count, 1, 1)), np.tile(np.eye(3), (count, bones, 1, 1))
    for bone, (name, channels) in enumerate(zip(skeleton.names, skeleton.channels, strict=True)):
        turns = [column for column, channel in enumerate(channels) if channel[0] == "r"]
        for column, channel in enumerate(channels):
            if channel[0] == "t":
                translations[:, bone, "xyz".index(channel[1])] += values[name][:, column]
        if turns:
            sequence = "".join(channels[column][1] for column in turns)
            turn = Rotation.from_euler(sequence, values[name][:, turns], degrees=degrees).as_matrix()
            rotations[:, bone] = skeleton.axes[bone] @ turn @ skeleton.axes[bone].T
    return JointMotion(
        skeleton.names, skeleton.parents, offsets, *place_joints(skeleton.parents, translations, rotations), fps
    )


def _frames(path: Path, text: str, skeleton: AcclaimSkeleton) -> dict[str, np.ndarray]:
    """Numbers of each bone that has degrees of freedom, ``(T, channels)``."""
    wanted = {name: len(channels) for name, channels in zip(skeleton.names, skeleton.channels, strict=True) if channels}
    rows: dict[str, list[list[float]]] = {name: [] for name in wanted}
    frame = 0
    for line in text.splitlines():
        words = line.split("#")[0].split()
        if not words or words[0].startswith(":"):
            continue
        if len(words) == 1 and words[0].isdigit():
            frame += 1
            continue
        name = words[0]
        if name not in wanted:
            raise ValueError(
                f"'{path}' moves the bone '{name}', which cannot move in the skeleton: it belongs to another ASF file. "
                f"The skeleton's bones are: {', '.join(wanted)}."
            )
        try:
            numbers = [float(word) for word in words[1:]]
        except ValueError as error:
            raise ValueError(f"'{path}' is not an AMC file: '{line.strip()}' in frame {frame} ({error}).") from error
        if len(numbers) != wanted[name]:
            raise ValueError(
                f"'{path}' has {len(numbers)} numbers for the bone '{name}' in frame {frame}, its skeleton "
                f"{wanted[name]}: it was cut short, or belongs to another ASF file."
            )
        rows[name].append(numbers)
    if frame == 0:
        raise ValueError(f"'{path}' has no frames. Is it an AMC file?")
    incomplete = [name for name, row in rows.items() if len(row) != frame]
    if incomplete:
        raise ValueError(f"'{path}' has not all of its {frame} frames for {', '.join(incomplete)}; it was cut short.")
    values = {name: np.array(row) for name, row in rows.items()}
    finite = np.all([np.isfinite(value).all(1) for value in values.values()], axis=0)
    if not finite.all():
        bad = np.flatnonzero(~finite)[0]
        raise ValueError(f"'{path}' has NaN or infinite numbers, first in frame {bad}. Repair or cut these frames.")
    return values


def find_asf(amc: str | Path) -> Path:
    """The skeleton of a motion: in the same folder, the ASF file of the same name, of the same subject, or the only one.

    CMU's ``02_01.amc`` is a motion of the subject ``02.asf``.

    Raises:
        ValueError: If there is none, or several and none of the motion's name.
    """
    amc = Path(amc)
    found = sorted(path for path in amc.parent.glob("*") if path.suffix.lower() == ".asf")
    for name in (amc.stem, amc.stem.split("_")[0]):
        for path in found:
            if path.stem == name:
                return path
    if len(found) == 1:
        return found[0]
    problem = f"has several: {', '.join(path.name for path in found)}" if found else "has no .asf file"
    raise ValueError(
        f"An AMC file needs the ASF file of its skeleton, and the folder of '{amc}' {problem}. Name it with "
        "`--skeleton FILE.asf`."
    )


def read_amc(
    path: str | Path,
    name: str | None = None,
    *,
    asf: str | Path | None = None,
    fps: float = AMC_FRAME_RATE,
    up: UpAxis | None = None,
    joints: Mapping[str, str] | None = None,
    labels: tuple[str, ...] = (),
    categories: tuple[str, ...] = ("imported",),
    licence: str = "unknown",
) -> MotionClip:
    """Reads an AMC file with its ASF file and retargets it to our skeleton at 30 frames per second.

    Args:
        path: The AMC file.
        name: Name of the clip; the file's name if None.
        asf: The ASF file; see :func:`find_asf` if None.
        fps: Frames per second of the AMC file.
        up: Axis that points up; found from the motion if None (say it for motions that lie on the floor).
        joints: Bones by the role of the joint at which they start, where their names are unusual.
        labels: Sentences that describe the motion.
        categories: Categories for balanced sampling.
        licence: Licence of the motion.

    Returns:
        The clip; see :func:`motion_data.joint_retarget.retarget`.

    Raises:
        FileNotFoundError: If there is no such file.
        ValueError: If a file cannot be read, they do not belong together, or the bones cannot be mapped.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"No AMC file at '{path}'.")
    motion = parse_amc(path, parse_asf(asf or find_asf(path)), fps)
    return retarget(motion, path, name, up=up, joints=joints, labels=labels, categories=categories, licence=licence)
