"""Captions: wordings of concepts and of pairs of concepts, and how far each is true of a motion."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from agents.encoder.concepts import CONCEPTS, Concept
from motion_data.clip import swap_sides

_THIRD_PERSON = {"go": "goes", "do": "does", "be": "is", "have": "has"}
_GERUND = {"be": "being", "lie": "lying", "die": "dying", "tie": "tying", "tiptoe": "tiptoeing"}
_VERBS_FILE = Path(__file__).with_name("verbs.txt")
_MARKED = [
    word for line in _VERBS_FILE.read_text(encoding="utf-8").splitlines() if line[0] != "#" for word in line.split()
]
_VERBS = frozenset(word.rstrip("*") for word in _MARKED)
_DOUBLING = frozenset(word[:-1] for word in _MARKED if word.endswith("*"))
_SYNONYMS = (
    ("raise", "lift"),
    ("above the head", "over the head", "overhead"),
    ("floor", "ground"),
    ("torso", "upper body", "trunk"),
    ("to the front", "forward", "ahead"),
    ("in front", "out in front"),
    ("both", "the two"),
    ("stretch", "extend", "reach"),
    ("hold", "keep"),
    ("put", "place"),
    ("out to the side", "sideways", "out to the sides"),
    ("down", "downward"),
    ("backward", "back", "backwards"),
    ("walk", "stroll"),
    ("the", "your", "its"),
    ("high", "up high"),
    ("deeply", "low", "far"),
    ("quickly", "fast"),
    ("a little", "slightly", "a bit"),
)
# The arms can do one thing while the legs, the trunk or the whole body do another.
_PARTNERS = (("arms", "legs"), ("arms", "travel"), ("arms", "trunk"), ("trunk", "legs"))
# Captions that need no person before them: whole sentences, and comparisons such as "as if held at gunpoint".
_WHOLE_SENTENCE = re.compile(
    r"^(a|an|the|he|she|it|they|we|you|this|that|these|those|his|her|its|their|someone|somebody|everybody|one|each|either"
    r"|neither|only|all|your|my|I|I'm|as|like|with|will|there)\b"
    r"|\b(is|are|has|have|goes?|lies?|moves?|touch|touches|points?|meets?|swings?|shoots?|rests?|comes?|stays?|flies|fly)\b"
    r"|\b(press|pushes|carry|carries|holds?|hangs?|hovers?|turns?|leads?|stands?|bends?|rises?|supports?|stirs)\b"
)
# A person can be seen "with" these.
_BODY = re.compile(
    r"\b(arms?|elbows?|forearms?|hands?|palms?|fists?|fingers?|legs?|knees?|shins?|foot|feet|heels?|ankles?|head|chin"
    r"|shoulders?)\b"
)
_JOINTS = ("{0} and {1}", "{1} and {0}", "{0} while {2}", "{3} while {1}", "{0}, {1}", "{1} with {0}")


def third_person(phrase: str) -> str | None:
    """Turns "raise the arm" into "raises the arm"; None if the phrase does not start with a verb."""
    return _conjugated(phrase, _third_person_of)


def gerund(phrase: str) -> str | None:
    """Turns "raise the arm" into "raising the arm"; None if the phrase does not start with a verb."""
    if phrase.startswith("do not "):
        negated = gerund(phrase.removeprefix("do not "))
        return negated and f"not {negated}"
    return _conjugated(phrase, _gerund_of)


def _conjugated(phrase: str, form: Callable[[str], str]) -> str | None:
    verb, _, rest = phrase.partition(" ")
    if verb not in _VERBS:
        return None
    # "squat down and stay low" has two verbs.
    rest = re.sub(r"\b(and then|and) (\w+)", lambda m: f"{m[1]} {form(m[2])}" if m[2] in _VERBS else m[0], rest)
    return f"{form(verb)} {rest}".strip()


def _of_another(phrase: str) -> str:
    """A person ties "their" shoelace, not "your" one."""
    return re.sub(r"\byour\b", "their", phrase.replace("yourself", "themselves"))


def _third_person_of(verb: str) -> str:
    if verb in _THIRD_PERSON:
        return _THIRD_PERSON[verb]
    if verb.endswith(("s", "sh", "ch", "x", "z")):
        return verb + "es"
    if verb.endswith("y") and verb[-2] not in "aeiou":
        return verb[:-1] + "ies"
    return verb + "s"


def _gerund_of(verb: str) -> str:
    if verb in _GERUND:
        return _GERUND[verb]
    if verb in _DOUBLING:
        return verb + verb[-1] + "ing"
    if verb.endswith("e") and not verb.endswith("ee"):
        return verb[:-1] + "ing"
    return verb + "ing"


def with_synonyms(phrase: str, rng: np.random.Generator) -> str:
    """The phrase with some of its words exchanged for others of the same meaning."""
    words = f" {phrase} ".replace(" in place ", " in_place ").replace(" the back ", " the_back ")  # these stay
    for group in _SYNONYMS:
        present = [word for word in group if f" {word} " in words]
        if present and rng.random() < 0.6:
            words = words.replace(f" {present[0]} ", f" {rng.choice(group)} ", 1)
    return words.strip().replace("_", " ")


@dataclass(frozen=True)
class Templates:
    """Ways to say a phrase, in which {0} is the phrase, {1} it in the third person and {2} as a gerund.

    Attributes:
        plain: for any phrase.
        verbal: for phrases that start with a verb.
        nominal: for those that do not, such as "hands up".
    """

    plain: tuple[str, ...]
    verbal: tuple[str, ...]
    nominal: tuple[str, ...]


TEMPLATES = {
    "reward": Templates(
        ("{0} please", "now {0}"),
        (
            "the humanoid {1}",
            "a person {1}",
            "someone {1}",
            "a robot {1}",
            "{2}",
            "a person {2}",
            "a person is {2}",
            "a humanoid robot {2}",
            "try to {0}",
            "the humanoid should {0}",
        ),
        ("a humanoid, {0}", "a person with {0}", "pose: {0}"),
    ),
    "evaluator": Templates(
        ("{0} now", "please, {0}"),
        (
            "this figure {1}",
            "he {1}",
            "she {1}",
            "one {1}",
            "here somebody is {2}",
            "the picture shows a body {2}",
            "an athlete {2}",
            "a character who {1}",
            "start to {0}",
            "we see a man {2}",
        ),
        ("a figure, {0}", "a body with {0}", "what is seen: {0}"),
    ),
}
"""Templates of the encoder that rewards, and of the independent evaluator: no wording is in both."""


def variants(phrase: str, style: str = "reward") -> list[str]:
    """Other ways to say a phrase, without the phrase itself.

    Args:
        phrase: the phrase.
        style: whose templates to take, a key of `TEMPLATES`.
    """
    templates = TEMPLATES[style]
    third, doing = third_person(phrase), gerund(phrase)
    if third is not None and doing is not None:
        chosen = templates.plain + templates.verbal
        third, doing = _of_another(third), _of_another(doing)
    elif _WHOLE_SENTENCE.search(phrase):  # "a person kicks the ball" needs no person before it
        chosen = templates.nominal[-1:]
    elif _BODY.search(phrase):
        chosen = templates.plain + templates.nominal
    else:  # "a person with surrender" is no English
        chosen = templates.plain + templates.nominal[-1:]
    return [text.format(phrase, third, doing) for text in chosen]


@dataclass(frozen=True)
class Caption:
    """A text and what it means.

    Attributes:
        text: the words.
        concepts: indices of one, two or three concepts that must be true together.
    """

    text: str
    concepts: tuple[int, ...]


@dataclass(frozen=True)
class CaptionSet:
    """Captions for training, and wordings that training never sees.

    Attributes:
        concepts: the concepts that captions point to.
        training: captions to train on.
        held_out: one concept each, in a wording that is in no training caption.
    """

    concepts: tuple[Concept, ...]
    training: tuple[Caption, ...]
    held_out: tuple[Caption, ...]

    def truth(self, captions: Sequence[Caption], truths: NDArray[np.floating]) -> NDArray[np.float32]:
        """How far captions are true of motions.

        Args:
            captions: c captions.
            truths: truth of every concept, `(n, concepts)`.

        Returns:
            `(n, c)`; several concepts count half their mean and half their worst.
        """
        return joint_truth([caption.concepts for caption in captions], truths)


def joint_truth(demands: Sequence[tuple[int, ...]], truths: NDArray[np.floating]) -> NDArray[np.float32]:
    """How far several demands are met together: half their mean, half the worst, so that each one met counts a little.

    Args:
        demands: for each of c captions, indices of what must be true together.
        truths: how far each of these is true of n motions, `(n, k)`.

    Returns:
        `(n, c)`.
    """
    width = max(len(demand) for demand in demands)
    # Filled up with the last demand, which changes no minimum.
    index = np.array([demand + demand[-1:] * (width - len(demand)) for demand in demands])
    counted = np.arange(width) < np.array([[len(demand)] for demand in demands])
    graded = truths[:, index]
    mean = (graded * counted).sum(2) / counted.sum(1)
    return (0.5 * mean + 0.5 * graded.min(2)).astype(np.float32)


def mirrored_caption(caption: Caption, concepts: Sequence[Concept]) -> Caption:
    """The caption with left and right exchanged, in words and in meaning."""
    names = [concept.name for concept in concepts]

    def partner(index: int) -> int:
        base, _, side = names[index].rpartition(".")
        other = {"left": "right", "right": "left"}.get(side)
        return names.index(f"{base}.{other}") if other else index

    return Caption(swap_sides(caption.text), tuple(partner(index) for index in caption.concepts))


def write_captions(
    rng: np.random.Generator,
    pairs: int = 700,
    variants_per_phrase: int = 2,
    held_out_share: float = 0.12,
    concepts: Sequence[Concept] | None = None,
    style: str = "reward",
    triples: int = 0,
) -> CaptionSet:
    """Writes the captions.

    Args:
        rng: draws wordings.
        pairs: how many pairs of concepts to join; each comes with its mirror image.
        variants_per_phrase: further wordings per phrase.
        held_out_share: share of the phrases that are kept for evaluation; never the first of a concept. A phrase and
            its mirror image are kept together.
        concepts: concepts to write about; all of them if None.
        style: whose templates to take, a key of `TEMPLATES`.
        triples: how many captions about arms, trunk and legs at once; each comes with its mirror image.

    Returns:
        The captions.
    """
    concepts = tuple(CONCEPTS.values() if concepts is None else concepts)
    kept: set[str] = set()
    for concept in concepts:
        for phrase in concept.phrases[1:]:
            if phrase not in kept and rng.random() < held_out_share:
                kept |= {phrase, swap_sides(phrase)}
    # Drawn after the others, so that which of those are kept does not depend on the further wordings.
    drawn: set[str] = set()
    for concept in concepts:
        for phrase in concept.further:
            if phrase in drawn:  # with its mirror image
                continue
            drawn |= {phrase, swap_sides(phrase)}
            if rng.random() < held_out_share:
                kept |= {phrase, swap_sides(phrase)}
    firsts = {concept.phrases[0] for concept in concepts}
    kept -= firsts
    training: list[Caption] = []
    held_out: list[Caption] = []
    for index, concept in enumerate(concepts):
        for phrase in concept.wordings:
            if phrase in kept:
                held_out.append(Caption(phrase, (index,)))
                continue
            training.append(Caption(phrase, (index,)))
            others = variants(phrase, style)
            chosen = rng.choice(len(others), size=min(variants_per_phrase, len(others)), replace=False)
            if phrase in concept.further:  # as varied as they are, they need no synonyms
                training += [Caption(others[choice], (index,)) for choice in chosen]
                continue
            training += [Caption(with_synonyms(others[choice], rng), (index,)) for choice in chosen]
            training += [Caption(with_synonyms(phrase, rng), (index,)) for _ in range(2)]
    groups: dict[str, list[int]] = {}
    for index, concept in enumerate(concepts):
        groups.setdefault(concept.group, []).append(index)
    partners = [pair for pair in _PARTNERS if all(group in groups for group in pair)]
    for _ in range(pairs if partners else 0):
        first_group, second_group = partners[rng.integers(len(partners))]
        first, second = int(rng.choice(groups[first_group])), int(rng.choice(groups[second_group]))
        caption = Caption(
            _join(rng, *(_phrase(rng, concepts[index], kept) for index in (first, second))), (first, second)
        )
        training += [caption, mirrored_caption(caption, concepts)]
    whole = [groups[group] for group in ("arms", "trunk", "legs") if group in groups]
    for _ in range(triples if len(whole) == 3 else 0):
        order = rng.permutation(3)
        chosen_three = tuple(int(rng.choice(whole[place])) for place in order)
        text = ", ".join(_phrase(rng, concepts[index], kept) for index in chosen_three)
        caption = Caption(text, chosen_three)
        training += [caption, mirrored_caption(caption, concepts)]
    unique = {caption.text: caption for caption in training if caption.text not in kept}
    return CaptionSet(concepts, tuple(unique.values()), tuple(held_out))


def _phrase(rng: np.random.Generator, concept: Concept, kept: set[str]) -> str:
    return str(rng.choice([phrase for phrase in concept.wordings if phrase not in kept]))


def _join(rng: np.random.Generator, first: str, second: str) -> str:
    first_doing, second_doing = gerund(first), gerund(second)
    possible = [template for template in _JOINTS if template.count("{") == 2]
    if second_doing is None:
        possible.remove("{0} while {2}")
    if first_doing is None or gerund(second) is None:
        possible.remove("{3} while {1}")
    # "squat with raise the arm" is no English, "squat with both hands up" is.
    if first_doing is not None or _WHOLE_SENTENCE.search(first) or not _BODY.search(first):
        possible.remove("{1} with {0}")
    template = str(rng.choice(possible))
    if template == "{3} while {1}":
        return f"{second} while {first_doing}"
    return template.format(first, second, second_doing, first_doing)
