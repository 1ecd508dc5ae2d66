"""Judges and rewrites captions by rules alone: what is used without a language model. Plain, quick, and without surprises.

A rule cannot know that a bow is a bent back. It makes short what is long, and tells what it cannot mend.
"""

from __future__ import annotations

import re

from agents.texts.vocabulary import (
    ARTICLES,
    BODY_PARTS,
    DIRECTIONS,
    PREPOSITIONS,
    REFERENCES,
    SEQUENCE_WORDS,
    SUBJECTS,
    VAGUE_VERBS,
    WHOLE_BODY_VERBS,
    about_face_or_fingers,
    base_form,
    is_adjective,
    is_adverb,
    singular,
    verbs_of,
    words_of,
)

MOST_WORDS = 7
"""An instruction has fewer than 8 words (AnySkill, appendix A.1)."""

# Where the first of several movements ends.
_BREAK = re.compile(
    r"[,;:.!?]|\b(?:and then|then|before|after(?:wards)?|while|until|when|because|so that|followed by|"
    r"as (?:if|though|he|she|they))\b"
)
_NOT_AFTER_AND = ("both", "left", "right", "the", "his", "her", "their")


def score_plainness(text: str) -> float:
    """How plain a caption is, from 0 to 10: short, one movement, no sequence, few verbs; see `prompts.PLAINNESS`."""
    words = words_of(text)
    verbs = verbs_of(words)
    score = 10.0
    score -= 1.0 * max(0, len(words) - MOST_WORDS)
    score -= 3.0 * sum(word in SEQUENCE_WORDS - {"and"} for word in words) + 1.5 * words.count("and")
    score -= 2.0 * max(0, len(verbs) - 1) + (4.0 if not verbs else 0.0)
    score -= 1.0 * sum(is_adjective(word) or is_adverb(word) for word in words)
    score -= 1.0 * any(word in SUBJECTS for word in words) + 0.5 * text.count(",")
    return max(0.0, min(10.0, score))


def score_clearness(text: str) -> float:
    """How clear it is what the body does, from 0 to 10; see `prompts.CLEARNESS`."""
    words = words_of(text)
    verbs = [base for base in map(base_form, words) if base]
    telling = [verb for verb in verbs if verb not in VAGUE_VERBS and verb != "dance"]
    score = 4.0 if telling else 0.0
    score += 3.0 * any(singular(word) in BODY_PARTS for word in words)
    score += 3.0 * any(word in DIRECTIONS for word in words)
    score += 4.0 * bool(WHOLE_BODY_VERBS & set(telling))
    score -= 3.0 * sum(word in REFERENCES for word in words)
    score -= 2.0 * sum(about_face_or_fingers(word) for word in words)
    return max(0.0, min(10.0, score))


def rewrite(text: str) -> str:
    """Makes an instruction of a caption: the first movement, in the imperative, without subject and ornament.

    Returns:
        The instruction; :func:`faults` says whether it is one.
    """
    clause = next((part for part in _BREAK.split(" ".join(text.lower().split())) if words_of(part)), "")
    words = _without_ornament(_from_first_verb(_before_second_verb(words_of(clause))))
    return " ".join(_shortened(words))


def faults(text: str) -> list[str]:
    """The rules that an instruction breaks, as phrases; empty for a good one."""
    words = words_of(text)
    verbs = verbs_of(words)
    nouns = [word for word in words if singular(word) in SUBJECTS]
    found = []
    if not words:
        return ["it is empty"]
    if len(words) > MOST_WORDS:
        found.append(f"it has {len(words)} words, {MOST_WORDS} are the most")
    if nouns:
        found.append(f"it names somebody ({nouns[0]})")
    if not base_form(words[0]) or base_form(words[0]) != words[0]:
        found.append(f"it does not begin with a verb in the imperative ({words[0]})")
    if len(verbs) > 1:
        found.append(f"it has more than one verb ({', '.join(verbs)})")
    ornament = [word for word in words if is_adverb(word) or is_adjective(word)]
    if ornament:
        found.append(f"it has adjectives or adverbs ({', '.join(ornament)})")
    hidden = [word for word in words if about_face_or_fingers(word)]
    if hidden:
        found.append(f"it is about face or fingers ({', '.join(hidden)})")
    sequence = [word for word in words if word in SEQUENCE_WORDS - {"and"}]
    if sequence:
        found.append(f"it is a sequence ({', '.join(sequence)})")
    return found


def _before_second_verb(words: list[str]) -> list[str]:
    """Cuts "... and turns around", but keeps "arms and legs"."""
    for place, word in enumerate(words[:-1]):
        following = words[place + 1]
        if (
            word == "and"
            and base_form(following)
            and following not in _NOT_AFTER_AND
            and any(map(base_form, words[:place]))
        ):
            return words[:place]
    return words


def _from_first_verb(words: list[str]) -> list[str]:
    """Drops subject and auxiliaries, and puts the first verb into the imperative."""
    for place, word in enumerate(words):
        base = base_form(word)
        # "a walking man": a verb before its subject is none
        if base and not any(each in SUBJECTS for each in words[place + 1 : place + 3]):
            rest = words[place + 1 :]
            return _told_by_noun(rest) or [base, *rest] if base in VAGUE_VERBS | {"take", "throw"} else [base, *rest]
    return words


def _told_by_noun(words: list[str]) -> list[str] | None:
    """The verb that "(take) a deep bow" or "(do) two squats" is about, with what follows it; None if there is none."""
    for place, word in enumerate(words[:4]):
        base = base_form(word)
        if word.endswith("ing"):  # "a jumping jack"
            return None
        if base and base not in VAGUE_VERBS and (place or word != base):
            return [base, *(each for each in words[:place] if each in DIRECTIONS), *words[place + 1 :]]
        if word in PREPOSITIONS or singular(word) in BODY_PARTS:
            return None
    return None


def _without_ornament(words: list[str]) -> list[str]:
    """Drops adjectives, adverbs, and phrases about face and fingers."""
    plain = [word for word in words if not is_adjective(word) and not is_adverb(word) or word in DIRECTIONS]
    cut: list[str] = []
    for word in plain:
        if about_face_or_fingers(word):
            # the phrase that it ends goes as well, back to its preposition
            starts = [place for place, each in enumerate(cut) if place and each in PREPOSITIONS | {"and"}]
            cut = cut[: starts[-1]] if starts else cut[:1]
            break
        cut.append("the" if word in ARTICLES - {"a", "an"} else word)
    return _without_loose_end(cut)


def _shortened(words: list[str]) -> list[str]:
    """At most seven words, cut where a phrase begins if there is such a place."""
    if len(words) <= MOST_WORDS:
        return words
    places = [place for place in range(2, MOST_WORDS + 1) if words[place] in PREPOSITIONS | {"and"}]
    return _without_loose_end(words[: places[-1] if places else MOST_WORDS])


def _without_loose_end(words: list[str]) -> list[str]:
    """Drops articles and prepositions with nothing behind them; directions such as "up" may stand last."""
    words = list(words)
    while len(words) > 1 and (words[-1] in ARTICLES | {"and"} or words[-1] in PREPOSITIONS - DIRECTIONS):
        words.pop()
    return words
