"""How near the latent that drives the controller stays to the motion library."""

from __future__ import annotations

from typing import Literal

import numpy as np

from rewards.base import FloatArray, RewardBatch, RewardOutput, TextFreeReward

StyleForm = Literal["distance", "nearest"]


class StyleReward(TextFreeReward):
    """The latent alignment of AnySkill (Cui et al., CVPR 2024), as printed and as released.

    "distance" is the second term of equation 3, exp(-4 |z - z^|_2): z is the latent that drives the controller and z^ a
    latent drawn from those of the motion library. Between unit vectors of 64 numbers that have nothing to do with each
    other the distance is about sqrt(2) and the term about exp(-4 sqrt(2)) = 0.0035, so it only speaks up close to z^.

    "nearest" is what the authors' code computes, max_k (cos(z, e_k) + 1) / 2 over latents e_k of the library, which is
    the style reward of CALM (Tessler et al., SIGGRAPH 2023) for the nearest of them. It is above
    0.5 unless the angles between z and all of them are obtuse.

    Term: "style".

    Args:
        form: "distance" or "nearest".
        sharpness: the factor 4 in the exponent of "distance".

    Raises:
        ValueError: another form, or a sharpness that is not finite.
    """

    def __init__(self, form: StyleForm = "distance", sharpness: float = 4.0) -> None:
        if form not in ("distance", "nearest"):
            raise ValueError(f'The form of the style term must be "distance" or "nearest", not {form!r}.')
        if not np.isfinite(sharpness):
            raise ValueError(f"The sharpness of the style term must be a finite number, not {sharpness}.")
        self.form = form
        self.sharpness = float(sharpness)
        self.needs = frozenset({"latent", "style_latent" if form == "distance" else "library_latents"})

    def alignment(self, batch: RewardBatch) -> FloatArray:
        """The term, (n,)."""
        assert batch.latent is not None  # `require` has seen to it
        if self.form == "distance":
            assert batch.style_latent is not None
            distance = np.linalg.norm(batch.latent - batch.style_latent, axis=-1)
            alignment: FloatArray = np.exp(-self.sharpness * distance)
            return alignment
        assert batch.library_latents is not None
        nearest: FloatArray = (batch.latent @ batch.library_latents.T).max(axis=-1)
        return (nearest + 1.0) / 2.0

    def __call__(self, batch: RewardBatch) -> RewardOutput:
        """Reward n humanoids.

        Raises:
            ValueError: the batch lacks what `needs` names.
        """
        batch.require(self.needs)
        return RewardOutput.from_terms({"style": self.alignment(batch)})
