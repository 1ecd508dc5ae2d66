"""What sentences mean: each concept has phrases and a rule that says how far a short motion fulfils it, from 0 to 1.

The rules grade: a hand half-way up is worth more than a hanging one, because these grades become the reward a policy
climbs. They also say no: a fallen body, the other limb, or standing still where the text says moving score low.

"{side}" and "{other}" in a phrase stand for left and right; a concept with them exists for both sides.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from agents.encoder.measurements import SIDES, Array, Measurements, near, partly, ramp

Rule = Callable[[Measurements], Array]
SidedRule = Callable[[Measurements, str, str], Array]


@dataclass(frozen=True)
class Concept:
    """A meaning with its wordings.

    Attributes:
        name: unique name; sided ones end in ".left" or ".right".
        group: "arms", "trunk", "legs", "travel" or "whole": concepts of different groups can be joined by "and".
        phrases: wordings, imperative first.
        rule: how far n short motions fulfil it, `(n,)` from 0 to 1.
    """

    name: str
    group: str
    phrases: tuple[str, ...]
    rule: Rule


CONCEPTS: dict[str, Concept] = {}


def _add(name: str, group: str, phrases: str, rule: Rule) -> None:
    CONCEPTS[name] = Concept(name, group, tuple(phrase.strip() for phrase in phrases.split("|")), rule)


def _add_sided(name: str, group: str, phrases: str, rule: SidedRule) -> None:
    for side, other in (SIDES, SIDES[::-1]):

        def sided(m: Measurements, side: str = side, other: str = other) -> Array:
            return rule(m, side, other)

        _add(f"{name}.{side}", group, phrases.format(side=side, other=other), sided)


def _degrees(angle: float) -> float:
    return float(np.radians(angle))


# ---------------------------------------------------------------------------------------------------------------- arms


def _one_arm(m: Measurements, value: Array, other: str) -> Array:
    """A text about one arm: the other one should not do the same."""
    return value * m.on_feet * (0.4 + 0.6 * m.arm_lowered(other))


_add(
    "arms_up",
    "arms",
    "raise both arms above the head | raise both arms | lift both hands up high | put both hands up | hands up |"
    "raise both hands above the head | lift the arms overhead | hold both arms up | both arms raised high |"
    "raise two arms | put your hands in the air | reach up with both hands | arms above the head | stretch up high |"
    "both hands over the head | throw both arms up in the air | reach for the ceiling | lift something above the head"
    " | raise both arms above the head through the sides | lift the arms sideways over the head | spread and raise both arms |"
    "stretch the whole body upward | stretch | raise the arms | arms up | lift both arms over the head | raise your hands",
    lambda m: partly(m.arm_raised("right"), m.arm_raised("left")) * m.on_feet,
)
_add_sided(
    "arm_up",
    "arms",
    "raise the {side} arm | raise the {side} hand above the head | lift the {side} hand up high | put the {side} hand up |"
    "lift the {side} arm overhead | hold the {side} arm up | {side} hand above the head | reach up with the {side} hand |"
    "raise only the {side} arm | {side} arm raised high | put your {side} hand in the air | stretch the {side} arm upward |"
    "raise the {side} arm and leave the {other} arm down | {side} hand up, {other} hand down",
    lambda m, side, other: _one_arm(m, m.arm_raised(side), other),
)
_add(
    "one_arm_up",
    "arms",
    "raise one arm | put up one hand | lift one hand above the head | one arm raised | hold one arm up",
    lambda m: np.maximum(
        _one_arm(m, m.arm_raised("right"), "left"),
        _one_arm(m, m.arm_raised("left"), "right"),
    ),
)
_add(
    "arms_down",
    "arms",
    "lower both arms | let the arms hang down | arms at the sides | put the hands down | keep both arms down |"
    "hands beside the hips | relax the arms | both arms hanging"
    " | drop the arms | bring both hands down | arms down | lower the hands to the sides",
    lambda m: (
        partly(m.arm_lowered("right"), m.arm_lowered("left"))
        * m.on_feet
        * ramp(np.maximum(m.elbow("right"), m.elbow("left")), _degrees(110), _degrees(50))
    ),
)


def _forward(m: Measurements, side: str) -> Array:
    hand = m.hand_from_shoulder(side)
    return ramp(hand[:, 0], 0.05, 0.45) * near(hand[:, 2], 0.0, 0.5)


def _sideways(m: Measurements, side: str) -> Array:
    hand = m.hand_from_shoulder(side)
    return ramp(hand[:, 1], 0.05, 0.45) * near(hand[:, 2], 0.0, 0.5)


_add(
    "arms_forward",
    "arms",
    "stretch both arms forward | hold both arms out in front | raise both arms forward | reach forward with both hands |"
    "both arms straight ahead | extend both arms to the front | point forward with both hands | arms in front of the body"
    " | hold the arms forward | zombie arms | put both hands out in front",
    lambda m: partly(_forward(m, "right"), _forward(m, "left")) * m.on_feet,
)
_add_sided(
    "arm_forward",
    "arms",
    "stretch the {side} arm forward | point forward with the {side} hand | reach forward with the {side} hand |"
    "hold the {side} arm out in front | point ahead with the {side} arm | extend the {side} arm to the front |"
    "{side} arm straight ahead | raise the {side} arm forward",
    lambda m, side, other: _one_arm(m, _forward(m, side), other),
)
_add(
    "arms_sideways",
    "arms",
    "stretch both arms out to the sides | stand in a T-pose | spread both arms | hold the arms out sideways | T-pose |"
    "spread the arms wide | both arms out at shoulder height | make a T with the arms | extend both arms to the sides"
    " | open both arms wide | hold the arms out like wings | both arms stretched sideways | arms out to the left and right",
    lambda m: partly(_sideways(m, "right"), _sideways(m, "left")) * m.on_feet,
)
_add_sided(
    "arm_sideways",
    "arms",
    "stretch the {side} arm out to the side | raise the {side} arm sideways | point to the {side} with the {side} hand |"
    "hold the {side} arm out to the {side} | {side} arm out at shoulder height | extend the {side} arm to the side |"
    "point {side}",
    lambda m, side, other: _one_arm(m, _sideways(m, side), other),
)
_add_sided(
    "arm_back",
    "arms",
    "put the {side} hand behind the back | move the {side} arm backward | stretch the {side} arm behind |"
    "{side} hand behind the body | reach back with the {side} hand",
    lambda m, side, other: ramp(m.point(f"{side}_hand")[:, 0], 0.0, -0.25) * m.on_feet,
)
_add_sided(
    "elbow_bent",
    "arms",
    "bend the {side} elbow | {side} arm bent at the elbow | flex the {side} arm | bend the {side} arm",
    lambda m, side, other: (
        ramp(m.elbow(side), _degrees(25), _degrees(100))
        * m.on_feet
        * (1 - 0.5 * ramp(m.elbow(other), _degrees(40), _degrees(100)))
    ),
)
_add(
    "elbows_bent",
    "arms",
    "bend both elbows | both arms bent at the elbows | flex both arms | bend both arms",
    lambda m: partly(*(ramp(m.elbow(side), _degrees(25), _degrees(100)) for side in SIDES)) * m.on_feet,
)
_add(
    "hands_chest",
    "arms",
    "bring the hands together in front of the chest | hold the palms together in front of the chest | pray |"
    "fold the hands in prayer | put both hands together | hands together at the chest | join the hands in front",
    lambda m: (
        partly(
            ramp(m.apart("right_hand", "left_hand"), 0.5, 0.14),
            ramp((m.point("right_hand") + m.point("left_hand"))[:, 0] / 2, 0.1, 0.25),
            near((m.point("right_hand") + m.point("left_hand"))[:, 2] / 2, 0.38, 0.35),
        )
        * m.on_feet
    ),
)


def _hand_on_hip(m: Measurements, side: str) -> Array:
    hand = m.point(f"{side}_hand") * np.array([1.0, 1.0 if side == "left" else -1.0, 1.0])
    return ramp(np.linalg.norm(hand - np.array([0.05, 0.19, 0.1]), axis=-1), 0.35, 0.1) * ramp(
        m.elbow(side), _degrees(30), _degrees(70)
    )


_add(
    "hands_on_hips",
    "arms",
    "put the hands on the hips | stand with hands on hips | rest both hands on the hips | hands on the waist |"
    "place both hands on the hips",
    lambda m: partly(_hand_on_hip(m, "right"), _hand_on_hip(m, "left")) * m.on_feet,
)
_add_sided(
    "hand_on_hip",
    "arms",
    "put the {side} hand on the hip | {side} hand on the waist | rest the {side} hand on the hip",
    lambda m, side, other: _hand_on_hip(m, side) * m.on_feet * (1 - 0.5 * _hand_on_hip(m, other)),
)


def _hand_at_head(m: Measurements, side: str) -> Array:
    gap = np.linalg.norm(m.point(f"{side}_hand") - m.head_centre, axis=-1)
    return ramp(gap, 0.55, 0.2)


_add(
    "hands_on_head",
    "arms",
    "put both hands on the head | hold the head with both hands | place the hands on top of the head |"
    "touch the head with both hands | hands on the head",
    lambda m: partly(_hand_at_head(m, "right"), _hand_at_head(m, "left")) * m.on_feet,
)
_add_sided(
    "hand_at_head",
    "arms",
    "raise the {side} hand to the forehead | salute with the {side} hand | touch the head with the {side} hand |"
    "give a military salute with the {side} hand | scratch the head with the {side} hand | {side} hand at the face |"
    "drink from a cup with the {side} hand | lift a glass to the mouth with the {side} hand",
    lambda m, side, other: _one_arm(m, _hand_at_head(m, side), other),
)
_add(
    "salute",
    "arms",
    "salute | give a military salute | drink | touch the face with one hand | scratch the head",
    lambda m: np.maximum(
        _one_arm(m, _hand_at_head(m, "right"), "left"), _one_arm(m, _hand_at_head(m, "left"), "right")
    ),
)
_add(
    "arms_crossed",
    "arms",
    "cross the arms | stand with crossed arms | fold the arms in front of the chest | fold one arm over the other |"
    "arms crossed over the chest | stand with arms folded",
    lambda m: (
        partly(
            ramp((m.point("right_hand") - m.point("left_hand"))[:, 1], -0.3, 0.12),
            near((m.point("right_hand") + m.point("left_hand"))[:, 2] / 2, 0.36, 0.3),
            ramp((m.point("right_hand") + m.point("left_hand"))[:, 0] / 2, 0.05, 0.2),
        )
        * m.on_feet
    ),
)


def _waving(m: Measurements, side: str) -> Array:
    raised = ramp(m.hand_from_shoulder(side)[:, 2], -0.4, 0.1)
    moving = ramp(m.speed(f"{side}_hand"), 0.3, 1.3)
    return raised * (0.2 + 0.8 * moving) * ramp(m.pelvis_height, 0.3, 0.6)


_add_sided(
    "wave",
    "arms",
    "wave the {side} hand | wave with the {side} hand | wave hello with the {side} arm | wave with the {side} arm |"
    "say hello by waving the {side} hand | wave goodbye with the {side} hand | swing the raised {side} hand to and fro |"
    "greet someone with the {side} hand | wave the {side} arm | raise the {side} hand and wave it | {side} hand waving",
    lambda m, side, other: _one_arm(m, _waving(m, side), other),
)
_add(
    "wave_any",
    "arms",
    "wave | wave hello | wave goodbye | wave with one hand | say hi with a wave | greet someone by waving",
    lambda m: np.maximum(_waving(m, "right"), _waving(m, "left")) * m.on_feet,
)
_add(
    "wave_both",
    "arms",
    "wave both hands | wave with both arms | wave both hands above the head | wave goodbye with both hands |"
    "wave hands up and down | wave both arms in the air",
    lambda m: partly(_waving(m, "right"), _waving(m, "left")) * m.on_feet,
)


def _punching(m: Measurements, side: str) -> Array:
    speed = m.velocity(f"{side}_hand")[:, 0]
    return _forward(m, side) * (0.25 + 0.75 * ramp(speed, 0.3, 2.5)) * m.standing


_add_sided(
    "punch",
    "arms",
    "punch with the {side} hand | punch forward with the {side} fist | throw a {side} punch | hit with the {side} hand |"
    "jab with the {side} hand | strike forward with the {side} fist | {side} punch",
    lambda m, side, other: _punching(m, side),
)
_add(
    "punch_any",
    "arms",
    "punch | box | throw punches | punch with both hands in turn | throw punches left and right | shadow boxing |"
    "strike with the fists | hit the pillar",
    lambda m: np.maximum(_punching(m, "right"), _punching(m, "left")),
)
_add(
    "push",
    "arms",
    "push forward with both hands | push something away | push with both arms | shove forward",
    lambda m: (
        partly(*(_forward(m, side) for side in SIDES))
        * (0.4 + 0.6 * partly(*(ramp(m.velocity(f"{side}_hand")[:, 0], 0.2, 1.5) for side in SIDES)))
        * m.standing
    ),
)
_add(
    "clap",
    "arms",
    "clap | clap the hands | clap both hands together in front of the chest | applaud | clap in front of the body",
    lambda m: (
        ramp(m.apart("right_hand", "left_hand"), 0.8, 0.3)
        * ramp((m.point("right_hand") + m.point("left_hand"))[:, 0] / 2, 0.05, 0.2)
        * ramp((m.point("right_hand") + m.point("left_hand"))[:, 2] / 2, 0.05, 0.25)
        * (0.25 + 0.75 * partly(*(ramp(m.speed(f"{side}_hand"), 0.2, 0.9) for side in SIDES)))
        * m.on_feet
    ),
)
_add(
    "arms_swing",
    "arms",
    "swing both arms | circle both arms | rotate the arms | swing the arms in big circles | move both arms quickly |"
    "make big circles in the air with both hands | flap the arms | wave the arms around",
    lambda m: partly(*(ramp(m.speed(f"{side}_hand"), 0.4, 2.2) for side in SIDES)) * m.on_feet,
)
_add(
    "arms_still",
    "arms",
    "keep the arms still | do not move the hands | hold the arms still",
    lambda m: partly(*(ramp(m.speed(f"{side}_hand"), 0.8, 0.1) for side in SIDES)) * m.on_feet,
)

# --------------------------------------------------------------------------------------------------------------- trunk


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


_add(
    "bow",
    "trunk",
    "bow | bow forward | take a bow | bend the upper body forward | bend forward | lean the torso forward |"
    "make a bow | tilt the upper body forward",
    lambda m: ramp(_pitch(m), _degrees(8), _degrees(55)) * _on_straight_legs(m),
)
_add(
    "bow_deep",
    "trunk",
    "bow deeply | bow at a right angle | bend forward until the back is level | make a deep bow | bend down deeply |"
    "bow at right angle"
    " | bend over | bend over at the waist | a very deep bow | bend far forward",
    lambda m: ramp(_pitch(m), _degrees(15), _degrees(85)) * _on_straight_legs(m),
)
_add(
    "lean_back",
    "trunk",
    "lean back | lean backward | bend the upper body backward | tilt the torso back | arch the back",
    lambda m: ramp(_pitch(m), _degrees(-2), _degrees(-28)) * _on_straight_legs(m),
)
_add_sided(
    "lean_side",
    "trunk",
    "lean to the {side} | bend the upper body to the {side} | tilt the torso to the {side} | side stretch to the {side} |"
    "bend sideways to the {side}",
    lambda m, side, other: ramp(_roll(m) * (1 if side == "left" else -1), _degrees(5), _degrees(30)) * m.standing,
)


def _yaw(m: Measurements, body: str) -> Array:
    """How far a body is turned to the left of the pelvis, in radians."""
    ahead = m.axis(body, 0)
    return np.arctan2(ahead[:, 1], ahead[:, 0])


_add_sided(
    "twist",
    "trunk",
    "twist the torso to the {side} | turn the upper body to the {side} | rotate the upper body to the {side} |"
    "twist to the {side}",
    lambda m, side, other: (
        ramp(_yaw(m, "torso") * (1 if side == "left" else -1), _degrees(8), _degrees(45)) * m.on_feet
    ),
)
_add_sided(
    "look_side",
    "trunk",
    "look to the {side} | turn the head to the {side} | look {side} | face {side} with the head",
    lambda m, side, other: (
        ramp(_yaw(m, "head") * (1 if side == "left" else -1), _degrees(10), _degrees(55)) * m.on_feet
    ),
)


def _gaze(m: Measurements) -> Array:
    """How far the head looks up, in radians."""
    return np.arcsin(np.clip(m.axis("head", 0)[:, 2], -1, 1))


_add(
    "look_up",
    "trunk",
    "look up | raise the head | tilt the head back | look at the sky",
    lambda m: ramp(_gaze(m), _degrees(5), _degrees(35)) * m.on_feet,
)
_add(
    "look_down",
    "trunk",
    "look down | lower the head | look at the floor | nod the head down",
    lambda m: ramp(_gaze(m), _degrees(-8), _degrees(-40)) * m.on_feet,
)
_add(
    "touch_floor",
    "whole",
    "touch the floor with both hands | hands touching the ground | bend down and touch the toes | reach for the toes |"
    "touch the feet with both hands | bend down to the ground | reach down to the floor",
    lambda m: partly(*(ramp(m.height(f"{side}_hand"), 0.75, 0.15) for side in SIDES)) * ramp(m.pelvis_height, 0.3, 0.5),
)
_add(
    "pick_up",
    "whole",
    "pick something up from the floor | bend down and pick up an object | reach down to the floor with one hand",
    lambda m: (
        ramp(np.minimum(m.height("right_hand"), m.height("left_hand")), 0.75, 0.15) * ramp(m.pelvis_height, 0.3, 0.5)
    ),
)

# ---------------------------------------------------------------------------------------------------------------- legs


def _squatting(m: Measurements, depth: Array) -> Array:
    knees = partly(*(ramp(m.knee(side), _degrees(10), _degrees(90)) for side in SIDES))
    feet = np.minimum(m.foot_down("right"), m.foot_down("left"))
    knees_up = np.minimum(*(ramp(m.height(f"{side}_shin"), 0.12, 0.28) for side in SIDES))
    seat_up = ramp(m.pelvis_height, 0.14, 0.3)
    return (0.6 * depth + 0.4 * knees) * feet * knees_up * seat_up * m.on_feet


_add(
    "squat",
    "legs",
    "squat down | squat | do a squat | bend the knees deeply | squat low | crouch down | go down into a squat |"
    "do a deep knee bend | get down in a squat | lower the body by bending the knees | squat as low as you can |"
    "hold a squat | stay in a squat | crouch low to the ground | squat down and stay low | lower the hips and bend both"
    " knees | sit down in the air | a deep squat | do squats | squatting low",
    lambda m: _squatting(m, ramp(m.pelvis_height, 0.87, 0.5)),
)
_add(
    "half_squat",
    "legs",
    "bend the knees a little | half squat | crouch slightly | bend both knees slightly | lower the hips a bit |"
    "stand with bent knees",
    lambda m: _squatting(m, near(m.pelvis_height, 0.72, 0.16)),
)


def _kneeling(m: Measurements, side: str) -> Array:
    return ramp(m.height(f"{side}_shin"), 0.3, 0.1)


_add(
    "kneel_both",
    "legs",
    "kneel | kneel down | kneel on both knees | go down on both knees | kneeling | kneel on the floor",
    lambda m: (
        partly(*(_kneeling(m, side) for side in SIDES))
        * ramp(m.uprightness, 0.4, 0.8)
        * ramp(m.pelvis_height, 0.15, 0.3)
    ),
)
_add_sided(
    "kneel",
    "legs",
    "kneel on the {side} knee | kneel down on the {side} knee | go down on the {side} knee | {side} knee on the floor |"
    "genuflect on the {side} knee",
    lambda m, side, other: (
        _kneeling(m, side)
        * ramp(m.height(f"{other}_shin"), 0.15, 0.35)
        * ramp(m.uprightness, 0.4, 0.8)
        * ramp(m.pelvis_height, 0.15, 0.3)
    ),
)
_add(
    "kneel_one",
    "legs",
    "go down on one knee | kneel on one knee | propose on one knee",
    lambda m: (
        np.maximum(_kneeling(m, "right"), _kneeling(m, "left"))
        * ramp(m.uprightness, 0.4, 0.8)
        * ramp(m.pelvis_height, 0.15, 0.3)
        * ramp(np.maximum(m.height("right_shin"), m.height("left_shin")), 0.12, 0.3)
    ),
)
_add(
    "sit",
    "legs",
    "sit down | sit on the floor | sit down on the ground | sit | be seated on the floor | sit with the legs folded",
    lambda m: ramp(m.pelvis_height, 0.6, 0.14) * ramp(m.uprightness, 0.3, 0.8),
)


def _knee_raised(m: Measurements, side: str, other: str) -> Array:
    lifted = ramp(m.point(f"{side}_shin")[:, 2], -0.38, 0.0)
    return lifted * ramp(m.knee(side), _degrees(15), _degrees(80)) * m.foot_down(other) * m.standing


_add_sided(
    "knee_up",
    "legs",
    "raise the {side} knee | lift the {side} knee up | bring the {side} knee up to the waist |"
    "lift the {side} leg with a bent knee | pull the {side} knee up | {side} knee raised high",
    _knee_raised,
)


def _kicking(m: Measurements, side: str, other: str) -> Array:
    foot = m.foot_from_pelvis(side)
    fast = ramp(np.linalg.norm(m.velocity(f"{side}_foot"), axis=-1), 0.4, 2.5)
    high = ramp(m.height(f"{side}_foot"), 0.1, 0.6)
    ahead = ramp(foot[:, 0], 0.0, 0.55)
    support = ramp(m.height(f"{other}_foot"), 0.35, 0.15) * ramp(m.pelvis_height, 0.5, 0.7)
    return high * (0.2 + 0.45 * ahead + 0.35 * fast) * support * ramp(m.uprightness, 0.0, 0.5)


_add_sided(
    "kick",
    "legs",
    "kick with the {side} leg | kick forward with the {side} leg | kick with the {side} foot | {side} kick |"
    "{side} leg kick | do a {side} front kick | give a kick with the {side} foot |"
    "swing the {side} leg forward and up | raise the {side} leg and kick it forward | kick out with the {side} leg |"
    "lift the {side} foot and kick | kick the {side} foot up | a kick of the {side} leg | kick a ball with the {side} foot",
    _kicking,
)
_add(
    "kick_any",
    "legs",
    "kick | kick forward | raise one leg and kick it forward | a martial arts kick | give a kick | kick the door",
    lambda m: np.maximum(_kicking(m, "right", "left"), _kicking(m, "left", "right")),
)
_add_sided(
    "leg_forward",
    "legs",
    "raise the {side} leg forward | hold the {side} leg out in front | lift the straight {side} leg forward |"
    "stretch the {side} leg forward in the air"
    " | {side} leg out in front | extend the {side} leg forward | hold the {side} leg up in front",
    lambda m, side, other: (
        ramp(m.height(f"{side}_foot"), 0.1, 0.6)
        * ramp(m.foot_from_pelvis(side)[:, 0], 0.05, 0.6)
        * ramp(m.knee(side), _degrees(110), _degrees(30))
        * ramp(m.height(f"{other}_foot"), 0.35, 0.15)
        * ramp(m.pelvis_height, 0.5, 0.7)
        * m.on_feet
    ),
)
_add_sided(
    "leg_side",
    "legs",
    "kick to the side with the {side} leg | raise the {side} leg sideways | side kick with the {side} leg |"
    "swing the {side} leg out to the {side} | lift the {side} leg out to the side",
    lambda m, side, other: (
        ramp(m.height(f"{side}_foot"), 0.09, 0.45)
        * ramp(m.foot_from_pelvis(side)[:, 1], 0.15, 0.55)
        * m.foot_down(other)
        * ramp(m.pelvis_height, 0.5, 0.7)
    ),
)
_add_sided(
    "leg_back",
    "legs",
    "lift the {side} leg backward | stretch the {side} leg out behind | kick backward with the {side} leg |"
    "raise the {side} foot behind the body"
    " | {side} leg behind the body | bend the {side} leg backward | {side} foot up behind",
    lambda m, side, other: (
        ramp(m.height(f"{side}_foot"), 0.1, 0.45)
        * ramp(m.foot_from_pelvis(side)[:, 0], -0.1, -0.45)
        * m.foot_down(other)
        * ramp(m.pelvis_height, 0.5, 0.7)
    ),
)
_add_sided(
    "balance",
    "legs",
    "stand on the {side} leg | balance on the {side} leg | stand on the {side} foot with the {other} foot lifted |"
    "lift the {other} foot off the floor | hop on the {side} leg | {other} leg off the ground",
    lambda m, side, other: ramp(m.height(f"{other}_foot"), 0.09, 0.3) * m.foot_down(side) * m.standing,
)
_add(
    "balance_any",
    "legs",
    "stand on one leg | balance on one leg | lift one foot | one foot off the ground | raise one leg",
    lambda m: (
        ramp(np.abs(m.height("right_foot") - m.height("left_foot")), 0.03, 0.3)
        * np.maximum(m.foot_down("right"), m.foot_down("left"))
        * m.standing
    ),
)


def _feet_gap(m: Measurements) -> Array:
    return m.point("left_foot") - m.point("right_foot")


_add(
    "legs_apart",
    "legs",
    "spread the legs | stand with the legs apart | stand with the feet wide apart | legs wide apart | straddle",
    lambda m: ramp(_feet_gap(m)[:, 1], 0.25, 0.75) * np.minimum(m.foot_down("right"), m.foot_down("left")) * m.on_feet,
)
_add(
    "feet_together",
    "legs",
    "stand with the feet together | close the legs | put the feet together",
    lambda m: ramp(np.linalg.norm(_feet_gap(m)[:, :2], axis=-1), 0.45, 0.14) * m.standing,
)
_add_sided(
    "lunge",
    "legs",
    "lunge forward with the {side} leg | do a forward lunge on the {side} | take a big step forward with the {side} leg"
    " and bend the knee | {side} leg forward, {other} leg back | put the {side} foot far forward",
    lambda m, side, other: (
        ramp(_feet_gap(m)[:, 0] * (1 if side == "left" else -1), 0.15, 0.7)
        * (0.4 + 0.6 * ramp(m.knee(side), _degrees(15), _degrees(75)))
        * np.minimum(m.foot_down("right"), m.foot_down("left"))
        * m.on_feet
    ),
)
_add_sided(
    "side_lunge",
    "legs",
    "lunge to the {side} side | do a side lunge to the {side} | step wide to the {side} and bend the {side} knee",
    lambda m, side, other: (
        ramp(_feet_gap(m)[:, 1], 0.3, 0.8)
        * ramp(m.knee(side) - m.knee(other), _degrees(5), _degrees(55))
        * np.minimum(m.foot_down("right"), m.foot_down("left"))
        * m.on_feet
    ),
)
_add(
    "tiptoe",
    "legs",
    "stand on the toes | rise on tiptoe | stand on tiptoe | lift the heels | walk on the toes",
    lambda m: (
        ramp(np.minimum(m.height("right_foot"), m.height("left_foot")), 0.085, 0.13)
        * ramp(np.maximum(m.height("right_foot"), m.height("left_foot")), 0.24, 0.17)
        * ramp(m.pelvis_height, 0.75, 0.9)
        * m.standing
    ),
)
_add(
    "jump",
    "legs",
    "jump | jump up | leap | jump high | jump into the air | hop up | both feet off the ground | jump with both feet",
    lambda m: (
        ramp(np.minimum(m.height("right_foot"), m.height("left_foot")), 0.1, 0.3)
        * ramp(m.pelvis_height, 0.6, 0.85)
        * ramp(m.uprightness, 0.2, 0.6)
    ),
)
_add(
    "legs_straight",
    "legs",
    "stand upright | stand up | stand tall | stand straight | stand on both feet | get up and stand | stand on both legs",
    lambda m: (
        ramp(m.pelvis_height, 0.5, 0.87)
        * ramp(m.uprightness, 0.5, 0.93)
        * np.minimum(m.foot_down("right"), m.foot_down("left"))
    ),
)

# -------------------------------------------------------------------------------------------------------------- travel


def _stepping(m: Measurements) -> Array:
    """1 if a foot moves as in walking."""
    return ramp(np.maximum(m.speed("right_foot"), m.speed("left_foot")), 0.25, 1.1)


_add(
    "walk",
    "travel",
    "walk forward | walk | take a walk | walk straight ahead | walk ahead | stroll forward | go forward | move forward |"
    "keep walking | march forward | step forward | walking ahead | take steps forward | walk in a straight line",
    lambda m: (
        ramp(m.travel[:, 0], 0.05, 0.9)
        * (0.4 + 0.6 * _stepping(m))
        * (1 - 0.6 * ramp(m.travel[:, 0], 1.9, 2.8))
        * (1 - 0.5 * ramp(np.abs(m.travel[:, 1]), 0.3, 0.9))
        * m.standing
    ),
)
_add(
    "walk_slowly",
    "travel",
    "walk slowly | walk forward slowly | take a slow walk | make a few slow steps forward | stroll slowly",
    lambda m: near(m.travel[:, 0], 0.45, 0.42) * (0.4 + 0.6 * _stepping(m)) * m.standing,
)
_add(
    "run",
    "travel",
    "run | run forward | jog ahead | run fast | sprint | jog | run straight ahead | dash forward",
    lambda m: ramp(m.travel[:, 0], 0.5, 2.6) * (0.3 + 0.7 * _stepping(m)) * ramp(m.pelvis_height, 0.5, 0.7) * m.on_feet,
)
_add(
    "walk_back",
    "travel",
    "walk backward | step backward | take steps backward | move back | walk backward slowly | go back | back away",
    lambda m: ramp(m.travel[:, 0], -0.04, -0.5) * (0.4 + 0.6 * _stepping(m)) * m.standing,
)
_add_sided(
    "walk_side",
    "travel",
    "step to the {side} | take steps to the {side} | side step to the {side} | move sideways to the {side} |"
    "walk sideways to the {side} | move to the {side}",
    lambda m, side, other: (
        ramp(m.travel[:, 1] * (1 if side == "left" else -1), 0.04, 0.4)
        * (1 - 0.5 * ramp(np.abs(m.travel[:, 0]), 0.3, 0.9))
        * m.standing
    ),
)
_add_sided(
    "turn",
    "travel",
    "turn {side} | turn around to the {side} | turn to the {side} in place | turn {side} with small steps |"
    "rotate to the {side} | spin {side}",
    lambda m, side, other: ramp(m.turning * (1 if side == "left" else -1), 0.2, 1.6) * m.standing,
)
_add(
    "turn_any",
    "travel",
    "turn around | spin around | turn in a circle | rotate on the spot",
    lambda m: ramp(np.abs(m.turning), 0.3, 2.2) * m.standing,
)
_add(
    "march",
    "travel",
    "march in place | march on the spot | lift the knees in turn | walk on the spot | run in place | step in place"
    " | jog in place | jog on the spot | run on the spot | high knees",
    lambda m: (
        np.maximum(_knee_raised(m, "right", "left"), _knee_raised(m, "left", "right")) ** 0.5
        * (0.3 + 0.7 * _stepping(m))
        * ramp(np.linalg.norm(m.travel[:, :2], axis=-1), 0.8, 0.25)
        * m.standing
    ),
)
_add(
    "stand_still",
    "whole",
    "stand still | stand and do nothing | stand idle | wait while standing | stand with the arms at the sides | stay |"
    "stand calmly | stop moving | stand around | do not move"
    " | stand relaxed | stand quietly with the arms hanging | just stand there | be at rest | freeze",
    lambda m: (
        m.standing
        * m.steady
        * ramp(m.pelvis_height, 0.7, 0.88)
        * ramp(m.liveliness, 1.0, 0.15)
        * (0.3 + 0.7 * partly(m.arm_lowered("right"), m.arm_lowered("left")))
    ),
)
_add(
    "lively",
    "whole",
    "dance | dance with arms | dance with swinging arms | a lively dance | move around wildly | dance around",
    lambda m: (
        partly(*(ramp(m.speed(f"{side}_{part}"), 0.2, 1.6) for side in SIDES for part in ("hand", "foot"))) * m.standing
    ),
)

# --------------------------------------------------------------------------------------------------------------- whole


def _low(m: Measurements) -> Array:
    return ramp(m.height("torso"), 0.5, 0.25) * ramp(m.head_height, 0.6, 0.3)


_add(
    "lie",
    "whole",
    "lie down | lie on the floor | fall down | lie on the ground | drop to the floor | collapse | be fallen over",
    _low,
)
_add(
    "lie_back",
    "whole",
    "lie on the back | lie face up | fall on the back | rest on the back",
    lambda m: _low(m) * ramp(m.axis("torso", 0)[:, 2], 0.2, 0.8),
)
_add(
    "lie_front",
    "whole",
    "lie on the belly | lie face down | fall on the stomach | lie prone",
    lambda m: _low(m) * ramp(m.axis("torso", 0)[:, 2], -0.2, -0.8),
)
_add_sided(
    "lie_side",
    "whole",
    "lie on the {side} side | fall onto the {side} side | rest on the {side} side",
    lambda m, side, other: _low(m) * ramp(m.axis("torso", 1)[:, 2] * (-1 if side == "left" else 1), 0.2, 0.8),
)


def _on_all_fours(m: Measurements) -> Array:
    hands = partly(*(ramp(m.height(f"{side}_hand"), 0.5, 0.15) for side in SIDES))
    knees = partly(*(ramp(m.height(f"{side}_shin"), 0.4, 0.12) for side in SIDES))
    prone = ramp(m.axis("torso", 0)[:, 2], 0.0, -0.6)
    return partly(hands, knees) * prone * ramp(m.pelvis_height, 0.18, 0.32) * ramp(m.height("torso"), 0.2, 0.35)


_add(
    "all_fours",
    "whole",
    "be on hands and knees | go down on all fours | kneel on hands and knees | stay on all fours",
    _on_all_fours,
)
_add(
    "crawl",
    "whole",
    "crawl | crawl forward | crawl forward on hands and knees | crawl on the floor | creep ahead on all fours",
    lambda m: _on_all_fours(m) * (0.4 + 0.6 * ramp(m.travel[:, 0], 0.0, 0.4)),
)
_add(
    "upside_down",
    "whole",
    "do a handstand | turn a cartwheel | cartwheel | flip over | be upside down | backflip | a somersault"
    " | flip backward in the air | do a backflip | stand on the hands | head down, feet up",
    lambda m: ramp(m.uprightness, 0.1, -0.7) * ramp(m.pelvis_height, 0.4, 0.7),
)
