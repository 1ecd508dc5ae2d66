"""States in which episodes start."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from motion_data.skeleton import QPOS_SIZE, QVEL_SIZE, rest_qpos

if TYPE_CHECKING:
    from motion_data.library import MotionLibrary

START_NAMES = ("standing", "library")


def draw_starts(
    start: Any, count: int, noise: float, rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Draw start states.

    Args:
        start: "standing" (the rest pose), "library" (a random frame of the motion clips, moved to the origin), or a
            mapping with `qpos` ``(35,)`` or ``(k, 35)`` and, if wanted, `qvel` ``(34,)`` or ``(k, 34)``, which gets no
            noise.
        count: number of humanoids k.
        noise: half-width of the uniform noise on joint angles (rad) and velocities (rad/s, m/s).
        rng: where the randomness comes from.

    Returns:
        qpos ``(k, 35)`` and qvel ``(k, 34)``.

    Raises:
        ValueError: `start` is none of these.
    """
    if isinstance(start, Mapping):
        return (
            _rows(start.get("qpos"), count, QPOS_SIZE, "qpos"),
            _rows(start.get("qvel", np.zeros(QVEL_SIZE)), count, QVEL_SIZE, "qvel"),
        )
    if start == "standing":
        qpos, qvel = np.tile(rest_qpos(), (count, 1)), np.zeros((count, QVEL_SIZE))
    elif start == "library":
        library = _default_library()
        clips = library.sample(rng, count)
        frames = library.starts[clips] + rng.integers(library.lengths[clips])
        qpos, qvel = library.qpos[frames].copy(), library.qvel[frames].copy()
        qpos[:, :2] = 0.0
    else:
        raise ValueError(
            f"initial_state must be one of {', '.join(START_NAMES)}, or a dictionary with 'qpos' and 'qvel', got "
            f"{start!r}."
        )
    qpos[:, 7:] += rng.uniform(-noise, noise, (count, QPOS_SIZE - 7))
    qvel += rng.uniform(-noise, noise, qvel.shape)
    return qpos, qvel


@cache
def _default_library() -> MotionLibrary:
    # Imported here: only environments that start from motion clips need them.
    from motion_data.library import MotionLibrary

    return MotionLibrary.default()


def _rows(values: Any, count: int, size: int, name: str) -> NDArray[np.float64]:
    """Values ``(size,)`` or ``(count, size)`` as ``(count, size)``."""
    array = np.asarray(np.nan if values is None else values, np.float64)
    if array.shape not in ((size,), (count, size)) or not np.isfinite(array).all():
        raise ValueError(
            f"options['initial_state']['{name}'] must hold finite numbers of shape ({size},) or ({count}, {size}), got "
            f"shape {array.shape}."
        )
    return np.array(np.broadcast_to(array, (count, size)))
