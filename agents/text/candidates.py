"""What the search tries: sequences of latents that are played over and over, and those of the motion library."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float32]

HELD_CANDIDATES = 384
"""Latents of the motion library that are tried at most, each held."""
ENTRIES = 4
"""Moments of a clip at which playing it may begin."""
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

    @property
    def description(self) -> str:
        """What it is, for reports."""
        return self.name

    def act(self, decision: int, places: FloatArray) -> FloatArray:
        """The latents of a decision.

        Args:
            decision: Decisions since the start of the episode.
            places: Horizontal places of the object in the heading frames of n humanoids, `(n, 2)` metres, for candidates
                that look at it; `(n, 0)` where there is none.

        Returns:
            `(n, 64)`.
        """
        latent = self.latents[decision % len(self.latents)]
        return np.broadcast_to(latent, (len(places), len(latent)))


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
