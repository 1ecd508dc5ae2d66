"""RACon's figure 6: how fast a humanoid follows when the speed of its goal jumps."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.retrieval.retriever import Retriever
from agents.retrieval.rollout import make_environment, roll_out
from motion_data.skeleton import FRAME_RATE

_SUDDEN_SECONDS = 4.0
_SPEED_PERCENTILES = (2, 98)


def sudden_change(
    retriever: Retriever, options: Mapping[str, Any], seed: int, humanoids: int = 32
) -> dict[str, NDArray[np.float64] | list[float] | float]:
    """The goal's speed jumps between the slowest and the fastest that the databases hold, and back.

    Returns:
        `seconds` and `goal` ``(T,)``, the mean `speed` along the goal ``(T,)`` of those that have not fallen, its
        `quartiles` ``(2, T)``, and the share that `fell`.
    """
    env = make_environment(humanoids, options, goal_seconds=None)
    names = env.clips.databases.names
    speeds = np.concatenate([env.clips.databases[name].speeds for name in names])
    slow, fast = np.percentile(speeds, _SPEED_PERCENTILES)
    ahead = np.zeros(humanoids)
    phases = {
        index * _SUDDEN_SECONDS: (np.full(humanoids, speed), ahead) for index, speed in enumerate((slow, fast, slow))
    }
    rollout = roll_out(env, retriever, 3 * _SUDDEN_SECONDS, seed, phases)
    env.close()
    length = max(map(len, rollout.velocity))
    along = np.full((humanoids, length), np.nan)
    for row, velocity in zip(along, rollout.velocity, strict=True):
        row[: len(velocity)] = velocity[:, 0]
    goal = max(rollout.goal, key=len)[:, 0]
    return {
        "seconds": np.arange(length) / FRAME_RATE,
        "goal": goal,
        "speed": np.nanmean(along, 0),
        "quartiles": np.nanpercentile(along, (25, 75), axis=0),
        "fell": float(rollout.fell.mean()),
        "slowest_and_fastest": [float(slow), float(fast)],
    }


def plot_sudden_change(path: Path, series: Mapping[str, Mapping[str, Any]]) -> None:
    """Draws the speed along the goal over time, with quartiles.

    Args:
        path: The picture, ending in .png.
        series: What :func:`sudden_change` returns, by name.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 3.6), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    longest = max(series.values(), key=lambda one: len(one["goal"]))
    axes.plot(longest["seconds"], longest["goal"], color="black", linestyle="--", label="goal")
    for (name, one), colour in zip(series.items(), ("#1b6ca8", "#c0392b", "#5a8f29", "#8e44ad"), strict=False):
        label = f"{name} ({one['fell']:.0%} fell)"
        axes.plot(one["seconds"], one["speed"], color=colour, label=label)
        axes.fill_between(one["seconds"], *one["quartiles"], color=colour, alpha=0.2, linewidth=0)
    axes.set_xlabel("s")
    axes.set_ylabel("speed along the goal, m/s")
    axes.grid(alpha=0.3)
    axes.legend(fontsize=9)
    figure.savefig(path, dpi=110)
