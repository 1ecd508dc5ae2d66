"""Smooth transitions between motions: the old motion dies away as an offset on the new one."""

import numpy as np

_STIFFNESS = 8.0  # rad/s: 95 % of a jump is gone after 0.6 s
_RATE = 30.0  # frames per second of the reference motions


class Inertialization:
    """Offsets that decay like critically damped springs (Bollo, "Inertialization", GDC 2018).

    The decay depends on the present offset and its velocity only, not on when the jump was. So a controller that sees
    the state and where to go can tell how fast to go there, which it could not with a cross-fade by the clock.

    Args:
        count: Humanoids.
        size: Numbers per humanoid.
    """

    def __init__(self, count: int, size: int):
        self._offset = np.zeros((count, size), np.float32)
        self._velocity = np.zeros((count, size), np.float32)

    def clear(self, ids: np.ndarray) -> None:
        """Forgets the offsets of some humanoids."""
        self._offset[ids] = 0
        self._velocity[ids] = 0

    def jump(self, ids: np.ndarray, offset: np.ndarray, velocity: np.ndarray) -> None:
        """Adds the jump (old minus new, ``(k, size)``) and that of the velocity (per second) of some humanoids."""
        self._offset[ids] += offset
        self._velocity[ids] += velocity

    def ahead(self, frames: int) -> np.ndarray:
        """The offsets some frames from now, float32 ``(n, size)``."""
        return self._decayed(frames)[0]

    def advance(self) -> None:
        """One frame passes."""
        self._offset, self._velocity = self._decayed(1)

    def _decayed(self, frames: int) -> tuple[np.ndarray, np.ndarray]:
        seconds = frames / _RATE
        decay = np.float32(np.exp(-_STIFFNESS * seconds))
        slope = self._velocity + _STIFFNESS * self._offset
        offset = decay * (self._offset + slope * seconds)
        return offset, decay * (self._velocity - _STIFFNESS * slope * seconds)

    @staticmethod
    def rate(first: np.ndarray, second: np.ndarray) -> np.ndarray:
        """Change per second from one frame to the next."""
        return (second - first) * _RATE
