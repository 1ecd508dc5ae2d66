"""The form in which PPO gets the environment: falling must not pay, values are of the size of one, time is seen."""

from __future__ import annotations

import numpy as np
from gymnasium.spaces import Box
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn

from agents.text.clock import CLOCK_SIZE, with_clock


class EpisodeClock(VecEnvWrapper):
    """Appends the time to observations; see `agents.text.clock`.

    Args:
        venv: An environment whose observations are vectors.
    """

    def __init__(self, venv: VecEnv) -> None:
        space = venv.observation_space
        assert isinstance(space, Box)
        clock = np.full(CLOCK_SIZE, 10.0, np.float32)
        low, high = np.concatenate([space.low, 0 * clock]), np.concatenate([space.high, clock])
        super().__init__(venv, observation_space=Box(low, high, dtype=np.float32))
        self._decisions = np.zeros(venv.num_envs, np.int64)

    def reset(self) -> VecEnvObs:
        """Start new episodes."""
        self._decisions[:] = 0
        return with_clock(np.asarray(self.venv.reset()), self._decisions)

    def step_wait(self) -> VecEnvStepReturn:
        """Execute the actions."""
        observations, rewards, dones, infos = self.venv.step_wait()
        self._decisions += 1
        for index in np.flatnonzero(dones):
            last = infos[index]["terminal_observation"][None]
            # PPO asks for the value of this state where time ran out. No decision was ever taken so late, so the clock
            # stays at the last one: what the episode would be worth if it went on as it was.
            infos[index]["terminal_observation"] = with_clock(last, self._decisions[index] - 1)[0]
        self._decisions[dones] = 0
        return with_clock(np.asarray(observations), self._decisions), rewards, dones, infos


class ShapedReward(VecEnvWrapper):
    """Adds a constant to every reward but that of a decision that ends in a termination, and scales the sum.

    A similarity can be negative. An agent that earns negative rewards learns to fall, because a fall ends the episode
    and with it the losses. With half of a cosine as reward a bonus of 0.5 makes every decision worth at least nothing.
    Scaled by one minus the discount, the value of a state is a mean of rewards instead of a sum: a value function of that
    size is learned quickly, and its gradients do not drown those of the policy, whose norms are clipped together.

    Args:
        venv: The environment.
        bonus: What to add.
        scale: By what to multiply the sum.
    """

    def __init__(self, venv: VecEnv, bonus: float, scale: float) -> None:
        super().__init__(venv)
        self._bonus = bonus
        self._scale = scale

    def reset(self) -> VecEnvObs:
        """Start new episodes."""
        return self.venv.reset()

    def step_wait(self) -> VecEnvStepReturn:
        """Execute the actions."""
        observations, rewards, dones, infos = self.venv.step_wait()
        terminated = dones & ~np.array([info["TimeLimit.truncated"] for info in infos])
        shaped = self._scale * (rewards + np.where(terminated, 0.0, self._bonus))
        return observations, shaped.astype(np.float32), dones, infos
