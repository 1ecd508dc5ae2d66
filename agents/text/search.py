"""Warm start: which piece of the motion library, played through the controller, earns the most reward?

A policy over unit latents that starts from nothing plays a random direction at every decision, and most of its first
minutes go into finding out that the motion library's own latents are the sensible ones. The search tries those first.
A candidate is a sequence of latents that is played over and over, one per decision: a single latent that is held, two
that alternate, or all latents of a clip. Every humanoid of the batch plays one candidate for some seconds; the best are
kept, varied and mixed for a few rounds (a cross-entropy search, Rubinstein 1999). The policy then starts from the winner,
and PPO makes it depend on the state and improves it. Only the environment's reward is used.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray

FloatArray = NDArray[np.float32]

TRIAL_DECISIONS = 30
"""Decisions (1/6 s) for which a candidate is played: 5 s."""
LONG_TRIAL_DECISIONS = 60
"""Decisions for which a candidate that did well is played again: 10 s, a whole episode."""
SETTLE_DECISIONS = 9
"""Decisions at the start that do not count: 1.5 s for getting from standing into the motion."""
HELD_CANDIDATES = 384
"""Latents of the motion library that are tried at most, each held."""
ENTRIES = 4
"""Moments of a clip at which playing it may begin."""
ELITE = 12
"""Candidates that survive a round."""
SPREAD = 0.04
"""Standard deviation of a variation in each of the 64 numbers of a unit latent: about 18 degrees."""


@dataclass
class Candidate:
    """A sequence of unit latents `(L, 64)`, played over and over, and the rewards that its trials earned.

    Attributes:
        latents: The sequence; a held latent has L = 1.
        name: The library clips that it descends from.
        rewards: Mean reward per decision of each trial.
    """

    latents: FloatArray
    name: str
    rewards: list[float] = field(default_factory=list)

    @property
    def held(self) -> bool:
        """Whether it is one latent that is held."""
        return len(self.latents) == 1

    @property
    def reward(self) -> float:
        """Mean over its trials."""
        return float(np.mean(self.rewards)) if self.rewards else -np.inf

    def unrolled(self, decisions: int) -> FloatArray:
        """The latents of some decisions, `(decisions, 64)`."""
        return self.latents[np.arange(decisions) % len(self.latents)]


@dataclass(frozen=True)
class SearchResult:
    """What the search found.

    Attributes:
        held: The best candidate with a single latent.
        played: The best candidate with a sequence of latents; None if there was none.
        library_rewards: Name of each library clip and its best reward before any variation, best first.
        tried: How many candidates were tried.
        curve: Best mean reward after the library was tried, and after each round.
    """

    held: Candidate
    played: Candidate | None
    library_rewards: dict[str, float]
    tried: int
    curve: list[float]


def unit(vectors: NDArray[np.floating]) -> FloatArray:
    """Vectors `(..., d)` scaled to length 1."""
    return (vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)).astype(np.float32)


def library_candidates(latents: FloatArray, names: Sequence[str] | NDArray[np.str_]) -> list[Candidate]:
    """The candidates that a motion library offers: its clips played, and evenly spaced latents held.

    Args:
        latents: Unit latents, `(k, 64)`, those of a clip one after the other, one per decision.
        names: The clip of each latent, `(k,)`.

    Raises:
        ValueError: There are no latents.
    """
    if not len(latents):
        raise ValueError("The search needs at least one latent to begin with; the controller's latents are missing.")
    names = np.asarray(names)
    chosen = np.unique(np.linspace(0, len(latents) - 1, HELD_CANDIDATES).round().astype(int))
    held = [Candidate(unit(latents[[index]]), str(names[index])) for index in chosen]
    # A clip is entered at several moments: from a stand, a stride that begins with the free leg is easier than another.
    played = [
        Candidate(unit(np.roll(latents[names == name], -shift, axis=0)), str(name))
        for name, count in zip(*np.unique(names, return_counts=True), strict=True)
        for shift in sorted({int(count * quarter / ENTRIES) for quarter in range(ENTRIES)})
    ]
    return held + [candidate for candidate in played if not candidate.held]


class Earnings:
    """What humanoids earn on average in a trial, counted after the settling time.

    A decision after a termination counts minus the alive bonus: as bad as going without the bonus while others get it.

    Args:
        count: Number of humanoids n.
        alive_bonus: Bonus for a decision without a fall.
    """

    def __init__(self, count: int, alive_bonus: float) -> None:
        self.alive = np.ones(count, bool)
        self._alive_bonus = alive_bonus
        self._sums = np.zeros(count)
        self._rewards_while_up: list[float] = []
        self._decisions = 0

    def add(self, reward: NDArray[np.floating], terminated: NDArray[np.bool_]) -> None:
        """Counts one decision: rewards and terminations `(n,)`."""
        if self._decisions >= SETTLE_DECISIONS:
            self._sums += np.where(self.alive, reward, -self._alive_bonus)
            self._rewards_while_up += np.asarray(reward)[self.alive].tolist()
        self._decisions += 1
        self.alive &= ~terminated

    @property
    def mean_while_up(self) -> float:
        """Mean over all humanoids and the decisions before their falls."""
        return float(np.mean(self._rewards_while_up)) if self._rewards_while_up else -np.inf

    def means(self) -> NDArray[np.float64]:
        """Mean per decision, `(n,)`."""
        return self._sums / max(self._decisions - SETTLE_DECISIONS, 1)


def try_candidates(
    env: VectorEnv,
    candidates: Sequence[Candidate],
    alive_bonus: float,
    rng: np.random.Generator,
    decisions: int = TRIAL_DECISIONS,
) -> None:
    """Plays each candidate once from a standing start and adds what it earned to its rewards.

    Args:
        env: A latent environment of n humanoids.
        candidates: Any number; they are played n at a time.
        alive_bonus: See :class:`Earnings`.
        rng: Draws the seeds of the start states.
        decisions: Length of the trial.
    """
    for start in range(0, len(candidates), env.num_envs):
        chosen = candidates[start : start + env.num_envs]
        # the humanoids that are left over repeat the first ones
        plans = np.stack([chosen[i % len(chosen)].unrolled(decisions) for i in range(env.num_envs)])
        env.reset(seed=int(rng.integers(2**31)))
        earnings = Earnings(env.num_envs, alive_bonus)
        for decision in range(decisions):
            _, reward, terminated, _, _ = env.step(plans[:, decision])
            earnings.add(reward, terminated)
        for candidate, earned in zip(chosen, earnings.means(), strict=False):
            candidate.rewards.append(float(earned))


def vary(elite: Sequence[Candidate], rng: np.random.Generator) -> Candidate:
    """A new candidate from one or two of the elite.

    Two held latents are mixed, or alternate, each held for one to three decisions: a rhythm that no held latent has, such
    as that of waving. Anything else is one of the elite. A small random offset, the same for the whole sequence, is added.
    """
    first, second = (elite[index] for index in rng.integers(len(elite), size=2))
    latents, name = first.latents, first.name
    if first.held and second.held:
        name = name if second.name == name else f"{name} + {second.name}"
        if rng.uniform() < 0.5:
            mix = rng.uniform()
            latents = unit(mix * first.latents + (1 - mix) * second.latents + 1e-6)
        else:
            latents = np.repeat(np.concatenate([first.latents, second.latents]), rng.integers(1, 4), axis=0)
    return Candidate(unit(latents + rng.normal(0.0, SPREAD, latents.shape[1])), name)


def best(candidates: Sequence[Candidate], count: int, trials: int = 1) -> list[Candidate]:
    """The candidates with the highest mean reward among those with enough trials, best first."""
    known = [candidate for candidate in candidates if len(candidate.rewards) >= trials]
    return sorted(known, key=lambda candidate: -candidate.reward)[:count]


def search(
    env: VectorEnv,
    latents: FloatArray,
    names: Sequence[str] | NDArray[np.str_],
    alive_bonus: float,
    rng: np.random.Generator,
    rounds: int = 4,
    seconds: float = np.inf,
) -> SearchResult:
    """Finds latents that earn a high reward.

    Args:
        env: A latent environment of n humanoids with the reward to be maximised.
        latents: The library's unit latents, `(k, 64)`; see :func:`library_candidates`.
        names: The clip of each latent, `(k,)`.
        alive_bonus: What a fall loses at every decision; see :class:`Earnings`.
        rng: Draws variations and start states.
        rounds: Rounds of variation after the library was tried; each takes n x 5 s of simulated time.
        seconds: No new round begins after this time, so that a slow machine has time left for learning.

    Returns:
        The best candidates, and what was seen on the way.

    Raises:
        ValueError: If there are no latents.
    """
    started = time.monotonic()
    library = library_candidates(latents, names)
    try_candidates(env, library, alive_bonus, rng)
    # a second, longer trial, so that neither luck nor a late fall wins
    try_candidates(env, best(library, env.num_envs), alive_bonus, rng, LONG_TRIAL_DECISIONS)
    library_rewards: dict[str, float] = {}
    for candidate in best(library, len(library)):
        library_rewards.setdefault(candidate.name, candidate.reward)
    population = list(library)
    curve = [best(population, 1, trials=2)[0].reward]
    for _ in range(rounds):
        if time.monotonic() - started > seconds:
            break
        elite = best(population, ELITE, trials=2)
        children = [vary(elite, rng) for _ in range(env.num_envs)]
        try_candidates(env, children, alive_bonus, rng)
        population += children
        again = elite + best(children, max(env.num_envs - ELITE, 1))
        try_candidates(env, again, alive_bonus, rng, LONG_TRIAL_DECISIONS)
        curve.append(best(population, 1, trials=2)[0].reward)
    ranking = best(population, len(population), trials=2)
    played = [candidate for candidate in ranking if not candidate.held]
    held = [candidate for candidate in ranking if candidate.held] or best(library[:HELD_CANDIDATES], 1)
    return SearchResult(held[0], played[0] if played else None, library_rewards, len(population), curve)


def summary(result: SearchResult) -> dict[str, Any]:
    """What a report says about the search: JSON values without the latents themselves."""
    return {
        "held": {"clip": result.held.name, "reward": result.held.reward},
        "played": None if result.played is None else {"clip": result.played.name, "reward": result.played.reward},
        "tried": result.tried,
        "curve": result.curve,
        "best_of_library": dict(list(result.library_rewards.items())[:5]),
    }
