"""Options that every job has which learns with PPO: one dataclass that is command line, documentation and configuration."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np

EPISODE_DECISIONS = 60
"""Decisions (1/6 s) of an episode of 10 s, as the environments are registered."""

_POSITIVE = (
    "minutes",
    "num_envs",
    "evaluation_episodes",
    "learning_rate",
    "decisions_per_update",
    "batch_size",
    "epochs",
    "exploration",
    "target_kl",
)
_SHARES = ("discount", "gae_lambda")
_PATHS = ("output", "controller")


@dataclass(frozen=True, kw_only=True)
class PPOOptions:
    """What a run is told about its folder, its time and its learning; a job adds its own and changes defaults.

    Raises:
        ValueError: An option has a bad value.
    """

    MAY_CHANGE_ON_RESUME: ClassVar[tuple[str, ...]] = (
        "minutes",
        "evaluation_episodes",
        "progress",
        "output",
        "resume",
        "overwrite",
    )
    """Options that a resumed run takes from the new command; all others are those of its start."""

    output: Path | None = None
    """Run folder."""

    minutes: float = 8.0
    """Training time in minutes of wall clock; the evaluation comes on top."""

    seed: int = 0
    """Seed of everything that is drawn."""

    num_envs: int = 128
    """Humanoids that learn together."""

    resume: bool = False
    """Continue the run in the output folder where its last checkpoint stands; minutes counts from its very start."""

    overwrite: bool = False
    """Start anew although the output folder holds a run; the old one is deleted."""

    controller: Path | None = None
    """Low-level controller (ONNX); the bundled one by default."""

    evaluation_episodes: int = 20
    """Episodes of 10 s with the deterministic policy after training."""

    progress: bool = True
    """Show a progress bar."""

    learning_rate: float = 1e-4
    """Step size of Adam at the start; it falls linearly to a tenth by the end."""

    decisions_per_update: int = 16
    """High-level decisions (1/6 s) of each humanoid between two updates."""

    batch_size: int = 512
    """Decisions in a minibatch."""

    epochs: int = 8
    """Passes over the collected decisions in an update."""

    discount: float = 0.95
    """Discount per decision; 0.95 looks about 3 s ahead."""

    gae_lambda: float = 0.9
    """Lambda of generalised advantage estimation."""

    exploration: float
    """Standard deviation of each action number at the start."""

    target_kl: float = 0.1
    """An update stops early when the policy has moved further than this."""

    hidden: tuple[int, ...] = (256, 128)
    """Hidden layers of the policy and of the value function, tanh."""

    def __post_init__(self) -> None:
        for name in _POSITIVE:
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise ValueError(f"{name} must be a positive number, got {value}.")
        for name in _SHARES:
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"{name} must be between 0 and 1, got {getattr(self, name)}.")
        if self.seed < 0:
            raise ValueError(f"seed must be 0 or more, got {self.seed}.")
        if self.batch_size > self.num_envs * self.decisions_per_update:
            raise ValueError(
                f"batch_size {self.batch_size} is more than the num_envs x decisions_per_update = "
                f"{self.num_envs * self.decisions_per_update} decisions of an update; lower it."
            )
        if self.resume and self.overwrite:
            raise ValueError("resume and overwrite exclude each other; choose one.")

    def resuming(self, saved: Self, folder: Path) -> Self:
        """The options of a saved run, with what may change taken from these.

        Args:
            saved: The options of the run when it began.
            folder: Where it is, for messages.
        """
        changes = {name: getattr(self, name) for name in self.MAY_CHANGE_ON_RESUME}
        changes["minutes"] = max(saved.minutes, self.minutes)
        return dataclasses.replace(saved, **changes)

    def to_json(self) -> dict[str, Any]:
        """The options as JSON values; :meth:`from_json` reads them."""
        return json.loads(json.dumps(dataclasses.asdict(self), default=str))

    @classmethod
    def from_json(cls, values: dict[str, Any]) -> Self:
        """Options from :meth:`to_json`."""
        values = {name: tuple(value) if isinstance(value, list) else value for name, value in values.items()}
        for name in _PATHS:
            values[name] = None if values[name] is None else Path(values[name])
        return cls(**values)
