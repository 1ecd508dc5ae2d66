"""What an encoder is trained on: the motion library, its concepts, short motions of both, captions."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from agents.encoder.captions import CaptionSet, write_captions
from agents.encoder.concepts import CONCEPTS, Concept
from agents.encoder.config import EncoderConfig
from agents.encoder.dataset import MotionSet, generate, join_sets
from agents.encoder.exemplars import exemplar_concepts
from agents.encoder.relations import relation_concepts
from agents.encoder.scenes import ObjectLayout
from agents.encoder.wordings import with_further_wordings
from anyskill_envs.objects import load_object
from motion_data.authored import authored_clips
from motion_data.clip import MIRRORED_SUFFIX, MotionClip
from motion_data.deepmimic import pybullet_clips
from motion_data.floor import floor_clips
from motion_data.gait_table import gait_clips


def motion_library() -> list[MotionClip]:
    """Authored clips, gaits, clips on the floor and captured ones, and their mirror images."""
    clips = [*authored_clips(), *gait_clips(), *floor_clips(), *pybullet_clips()]
    names = {clip.name for clip in clips}
    # Sided authored clips come in both kinds already.
    return clips + [clip.mirrored() for clip in clips if not _partner_names(clip.name) & names]


def _partner_names(name: str) -> set[str]:
    swapped = {name.replace("right", "left"), name.replace("left", "right")} - {name}
    return swapped | {name + MIRRORED_SUFFIX}


def all_concepts(clips: list[MotionClip], objects: tuple[str, ...] = ()) -> tuple[Concept, ...]:
    """Ruled concepts, then those that clips show, then relations to objects, all with their further wordings."""
    related = relation_concepts([load_object(name) for name in objects])
    return with_further_wordings((*CONCEPTS.values(), *exemplar_concepts(clips), *related))


def mirrored_concepts(concepts: tuple[Concept, ...]) -> NDArray[np.int64]:
    """Index of each concept's mirror image."""
    names = [concept.name for concept in concepts]
    swap = {"left": "right", "right": "left"}
    partners = []
    for index, name in enumerate(names):
        base, _, side = name.rpartition(".")
        partners.append(names.index(f"{base}.{swap[side]}") if side in swap else index)
    return np.array(partners)


def make_motions(
    config: EncoderConfig, clips: list[MotionClip], concepts: tuple[Concept, ...], layout: ObjectLayout
) -> MotionSet:
    """The motions to train on, made once per run folder."""
    path = config.run / "motions.npz"
    if path.is_file():
        motions = MotionSet.load(path)
        if motions.truths.shape[1] == len(concepts) and motions.objects.shape[1] == layout.size:
            return motions
    rng = np.random.default_rng(config.seed)
    sets = generate(clips, concepts, rng, config.rounds, config.tracks, config.per_track, layout=layout)
    motions = join_sets(list(tqdm(sets, desc="making motions", unit="set")))
    motions.save(path)
    return motions


def prepare_captions(config: EncoderConfig, clips: list[MotionClip]) -> CaptionSet:
    """The captions of a run.

    Raises:
        ValueError: there is no concept of a name in `config.only`, or no object of a name in `config.objects`.
    """
    concepts = all_concepts(clips, config.objects)
    unknown = set(config.only) - {concept.name for concept in concepts}
    if unknown:
        raise ValueError(f"Unknown concepts: {', '.join(sorted(unknown))}.")
    if config.only:
        concepts = tuple(concept for concept in concepts if concept.name in config.only)
    rng = np.random.default_rng(config.seed + 3)
    return write_captions(
        rng, config.caption_pairs, concepts=concepts, style=config.style, triples=config.caption_triples
    )
