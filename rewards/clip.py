"""AnySkill's reward: how well the picture matches the text, and how near the latent stays to the motion library."""

from __future__ import annotations

import numpy as np

from rewards.base import RewardBatch, RewardOutput
from rewards.encoders import Encoder
from rewards.similarity import SimilarityReward, Source, cosine
from rewards.style import StyleForm, StyleReward


class ClipReward(SimilarityReward):
    """Equation 3 of AnySkill (Cui et al., CVPR 2024): r = w_c cos(f_image, f_text) + w_s style(z).

    f are unit features; the style term is that of :class:`rewards.style.StyleReward`, exp(-4 |z - z^|_2) in the paper and
    the nearest latent of the library in the code that its authors released. The paper gives no weights. The released code
    weighs both terms alike (0.40 each), so both are 0.5 here: the reward is then at most 1.

    Terms: "clip" and, if it has a weight, "style".

    Args:
        encoder: an encoder or its name.
        source: "state", "frames" or None; see :class:`SimilarityReward`.
        clip_weight: w_c, the weight of the similarity.
        style_weight: w_s, the weight of the latent alignment.
        style: "distance" (the paper) or "nearest" (the released code).
        style_sharpness: the factor 4 in the exponent of "distance".

    Raises:
        ValueError: an argument is none of these, or a weight is not finite.
    """

    def __init__(
        self,
        encoder: str | Encoder = "bundled",
        source: Source | None = None,
        clip_weight: float = 0.5,
        style_weight: float = 0.5,
        style: StyleForm = "distance",
        style_sharpness: float = 4.0,
    ) -> None:
        if not np.isfinite([clip_weight, style_weight, style_sharpness]).all():
            raise ValueError("The weights of the clip reward must be finite numbers.")
        super().__init__(encoder, source)
        self.style = StyleReward(style, style_sharpness)
        self.clip_weight = float(clip_weight)
        self.style_weight = float(style_weight)
        if self.style_weight != 0.0:
            self.needs |= self.style.needs

    def __call__(self, batch: RewardBatch) -> RewardOutput:
        """Reward n humanoids.

        Raises:
            ValueError: the batch lacks what `needs` names.
        """
        batch.require(self.needs)
        similarity = cosine(self.image_feature(batch), batch)
        terms = {"clip": self.clip_weight * similarity}
        if self.style_weight != 0.0:
            terms["style"] = self.style_weight * self.style.alignment(batch)
        return RewardOutput.from_terms(terms, similarity=similarity)
