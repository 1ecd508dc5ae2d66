"""State projections: small networks that give the image feature of an encoder from the state, without any picture.

`anyskill encoder project` fits and caches them, one file for each encoder and camera; `load_encoder` takes the cached one
for AnySkill's camera where the encoder has no projection of its own.
"""

from __future__ import annotations

import hashlib
import json
import logging
import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from motion_data.skeleton import HUMANOID_XML
from rewards.base import FloatArray
from rewards.onnx_files import open_session

if TYPE_CHECKING:
    from rewards.encoders import Encoder

log = logging.getLogger(__name__)

KIND = "anyskill-state-projection"
FORMAT_VERSION = "1"
OBSERVATION_SIZE = 223
FRONT_VIEW = "front"
"""The camera of environments without objects."""

_PROBES = ["raise both arms above the head", "squat down"]
_PROBE_TOLERANCE = 1e-3


class ProjectionError(ValueError):
    """The file of a state projection is missing or does not fit; the message says what to do."""


def projection_path(encoder: str, view: str = FRONT_VIEW) -> Path:
    """Where the projection of an encoder is cached.

    Args:
        encoder: name of the encoder or its folder, as `load_encoder` takes it.
        view: name of the camera and of the objects that it shows.
    """
    root = os.environ.get("ANYSKILL_CACHE", "") or Path.home() / ".cache" / "anyskill"
    place = str(Path(encoder).resolve()) if Path(encoder).is_dir() else encoder
    word = re.sub(r"[^a-z0-9]+", "-", Path(encoder).name.lower()).strip("-")[:40]
    digest = hashlib.sha256(place.encode()).hexdigest()[:10]
    return Path(root) / "state_projections" / f"{word}-{digest}" / f"{view}.onnx"


def probe(encoder: Encoder) -> FloatArray:
    """A few numbers by which a model is known again."""
    return encoder.encode_text(list(_PROBES))[:, :8].ravel()


def projection_contract(encoder: Encoder) -> dict[str, str]:
    """What a projection of this encoder must agree on with encoder and package: its ONNX metadata."""
    return {
        "kind": KIND,
        "format_version": FORMAT_VERSION,
        "model_xml_sha256": hashlib.sha256(HUMANOID_XML.read_bytes()).hexdigest(),
        "feature_size": str(encoder.feature_size),
        "probe": json.dumps([round(float(number), 5) for number in probe(encoder)]),
    }


class StateProjection:
    """A projection read from its file; pickles by its path.

    Args:
        path: the file.
        num_threads: threads of onnxruntime within one call.

    Attributes:
        object_sizes: which objects it is told about, and how many numbers it takes of each.
        metadata: what the file says of itself, such as the cosine on unseen states.

    Raises:
        ProjectionError: the file is missing, broken, or was made by another version or for another body.
    """

    def __init__(self, path: str | Path, num_threads: int = 1) -> None:
        self.path = Path(path)
        self.num_threads = num_threads
        self._open()

    def _open(self) -> None:
        again = "Make it with `anyskill encoder project --encoder NAME`."
        if not self.path.is_file():
            raise ProjectionError(f"There is no state projection at '{self.path}'. {again}")
        try:
            self._session = open_session(self.path, self.num_threads)
        except ValueError as error:
            raise ProjectionError(f"{error} {again}") from error
        self.metadata: dict[str, str] = dict(self._session.get_modelmeta().custom_metadata_map)
        body = hashlib.sha256(HUMANOID_XML.read_bytes()).hexdigest()
        expected = {"kind": KIND, "format_version": FORMAT_VERSION, "model_xml_sha256": body}
        if any(self.metadata.get(name) != value for name, value in expected.items()):
            raise ProjectionError(f"'{self.path}' is no state projection for this version and body. {again}")
        self.object_sizes: dict[str, int] = json.loads(self.metadata.get("object_sizes", "{}"))

    def fits(self, encoder: Encoder) -> bool:
        """Whether it was made for this very model."""
        if self.metadata.get("feature_size") != str(encoder.feature_size):
            return False
        difference = np.abs(np.array(json.loads(self.metadata["probe"])) - probe(encoder))
        return bool(difference.max() < _PROBE_TOLERANCE)

    def __call__(self, observation: FloatArray, objects: Mapping[str, FloatArray] | None = None) -> FloatArray:
        """Unit features (n, d) of observations (n, 223) and states of objects by name, (n, m) each.

        Raises:
            ValueError: the observations have another size, or the state of a known object has.
        """
        feature: FloatArray = self._session.run(["feature"], state_inputs(self.object_sizes, observation, objects))[0]
        return feature

    def __getstate__(self) -> dict[str, Any]:
        return {"path": self.path, "num_threads": self.num_threads}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._open()


