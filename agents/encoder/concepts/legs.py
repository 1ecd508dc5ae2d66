"""Concepts about the legs and how the body stands on them."""

from __future__ import annotations

import numpy as np

from agents.encoder.concepts.base import add, add_sided, degrees
from agents.encoder.measurements import SIDES, Array, Measurements, near, partly, ramp


def _squatting(m: Measurements, depth: Array) -> Array:
    knees = partly(*(ramp(m.knee(side), degrees(10), degrees(90)) for side in SIDES))
    feet = np.minimum(m.foot_down("right"), m.foot_down("left"))
    knees_up = np.minimum(*(ramp(m.height(f"{side}_shin"), 0.12, 0.28) for side in SIDES))
    seat_up = ramp(m.pelvis_height, 0.14, 0.3)
    return (0.6 * depth + 0.4 * knees) * feet * knees_up * seat_up * m.on_feet


add(
    "squat",
    "legs",
    "squat down | squat | do a squat | bend the knees deeply | squat low | crouch down | go down into a squat |"
    "do a deep knee bend | get down in a squat | lower the body by bending the knees | squat as low as you can |"
    "hold a squat | stay in a squat | crouch low to the ground | squat down and stay low | lower the hips and bend both"
    " knees | sit down in the air | a deep squat | do squats | squatting low",
    lambda m: _squatting(m, ramp(m.pelvis_height, 0.87, 0.5)),
)
add(
    "half_squat",
    "legs",
    "bend the knees a little | half squat | crouch slightly | bend both knees slightly | lower the hips a bit |"
    "stand with bent knees",
    lambda m: _squatting(m, near(m.pelvis_height, 0.72, 0.16)),
)


def _kneeling(m: Measurements, side: str) -> Array:
    return ramp(m.height(f"{side}_shin"), 0.3, 0.1)


