"""`anyskill evaluate retrieval`: how well retrieval follows goals, with and without a trained retriever."""

from __future__ import annotations

import json as json_format
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from agents.retrieval.config import named_databases
from agents.retrieval.retriever import Retriever, load_retriever, unlearned
from anyskill_envs.goals import GOAL_SECONDS, GOAL_SPEED
from anyskill_envs.observation import OBSERVATION_LAYOUT
from anyskill_envs.retrieval import RetrievalLocomotionVectorEnv
from anyskill_envs.simulation import CONTROLLER_STEPS
from motion_data.metrics import frechet_distance, frechet_floor, multimodality
from motion_data.motion_features import MOTION_FEATURE_SIZE, windowed_features
from motion_data.retrieval import MotionDatabases
from motion_data.retrieval_keys import turned
from motion_data.skeleton import FRAME_RATE, heading

DECISIONS_PER_SECOND = FRAME_RATE / CONTROLLER_STEPS
_LINEAR = OBSERVATION_LAYOUT["body_linear_velocities"].start
_SHORTEST = FRAME_RATE // 2
"""Frames below which an episode has no features: less than 0.5 s shows that it ended, not how it moved."""
_EPISODE_STRIDE = 0.5  # s
_REAL_STRIDE = 0.1  # s: clips are short, so their windows overlap more than those of the episodes
_CONDITIONS = 12
_PER_CONDITION = 10
_CONDITION_SECONDS = 4.0
_SUDDEN_SECONDS = 4.0
_SPEED_PERCENTILES = (2, 98)


@dataclass(frozen=True)
class Rollout:
    """Episodes of one retriever, recorded at 30 Hz.

    Attributes:
        qpos: Poses of each episode, ``(T, 35)`` each.
        velocity: Horizontal velocities of the root in the world, ``(T, 2)`` m/s each.
        goal: Goals, ``(T, 2)`` m/s each.
        clip_error: Distance of each retrieved clip's mean velocity to the goal, one for each decision, m/s.
        fell: Episodes that terminated, ``(n,)``.
        names: What was retrieved, one for each decision.
    """

    qpos: list[NDArray[np.float64]]
    velocity: list[NDArray[np.float64]]
    goal: list[NDArray[np.float64]]
    clip_error: NDArray[np.float64]
    fell: NDArray[np.bool_]
    names: list[str]

    @property
    def errors(self) -> NDArray[np.float64]:
        """Mean velocity error of each episode, ``(n,)`` m/s."""
        pairs = zip(self.velocity, self.goal, strict=True)
        return np.array([np.linalg.norm(velocity - goal, axis=1).mean() for velocity, goal in pairs])


def make_environment(episodes: int, options: Mapping[str, Any], **changes: Any) -> RetrievalLocomotionVectorEnv:
    """The batch of an evaluation."""
    return RetrievalLocomotionVectorEnv(episodes, **dict(options) | {"record_controller_steps": True} | changes)


def roll_out(
    env: RetrievalLocomotionVectorEnv,
    retriever: Retriever,
    seconds: float,
    seed: int,
    goals: Mapping[float, tuple[NDArray[np.float64], NDArray[np.float64]]] | None = None,
) -> Rollout:
    """Runs one episode of each humanoid.

    Args:
        env: The batch.
        retriever: What acts.
        seconds: Length of an episode that does not terminate.
        seed: Seed of starts and goals.
        goals: Speeds and directions ``(n,)`` to set at some moments (seconds); the environment's own goals if None.

    Returns:
        The episodes.
    """
    count = env.num_envs
    changes = {round(moment * DECISIONS_PER_SECOND): goal for moment, goal in (goals or {}).items()}
    observation, _ = env.reset(seed=seed)
    running, fell = np.ones(count, bool), np.zeros(count, bool)
    rows: list[list[tuple[NDArray[Any], NDArray[Any], NDArray[Any]]]] = [[] for _ in range(count)]
    clip_error: list[float] = []
    names: list[str] = []
    for decision in range(round(seconds * DECISIONS_PER_SECOND)):
        if decision in changes:
            for index, (speed, direction) in enumerate(zip(*changes[decision], strict=True)):
                env.set_goal(float(speed), float(direction), [index])
            observation = env.observations(slice(None))
        observation, _, terminated, truncated, info = env.step(retriever(observation))
        poses, proprioception = info["controller_qpos"], info["controller_observations"]
        velocity = turned(proprioception[:, :, _LINEAR : _LINEAR + 2], heading(poses[..., 3:7]))
        error = np.linalg.norm(env.clips.velocities - info["goal_velocity"], axis=1)
        for index in np.flatnonzero(running).tolist():
            # after a termination inside a decision the humanoid keeps its state: only executed steps count
            done = int(info["controller_steps"][index])
            goal = np.tile(info["goal_velocity"][index], (done, 1))
            rows[index].append((poses[index, :done], velocity[index, :done], goal))
            clip_error.append(float(error[index]))
            names.append(str(info["clip"][index]))
        fell |= running & terminated
        running &= ~(terminated | truncated)
        if not running.any():
            break
    joined = [[np.concatenate(parts) for parts in zip(*episode, strict=True)] for episode in rows]
    qpos, velocities, wished = map(list, zip(*joined, strict=True))
    return Rollout(qpos, velocities, wished, np.array(clip_error), fell, names)


