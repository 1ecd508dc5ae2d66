"""Goals of locomotion: a horizontal velocity to walk with, redrawn now and then, and how far a motion is from it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from motion_data.skeleton import FRAME_RATE

FASTEST_GOAL = 20.0
"""m/s; faster than any human."""
_SLOW = 0.1
"""m/s; below this a velocity has no direction worth comparing."""

Range = tuple[float, float]
GOAL_SPEED: Range = (0.5, 3.0)
"""m/s: slowest and fastest goal unless one says otherwise."""
GOAL_SECONDS: Range = (4.0, 7.0)
"""Shortest and longest time until a goal changes; that of MimicKit's steering task."""


def goal_distance(velocity: NDArray[np.float64], goal: NDArray[np.float64]) -> NDArray[np.float64]:
    """How far a velocity is from the wished one: RACon's d, section 3.2.

    The paper combines "cosine similarity and norm difference" without a formula; this project takes
    (1 - cos(v, g)) + | |v| - |g| |. The cosine fades out below 0.1 m/s, and a goal to stand has no direction.

    Args:
        velocity: Horizontal velocities, ``(n, 2)`` m/s.
        goal: Wished ones, ``(n, 2)`` m/s.

    Returns:
        Distances from 0, ``(n,)``.
    """
    speed, wished = np.linalg.norm(velocity, axis=1), np.linalg.norm(goal, axis=1)
    cosine = (velocity * goal).sum(1) / (np.maximum(speed, _SLOW) * np.maximum(wished, _SLOW))
    return np.where(wished < _SLOW, 0.0, 1 - cosine) + np.abs(speed - wished)


def checked_range(name: str, values: Range, lowest: float, highest: float = np.inf) -> Range:
    """A range of two numbers, the first not above the second.

    Raises:
        ValueError: If it is none, or reaches beyond the limits.
    """
    limits = np.array(values, float)
    if not (limits.shape == (2,) and np.isfinite(limits).all() and lowest <= limits[0] <= limits[1] <= highest):
        raise ValueError(
            f"{name} must be two finite numbers from {lowest:g}{'' if np.isinf(highest) else f' to {highest:g}'}, the "
            f"smaller first, got {values}."
        )
    return float(limits[0]), float(limits[1])


class VelocityGoals:
    """A wished horizontal velocity for each humanoid: any direction, a uniform speed, redrawn after a uniform time.

    Args:
        count: Humanoids.
        speed: Slowest and fastest goal, m/s.
        seconds: Shortest and longest time until a goal changes; None for goals that stay.

    Attributes:
        velocity: The goals in the world frame, ``(n, 2)`` m/s.

    Raises:
        ValueError: If a range is none.
    """

    def __init__(self, count: int, speed: Range, seconds: Range | None):
        self._speed = checked_range("goal_speed", speed, 0, FASTEST_GOAL)
        self._seconds = None if seconds is None else checked_range("goal_seconds", seconds, 1 / FRAME_RATE)
        self.velocity = np.zeros((count, 2))
        self._steps_left = np.zeros(count)

    def draw(self, ids: NDArray[np.int64], rng: np.random.Generator) -> None:
        """Draws goals for the humanoids `ids`, and when they change."""
        speed = rng.uniform(*self._speed, len(ids))
        direction = rng.uniform(-np.pi, np.pi, len(ids))
        self.velocity[ids] = np.stack([speed * np.cos(direction), speed * np.sin(direction)], 1)
        if self._seconds is not None:
            self._steps_left[ids] = np.round(rng.uniform(*self._seconds, len(ids)) * FRAME_RATE)

    def set(self, ids: NDArray[np.int64], speed: float, direction: float) -> None:
        """Sets the goal of the humanoids `ids`; it changes when the present one would have changed.

        Raises:
            ValueError: If a number is not finite, or the speed out of range.
        """
        if not (np.isfinite(direction) and np.isfinite(speed) and 0 <= speed <= FASTEST_GOAL):
            raise ValueError(
                f"A goal is a speed from 0 to {FASTEST_GOAL:g} m/s and a direction in radians, both finite; got "
                f"{speed} and {direction}."
            )
        self.velocity[ids] = speed * np.cos(direction), speed * np.sin(direction)

    def advance(self, executed: NDArray[np.int64], rng: np.random.Generator) -> None:
        """Lets time pass, in controller steps ``(n,)``, and redraws the goals whose time is up."""
        if self._seconds is None:
            return
        self._steps_left -= executed
        due = np.flatnonzero((self._steps_left <= 0) & (executed > 0))
        if len(due):
            self.draw(due, rng)
