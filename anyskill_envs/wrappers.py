"""Wrappers that turn joint-level environments of this project into latent ones."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.utils import RecordConstructorArgs
from gymnasium.vector import VectorWrapper
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from anyskill_envs.actions import FloatArray, JointActions, LatentActions
from anyskill_envs.single import HumanoidEnv
from anyskill_envs.vector import HumanoidVectorEnv
from motion_data.skeleton import FRAME_RATE


class LatentAction(gym.Wrapper[FloatArray, FloatArray, FloatArray, FloatArray], RecordConstructorArgs):
    """Drives a joint-level environment through the low-level controller.

    An action is a latent, L2-normalised and held for five steps of the wrapped environment. The loop stops when the
    episode ends. Rewards, `reward_<term>` and `similarity` are averaged over the executed steps; the rest of `info` is
    that of the last step.

    Example:
        >>> import gymnasium as gym
        >>> import anyskill_envs
        >>> from anyskill_envs.wrappers import LatentAction
        >>> env = LatentAction(gym.make("HumanoidJoints-v0"))  # doctest: +SKIP

    Args:
        env: an environment whose unwrapped one is a joint-level :class:`HumanoidEnv`.
        controller: path of the controller's ONNX file; the bundled one if None.

    Raises:
        TypeError: the environment is not joint-level, or not one of this project.
        FileNotFoundError: there is no such controller file.
        ValueError: the file is not a controller for this humanoid.
    """

    def __init__(self, env: gym.Env[FloatArray, FloatArray], controller: str | Path | None = None) -> None:
        base = env.unwrapped
        if not isinstance(base, HumanoidEnv) or not isinstance(base.vector.decoder, JointActions):
            raise TypeError(
                f"LatentAction needs a joint-level HumanoidEnv, such as gym.make('HumanoidJoints-v0'), got {env}."
            )
        RecordConstructorArgs.__init__(self, controller=controller and str(controller))  # a Path is no JSON
        super().__init__(env)
        self._vector = base.vector
        self._joints = base.vector.decoder
        self._latents = LatentActions(controller)
        self.action_space = self._latents.space
        self.metadata = env.metadata | {"render_fps": round(FRAME_RATE / self._latents.controller_steps)}

    @property
    def latents(self) -> dict[str, FloatArray]:
        """Named latents of the controller, ``(64,)`` each."""
        return self._latents.controller.anchors

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[FloatArray, dict[str, Any]]:
        """Start a new episode."""
        observation, info = self.env.reset(seed=seed, options=options)
        return observation, info | {"latent": np.zeros(self._latents.controller.latent_size, np.float32)}

    def step(self, action: ArrayLike) -> tuple[FloatArray, float, bool, bool, dict[str, Any]]:
        """Play a latent ``(64,)`` for up to five controller steps."""
        commands = self._latents.commands(np.asarray(action)[None])
        rewards: list[float] = []
        infos: list[dict[str, Any]] = []
        for _ in range(self._latents.controller_steps):
            targets = self._latents.targets(self._vector.proprioception, commands)
            observation, reward, terminated, truncated, info = self.env.step(self._joints.actions(targets)[0])
            rewards.append(float(reward))
            infos.append(info)
            if terminated or truncated:
                break
        averaged = [key for key in infos[-1] if key.startswith("reward_") or key == "similarity"]
        info = infos[-1] | {key: float(np.mean([item[key] for item in infos])) for key in averaged}
        info |= {"controller_steps": len(infos), "latent": commands[0].copy()}
        return observation, float(np.mean(rewards)), terminated, truncated, info


class VectorLatentAction(VectorWrapper[FloatArray, FloatArray, FloatArray, FloatArray, NDArray[Any]]):
    """Drives a joint-level vector environment through the low-level controller; the batched :class:`LatentAction`.

    Args:
        env: a joint-level :class:`HumanoidVectorEnv`, not wrapped before: its loop of controller steps runs inside it.
        controller: path of the controller's ONNX file; the bundled one if None.

    Raises:
        TypeError: the environment is not joint-level, or not one of this project, or wrapped.
        FileNotFoundError: there is no such controller file.
        ValueError: the file is not a controller for this humanoid.
    """

    env: HumanoidVectorEnv

    def __init__(self, env: HumanoidVectorEnv, controller: str | Path | None = None) -> None:
        if not isinstance(env, HumanoidVectorEnv) or not isinstance(env.decoder, JointActions):
            raise TypeError(
                "VectorLatentAction needs an unwrapped joint-level HumanoidVectorEnv, such as "
                f"gym.make_vec('HumanoidJoints-v0', num_envs=8), got {env}."
            )
        super().__init__(env)
        self._latents = LatentActions(controller)
        self.single_action_space = self._latents.space
        self.action_space = batch_space(self._latents.space, env.num_envs)
        self.metadata = env.metadata | {"render_fps": round(FRAME_RATE / self._latents.controller_steps)}

    @property
    def latents(self) -> dict[str, FloatArray]:
        """Named latents of the controller, ``(64,)`` each."""
        return self._latents.controller.anchors

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[FloatArray, dict[str, Any]]:
        """Start new episodes."""
        return self.env.reset_with(self._latents, seed=seed, options=options)

    def step(self, actions: FloatArray) -> tuple[FloatArray, NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        """Play latents ``(num_envs, 64)`` for up to five controller steps."""
        return self.env.step_with(self._latents, actions)
