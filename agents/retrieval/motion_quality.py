"""How retrieved motion compares with the databases' own, and how much it varies under the same goal."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.retrieval.retriever import Retriever
from agents.retrieval.rollout import make_environment, roll_out
from anyskill_envs.goals import GOAL_SPEED
from motion_data.metrics import frechet_distance, frechet_floor, multimodality
from motion_data.motion_features import MOTION_FEATURE_SIZE, windowed_features
from motion_data.retrieval import MotionDatabases
from motion_data.skeleton import FRAME_RATE

PER_CONDITION = 10
"""Episodes under the same goal, at most."""
_CONDITIONS = 12
_CONDITION_SECONDS = 4.0
_SHORTEST = FRAME_RATE // 2
"""Frames below which an episode has no features: less than 0.5 s shows that it ended, not how it moved."""
_EPISODE_STRIDE = 0.5  # s
_REAL_STRIDE = 0.1  # s: clips are short, so their windows overlap more than those of the episodes


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
        drawn = [features[self._rng.integers(len(features), size=PER_CONDITION)] for features in several]
        return multimodality(np.stack(drawn), self._rng)


def same_goal_features(
    retriever: Retriever, options: Mapping[str, Any], seed: int, repeats: int = PER_CONDITION
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
