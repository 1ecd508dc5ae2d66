"""HumanoidText-v0: a humanoid that is rewarded for doing what a sentence says."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import ArrayLike, NDArray

from anyskill_envs.actions import ActionDecoder, FloatArray
from anyskill_envs.controller import LowLevelController
from anyskill_envs.humanoid_reward import HumanoidReward
from anyskill_envs.latent import HumanoidLatentEnv, HumanoidLatentVectorEnv
from anyskill_envs.objects import SceneObject
from anyskill_envs.objects.scene import Scene
from anyskill_envs.rendering import camera_of
from rewards import Encoder, RewardFn, RewardOutput, make_reward
from rewards.episodic import checked_texts

DEFAULT_TEXT = "raise both arms above the head"


class HumanoidTextVectorEnv(HumanoidLatentVectorEnv):
    """Humanoids rewarded for what a text says; see :class:`HumanoidTextEnv`.

    Args:
        num_envs: number of humanoids.
        text: what to do, one sentence for all or a list with one for each humanoid.
        reward: name of a reward of the package `rewards`; or weights by name, ``{"clip": 0.8, "velocity": 0.2}``, for a
            sum; or a reward.
        reward_kwargs: arguments of the reward's constructor, beside `encoder`; see `rewards.make_reward`.
        encoder: what compares text and motion: a name, see `rewards.load_encoder`, or an encoder.
        text_observation: append the text's feature to the observation, for one policy that is told many texts.
        terminate_when_fallen: see :class:`HumanoidVectorEnv`; a fall ends the episode by default.
        controller: path of the controller's ONNX file, or a loaded controller; the bundled one if None.
        num_threads: threads of physics, controller and reward; 0 for one per CPU. Results do not depend on it.
        objects: what stands beside each humanoid; see :class:`HumanoidVectorEnv`.
        **kwargs: arguments of :class:`HumanoidVectorEnv`.

    Raises:
        FileNotFoundError: there is no such controller file.
        RenderingError: the reward looks at pictures, and none can be drawn on this machine.
        ValueError: an empty text, an unknown reward or encoder, or another argument out of its range.
    """

    reset_options: ClassVar[tuple[str, ...]] = (*HumanoidLatentVectorEnv.reset_options, "text")

    def __init__(
        self,
        num_envs: int = 1,
        *,
        text: str | Sequence[str] = DEFAULT_TEXT,
        reward: str | Mapping[str, float] | RewardFn = "clip",
        reward_kwargs: Mapping[str, Any] | None = None,
        encoder: str | Encoder = "bundled",
        text_observation: bool = False,
        terminate_when_fallen: bool = True,
        controller: LowLevelController | str | Path | None = None,
        num_threads: int = 0,
        objects: Scene | Sequence[str | SceneObject] = (),
        **kwargs: Any,
    ) -> None:
        texts = checked_texts(text, max(num_envs, 1), "humanoids")  # the base class refuses less
        # One humanoid needs one thread: single environments are run in many processes at once.
        threads = num_threads if num_envs > 1 else 1
        if isinstance(reward, str | Mapping):
            reward = make_reward(reward, **{"encoder": encoder, "num_threads": threads} | dict(reward_kwargs or {}))
        if not isinstance(controller, LowLevelController):
            controller = LowLevelController.load(controller, threads)
        scene = Scene.of(objects)
        camera = camera_of(kwargs.get("camera"), scene)
        self._reward = HumanoidReward(reward, texts, camera, controller.latents, scene)
        self.text_observation = text_observation
        super().__init__(
            num_envs,
            controller=controller,
            num_threads=num_threads,
            terminate_when_fallen=terminate_when_fallen,
            objects=scene,
            **kwargs,
        )

    @property
    def reward(self) -> RewardFn:
        """The reward."""
        return self._reward.reward

    @property
    def texts(self) -> list[str]:
        """What each humanoid should do."""
        return self._reward.texts

    @property
    def text_features(self) -> FloatArray:
        """Unit features of the texts, ``(n, d)``."""
        return self._reward.text_features

    @property
    def library_latents(self) -> FloatArray:
        """Latents of the motion library that a style term "nearest" looks through, ``(128, 64)``."""
        return self._reward.library_latents

    def make_observation_space(self) -> Box:
        """Proprioception and objects, and the text's feature if it was asked for."""
        space = super().make_observation_space()
        if not self.text_observation:
            return space
        feature = np.ones(self.text_features.shape[1], np.float32)
        return Box(np.concatenate([space.low, -feature]), np.concatenate([space.high, feature]), dtype=np.float32)

    def observations(self, ids: NDArray[np.int64] | slice) -> FloatArray:
        """Observations of some humanoids, new arrays ``(k, 223)``, and further columns for objects and text."""
        observations = super().observations(ids)
        if self.text_observation:
            observations = np.concatenate([observations, self.text_features[ids]], axis=1)
        return observations

    def step_with(
        self, decoder: ActionDecoder, actions: ArrayLike
    ) -> tuple[FloatArray, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Draw the latents that a style term compares with, and step."""
        self._reward.draw_style_latents(self.np_random)
        return super().step_with(decoder, actions)

    def compute_reward(self, commands: FloatArray) -> RewardOutput:
        """The text reward of the controller step that was just executed."""
        return self._reward.of_step(self.proprioception, self.simulation.poses, commands, self.object_vectors)

    def begin_episodes(self, ids: NDArray[np.int64], options: dict[str, Any]) -> None:
        """Take in a new text; `text` may be one sentence or one for each of the humanoids that are reset."""
        if "text" in options:
            self._reward.set_texts(ids, checked_texts(options["text"], len(ids), "humanoids"))
        vectors = self.object_vectors[ids]
        self._reward.start_from(ids, self.proprioception[ids], self.simulation.poses[ids], vectors)

    def extra_info(self) -> dict[str, NDArray[Any]]:
        """The latents drawn for a style term: with them the reward can be recomputed."""
        return dict(self._reward.style_info())

    def close_extras(self, **kwargs: Any) -> None:
        """Free the GL contexts and close the window."""
        super().close_extras(**kwargs)
        self._reward.close()


class HumanoidTextEnv(HumanoidLatentEnv):
    """One humanoid that learns to do what a sentence says (AnySkill, Cui et al., CVPR 2024).

    ## Action space

    That of :class:`HumanoidLatentEnv`: a latent of the low-level controller, `Box(-1, 1, (64,), float32)`, for 1/6 s.

    ## Observation space

    Proprioception, `Box((223,), float32)`, as in :class:`HumanoidEnv`: one policy per text needs nothing else. Objects
    append what is seen of them, and `text_observation=True` appends the text's feature.

    ## Rewards

    That of the chosen reward function, averaged over the executed controller steps; `reward="clip"` has the terms
    `reward_clip` (similarity of text and motion) and `reward_style` (nearness to a latent of the motion library).
    `reward={"clip": 0.8, "velocity": 0.2}` is a weighted sum; docs/rewards.md has them all. `info["similarity"]` is the
    raw cosine.

    ## Starting state

    That of :class:`HumanoidEnv`. `reset(options={"text": ...})` changes the text.

    ## Objects

    HumanoidSoccer-v0, HumanoidDoor-v0, HumanoidChair-v0 and HumanoidPillar-v0 are this environment with `objects` and
    another default text; docs/objects.md describes them.

    ## Episode end

    That of :class:`HumanoidEnv`; a fall (a body other than feet and shins below 0.05 m) terminates unless
    `terminate_when_fallen=False`.

    ## Arguments

    Those of :class:`HumanoidTextVectorEnv`, but `num_envs`, `max_episode_steps` and `autoreset_mode`.

    ## Version history

    v0: first version.
    """

    vector_class: ClassVar[type[HumanoidTextVectorEnv]] = HumanoidTextVectorEnv
    vector: HumanoidTextVectorEnv

    @property
    def text(self) -> str:
        """What the humanoid should do."""
        return self.vector.texts[0]