add(
    "kneel_both",
    "legs",
    "kneel | kneel down | kneel on both knees | go down on both knees | kneeling | kneel on the floor",
    lambda m: (
        partly(*(_kneeling(m, side) for side in SIDES))
        * ramp(m.uprightness, 0.4, 0.8)
        * ramp(m.pelvis_height, 0.15, 0.3)
    ),
)
add_sided(
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
add(
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
add(
    "sit",
    "legs",
    "sit down | sit on the floor | sit down on the ground | sit | be seated on the floor | sit with the legs folded",
    lambda m: ramp(m.pelvis_height, 0.6, 0.14) * ramp(m.uprightness, 0.3, 0.8),
)


def knee_raised(m: Measurements, side: str, other: str) -> Array:
    """A knee raised towards the waist, the other foot on the floor."""
    lifted = ramp(m.point(f"{side}_shin")[:, 2], -0.38, 0.0)
    return lifted * ramp(m.knee(side), degrees(15), degrees(80)) * m.foot_down(other) * m.standing


add_sided(
    "knee_up",
    "legs",
    "raise the {side} knee | lift the {side} knee up | bring the {side} knee up to the waist |"
    "lift the {side} leg with a bent knee | pull the {side} knee up | {side} knee raised high",
    knee_raised,
)


def _kicking(m: Measurements, side: str, other: str) -> Array:
    foot = m.foot_from_pelvis(side)
    fast = ramp(np.linalg.norm(m.velocity(f"{side}_foot"), axis=-1), 0.4, 2.5)
    high = ramp(m.height(f"{side}_foot"), 0.1, 0.6)
    ahead = ramp(foot[:, 0], 0.0, 0.55)
    support = ramp(m.height(f"{other}_foot"), 0.35, 0.15) * ramp(m.pelvis_height, 0.5, 0.7)
    return high * (0.2 + 0.45 * ahead + 0.35 * fast) * support * ramp(m.uprightness, 0.0, 0.5)


add_sided(
    "kick",
    "legs",
    "kick with the {side} leg | kick forward with the {side} leg | kick with the {side} foot | {side} kick |"
    "{side} leg kick | do a {side} front kick | give a kick with the {side} foot |"
    "swing the {side} leg forward and up | raise the {side} leg and kick it forward | kick out with the {side} leg |"
    "lift the {side} foot and kick | kick the {side} foot up | a kick of the {side} leg | kick a ball with the {side} foot",
    _kicking,
)
add(
    "kick_any",
    "legs",
    "kick | kick forward | raise one leg and kick it forward | a martial arts kick | give a kick | kick the door",
    lambda m: np.maximum(_kicking(m, "right", "left"), _kicking(m, "left", "right")),
)
add_sided(
    "leg_forward",
    "legs",
    "raise the {side} leg forward | hold the {side} leg out in front | lift the straight {side} leg forward |"
    "stretch the {side} leg forward in the air"
    " | {side} leg out in front | extend the {side} leg forward | hold the {side} leg up in front",
    lambda m, side, other: (
        ramp(m.height(f"{side}_foot"), 0.1, 0.6)
        * ramp(m.foot_from_pelvis(side)[:, 0], 0.05, 0.6)
        * ramp(m.knee(side), degrees(110), degrees(30))
        * ramp(m.height(f"{other}_foot"), 0.35, 0.15)
        * ramp(m.pelvis_height, 0.5, 0.7)
        * m.on_feet
    ),
)
add_sided(
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
add_sided(
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
add_sided(
    "balance",
    "legs",
    "stand on the {side} leg | balance on the {side} leg | stand on the {side} foot with the {other} foot lifted |"
    "lift the {other} foot off the floor | hop on the {side} leg | {other} leg off the ground",
    lambda m, side, other: ramp(m.height(f"{other}_foot"), 0.09, 0.3) * m.foot_down(side) * m.standing,
)
add(
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


add(
    "legs_apart",
    "legs",
    "spread the legs | stand with the legs apart | stand with the feet wide apart | legs wide apart | straddle",
    lambda m: ramp(_feet_gap(m)[:, 1], 0.25, 0.75) * np.minimum(m.foot_down("right"), m.foot_down("left")) * m.on_feet,
)
add(
    "feet_together",
    "legs",
    "stand with the feet together | close the legs | put the feet together",
    lambda m: ramp(np.linalg.norm(_feet_gap(m)[:, :2], axis=-1), 0.45, 0.14) * m.standing,
)
add_sided(
    "lunge",
    "legs",
    "lunge forward with the {side} leg | do a forward lunge on the {side} | take a big step forward with the {side} leg"
    " and bend the knee | {side} leg forward, {other} leg back | put the {side} foot far forward",
    lambda m, side, other: (
        ramp(_feet_gap(m)[:, 0] * (1 if side == "left" else -1), 0.15, 0.7)
        * (0.4 + 0.6 * ramp(m.knee(side), degrees(15), degrees(75)))
        * np.minimum(m.foot_down("right"), m.foot_down("left"))
        * m.on_feet
    ),
)
add_sided(
    "side_lunge",
    "legs",
    "lunge to the {side} side | do a side lunge to the {side} | step wide to the {side} and bend the {side} knee",
    lambda m, side, other: (
        ramp(_feet_gap(m)[:, 1], 0.3, 0.8)
        * ramp(m.knee(side) - m.knee(other), degrees(5), degrees(55))
        * np.minimum(m.foot_down("right"), m.foot_down("left"))
        * m.on_feet
    ),
)
add(
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
add(
    "jump",
    "legs",
    "jump | jump up | leap | jump high | jump into the air | hop up | both feet off the ground | jump with both feet",
    lambda m: (
        ramp(np.minimum(m.height("right_foot"), m.height("left_foot")), 0.1, 0.3)
        * ramp(m.pelvis_height, 0.6, 0.85)
        * ramp(m.uprightness, 0.2, 0.6)
    ),
)
add(
    "legs_straight",
    "legs",
    "stand upright | stand up | stand tall | stand straight | stand on both feet | get up and stand | stand on both legs",
    lambda m: (
        ramp(m.pelvis_height, 0.5, 0.87)
        * ramp(m.uprightness, 0.5, 0.93)
        * np.minimum(m.foot_down("right"), m.foot_down("left"))
    ),
)
