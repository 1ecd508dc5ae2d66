"""Candidates of the search that look at an object: walk to it, then do something there.

Without them a policy begins with something that is played blindly, and has to find out by PPO that turning towards an
object pays. A steered candidate plays one piece of the motion library while it is far from the object, turned towards it by
a direction in latent space, and another piece within reach. Which pieces, which direction and which reach is searched for,
with the environment's reward alone; position of the object is what the policy observes, too, so a blind one has none.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray

from agents.text.candidates import SPREAD, Candidate, FloatArray, unit
from anyskill_envs.objects.state import observation_layout
from anyskill_envs.observation import OBSERVATION_SIZE
from motion_data.library import MotionLibrary

TURNING = "move_around"
"""Category of the clips that bring a humanoid somewhere."""
GAINS = (0.5, 1.0, 2.0)
"""How far latents are moved along a direction per radian of the object's bearing."""
REACH = (0.3, 1.2)
"""Distances from the pelvis to the object, metres, at which it may be within reach."""
_BACK_FIRST = 0.25  # share of the draws that turn their back on the object, as one who sits down does
_STAYS = 0.5  # share of the draws that go on with what they do at the object
_NEVER = np.iinfo(np.int64).max
_EXCHANGED = 0.3  # share of the variations with another random part


@dataclass(kw_only=True)
class SteeredCandidate(Candidate):
    """Plays its latents, turned towards the object, until it is within reach, and another candidate from then on.

    Attributes:
        doing: What is played within reach.
        turn: What is added to a latent per radian to the left in which the object is seen, up to one radian, `(64,)`; of one
            who goes back first, per radian to the left of straight behind.
        reach: Distance in metres.
        back_first: Whether the back is turned to the object instead of the face.
        stays: Whether whoever has once been within reach goes on with it, from its beginning, wherever the object is then: a
            door that was kicked open, or a step back, does not interrupt. Others set out again after a ball that rolls away.
    """

    doing: Candidate
    turn: FloatArray
    reach: float
    back_first: bool = False
    stays: bool = False
    _arrived: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64), repr=False)

    @property
    def description(self) -> str:
        """How it goes to the object, and what it does there."""
        manner = f"{' back first' if self.back_first else ''}{', once' if self.stays else ''}"
        return f"{self.name} to it{manner}, {self.doing.description}"

    def act(self, decision: int, places: FloatArray) -> FloatArray:
        """Latents `(n, 64)` for objects at `(n, 2)` in the heading frame; decision 0 begins an episode of these humanoids."""
        ahead = -places if self.back_first else places
        bearing = np.clip(np.arctan2(ahead[:, 1], ahead[:, 0]), -1.0, 1.0)
        far = unit(super().act(decision, places) + bearing[:, None] * self.turn)
        within = np.linalg.norm(places, axis=1) < self.reach
        if not self.stays:
            return np.where(within[:, None], self.doing.act(decision, places), far)
        if decision == 0:
            self._arrived = np.full(len(places), _NEVER)
        self._arrived = np.minimum(self._arrived, np.where(within, decision, _NEVER))
        since = decision - np.minimum(self._arrived, decision)
        doing = self.doing.latents[since % len(self.doing.latents)]
        return np.where((self._arrived <= decision)[:, None], doing, far)


def object_columns(env: VectorEnv) -> slice:
    """Where the observation has the horizontal place of the first object; empty if there is none or it is not observed."""
    unwrapped: Any = env.unwrapped
    scene = getattr(unwrapped, "scene", None)
    if not scene or not unwrapped.object_observation:
        return slice(0, 0)
    place = observation_layout(scene).get(f"{next(iter(scene.parts))}.position")
    return slice(0, 0) if place is None else slice(OBSERVATION_SIZE + place.start, OBSERVATION_SIZE + place.start + 2)


def sees_object(env: VectorEnv) -> bool:
    """Whether the observation tells where an object is."""
    return object_columns(env).stop > 0


class SteeredCandidates:
    """Draws and varies steered candidates.

    Args:
        latents: The library's unit latents, `(k, 64)`.
        names: The clip of each, `(k,)`.
        doings: Candidates that may be played at the object, best first.
        rng: All randomness.
    """

    def __init__(
        self,
        latents: FloatArray,
        names: Sequence[str] | NDArray[np.str_],
        doings: Sequence[Candidate],
        rng: np.random.Generator,
    ) -> None:
        self._rng, self._latents, self._names = rng, latents, np.asarray(names)
        clips = MotionLibrary.default(mirrored=False).clips
        going = {clip.name for clip in clips if TURNING in clip.categories} & set(self._names)
        # Clips that the library does not know, of a controller for other ones, may all be good for going.
        self._going = np.flatnonzero(np.isin(self._names, sorted(going)) if going else np.ones(len(self._names), bool))
        self._turns = [self._turn(name) for name in sorted(going or set(self._names)) if self._twin(name)]
        self._doings = list(doings)

    def _twin(self, name: str) -> str | None:
        other = name.replace("left", "right")
        return other if other != name and other in self._names else None

    def _turn(self, name: str) -> FloatArray:
        """From going right to going left."""
        twin = self._twin(name)
        turn: FloatArray = self._latents[self._names == name].mean(0) - self._latents[self._names == twin].mean(0)
        return turn

    def draw(self) -> SteeredCandidate:
        """A random one: going by any travelling clip, turned by any pair of twins, doing one of the better things."""
        index = self._rng.choice(self._going)
        turn = np.zeros(self._latents.shape[1], np.float32)
        if self._turns:
            turn = self._turns[self._rng.integers(len(self._turns))] * np.float32(self._rng.choice([0.0, *GAINS]))
        # Squared: the better ones more often.
        doing = self._doings[int(len(self._doings) * self._rng.uniform() ** 2)]
        return SteeredCandidate(
            latents=unit(self._latents[[index]]),
            name=str(self._names[index]),
            doing=doing,
            turn=turn,
            reach=float(self._rng.uniform(*REACH)),
            back_first=bool(self._rng.uniform() < _BACK_FIRST),
            stays=bool(self._rng.uniform() < _STAYS),
        )

    def vary(self, elite: Sequence[SteeredCandidate]) -> SteeredCandidate:
        """A new one with the parts of two of the elite, sometimes with one part drawn anew, all a little changed."""
        rng = self._rng
        first, second = (elite[index] for index in rng.integers(len(elite), size=2))
        other = self.draw() if rng.uniform() < _EXCHANGED else second
        taken = rng.uniform(size=5) < 0.5
        size = self._latents.shape[1]
        going, doing = (other if taken[0] else first), (other if taken[1] else first).doing
        return SteeredCandidate(
            latents=unit(going.latents + rng.normal(0.0, SPREAD, size)),
            name=going.name,
            back_first=going.back_first,
            stays=(other if taken[4] else first).stays,
            doing=Candidate(unit(doing.latents + rng.normal(0.0, SPREAD, size)), doing.name),
            turn=(other if taken[2] else first).turn * np.float32(np.exp(rng.normal(0.0, 0.3))),
            reach=float((other if taken[3] else first).reach * np.exp(rng.normal(0.0, 0.2))),
        )
