"""The encoder that judges what the runs learned; at best one that no run was rewarded by."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from anyskill_envs.objects.scene import Scene
from anyskill_envs.observation import OBSERVATION_SIZE
from anyskill_envs.rendering import Camera, HumanoidRenderer, camera_of
from motion_data.metrics import clip_similarity
from rewards import Encoder, load_encoder
from rewards.bundled import WEIGHTS_FOLDER

EVALUATOR_FOLDER = WEIGHTS_FOLDER / "evaluator"
"""Files of the bundled evaluator, which are those of a bundled encoder trained apart from that of the rewards."""

FRAME_STRIDE = 4
"""Every fourth frame is judged, 0.13 s apart, as in the films that the bundled image tower reads."""
_FILM_FRAMES = 4


@dataclass(frozen=True)
class Evaluator:
    """Measures CLIP_S of motions.

    Attributes:
        encoder: What compares text and motion.
        name: What it is called in the report.
        note: One sentence on whose judgement this is.
        pictures: Whether it looks at rendered pictures; else at states.
        independent: Whether no run was rewarded by it.
    """

    encoder: Encoder
    name: str
    note: str
    pictures: bool
    independent: bool

    @cached_property
    def digest(self) -> str:
        """Tells this judgement from that of any other encoder, by features of two texts and of noise."""
        rng = np.random.default_rng(0)
        texts = self.encoder.encode_text(["raise both arms above the head", "squat down"])
        if self.pictures:
            seen = self.encoder.encode_image(rng.integers(256, size=(1, _FILM_FRAMES, 64, 64, 3), dtype=np.uint8))
        else:
            seen = self.encoder.encode_state(rng.normal(size=(2, OBSERVATION_SIZE)).astype(np.float32))
        numbers = np.round(np.concatenate([texts, seen]), 4)
        return hashlib.sha256(numbers.tobytes()).hexdigest()[:16] + ("-pictures" if self.pictures else "")

    def scores(
        self,
        motions: Sequence[tuple[NDArray[np.float64], NDArray[np.float32]]],
        text: str,
        scene: Scene | None = None,
    ) -> list[float]:
        """CLIP_S of motions.

        Args:
            motions: Poses `(T, 35)`, or those of the scene, and observations `(T, 223)`.
            text: What they are compared with.
            scene: The objects beside the humanoid, which only pictures show; none if None.

        Raises:
            RenderingError: It looks at pictures, and none can be drawn on this machine.
        """
        wanted = self.encoder.encode_text([text])[0]
        if not self.pictures:
            return [
                float(clip_similarity(self.encoder.encode_state(seen[::FRAME_STRIDE]), wanted)) for _, seen in motions
            ]
        scene = scene or Scene()
        renderer, camera = HumanoidRenderer(scene=scene), camera_of(None, scene)
        try:
            return [float(clip_similarity(self._filmed(renderer, camera, qpos), wanted)) for qpos, _ in motions]
        finally:
            renderer.close()

    def _filmed(self, renderer: HumanoidRenderer, camera: Camera, qpos: NDArray[np.float64]) -> NDArray[np.float32]:
        """Features of films of 0.4 s, one ending at each rendered frame."""
        pictures = np.stack([renderer.render(pose, camera) for pose in qpos[::FRAME_STRIDE]])
        ends = np.arange(len(pictures))[:, None]
        return self.encoder.encode_image(pictures[np.maximum(ends - np.arange(_FILM_FRAMES)[::-1], 0)])


def choose_evaluator(name: str | None, reward_encoder: str, pictures: bool = False) -> Evaluator:
    """The encoder that judges.

    Args:
        name: Name of an encoder, or a folder: that of a transformers model, or with the files of a bundled encoder. None
            takes the bundled evaluator if its files are there, else the encoder of the rewards.
        reward_encoder: Name of the encoder of the rewards.
        pictures: Look at pictures although it has a state projection.

    Raises:
        ValueError: There is no such encoder.
    """
    if name is None and (EVALUATOR_FOLDER / "text_head.onnx").is_file():
        name = str(EVALUATOR_FOLDER)
    independent = name is not None and _place(name) != _place(reward_encoder)
    if name is None or not independent:
        encoder, name = load_encoder(reward_encoder), reward_encoder
        note = (
            f"CLIP_S is measured by the encoder of the rewards, “{name}”, for want of an independent evaluator: it favours "
            "rewards that climb this very similarity, and cannot tell a skill from a trick."
        )
    else:
        encoder = _load(name)
        note = f"CLIP_S is measured by “{Path(name).name}”, which no run was rewarded by."
    pictures = pictures or not getattr(encoder, "has_state_projection", True)
    return Evaluator(encoder, Path(name).name, note, pictures, independent)


def _place(name: str) -> str | Path:
    """The folder that a name stands for if there is one, so that two spellings of one encoder are told as one."""
    folder = WEIGHTS_FOLDER if name == "bundled" else Path(name)
    return folder.resolve() if folder.is_dir() else name


def _load(name: str) -> Encoder:
    if (Path(name) / "state_projection.onnx").is_file():
        from rewards.bundled import BundledEncoder

        return BundledEncoder(name)
    return load_encoder(name)
