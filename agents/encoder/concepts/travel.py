"""Concepts about moving and turning, and about standing still."""

from __future__ import annotations

import numpy as np

from agents.encoder.concepts.base import add, add_sided
from agents.encoder.concepts.legs import knee_raised
from agents.encoder.measurements import SIDES, Array, Measurements, near, partly, ramp


def _stepping(m: Measurements) -> Array:
    """1 if a foot moves as in walking."""
    return ramp(np.maximum(m.speed("right_foot"), m.speed("left_foot")), 0.25, 1.1)


add(
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
add(
    "walk_slowly",
    "travel",
    "walk slowly | walk forward slowly | take a slow walk | make a few slow steps forward | stroll slowly",
    lambda m: near(m.travel[:, 0], 0.45, 0.42) * (0.4 + 0.6 * _stepping(m)) * m.standing,
)
add(
    "run",
    "travel",
    "run | run forward | jog ahead | run fast | sprint | jog | run straight ahead | dash forward",
    lambda m: ramp(m.travel[:, 0], 0.5, 2.6) * (0.3 + 0.7 * _stepping(m)) * ramp(m.pelvis_height, 0.5, 0.7) * m.on_feet,
)
add(
    "walk_back",
    "travel",
    "walk backward | step backward | take steps backward | move back | walk backward slowly | go back | back away",
    lambda m: ramp(m.travel[:, 0], -0.04, -0.5) * (0.4 + 0.6 * _stepping(m)) * m.standing,
)
add_sided(
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
add_sided(
    "turn",
    "travel",
    "turn {side} | turn around to the {side} | turn to the {side} in place | turn {side} with small steps |"
    "rotate to the {side} | spin {side}",
    lambda m, side, other: ramp(m.turning * (1 if side == "left" else -1), 0.2, 1.6) * m.standing,
)
add(
    "turn_any",
    "travel",
    "turn around | spin around | turn in a circle | rotate on the spot",
    lambda m: ramp(np.abs(m.turning), 0.3, 2.2) * m.standing,
)
add(
    "march",
    "travel",
    "march in place | march on the spot | lift the knees in turn | walk on the spot | run in place | step in place"
    " | jog in place | jog on the spot | run on the spot | high knees",
    lambda m: (
        np.maximum(knee_raised(m, "right", "left"), knee_raised(m, "left", "right")) ** 0.5
        * (0.3 + 0.7 * _stepping(m))
        * ramp(np.linalg.norm(m.travel[:, :2], axis=-1), 0.8, 0.25)
        * m.standing
    ),
)
add(
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
add(
    "lively",
    "whole",
    "dance | dance with arms | dance with swinging arms | a lively dance | move around wildly | dance around",
    lambda m: (
        partly(*(ramp(m.speed(f"{side}_{part}"), 0.2, 1.6) for side in SIDES for part in ("hand", "foot"))) * m.standing
    ),
)
