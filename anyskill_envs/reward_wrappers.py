"""Wrappers that put a reward of the package `rewards` on any Gymnasium environment."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.utils import RecordConstructorArgs
from gymnasium.vector import AutoresetMode, VectorEnv, VectorWrapper
from numpy.typing import NDArray

from anyskill_envs.rebuilding import RebuiltFromArguments
from anyskill_envs.reward_sources import Entries, HumanoidSource, RewardSource, ShownSource
from anyskill_envs.single import HumanoidEnv
from anyskill_envs.vector import HumanoidVectorEnv
from anyskill_envs.vector_info import with_masks
from rewards import Encoder, RewardFn, encoder_names, load_encoder, make_reward
from rewards.episodic import checked_texts


class TextReward(RebuiltFromArguments, gym.Wrapper[Any, Any, Any, Any], RecordConstructorArgs):
    """Replaces the reward of an environment by how well it shows what a text says.

    Humanoids of this project earn what `HumanoidText-v0` gives with the same reward, averaged over the controller steps.
    Any other environment earns one reward for each step: rewards that look at pictures draw them with `env.render()`,
    rewards that look at states want observations that their encoder was made for.

    `info` holds every term as `reward_<term>` (they add up to the reward), `similarity`, and what the environment gave
    itself as `original_reward` and `original_reward_<term>`; humanoids also record their controller steps there.
    `reset(options={"text": ...})` changes the text.

    Example:
        >>> import gymnasium as gym, anyskill_envs
        >>> from anyskill_envs.reward_wrappers import TextReward
        >>> env = gym.make("HumanoidLatent-v0")  # doctest: +SKIP
        >>> env = TextReward(env, "raise both arms", reward={"vlm-rm": 0.8, "velocity": 0.2})  # doctest: +SKIP
        >>> pole = gym.make("CartPole-v1", render_mode="rgb_array")  # doctest: +SKIP
        >>> pole = TextReward(pole, "an upright pole", reward="clip-s", encoder="path/of/a/clip")  # doctest: +SKIP

    Args:
        env: the environment.
        text: what should be seen.
        reward: name of a reward, weights by name, or a reward; see `rewards.make_reward`.
        reward_kwargs: arguments of the reward's constructor, beside `encoder`.
        encoder: name of the encoder, or an encoder; see `rewards.load_encoder`.

    Raises:
        RenderingError: the reward looks at pictures, and none can be drawn on this machine.
        TypeError: `env` is a vector environment.
        ValueError: an empty text, an unknown reward or encoder, or one that looks at what this environment does not show.
    """

    def __init__(
        self,
        env: gym.Env[Any, Any],
        text: str,
        reward: str | Mapping[str, float] | RewardFn = "clip",
        reward_kwargs: Mapping[str, Any] | None = None,
        encoder: str | Encoder = "bundled",
    ) -> None:
        given: Any = env
        if isinstance(given, VectorEnv):
            raise TypeError("TextReward wraps single environments: use VectorTextReward for those of gym.make_vec.")
        RecordConstructorArgs.__init__(
            self, text=text, reward=reward, reward_kwargs=reward_kwargs, encoder=encoder, _disable_deepcopy=True
        )
        gym.Wrapper.__init__(self, env)
        base = env.unwrapped
        chosen = encoder if isinstance(base, HumanoidEnv) else _of_pictures(encoder)
        made = make_reward(reward, encoder=chosen, **dict(reward_kwargs or {}))
        texts = checked_texts(text, 1)
        self._source: RewardSource
        if isinstance(base, HumanoidEnv):
            self._source = HumanoidSource(base.vector, made, texts)
        else:
            self._source = ShownSource(env.observation_space, self._pictures, env.render_mode, made, texts)
        self._blank: Entries | None = None

    @property
    def text(self) -> str:
        """What should be seen."""
        return self._source.episodic.texts[0]

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Start a new episode; the option `text` changes the text."""
        options = dict(options or {})
        text = options.pop("text", None)
        observation, info = self.env.reset(seed=seed, options=options or None)
        if text is not None:
            self._source.episodic.set_texts(np.arange(1), checked_texts(text, 1))
        observations = _batch_of_one(observation)
        self._source.start(np.arange(1), observations)
        if self._blank is None:
            self._blank = self._source.blank(observations)
        return observation, self._told(info, 0.0, self._blank)

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Take a step of the environment."""
        self._source.prepare()
        observation, original, terminated, truncated, info = self.env.step(action)
        infos = {key: np.asarray(info[key])[None] for key in _CONTROLLER_STEP_KEYS if key in info}
        entries = self._source.entries(_batch_of_one(observation), infos)
        reward = float(_total(entries)[0])
        return observation, reward, terminated, truncated, self._told(info, float(original), entries)

    def close(self) -> None:
        """Close the environment, and free what was needed for pictures."""
        self._source.close()
        super().close()

    def _pictures(self) -> Sequence[NDArray[np.uint8]]:
        picture: Any = self.env.render()
        return [picture]

    def _told(self, info: dict[str, Any], original: float, entries: Entries) -> dict[str, Any]:
        own = {key: value[0].item() if value.ndim == 1 else value[0].copy() for key, value in entries.items()}
        return _renamed(info) | {"original_reward": original} | own


class VectorTextReward(RebuiltFromArguments, VectorWrapper[Any, Any, Any, Any, NDArray[Any]]):
    """Replaces the rewards of a vector environment; the batched :class:`TextReward`.

    Args:
        env: the vector environment, in any autoreset mode.
        text: what should be seen, one sentence for all or a list with one for each environment.
        reward: name of a reward, weights by name, or a reward; see `rewards.make_reward`.
        reward_kwargs: arguments of the reward's constructor, beside `encoder`.
        encoder: name of the encoder, or an encoder; see `rewards.load_encoder`.

    Raises:
        RenderingError: the reward looks at pictures, and none can be drawn on this machine.
        TypeError: `env` is no vector environment.
        ValueError: an empty text, an unknown reward or encoder, or one that looks at what this environment does not show.
    """

    def __init__(
        self,
        env: VectorEnv[Any, Any, NDArray[Any]],
        text: str | Sequence[str],
        reward: str | Mapping[str, float] | RewardFn = "clip",
        reward_kwargs: Mapping[str, Any] | None = None,
        encoder: str | Encoder = "bundled",
    ) -> None:
        if not isinstance(env, VectorEnv):
            raise TypeError(f"VectorTextReward wraps vector environments (of gym.make_vec), got {env}: use TextReward.")
        super().__init__(env)
        base = env.unwrapped
        chosen = encoder if isinstance(base, HumanoidVectorEnv) else _of_pictures(encoder)
        made = make_reward(reward, encoder=chosen, **dict(reward_kwargs or {}))
        texts = checked_texts(text, env.num_envs)
        # Gymnasium's own wrappers take an environment that does not tell its mode for one in this mode, too.
        self._mode = env.metadata.get("autoreset_mode", AutoresetMode.NEXT_STEP)
        self._source: RewardSource
        if isinstance(base, HumanoidVectorEnv):
            self._source = HumanoidSource(base, made, texts)
        else:
            if "frames" in made.needs and self._mode == AutoresetMode.SAME_STEP:
                raise ValueError(
                    'The last picture of an episode is lost in the autoreset mode "SameStep": use "NextStep", or wrap each '
                    "single environment in TextReward."
                )
            space = env.single_observation_space
            self._source = ShownSource(space, self._pictures, env.render_mode, made, texts)
        self._resetting = np.zeros(env.num_envs, bool)
        self._blank: Entries | None = None

    @property
    def texts(self) -> list[str]:
        """What should be seen in each environment."""
        return self._source.episodic.texts

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Start new episodes; the option `text` changes the text, one or one for each environment that is reset."""
        options = dict(options or {})
        text = options.pop("text", None)
        mask = np.array(options.get("reset_mask", np.ones(self.num_envs, bool)))
        observations, infos = self.env.reset(seed=seed, options=options or None)
        ids = np.flatnonzero(mask)
        if text is not None:
            self._source.episodic.set_texts(ids, checked_texts(text, len(ids)))
        self._source.start(ids, observations)
        self._resetting[ids] = False
        if self._blank is None:
            self._blank = self._source.blank(observations)
        everywhere = np.ones(self.num_envs, bool)
        return observations, self._told(infos, np.zeros(self.num_envs), self._blank, everywhere)

    def step(self, actions: Any) -> tuple[Any, NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        """Take a step of each environment."""
        self._source.prepare()
        observations, originals, terminated, truncated, infos = self.env.step(actions)
        done = terminated | truncated
        anew = done if self._mode == AutoresetMode.SAME_STEP else self._resetting
        final = infos.pop("final_info", None) if self._mode == AutoresetMode.SAME_STEP else None
        shown, steps = observations, infos
        if final is not None:
            shown = _chosen(done, np.stack([*infos["final_obs"][done]]), observations)
            steps = {key: _chosen(done, final[key][done], infos[key]) for key in _CONTROLLER_STEP_KEYS if key in infos}
        entries = self._source.entries(shown, steps)
        # Nothing is earned in the step that Gymnasium's "NextStep" mode spends on a reset.
        entries = {
            key: np.where(self._resetting, 0.0, value) if value.ndim == 1 else value for key, value in entries.items()
        }
        rewards = _total(entries)
        if anew.any():
            self._source.start(np.flatnonzero(anew), observations)
        self._resetting = done.copy() if self._mode == AutoresetMode.NEXT_STEP else np.zeros(self.num_envs, bool)

        everywhere = np.ones(self.num_envs, bool)
        if final is None:
            return observations, rewards, terminated, truncated, self._told(infos, originals, entries, everywhere)
        last = self._told(final, originals, entries, done)
        assert self._blank is not None
        present = {key: _chosen(done, self._blank[key][done], value) for key, value in entries.items()}
        infos = self._told(infos, np.where(done, 0.0, originals), present, everywhere)
        return observations, rewards, terminated, truncated, infos | {"final_info": last}

    def close(self, **kwargs: Any) -> None:
        """Close the environments, and free what was needed for pictures."""
        self._source.close()
        super().close(**kwargs)

    def _pictures(self) -> Sequence[NDArray[np.uint8]]:
        pictures: Any = self.env.render()
        return pictures

    def _told(
        self, infos: dict[str, Any], originals: NDArray[Any], entries: Entries, mask: NDArray[np.bool_]
    ) -> dict[str, Any]:
        own = {"original_reward": np.array(originals, np.float64)}
        own |= {key: np.array(value) for key, value in entries.items()}
        return _renamed(infos) | with_masks(own, mask)


_CONTROLLER_STEP_KEYS = (
    "controller_observations",
    "controller_qpos",
    "controller_objects",
    "controller_steps",
    "diverged",
    "latent",
)
"""What :class:`HumanoidSource` reads."""


def _of_pictures(encoder: str | Encoder) -> str | Encoder:
    """The encoder for environments of others: without the state projection that is cached for our humanoid's states."""
    if isinstance(encoder, str) and encoder not in encoder_names():
        return load_encoder(encoder, projection=False)
    return encoder


def _batch_of_one(observation: Any) -> Any:
    """A batch of one observation; only arrays are ever looked at."""
    return np.asarray(observation)[None] if isinstance(observation, np.ndarray | np.generic | int) else None


def _total(entries: Entries) -> NDArray[np.float64]:
    """The terms added up, ``(n,)``, in the order in which the environments of this project add them."""
    total: NDArray[np.float64] = np.sum([value for key, value in entries.items() if key.startswith("reward_")], axis=0)
    return total


def _chosen(mask: NDArray[np.bool_], rows: NDArray[Any], others: NDArray[Any]) -> NDArray[Any]:
    """A copy of `others` with other rows where the mask is true."""
    chosen = np.array(others)
    chosen[mask] = rows
    return chosen


def _renamed(info: dict[str, Any]) -> dict[str, Any]:
    """`info` (or vector info) with the terms of the replaced reward named as such."""
    renamed = {}
    for key, value in info.items():
        mask, name = ("_", key[1:]) if key.startswith("_") else ("", key)
        renamed[mask + ("original_" + name if name.startswith("reward_") else name)] = value
    return renamed