def _features(motions: list[NDArray[np.float64]], stride: float) -> list[NDArray[np.float64]]:
    """Features of the 2 s windows of each motion that lasts 0.5 s, ``(windows, 88)`` each."""
    return [windowed_features(qpos, stride_seconds=stride) for qpos in motions if len(qpos) >= _SHORTEST]


class RealMotion:
    """The clips of the databases as features: what generated motion is compared with.

    Args:
        databases: The databases.
        rng: Source of what is drawn.
    """

    def __init__(self, databases: MotionDatabases, rng: np.random.Generator) -> None:
        motions = []
        for name in databases.names:
            database = databases[name]
            motions += np.split(database.qpos.astype(float), np.cumsum(database.lengths)[:-1])
        self._motions = _features(motions, _REAL_STRIDE)
        self.features = np.concatenate(self._motions)
        self._rng = rng

    def floor(self) -> float:
        """Frechet distance between halves of the real windows."""
        return frechet_floor(self.features, self._rng)

    def distance(self, motions: list[NDArray[np.float64]]) -> float | None:
        """Frechet distance to the real windows, with as many of each as in a half, so that the floor can be compared.

        Args:
            motions: Poses of each episode, ``(T, 35)`` each.

        Returns:
            The distance; None if episodes of 0.5 s or more have fewer than 2 windows.
        """
        windows = _features(motions, _EPISODE_STRIDE)
        if sum(map(len, windows)) < 2:
            return None
        features = np.concatenate(windows)
        count = min(len(features), len(self.features) // 2)
        one = self._rng.choice(len(features), count, replace=False)
        other = self._rng.choice(len(self.features), count, replace=False)
        return frechet_distance(features[one], self.features[other])

    def multimodality(self) -> float:
        """Mean distance of two windows of the same motion."""
        several = [features for features in self._motions if len(features) > 1]
        drawn = [features[self._rng.integers(len(features), size=_PER_CONDITION)] for features in several]
        return multimodality(np.stack(drawn), self._rng)


def same_goal_features(
    retriever: Retriever, options: Mapping[str, Any], seed: int, repeats: int = _PER_CONDITION
) -> NDArray[np.float64]:
    """Features of episodes under the same goal: 12 goals, some episodes of each from noisy starts.

    Returns:
        Features of the last 2 s of 4 s (or of what there is after a fall), ``(goals, repeats, 88)``; goals under which an
        episode lasts less than 0.5 s are left out.
    """
    rng = np.random.default_rng(seed)
    low, high = options.get("goal_speed", GOAL_SPEED)
    speed = np.repeat(rng.uniform(low, high, _CONDITIONS), repeats)
    direction = np.repeat(rng.uniform(-np.pi, np.pi, _CONDITIONS), repeats)
    env = make_environment(len(speed), options, goal_seconds=None, reset_noise_scale=0.05)
    rollout = roll_out(env, retriever, _CONDITION_SECONDS, seed, {0.0: (speed, direction)})
    env.close()
    last = [qpos[-round(2 * FRAME_RATE) :] for qpos in rollout.qpos]
    goals = [last[first : first + repeats] for first in range(0, len(last), repeats)]
    features = [[windowed_features(qpos)[0] for qpos in goal] for goal in goals if min(map(len, goal)) >= _SHORTEST]
    return np.reshape(features, (-1, repeats, MOTION_FEATURE_SIZE))


def sudden_change(
    retriever: Retriever, options: Mapping[str, Any], seed: int, humanoids: int = 32
) -> dict[str, NDArray[np.float64] | list[float] | float]:
    """RACon's figure 6: the goal's speed jumps between the slowest and the fastest that the databases hold, and back.

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
        repeated = same_goal_features(retriever, options, seed, int(np.clip(episodes // 6, 2, _PER_CONDITION)))
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
