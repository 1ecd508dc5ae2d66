"""`anyskill evaluate retrieval`: how well retrieval follows goals, with and without a trained retriever."""

from __future__ import annotations

import json as json_format
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np

from agents.retrieval.config import named_databases
from agents.retrieval.motion_quality import PER_CONDITION, RealMotion, same_goal_features
from agents.retrieval.retriever import Retriever, load_retriever, unlearned
from agents.retrieval.rollout import make_environment, roll_out
from agents.retrieval.sudden_change import plot_sudden_change, sudden_change
from anyskill_envs.goals import GOAL_SECONDS, GOAL_SPEED
from motion_data.metrics import multimodality
from motion_data.skeleton import FRAME_RATE


def evaluate_retrievers(
    retrievers: Mapping[str, Retriever],
    options: Mapping[str, Any],
    episodes: int = 64,
    seconds: float = 10.0,
    seed: int = 0,
) -> dict[str, Any]:
    """Measures retrievers on the same goals.

    Args:
        retrievers: What to measure, by name.
        options: Arguments of RetrievalLocomotion-v0.
        episodes: Episodes of each.
        seconds: Length of an episode.
        seed: Seed of starts, goals and draws.

    Returns:
        JSON values: under `rows` the measures of each retriever, under `real` those of the databases' own motion.
        `velocity_error` is RACon's MVE, the mean over frames and episodes of |v - g| in m/s; `interval` half of its 95 %
        interval over episodes; `clip_velocity_error` the same of what was retrieved; `terminated` the share of episodes
        that ended by a fall; `length` the mean share of an episode that was reached. `frechet` and `multimodality` are None
        if too many episodes end within 0.5 s: there is no motion to compare.
    """
    rows: dict[str, Any] = {}
    real: RealMotion | None = None
    for name, retriever in retrievers.items():
        env = make_environment(episodes, options)
        real = real or RealMotion(env.clips.databases, np.random.default_rng(seed))
        rollout = roll_out(env, retriever, seconds, seed)
        env.close()
        errors = rollout.errors
        lengths = np.array([len(qpos) for qpos in rollout.qpos])
        used, counts = np.unique(rollout.names, return_counts=True)
        order = np.argsort(-counts)[:5]
        frames = np.sum(errors * lengths) / lengths.sum()
        repeated = same_goal_features(retriever, options, seed, int(np.clip(episodes // 6, 2, PER_CONDITION)))
        rows[name] = {
            "velocity_error": float(frames),
            "interval": float(1.96 * errors.std(ddof=1) / np.sqrt(len(errors))) if len(errors) > 1 else None,
            "clip_velocity_error": float(rollout.clip_error.mean()),
            "terminated": float(rollout.fell.mean()),
            "length": float(lengths.mean() / (seconds * FRAME_RATE)),
            "frechet": real.distance(rollout.qpos),
            "multimodality": multimodality(repeated, np.random.default_rng(seed)) if len(repeated) else None,
            "most_used_clips": {str(used[index]): float(counts[index] / counts.sum()) for index in order},
        }
    assert real is not None
    return {
        "rows": rows,
        "real": {"frechet": real.floor(), "multimodality": real.multimodality()},
        "episodes": episodes,
        "seconds": seconds,
        "seed": seed,
        "goal_speed": list(options.get("goal_speed", GOAL_SPEED)),
        "goal_seconds": list(options.get("goal_seconds", GOAL_SECONDS)),
    }


def as_table(result: Mapping[str, Any]) -> str:
    """The measures as a Markdown table, in the order of RACon's table 1."""
    head = ("", "MVE, m/s", "MVE of the clips", "terminated", "length", "Frechet distance", "multimodality")
    lines = [head, ("---",) * len(head)]
    real = result["real"]
    lines.append(("real motion", "", "", "", "", f"{real['frechet']:.2f}", f"{real['multimodality']:.2f}"))
    for name, row in result["rows"].items():
        interval = "" if row["interval"] is None else f" ± {row['interval']:.3f}"
        lines.append(
            (
                name,
                f"{row['velocity_error']:.3f}{interval}",
                f"{row['clip_velocity_error']:.3f}",
                f"{row['terminated']:.1%}",
                f"{row['length']:.1%}",
                *("-" if row[key] is None else f"{row[key]:.2f}" for key in ("frechet", "multimodality")),
            )
        )
    table = "\n".join("| " + " | ".join(cells) + " |" for cells in lines)
    unknown = [name for name, row in result["rows"].items() if None in (row["frechet"], row["multimodality"])]
    if not unknown:
        return table
    return (
        f"{table}\n\n-: too many episodes of {', '.join(unknown)} ended within 0.5 s for their motion to be compared."
    )


def evaluate(
    retrievers: tuple[Path, ...] = (),
    databases: tuple[str, ...] = (),
    controller: Path | None = None,
    episodes: int = 64,
    seconds: float = 10.0,
    seed: int = 0,
    goal_speed: tuple[float, float] = GOAL_SPEED,
    goal_seconds: tuple[float, float] = GOAL_SECONDS,
    weighting: Literal["query", "metric"] = "query",
    query_period: int = 1,
    plot: Path | None = None,
    json: bool = False,
) -> int:
    """Measure retrieval locomotion: velocity error, falls, Frechet distance, multimodality.

    Retrieval without learning is always measured too, on the same goals.

    Args:
        retrievers: Run folders of `anyskill train-retrieval`, their policy.onnx, or .zip files of Stable-Baselines3.
        databases: Motion databases, SOURCE or NAME=SOURCE each; "move_around&usual" of the library by default.
        controller: Low-level controller (ONNX), with its motion encoder beside it; the bundled one by default.
        episodes: Episodes of each retriever.
        seconds: Length of an episode.
        seed: Seed of starts and goals.
        goal_speed: Slowest and fastest goal, m/s.
        goal_seconds: Shortest and longest time until a goal changes.
        weighting: What the retrievers weight.
        query_period: Decisions (1/6 s) between two retrievals.
        plot: Draw a sudden change of the goal's speed to this .png file.
        json: Print JSON instead of a table.

    Returns:
        0.

    Raises:
        FileNotFoundError: There is no such retriever or controller.
        ValueError: An option has a bad value.
    """
    if episodes < 2 or not seconds >= 1:
        raise ValueError(f"An evaluation needs at least 2 episodes of 1 s, got {episodes} of {seconds} s.")
    if plot is not None and plot.suffix.lower() != ".png":
        raise ValueError(f"The plot must be a .png file, got '{plot}'.")
    measured: dict[str, Retriever] = {"un-learned": unlearned}
    measured |= {str(path): load_retriever(path) for path in retrievers}
    options = {
        "databases": named_databases(databases),
        "database": "random" if len(databases) > 1 else None,
        "controller": None if controller is None else str(controller),
        "goal_speed": goal_speed,
        "goal_seconds": goal_seconds,
        "weighting": weighting,
        "query_period": query_period,
    }
    result = evaluate_retrievers(measured, options, episodes, seconds, seed)
    if plot is not None:
        series = {name: sudden_change(retriever, options, seed) for name, retriever in measured.items()}
        plot.parent.mkdir(parents=True, exist_ok=True)
        plot_sudden_change(plot, series)
        result["sudden_change"] = {
            name: {key: one[key] for key in ("fell", "slowest_and_fastest")} for name, one in series.items()
        }
    if json:
        print(json_format.dumps(result, indent=2))
    else:
        print(as_table(result))
        if plot is not None:
            print(f"Wrote {plot}", file=sys.stderr)
    return 0
