"""Concepts about the whole body: lying, all fours, upside down."""

from __future__ import annotations

from agents.encoder.concepts.base import add, add_sided
from agents.encoder.measurements import SIDES, Array, Measurements, partly, ramp


def _low(m: Measurements) -> Array:
    return ramp(m.height("torso"), 0.5, 0.25) * ramp(m.head_height, 0.6, 0.3)


add(
    "lie",
    "whole",
    "lie down | lie on the floor | fall down | lie on the ground | drop to the floor | collapse | be fallen over",
    _low,
)
add(
    "lie_back",
    "whole",
    "lie on the back | lie face up | fall on the back | rest on the back",
    lambda m: _low(m) * ramp(m.axis("torso", 0)[:, 2], 0.2, 0.8),
)
add(
    "lie_front",
    "whole",
    "lie on the belly | lie face down | fall on the stomach | lie prone",
    lambda m: _low(m) * ramp(m.axis("torso", 0)[:, 2], -0.2, -0.8),
)
add_sided(
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


add(
    "all_fours",
    "whole",
    "be on hands and knees | go down on all fours | kneel on hands and knees | stay on all fours",
    _on_all_fours,
)
add(
    "crawl",
    "whole",
    "crawl | crawl forward | crawl forward on hands and knees | crawl on the floor | creep ahead on all fours",
    lambda m: _on_all_fours(m) * (0.4 + 0.6 * ramp(m.travel[:, 0], 0.0, 0.4)),
)
add(
    "upside_down",
    "whole",
    "do a handstand | turn a cartwheel | cartwheel | flip over | be upside down | backflip | a somersault"
    " | flip backward in the air | do a backflip | stand on the hands | head down, feet up",
    lambda m: ramp(m.uprightness, 0.1, -0.7) * ramp(m.pelvis_height, 0.4, 0.7),
)
