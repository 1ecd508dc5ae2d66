"""Rewards for moving in a direction, to be added to one about a text."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from rewards.base import FloatArray, RewardBatch, RewardOutput, TextFreeReward

VelocityForm = Literal["ase", "anyskill"]

SHARPNESS = 0.25
"""Factor of the squared speed error in the exponent, in s^2/m^2; both forms have it."""
TANGENTIAL_SHARE = 0.1
VELOCITY_WEIGHT, FACING_WEIGHT = 0.7, 0.3
ANYSKILL_WEIGHT = 0.1

DEFAULT_SPEED = {"ase": 1.55, "anyskill": 0.2}
"""Wanted speeds in m/s. ASE draws its own from 1.5 to 1.6; that of AnySkill's code stays at 0.2."""


class VelocityReward(TextFreeReward):
    """Moving with a wanted speed v* in a direction d, as ASE and as the released code of AnySkill compute it.

    "ase", the heading task of ASE (Peng et al., SIGGRAPH 2022), as its code has it::

        r = 0.7 exp(-0.25 [(v* - d.v)^2 + 0.1 t^2]) + 0.3 max(0, d_face . h)

    where v is the horizontal velocity in the world, t the sum of the two components of v - (d.v) d, d_face the direction
    to face, h where the body faces; the first term is 0 if d.v <= 0. Terms: "velocity" and "facing".

    "anyskill", the auxiliary reward of AnySkill (Cui et al., CVPR 2024; "+ vel." in table 3)::

        r = 0.1 exp(-0.25 (v* - d.v)^2), 0 if d.v <= 0

    Term: "velocity".

    Args:
        form: "ase" or "anyskill".
        speed: v* in m/s; 1.55 in the form "ase" and 0.2 in the form "anyskill" if None.
        direction: d, x and y in the world; need not have length 1.
        face: d_face; the direction if None. Only the form "ase" looks at it.

    Raises:
        ValueError: another form, a speed that is not finite, or a direction that is no direction.
    """

    def __init__(
        self,
        form: VelocityForm = "ase",
        speed: float | None = None,
        direction: ArrayLike = (1.0, 0.0),
        face: ArrayLike | None = None,
    ) -> None:
        if form not in DEFAULT_SPEED:
            raise ValueError(f'The form of the velocity reward must be "ase" or "anyskill", not {form!r}.')
        self.form = form
        self.speed = float(DEFAULT_SPEED[form] if speed is None else speed)
        if not np.isfinite(self.speed):
            raise ValueError(f"The wanted speed must be a finite number in m/s, not {speed}.")
        self.direction = _unit(direction)
        self.face = self.direction if face is None else _unit(face)
        self.needs = frozenset({"velocity", "facing"} if form == "ase" else {"velocity"})

    def __call__(self, batch: RewardBatch) -> RewardOutput:
        """Reward n humanoids.

        Raises:
            ValueError: the batch lacks what `needs` names.
        """
        batch.require(self.needs)
        assert batch.velocity is not None
        forward = batch.velocity @ self.direction
        error = (self.speed - forward) ** 2
        if self.form == "anyskill":
            return RewardOutput.from_terms(
                {"velocity": np.where(forward > 0.0, ANYSKILL_WEIGHT * np.exp(-SHARPNESS * error), 0.0)}
            )
        assert batch.facing is not None
        tangential = (batch.velocity - forward[:, None] * self.direction).sum(axis=-1)
        moving = np.exp(-SHARPNESS * (error + TANGENTIAL_SHARE * tangential**2))
        return RewardOutput.from_terms(
            {
                "velocity": VELOCITY_WEIGHT * np.where(forward > 0.0, moving, 0.0),
                "facing": FACING_WEIGHT * np.maximum(batch.facing @ self.face, 0.0),
            }
        )


def _unit(direction: ArrayLike) -> FloatArray:
    vector = np.asarray(direction, np.float32)
    length = float(np.linalg.norm(vector))
    if vector.shape != (2,) or not 0.0 < length < np.inf:
        raise ValueError(f"A direction must be two numbers, x and y, that are not both 0, not {direction!r}.")
    unit: FloatArray = vector / length
    return unit
