"""Stable-Baselines3 on batched environments: an adapter from `gymnasium.vector.VectorEnv` to SB3's `VecEnv`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv, VecMonitor
from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices, VecEnvStepReturn

import anyskill_envs  # noqa: F401  (registers the environments)


class VectorEnvAdapter(VecEnv):
    """Lets Stable-Baselines3 train on a Gymnasium vector environment: `PPO("MlpPolicy", VectorEnvAdapter(envs))`.

    As SB3 expects, an episode that ends starts anew in the same step, its last observation is in
    `info["terminal_observation"]` and `info["TimeLimit.truncated"]` tells a time limit from a termination. The rest of
    the `info` of such a step is that of the episode that ended.

    The batch is one environment: attributes and methods belong to all its humanoids at once.

    Args:
        env: a vector environment in "SameStep" autoreset mode.

    Raises:
        TypeError: it is no vector environment.
        ValueError: it resets in another mode.
    """

    def __init__(self, env: VectorEnv[Any, Any, Any]) -> None:
        if not isinstance(env, VectorEnv):
            raise TypeError(
                f"VectorEnvAdapter needs a gymnasium.vector.VectorEnv (from gym.make_vec), got {type(env)}."
            )
        mode = env.metadata.get("autoreset_mode")
        if mode != AutoresetMode.SAME_STEP:
            raise ValueError(
                f"Stable-Baselines3 resets in the same step, but this environment has the autoreset mode {mode}: make "
                'it with gym.make_vec(..., autoreset_mode="SameStep").'
            )
        self.env = env
        self._actions: NDArray[Any] | None = None
        super().__init__(env.num_envs, env.single_observation_space, env.single_action_space)
        self.metadata = env.metadata

    def reset(self) -> NDArray[Any]:
        """Start new episodes, with the seed and the options that were set before."""
        if any(options != self._options[0] for options in self._options):
            raise ValueError("The humanoids of a batch are reset with the same options: pass one dictionary.")
        observations, infos = self.env.reset(seed=self._seeds[0], options=self._options[0] or None)
        self.reset_infos = unstack_info(infos, self.num_envs)
        self._reset_seeds()
        self._reset_options()
        return observations

    def step_async(self, actions: NDArray[Any]) -> None:
        """Remember the actions ``(num_envs, ...)``."""
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        """Execute them: observations, rewards, dones and one info per humanoid."""
        observations, rewards, terminated, truncated, infos = self.env.step(self._actions)
        dones = terminated | truncated
        final_observations = infos.pop("final_obs", None)
        final_infos = infos.pop("final_info", None)
        infos.pop("_final_obs", None)
        infos.pop("_final_info", None)
        rows = unstack_info(infos, self.num_envs)
        finals = unstack_info(final_infos, self.num_envs) if final_infos is not None else rows
        for index in np.flatnonzero(dones):
            self.reset_infos[index] = rows[index]
            rows[index] = finals[index] | {"terminal_observation": final_observations[index]}
        for row, time_is_up in zip(rows, (truncated & ~terminated).tolist(), strict=True):
            row["TimeLimit.truncated"] = time_is_up
        return observations, np.asarray(rewards, np.float32), dones, rows

    def close(self) -> None:
        """Close the environment."""
        self.env.close()

    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        """One picture per humanoid."""
        frames: Any = self.env.render()
        return frames or [None] * self.num_envs

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """The attribute of the outermost wrapper that has it, once for each humanoid."""
        return [getattr(self._owner(attr_name), attr_name)] * len(list(self._get_indices(indices)))

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Set an attribute of the batch.

        Raises:
            ValueError: it was to be set for some of the humanoids only.
        """
        if len(set(self._get_indices(indices))) != self.num_envs:
            raise ValueError(f"{attr_name!r} belongs to all humanoids of the batch: leave `indices` out.")
        try:
            owner = self._owner(attr_name)
        except AttributeError:
            owner = self.env.unwrapped
        setattr(owner, attr_name, value)

    def env_method(
        self, method_name: str, *method_args: Any, indices: VecEnvIndices = None, **method_kwargs: Any
    ) -> Any:
        """Call a method of the batch, once; the result is repeated for each humanoid."""
        result = getattr(self._owner(method_name), method_name)(*method_args, **method_kwargs)
        return [result] * len(list(self._get_indices(indices)))

    def env_is_wrapped(self, wrapper_class: type[Any], indices: VecEnvIndices = None) -> list[bool]:
        """Whether the batch is wrapped, once for each humanoid."""
        return [any(isinstance(layer, wrapper_class) for layer in self._layers())] * len(
            list(self._get_indices(indices))
        )

    def _layers(self) -> list[VectorEnv[Any, Any, Any]]:
        """The environment from the outermost wrapper to its core."""
        layers = [self.env]
        while isinstance(layers[-1], gym.vector.VectorWrapper):
            layers.append(layers[-1].env)
        return layers

    def _owner(self, name: str) -> VectorEnv[Any, Any, Any]:
        for layer in self._layers():
            if hasattr(layer, name):
                return layer
        raise AttributeError(f"{self.env} has no attribute {name!r}.")


def unstack_info(infos: dict[str, Any], num_envs: int) -> list[dict[str, Any]]:
    """Gymnasium's vector `info`, arrays beside masks, as one dictionary for each humanoid."""
    rows: list[dict[str, Any]] = [{} for _ in range(num_envs)]
    for key, value in infos.items():
        if key.startswith("_"):
            continue
        if isinstance(value, dict):
            values: Sequence[Any] = unstack_info(value, num_envs)
        else:
            values = value.tolist() if value.ndim == 1 and value.dtype != object else list(value)
        mask = infos.get(f"_{key}")
        for index in range(num_envs) if mask is None else np.flatnonzero(mask).tolist():
            rows[index][key] = values[index]
    return rows


def make_sb3_env(
    environment_id: str, num_envs: int, *, seed: int | None = None, monitor: bool = True, **kwargs: Any
) -> VecEnv:
    """Make a batched environment for Stable-Baselines3.

    Args:
        environment_id: a registered id, for instance "HumanoidText-v0".
        num_envs: number of humanoids.
        seed: seeds the first reset.
        monitor: record returns and lengths of episodes (`VecMonitor`), which SB3 logs.
        **kwargs: arguments of the environment.

    Returns:
        The environment, ready for `PPO("MlpPolicy", env)`.
    """
    env: VecEnv = VectorEnvAdapter(
        gym.make_vec(environment_id, num_envs, autoreset_mode=AutoresetMode.SAME_STEP.value, **kwargs)
    )
    if monitor:
        env = VecMonitor(env)
    if seed is not None:
        env.seed(seed)
    return env
