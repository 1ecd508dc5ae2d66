"""Transitions that the policy made before: the discriminator must not forget what it has already seen through."""

import numpy as np
import torch


class Replay:
    """A ring of transitions with the windows whose latents they followed.

    Args:
        capacity: How many are kept.
        shape: Shape of one transition.
        share: Share of each rollout that is taken once the ring is full, so that it spans many updates.
    """

    def __init__(self, capacity: int, shape: tuple[int, ...], share: float):
        self._transitions = torch.zeros((capacity, *shape), dtype=torch.float16)
        self._windows = torch.zeros(capacity, dtype=torch.long)
        self._share = share
        self._next = 0
        self._size = 0

    def __len__(self) -> int:
        """Transitions held."""
        return self._size

    def add(self, transitions: torch.Tensor, windows: torch.Tensor, rng: np.random.Generator) -> None:
        """Takes transitions ``(n, ...)`` with their windows ``(n,)``; the oldest make room."""
        capacity = len(self._windows)
        count = min(len(windows), capacity)
        if self._size == capacity:
            count = min(count, max(1, round(self._share * len(windows))))
        chosen = torch.from_numpy(rng.choice(len(windows), count, replace=False))
        place = (self._next + torch.arange(count)) % capacity
        self._transitions[place] = transitions[chosen].to(torch.float16)
        self._windows[place] = windows[chosen]
        self._next = (self._next + count) % capacity
        self._size = min(capacity, self._size + count)

    def sample(self, rng: np.random.Generator, count: int) -> tuple[torch.Tensor, torch.Tensor]:
        """Random transitions, float16 ``(count, ...)``, and their windows ``(count,)``."""
        chosen = torch.from_numpy(rng.integers(self._size, size=count))
        return self._transitions[chosen], self._windows[chosen]
