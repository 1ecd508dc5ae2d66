"""Warm start: which piece of the motion library, played through the controller, earns the most reward?

A policy over unit latents that starts from nothing plays a random direction at every decision, and most of its first
minutes go into finding out that the motion library's own latents are the sensible ones. The search tries those first.
A candidate is a sequence of latents that is played over and over, one per decision: a single latent that is held, two
that alternate, or all latents of a clip. Every humanoid of the batch plays one candidate for some seconds; the best are
kept, varied and mixed for a few rounds (a cross-entropy search, Rubinstein 1999). Where the policy sees an object, candidates
that walk to it and do something there are searched for as well (`agents.text.steering`). The policy then starts from the
winner, and PPO makes it depend on the state and improves it. Only the environment's reward is used.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar

import numpy as np
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray

from agents.text.candidates import HELD_CANDIDATES, Candidate, FloatArray, library_candidates, vary
from agents.text.steering import SteeredCandidate, SteeredCandidates, object_columns, sees_object

_Kind = TypeVar("_Kind", bound=Candidate)

TRIAL_DECISIONS = 30
"""Decisions (1/6 s) for which a candidate is played: 5 s."""
LONG_TRIAL_DECISIONS = 60
"""Decisions for which a candidate that did well is played again: 10 s, a whole episode."""
SETTLE_DECISIONS = 9
"""Decisions at the start that do not count: 1.5 s for getting from standing into the motion."""
ELITE = 12
"""Candidates that survive a round."""
STEERED_ROUNDS = 4
"""Rounds of variation of candidates that look at an object, for each of the others, if there is time."""
FINALISTS = 4
"""Candidates of each kind that are played by many humanoids at last: where objects stand at random, luck wins in few trials."""


@dataclass(frozen=True)
class SearchResult:
    """What the search found.

    Attributes:
        held: The best candidate with a single latent.
        played: The best candidate with a sequence of latents; None if there was none.
        steered: The best candidate that looks at an object; None where none is seen.
        library_rewards: Name of each library clip and its best reward before any variation, best first.
        tried: How many candidates were tried.
        curve: Best mean reward after the library was tried, and after each round.
    """

    held: Candidate
    played: Candidate | None
    steered: SteeredCandidate | None
    library_rewards: dict[str, float]
    tried: int
    curve: list[float]


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
    all_humanoids: bool = False,
) -> None:
    """Plays each candidate from a standing start and adds what it earned to its rewards.

    Args:
        env: A latent environment of n humanoids.
        candidates: Any number; they are played n at a time.
        alive_bonus: See :class:`Earnings`.
        rng: Draws the seeds of the start states.
        decisions: Length of the trial.
        all_humanoids: Whether what the left-over humanoids earn counts, too, who repeat the first candidates.
    """
    columns = object_columns(env)
    for start in range(0, len(candidates), env.num_envs):
        chosen = candidates[start : start + env.num_envs]
        # the humanoids that are left over repeat the first ones
        rows = [np.arange(first, env.num_envs, len(chosen)) for first in range(len(chosen))]
        observation, _ = env.reset(seed=int(rng.integers(2**31)))
        earnings = Earnings(env.num_envs, alive_bonus)
        for decision in range(decisions):
            places = observation[:, columns]
            actions = np.empty((env.num_envs, chosen[0].latents.shape[1]), np.float32)
            for candidate, own in zip(chosen, rows, strict=True):
                actions[own] = candidate.act(decision, places[own])
            observation, reward, terminated, _, _ = env.step(actions)
            earnings.add(reward, terminated)
        earned = earnings.means()
        for candidate, own in zip(chosen, rows, strict=True):
            candidate.rewards += earned[own if all_humanoids else own[:1]].tolist()


def best(candidates: Sequence[_Kind], count: int, trials: int = 1) -> list[_Kind]:
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
    # Where an object is seen, half of the time is for what looks at it.
    sees = sees_object(env)
    end = started + (seconds / 2 if sees else seconds)
    curve = [best(population, 1, trials=2)[0].reward]
    curve += refine(env, population, partial(vary, rng=rng), alive_bonus, rng, rounds, end, TRIAL_DECISIONS)
    ranking = best(population, len(population), trials=2)
    played = [candidate for candidate in ranking if not candidate.held]
    held = [candidate for candidate in ranking if candidate.held] or best(library[:HELD_CANDIDATES], 1)
    steered: list[SteeredCandidate] = []
    tried = len(population)
    if sees:
        candidates = SteeredCandidates(latents, names, ranking[: 4 * ELITE], rng)
        steered = [candidates.draw() for _ in range(2 * env.num_envs)]
        # Whole episodes from the start: it takes a while to get there.
        try_candidates(env, steered, alive_bonus, rng, LONG_TRIAL_DECISIONS)
        try_candidates(env, best(steered, env.num_envs), alive_bonus, rng, LONG_TRIAL_DECISIONS)
        # They have more parts than others, so they are varied for as long as there is time.
        most = STEERED_ROUNDS * rounds
        refine(env, steered, candidates.vary, alive_bonus, rng, most, started + seconds, LONG_TRIAL_DECISIONS)
        tried += len(steered)
        steered = play_finals(env, best(steered, FINALISTS, trials=2), alive_bonus, rng)
        held, played = (play_finals(env, kind[:FINALISTS], alive_bonus, rng) for kind in (held, played))
        curve.append(steered[0].reward)
    return SearchResult(
        held[0],
        played[0] if played else None,
        steered[0] if steered else None,
        library_rewards,
        tried,
        curve,
    )


def play_finals(
    env: VectorEnv, finalists: Sequence[_Kind], alive_bonus: float, rng: np.random.Generator
) -> list[_Kind]:
    """A few candidates, best first, after every humanoid of the batch has played one of them for a whole episode."""
    for finalist in finalists:
        finalist.rewards.clear()  # what made them finalists was partly luck
    if finalists:
        try_candidates(env, finalists, alive_bonus, rng, LONG_TRIAL_DECISIONS, all_humanoids=True)
    return best(finalists, len(finalists))


def refine(
    env: VectorEnv,
    population: list[_Kind],
    child: Callable[[Sequence[_Kind]], _Kind],
    alive_bonus: float,
    rng: np.random.Generator,
    rounds: int,
    end: float,
    decisions: int,
) -> list[float]:
    """Adds to a population in rounds: children of the best are tried, and the best of these again for a whole episode.

    Args:
        env: A latent environment of n humanoids; a round has n children.
        population: Candidates that were tried; the elite of a round are those that were tried twice.
        child: Makes a candidate of the elite.
        alive_bonus: See :class:`Earnings`.
        rng: Draws start states.
        rounds: How many.
        end: No new round begins after this time, as `time.monotonic` tells it.
        decisions: Length of a child's first trial.

    Returns:
        The best mean reward after each round.
    """
    curve = []
    for _ in range(rounds):
        if time.monotonic() > end:
            break
        elite = best(population, ELITE, trials=2)
        children = [child(elite) for _ in range(env.num_envs)]
        try_candidates(env, children, alive_bonus, rng, decisions)
        population += children
        again = elite + best(children, max(env.num_envs - ELITE, 1))
        try_candidates(env, again, alive_bonus, rng, LONG_TRIAL_DECISIONS)
        curve.append(best(population, 1, trials=2)[0].reward)
    return curve


def summary(result: SearchResult) -> dict[str, Any]:
    """What a report says about the search: JSON values without the latents themselves."""
    kinds = {"held": result.held, "played": result.played, "steered": result.steered}
    return {
        **{kind: one and {"clip": one.description, "reward": one.reward} for kind, one in kinds.items()},
        "tried": result.tried,
        "curve": result.curve,
        "best_of_library": dict(list(result.library_rewards.items())[:5]),
    }
