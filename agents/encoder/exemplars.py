"""Concepts that are shown rather than ruled: a motion fulfils "nod" as far as it resembles a clip that is labelled so."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from agents.encoder.concepts import CONCEPTS, Concept
from agents.encoder.measurements import WINDOW, Array, Measurements
from motion_data.clip import MotionClip
from motion_data.skeleton import forward_kinematics, rest_qpos

_RESEMBLANCE = 0.05
"""Metres of mean body distance at which a resemblance has fallen to 0.6."""
_IDLE = 0.12
"""Frames of a clip nearer than this to the rest pose are its way in and out, not what it shows."""
_PAST = 8
"""Frames between the two poses that are compared."""


def resemblance_features(m: Measurements) -> Array:
    """Poses now and 0.27 s ago, as body positions seen from the pelvis, scaled so that distance is root mean square."""
    now, past = m.positions[:, -1], m.positions[:, -1 - _PAST]
    seen = np.concatenate([m._turn(frame - frame[:, :1]) for frame in (now, past)], axis=1)
    height = np.stack([now[:, 0, 2], past[:, 0, 2]], 1)[:, :, None] * np.array([0.0, 0.0, 2.0])
    features = np.concatenate([seen, height], 1)
    return (features / np.sqrt(features.shape[1])).reshape(len(m), -1)


def clip_windows(clip: MotionClip) -> Measurements:
    """One short motion per frame of a clip; before its start the first pose stands still."""
    qpos = clip.resampled().qpos
    padded = np.concatenate([np.repeat(qpos[:1], WINDOW - 1, 0), qpos])
    positions, quaternions = forward_kinematics(padded)
    index = np.arange(len(qpos))[:, None] + np.arange(WINDOW)
    return Measurements(positions[index], quaternions[index])


def exemplar_concepts(clips: Sequence[MotionClip]) -> list[Concept]:
    """One concept for each clip that has labels, none of which is a phrase of a ruled concept.

    Clips that share their first label become one concept.
    """
    known = {phrase for concept in CONCEPTS.values() for phrase in concept.phrases}
    shown: dict[str, list[MotionClip]] = {}
    for clip in clips:
        if clip.labels and not known.intersection(clip.labels):
            shown.setdefault(clip.labels[0], []).append(clip)
    rest, turned = forward_kinematics(np.repeat(rest_qpos()[None], WINDOW, 0))
    idle = resemblance_features(Measurements(rest[None], turned[None]))[0]
    concepts = []
    for label, group in shown.items():
        features = np.concatenate([resemblance_features(clip_windows(clip)) for clip in group])
        telling = np.linalg.norm(features - idle, axis=1) > _IDLE
        if not telling.any():
            continue
        phrases = tuple(dict.fromkeys(phrase for clip in group for phrase in clip.labels))
        side = next((side for side in ("left", "right") if side in label.split()), None)
        name = f"shown:{group[0].name.removesuffix('_mirrored').removesuffix('_left').removesuffix('_right')}"
        concepts.append(Concept(f"{name}.{side}" if side else name, "whole", phrases, _resembles(features[telling])))
    names = [concept.name for concept in concepts]
    # A sided concept without its mirror image cannot be mirrored with the data: it is left out.
    swap = {"left": "right", "right": "left"}
    return [
        concept
        for concept in concepts
        if concept.name.rpartition(".")[2] not in swap
        or f"{concept.name.rpartition('.')[0]}.{swap[concept.name.rpartition('.')[2]]}" in names
    ]


def _resembles(features: Array):  # type: ignore[no-untyped-def]
    tree = cKDTree(features)

    def rule(m: Measurements) -> Array:
        distance, _ = tree.query(resemblance_features(m))
        return np.exp(-0.5 * (distance / _RESEMBLANCE) ** 2)

    return rule
