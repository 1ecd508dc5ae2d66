"""Means over runs, how sure they are, and what differs: bootstrap, because shares and distances are far from normal."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy import stats

from agents.ablation.measure import MEASURES
from agents.ablation.plan import Run
from motion_data.metrics import diversity

CONFIDENCE = 0.95
RESAMPLES = 4000
FEWEST = 6
"""Values below which there is no interval: by chance alone five differences have the same sign once in 16 times."""
TEXT_MEASURES = ("clip_s", "success")
"""What is given for each text apart."""

Interval = dict[str, float | int | None]
"""`mean`; `low` and `high`, the ends of the interval, None for fewer than `FEWEST` values; `least` and `most`, the lowest and
the highest value; `count`."""


def interval(values: Sequence[float | None]) -> Interval | None:
    """Mean of some values with its 95 % bootstrap interval, or None if none is known.

    The interval is BCa (Efron 1987), expanded for few values: resampling n values shows only (n - 1) / n of their variance,
    and an estimated spread needs Student's quantile. Both are made good by a higher nominal level, as in the expanded
    percentile interval of Hesterberg 2015 ("What teachers should know about the bootstrap").

    Args:
        values: One value for each run; None and NaN count as unknown.
    """
    known = np.array([value for value in values if value is not None and np.isfinite(value)], float)
    if not len(known):
        return None
    count, mean = len(known), float(known.mean())
    low: float | None = None
    high: float | None = None
    if count >= FEWEST and np.ptp(known) == 0:
        low = high = mean
    elif count >= FEWEST:
        student = stats.t.ppf((1 + CONFIDENCE) / 2, count - 1) * np.sqrt(count / (count - 1))
        ends = stats.bootstrap(
            (known,),
            np.mean,
            n_resamples=RESAMPLES,
            confidence_level=float(1 - 2 * stats.norm.cdf(-student)),
            method="BCa",
            rng=np.random.default_rng(0),
        ).confidence_interval
        if np.isfinite([ends.low, ends.high]).all():
            low, high = float(ends.low), float(ends.high)
    return {
        "mean": mean,
        "low": low,
        "high": high,
        "least": float(known.min()),
        "most": float(known.max()),
        "count": count,
    }


def rank_correlation(pairs: Sequence[tuple[float | None, float | None]]) -> Interval | None:
    """Spearman's rank correlation with its 95 % bootstrap interval (percentiles).

    Args:
        pairs: Two numbers of each run; pairs with an unknown one are left out.

    Returns:
        `mean` (of the pairs as they are), `low`, `high` and `count`; None for fewer than `FEWEST` pairs, or equal numbers.
    """
    known = np.array([pair for pair in pairs if None not in pair], float)
    if len(known) < FEWEST or (np.ptp(known, axis=0) == 0).any():
        return None
    rows = np.random.default_rng(0).integers(len(known), size=(RESAMPLES, len(known)))
    rows[0] = np.arange(len(known))  # the first are the runs as they are
    drawn = known[rows]
    drawn = drawn[(np.ptp(drawn, axis=1) > 0).all(-1)]  # equal numbers have no order
    ranks = stats.rankdata(drawn, axis=1)
    ranks -= ranks.mean(1, keepdims=True)
    values = ranks.prod(-1).sum(1) / np.sqrt((ranks**2).sum(1).prod(-1))
    tail = (1 - CONFIDENCE) / 2
    low, high = np.quantile(values, [tail, 1 - tail])
    return {"mean": float(values[0]), "low": float(low), "high": float(high), "count": len(known)}


def summarise(runs: Sequence[Run], values: Sequence[dict[str, Any]], rewards: Sequence[str]) -> dict[str, Any]:
    """Everything that the report states about the finished runs.

    Args:
        runs: The finished runs.
        values: What :func:`agents.ablation.measure.measure_run` says about each.
        rewards: All rewards, the first of which is what the others are compared with.

    Returns:
        `rewards`: for each reward an interval of each measure over its runs, and of `diversity`, between episodes of all
        texts, over those of its seeds that have all texts. `differences`: for each other reward the same of the differences
        to the first, each between runs of one text and seed. `texts`: by text and reward an interval of each of
        `TEXT_MEASURES`. `agreement`: the rank correlation of CLIP_S and success over all runs. All are JSON values.
    """
    table = list(zip(runs, values, strict=True))
    keys = [measure.key for measure in MEASURES]
    by_reward: dict[str, Any] = {}
    differences: dict[str, Any] = {}
    base = {(run.text, run.seed): each for run, each in table if run.reward == rewards[0]}
    for reward in rewards:
        own = [(run, each) for run, each in table if run.reward == reward]
        by_reward[reward] = {key: interval([each[key] for _, each in own]) for key in keys}
        by_reward[reward]["diversity"] = interval(_diversities(own, {run.text for run in runs}))
        by_reward[reward]["runs"] = len(own)
        if reward == rewards[0]:
            continue
        pairs = [(each, base[run.text, run.seed]) for run, each in own if (run.text, run.seed) in base]
        differences[reward] = {
            key: interval([one[key] - two[key] for one, two in pairs if None not in (one[key], two[key])])
            for key in keys
        }
    texts = {
        text: {
            reward: {
                key: interval([each[key] for run, each in table if (run.text, run.reward) == (text, reward)])
                for key in TEXT_MEASURES
            }
            for reward in rewards
        }
        for text in dict.fromkeys(run.text for run in runs)
    }
    agreement = rank_correlation([(each["clip_s"], each["success"]) for each in values])
    return {"rewards": by_reward, "differences": differences, "texts": texts, "agreement": agreement}


def _diversities(own: Sequence[tuple[Run, dict[str, Any]]], texts: set[str]) -> list[float]:
    """Diversity of the episodes of each seed that was trained on all texts; on fewer it would be smaller for that alone."""
    found = []
    for seed in dict.fromkeys(run.seed for run, _ in own):
        trained = [(run, each) for run, each in own if run.seed == seed]
        features = [row for _, each in trained for row in each["episode_features"]]
        if {run.text for run, _ in trained} == texts and len(features) > 1:
            found.append(diversity(np.array(features), np.random.default_rng(0)))
    return found
