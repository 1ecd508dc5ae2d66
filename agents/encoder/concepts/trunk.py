"""Concepts about trunk and head, and about reaching the floor."""

from __future__ import annotations

import numpy as np

from agents.encoder.concepts.base import add, add_sided, degrees
from agents.encoder.measurements import SIDES, Array, Measurements, partly, ramp


def _pitch(m: Measurements) -> Array:
    """Forward tilt of the torso in radians."""
    up = m.axis("torso", 2)
    return np.arctan2(up[:, 0], up[:, 2])


def _roll(m: Measurements) -> Array:
    """Tilt of the torso to the left in radians."""
    up = m.axis("torso", 2)
    return np.arctan2(up[:, 1], up[:, 2])


def _on_straight_legs(m: Measurements) -> Array:
    return ramp(m.pelvis_height, 0.55, 0.75) * np.minimum(m.foot_down("right"), m.foot_down("left"))


add(
    "bow",
    "trunk",
    "bow | bow forward | take a bow | bend the upper body forward | bend forward | lean the torso forward |"
    "make a bow | tilt the upper body forward",
    lambda m: ramp(_pitch(m), degrees(8), degrees(55)) * _on_straight_legs(m),
)
add(
    "bow_deep",
    "trunk",
    "bow deeply | bow at a right angle | bend forward until the back is level | make a deep bow | bend down deeply |"
    "bow at right angle"
    " | bend over | bend over at the waist | a very deep bow | bend far forward",
    lambda m: ramp(_pitch(m), degrees(15), degrees(85)) * _on_straight_legs(m),
)
add(
    "lean_back",
    "trunk",
    "lean back | lean backward | bend the upper body backward | tilt the torso back | arch the back",
    lambda m: ramp(_pitch(m), degrees(-2), degrees(-28)) * _on_straight_legs(m),
)
add_sided(
    "lean_side",
    "trunk",
    "lean to the {side} | bend the upper body to the {side} | tilt the torso to the {side} | side stretch to the {side} |"
    "bend sideways to the {side}",
    lambda m, side, other: ramp(_roll(m) * (1 if side == "left" else -1), degrees(5), degrees(30)) * m.standing,
)


def _yaw(m: Measurements, body: str) -> Array:
    """How far a body is turned to the left of the pelvis, in radians."""
    ahead = m.axis(body, 0)
    return np.arctan2(ahead[:, 1], ahead[:, 0])


add_sided(
    "twist",
    "trunk",
    "twist the torso to the {side} | turn the upper body to the {side} | rotate the upper body to the {side} |"
    "twist to the {side}",
    lambda m, side, other: ramp(_yaw(m, "torso") * (1 if side == "left" else -1), degrees(8), degrees(45)) * m.on_feet,
)
add_sided(
    "look_side",
    "trunk",
    "look to the {side} | turn the head to the {side} | look {side} | face {side} with the head",
    lambda m, side, other: ramp(_yaw(m, "head") * (1 if side == "left" else -1), degrees(10), degrees(55)) * m.on_feet,
)


def _gaze(m: Measurements) -> Array:
    """How far the head looks up, in radians."""
    return np.arcsin(np.clip(m.axis("head", 0)[:, 2], -1, 1))


add(
    "look_up",
    "trunk",
    "look up | raise the head | tilt the head back | look at the sky",
    lambda m: ramp(_gaze(m), degrees(5), degrees(35)) * m.on_feet,
)
add(
    "look_down",
    "trunk",
    "look down | lower the head | look at the floor | nod the head down",
    lambda m: ramp(_gaze(m), degrees(-8), degrees(-40)) * m.on_feet,
)
add(
    "touch_floor",
    "whole",
    "touch the floor with both hands | hands touching the ground | bend down and touch the toes | reach for the toes |"
    "touch the feet with both hands | bend down to the ground | reach down to the floor",
    lambda m: partly(*(ramp(m.height(f"{side}_hand"), 0.75, 0.15) for side in SIDES)) * ramp(m.pelvis_height, 0.3, 0.5),
)
add(
    "pick_up",
    "whole",
    "pick something up from the floor | bend down and pick up an object | reach down to the floor with one hand",
    lambda m: (
        ramp(np.minimum(m.height("right_hand"), m.height("left_hand")), 0.75, 0.15) * ramp(m.pelvis_height, 0.3, 0.5)
    ),
)
