"""Shaped rewards for dealing with an object, the usual way to teach such a skill; for comparison with a text reward.

They read what the object does from physics, which a text reward never does. Every term lies between 0 and its weight.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rewards.base import FloatArray, RewardBatch, RewardOutput, TextFreeReward
from rewards.object_state import ObjectState

APPROACH_SPEED = 1.0
"""Wanted speed towards an object in m/s; that of AMP's target location task."""


class ObjectReward(TextFreeReward):
    """Base of rewards about one object of the scene.

    Args:
        object: name of the object; the first of the scene if None.
    """

    def __init__(self, object: str | None = None) -> None:
        self.object = object
        self.needs = frozenset({"objects", "velocity", "facing"})

    def state(self, batch: RewardBatch) -> ObjectState:
        """The object's state.

        Raises:
            ValueError: the scene has no such object, or the batch lacks what `needs` names.
        """
        batch.require(self.needs)
        assert batch.objects is not None
        name = self.default_object(batch.objects) if self.object is None else self.object
        if name not in batch.objects:
            raise ValueError(
                f"The reward looks at {name!r}, but the objects of the scene are: {', '.join(batch.objects)}."
            )
        return batch.objects[name]

    def default_object(self, objects: Mapping[str, ObjectState]) -> str:
        """Which object of the scene is looked at when none was named: the first."""
        return next(iter(objects))

    def nearing(self, batch: RewardBatch, reach: float) -> FloatArray:
        """The task "target location" of AMP (Peng et al., SIGGRAPH 2021), from 0 to 1, shape (n,).

        0.7 exp(-0.5 d^2) + 0.3 exp(-max(0, v* - u.v)^2), where d is the horizontal distance that is left until the pelvis
        is within reach, u the direction of the object, v the horizontal velocity of the pelvis; within reach both are 1.
        """
        position = self.state(batch).position[:, :2]
        assert batch.velocity is not None and batch.facing is not None
        distance = np.linalg.norm(position, axis=1)
        left = np.stack([-batch.facing[:, 1], batch.facing[:, 0]], axis=1)
        direction = position / np.maximum(distance, 1e-6)[:, None]
        towards = (direction[:, :1] * batch.facing + direction[:, 1:] * left) * batch.velocity
        missing = np.maximum(distance - reach, 0.0)
        slow = np.where(missing > 0.0, np.maximum(APPROACH_SPEED - towards.sum(axis=1), 0.0), 0.0)
        near: FloatArray = (0.7 * np.exp(-0.5 * missing**2) + 0.3 * np.exp(-(slow**2))).astype(np.float32)
        return near


class ApproachReward(ObjectReward):
    """Walking to an object: :meth:`ObjectReward.nearing`. Term: "approach".

    Args:
        object: name of the object; the first of the scene if None.
        reach: distance between pelvis and object at which it is reached, metres.
    """

    def __init__(self, object: str | None = None, reach: float = 0.5) -> None:
        super().__init__(object)
        self.reach = reach

    def __call__(self, batch: RewardBatch) -> RewardOutput:
        """Reward n humanoids."""
        return RewardOutput.from_terms({"approach": self.nearing(batch, self.reach)})


class StrikeReward(ObjectReward):
    """Walking to an object and getting it to move, as in kicking a ball or striking a pillar.

    The formula::

        r = 0.3 nearing + 0.7 min(s / speed, 1)

    where s is the speed of the object. Terms: "approach" and "strike".

    Args:
        object: name of the object; the first of the scene if None.
        speed: speed of the object that earns most, m/s.
        reach: as in :class:`ApproachReward`.

    Raises:
        ValueError: a speed that is not positive.
    """

    def __init__(self, object: str | None = None, speed: float = 3.0, reach: float = 0.4) -> None:
        super().__init__(object)
        self.speed = _checked("speed", speed)
        self.reach = reach

    def __call__(self, batch: RewardBatch) -> RewardOutput:
        """Reward n humanoids."""
        speed = np.linalg.norm(self.state(batch).linear_velocity, axis=1)
        strike = 0.7 * np.minimum(speed / self.speed, 1.0)
        return RewardOutput.from_terms({"approach": 0.3 * self.nearing(batch, self.reach), "strike": strike})


class OpenReward(ObjectReward):
    """Walking to a door and turning it on its hinge.

    The formula::

        r = 0.3 nearing + 0.7 min(max(a, 0) / angle, 1)

    where a is the angle of the object's first joint. Terms: "approach" and "open".

    Args:
        object: name of the object; the first of the scene that has a joint if None.
        angle: angle that earns most, radians.
        reach: as in :class:`ApproachReward`.

    Raises:
        ValueError: an angle that is not positive; or, when it is called, its object has no joint.
    """

    def __init__(self, object: str | None = None, angle: float = 1.5, reach: float = 0.4) -> None:
        super().__init__(object)
        self.angle = _checked("angle", angle)
        self.reach = reach
        self.needs |= {"object_angle"}

    def default_object(self, objects: Mapping[str, ObjectState]) -> str:
        """The first object with a joint."""
        return next((name for name, state in objects.items() if state.angle.shape[1]), next(iter(objects)))

    def __call__(self, batch: RewardBatch) -> RewardOutput:
        """Reward n humanoids."""
        angle = self.state(batch).angle
        if not angle.shape[1]:
            raise ValueError('The reward "open" looks at the hinge of an object, and this one has none; try "strike".')
        opening = 0.7 * np.clip(angle[:, 0] / self.angle, 0.0, 1.0)
        return RewardOutput.from_terms({"approach": 0.3 * self.nearing(batch, self.reach), "open": opening})


class SitReward(ObjectReward):
    """Bringing the pelvis onto a seat and resting there.

    The formula::

        r = 0.7 exp(-10 |x - c|^2) + 0.3 exp(-2 |v|^2) near

    where x is the pelvis, c a point 0.12 m above the object's position (the pelvis of one who sits there), near the first
    factor, v the horizontal velocity of the pelvis. Terms: "seat" and "rest".

    Args:
        object: name of the object; the first of the scene if None.
        height: height of the sitting pelvis above the object's position, metres.
    """

    def __init__(self, object: str | None = None, height: float = 0.12) -> None:
        super().__init__(object)
        self.height = height

    def __call__(self, batch: RewardBatch) -> RewardOutput:
        """Reward n humanoids."""
        offset = self.state(batch).position + np.array([0.0, 0.0, self.height], np.float32)
        assert batch.velocity is not None
        near = np.exp(-10.0 * np.square(offset).sum(axis=1))
        rest = np.exp(-2.0 * np.square(batch.velocity).sum(axis=1))
        return RewardOutput.from_terms({"seat": 0.7 * near, "rest": 0.3 * near * rest})


def _checked(name: str, value: float) -> float:
    """A number that something is divided by."""
    if not (np.isfinite(value) and value > 0):
        raise ValueError(f"The {name} that earns most must be a positive number, not {value}.")
    return float(value)
