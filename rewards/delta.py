"""The change of similarity: progress towards the text."""

from __future__ import annotations

from rewards.base import RewardBatch, RewardOutput
from rewards.encoders import Encoder
from rewards.similarity import SimilarityReward, Source, cosine, past_features


class DeltaReward(SimilarityReward):
    """AnySkill's delta similarity: r_t = cos(f_image,t, f_text) - cos(f_image,t-1, f_text).

    It is no equation of the paper (Cui et al., CVPR 2024), but was the reward in earlier versions of its code, weighted by
    800 for rendered pictures and 3600 for their state projection; ``reward={"delta": 800}`` is that. There the memory of
    the last similarity outlived the episode; here the first step is compared with the state in which the episode starts.
    The rewards of an episode add up to the similarity of its last state minus that of its first.

    Term: "delta".

    Args:
        encoder: an encoder or its name.
        source: "state", "frames" or None; see :class:`SimilarityReward`.
    """

    history = 1

    def __init__(self, encoder: str | Encoder = "bundled", source: Source | None = None) -> None:
        super().__init__(encoder, source)
        self.needs |= {"past_features"}

    def __call__(self, batch: RewardBatch) -> RewardOutput:
        """Reward n humanoids.

        Raises:
            ValueError: the batch lacks what `needs` names.
        """
        batch.require(self.needs)
        similarity = cosine(self.image_feature(batch), batch)
        before = cosine(past_features(batch, 1)[:, 0], batch)
        return RewardOutput.from_terms({"delta": similarity - before}, similarity=similarity)
