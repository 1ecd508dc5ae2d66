"""What a posecode is: one low-level fact about a short motion, with a grade and the parts of which its wordings are made.

After PoseScript (Delmas et al., "PoseScript: 3D Human Poses from Natural Language", ECCV 2022), which describes poses by
automatic "posecodes": how far a joint is bent, where a limb is relative to another, what touches the floor. The rules here
are our own: they grade from 0 to 1, by the measurements that the concepts use.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from agents.encoder.measurements import SIDES, Array, Measurements
from agents.encoder.posecodes.wordings import further_wordings

Rule = Callable[[Measurements], Array]
SidedRule = Callable[[Measurements, str, str], Array]
_PLURALS = {"foot": "feet", "calf": "calves"}


@dataclass(frozen=True)
class Posecode:
    """One low-level fact.

    Attributes:
        name: unique name; those about one side end in ".left" or ".right", about both in ".both", about any in ".one".
        subjects: what it is about, without article: "left elbow".
        states: what is said of the subject: "bent at a right angle".
        plural: whether the subjects are plural.
        imperatives: what to do for it, beginning with a verb.
        clauses: whole sentences about it.
        nominals: noun phrases that can follow "with".
        rule: how far n short motions fulfil it, `(n,)` from 0 to 1.
        opposites: names of posecodes with which it is easily confused: another direction or another limb.
    """

    name: str
    subjects: tuple[str, ...]
    states: tuple[str, ...]
    plural: bool
    imperatives: tuple[str, ...]
    clauses: tuple[str, ...]
    nominals: tuple[str, ...]
    rule: Rule
    opposites: tuple[str, ...] = ()

    @property
    def stem(self) -> str:
        """Its name without side."""
        return self.name.partition(".")[0]


POSECODES: dict[str, Posecode] = {}
"""All posecodes by name."""


def split(texts: str) -> tuple[str, ...]:
    """Wordings between bars."""
    return tuple(text.strip() for text in texts.split("|") if text.strip())


def plural(noun: str) -> str:
    """The plural of a noun, "left feet" of "left foot"."""
    first, _, last = noun.rpartition(" ")
    return f"{first} {_PLURALS.get(last, last + 's')}".strip()


def _add(code: Posecode) -> None:
    if code.name in POSECODES:
        raise ValueError(f"There are two posecodes {code.name!r}.")
    written = further_wordings(code.name)
    POSECODES[code.name] = replace(
        code,
        nominals=code.nominals + written.nominals,
        clauses=code.clauses + written.clauses,
        imperatives=code.imperatives + written.imperatives,
    )


def _add_sides(
    stem: str,
    rule: SidedRule,
    opposites: str,
    subjects: str = "",
    states: str = "",
    imperatives: str = "",
    clauses: str = "",
    nominals: str = "",
) -> None:
    """One posecode for each side; "{side}" and "{other}" in the wordings stand for it and the other one."""
    for side, other in (SIDES, SIDES[::-1]):

        def sided(m: Measurements, side: str = side, other: str = other) -> Array:
            return rule(m, side, other)

        def worded(texts: str, side: str = side, other: str = other) -> tuple[str, ...]:
            return split(texts.format(side=side, other=other))

        _add(
            Posecode(
                name=f"{stem}.{side}",
                subjects=worded(subjects),
                states=worded(states),
                plural=False,
                imperatives=worded(imperatives),
                clauses=worded(clauses),
                nominals=worded(nominals),
                rule=sided,
                opposites=tuple(f"{one}.{side}" for one in split(opposites)),
            )
        )


def add_limb(
    stem: str,
    nouns: str,
    states: str,
    rule: SidedRule,
    imperatives: str = "",
    clauses: str = "",
    opposites: str = "",
    both: bool = True,
) -> None:
    """Puts a fact about a limb into the table, for either side, and for both and any of them.

    Args:
        stem: name without side.
        nouns: names of the limb without its side, such as "elbow | arm".
        states: what is said of it.
        rule: gets the measurements, the side and the other side.
        imperatives: what to do for it, with "{side}" before the limb.
        clauses: whole sentences with "{side}" and "{other}".
        opposites: stems of posecodes with which it is easily confused.
        both: whether there are facts about both limbs and about any of them, too.
    """
    subjects = " | ".join(f"{{side}} {noun}" for noun in split(nouns))
    _add_sides(stem, rule, opposites, subjects, states, imperatives, clauses)
    if not both or "{" in states:
        return
    together = tuple(f"{word} {plural(noun)}" for noun in split(nouns) for word in ("both", "the two"))
    to_both = re.sub(r"(?:the|your) \{side\} (\w+)", lambda found: f"both {plural(found[1])}", imperatives)
    _add(
        Posecode(
            f"{stem}.both",
            together,
            split(states),
            True,
            split(to_both) if "{" not in to_both else (),
            (),
            (),
            lambda m: np.minimum(rule(m, *SIDES), rule(m, *SIDES[::-1])),
            tuple(f"{one}.both" for one in split(opposites)),
        )
    )
    _add(
        Posecode(
            f"{stem}.one",
            tuple(f"{word} {noun}" for noun in split(nouns) for word in ("one", "at least one")),
            split(states),
            False,
            split(re.sub(r"(?:the|your) \{side\}", "one", imperatives)) if "{other}" not in imperatives else (),
            (),
            (),
            lambda m: np.maximum(rule(m, *SIDES), rule(m, *SIDES[::-1])),
            tuple(f"{one}.one" for one in split(opposites)),
        )
    )


def add_whole(stem: str, nominals: str, clauses: str, imperatives: str, rule: Rule, opposites: str = "") -> None:
    """Puts a fact about the whole body, or about two limbs at once, into the table.

    Args:
        stem: its name.
        nominals: noun phrases that can follow "with".
        clauses: whole sentences.
        imperatives: what to do for it.
        rule: gets the measurements.
        opposites: names of posecodes with which it is easily confused.
    """
    _add(
        Posecode(
            stem, (), (), False, split(imperatives), split(clauses), split(nominals), rule, tuple(split(opposites))
        )
    )


def add_sided(stem: str, nominals: str, clauses: str, imperatives: str, rule: SidedRule, opposites: str = "") -> None:
    """Puts a fact with a side that is not about one limb alone into the table: a lean, a turn, one foot before the other."""
    _add_sides(stem, rule, opposites, imperatives=imperatives, clauses=clauses, nominals=nominals)
