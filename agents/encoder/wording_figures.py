"""Figures of an encoder on captions by the rules of training, in wordings that were kept out of it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from agents.encoder.captions import CaptionSet
from agents.encoder.dataset import MotionSet
from motion_data.clip import swap_sides
from rewards.encoders import Encoder

_TRUE = 0.75
_FALSE = 0.4


def retrieval(
    similarity: NDArray[np.float32],
    truth: NDArray[np.float32],
    rng: np.random.Generator,
    trials: int = 500,
    among: int = 100,
) -> dict[str, float]:
    """Text to motion: is a motion that fulfils the text found among 99 that do not?

    Args:
        similarity: of n motions and c texts, `(n, c)`.
        truth: how far each text is true, `(n, c)`.
        rng: draws texts and motions.
        trials: how many searches.
        among: motions per search.

    Returns:
        Share of searches in which the motion is the first, and is among the first five.
    """
    ranks = []
    for _ in range(trials):
        text = rng.integers(truth.shape[1])
        right, wrong = np.flatnonzero(truth[:, text] > _TRUE), np.flatnonzero(truth[:, text] < _FALSE)
        if not len(right) or len(wrong) < among - 1:
            continue
        others = rng.choice(wrong, among - 1, replace=False)
        ranks.append(int((similarity[others, text] >= similarity[rng.choice(right), text]).sum()))
    if not ranks:
        return {"recall@1": float("nan"), "recall@5": float("nan")}
    return {"recall@1": float(np.mean(np.array(ranks) < 1)), "recall@5": float(np.mean(np.array(ranks) < 5))}


def correlations(similarity: NDArray[np.float32], truth: NDArray[np.float32]) -> NDArray[np.float64]:
    """Correlation of similarity and truth over the motions, for each text that is true of some, `(c',)`."""
    told = truth.std(0) > 0.02
    first, second = similarity[:, told], truth[:, told]
    first, second = first - first.mean(0), second - second.mean(0)
    return (first * second).sum(0) / np.sqrt((first**2).sum(0) * (second**2).sum(0))


def side_accuracy(
    encoder: Encoder,
    features: NDArray[np.float32],
    motions: MotionSet,
    captions: CaptionSet,
    texts: Sequence[tuple[str, int]],
) -> float:
    """How often a motion of one side is nearer to its text than to the text with left and right exchanged.

    Args:
        encoder: the encoder.
        features: features of the motions, `(n, d)`.
        motions: the motions.
        captions: whose concepts `texts` point to.
        texts: wordings and the index of their sided concept.

    Returns:
        The share, every text counting the same.
    """
    names = [concept.name for concept in captions.concepts]
    shares = []
    for text, index in texts:
        base, _, side = names[index].rpartition(".")
        if side not in ("left", "right"):
            continue
        partner = names.index(f"{base}.{'left' if side == 'right' else 'right'}")
        chosen = (motions.truths[:, index] > _TRUE) & (motions.truths[:, partner] < _FALSE)
        if chosen.sum() < 5:
            continue
        own, other = encoder.encode_text([text, swap_sides(text)])
        shares.append(float((features[chosen] @ own > features[chosen] @ other).mean()))
    return float(np.mean(shares)) if shares else float("nan")


# Texts that name the same side but another limb, or the same limb the other way up.
LIMB_TEXTS = (
    ("raise the {side} arm", "arm_up.{side}", "raise the {side} knee", "knee_up.{side}"),
    ("kick with the {side} leg", "kick.{side}", "punch with the {side} hand", "punch.{side}"),
    ("stretch the {side} arm forward", "arm_forward.{side}", "raise the {side} leg forward", "leg_forward.{side}"),
    (
        "stretch the {side} arm out to the side",
        "arm_sideways.{side}",
        "raise the {side} leg sideways",
        "leg_side.{side}",
    ),
)
UP_DOWN_TEXTS = (
    ("raise both arms", "arms_up", "lower both arms", "arms_down"),
    ("stand up", "legs_straight", "squat down", "squat"),
    ("look up", "look_up", "look down", "look_down"),
    ("lean back", "lean_back", "bow forward", "bow"),
)


def pair_accuracy(
    encoder: Encoder,
    features: NDArray[np.float32],
    motions: MotionSet,
    captions: CaptionSet,
    pairs: Sequence[tuple[str, str, str, str]],
) -> float:
    """How often a motion that fulfils one of two texts and not the other is nearer to the right one."""
    names = [concept.name for concept in captions.concepts]
    shares = []
    for pair in pairs:
        for side in ("left", "right") if "{side}" in pair[0] else ("",):
            first_text, first, second_text, second = (part.format(side=side) for part in pair)
            if first not in names or second not in names:
                continue
            one, two = encoder.encode_text([first_text, second_text])
            for own, other, right, wrong in ((one, two, first, second), (two, one, second, first)):
                truths = motions.truths[:, [names.index(right), names.index(wrong)]]
                chosen = (truths[:, 0] > _TRUE) & (truths[:, 1] < _FALSE)
                if chosen.sum() >= 5:
                    shares.append(float((features[chosen] @ own > features[chosen] @ other).mean()))
    return float(np.mean(shares)) if shares else float("nan")


def paraphrase_agreement(encoder: Encoder, captions: CaptionSet) -> float:
    """Mean cosine between a held-out wording and the first wording of its concept."""
    held = captions.held_out
    if not held:
        return float("nan")
    own = encoder.encode_text([caption.text for caption in held])
    first = encoder.encode_text([captions.concepts[caption.concepts[0]].phrases[0] for caption in held])
    return float((own * first).sum(1).mean())


def wording_figures(
    encoder: Encoder,
    motions: MotionSet,
    captions: CaptionSet,
    rng: np.random.Generator,
    features: NDArray[np.float32] | None = None,
) -> dict[str, float]:
    """Figures on held-out motions and held-out wordings.

    Args:
        encoder: the encoder.
        motions: held-out motions.
        captions: captions, whose held-out wordings are used.
        rng: draws the searches.
        features: features of the motions; those of the state projection if None.

    Returns:
        Figures by name.
    """
    features = encoder.encode_state(motions.observations) if features is None else features
    truths = motions.truths.astype(np.float32)
    held = [caption for caption in captions.held_out if (truths[:, caption.concepts[0]] > _TRUE).sum() >= 5]
    if not held:
        raise ValueError("The held-out motions fulfil none of the held-out captions; make more motions.")
    similarity = features @ encoder.encode_text([caption.text for caption in held]).T
    truth = captions.truth(held, truths)
    firsts = [(concept.phrases[0], index) for index, concept in enumerate(captions.concepts)]
    correlation = correlations(similarity, truth)
    return {
        **retrieval(similarity, truth, rng),
        "correlation": float(correlation.mean()),
        "worst correlation": float(correlation.min()),
        "left or right": side_accuracy(encoder, features, motions, captions, firsts),
        "which limb": pair_accuracy(encoder, features, motions, captions, LIMB_TEXTS),
        "up or down": pair_accuracy(encoder, features, motions, captions, UP_DOWN_TEXTS),
        "paraphrases": paraphrase_agreement(encoder, captions),
    }
