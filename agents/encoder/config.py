"""Settings of a training run of the encoder, and what the independent evaluator does differently."""

from __future__ import annotations

import json
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

from agents.ablation.evaluator import EVALUATOR_FOLDER
from agents.encoder.pictures import CameraRange
from rewards.bundled import WEIGHTS_FOLDER


@dataclass(frozen=True)
class EncoderConfig:
    """Settings of a training run of the encoder."""

    only: tuple[str, ...] = ()
    """Names of the concepts to train on, for quick trials; all of them if none is given."""
    evaluator: bool = False
    """Train the evaluator instead: other seed, widths, cameras and caption templates, into a folder of its own."""
    objects: tuple[str, ...] = ("ball", "chair", "door", "pillar")
    """Objects of the scenes that the encoder learns about; `--objects` alone for none."""
    run: Path = Path("runs/encoder")
    """Folder of the run: data, checkpoints, report."""
    begin: Path | None = None
    """Folder of an earlier run with whose state and text towers the training begins; hidden layers may be wider."""
    seed: int = 0
    """Seed of all randomness."""
    rounds: int = 10
    """Rounds of data; each has about 2,000 motions per source and 4,000 simulated ones."""
    tracks: int = 128
    """Tracks per source and round."""
    per_track: int = 16
    """Short motions cut from each track."""
    caption_pairs: int = 700
    """Captions that join two concepts; as many mirrored ones come with them."""
    caption_triples: int = 300
    """Captions about arms, trunk and legs at once; as many mirrored ones come with them."""
    lessons: int = 3500
    """Motions that are described by low-level facts, each in three captions; see `agents.encoder.posecodes`."""
    lesson_batch: int = 56
    """Of these per step, and as many motions with captions that are composed in the step."""
    phrases: int = 72
    """Phrases of each posecode, of which captions are composed in each step."""
    feature_size: int = 512
    """Size of the shared space: one half for a motion or text as it is, one for its mirror image."""
    hidden: int = 768
    """Width of the hidden layers of the state tower."""
    symmetric_hidden: int = 640
    """Width of the hidden layers of the symmetric state tower that learns from it and is exported."""
    relation_share: float = 0.5
    """Of the motions that are drawn for the sake of a concept, the share whose concept is a relation to an object."""
    state_batch: int = 384
    """Motions per step of the state and text towers."""
    caption_batch: int = 224
    """Captions per step."""
    steps: int = 5000
    """Steps of the state and text towers."""
    symmetry_steps: int = 6000
    """Steps in which one symmetric state tower learns from the trained one and its look into the mirror."""
    learning_rate: float = 1e-3
    """Highest learning rate; it rises for 200 steps and then falls along a cosine."""
    image_size: int = 64
    """Pixels per side of the image tower's frames."""
    image_width: int = 24
    """Channels of the image tower's first convolution; the others are multiples of it."""
    image_motions: int = 12000
    """Motions that are rendered for the image tower."""
    image_epochs: int = 12
    """Passes over the rendered motions."""
    image_batch: int = 64
    """Films per step of the image tower."""
    threads: int = 1
    """Threads of torch."""
    out: Path | None = None
    """Folder to export to; that of the bundled encoder, or of the evaluator, if None."""

    @property
    def folder(self) -> Path:
        """Where the files go."""
        if self.out is not None:
            return self.out
        return EVALUATOR_FOLDER if self.evaluator else WEIGHTS_FOLDER

    @property
    def style(self) -> str:
        """Whose caption templates are taken; see `agents.encoder.captions.TEMPLATES`."""
        return "evaluator" if self.evaluator else "reward"

    @property
    def caption_settings(self) -> str:
        """All that the captions depend on, as JSON; see :func:`captions_of`."""
        return json.dumps({name: getattr(self, name) for name in _CAPTION_SETTINGS})

    @property
    def cameras(self) -> CameraRange:
        """Where the cameras of the films stand."""
        if not self.evaluator:
            return CameraRange()
        return CameraRange(front=0.15, angle=0.75, distance=(2.8, 4.2), height=(0.5, 1.9))

    @property
    def settled(self) -> EncoderConfig:
        """The settings with those of the evaluator where it is wanted and nothing else was chosen."""
        if not self.evaluator:
            return self
        defaults = {item.name: item.default for item in fields(self)}
        chosen = {name: value for name, value in _EVALUATOR.items() if getattr(self, name) == defaults[name]}
        return replace(self, **chosen)


def captions_of(settings: str) -> EncoderConfig:
    """The settings whose `caption_settings` these are; those without objects for an encoder that says nothing."""
    stored: dict[str, Any] = json.loads(settings) or {"objects": ()}
    values: dict[str, Any] = {
        name: tuple(value) if isinstance(value, list) else value for name, value in stored.items()
    }
    return EncoderConfig(**values)


_CAPTION_SETTINGS = ("only", "evaluator", "objects", "seed", "caption_pairs", "caption_triples")
_EVALUATOR: dict[str, Any] = {
    "run": Path("runs/encoder_evaluator"),
    "seed": 7041,
    "feature_size": 384,
    "hidden": 384,
    "symmetric_hidden": 320,
    "lessons": 0,
    "caption_batch": 256,
    "steps": 6000,
    "image_width": 20,
}
