"""The goal-baseline regularised reward of VLM-RMs."""

from __future__ import annotations

import numpy as np

from rewards.base import FloatArray, RewardBatch, RewardOutput
from rewards.encoders import Encoder
from rewards.similarity import SimilarityReward, Source, cosine

BASELINE = "a humanoid robot"
"""The baseline prompt of Rocamonde et al. for the humanoid."""


class VlmRmReward(SimilarityReward):
    """VLM-RM (Rocamonde et al., ICLR 2024): r = 1 - |alpha proj_L(s) + (1 - alpha) s - g|^2 / 2.

    This is their "goal-baseline regularization": s is the unit feature of the image, g that of the text (the goal), b that
    of the baseline prompt, and L the line through b and g. What does not lie in the direction from the baseline to the
    goal counts less. With alpha = 0 it is cos(s, g), with alpha = 1 only the direction counts. The default alpha and
    baseline prompt are those of the example that the authors publish with their code.

    Term: "vlm_rm".

    Args:
        encoder: an encoder or its name.
        source: "state", "frames" or None; see :class:`SimilarityReward`.
        alpha: strength of the regularisation, from 0 to 1.
        baseline: the baseline prompt: what is seen whatever the humanoid does.

    Raises:
        ValueError: alpha out of its range.
    """

    def __init__(
        self,
        encoder: str | Encoder = "bundled",
        source: Source | None = None,
        alpha: float = 0.5,
        baseline: str = BASELINE,
    ) -> None:
        if not 0.0 <= alpha <= 1.0:
            raise ValueError(f"alpha must be between 0 and 1, not {alpha}.")
        super().__init__(encoder, source)
        self.alpha = float(alpha)
        self.baseline = baseline
        self.baseline_feature = self.encoder.encode_text([baseline])[0]

    def encode_text(self, texts: list[str]) -> FloatArray:
        """Unit features (k, d) of k texts.

        Raises:
            ValueError: a text means the same as the baseline prompt, so that there is no direction between them.
        """
        features = super().encode_text(texts)
        for text, length in zip(texts, np.linalg.norm(features - self.baseline_feature, axis=-1), strict=True):
            if self.alpha > 0.0 and length < 1e-4:
                raise ValueError(
                    f"The text {text!r} is the baseline prompt {self.baseline!r}: choose another baseline."
                )
        return features

    def __call__(self, batch: RewardBatch) -> RewardOutput:
        """Reward n humanoids.

        Raises:
            ValueError: the batch lacks what `needs` names.
        """
        batch.require(self.needs)
        assert batch.text_feature is not None
        image = self.image_feature(batch)
        goal = np.atleast_2d(batch.text_feature)
        direction = goal - self.baseline_feature
        # The goal lies on L, so proj_L(s) - g is the projection of s - g onto the direction of L.
        offset = image - goal
        along = (offset * direction).sum(-1, keepdims=True) / (direction**2).sum(-1, keepdims=True).clip(1e-12)
        regularised = self.alpha * along * direction + (1.0 - self.alpha) * offset
        reward = 1.0 - 0.5 * (regularised**2).sum(-1)
        return RewardOutput.from_terms({"vlm_rm": reward}, similarity=cosine(image, batch))
