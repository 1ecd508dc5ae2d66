"""Which decision of its episode it is, as part of what a policy sees.

A motion with a course, a kick or a wave, cannot be read off a pose: the same stand comes before and after it. With the
time in its observation (Pardo et al. 2018, "Time limits in reinforcement learning") a policy can play a course of
latents, and correct it by the state that it also sees.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float32]

CLOCK_SIZE = 60
"""Decisions of an episode of 10 s; a longer episode begins again at the first."""
_HEIGHT = 4.0
"""Size of the entry that is not zero; about that of the rest of an observation, so that it is learned as quickly."""


def with_clock(observation: FloatArray, decisions: ArrayLike) -> FloatArray:
    """Appends the time to observations.

    Args:
        observation: `(n, 223)`.
        decisions: Decisions since the start of the episode, one number or `(n,)`.

    Returns:
        `(n, 283)`: 60 numbers more, zero but for that of the present decision.
    """
    clock = np.zeros((len(observation), CLOCK_SIZE), np.float32)
    clock[np.arange(len(observation)), np.asarray(decisions) % CLOCK_SIZE] = _HEIGHT
    return np.concatenate([observation, clock], axis=1)


class ClockedPolicy:
    """Plays one batch of episodes from their start with a policy that sees the time.

    Args:
        act: Observations with time `(n, 283)` to actions `(n, 64)`.
    """

    def __init__(self, act: Callable[[FloatArray], FloatArray]) -> None:
        self._act = act
        self._decision = 0

    def __call__(self, observation: FloatArray) -> FloatArray:
        """Actions `(n, 64)` for the observations `(n, 223)` of the next decision."""
        self._decision += 1
        return self._act(with_clock(observation, self._decision - 1))