def state_inputs(
    object_sizes: Mapping[str, int], observation: FloatArray, objects: Mapping[str, FloatArray] | None
) -> dict[str, FloatArray]:
    """The inputs of a state tower: ``observation``, and ``objects`` if it knows any.

    For each known object in order: whether it is there (1 or 0) and its state, zeros if it is not. Others are left out.

    Args:
        object_sizes: the objects that the tower knows, with the size of their state.
        observation: proprioception, (n, 223).
        objects: states of objects by name, (n, m) each.

    Raises:
        ValueError: the observations have another size, or the state of a known object has.
    """
    observation = np.asarray(observation, dtype=np.float32)
    if observation.ndim != 2 or observation.shape[1] != OBSERVATION_SIZE:
        raise ValueError(f"Observations must be (n, {OBSERVATION_SIZE}), got {observation.shape}.")
    if not object_sizes:
        return {"observation": observation}
    blocks = []
    for name, size in object_sizes.items():
        state = (objects or {}).get(name)
        block = np.zeros((len(observation), 1 + size), np.float32)
        if state is not None:
            if state.shape != (len(observation), size):
                raise ValueError(f"States of {name!r} must be ({len(observation)}, {size}), got {state.shape}.")
            block[:, 0], block[:, 1:] = 1.0, state
        blocks.append(block)
    return {"observation": observation, "objects": np.concatenate(blocks, axis=1)}


class ProjectedEncoder:
    """An encoder with a state projection that was fitted to its image features.

    Args:
        encoder: the encoder.
        projection: the projection.

    Attributes:
        feature_size: length of the features.
        object_sizes: objects that the projection knows; see :class:`rewards.encoders.SceneEncoder`.
    """

    has_state_projection = True

    def __init__(self, encoder: Encoder, projection: StateProjection) -> None:
        self.encoder = encoder
        self.projection = projection
        self.feature_size = encoder.feature_size
        self.object_sizes = projection.object_sizes

    def encode_text(self, texts: Sequence[str]) -> FloatArray:
        """Unit features (k, d) of k texts."""
        return self.encoder.encode_text(list(texts))

    def encode_image(self, frames: NDArray[np.uint8]) -> FloatArray:
        """Unit features (n, d) of pictures or short films, by the encoder itself."""
        return self.encoder.encode_image(frames)

    def encode_state(self, observation: FloatArray, objects: Mapping[str, FloatArray] | None = None) -> FloatArray:
        """Unit features (n, d) of observations (n, 223), by the projection."""
        return self.projection(observation, objects)


def with_projection(encoder: Encoder, name: str, projection: str | Path | None = None, num_threads: int = 1) -> Encoder:
    """The encoder with a state projection.

    Args:
        encoder: the encoder.
        name: what it was loaded by.
        projection: file of the projection; None for the cached one, if there is one and the encoder has none of its own.
        num_threads: threads of onnxruntime within one call of the projection; 0 for one per CPU.

    Raises:
        ProjectionError: the given file is missing or does not fit.
    """
    if projection is not None:
        found = StateProjection(projection, num_threads)
        if not found.fits(encoder):
            raise ProjectionError(f"The state projection '{projection}' was made for another encoder than '{name}'.")
        return ProjectedEncoder(encoder, found)
    path = projection_path(name)
    if getattr(encoder, "has_state_projection", True) or not path.is_file():
        return encoder
    try:
        found = StateProjection(path, num_threads)
    except ProjectionError as error:
        log.warning("%s Pictures are looked at instead.", error)
        return encoder
    if not found.fits(encoder):
        log.warning("'%s' was made for another model of this name: pictures are looked at instead.", path)
        return encoder
    return ProjectedEncoder(encoder, found)
