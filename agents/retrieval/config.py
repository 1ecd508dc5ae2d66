"""Options of training a retriever, and of every command that makes the environment."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import tyro

from anyskill_envs.goals import GOAL_SECONDS, GOAL_SPEED


def named_databases(databases: Sequence[str]) -> dict[str, str] | None:
    """Names and sources of words such as "crawl=crawl*"; a word without a name is named by itself. None if there are none.

    Raises:
        ValueError: A name occurs twice.
    """
    named: dict[str, str] = {}
    for word in databases:
        name, _, source = word.rpartition("=")
        name = name or Path(source).stem
        if name in named:
            raise ValueError(f"Two databases are named {name!r}; name one of them, as in other={source}.")
        named[name] = source
    return named or None


@dataclass(frozen=True)
class RetrievalConfig:
    """Train a retriever: PPO of Stable-Baselines3 on RetrievalLocomotion-v0, over the frozen controller.

    The run folder then holds policy.zip (Stable-Baselines3), policy.onnx, curve.png, report.json and TensorBoard events.
    """

    databases: tuple[str, ...] = ()
    """Motion databases, each a source or NAME=SOURCE: a saved database (.npz), a folder of motion files, a category of the
    motion library, a pattern of its clips' names, or both as in "move_around&usual", the
    default. With several, episodes draw one at random."""

    output: Path = Path("runs/retrieval")
    """Run folder."""

    minutes: float = 20.0
    """Training time in minutes of wall clock; the evaluation comes on top."""

    seed: int = 0
    """Seed of everything that is drawn."""

    num_envs: int = 128
    """Humanoids that learn together."""

    resume: bool = False
    """Continue the run in the output folder where its last checkpoint stands; minutes counts from its very start."""

    overwrite: bool = False
    """Start anew although the output folder holds a run; the old one is deleted."""

    weighting: Literal["query", "metric"] = "query"
    """What the action weights."""

    query_period: int = 1
    """Decisions (1/6 s) between two retrievals."""

    goal_speed: tuple[float, float] = GOAL_SPEED
    """Slowest and fastest goal, m/s."""

    goal_seconds: tuple[float, float] = GOAL_SECONDS
    """Shortest and longest time until a goal changes."""

    controller: Path | None = None
    """Low-level controller (ONNX), with its motion encoder beside it; the bundled one by default."""

    evaluation_episodes: int = 64
    """Episodes of 10 s with the deterministic retriever after training, and as many without learning."""

    progress: bool = True
    """Show a progress bar."""

    learning_rate: float = 1e-4
    """Step size of Adam at the start."""

    decisions_per_update: int = 32
    """Decisions (1/6 s) of each humanoid between two updates."""

    batch_size: int = 1024
    """Decisions in a minibatch."""

    epochs: int = 6
    """Passes over the collected decisions in an update."""

    discount: float = 0.97
    """Discount per decision; RACon's."""

    gae_lambda: float = 0.95
    """Lambda of generalised advantage estimation."""

    exploration: float = 0.2
    """Standard deviation of each weight at the start, where all weights are about 1."""

    target_kl: float = 0.05
    """An update stops early when the policy has moved further than this."""

    hidden: tuple[int, ...] = (256, 128)
    """Hidden layers of the policy and of the value function, tanh."""

    def __post_init__(self) -> None:
        names = ("minutes", "num_envs", "evaluation_episodes", "learning_rate", "decisions_per_update", "batch_size")
        for name in (*names, "epochs", "exploration", "target_kl"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise ValueError(f"{name} must be a positive number, got {value}.")
        for name in ("discount", "gae_lambda"):
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
        named_databases(self.databases)

    @property
    def environment_options(self) -> dict[str, Any]:
        """Arguments of RetrievalLocomotion-v0 that these options stand for."""
        return {
            "databases": named_databases(self.databases),
            "database": "random" if len(self.databases) > 1 else None,
            "weighting": self.weighting,
            "query_period": self.query_period,
            "goal_speed": self.goal_speed,
            "goal_seconds": self.goal_seconds,
            "controller": None if self.controller is None else str(self.controller),
        }

    def to_json(self) -> dict[str, Any]:
        """The options as JSON values; :meth:`from_json` reads them."""
        return json.loads(json.dumps(dataclasses.asdict(self), default=str))

    @classmethod
    def from_json(cls, values: dict[str, Any]) -> RetrievalConfig:
        """Options from :meth:`to_json`."""
        values = {name: tuple(value) if isinstance(value, list) else value for name, value in values.items()}
        values["output"] = Path(values["output"])
        values["controller"] = None if values["controller"] is None else Path(values["controller"])
        return cls(**values)


RetrievalOptions = Annotated[RetrievalConfig, tyro.conf.arg(name="")]
"""A `RetrievalConfig` whose fields are options without a prefix."""
