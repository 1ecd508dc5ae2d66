"""A motion clip: poses over time with source, licence and labels, stored without pickle."""

import json
import re
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from motion_data.files import write_whole
from motion_data.skeleton import FRAME_RATE, JOINT_NAMES, QPOS_SIZE, differentiate, heading, mirror_qpos

_FORMAT_VERSION = 1
MIRRORED_SUFFIX = "_mirrored"
"""Ends the name of a mirror image."""


@dataclass(frozen=True)
class MotionClip:
    """Poses of the humanoid over time.

    Attributes:
        name: Unique name, lower case with underscores.
        qpos: Poses ``(T, 35)``: root position in metres, root quaternion (w first), 28 hinge angles in radians.
        fps: Frames per second.
        source: Where the motion comes from.
        licence: Licence of the motion.
        labels: Sentences that describe the motion.
        categories: Categories for balanced sampling, such as ``act_in_place`` or ``dance``.
        loop: Whether the last pose leads into the first.

    Raises:
        ValueError: If the poses have the wrong shape, are not finite, or have a broken quaternion.
    """

    name: str
    qpos: np.ndarray
    fps: float = FRAME_RATE
    source: str = "unknown"
    licence: str = "unknown"
    labels: tuple[str, ...] = ()
    categories: tuple[str, ...] = field(default=("uncategorised",))
    loop: bool = False

    def __post_init__(self) -> None:
        qpos = np.array(self.qpos, dtype=np.float64)
        if qpos.ndim != 2 or qpos.shape[1] != QPOS_SIZE:
            raise ValueError(
                f"Clip '{self.name}': qpos has shape {qpos.shape}, expected (frames, {QPOS_SIZE}): root position 3, "
                f"root quaternion 4, {len(JOINT_NAMES)} hinge angles. Retarget other skeletons with "
                "`anyskill motions import`."
            )
        if len(qpos) < 2:
            raise ValueError(f"Clip '{self.name}' has {len(qpos)} frames; a motion needs at least 2.")
        bad = np.flatnonzero(~np.isfinite(qpos).all(1))
        if len(bad):
            raise ValueError(
                f"Clip '{self.name}' has NaN or infinite numbers in {len(bad)} frames, first in frame {bad[0]}. "
                "Repair or cut these frames."
            )
        norms = np.linalg.norm(qpos[:, 3:7], axis=1)
        if np.abs(norms - 1).max() > 0.01:
            raise ValueError(
                f"Clip '{self.name}': root quaternions (w first) must have unit length, found {norms.min():.3f} to "
                f"{norms.max():.3f}."
            )
        if not self.fps > 0:
            raise ValueError(f"Clip '{self.name}': fps must be positive, got {self.fps}.")
        qpos[:, 3:7] /= norms[:, None]
        qpos.flags.writeable = False
        object.__setattr__(self, "qpos", qpos)
        object.__setattr__(self, "labels", tuple(self.labels))
        object.__setattr__(self, "categories", tuple(self.categories))

    def __len__(self) -> int:
        """Number of frames."""
        return len(self.qpos)

    @property
    def duration(self) -> float:
        """Length in seconds."""
        return (len(self.qpos) - 1) / self.fps

    @cached_property
    def qvel(self) -> np.ndarray:
        """Velocities ``(T, 34)`` in MuJoCo's convention, by central differences."""
        return differentiate(self.qpos, self.fps)

    def resampled(self, fps: float = FRAME_RATE) -> "MotionClip":
        """The same motion at another frame rate: angles linearly, the root orientation spherically interpolated."""
        if fps == self.fps:
            return self
        old = np.arange(len(self.qpos)) / self.fps
        new = np.arange(max(2, int(np.floor(self.duration * fps + 1e-6)) + 1)) / fps
        new = np.minimum(new, old[-1])
        qpos = np.stack([np.interp(new, old, column) for column in self.qpos.T], 1)
        rotations = Rotation.from_quat(self.qpos[:, 3:7], scalar_first=True)
        qpos[:, 3:7] = Slerp(old, rotations)(new).as_quat(scalar_first=True)
        return replace(self, qpos=qpos, fps=fps)

    def at_speed(self, factor: float) -> "MotionClip":
        """The same motion ``factor`` times as fast, at the same frame rate.

        Raises:
            ValueError: If the factor is not positive.
        """
        if not factor > 0:
            raise ValueError(f"The speed factor must be positive, got {factor}.")
        faster = replace(self, name=f"{self.name}_speed_{factor:g}", fps=self.fps * factor)
        return replace(faster.resampled(self.fps), fps=self.fps)

    def mirrored(self) -> "MotionClip":
        """The motion reflected in the x-z plane, with "left" and "right" exchanged in its labels."""
        base = self.name.removesuffix(MIRRORED_SUFFIX)
        name = base if base != self.name else self.name + MIRRORED_SUFFIX
        return replace(self, name=name, qpos=mirror_qpos(self.qpos), labels=tuple(map(swap_sides, self.labels)))

    def repeated(self, duration: float) -> "MotionClip":
        """A looping motion continued until it lasts at least ``duration`` seconds; other motions unchanged.

        Each repetition starts where the last one ended, turned by the change of heading; the seam is blended over 0.2 s.
        """
        if not self.loop:
            return self
        parts = [self.qpos]
        blend = min(6, len(self.qpos) - 1)
        while sum(map(len, parts)) < duration * self.fps:
            last, first = parts[-1][-1], self.qpos[0]
            turn = Rotation.from_euler("z", heading(last[3:7]) - heading(first[3:7]))
            part = self.qpos[1:].copy()
            offset = turn.apply(self.qpos[1:, :3] - [*first[:2], 0]) + [*last[:2], 0]
            part[:, :3] = offset
            part[:, 3:7] = (turn * Rotation.from_quat(part[:, 3:7], scalar_first=True)).as_quat(scalar_first=True)
            weight = 1 - np.arange(1, blend + 1) / (blend + 1)
            part[:blend, 7:] += weight[:, None] * (last[7:] - first[7:])
            part[:blend, 2] += weight * (last[2] - first[2])
            parts.append(part)
        return replace(self, qpos=np.concatenate(parts))

    def save(self, path: str | Path) -> Path:
        """Writes the clip as ``.npz`` without pickle, whole or not at all.

        Returns:
            The path written.
        """
        path = Path(path)
        header = {
            "format_version": _FORMAT_VERSION,
            "name": self.name,
            "fps": self.fps,
            "source": self.source,
            "licence": self.licence,
            "labels": list(self.labels),
            "categories": list(self.categories),
            "loop": self.loop,
            "joints": list(JOINT_NAMES),
        }
        text = np.array(json.dumps(header))
        write_whole(path, lambda temporary: np.savez_compressed(temporary, header=text, qpos=self.qpos))
        return path

    @classmethod
    def load(cls, path: str | Path) -> "MotionClip":
        """Reads a clip that :meth:`save` wrote.

        Raises:
            FileNotFoundError: If the file does not exist.
            ValueError: If it is not such a file, or its joints are not those of our skeleton.
        """
        path = Path(path)
        if not path.is_file():
            raise FileNotFoundError(f"No motion clip at '{path}'. List what exists with `anyskill motions list`.")
        try:
            with np.load(path, allow_pickle=False) as archive:
                header, qpos = json.loads(str(archive["header"])), archive["qpos"]
        except (KeyError, ValueError, OSError, EOFError, json.JSONDecodeError) as error:
            raise ValueError(f"'{path}' is not a motion clip of this project ({error}). Import it again.") from error
        if header.get("joints") != list(JOINT_NAMES):
            raise ValueError(
                f"'{path}' has the joints {header.get('joints')}, this skeleton has {list(JOINT_NAMES)}. Import the "
                "original file again with `anyskill motions import`."
            )
        return cls(
            name=header["name"],
            qpos=qpos,
            fps=header["fps"],
            source=header["source"],
            licence=header["licence"],
            labels=tuple(header["labels"]),
            categories=tuple(header["categories"]),
            loop=header["loop"],
        )


def swap_sides(text: str) -> str:
    """Exchanges the words "left" and "right", "leftward" and "rightward" in a text, keeping the case of the first letter.

    A "right angle" has no side.
    """
    other = {"left": "right", "right": "left", "Left": "Right", "Right": "Left"}
    return re.sub(r"\b([Ll]eft|[Rr]ight(?! angle))(?=(ward|wards)?\b)", lambda match: other[match.group()], text)
