"""Writes captions from posecodes: one to four facts, in many registers."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from agents.encoder.captions import gerund, third_person
from agents.encoder.posecodes.base import Posecode

_PEOPLE = (
    "a person",
    "someone",
    "somebody",
    "the figure",
    "a figure",
    "the humanoid",
    "a humanoid",
    "the body",
    "a robot",
    "the character",
    "a man",
    "a woman",
    "the dancer",
    "the patient",
    "the athlete",
    "the child",
)
_PRONOUNS = ("he", "she", "the person", "the figure", "the subject", "the humanoid", "it")
_OWNERS = ("your", "its", "their", "his", "her", "the", "the", "the")
_HOLDING = ("keep", "hold", "have", "leave")
_BEING = ("is", "is", "is", "stays", "remains")
_BEING_MANY = ("are", "are", "are", "stay", "remain")
_WRITTEN = 0.7
"""How often a whole wording is taken where a subject and a state could be put together as well."""
_LIMB = re.compile(r"\bthe (left|right|other)\b")


def _pick(rng: np.random.Generator, options: Sequence[str]) -> str:
    return options[int(rng.integers(len(options)))]


def _article(code: Posecode, subject: str, owner: str) -> str:
    """The subject with its article; "both elbows" and "one elbow" have none."""
    return subject if code.name.endswith((".both", ".one")) else f"{owner} {subject}"


def nominal(code: Posecode, rng: np.random.Generator) -> str:
    """A noun phrase that can follow "with": "the left elbow bent", "a forward lean"."""
    if code.nominals and (not code.states or rng.random() < _WRITTEN):
        return _pick(rng, code.nominals)
    subject, state = _pick(rng, code.subjects), _pick(rng, code.states)
    return f"{_article(code, subject, _pick(rng, ('the', 'the', 'a', '')))} {state}".strip().replace("a both", "both")


def clause(code: Posecode, rng: np.random.Generator) -> str:
    """A sentence without its full stop: "the left elbow is bent"."""
    if code.clauses and (not code.states or rng.random() < _WRITTEN):
        return _pick(rng, code.clauses)
    if not code.states:
        return f"{_pick(rng, _PRONOUNS)} has {nominal(code, rng)}"
    subject, state = _pick(rng, code.subjects), _pick(rng, code.states)
    if rng.random() < 0.2:
        return f"{_pick(rng, _PRONOUNS)} has {_article(code, subject, _pick(rng, ('its', 'the', 'their')))} {state}"
    being = _pick(rng, _BEING_MANY if code.plural else _BEING)
    owner = _pick(rng, ("the", "the", "the", "its", "your", "the person's"))
    return f"{_article(code, subject, owner)} {being} {state}"


def imperative(code: Posecode, rng: np.random.Generator) -> str:
    """What to do for it: "bend the left elbow"."""
    if code.imperatives and (not code.states or rng.random() < 0.7):
        chosen = _pick(rng, code.imperatives)
        if rng.random() < 0.4:
            owner = _pick(rng, _OWNERS)
            chosen = _LIMB.sub(lambda found: f"{owner} {found[1]}", chosen)
        return chosen
    if not code.states:
        return f"be seen with {nominal(code, rng)}"
    subject, state = _pick(rng, code.subjects), _pick(rng, code.states)
    return f"{_pick(rng, _HOLDING)} {_article(code, subject, _pick(rng, _OWNERS))} {state}"


def phrase(code: Posecode, rng: np.random.Generator) -> str:
    """One fact in any register."""
    register = rng.random()
    if register < 0.35:
        said = nominal(code, rng)
        return f"with {said}" if rng.random() < 0.2 else said
    if register < 0.65:
        return clause(code, rng)
    said = imperative(code, rng)
    register = rng.random()
    if register < 0.6:
        return said
    return (third_person(said) or said) if register < 0.8 else (gerund(said) or said)


def _listed(rng: np.random.Generator, parts: list[str]) -> str:
    style = rng.random()
    if len(parts) == 1:
        return parts[0]
    if style < 0.45:
        return f"{', '.join(parts[:-1])} and {parts[-1]}"
    if style < 0.8:
        return ", ".join(parts)
    return " and ".join(parts)


def describe(codes: Sequence[Posecode], rng: np.random.Generator) -> str:
    """One caption about several facts.

    Args:
        codes: one to four facts, in the order in which they are said.
        rng: draws the register, the wordings and how they are joined. Facts that are mirror images of each other are
            said in the same words by generators of the same state.

    Returns:
        The caption.
    """
    register = rng.random()
    if register < 0.16:  # terse
        parts = [nominal(code, rng) for code in codes]
        parts = [re.sub(r"^(the|a) ", "", part) for part in parts] if rng.random() < 0.7 else parts
        text = _pick(rng, ("; ", ", ", ", ", " / ", " and ", " - ", ". ")).join(parts)
        if rng.random() < 0.3:
            text = _pick(rng, ("pose: ", "a pose with ", "posture: ", "position: ")) + text
    elif register < 0.46:  # sentences
        parts = [clause(code, rng) for code in codes]
        joint = rng.random()
        if joint < 0.3:
            text = _listed(rng, parts)
        elif joint < 0.5:
            text = ", while ".join([_listed(rng, parts[:-1]), parts[-1]] if len(parts) > 1 else parts)
        elif joint < 0.75:
            text = ". ".join(parts) + "."
        else:
            text = _pick(rng, ("; ", ", and ", ", ", " whereas ", " with ", " as ")).join(parts)
    elif register < 0.66:  # orders
        parts = [imperative(code, rng) for code in codes]
        joint = rng.random()
        if joint < 0.4:
            text = _listed(rng, parts)
        elif joint < 0.6 and len(parts) > 1:
            text = _listed(rng, parts[:-1]) + " while " + (gerund(parts[-1]) or f"you {parts[-1]}")
        elif joint < 0.8:
            text = ", ".join([parts[0], *(nominal(code, rng) for code in codes[1:])])
        else:
            text = ". ".join(parts) + "."
        if rng.random() < 0.15:
            text = _pick(rng, ("please ", "now ", "try to ", "can you ", "you should ")) + text
    elif register < 0.86:  # with
        text = f"{_pick(rng, _PEOPLE)} with {_listed(rng, [nominal(code, rng) for code in codes])}"
        if rng.random() < 0.2:
            text = (
                f"{_pick(rng, _PEOPLE)} {_pick(rng, ('stands', 'poses', 'is seen', 'is shown', 'moves'))} with "
                + _listed(rng, [nominal(code, rng) for code in codes])
            )
    elif register < 0.94:  # someone does
        parts = [imperative(code, rng) for code in codes]
        doing = rng.random() < 0.4
        form = gerund if doing else third_person
        told = [form(part) or clause(code, rng) for part, code in zip(parts, codes, strict=True)]
        text = f"{_pick(rng, _PEOPLE)} {'is ' if doing and rng.random() < 0.5 else ''}{_listed(rng, told)}"
    else:  # anything
        text = ", ".join(phrase(code, rng) for code in codes)
    return re.sub(r"\s+", " ", text).strip()
