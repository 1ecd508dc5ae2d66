"""All that the card of an encoder says: recall, minimal pairs, paraphrases, the projection's fidelity and speed."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from agents.encoder.captions import CaptionSet
from agents.encoder.dataset import MotionSet, generate, join_sets
from agents.encoder.free_sentences import Moments, sentence_moments
from agents.encoder.material import motion_library
from agents.encoder.pictures import picture_index, render_films
from agents.encoder.pose_facts import measure_facts
from agents.encoder.pose_figures import rule_figures, sentence_figures
from agents.encoder.projecting import measure_speed
from agents.encoder.sanity import SanityRow, sanity_table
from agents.encoder.scenes import ObjectLayout
from agents.encoder.wording_figures import wording_figures
from anyskill_envs.objects.scene import Scene
from anyskill_envs.rendering import FRONT_CAMERA
from motion_data.clip import MIRRORED_SUFFIX, MotionClip
from rewards.encoders import Encoder, SceneEncoder

SEED = 20_260
"""Seed of the held-out motions; no training uses it."""
Figures = dict[str, float]


@dataclass(frozen=True)
class EncoderReport:
    """What was measured.

    Attributes:
        figures: by tower ("state", "image"), then by set ("rules", "sentences", "training rules"), then by name.
        projection: cosine of projection and image feature on held-out states, and the speed of both.
        sanity: scores of clips for a few texts; empty for encoders without a state projection.
        motions: held-out motions, and how many of them were drawn.
    """

    figures: dict[str, dict[str, Figures]]
    projection: Figures
    sanity: list[SanityRow] = field(default_factory=list)
    motions: tuple[int, int] = (0, 0)

    @property
    def json(self) -> str:
        """The report as JSON."""
        return json.dumps(dataclasses.asdict(self), indent=2).replace("NaN", "null")

    def rows(self) -> Iterator[tuple[str, str, float, float]]:
        """Set, name, and value of the state and of the image tower."""
        towers = [self.figures.get(tower, {}) for tower in ("state", "image")]
        for kind, figures in next(iter(self.figures.values())).items():
            for name in figures:
                first, second = (tower.get(kind, {}).get(name, float("nan")) for tower in towers)
                yield kind, name, first, second

    @property
    def table(self) -> str:
        """The figures as a Markdown table."""
        lines = ["| measured on | figure | state projection | image tower |", "|---|---|---|---|"]
        for kind, name, first, second in self.rows():
            digits = 0 if name in ("captions", "sentences") else 3
            lines.append(f"| {kind} | {name} | {_shown(first, digits)} | {_shown(second, digits)} |")
        for name, value in self.projection.items():
            lines.append(f"| projection | {name} | {value:,.4g} | |")
        return "\n".join(lines)


def _shown(value: float, digits: int) -> str:
    return "-" if np.isnan(value) else f"{value:.{digits}f}"


def evaluate(
    encoder: Encoder, captions: CaptionSet, pictures: int = 400, tracks: int = 48, per_track: int = 12
) -> EncoderReport:
    """Measures an encoder.

    Motions come from a seed that no training uses; captions from rules that no training uses (`pose_facts`), from sentences
    that somebody wrote (`free_sentences`), and, for comparison, from wordings of the training rules that were held out.

    Args:
        encoder: the encoder.
        captions: those of its training, for their held-out wordings.
        pictures: how many motions are drawn for the image tower.
        tracks: held-out tracks per source.
        per_track: motions per track.

    Raises:
        ValueError: there are too few motions.
    """
    clips = motion_library()
    moments = unseen(sentence_moments(clips, np.random.default_rng(SEED)), captions)
    layout = ObjectLayout(_objects(captions))
    rng = np.random.default_rng(SEED + 1)
    held = join_sets(list(generate(clips, captions.concepts, rng, 1, tracks, per_track, layout=layout)))
    # Facts and sentences are about the humanoid alone; and scenes are drawn by another camera.
    alone = held.take(np.flatnonzero(held.scenes < 0))
    drawn = alone.take(picture_index(alone, min(pictures, len(alone)), rng))
    figures: dict[str, dict[str, Figures]] = {}
    projection: Figures = {}
    sanity: list[SanityRow] = []
    image = _filmed(encoder, drawn, rng)
    projects = getattr(encoder, "has_state_projection", True)
    if projects:
        features = encode_states(encoder, held, layout)
        lonely = features[held.scenes < 0]
        figures["state"] = {
            "rules": rule_figures(encoder, lonely, _facts(alone), np.random.default_rng(SEED + 2)),
            "sentences": sentence_figures(encoder, encoder.encode_state(moments.observations), moments.sentences),
            "training rules": wording_figures(encoder, held, captions, np.random.default_rng(SEED + 3), features),
        }
        projection = projection_figures(encoder, drawn, image)
        sanity = sanity_table(encoder, _originals(clips), np.random.default_rng(SEED + 4))
    figures["image"] = {
        "rules": rule_figures(encoder, image, _facts(drawn), np.random.default_rng(SEED + 2)),
        "sentences": sentence_figures(encoder, _filmed_moments(encoder, moments, drawn, rng), moments.sentences),
        "training rules": wording_figures(encoder, drawn, captions, np.random.default_rng(SEED + 3), image),
    }
    return EncoderReport(figures, projection, sanity, (len(held), len(drawn)))


def _objects(captions: CaptionSet) -> tuple[str, ...]:
    """The objects that the concepts of a training are about."""
    names = [concept.name.partition(":")[0] for concept in captions.concepts if concept.group == "object"]
    return tuple(dict.fromkeys(names))


def unseen(moments: Moments, captions: CaptionSet) -> Moments:
    """The moments whose sentences are not by chance among the captions of training; the figures say how many are left."""
    known = {caption.text for caption in captions.training}
    rows = [row for row, sentence in enumerate(moments.sentences) if sentence.lower() not in known]
    return Moments(
        tuple(moments.sentences[row] for row in rows),
        tuple(moments.clips[row] for row in rows),
        moments.observations[rows],
        moments.films[rows],
    )


def _originals(clips: list[MotionClip]) -> list[MotionClip]:
    return [clip for clip in clips if not clip.name.endswith(MIRRORED_SUFFIX)]


def _facts(motions: MotionSet) -> NDArray[np.float64]:
    """The facts of the last pose of each motion."""
    return measure_facts(motions.films[:, -1, :35].astype(np.float64))


def encode_states(encoder: Encoder, motions: MotionSet, layout: ObjectLayout) -> NDArray[np.float32]:
    """Features of states, the encoder being told of the objects that are there."""
    features = np.empty((len(motions), encoder.feature_size), np.float32)
    for scene in np.unique(motions.scenes):
        rows = np.flatnonzero(motions.scenes == scene)
        if scene < 0 or not (isinstance(encoder, SceneEncoder) and encoder.object_sizes):
            features[rows] = encoder.encode_state(motions.observations[rows])
        else:
            name = layout.names[scene]
            features[rows] = encoder.encode_state(
                motions.observations[rows], {name: layout.state(name, motions.objects[rows])}
            )
    return features


def _filmed(encoder: Encoder, motions: MotionSet, rng: np.random.Generator) -> NDArray[np.float32]:
    """Image features of motions, drawn with 224 pixels as an environment draws them, in portions that fit into memory."""
    parts = np.array_split(np.arange(len(motions)), len(motions) // 100 + 1)
    return np.concatenate([encoder.encode_image(render_films(motions.take(part), 224, rng)) for part in parts])


def _filmed_moments(
    encoder: Encoder, moments: Moments, like: MotionSet, rng: np.random.Generator
) -> NDArray[np.float32]:
    count = len(moments.sentences)
    films = np.zeros((count, *like.films.shape[1:]), np.float32)
    films[:, :, :35] = moments.films
    template = like.take(np.zeros(count, dtype=np.int64))
    return _filmed(encoder, dataclasses.replace(template, films=films, scenes=np.full(count, -1)), rng)


def projection_figures(encoder: Encoder, motions: MotionSet, image: NDArray[np.float32]) -> Figures:
    """Cosine of projection and image feature on held-out motions, and seconds of both in one process."""
    cosine = (encoder.encode_state(motions.observations) * image).sum(1)
    poses = motions.films[:, -1, :35].astype(np.float64)
    drawn, projected = measure_speed(encoder, poses, motions.observations, Scene(), FRONT_CAMERA)
    return {
        "cosine with the image feature": float(cosine.mean()),
        "1 in 100 is below": float(np.quantile(cosine, 0.01)),
        "microseconds per state": 1e6 * projected,
        "microseconds per rendered and encoded picture": 1e6 * drawn,
        "times as fast": drawn / projected,
    }
