"""What an object is: an MJCF fragment, where it is put, what the humanoid sees of it, and sentences about it."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from rewards.object_state import BLOCKS

Range = tuple[float, float]

RELATIONS = (
    "in front of",
    "beside",
    "facing",
    "touching",
    "kicking",
    "striking",
    "leaning on",
    "pushing open",
    "sitting on",
)
"""What a humanoid can have to do with an object; captions are filed under these names."""


@dataclass(frozen=True)
class Placement:
    """Where an object stands when an episode starts, seen from the humanoid. Values are drawn evenly from each range.

    Attributes:
        distance: from the humanoid's pelvis, horizontally, metres.
        bearing: direction in which the object lies, radians; 0 is ahead, positive is to the left.
        yaw: turn of the object about the vertical, radians; at 0 its x axis points at the humanoid.

    Raises:
        ValueError: a range is not a number or two finite numbers in rising order, or a distance is negative.
    """

    distance: Range = (1.0, 2.0)
    bearing: Range = (-0.5, 0.5)
    yaw: Range = (-0.5, 0.5)

    def __post_init__(self) -> None:
        """Check the ranges; a single number is a range of itself."""
        for item in dataclasses.fields(self):
            object.__setattr__(self, item.name, _checked_range(item.name, getattr(self, item.name)))
        if self.distance[0] < 0:
            raise ValueError(f"Placement.distance must be a range from 0 m on, not {self.distance}.")

    @property
    def ranges(self) -> tuple[Range, Range, Range]:
        """Distance, bearing and yaw."""
        return self.distance, self.bearing, self.yaw

    def changed(self, changes: Mapping[str, Any]) -> Placement:
        """A placement with other values for some of the ranges.

        Raises:
            ValueError: there is no such range, or a value is none.
        """
        names = [item.name for item in dataclasses.fields(self)]
        unknown = sorted(set(changes) - set(names))
        if unknown:
            raise ValueError(f"Unknown placement {unknown[0]!r}; the ranges that exist are: {', '.join(names)}.")
        return dataclasses.replace(self, **changes)


def _checked_range(name: str, value: Any) -> Range:
    try:
        numbers = np.asarray(value, dtype=np.float64).ravel()
    except (TypeError, ValueError):
        numbers = np.empty(0)
    if len(numbers) not in (1, 2) or not np.isfinite(numbers).all() or numbers[0] > numbers[-1]:
        raise ValueError(f"Placement.{name} must be a finite number, or two of them in rising order, not {value!r}.")
    return float(numbers[0]), float(numbers[-1])


@dataclass(frozen=True)
class SceneObject:
    """A thing beside the humanoid. One such constant in a file of its own, and one line that registers it, are an object.

    Attributes:
        name: lower-case name, by which environments and rewards find it.
        mjcf: the MJCF: either one `<body>`, or a whole `<mujoco>` document with assets, defaults or excluded contacts
            whose `<worldbody>` holds one body. With a `<freejoint/>` in it the object moves freely, without it stands
            fixed where it is put. Further bodies inside may have hinges and slides. The body's origin is the object's
            position, its height above the floor is the `z` of its `pos`, and its x axis is its front. Angles are
            in degrees, as in MJCF. Geoms touch humanoid, floor and other objects unless they say otherwise.
        placement: where it is put by default.
        radius: metres of floor around its origin that it takes up; no other object is put there.
        texts: what a humanoid may be told to do with it, the default first.
        captions: sentences that describe pictures with the object, by relation (one of `RELATIONS`).
        observed: blocks of :class:`rewards.object_state.ObjectState` that a policy observes; all that can change if
            None: position, rotation and both velocities of a free object, position and facing of a fixed one, and
            angle and velocity of each joint.
        kind: what it is, by which texts and their checks find it: a "latched_door" is a "door". Its name if left out.

    Raises:
        ValueError: a name, kind, relation or block that does not fit.
    """

    name: str
    mjcf: str
    placement: Placement = Placement()
    radius: float = 0.3
    texts: tuple[str, ...] = ()
    captions: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    observed: tuple[str, ...] | None = None
    kind: str = ""

    def __post_init__(self) -> None:
        """Check what MuJoCo will not."""
        object.__setattr__(self, "kind", self.kind or self.name)
        for word, value in (("name", self.name), ("kind", self.kind)):
            if not value.isidentifier() or value != value.lower():
                raise ValueError(f"The {word} of an object must be a lower-case word like 'ball', not {value!r}.")
        if not 0 <= self.radius < np.inf:
            raise ValueError(f"The radius of {self.name!r} must be a number of metres from 0 on, not {self.radius}.")
        strangers = [relation for relation in self.captions if relation not in RELATIONS]
        if strangers:
            raise ValueError(f"Unknown relation {strangers[0]!r} of {self.name!r}; there are: {', '.join(RELATIONS)}.")
        strangers = [block for block in self.observed or () if block not in OBSERVABLE]
        if strangers:
            raise ValueError(f"{self.name!r} cannot show {strangers[0]!r}; the blocks are: {', '.join(OBSERVABLE)}.")

    def __hash__(self) -> int:
        """By name and body; captions are a mapping and have no hash."""
        return hash((self.name, self.mjcf))


OBSERVABLE = (*BLOCKS, "facing", "angle", "angle_velocity")
"""Blocks that a policy can observe of an object; "facing" is the horizontal part of its x axis."""
