"""The motion library: clips with sampling weights by inverse category frequency."""

import logging
import os
from collections import Counter
from collections.abc import Sequence
from functools import cache, cached_property
from pathlib import Path

import numpy as np

from motion_data.authored import authored_clips
from motion_data.clip import MotionClip, swap_sides
from motion_data.deepmimic import pybullet_clips
from motion_data.floor import floor_clips
from motion_data.gait_table import gait_clips
from motion_data.joining import joined_clips
from motion_data.skeleton import kinematics

_LOG = logging.getLogger(__name__)

# A clip whose mirror image differs by less from one of the library's own clips (radians, mean) needs no twin.
_SYMMETRY_TOLERANCE = 0.02
_EVEN_TOLERANCE = 0.001  # the same for a gait whose two steps are alike; captured steps never are


def imports_folder() -> Path:
    """Where imported clips live: ``$ANYSKILL_CACHE/motions``, by default ``~/.cache/anyskill/motions``."""
    return Path(os.environ.get("ANYSKILL_CACHE", "~/.cache/anyskill")).expanduser() / "motions"


class MotionLibrary:
    """Clips and how often each is drawn.

    The weight of a category is the inverse of its number of clips; a clip of several categories takes their mean
    (AnySkill, section 4.1 and appendix A.2).

    Args:
        clips: The clips; names must be unique.

    Attributes:
        clips: The clips at 30 frames per second.
        names: Their names.
        weights: Probability of each clip, ``(clips,)``; they add up to 1.
        starts: First frame of each clip in the joined arrays, ``(clips,)``.
        lengths: Frames of each clip, ``(clips,)``.

    Raises:
        ValueError: If there is no clip or a name occurs twice.
    """

    def __init__(self, clips: Sequence[MotionClip]):
        if not clips:
            raise ValueError("A motion library needs at least one clip.")
        self.clips = [clip.resampled() for clip in clips]
        self.names = [clip.name for clip in clips]
        twice = sorted(name for name, count in Counter(self.names).items() if count > 1)
        if twice:
            raise ValueError(f"Two clips share a name: {', '.join(twice)}. Rename one of each pair.")
        frequency = Counter(category for clip in clips for category in clip.categories)
        weights = np.array([np.mean([1 / frequency[category] for category in clip.categories]) for clip in clips])
        self.weights = weights / weights.sum()
        self.lengths = np.array([len(clip) for clip in self.clips])
        self.starts = np.concatenate([[0], np.cumsum(self.lengths)[:-1]])

    def __len__(self) -> int:
        """Number of clips."""
        return len(self.clips)

    def __getitem__(self, name: str) -> MotionClip:
        """The clip of that name.

        Raises:
            ValueError: If there is none; the message lists the names.
        """
        if name not in self.names:
            raise ValueError(f"Unknown clip '{name}'. The library has: {', '.join(self.names)}.")
        return self.clips[self.names.index(name)]

    def sample(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """Indices of ``count`` clips, drawn by weight, ``(count,)``."""
        return rng.choice(len(self.clips), count, p=self.weights)

    @cached_property
    def qpos(self) -> np.ndarray:
        """Poses of all clips, joined, ``(F, 35)``."""
        return np.concatenate([clip.qpos for clip in self.clips])

    @cached_property
    def qvel(self) -> np.ndarray:
        """Velocities of all clips, joined, ``(F, 34)``."""
        return np.concatenate([clip.qvel for clip in self.clips])

    @cached_property
    def positions(self) -> np.ndarray:
        """World positions of the bodies, ``(F, 15, 3)``."""
        return kinematics(self.qpos).positions

    @cached_property
    def quaternions(self) -> np.ndarray:
        """World orientations of the bodies, w first, ``(F, 15, 4)``."""
        return kinematics(self.qpos).quaternions

    @classmethod
    def default(cls, mirrored: bool = True, imported: str | Path | None = None) -> "MotionLibrary":
        """The project's library: mocap of ``pybullet``, what is authored, planned or joined, mirror images, imports.

        Args:
            mirrored: Add the mirror image of every clip that has no mirror image in the library yet.
            imported: Folder of clips that the user imported; :func:`imports_folder` if None.
        """
        try:
            clips = list(_mocap_clips())
        except ModuleNotFoundError as error:
            _LOG.warning("The library has no mocap clips: %s", error)
            clips = []
        clips += authored_clips() + gait_clips() + floor_clips()
        clips += joined_clips(clips)
        folder = imports_folder() if imported is None else Path(imported)
        clips += [MotionClip.load(path) for path in sorted(folder.glob("*.npz"))]
        if mirrored:
            clips += missing_mirrors(clips)
        return cls(clips)


@cache
def _mocap_clips() -> tuple[MotionClip, ...]:
    """The clips of pybullet; retargeting takes two seconds, so once per process is enough."""
    return tuple(pybullet_clips())


def mirror_name(name: str) -> str:
    """Name with left and right exchanged; the same name if it has neither."""
    return swap_sides(name.replace("_", " ")).replace(" ", "_")


def missing_mirrors(clips: Sequence[MotionClip]) -> list[MotionClip]:
    """Mirror images of the clips that neither are symmetric, also from step to step, nor have a twin."""
    names = {clip.name for clip in clips}
    missing = []
    for clip in clips:
        twin = mirror_name(clip.name)
        if twin != clip.name and twin in names:
            continue
        image = clip.mirrored()
        # The image of a planned gait is the same gait, half a stride later.
        later = np.roll(clip.qpos[:-1], (len(clip) - 1) // 2, 0)
        even = clip.loop and np.abs(image.qpos[:-1, 3:] - later[:, 3:]).mean() < _EVEN_TOLERANCE
        if not even and np.abs(image.qpos[:, 3:] - clip.qpos[:, 3:]).mean() > _SYMMETRY_TOLERANCE:
            missing.append(image)
    return missing
