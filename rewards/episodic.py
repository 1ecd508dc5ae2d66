"""A reward along episodes: it is given the texts, and the past that a function of one step cannot know."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rewards.base import FloatArray, HistoryRewardFn, RewardBatch, RewardFn, RewardOutput


class EpisodicReward:
    """A reward at work on n environments, step by step.

    Environments and wrappers use it while they run, and it recomputes rewards on stored rollouts: give it the batches of
    the steps again, in their order. The reward itself stays a pure function of each batch.

    Args:
        reward: the reward.
        texts: the text of each environment, n of them.

    Attributes:
        reward: the reward.
        texts: the text of each environment.
        text_features: their unit features, (n, d).
    """

    def __init__(self, reward: RewardFn, texts: Sequence[str]) -> None:
        self.reward = reward
        self.texts = list(texts)
        self.text_features = self._encode(self.texts)
        self._looks_back = isinstance(reward, HistoryRewardFn) and reward.history > 0
        self._past: FloatArray | None = None

    def _encode(self, texts: Sequence[str]) -> FloatArray:
        """Features (k, d) of k texts; each different text is encoded once."""
        different = list(dict.fromkeys(texts))
        features = np.asarray(self.reward.encode_text(different), np.float32)
        return features[[different.index(text) for text in texts]]

    def set_texts(self, ids: NDArray[np.int64], texts: Sequence[str]) -> None:
        """Give the environments `ids` (k,) other texts, k of them."""
        features = self._encode(texts)
        for index, text in zip(ids, texts, strict=True):
            self.texts[index] = text
        self.text_features[ids] = features

    def start(self, ids: NDArray[np.int64], batch: RewardBatch) -> None:
        """Begin new episodes: the past of an episode is the state in which it starts.

        Args:
            ids: the environments that start, (k,).
            batch: their start states, k rows.
        """
        if not self._looks_back:
            return
        assert isinstance(self.reward, HistoryRewardFn)
        features = self.reward.image_feature(batch)
        if self._past is None:
            past = np.zeros((len(self.texts), self.reward.history, features.shape[1]), np.float32)
        else:
            past = self._past.copy()  # a batch that somebody keeps may hold the old one
        past[ids] = features[:, None]
        self._past = past

    def __call__(self, batch: RewardBatch) -> RewardOutput:
        """Reward one step of all n environments.

        Args:
            batch: what the reward needs but texts and past, n rows.

        Raises:
            ValueError: the batch lacks what the reward needs, or no episode was started.
        """
        changes: dict[str, Any] = {"text_feature": self.text_features}
        if not self._looks_back:
            return self.reward(dataclasses.replace(batch, **changes))
        assert isinstance(self.reward, HistoryRewardFn)
        if self._past is None:
            raise ValueError("This reward looks back: call start() with the states in which the episodes start first.")
        feature = self.reward.image_feature(batch)
        output = self.reward(dataclasses.replace(batch, image_feature=feature, past_features=self._past, **changes))
        self._past = np.concatenate([self._past[:, 1:], feature[:, None]], axis=1)
        return output


def checked_texts(text: str | Sequence[str], count: int, kind: str = "environments") -> list[str]:
    """One text for each of `count` environments.

    Args:
        text: one text for all, or a list of `count` texts.
        count: how many there are.
        kind: what they are called in the message.

    Raises:
        ValueError: a wrong number of texts, or an empty one.
    """
    texts = [text] * count if isinstance(text, str) else list(text)
    if len(texts) != count:
        raise ValueError(f"text must be one sentence, or one for each of the {count} {kind}; got {len(texts)} of them.")
    if not all(isinstance(item, str) and item.strip() for item in texts):
        raise ValueError('text is empty: say what the humanoid should do, for instance text="wave the right hand".')
    return texts
