"""What a concept is, and the table that the modules beside this one fill."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from agents.encoder.measurements import SIDES, Array, Measurements

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
        further: more wordings, see :func:`agents.encoder.wordings.with_further_wordings`.
    """

    name: str
    group: str
    phrases: tuple[str, ...]
    rule: Rule
    further: tuple[str, ...] = ()

    @property
    def wordings(self) -> tuple[str, ...]:
        """All wordings: the phrases, then the further ones."""
        return self.phrases + self.further


CONCEPTS: dict[str, Concept] = {}
"""All concepts by name."""


def add(name: str, group: str, phrases: str, rule: Rule) -> None:
    """Puts a concept into the table; a bar stands between its wordings."""
    CONCEPTS[name] = Concept(name, group, tuple(phrase.strip() for phrase in phrases.split("|")), rule)


def add_sided(name: str, group: str, phrases: str, rule: SidedRule) -> None:
    """Puts a concept into the table for either side; the rule gets the side and the other one."""
    for side, other in (SIDES, SIDES[::-1]):

        def sided(m: Measurements, side: str = side, other: str = other) -> Array:
            return rule(m, side, other)

        add(f"{name}.{side}", group, phrases.format(side=side, other=other), sided)


def degrees(angle: float) -> float:
    """Radians of an angle in degrees."""
    return float(np.radians(angle))
