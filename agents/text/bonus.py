"""Why falling must not pay: a bonus for every decision on one's feet."""

from __future__ import annotations

import numpy as np
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn


class AliveBonus(VecEnvWrapper):
    """Adds a constant to every reward but that of a decision that ends in a termination.

    A similarity can be negative. An agent that earns negative rewards learns to fall, because a fall ends the episode
    and with it the losses. With half of a cosine as reward a bonus of 0.5 makes every decision worth at least nothing.

    Args:
        venv: The environment.
        bonus: What to add.
    """

    def __init__(self, venv: VecEnv, bonus: float) -> None:
        super().__init__(venv)
        self.bonus = bonus

    def reset(self) -> VecEnvObs:
        """Start new episodes."""
        return self.venv.reset()

    def step_wait(self) -> VecEnvStepReturn:
        """Execute the actions."""
        observations, rewards, dones, infos = self.venv.step_wait()
        terminated = dones & ~np.array([info["TimeLimit.truncated"] for info in infos])
        return observations, rewards + np.where(terminated, 0.0, self.bonus).astype(np.float32), dones, infos
