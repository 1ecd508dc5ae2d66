"""What the stages of controller training share: the clock, the checkpoint, the progress bar, the log."""

import logging
import os
import time
from abc import ABC, abstractmethod
from pathlib import Path
from typing import Any

import numpy as np
import torch
from rich.progress import Progress

from motion_data.files import write_whole

_LOG = logging.getLogger(__name__)
_SAVE_EVERY = 60.0  # seconds
_LOG_EVERY = 20  # updates
_INSPECT_EVERY = 200  # updates


class Stage(ABC):
    """A training stage that can be stopped at any time and goes on from its checkpoint.

    Args:
        path: The checkpoint.
        minutes: Training time, over all sessions.
        seed: Seed of everything random.
        threads: Threads for physics and learning; 0 for one per CPU.

    Attributes:
        samples: Controller steps seen so far, all humanoids together.
        seconds: Training time so far.
        checkpoint: What the file held when the stage was made; None if there was none.
    """

    def __init__(self, path: Path, minutes: float, seed: int, threads: int):
        self.path = path
        path.parent.mkdir(parents=True, exist_ok=True)
        torch.set_num_threads(threads or len(os.sched_getaffinity(0)))
        torch.manual_seed(seed)
        self.checkpoint: dict[str, Any] | None = torch.load(path, weights_only=True) if path.exists() else None
        self.samples: int = self.checkpoint["samples"] if self.checkpoint else 0
        self.seconds: float = self.checkpoint["seconds"] if self.checkpoint else 0.0
        self.budget = 60 * minutes
        # A resumed run continues with fresh episodes: a new stream of random numbers, still determined by the seed.
        self.rng = np.random.default_rng((seed, self.samples))

    @abstractmethod
    def update(self) -> dict[str, float]:
        """Collects and learns once; returns figures for the log."""

    def inspect(self) -> dict[str, float]:
        """Figures that take too long for every update; none by default."""
        return {}

    @abstractmethod
    def state(self) -> dict[str, Any]:
        """What the checkpoint needs beside the clock."""

    def save(self) -> None:
        """Writes the checkpoint, whole or not at all."""
        content = {**self.state(), "samples": self.samples, "seconds": self.seconds}
        write_whole(self.path, lambda temporary: torch.save(content, temporary))

    def run(self) -> None:
        """Trains until the time is used up; saves every minute."""
        saved, updates = time.monotonic(), 0
        with Progress() as progress:
            bar = progress.add_task(self.path.stem, total=self.budget, completed=int(self.seconds))
            while self.seconds < self.budget:
                start = time.monotonic()
                figures = self.update()
                self.seconds += time.monotonic() - start
                updates += 1
                if updates % _INSPECT_EVERY == 0:
                    figures |= self.inspect()
                text = ", ".join(f"{name} {value:.4g}" for name, value in figures.items())
                progress.update(bar, completed=self.seconds, description=f"{self.path.stem}: {text}")
                if updates % _LOG_EVERY == 0:
                    _LOG.info("%.0f s, %.2f M samples, %s", self.seconds, self.samples / 1e6, text)
                if time.monotonic() - saved > _SAVE_EVERY:
                    self.save()
                    saved = time.monotonic()
        self.save()
