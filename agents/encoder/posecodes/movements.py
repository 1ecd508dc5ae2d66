"""Posecodes of movements: where hands, feet and the whole body go, and how fast."""

from __future__ import annotations

import numpy as np

from agents.encoder.measurements import Array, Measurements, ramp
from agents.encoder.posecodes.base import Rule, SidedRule, add_limb, add_sided, add_whole


def _velocity(m: Measurements, side: str, part: str) -> Array:
    """Forward, outward, up, in m/s."""
    moved: Array = m.velocity(f"{side}_{part}") * np.array([1.0, 1.0 if side == "left" else -1.0, 1.0])
    return moved


def _going(part: str, axis: int, sign: float) -> SidedRule:
    return lambda m, side, other: ramp(sign * _velocity(m, side, part)[:, axis], 0.25, 0.9)


def _fast(part: str, start: float, end: float) -> SidedRule:
    return lambda m, side, other: ramp(m.speed(f"{side}_{part}", 5), start, end)


def _travelling(axis: int, sign: float) -> Rule:
    return lambda m: ramp(sign * m.travel[:, axis], 0.15, 0.6)


for part in ("hand", "foot"):
    few = {"hand": "foot", "foot": "hand"}[part]
    noun = {"hand": "hand", "foot": "foot | leg"}[part]

    for stem, states, axis, sign, verbs, opposite in (
        (
            "rising",
            "moving up | rising | going upward | on the way up",
            2,
            1.0,
            "lift | raise | move up with",
            "falling",
        ),
        (
            "falling",
            "moving down | sinking | going downward | coming down",
            2,
            -1.0,
            "lower | bring down | drop",
            "rising",
        ),
        (
            "going_ahead",
            "moving forward | going to the front | swinging forward | travelling ahead",
            0,
            1.0,
            "swing forward with | push ahead with",
            "going_back",
        ),
        (
            "going_back",
            "moving backward | being pulled back | swinging back | going to the rear",
            0,
            -1.0,
            "pull back | swing back with",
            "going_ahead",
        ),
        (
            "going_out",
            "moving outward | going out to the side | swinging to the {side} | moving away from the middle",
            1,
            1.0,
            "move out to the side with | swing to the {side} with",
            "going_in",
        ),
        (
            "going_in",
            "moving inward | coming in to the middle | swinging to the {other} | moving towards the midline",
            1,
            -1.0,
            "swing inward with | move to the {other} with",
            "going_out",
        ),
    ):
        add_limb(
            f"{part}_{stem}",
            noun,
            states,
            _going(part, axis, sign),
            " | ".join(f"{verb} the {{side}} {part}" for verb in verbs.split(" | ")),
            "",
            f"{part}_{opposite} | {few}_{stem}",
            both=axis != 1,
        )
    add_limb(
        f"{part}_fast",
        noun,
        "moving fast | in quick motion | moving quickly | swinging rapidly | in rapid movement",
        _fast(part, 0.5, 1.7),
        f"move the {{side}} {part} fast | swing the {{side}} {part} quickly",
        f"the {{side}} {part} moves quickly | the {{side}} {part} is fast",
        f"{part}_still | {few}_fast",
    )
    add_limb(
        f"{part}_still",
        noun,
        "still | at rest | not moving | held motionless | kept in place",
        _fast(part, 0.35, 0.12),
        f"keep the {{side}} {part} still | do not move the {{side}} {part} | hold the {{side}} {part} motionless",
        f"the {{side}} {part} does not move | the {{side}} {part} stays where it is",
        f"{part}_fast",
    )

for stem, way, axis, sign, opposite in (
    ("ahead", "forward", 0, 1.0, "backward"),
    ("backward", "backward", 0, -1.0, "ahead"),
):
    add_whole(
        f"body_{stem}",
        f"the whole body moving {way} | a movement {way} | steps {way}",
        f"the body moves {way} | the whole body goes {way} | the person travels {way} | the hips move {way}",
        f"move {way} | go {way} | travel {way} | step {way}",
        _travelling(axis, sign),
        f"body_{opposite} | body_still",
    )
add_sided(
    "body_aside",
    "the whole body moving to the {side} | a movement to the {side} | steps to the {side}",
    "the body moves to the {side} | the whole body goes sideways to the {side} | the hips travel to the {side}",
    "move to the {side} | go sideways to the {side} | step to the {side}",
    lambda m, side, other: ramp(m.travel[:, 1] * (1.0 if side == "left" else -1.0), 0.08, 0.4),
    "body_turning",
)
add_sided(
    "body_turning",
    "the whole body turning to the {side} | a turn to the {side} | a rotation to the {side}",
    "the body turns to the {side} | the whole body rotates {side} | the person is turning {side}",
    "turn to the {side} | rotate to the {side} | turn {side}",
    lambda m, side, other: ramp(m.turning * (1.0 if side == "left" else -1.0), 0.3, 1.3),
    "body_aside",
)
add_whole(
    "body_rising",
    "the hips rising | the body going up | an upward movement of the body",
    "the body moves up | the pelvis rises | the hips go up",
    "rise | move the hips up | come up",
    lambda m: ramp(m.travel[:, 2], 0.12, 0.5),
    "body_sinking",
)
add_whole(
    "body_sinking",
    "the hips sinking | the body going down | a downward movement of the body",
    "the body moves down | the pelvis sinks | the hips go down | the body is falling",
    "sink | move the hips down | go down",
    lambda m: ramp(m.travel[:, 2], -0.12, -0.5),
    "body_rising",
)
add_whole(
    "body_still",
    "the body at rest | no movement at all | the whole body still",
    "the body does not move | nothing moves | the whole body is still | the figure holds its position",
    "stay still | do not move | hold the position | keep still",
    lambda m: ramp(m.liveliness, 0.6, 0.2) * ramp(np.linalg.norm(m.travel, axis=1), 0.3, 0.1),
    "body_ahead | body_backward | body_lively",
)
add_whole(
    "body_lively",
    "all limbs in motion | a lot of movement | arms and legs moving",
    "arms and legs are moving | the whole body is in motion | a lot is moving",
    "move all limbs | keep arms and legs moving",
    lambda m: ramp(
        np.mean([m.speed(f"{side}_{part}") for side in ("right", "left") for part in ("hand", "foot")], axis=0),
        0.5,
        1.3,
    ),
    "body_still",
)
