"""RLCF's reward: CLIPScore against that of other texts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rewards.base import RewardBatch, RewardOutput
from rewards.encoders import Encoder
from rewards.similarity import SimilarityReward, Source, cosine

CLIP_SCORE_SCALE = 2.5
"""The factor of CLIPScore (Hessel et al., EMNLP 2021)."""

OTHER_TEXTS = ("stand still", "walk forward", "lie on the floor", "turn around")
"""Texts that, beside the wanted one, make up the K = 5 texts of RLCF's default."""


class ClipScoreReward(SimilarityReward):
    """RLCF (Zhao et al., ICLR 2024): r(t, v) = CLIPScore(t, v) - mean_k CLIPScore(t_k, v), CLIPScore = 2.5 max(cos, 0).

    The mean runs over K texts for the same image. RLCF lets a classifier sample them for each image; a skill has one text,
    so the other K - 1 are fixed here. Without other texts the reward is CLIPScore itself. A mean over the images that a
    policy has seen, which traces in AnySkill's code subtract for its comparison (table 3, "CLIP-S"), is no function of a
    batch; the value function of PPO takes that place.

    Terms: "clip_s" and, with other texts, "clip_s_baseline" (the mean with its minus).

    Args:
        encoder: an encoder or its name.
        source: "state", "frames" or None; see :class:`SimilarityReward`.
        other_texts: texts to compare with.
        divide_by_deviation: divide by the standard deviation of the K scores, RLCF's option; that of a sample (K - 1).

    Raises:
        ValueError: `divide_by_deviation` without other texts.
    """

    def __init__(
        self,
        encoder: str | Encoder = "bundled",
        source: Source | None = None,
        other_texts: Sequence[str] = OTHER_TEXTS,
        divide_by_deviation: bool = False,
    ) -> None:
        if isinstance(other_texts, str):
            raise ValueError(f"other_texts must be a list of texts, not the one text {other_texts!r}.")
        if divide_by_deviation and not other_texts:
            raise ValueError("divide_by_deviation needs other_texts: one score has no standard deviation.")
        super().__init__(encoder, source)
        self.other_texts = tuple(other_texts)
        self.divide_by_deviation = divide_by_deviation
        self.other_features = self.encoder.encode_text(list(other_texts)) if other_texts else None

    def __call__(self, batch: RewardBatch) -> RewardOutput:
        """Reward n humanoids.

        Raises:
            ValueError: the batch lacks what `needs` names.
        """
        batch.require(self.needs)
        image = self.image_feature(batch)
        similarity = cosine(image, batch)
        score = CLIP_SCORE_SCALE * np.maximum(similarity, 0.0)
        if self.other_features is None:
            return RewardOutput.from_terms({"clip_s": score}, similarity=similarity)
        others = CLIP_SCORE_SCALE * np.maximum(image @ self.other_features.T, 0.0)
        scores = np.concatenate([score[:, None], others], axis=1)
        baseline = scores.mean(axis=1)
        if self.divide_by_deviation:
            # Without a single positive cosine all scores are 0, and so is the reward.
            deviation = np.maximum(scores.std(axis=1, ddof=1), 1e-6)
            score, baseline = score / deviation, baseline / deviation
        return RewardOutput.from_terms({"clip_s": score, "clip_s_baseline": -baseline}, similarity=similarity)
