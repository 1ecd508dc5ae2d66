"""Keeps the best policy of a run: exploration can hide that the mean action falls, and late updates can spoil.

A humanoid that explores is shaken out of places where one that always takes the mean action stands until it tips over. So
what training earns says little about the policy that is kept; every now and then it is played without exploration.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv

from motion_data.files import write_whole

PLAY_SECONDS = 45.0
"""Seconds of training between two plays; a play takes a little more than one."""


class BestPolicy(BaseCallback):
    """Plays the policy without exploration at the start, every 45 s and at the end, and keeps the one that earns most.

    What counts is the reward that PPO gets, with whatever the job adds to it; checks of success are not known here.

    Args:
        env: Where it is played, one episode of each humanoid; not the environment of training.
        decisions: Decisions of an episode.
        seed: Seed of the first states, the same each time.
        path: File of the best policy (zip of Stable-Baselines3).
        progress: Progress of the run; the entry "plays" holds `seconds` of training, `decisions` and mean `reward` of each.
    """

    def __init__(self, env: VecEnv, decisions: int, seed: int, path: Path, progress: dict[str, Any]) -> None:
        super().__init__()
        self._env = env
        self._episode = decisions
        self._seed = seed
        self._path = path
        self._begun, self._before = time.monotonic(), float(progress["seconds"])
        self._last = -np.inf
        self.plays: list[dict[str, float]] = progress.setdefault("plays", [])

    def _on_step(self) -> bool:
        return True

    def _on_rollout_start(self) -> None:
        if time.monotonic() - self._last >= PLAY_SECONDS:
            self._play()

    def _on_training_end(self) -> None:
        self._play()

    def _play(self) -> None:
        model = self.model
        assert isinstance(model, PPO)
        best = max((play["reward"] for play in self.plays), default=-np.inf)
        reward = mean_reward(model, self._env, self._episode, self._seed)
        seconds = self._before + time.monotonic() - self._begun
        self.plays.append({"seconds": seconds, "decisions": self.num_timesteps, "reward": reward})
        if reward > best:
            write_whole(self._path, model.save)
        self._last = time.monotonic()


def restore_best(model: PPO, path: Path, progress: dict[str, Any]) -> None:
    """Puts the best policy of a run back into the model, and its entry of the plays into `progress["kept"]`.

    Args:
        model: The model.
        path: File of the best policy; without it the model stays as it is.
        progress: Progress of the run.
    """
    if path.exists() and progress.get("plays"):
        model.set_parameters(str(path), device="cpu")
        progress["kept"] = max(progress["plays"], key=lambda play: play["reward"])


def mean_reward(model: PPO, env: VecEnv, decisions: int, seed: int) -> float:
    """Mean reward per decision without exploration, of the first episode of each humanoid; nothing comes after a fall.

    Args:
        model: The policy.
        env: The environment, all of whose episodes start together.
        decisions: Decisions of an episode.
        seed: Seed of the first states.
    """
    env.seed(seed)
    observation = env.reset()
    running = np.ones(env.num_envs, bool)
    total = np.zeros(env.num_envs)
    for _ in range(decisions):
        action, _ = model.predict(observation, deterministic=True)  # type: ignore[arg-type]
        observation, rewards, dones, _ = env.step(action)
        total += np.where(running, rewards, 0.0)
        running &= ~np.asarray(dones, bool)
        if not running.any():
            break
    result: NDArray[np.float64] = total / decisions
    return float(result.mean())
