"""Concepts about the arms and hands."""

from __future__ import annotations

import numpy as np

from agents.encoder.concepts.base import add, add_sided, degrees
from agents.encoder.measurements import SIDES, Array, Measurements, near, partly, ramp


def _one_arm(m: Measurements, value: Array, other: str) -> Array:
    """A text about one arm: the other one should not do the same."""
    return value * m.on_feet * (0.4 + 0.6 * m.arm_lowered(other))


add(
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
add_sided(
    "arm_up",
    "arms",
    "raise the {side} arm | raise the {side} hand above the head | lift the {side} hand up high | put the {side} hand up |"
    "lift the {side} arm overhead | hold the {side} arm up | {side} hand above the head | reach up with the {side} hand |"
    "raise only the {side} arm | {side} arm raised high | put your {side} hand in the air | stretch the {side} arm upward |"
    "raise the {side} arm and leave the {other} arm down | {side} hand up, {other} hand down",
    lambda m, side, other: _one_arm(m, m.arm_raised(side), other),
)
add(
    "one_arm_up",
    "arms",
    "raise one arm | put up one hand | lift one hand above the head | one arm raised | hold one arm up",
    lambda m: np.maximum(
        _one_arm(m, m.arm_raised("right"), "left"),
        _one_arm(m, m.arm_raised("left"), "right"),
    ),
)
add(
    "arms_down",
    "arms",
    "lower both arms | let the arms hang down | arms at the sides | put the hands down | keep both arms down |"
    "hands beside the hips | relax the arms | both arms hanging"
    " | drop the arms | bring both hands down | arms down | lower the hands to the sides",
    lambda m: (
        partly(m.arm_lowered("right"), m.arm_lowered("left"))
        * m.on_feet
        * ramp(np.maximum(m.elbow("right"), m.elbow("left")), degrees(110), degrees(50))
    ),
)


def _forward(m: Measurements, side: str) -> Array:
    hand = m.hand_from_shoulder(side)
    return ramp(hand[:, 0], 0.05, 0.45) * near(hand[:, 2], 0.0, 0.5)


def _sideways(m: Measurements, side: str) -> Array:
    hand = m.hand_from_shoulder(side)
    return ramp(hand[:, 1], 0.05, 0.45) * near(hand[:, 2], 0.0, 0.5)


add(
    "arms_forward",
    "arms",
    "stretch both arms forward | hold both arms out in front | raise both arms forward | reach forward with both hands |"
    "both arms straight ahead | extend both arms to the front | point forward with both hands | arms in front of the body"
    " | hold the arms forward | zombie arms | put both hands out in front",
    lambda m: partly(_forward(m, "right"), _forward(m, "left")) * m.on_feet,
)
add_sided(
    "arm_forward",
    "arms",
    "stretch the {side} arm forward | point forward with the {side} hand | reach forward with the {side} hand |"
    "hold the {side} arm out in front | point ahead with the {side} arm | extend the {side} arm to the front |"
    "{side} arm straight ahead | raise the {side} arm forward",
    lambda m, side, other: _one_arm(m, _forward(m, side), other),
)
add(
    "arms_sideways",
    "arms",
    "stretch both arms out to the sides | stand in a T-pose | spread both arms | hold the arms out sideways | T-pose |"
    "spread the arms wide | both arms out at shoulder height | make a T with the arms | extend both arms to the sides"
    " | open both arms wide | hold the arms out like wings | both arms stretched sideways | arms out to the left and right",
    lambda m: partly(_sideways(m, "right"), _sideways(m, "left")) * m.on_feet,
)
add_sided(
    "arm_sideways",
    "arms",
    "stretch the {side} arm out to the side | raise the {side} arm sideways | point to the {side} with the {side} hand |"
    "hold the {side} arm out to the {side} | {side} arm out at shoulder height | extend the {side} arm to the side |"
    "point {side}",
    lambda m, side, other: _one_arm(m, _sideways(m, side), other),
)
add_sided(
    "arm_back",
    "arms",
    "put the {side} hand behind the back | move the {side} arm backward | stretch the {side} arm behind |"
    "{side} hand behind the body | reach back with the {side} hand",
    lambda m, side, other: ramp(m.point(f"{side}_hand")[:, 0], 0.0, -0.25) * m.on_feet,
)
add_sided(
    "elbow_bent",
    "arms",
    "bend the {side} elbow | {side} arm bent at the elbow | flex the {side} arm | bend the {side} arm",
    lambda m, side, other: (
        ramp(m.elbow(side), degrees(25), degrees(100))
        * m.on_feet
        * (1 - 0.5 * ramp(m.elbow(other), degrees(40), degrees(100)))
    ),
)
add(
    "elbows_bent",
    "arms",
    "bend both elbows | both arms bent at the elbows | flex both arms | bend both arms",
    lambda m: partly(*(ramp(m.elbow(side), degrees(25), degrees(100)) for side in SIDES)) * m.on_feet,
)
add(
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
        m.elbow(side), degrees(30), degrees(70)
    )


add(
    "hands_on_hips",
    "arms",
    "put the hands on the hips | stand with hands on hips | rest both hands on the hips | hands on the waist |"
    "place both hands on the hips",
    lambda m: partly(_hand_on_hip(m, "right"), _hand_on_hip(m, "left")) * m.on_feet,
)
add_sided(
    "hand_on_hip",
    "arms",
    "put the {side} hand on the hip | {side} hand on the waist | rest the {side} hand on the hip",
    lambda m, side, other: _hand_on_hip(m, side) * m.on_feet * (1 - 0.5 * _hand_on_hip(m, other)),
)


def _hand_at_head(m: Measurements, side: str) -> Array:
    gap = np.linalg.norm(m.point(f"{side}_hand") - m.head_centre, axis=-1)
    return ramp(gap, 0.55, 0.2)


add(
    "hands_on_head",
    "arms",
    "put both hands on the head | hold the head with both hands | place the hands on top of the head |"
    "touch the head with both hands | hands on the head",
    lambda m: partly(_hand_at_head(m, "right"), _hand_at_head(m, "left")) * m.on_feet,
)
add_sided(
    "hand_at_head",
    "arms",
    "raise the {side} hand to the forehead | salute with the {side} hand | touch the head with the {side} hand |"
    "give a military salute with the {side} hand | scratch the head with the {side} hand | {side} hand at the face |"
    "drink from a cup with the {side} hand | lift a glass to the mouth with the {side} hand",
    lambda m, side, other: _one_arm(m, _hand_at_head(m, side), other),
)
add(
    "salute",
    "arms",
    "salute | give a military salute | drink | touch the face with one hand | scratch the head",
    lambda m: np.maximum(
        _one_arm(m, _hand_at_head(m, "right"), "left"), _one_arm(m, _hand_at_head(m, "left"), "right")
    ),
)
add(
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


add_sided(
    "wave",
    "arms",
    "wave the {side} hand | wave with the {side} hand | wave hello with the {side} arm | wave with the {side} arm |"
    "say hello by waving the {side} hand | wave goodbye with the {side} hand | swing the raised {side} hand to and fro |"
    "greet someone with the {side} hand | wave the {side} arm | raise the {side} hand and wave it | {side} hand waving",
    lambda m, side, other: _one_arm(m, _waving(m, side), other),
)
add(
    "wave_any",
    "arms",
    "wave | wave hello | wave goodbye | wave with one hand | say hi with a wave | greet someone by waving",
    lambda m: np.maximum(_waving(m, "right"), _waving(m, "left")) * m.on_feet,
)
add(
    "wave_both",
    "arms",
    "wave both hands | wave with both arms | wave both hands above the head | wave goodbye with both hands |"
    "wave hands up and down | wave both arms in the air",
    lambda m: partly(_waving(m, "right"), _waving(m, "left")) * m.on_feet,
)


def _punching(m: Measurements, side: str) -> Array:
    speed = m.velocity(f"{side}_hand")[:, 0]
    return _forward(m, side) * (0.25 + 0.75 * ramp(speed, 0.3, 2.5)) * m.standing


add_sided(
    "punch",
    "arms",
    "punch with the {side} hand | punch forward with the {side} fist | throw a {side} punch | hit with the {side} hand |"
    "jab with the {side} hand | strike forward with the {side} fist | {side} punch",
    lambda m, side, other: _punching(m, side),
)
add(
    "punch_any",
    "arms",
    "punch | box | throw punches | punch with both hands in turn | throw punches left and right | shadow boxing |"
    "strike with the fists | hit the pillar",
    lambda m: np.maximum(_punching(m, "right"), _punching(m, "left")),
)
add(
    "push",
    "arms",
    "push forward with both hands | push something away | push with both arms | shove forward",
    lambda m: (
        partly(*(_forward(m, side) for side in SIDES))
        * (0.4 + 0.6 * partly(*(ramp(m.velocity(f"{side}_hand")[:, 0], 0.2, 1.5) for side in SIDES)))
        * m.standing
    ),
)
add(
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
add(
    "arms_swing",
    "arms",
    "swing both arms | circle both arms | rotate the arms | swing the arms in big circles | move both arms quickly |"
    "make big circles in the air with both hands | flap the arms | wave the arms around",
    lambda m: partly(*(ramp(m.speed(f"{side}_hand"), 0.4, 2.2) for side in SIDES)) * m.on_feet,
)
add(
    "arms_still",
    "arms",
    "keep the arms still | do not move the hands | hold the arms still",
    lambda m: partly(*(ramp(m.speed(f"{side}_hand"), 0.8, 0.1) for side in SIDES)) * m.on_feet,
)
