"""What the reward wrappers compute rewards from: the controller steps of our humanoids, or what any environment shows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Protocol

import gymnasium as gym
import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from anyskill_envs.actions import FloatArray
from anyskill_envs.humanoid_reward import HumanoidReward
from anyskill_envs.vector import HumanoidVectorEnv
from anyskill_envs.vector_info import reward_entries
from rewards import EpisodicReward, RewardBatch, RewardFn

Entries = dict[str, NDArray[Any]]
"""Terms, similarity and what else goes into `info`, ``(n, ...)`` each."""


class RewardSource(Protocol):
    """Computes the reward of one step of n environments out of what the step returned."""

    @property
    def episodic(self) -> EpisodicReward:
        """The reward at work."""
        ...

    def start(self, ids: NDArray[np.int64], observations: Any) -> None:
        """Begin episodes of the environments `ids`; `observations` are those of all environments."""
        ...

    def prepare(self) -> None:
        """Called before each step."""
        ...

    def entries(self, observations: Any, infos: dict[str, Any]) -> Entries:
        """Rewards by term of the step that led to `observations` and `infos`, of all n environments."""
        ...

    def blank(self, observations: Any) -> Entries:
        """Zeros under the keys of :meth:`entries`, for environments that were all reset and have not acted yet."""
        ...

    def close(self) -> None:
        """Free what was needed for pictures."""
        ...


class HumanoidSource:
    """Humanoids of this project: a reward for each controller step, averaged, as `HumanoidText-v0` does it.

    Poses and observations of the controller steps come through `info`: `record_controller_steps` is switched on here.

    Args:
        env: the batch of humanoids.
        reward: the reward.
        texts: what each of them should do.

    Raises:
        RenderingError: the reward looks at pictures, and none can be drawn on this machine.
        ValueError: the reward looks at latents, and the actions are none.
    """

    def __init__(self, env: HumanoidVectorEnv, reward: RewardFn, texts: Sequence[str]) -> None:
        controller = getattr(env.decoder, "controller", None)
        latents = None if controller is None else controller.latents
        self._env = env
        self.episodic: HumanoidReward = HumanoidReward(reward, texts, env._camera, latents, env.scene)
        env.record_controller_steps = True

    def start(self, ids: NDArray[np.int64], observations: Any) -> None:
        """Begin episodes in the states in which the humanoids are now."""
        env = self._env
        self.episodic.start_from(ids, env.proprioception[ids], env.simulation.poses[ids], env.object_vectors[ids])

    def prepare(self) -> None:
        """Draw the latents that a style term compares with, as `HumanoidText-v0` does."""
        self.episodic.draw_style_latents(self._env.np_random)

    def entries(self, observations: Any, infos: dict[str, Any]) -> Entries:
        """Means over the executed controller steps; one in which the simulation diverged earns nothing."""
        seen, poses = infos["controller_observations"], infos["controller_qpos"]
        objects = infos.get("controller_objects", np.zeros((*seen.shape[:2], 0), np.float32))
        latents = infos.get("latent")
        # A wrapper of the actions may have counted more steps than the last one, which is recorded.
        executed = np.minimum(infos["controller_steps"], seen.shape[1])
        sums: Entries = {}
        for step in range(seen.shape[1]):
            last = step == executed - 1
            counted = (step < executed) & ~(last & infos["diverged"])
            output = self.episodic.of_step(seen[:, step], poses[:, step], latents, objects[:, step])
            for key, value in reward_entries(output).items():
                sums[key] = sums.get(key, 0.0) + np.where(counted, value, 0.0)
        means: Entries = {key: value / np.maximum(executed, 1) for key, value in sums.items()}
        return means | dict(self.episodic.style_info())

    def blank(self, observations: Any) -> Entries:
        """Zeros under the keys of :meth:`entries`."""
        shape = (len(self.episodic.texts), self.episodic.library_latents.shape[1])
        still = np.zeros(shape, np.float32)
        env = self._env
        output = self.episodic.of_step(env.proprioception, env.simulation.poses, still, env.object_vectors)
        zeros: Entries = {key: np.zeros(shape[0]) for key in reward_entries(output)}
        return zeros | {key: np.zeros_like(value) for key, value in self.episodic.style_info().items()}

    def close(self) -> None:
        """Free the GL context."""
        self.episodic.close()


class ShownSource:
    """Any other environment: one reward for each step, for the observation or the picture that it ends with.

    Args:
        space: space of the observation of one environment.
        render: returns one picture for each environment.
        render_mode: render mode of the environment.
        reward: the reward.
        texts: the text of each environment.

    Raises:
        ValueError: the reward looks at something that this environment does not show.
    """

    def __init__(
        self,
        space: gym.Space[Any],
        render: Callable[[], Sequence[NDArray[np.uint8]]],
        render_mode: str | None,
        reward: RewardFn,
        texts: Sequence[str],
    ) -> None:
        self._render = render
        self._needs = reward.needs
        inner = sorted(self._needs - {"state", "frames", "text", "past_features"})
        if inner:
            raise ValueError(
                f"The reward looks at {', '.join(inner)}, which only the humanoids of this project have; choose another."
            )
        if "frames" in self._needs and render_mode != "rgb_array":
            raise ValueError(
                f"The reward looks at pictures, but the render mode is {render_mode!r}: make the environment with "
                'render_mode="rgb_array".'
            )
        if "state" in self._needs:
            _try_state(space, reward)
        self.episodic = EpisodicReward(reward, texts)

    def start(self, ids: NDArray[np.int64], observations: Any) -> None:
        """Begin episodes with what is shown now."""
        self.episodic.start(ids, self._batch(observations, ids))

    def prepare(self) -> None:
        """Nothing."""

    def entries(self, observations: Any, infos: dict[str, Any]) -> Entries:
        """Rewards of what is shown now."""
        output = self.episodic(self._batch(observations, np.arange(len(self.episodic.texts))))
        return {key: value.astype(np.float64) for key, value in reward_entries(output).items()}

    def blank(self, observations: Any) -> Entries:
        """Zeros under the keys of :meth:`entries`."""
        return {key: np.zeros_like(value) for key, value in self.entries(observations, {}).items()}

    def close(self) -> None:
        """Nothing: the environment closes its own pictures."""

    def _batch(self, observations: Any, ids: NDArray[np.int64]) -> RewardBatch:
        state = frames = None
        if "state" in self._needs:
            state = _flat(np.asarray(observations)[ids])
        if "frames" in self._needs:
            frames = np.stack([np.asarray(picture) for picture in self._render()])[ids]
        return RewardBatch(observation=state, frames=frames)


def _flat(observations: NDArray[Any]) -> FloatArray:
    return observations.reshape(len(observations), -1).astype(np.float32)


def _try_state(space: gym.Space[Any], reward: RewardFn) -> None:
    """Raises ValueError if the reward can make nothing of observations of this space."""
    advice = (
        'let it look at pictures: reward_kwargs={"source": "frames"}, and render_mode="rgb_array" for the environment.'
    )
    if not isinstance(space, Box):
        raise ValueError(f"The reward reads observations that are arrays, not {space}; {advice}")
    image_feature = getattr(reward, "image_feature", None)
    if image_feature is None:
        return
    try:
        image_feature(RewardBatch(observation=_flat(np.zeros((1, *space.shape)))))
    except ValueError as error:
        raise ValueError(f"The reward cannot read these observations, {space} ({error}); {advice}") from error
