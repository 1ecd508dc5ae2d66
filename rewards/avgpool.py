"""Similarity of the text with the mean feature of the last frames."""

from __future__ import annotations

import numpy as np

from rewards.base import RewardBatch, RewardOutput
from rewards.encoders import Encoder
from rewards.similarity import SimilarityReward, Source, cosine, past_features


class AvgPoolReward(SimilarityReward):
    """Mean-pooled features: r = cos(m, f_text), m = normalised mean of the unit features of the last `window` frames.

    "AvgPool" in table 3 of AnySkill (Cui et al., CVPR 2024), there named after VideoCLIP (Xu et al., EMNLP 2021). The
    paper says no more than "mean-pooled CLIP features across frames"; that frames are normalised, averaged and normalised
    again is what its code does with the features of CLIP4Clip. The window is nowhere stated; 8 is the length that
    traces of it in the code have.

    Frames before the episode count as its first state. `similarity` is that of the newest frame alone.

    Term: "avgpool".

    Args:
        encoder: an encoder or its name.
        source: "state", "frames" or None; see :class:`SimilarityReward`.
        window: number of frames that are averaged, with the newest one; in `HumanoidText-v0` they are 1/30 s apart.

    Raises:
        ValueError: a window below 1.
    """

    def __init__(self, encoder: str | Encoder = "bundled", source: Source | None = None, window: int = 8) -> None:
        if window < 1:
            raise ValueError(f"The window of avgpool must be at least 1 frame, not {window}.")
        super().__init__(encoder, source)
        self.window = window
        self.history = window - 1
        if self.history:
            self.needs |= {"past_features"}

    def __call__(self, batch: RewardBatch) -> RewardOutput:
        """Reward n humanoids.

        Raises:
            ValueError: the batch lacks what `needs` names.
        """
        batch.require(self.needs)
        newest = self.image_feature(batch)
        pooled = newest
        if self.history:
            pooled = np.concatenate([past_features(batch, self.history), newest[:, None]], axis=1).mean(axis=1)
            pooled = pooled / np.maximum(np.linalg.norm(pooled, axis=-1, keepdims=True), 1e-8)
        return RewardOutput.from_terms({"avgpool": cosine(pooled, batch)}, similarity=cosine(newest, batch))
