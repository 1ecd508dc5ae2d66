"""How far posecodes are true of motions, and which of them say something about a motion."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.encoder.measurements import WINDOW, Array, Measurements
from agents.encoder.posecodes.base import POSECODES
from motion_data.skeleton import forward_kinematics

CODES = tuple(POSECODES.values())
_CHUNK = 4096
_OTHER = {"left": "right", "right": "left"}
_OF_BOTH = {"both": np.minimum, "one": np.maximum}


class _Remembered(Measurements):
    """Measurements that compute nothing twice: hundreds of rules ask for the same few places."""

    def __getattribute__(self, name: str) -> Any:
        """Methods of places and speeds keep what they gave before; it must not be changed in place."""
        found = super().__getattribute__(name)
        if name not in _KEPT:
            return found
        store: dict[tuple[Any, ...], Array] = self.__dict__.setdefault("_given", {})

        def remembered(*arguments: Any) -> Array:
            if (name, *arguments) not in store:
                store[name, *arguments] = found(*arguments)
            return store[name, *arguments]

        return remembered


_KEPT = frozenset(
    {"point", "height", "axis", "velocity", "speed", "_track", "apart", "bend", "foot_down", "arm_lowered"}
)


def measured(poses: NDArray[np.floating], frames: tuple[int, ...]) -> Measurements:
    """Measurements of motions of which a few frames are known, the last one among them; the others lie between these.

    Args:
        poses: `(n, k, 35)`.
        frames: where in the half second the k poses stand; the last one counts as its end.
    """
    count = len(poses)
    positions, quaternions = forward_kinematics(poses[:, :, :35].astype(np.float64).reshape(-1, 35))
    positions = positions.reshape(count, len(frames), 15, 3)
    quaternions = quaternions.reshape(count, len(frames), 15, 4)
    place = np.interp(np.arange(WINDOW), frames, np.arange(len(frames)))
    before = np.minimum(place.astype(int), len(frames) - 2)
    share = (place - before)[None, :, None, None]
    between = positions[:, before] * (1 - share) + positions[:, before + 1] * share
    return _Remembered(between, quaternions[:, np.round(place).astype(int)])


def grade(films: NDArray[np.floating], frames: tuple[int, ...]) -> NDArray[np.float16]:
    """Grades of all posecodes, `(n, codes)`; see :func:`measured`."""
    parts = []
    for start in range(0, len(films), _CHUNK):
        m = measured(films[start : start + _CHUNK], frames)
        found: dict[str, Array] = {}
        for code in CODES:
            stem, _, which = code.name.rpartition(".")
            if which in _OF_BOTH:  # what its rule says, without asking both sides again
                found[code.name] = _OF_BOTH[which](found[f"{stem}.right"], found[f"{stem}.left"])
            else:
                found[code.name] = code.rule(m)
        parts.append(np.stack([found[code.name] for code in CODES], 1).astype(np.float16))
    return np.concatenate(parts)


def partners() -> NDArray[np.int64]:
    """Index of each posecode's mirror image."""
    names = [code.name for code in CODES]
    mirrored = []
    for name in names:
        stem, _, side = name.rpartition(".")
        mirrored.append(names.index(f"{stem}.{_OTHER[side]}" if side in _OTHER else name))
    return np.array(mirrored)


def opposites() -> list[list[int]]:
    """For each posecode, those that it is easily confused with: the mirror image, other directions, other limbs."""
    names = [code.name for code in CODES]
    mirrored = partners()
    listed = []
    for index, code in enumerate(CODES):
        others = [names.index(name) for name in code.opposites if name in POSECODES]
        # The other side is the commonest mistake.
        listed.append(([int(mirrored[index])] * 3 if mirrored[index] != index else []) + others)
    return listed


class CodeChooser:
    """Chooses facts about motions, rare ones more often than those that are nearly always true.

    Args:
        grades: of the motions, `(n, codes)`.
        rng: all randomness.
    """

    def __init__(self, grades: NDArray[np.float16], rng: np.random.Generator) -> None:
        self.grades = grades
        self.rng = rng
        self.mirror = partners()
        share = (grades > 0.7).mean(0)
        share = 0.5 * (share + share[self.mirror])
        self._rarity = -np.log(share + 0.002)
        stems = [code.stem for code in CODES]
        self._stem = np.array([stems.index(stem) for stem in stems])

    def of(self, rows: NDArray[np.int64], turned: NDArray[np.bool_]) -> NDArray[np.float32]:
        """Grades of some motions, or of their mirror images, `(k, codes)`."""
        grades = self.grades[rows].astype(np.float32)
        grades[turned] = grades[turned][:, self.mirror]
        return grades

    def choose(self, grades: NDArray[np.floating], most: int = 4) -> list[tuple[int, ...]]:
        """One to `most` true facts of each motion, `(n, codes)`; those of one stem never together."""
        count = len(grades)
        noise = self.rng.gumbel(size=grades.shape)
        # From even odds of all that is true to nearly the rarest facts alone.
        bias = self.rng.choice([0.3, 1.0, 2.5], size=(count, 1))
        scores = np.where(grades > 0.72, bias * self._rarity + noise, -np.inf)
        sizes = np.minimum(self.rng.choice([1, 2, 3, 4], size=count, p=[0.15, 0.25, 0.4, 0.2]), most)
        chosen = []
        order = np.argsort(-scores, axis=1)[:, : 4 * most]
        for row in range(count):
            codes: list[int] = []
            for code in order[row]:
                if len(codes) == sizes[row] or scores[row, code] == -np.inf:
                    break
                if self._stem[code] not in self._stem[codes]:
                    codes.append(int(code))
            self.rng.shuffle(codes)
            chosen.append(tuple(codes))
        return chosen
