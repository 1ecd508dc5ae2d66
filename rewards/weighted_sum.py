"""Several rewards, weighted and added up."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np

from rewards.base import (
    FloatArray,
    HistoryRewardFn,
    RewardBatch,
    RewardOutput,
    make_reward,
    reward_names,
    takes_argument,
)
from rewards.encoders import Encoder, load_encoder
from rewards.similarity import SimilarityReward, Source


def parse_weights(spelling: str) -> dict[str, float]:
    """Weights by name out of one line, for command lines: "clip+0.5*velocity" is `{"clip": 1.0, "velocity": 0.5}`.

    Args:
        spelling: parts joined by "+"; a part is a name, or a weight, "*" and a name. Blanks do not matter, and a part that
            occurs twice counts twice.

    Raises:
        ValueError: a part is not of this form.
    """
    weights: dict[str, float] = {}
    for part in spelling.split("+"):
        weight, star, name = part.rpartition("*")
        try:
            number = float(weight) if star else 1.0
        except ValueError:
            number = np.nan
        if not name.strip() or not np.isfinite(number):
            raise ValueError(
                f'The part {part.strip()!r} of the reward {spelling!r} is neither a name nor a weight, "*" and a name; '
                'write sums like "clip+0.5*velocity".'
            )
        weights[name.strip()] = weights.get(name.strip(), 0.0) + number
    return weights


class WeightedSum:
    """r = sum_i w_i r_i, with the terms of all parts: `make_reward({"clip": 0.8, "velocity": 0.2})`.

    All parts share one encoder, and what is seen is encoded once. Terms of the same name are added up; `similarity` is
    that of the first part that has one.

    Args:
        weights: weight of each reward, by its registered name; a weight of 0 leaves a reward out.
        encoder: an encoder or its name, for the parts that have one; "bundled" if None.
        source: "state", "frames" or None, for the parts that look at something; see :class:`SimilarityReward`.
        **arguments: further arguments of a part's constructor, by the name of the part.

    Raises:
        ValueError: no reward has such a name, a weight is not finite, or all of them are 0.
        TypeError: arguments of a reward that is no part.
    """

    def __init__(
        self,
        weights: Mapping[str, float],
        encoder: str | Encoder | None = None,
        source: Source | None = None,
        **arguments: Mapping[str, Any],
    ) -> None:
        unknown = [name for name in weights if name not in reward_names()]
        if unknown:
            make_reward(unknown[0])  # its error lists those that exist
        if not all(isinstance(weight, (int, float)) and np.isfinite(weight) for weight in weights.values()):
            raise ValueError(f"The weights of rewards must be finite numbers, got {dict(weights)}.")
        self.weights = {name: float(weight) for name, weight in weights.items() if weight != 0.0}
        if not self.weights:
            raise ValueError("A sum needs at least one reward with a weight that is not 0.")
        strangers = [name for name in arguments if name not in weights]
        if strangers:
            raise TypeError(f"Arguments of {strangers[0]!r}, which is no part of the sum of {', '.join(weights)}.")
        shared: dict[str, Any] = {} if source is None else {"source": source}
        if any(takes_argument(name, "encoder") for name in self.weights):
            encoder = "bundled" if encoder is None else encoder
            shared["encoder"] = load_encoder(encoder) if isinstance(encoder, str) else encoder
        self.parts = {
            name: make_reward(
                name,
                **{key: value for key, value in shared.items() if takes_argument(name, key)}
                | dict(arguments.get(name, {})),
            )
            for name in self.weights
        }
        self.needs = frozenset().union(*(part.needs for part in self.parts.values()))
        self.history = max(part.history if isinstance(part, HistoryRewardFn) else 0 for part in self.parts.values())
        self._seeing = [part for part in self.parts.values() if isinstance(part, SimilarityReward)]
        if len({(id(part.encoder), part.source) for part in self._seeing}) > 1:
            raise ValueError("The parts of a sum must share one encoder and one source: give them to the sum.")

    def encode_text(self, texts: list[str]) -> FloatArray:
        """Unit features (k, d) of k texts, empty if no part reads a text."""
        features = [part.encode_text(texts) for part in self.parts.values()]
        return max(features, key=lambda each: each.shape[1])

    def image_feature(self, batch: RewardBatch) -> FloatArray:
        """Unit features (n, d) of what the batch shows; empty if no part looks at it."""
        if not self._seeing:
            return np.zeros((len(batch), 0), np.float32)
        return self._seeing[0].image_feature(batch)

    def __call__(self, batch: RewardBatch) -> RewardOutput:
        """Reward n humanoids.

        Raises:
            ValueError: the batch lacks what `needs` names.
        """
        batch.require(self.needs)
        if self._seeing:
            batch = dataclasses.replace(batch, image_feature=self.image_feature(batch))
        terms: dict[str, FloatArray] = {}
        similarity = None
        for name, part in self.parts.items():
            output = part(batch)
            for term, value in output.terms.items():
                terms[term] = terms.get(term, np.float32(0.0)) + np.float32(self.weights[name]) * value
            similarity = output.similarity if similarity is None else similarity
        return RewardOutput.from_terms(terms, similarity=similarity)
