"""Warm start: which latent, simply held, earns the most reward?

A policy over unit latents that starts from nothing plays a random direction at every decision, and most of its first
minutes go into finding out that the motion library's own latents are the sensible ones. The search tries those first:
every humanoid of the batch holds one candidate for some seconds; the best are kept, varied and mixed for a few rounds
(a cross-entropy search, Rubinstein 1999). The winner becomes the bias of the policy's last layer; PPO then makes it
depend on the state. Only the environment's reward is used.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray

HOLD_DECISIONS = 30
"""Decisions (1/6 s) for which a candidate is held: 5 s."""
SETTLE_DECISIONS = 9
"""Decisions at the start that do not count: 1.5 s for getting from standing into the motion."""
LIBRARY_SIZE = 512
"""Latents of the motion library that are tried at most."""
ELITE = 12
"""Candidates that survive a round."""
SPREAD = 0.04
"""Standard deviation of a variation in each of the 64 numbers of a unit latent: about 18 degrees."""


@dataclass(frozen=True)
class SearchResult:
    """What the search found.

    Attributes:
        latent: The best unit latent, `(64,)` float32.
        name: The library clip that it descends from.
        reward: Its mean reward per decision.
        library_rewards: Name of each library clip and the mean reward of its best latent, best first.
        candidates: How many latents were tried.
        curve: Mean reward of the best candidate after each round.
    """

    latent: NDArray[np.float32]
    name: str
    reward: float
    library_rewards: dict[str, float]
    candidates: int
    curve: list[float]


def _unit(vectors: NDArray[np.floating]) -> NDArray[np.float32]:
    return (vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)).astype(np.float32)


def held_rewards(env: VectorEnv, latents: NDArray[np.float32], seed: int) -> NDArray[np.float64]:
    """Mean reward per decision of latents that are held from a standing start.

    Args:
        env: A latent environment of n humanoids.
        latents: Unit latents, `(k, 64)`, k at most n.
        seed: Seed of the start states.

    Returns:
        Mean reward after the settling time, `(k,)`; decisions after a termination count 0.
    """
    count = len(latents)
    actions = np.resize(latents, (env.num_envs, latents.shape[1]))
    env.reset(seed=seed)
    alive = np.ones(env.num_envs, bool)
    total = np.zeros(env.num_envs)
    for decision in range(HOLD_DECISIONS):
        _, reward, terminated, _, _ = env.step(actions)
        if decision >= SETTLE_DECISIONS:
            total += np.where(alive, reward, 0.0)
        alive &= ~terminated
    return total[:count] / (HOLD_DECISIONS - SETTLE_DECISIONS)


class _Population:
    """Candidates with the mean of all their trials, so that one lucky trial does not win."""

    def __init__(self) -> None:
        self.latents: list[NDArray[np.float32]] = []
        self.names: list[str] = []
        self.sums: list[float] = []
        self.trials: list[int] = []

    def add(self, latent: NDArray[np.float32], name: str) -> int:
        self.latents.append(latent)
        self.names.append(name)
        self.sums.append(0.0)
        self.trials.append(0)
        return len(self.latents) - 1

    def try_all(self, env: VectorEnv, ids: list[int], seeds: np.random.Generator) -> None:
        for start in range(0, len(ids), env.num_envs):
            chosen = ids[start : start + env.num_envs]
            rewards = held_rewards(env, np.stack([self.latents[i] for i in chosen]), int(seeds.integers(2**31)))
            for index, reward in zip(chosen, rewards, strict=True):
                self.sums[index] += float(reward)
                self.trials[index] += 1

    def means(self) -> NDArray[np.float64]:
        return np.array(self.sums) / np.maximum(self.trials, 1)

    def best(self, count: int) -> list[int]:
        return np.argsort(-self.means(), kind="stable")[:count].tolist()


def search_latent(
    env: VectorEnv,
    latents: NDArray[np.float32],
    names: Sequence[str] | NDArray[np.str_],
    rng: np.random.Generator,
    rounds: int = 4,
) -> SearchResult:
    """Finds a latent that earns a high reward when it is held.

    Args:
        env: A latent environment of n humanoids with the reward to be maximised.
        latents: Unit latents to begin with, `(k, 64)`; at most `LIBRARY_SIZE` of them are tried, evenly spaced.
        names: The clip of each latent, `(k,)`.
        rng: Draws variations and start states.
        rounds: Rounds of variation after the library itself was tried; each takes n x 5 s of simulated time.

    Returns:
        The best latent, and what was seen on the way.

    Raises:
        ValueError: If the library is empty.
    """
    if not len(latents):
        raise ValueError("The search needs at least one latent to begin with; the controller's latents are missing.")
    population = _Population()
    chosen = np.unique(np.linspace(0, len(latents) - 1, LIBRARY_SIZE).round().astype(int))
    library_ids = [population.add(_unit(latents[index]), str(names[index])) for index in chosen]
    population.try_all(env, library_ids, rng)
    population.try_all(env, population.best(env.num_envs), rng)  # a second trial for the better ones
    curve = [float(population.means().max())]
    for _ in range(rounds):
        elite = population.best(ELITE)
        ids = list(elite)
        while len(ids) < max(env.num_envs, 2 * ELITE):
            first, second = rng.choice(elite, 2)
            mix = rng.uniform()
            parent = mix * population.latents[first] + (1 - mix) * population.latents[second]
            child = _unit(_unit(parent) + rng.normal(0.0, SPREAD, parent.shape))
            ids.append(population.add(child, population.names[first if mix >= 0.5 else second]))
        population.try_all(env, ids, rng)
        curve.append(float(population.means()[elite].max()))
    # Those that survived a round were tried at least twice.
    means = np.where(np.array(population.trials) >= 2, population.means(), -np.inf)
    winner = int(means.argmax())
    library_rewards: dict[str, float] = {}
    for index in library_ids:
        name, reward = population.names[index], float(population.means()[index])
        library_rewards[name] = max(reward, library_rewards.get(name, -np.inf))
    return SearchResult(
        latent=population.latents[winner],
        name=population.names[winner],
        reward=float(means[winner]),
        library_rewards=dict(sorted(library_rewards.items(), key=lambda item: -item[1])),
        candidates=len(population.latents),
        curve=curve,
    )


def summary(result: SearchResult) -> dict[str, Any]:
    """What a report says about the search: JSON values without the latent itself."""
    best = dict(list(result.library_rewards.items())[:5])
    return {
        "start": result.name,
        "reward": result.reward,
        "candidates": result.candidates,
        "curve": result.curve,
        "best_of_library": best,
    }
