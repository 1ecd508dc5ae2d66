"""Options of training a retriever, and of every command that makes the environment."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

from agents.training.config import PPOOptions
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


@dataclass(frozen=True, kw_only=True)
class RetrievalConfig(PPOOptions):
    """Train a retriever: PPO of Stable-Baselines3 on RetrievalLocomotion-v0, over the frozen controller.

    The run folder then holds policy.zip (Stable-Baselines3), policy.onnx, curve.png, report.json and TensorBoard events.
    """

    output: Path = Path("runs/retrieval")
    minutes: float = 20.0
    decisions_per_update: int = 32
    batch_size: int = 1024
    epochs: int = 6
    gae_lambda: float = 0.95
    target_kl: float = 0.05

    controller: Path | None = None
    """Low-level controller (ONNX), with its motion encoder beside it; the bundled one by default."""

    evaluation_episodes: int = 64
    """Episodes of 10 s with the deterministic retriever after training, and as many without learning."""

    discount: float = 0.97
    """Discount per decision; RACon's."""

    exploration: float = 0.2
    """Standard deviation of each weight at the start, where all weights are about 1."""

    databases: tuple[str, ...] = ()
    """Motion databases, each a source or NAME=SOURCE: a saved database (.npz), a folder of motion files, a category of the
    motion library, a pattern of its clips' names, or both as in "move_around&usual", the
    default. With several, episodes draw one at random."""

    weighting: Literal["query", "metric"] = "query"
    """What the action weights."""

    query_period: int = 1
    """Decisions (1/6 s) between two retrievals."""

    goal_speed: tuple[float, float] = GOAL_SPEED
    """Slowest and fastest goal, m/s."""

    goal_seconds: tuple[float, float] = GOAL_SECONDS
    """Shortest and longest time until a goal changes."""

    def __post_init__(self) -> None:
        super().__post_init__()
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


RetrievalOptions = Annotated[RetrievalConfig, tyro.conf.arg(name="")]
"""A `RetrievalConfig` whose fields are options without a prefix."""
