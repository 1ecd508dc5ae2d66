"""AnySkill's reward: how well the picture matches the text, and how near the latent stays to the motion library."""

from __future__ import annotations

from typing import Literal

import numpy as np

from rewards.base import FloatArray, RewardBatch, RewardOutput
from rewards.encoders import Encoder, load_encoder


class ClipReward:
    """Equation 3 of AnySkill (Cui et al., CVPR 2024): r = w_c cos(f_image, f_text) + w_s exp(-4 |z - z^|_2).

    f are unit features, z is the latent that drives the controller and z^ a latent drawn from those of the motion library.
    The paper gives no weights. The code its authors released weighs both terms alike (0.40 each, for a nearest-latent form
    of the second), so both are 0.5 here: the reward is then at most 1. Between unit vectors of 64 numbers that have
    nothing to do with each other the distance is about 1.4 and the second term about 0.002, so it only speaks up close
    to z^.

    Terms: "clip" and "style".
    """

    def __init__(
        self,
        encoder: str | Encoder = "bundled",
        source: Literal["state", "frames"] = "state",
        clip_weight: float = 0.5,
        style_weight: float = 0.5,
        style_sharpness: float = 4.0,
    ) -> None:
        """Choose encoder and weights.

        Args:
            encoder: an encoder or its name.
            source: "state" takes image features from the encoder's state projection and needs no rendering, "frames" from
                rendered pictures.
            clip_weight: w_c, the weight of the similarity.
            style_weight: w_s, the weight of the latent alignment.
            style_sharpness: the factor 4 in the exponent.

        Raises:
            ValueError: `source` is neither "state" nor "frames", or a weight is not finite.
        """
        if source not in ("state", "frames"):
            raise ValueError(f'source must be "state" or "frames", not {source!r}.')
        if not np.isfinite([clip_weight, style_weight, style_sharpness]).all():
            raise ValueError("The weights of the clip reward must be finite numbers.")
        self.encoder = load_encoder(encoder) if isinstance(encoder, str) else encoder
        self.source = source
        self.clip_weight = float(clip_weight)
        self.style_weight = float(style_weight)
        self.style_sharpness = float(style_sharpness)
        needs = {source, "text"}
        if self.style_weight != 0.0:
            needs |= {"latent", "style_latent"}
        self.needs = frozenset(needs)

    def encode_text(self, texts: list[str]) -> FloatArray:
        """Unit features (k, d) of k texts."""
        return self.encoder.encode_text(texts)

    def image_feature(self, batch: RewardBatch) -> FloatArray:
        """Unit features (n, d) of what the batch shows: those it carries, else encoded from its states or frames."""
        if batch.image_feature is not None:
            return batch.image_feature
        if self.source == "state":
            assert batch.observation is not None  # `require` has seen to it
            return self.encoder.encode_state(batch.observation)
        assert batch.frames is not None
        return self.encoder.encode_image(batch.frames)

    def __call__(self, batch: RewardBatch) -> RewardOutput:
        """Reward n humanoids.

        Raises:
            ValueError: the batch lacks what `needs` names.
        """
        batch.require(self.needs)
        assert batch.text_feature is not None
        text = np.atleast_2d(batch.text_feature)
        similarity: FloatArray = (self.image_feature(batch) * text).sum(axis=-1, dtype=np.float32)
        terms = {"clip": self.clip_weight * similarity}
        if self.style_weight != 0.0:
            assert batch.latent is not None and batch.style_latent is not None
            distance = np.linalg.norm(batch.latent - batch.style_latent, axis=-1)
            terms["style"] = self.style_weight * np.exp(-self.style_sharpness * distance)
        return RewardOutput.from_terms(terms, similarity=similarity)
