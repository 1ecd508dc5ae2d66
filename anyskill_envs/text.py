"""HumanoidText-v0: a humanoid that is rewarded for doing what a sentence says."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from anyskill_envs.actions import FloatArray
from anyskill_envs.controller import LowLevelController
from anyskill_envs.latent import HumanoidLatentEnv, HumanoidLatentVectorEnv
from anyskill_envs.rendering import HumanoidRenderer
from rewards import RewardBatch, RewardFn, RewardOutput, make_reward

DEFAULT_TEXT = "raise both arms above the head"


class HumanoidTextVectorEnv(HumanoidLatentVectorEnv):
    """Humanoids rewarded for what a text says; see :class:`HumanoidTextEnv`.

    Args:
        num_envs: number of humanoids.
        text: what to do, one sentence for all or a list with one for each humanoid.
        reward: name of a reward of the package `rewards`, or a reward.
        reward_kwargs: arguments of the reward's constructor, beside `encoder`.
        encoder: name of the encoder that compares text and motion.
        text_observation: append the text's feature to the observation, for one policy that is told many texts.
        terminate_when_fallen: see :class:`HumanoidVectorEnv`; a fall ends the episode by default.
        controller: path of the controller's ONNX file, or a loaded controller; the bundled one if None.
        num_threads: threads of physics and controller; 0 for one per CPU. Results do not depend on it.
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
        reward: str | RewardFn = "clip",
        reward_kwargs: Mapping[str, Any] | None = None,
        encoder: str = "bundled",
        text_observation: bool = False,
        terminate_when_fallen: bool = True,
        controller: LowLevelController | str | Path | None = None,
        num_threads: int = 0,
        **kwargs: Any,
    ) -> None:
        texts = _checked_texts(text, max(num_envs, 1))  # the base class refuses less
        if isinstance(reward, str):
            reward = make_reward(reward, **{"encoder": encoder} | dict(reward_kwargs or {}))
        self.reward = reward
        self.texts = list(texts)
        self.text_features = self._encode(texts)
        self.text_observation = text_observation
        self._frames = HumanoidRenderer() if "frames" in reward.needs else None
        self._previous_similarity = np.zeros(num_envs, np.float32)
        super().__init__(
            num_envs,
            controller=controller,
            num_threads=num_threads,
            terminate_when_fallen=terminate_when_fallen,
            **kwargs,
        )
        self._library_latents = self.decoder.controller.latents.astype(np.float32)
        self._style_latents = np.zeros((num_envs, self._library_latents.shape[1]), np.float32)

    def make_observation_space(self) -> Box:
        """Proprioception, and the text's feature if it was asked for."""
        space = super().make_observation_space()
        if not self.text_observation:
            return space
        feature = np.ones(self.text_features.shape[1], np.float32)
        return Box(np.concatenate([space.low, -feature]), np.concatenate([space.high, feature]), dtype=np.float32)

    def observations(self, ids: NDArray[np.int64] | slice) -> FloatArray:
        """Observations of some humanoids, new arrays ``(k, 223)`` or ``(k, 223 + d)``."""
        observations = super().observations(ids)
        if self.text_observation:
            observations = np.concatenate([observations, self.text_features[ids]], axis=1)
        return observations

    def compute_reward(self, commands: FloatArray) -> RewardOutput:
        """The text reward of the controller step that was just executed."""
        output = self.reward(self._reward_batch(commands))
        if output.similarity is not None:
            self._previous_similarity = np.asarray(output.similarity, np.float32)
        return output

    def begin_episodes(self, ids: NDArray[np.int64], options: dict[str, Any]) -> None:
        """Take in a new text; `text` may be one sentence or one for each of the humanoids that are reset."""
        if "text" in options:
            texts = _checked_texts(options["text"], len(ids))
            for index, text in zip(ids, texts, strict=True):
                self.texts[index] = text
            self.text_features[ids] = self._encode(texts)
        if "previous_similarity" in self.reward.needs:
            # A reward for progress counts from the state in which the episode starts.
            commands = self.decoder.commands(np.zeros((self.num_envs, *self.decoder.space.shape)))
            similarity = self.reward(self._reward_batch(commands)).similarity
            assert similarity is not None  # what such a reward compares
            self._previous_similarity[ids] = similarity[ids]

    def begin_decision(self) -> None:
        """Draw the latents of the motion library that the reward's style term compares with."""
        if "style_latent" in self.reward.needs:
            drawn = self.np_random.integers(len(self._library_latents), size=self.num_envs)
            self._style_latents = self._library_latents[drawn]

    def extra_info(self) -> dict[str, NDArray[Any]]:
        """The drawn latents, if the reward used any: with them it can be recomputed."""
        return {"style_latent": self._style_latents.copy()} if "style_latent" in self.reward.needs else {}

    def close_extras(self, **kwargs: Any) -> None:
        """Free the GL contexts and close the window."""
        super().close_extras(**kwargs)
        if self._frames is not None:
            self._frames.close()

    def _encode(self, texts: Sequence[str]) -> FloatArray:
        """Features ``(n, d)`` of n texts; each different text is encoded once."""
        different = list(dict.fromkeys(texts))
        features = np.asarray(self.reward.encode_text(different), np.float32)
        return features[[different.index(text) for text in texts]]

    def _reward_batch(self, commands: FloatArray) -> RewardBatch:
        frames = None
        if self._frames is not None:
            frames = np.stack([self._frames.render(qpos, self._camera) for qpos in self.simulation.qpos])
        return RewardBatch(
            observation=self.proprioception,
            frames=frames,
            text_feature=self.text_features,
            latent=commands,
            style_latent=self._style_latents,
            previous_similarity=self._previous_similarity,
        )


def _checked_texts(text: str | Sequence[str], count: int) -> list[str]:
    """One text for each of `count` humanoids."""
    texts = [text] * count if isinstance(text, str) else list(text)
    if len(texts) != count:
        raise ValueError(
            f"text must be one sentence, or one for each of the {count} humanoids; got {len(texts)} of them."
        )
    if not all(isinstance(item, str) and item.strip() for item in texts):
        raise ValueError('text is empty: say what the humanoid should do, for instance text="wave the right hand".')
    return texts


class HumanoidTextEnv(HumanoidLatentEnv):
    """One humanoid that learns to do what a sentence says (AnySkill, Cui et al., CVPR 2024).

    ## Action space

    That of :class:`HumanoidLatentEnv`: a latent of the low-level controller, `Box(-1, 1, (64,), float32)`, for 1/6 s.

    ## Observation space

    Proprioception, `Box((223,), float32)`, as in :class:`HumanoidEnv`: one policy per text needs nothing else.
    `text_observation=True` appends the text's feature.

    ## Rewards

    That of the chosen reward function, averaged over the executed controller steps; `reward="clip"` has the terms
    `reward_clip` (similarity of text and motion) and `reward_style` (nearness to a latent of the motion library).
    `info["similarity"]` is the raw cosine.

    ## Starting state

    That of :class:`HumanoidEnv`. `reset(options={"text": ...})` changes the text.

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
