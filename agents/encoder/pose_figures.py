"""Figures of an encoder on captions of other rules than those of training, and on freely written sentences."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from agents.encoder.pose_facts import FACT_NAMES, FACTS, Array, PoseCaption, pose_captions
from rewards.encoders import Encoder

Features = NDArray[np.float32]

AMONG = 100
MOST_CAPTIONS = 400
"""Captions that figures are taken of, drawn from all that can be written."""
_FEWEST = 5
_RIDGE = 3.0


def rule_figures(
    encoder: Encoder, features: Features, values: Array, rng: np.random.Generator, trials: int = 20
) -> dict[str, float]:
    """Figures on captions by the rules of `pose_facts`.

    Args:
        encoder: reads the captions.
        features: unit features of poses, `(n, d)`.
        values: how far the facts hold of them, `(n, facts)`.
        rng: draws captions, and the hundred poses of each search.
        trials: how often a hundred poses are drawn for each caption.

    Returns:
        Recall among 100 distinct poses, that of :func:`recall_without_words`, the three kinds of minimal pairs, the cosine of
        paraphrases, and how many captions there were.
    """
    captions = pose_captions(values)
    if not captions:
        raise ValueError("Nothing can be said of the held-out poses; make more motions.")
    if len(captions) > MOST_CAPTIONS:
        captions = [
            captions[index] for index in sorted(rng.choice(len(captions), MOST_CAPTIONS, replace=False).tolist())
        ]
    texts = [[caption.texts[wording] for caption in captions] for wording in (0, 1)]
    first, second = _encoded(encoder, texts[0]), _encoded(encoder, texts[1])
    return {
        "captions": float(len(captions)),
        **_recall(features, values, captions, first, rng, trials),
        "recall@1 without words": recall_without_words(features, values, rng, trials),
        "left or right": side_accuracy(encoder, features, values),
        "up or down": pair_accuracy(encoder, features, values, "opposite"),
        "which limb": pair_accuracy(encoder, features, values, "other_limb"),
        "paraphrases": float((first * second).sum(1).mean()),
    }


def _encoded(encoder: Encoder, texts: Sequence[str]) -> Features:
    """Features `(k, d)` of texts that may repeat, each read once."""
    unique = list(dict.fromkeys(texts))
    features = encoder.encode_text(unique)
    place = {text: index for index, text in enumerate(unique)}
    return features[[place[text] for text in texts]]


def _recall(
    features: Features,
    values: Array,
    captions: Sequence[PoseCaption],
    texts: Features,
    rng: np.random.Generator,
    trials: int,
) -> dict[str, float]:
    """Is the pose found by its caption among 99 others of which the caption is clearly not true, no two of them alike?"""
    holds = values >= 0.999
    kinds = np.unique(holds, axis=0, return_inverse=True)[1].ravel()
    ranks = []
    for caption, text in zip(captions, texts, strict=True):
        similarity = features @ text
        denied = np.flatnonzero((values[:, caption.facts] <= 0.001).any(1))
        for _ in range(trials):
            mixed = rng.permutation(denied)
            others = mixed[np.unique(kinds[mixed], return_index=True)[1]]  # one of each kind
            if len(others) < AMONG - 1:
                break
            others = rng.choice(others, AMONG - 1, replace=False)
            ranks.append(int((similarity[others] >= similarity[caption.pose]).sum()))
    if not ranks:
        return {"recall@1": float("nan"), "recall@5": float("nan")}
    return {"recall@1": float(np.mean(np.array(ranks) < 1)), "recall@5": float(np.mean(np.array(ranks) < 5))}


def recall_without_words(features: Features, values: Array, rng: np.random.Generator, trials: int) -> float:
    """What recall would be if all was understood that is said: how much of the facts is in the features of the poses.

    On one half of the poses a direction is fitted to each fact (ridge regression of how far it holds on the feature). On the
    other half the sum of the directions of its facts takes the place of a caption's feature.

    Args:
        features: unit features of poses, `(n, d)`.
        values: how far the facts hold of them, `(n, facts)`.
        rng: draws the halves, and the hundred poses of each search.
        trials: how often a hundred poses are drawn for each caption.
    """
    fitted, kept = np.array_split(rng.permutation(len(features)), 2)
    mean = features[fitted].mean(0)
    centred = (features[fitted] - mean).astype(np.float64)
    penalty = _RIDGE * np.eye(centred.shape[1])
    wanted = values[fitted] - values[fitted].mean(0)
    directions = np.linalg.solve(centred.T @ centred + penalty, centred.T @ wanted).T
    captions = pose_captions(values[kept])
    if len(captions) > MOST_CAPTIONS:
        captions = [captions[index] for index in rng.choice(len(captions), MOST_CAPTIONS, replace=False).tolist()]
    asked = np.array([directions[list(caption.facts)].sum(0) for caption in captions]).reshape(-1, features.shape[1])
    return _recall(features[kept] - mean, values[kept], captions, asked.astype(np.float32), rng, trials)["recall@1"]


def side_accuracy(encoder: Encoder, features: Features, values: Array) -> float:
    """How often a pose of which a sided fact holds, and clearly not its mirror image, is nearer to the right wording."""
    pairs = [
        (index, FACT_NAMES.index(f"{base}.{'left' if side == 'right' else 'right'}"))
        for index, (base, _, side) in enumerate(name.rpartition(".") for name in FACT_NAMES)
        if side in ("left", "right") and base
    ]
    return _accuracy(encoder, features, values, pairs)


def pair_accuracy(encoder: Encoder, features: Features, values: Array, partner: str) -> float:
    """The same for a fact and its partner: "opposite" for the other way up, "other_limb" for another limb."""
    pairs = [
        (index, FACT_NAMES.index(getattr(fact, partner))) for index, fact in enumerate(FACTS) if getattr(fact, partner)
    ]
    return _accuracy(encoder, features, values, pairs)


def _accuracy(encoder: Encoder, features: Features, values: Array, pairs: Sequence[tuple[int, int]]) -> float:
    shares = []
    for right, wrong in pairs:
        chosen = (values[:, right] >= 0.999) & (values[:, wrong] <= 0.001)
        if chosen.sum() < _FEWEST:
            continue
        for wording in (0, 1):
            own, other = encoder.encode_text([FACTS[right].wordings[wording], FACTS[wrong].wordings[wording]])
            shares.append(float((features[chosen] @ own > features[chosen] @ other).mean()))
    return float(np.mean(shares)) if shares else float("nan")


def sentence_figures(encoder: Encoder, features: Features, sentences: Sequence[str]) -> dict[str, float]:
    """Recall of the moments of free sentences, each among the moments of all of them.

    Args:
        encoder: reads the sentences.
        features: unit features of the moments, `(n, d)`.
        sentences: the sentence of each, n.
    """
    similarity = features @ encoder.encode_text(list(sentences)).T
    ranks = (similarity >= np.diag(similarity)).sum(0) - 1
    return {
        "recall@1": float((ranks < 1).mean()),
        "recall@5": float((ranks < 5).mean()),
        "sentences": float(len(ranks)),
    }
