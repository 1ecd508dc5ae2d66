"""What the towers learn from posecodes: descriptions of motions, the same in other words, and with one fact wrong."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from agents.encoder.posecodes.grading import CODES, CodeChooser, opposites
from agents.encoder.posecodes.writing import describe, phrase

_FALSE = 0.3
"""Grade up to which a fact is false of a motion."""


@dataclass(frozen=True)
class Lesson:
    """One motion and captions about it.

    Attributes:
        row: which motion.
        turned: whether its mirror image is meant.
        facts: indices of posecodes that are true of it.
        text: a description.
        other_text: the same facts in other words.
        wrong_facts: the facts with one exchanged for the other side, limb or direction; the same if there is none.
        wrong_text: their description, in the words of `text` but for that fact.
    """

    row: int
    turned: bool
    facts: tuple[int, ...]
    text: str
    other_text: str
    wrong_facts: tuple[int, ...]
    wrong_text: str


def write_lessons(
    chooser: CodeChooser, rows: NDArray[np.int64], turned: NDArray[np.bool_], rng: np.random.Generator
) -> list[Lesson]:
    """A lesson about each of some motions, but those of which no fact is true.

    Args:
        chooser: chooses facts, and knows the grades of all motions.
        rows: which motions.
        turned: of which the mirror image is meant.
        rng: draws wordings and what is wrong.
    """
    grades = chooser.of(rows, turned)
    confused = opposites()
    lessons = []
    for place, facts in enumerate(chooser.choose(grades)):
        if not facts:
            continue
        seed = int(rng.integers(2**31))
        text = describe([CODES[fact] for fact in facts], np.random.default_rng(seed))
        wrong = with_one_wrong(facts, grades[place], confused, rng)
        lessons.append(
            Lesson(
                int(rows[place]),
                bool(turned[place]),
                facts,
                text,
                describe([CODES[fact] for fact in facts], rng),
                wrong,
                describe([CODES[fact] for fact in wrong], np.random.default_rng(seed)),
            )
        )
    return lessons


def with_one_wrong(
    facts: tuple[int, ...], grades: NDArray[np.float32], confused: Sequence[Sequence[int]], rng: np.random.Generator
) -> tuple[int, ...]:
    """Facts with one exchanged for one that is false; the same ones if none of those that they are confused with is.

    Args:
        facts: indices of posecodes.
        grades: how far each posecode is true of the motion, `(codes,)`.
        confused: with which others each is confused, see :func:`agents.encoder.posecodes.grading.opposites`.
        rng: draws which one is exchanged, and for what.
    """
    for place in rng.permutation(len(facts)):
        false = [other for other in confused[facts[place]] if grades[other] <= _FALSE]
        if false:
            changed = list(facts)
            changed[place] = int(rng.choice(false))
            return tuple(changed)
    return facts


def write_phrases(rng: np.random.Generator, each: int) -> list[list[str]]:
    """For each posecode some phrases, of which captions are composed while training.

    Those of a posecode and of its mirror image are the same in the same order, but for the sides.

    Args:
        rng: draws them.
        each: how many are drawn of each; equal ones are kept once.
    """
    seeds: dict[str, int] = {}
    written = []
    for code in CODES:
        seed = seeds.setdefault(code.stem, int(rng.integers(2**31)))
        drawn = np.random.default_rng(seed)
        written.append(list(dict.fromkeys(phrase(code, drawn) for _ in range(each))))
    return written


def compose(
    facts: Sequence[int], phrases: Sequence[Sequence[str]], rng: np.random.Generator, like: Sequence[int] | None = None
) -> list[int]:
    """Which phrase of each fact is said.

    Args:
        facts: indices of posecodes.
        phrases: of each posecode, see :func:`write_phrases`.
        rng: draws them.
        like: places of the phrases in a caption from which this one differs in facts: a fact of the same place is said
            in the same words.
    """
    if like is None:
        return [int(rng.integers(len(phrases[fact]))) for fact in facts]
    return [place % len(phrases[fact]) for place, fact in zip(like, facts, strict=True)]
