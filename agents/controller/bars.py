"""The bars that a controller should pass, and which of them a measured one does."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple


class Bar(NamedTuple):
    """One bar.

    Attributes:
        name: What is measured.
        path: Where the result has it; of several places the worst counts.
        limit: The value that is just good enough.
        at_most: Whether lower is better.
        unit: ``share``, ``mm``, ``m/s``, ``degrees/s`` or ``times``.
    """

    name: str
    path: tuple[str, ...]
    limit: float
    at_most: bool
    unit: str = "share"


BARS = (
    Bar("survival, mean over clips without acrobatics", ("summary.all_but_acrobatic.survival",), 0.95, False),
    Bar("survival, lowest clip without acrobatics", ("summary.all_but_acrobatic.lowest_survival",), 0.8, False),
    Bar("body error, clips in place", ("summary.in_place.error_mm",), 80, True, "mm"),
    Bar("body error, locomotion", ("summary.locomotion.error_mm",), 120, True, "mm"),
    Bar("falls in 10 s, random latents of clips on the feet at 6 Hz", ("random_upright_falls",), 0.1, True),
    Bar("falls in 10 s, uniform latents at 6 Hz", ("uniform_falls",), 0.25, True),
    Bar("falls after a push, standing or walking", ("push_falls.standing", "push_falls.walking"), 0.15, True),
    Bar("standing 6 s after lying, front or back", ("get_up.front", "get_up.back"), 0.8, False),
    Bar("clips named from the simulated motion", ("naming.top1",), 0.75, False),
    Bar("forward speed", ("steering.fastest.forward.speed",), 3.0, False, "m/s"),
    Bar("largest gap to a forward speed of 0.5, 1, ... 3 m/s", ("steering.largest_gap",), 0.25, True, "m/s"),
    Bar("backward speed", ("steering.fastest.backward.speed",), 0.5, False, "m/s"),
    Bar(
        "sideways speed, left or right",
        ("steering.fastest.left.speed", "steering.fastest.right.speed"),
        0.5,
        False,
        "m/s",
    ),
    Bar(
        "turn rate, left or right",
        ("steering.fastest.turn_left.speed", "steering.fastest.turn_right.speed"),
        60,
        False,
        "degrees/s",
    ),
    Bar("foot skate over that of the reference", ("smoothness.foot_skate.ratio",), 1.5, True, "times"),
    Bar("jerk over that of the reference", ("smoothness.jerk.ratio",), 1.5, True, "times"),
)
"""The bars of a controller; body errors are means over clips."""


def _value(result: Mapping[str, Any], path: str) -> float | None:
    value: Any = result
    for key in path.split("."):
        value = value.get(key) if isinstance(value, Mapping) else None
    return value


def bars(result: Mapping[str, Any], wanted: Sequence[Bar] = BARS) -> list[dict[str, Any]]:
    """Compares a result with the bars.

    Args:
        result: What :func:`agents.controller.evaluate.evaluate_controller` measures.
        wanted: The bars.

    Returns:
        For each bar ``name``, ``value``, ``limit``, ``at_most``, ``unit`` and ``met``; value and met are None where one of
        its measurements is missing.
    """
    rows = []
    for bar in wanted:
        values = [_value(result, path) for path in bar.path]
        known = [value for value in values if value is not None]
        complete = len(known) == len(values)
        value = (max if bar.at_most else min)(known) if complete else None
        met = None if value is None else value <= bar.limit if bar.at_most else value >= bar.limit
        rows.append(
            {
                "name": bar.name,
                "value": value,
                "limit": bar.limit,
                "at_most": bar.at_most,
                "unit": bar.unit,
                "met": met,
            }
        )
    return rows
