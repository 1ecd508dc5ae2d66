"""Words by which rules judge and rewrite captions of motion; plain sets, so that they can be read and extended."""

from __future__ import annotations

import re


def _words(text: str) -> frozenset[str]:
    return frozenset(text.split())


VERBS = _words("""
    balance bend bow box bring brush carry cartwheel catch circle clap climb crawl cross crouch dance dip dive do dodge drag
    drop duck embrace execute extend
    fall flap flex fold follow get give go grab hang hit hold hop hug hurdle jab jog juggle jump
    kick kneel lay lean leap lie lift limp lower lunge make march mimic move nod open pace perform pick pivot place play point
    pose practise pull punch push put raise reach rest retreat rise roll rotate row run salute scratch shake shuffle shift shoot
    show shrug sidestep sit skate skip slide sneak spin spread sprint squat stagger stamp stand start step stoop stop
    stretch stride stroll strike stumble sway swim swing take tap throw tilt tiptoe toss touch trot turn twist use waddle wait
    walk warm wave wiggle
    """)
"""Base forms of what bodies do."""

IRREGULAR = {
    "is": "", "are": "", "was": "", "were": "", "has": "", "have": "", "does": "do", "did": "do", "goes": "go", "went": "go",
    "ran": "run", "sat": "sit", "stood": "stand", "threw": "throw", "took": "take", "bent": "bend", "knelt": "kneel",
    "held": "hold", "lying": "lie", "swam": "swim", "swung": "swing", "hung": "hang", "caught": "catch", "brought": "bring",
    "fell": "fall", "rose": "rise", "made": "make", "shook": "shake", "spun": "spin", "struck": "strike", "got": "get",
    "practices": "practise", "practicing": "practise", "laid": "lay", "gave": "give", "leapt": "leap",
}  # fmt: skip
"""Forms that no rule finds; an empty base form is that of an auxiliary, which is left out."""

VAGUE_VERBS = _words("do execute go get make perform play practise mimic use start stop warm show move")
"""Verbs that do not say what the body does."""

WHOLE_BODY_VERBS = _words("squat sit kneel walk run crawl jump hop crouch lie march skip bow clap tiptoe")
"""Verbs that are clear without a part of the body being named."""

BODY_PARTS = _words("""
    ankle arm back body chest elbow foot feet forearm hand head heel hip knee leg neck palm shoulder thigh toe torso trunk
    waist wrist
    """)

FACE_AND_FINGERS = _words("""
    cheek chin ear expression eye eyebrow face facial finger fingertip fist frown gaze grin laugh lip look mouth nose smile
    stare talk thumb tongue yawn
    """)

DIRECTIONS = _words("""
    above ahead apart around aside ground floor back backward backwards beside behind below between both clockwise down
    downward downwards forth forward forwards front higher left level overhead right side sideway sideways straight up upright
    upward upwards over
    """)
"""Words that make a motion clear, and that are no superfluous adverbs."""

SUBJECTS = _words("""
    actor athlete boy character child dancer figure gentleman girl guy human humanoid individual lady man men mannequin model
    he she somebody someone people person player robot stickman subject they woman
    """)

SEQUENCE_WORDS = _words(
    "after afterwards again and before finally first later meanwhile next once repeatedly second then until when while"
)

ADJECTIVES = _words("""
    aggressive angry awkward beautiful big bit broad calm careful casual dramatic drunk elegant energetic exaggerated excited
    fancy fast full funny gentle graceful great happy hard heavy high huge imaginary intense large lazy light little long loose
    low lot nervous normal old playful powerful proud quick quiet rapid relaxed sad several short sideward slight slow small
    smooth soft some steady strong stylish sudden tall tired traditional very wide wild young
    """)

ADVERBS = _words("almost also fast just maybe quite rather really slightly somewhat still together too very well")

REFERENCES = _words("another it something somewhere stuff that them thing this those")
"""Words that refer to what a caption does not say."""

ARTICLES = _words("a an the his her their its my your")

PREPOSITIONS = _words(
    "about above across against along around as at behind below beside between by during for from in into like near of off on "
    "onto over past through to toward towards under with without"
)

_ORDINARY_LY = _words("belly fly only")


def words_of(text: str) -> list[str]:
    """Words of a text in lower case, without punctuation."""
    return re.findall(r"[a-z]+(?:'[a-z]+)?", text.lower().replace("’", "'"))


def singular(word: str) -> str:
    """A noun without the s of its plural: "knees" becomes "knee"."""
    if word in ("feet", "men", "women"):
        return {"feet": "foot", "men": "man", "women": "woman"}[word]
    return word[:-1] if word.endswith("s") and not word.endswith("ss") and len(word) > 3 else word


def base_form(word: str) -> str | None:
    """The base form of a verb of :data:`VERBS`, "" for an auxiliary, None for any other word."""
    if word in VERBS:
        return word
    if word in IRREGULAR:
        return IRREGULAR[word]
    for ending, additions in (("ing", ("", "e")), ("ed", ("", "e")), ("es", ("", "e")), ("s", ("",)), ("ies", ("y",))):
        if word.endswith(ending):
            stem = word[: -len(ending)]
            candidates = [stem + addition for addition in additions]
            if len(stem) > 2 and stem[-1] == stem[-2]:
                candidates.append(stem[:-1])  # running, clapped
            for candidate in candidates:
                if candidate in VERBS:
                    return candidate
    return None


def verbs_of(words: list[str]) -> list[str]:
    """The verbs among the words of a caption, but no noun of the same form ("a kick", "in circles", "arms crossed")."""
    found = []
    for place, word in enumerate(words):
        before = words[place - 1] if place else ""
        noun = before in ARTICLES or before in PREPOSITIONS - DIRECTIONS or is_adjective(before)
        participle = word.endswith(("ed", "ing")) and singular(before) in BODY_PARTS
        if base_form(word) and not noun and not participle:
            found.append(word)
    return found


def is_adverb(word: str) -> bool:
    """Whether a word says how something is done."""
    return word in ADVERBS or (word.endswith("ly") and len(word) > 4 and word not in _ORDINARY_LY)


def is_adjective(word: str) -> bool:
    """Whether a word is one of the adjectives that captions are fond of."""
    return word in ADJECTIVES


def about_face_or_fingers(word: str) -> bool:
    """Whether a word is about what a picture of a whole body does not show."""
    return singular(word) in FACE_AND_FINGERS or base_form(word) in FACE_AND_FINGERS
