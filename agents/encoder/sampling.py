"""Draws batches of motions and captions."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from agents.encoder.captions import CaptionSet
from agents.encoder.concepts import Concept
from agents.encoder.dataset import MotionSet
from agents.encoder.scenes import ObjectLayout
from anyskill_envs.observation import MIRROR_INDEX, MIRROR_SIGN, OBSERVATION_LAYOUT


def concept_weights(concepts: Sequence[Concept], relation_share: float) -> NDArray[np.float64]:
    """How often motions are drawn for the sake of each concept, `(concepts,)`; adds up to 1.

    What is true of an object is true of few motions, and it is what a policy climbs: relations to objects share a part of
    the draws of their own.

    Args:
        concepts: the concepts; relations are named "ball:kicking".
        relation_share: that part, from 0 to 1; without relations it goes to the others.
    """
    related = np.array([":" in concept.name for concept in concepts])
    weights = np.where(related, relation_share / max(related.sum(), 1), (1 - relation_share) / max((~related).sum(), 1))
    scaled: NDArray[np.float64] = weights / weights.sum()
    return scaled


class MotionSampler:
    """Draws batches in which rare concepts are seen often, half of them mirrored.

    Args:
        motions: what to draw from.
        mirror: index of each concept's mirror image.
        rng: all randomness.
        layout: objects that the motions' scenes hold.
        weights: how often motions are drawn for the sake of each concept, see :func:`concept_weights`.
    """

    def __init__(
        self,
        motions: MotionSet,
        mirror: NDArray[np.int64],
        rng: np.random.Generator,
        layout: ObjectLayout,
        weights: NDArray[np.float64],
    ) -> None:
        self.motions = motions
        self.layout = layout
        self.mirror = mirror
        self.rng = rng
        self._weights = weights
        self._fulfilling = [np.flatnonzero(column > 0.6) for column in motions.truths.T]
        velocities = [OBSERVATION_LAYOUT["body_linear_velocities"], OBSERVATION_LAYOUT["body_angular_velocities"]]
        self._noise = np.full(motions.observations.shape[1], 0.005, np.float32)
        self._noise[velocities[0]], self._noise[velocities[1]] = 0.08, 0.3

    def index(self, size: int) -> NDArray[np.int64]:
        """Half uniform, half from the motions that fulfil a random concept."""
        index = self.rng.integers(len(self.motions), size=size)
        for place, concept in enumerate(self.rng.choice(len(self._weights), size // 2, p=self._weights)):
            fulfilling = self._fulfilling[concept]
            if len(fulfilling):
                index[place] = fulfilling[self.rng.integers(len(fulfilling))]
        return index

    def turned(self, index: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Half of the motions, to be mirrored; none that has no mirror image."""
        mirrored: NDArray[np.bool_] = self.layout.has_mirror_image(self.motions.objects[index])
        return mirrored & (self.rng.random(len(index)) < 0.5)

    def draw(self, size: int) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
        """Observations (size, 223), states of objects (size, m) and truths (size, concepts)."""
        index = self.index(size)
        return self.take(index, self.turned(index))

    def take(
        self, index: NDArray[np.int64], turned: NDArray[np.bool_]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
        """Observations, states of objects and truths of some motions, those turned mirrored, with a little noise."""
        observations = self.motions.observations[index]
        objects = self.motions.objects[index]
        truths = self.motions.truths[index].astype(np.float32)
        observations[turned] = observations[turned][:, MIRROR_INDEX] * MIRROR_SIGN
        objects[turned] *= self.layout.mirror_sign
        truths[turned] = truths[turned][:, self.mirror]
        noise = self.rng.normal(size=observations.shape).astype(np.float32) * self._noise
        return observations + noise * self.rng.random((len(index), 1), np.float32), objects, truths


class CaptionSampler:
    """Draws captions so that every concept is named often, whatever the number of its wordings."""

    def __init__(self, captions: CaptionSet, rng: np.random.Generator) -> None:
        self.rng = rng
        self.pairs = np.array([i for i, caption in enumerate(captions.training) if len(caption.concepts) > 1])
        self.singles: list[NDArray[np.int64]] = []
        for concept in range(len(captions.concepts)):
            chosen = [i for i, caption in enumerate(captions.training) if caption.concepts == (concept,)]
            self.singles.append(np.array(chosen))

    def draw(self, size: int) -> NDArray[np.int64]:
        """Indices of captions, three quarters about one concept."""
        count = size if not len(self.pairs) else size * 3 // 4
        # Whichever the size: with fewer captions than concepts, other ones are left out each time.
        concepts = self.rng.permutation(len(self.singles))[np.arange(count) % len(self.singles)]
        singles = [self.rng.choice(self.singles[concept]) for concept in concepts if len(self.singles[concept])]
        if not len(self.pairs):
            return np.array(singles, dtype=np.int64)
        return np.concatenate([singles, self.rng.choice(self.pairs, size=size - count)]).astype(np.int64)
