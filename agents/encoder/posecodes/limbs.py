"""Posecodes of single limbs: how far joints are bent, and where limbs point."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from agents.encoder.concepts.base import degrees
from agents.encoder.measurements import Array, Measurements, near, ramp
from agents.encoder.posecodes.base import SidedRule, add_limb


def towards(m: Measurements, first: str, second: str, side: str) -> Array:
    """Unit vector from one body's origin to another's `(n, 3)`: forward, outward, up."""
    gap = m.point(second) - m.point(first)
    gap = gap * np.array([1.0, 1.0 if side == "left" else -1.0, 1.0])
    unit: Array = gap / np.maximum(np.linalg.norm(gap, axis=1, keepdims=True), 1e-6)
    return unit


_Measure = Callable[[Measurements, str], Array]


def _from_to(first: str, second: str) -> _Measure:
    return lambda m, side: towards(m, f"{side}_{first}", f"{side}_{second}", side)


def _of(measure: _Measure, grade: Callable[[Array], Array]) -> SidedRule:
    """The rule that grades what is measured on the side."""
    return lambda m, side, other: grade(measure(m, side))


def hip(m: Measurements, side: str) -> Array:
    """Bend of a hip, 0 if the thigh goes on where the trunk ends."""
    thigh = m.point(f"{side}_shin") - m.point(f"{side}_thigh")
    along = (thigh * m.axis("pelvis", 2)).sum(1) / np.maximum(np.linalg.norm(thigh, axis=1), 1e-6)
    return np.arccos(np.clip(-along, -1, 1))


_BENT = "bent | flexed | not straight | crooked | in flexion"
_STRAIGHT = "straight | fully extended | stretched out | not bent | locked out | unbent | long and straight"
_SLIGHTLY = (
    "slightly bent | a little bent | softly flexed | not quite straight | relaxed with a small bend | barely bent"
)
_RIGHT_ANGLE = (
    "bent at a right angle | at ninety degrees | bent to 90 degrees | bent halfway | forming an L | half flexed | "
    "bent at about a right angle"
)
_FULLY = (
    "fully bent | sharply bent | tightly folded | bent as far as it goes | completely flexed | strongly bent | "
    "bent at an acute angle | folded up"
)

for joint, nouns, bend, straighten in (
    ("elbow", "elbow | arm", "bend the {side} elbow | flex the {side} arm", "straighten the {side} elbow"),
    ("knee", "knee | leg", "bend the {side} knee | flex the {side} leg", "straighten the {side} leg"),
):
    _angle = Measurements.elbow if joint == "elbow" else Measurements.knee
    limb = {"elbow": "knee", "knee": "elbow"}[joint]
    add_limb(
        f"{joint}_straight",
        nouns,
        _STRAIGHT,
        _of(_angle, lambda angle: ramp(angle, degrees(38), degrees(16))),
        f"{straighten} | extend the {{side}} {nouns.split(' | ')[1]} fully | "
        f"stretch the {{side}} {nouns.split(' | ')[1]}"
        f" | lock the {{side}} {joint}",
        opposites=f"{joint}_right | {joint}_full | {limb}_straight",
    )
    add_limb(
        f"{joint}_slight",
        nouns,
        _SLIGHTLY,
        _of(_angle, lambda angle: near(angle, degrees(36), degrees(24))),
        f"bend the {{side}} {joint} slightly | keep a small bend in the {{side}} {joint} | "
        f"flex the {{side}} {joint} a bit"
        f" | unlock the {{side}} {joint}",
        opposites=f"{joint}_full | {limb}_slight",
    )
    add_limb(
        f"{joint}_right",
        nouns,
        _RIGHT_ANGLE,
        _of(_angle, lambda angle: near(angle, degrees(88), degrees(38))),
        f"bend the {{side}} {joint} to a right angle | bend the {{side}} {joint} ninety degrees"
        f" | make an L of the {{side}} {nouns.split(' | ')[1]} | bend the {{side}} {nouns.split(' | ')[1]} halfway",
        opposites=f"{joint}_straight | {limb}_right",
    )
    add_limb(
        f"{joint}_full",
        nouns,
        _FULLY,
        _of(_angle, lambda angle: ramp(angle, degrees(95), degrees(128))),
        f"bend the {{side}} {joint} as far as possible | fold the {{side}} {nouns.split(' | ')[1]}"
        f" | bend the {{side}} {joint} sharply | flex the {{side}} {joint} completely",
        opposites=f"{joint}_straight | {limb}_full",
    )
    add_limb(
        f"{joint}_bent",
        nouns,
        _BENT,
        _of(_angle, lambda angle: ramp(angle, degrees(22), degrees(65))),
        f"{bend} | put a bend into the {{side}} {joint}",
        f"there is a bend in the {{side}} {joint} | the {{side}} {joint} makes an angle | the {{side}} {joint} bends",
        opposites=f"{joint}_straight | {limb}_bent",
    )

add_limb(
    "hip_straight",
    "hip",
    f"{_STRAIGHT} | open | in line with the trunk",
    lambda m, side, other: ramp(hip(m, side), degrees(40), degrees(18)),
    "straighten the {side} hip | extend the {side} hip | open the {side} hip",
    "the {side} thigh is in line with the trunk | no bend in the {side} hip",
    "hip_right | hip_full",
)
add_limb(
    "hip_right",
    "hip",
    _RIGHT_ANGLE,
    lambda m, side, other: near(hip(m, side), degrees(85), degrees(38)),
    "bend the {side} hip to a right angle | flex the {side} hip ninety degrees",
    "the {side} thigh stands at a right angle to the trunk | the {side} leg makes a right angle with the body",
    "hip_straight",
)
add_limb(
    "hip_full",
    "hip",
    f"{_FULLY} | deeply flexed",
    lambda m, side, other: ramp(hip(m, side), degrees(95), degrees(125)),
    "bend the {side} hip as far as possible | draw the {side} thigh to the belly | pull the {side} thigh to the trunk",
    "the {side} thigh is pressed against the belly | the {side} thigh is close to the chest",
    "hip_straight",
)
add_limb(
    "hip_bent",
    "hip",
    f"{_BENT} | hinged",
    lambda m, side, other: ramp(hip(m, side), degrees(22), degrees(65)),
    "bend the {side} hip | flex the {side} hip",
    "the {side} thigh is bent towards the trunk",
    "hip_straight | knee_bent",
)

# Where a limb points: names of its bodies, its nouns, and the verb that one would use.
_UP = "pointing up | pointing upward | vertical, upward | pointing to the ceiling | directed at the sky | upright"
_DOWN = "pointing down | hanging down | vertical | pointing at the floor | directed downward | hanging | straight down"
_AHEAD = "pointing forward | pointing ahead | out in front | directed to the front | reaching forward | to the front"
_BACK = "pointing backward | behind | directed to the rear | reaching back | extended behind | pointing to the back"
_OUT = "pointing sideways | out to the side | directed outward | pointing to the {side} | away from the body sideways"
_IN = "pointing inward | pointing across the body | directed at the other side | reaching across | pointing to the {other}"
_LEVEL = "horizontal | level | parallel to the floor | parallel to the ground | flat in the air"

for name, first, second, nouns in (
    ("arm", "upper_arm", "hand", "arm"),
    ("upper_arm", "upper_arm", "lower_arm", "upper arm"),
    ("forearm", "lower_arm", "hand", "forearm | lower arm"),
    ("leg", "thigh", "foot", "leg"),
    ("thigh", "thigh", "shin", "thigh | upper leg"),
    ("shin", "shin", "foot", "shin | lower leg | calf"),
):
    noun = nouns.split(" | ")[0]
    pair = {"arm": "leg", "leg": "arm", "forearm": "shin", "shin": "forearm"}.get(name, "")
    pair = pair or {"upper_arm": "thigh", "thigh": "upper_arm"}[name]
    _direction = _from_to(first, second)
    add_limb(
        f"{name}_up",
        nouns,
        _UP,
        _of(_direction, lambda way: ramp(way[:, 2], 0.5, 0.88)),
        f"point the {{side}} {noun} up | raise the {{side}} {noun} vertically | stretch the {{side}} {noun} upward",
        f"the {{side}} {noun} points at the ceiling | the {{side}} {noun} points up",
        f"{name}_down | {name}_forward | {pair}_up",
    )
    add_limb(
        f"{name}_down",
        nouns,
        _DOWN,
        _of(_direction, lambda way: ramp(way[:, 2], -0.6, -0.92)),
        f"point the {{side}} {noun} down | let the {{side}} {noun} hang | lower the {{side}} {noun}",
        f"the {{side}} {noun} points at the floor | the {{side}} {noun} hangs down | the {{side}} {noun} points down",
        f"{name}_up | {name}_forward | {name}_out",
    )
    add_limb(
        f"{name}_forward",
        nouns,
        _AHEAD,
        _of(_direction, lambda way: ramp(way[:, 0], 0.45, 0.85)),
        f"point the {{side}} {noun} forward | stretch the {{side}} {noun} to the front | "
        f"bring the {{side}} {noun} forward",
        f"the {{side}} {noun} points ahead | the {{side}} {noun} reaches forward",
        f"{name}_back | {name}_out | {name}_down | {pair}_forward",
    )
    add_limb(
        f"{name}_back",
        nouns,
        _BACK,
        _of(_direction, lambda way: ramp(way[:, 0], -0.25, -0.65)),
        f"point the {{side}} {noun} backward | stretch the {{side}} {noun} behind you | swing the {{side}} {noun} back",
        f"the {{side}} {noun} points to the rear | the {{side}} {noun} reaches back",
        f"{name}_forward | {name}_down | {pair}_back",
    )
    add_limb(
        f"{name}_out",
        nouns,
        _OUT,
        _of(_direction, lambda way: ramp(way[:, 1], 0.4, 0.82)),
        f"point the {{side}} {noun} sideways | stretch the {{side}} {noun} out to the side | spread the {{side}} {noun}"
        f" | abduct the {{side}} {noun}",
        f"the {{side}} {noun} points outward | the {{side}} {noun} reaches to the {{side}}",
        f"{name}_in | {name}_forward | {pair}_out",
    )
    add_limb(
        f"{name}_in",
        nouns,
        _IN,
        _of(_direction, lambda way: ramp(way[:, 1], -0.15, -0.55)),
        f"point the {{side}} {noun} inward | bring the {{side}} {noun} across the body"
        f" | cross the {{side}} {noun} over to the {{other}}",
        f"the {{side}} {noun} points inward | the {{side}} {noun} crosses to the {{other}} side",
        f"{name}_out | {pair}_in",
    )
    add_limb(
        f"{name}_level",
        nouns,
        _LEVEL,
        _of(_direction, lambda way: ramp(np.abs(way[:, 2]), 0.5, 0.2)),
        f"hold the {{side}} {noun} level | lift the {{side}} {noun} parallel to the floor | "
        f"keep the {{side}} {noun} horizontal",
        f"the {{side}} {noun} makes a level line",
        f"{name}_down | {name}_up | {pair}_level",
    )
