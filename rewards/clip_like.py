"""What encoders share that know pictures and texts, but no states of the humanoid."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rewards.base import FloatArray


class ClipLikeEncoder(ABC):
    """Base of encoders of pictures and texts: what may come in, films, and batches.

    Attributes:
        name: where the model comes from.
        feature_size: length of the features.
        batch_size: pictures that go through the model at once.
    """

    has_state_projection = False
    name: str
    feature_size: int
    batch_size: int

    def encode_text(self, texts: Sequence[str]) -> FloatArray:
        """Unit features (k, d) of k texts.

        Raises:
            ValueError: no text, or an empty one.
        """
        if isinstance(texts, str) or not texts or any(not text.strip() for text in texts):
            raise ValueError("encode_text takes a list of at least one text, and no text may be empty.")
        return self._encode_texts(list(texts))

    def encode_image(self, frames: NDArray[np.uint8]) -> FloatArray:
        """Unit features (n, d) of pictures or short films.

        Args:
            frames: uint8 pictures (n, height, width, 3), or films (n, k, height, width, 3); the feature of a film is the
                normalised mean of those of its frames.

        Raises:
            ValueError: another shape or type.
        """
        frames = np.asarray(frames)
        if frames.dtype != np.uint8 or frames.ndim not in (4, 5) or frames.shape[-1] != 3:
            raise ValueError(
                f"Frames must be uint8 (n, height, width, 3) or (n, k, height, width, 3), got {frames.dtype} {frames.shape}."
            )
        if frames.ndim == 5:
            films, length = frames.shape[:2]
            features = self.encode_image(frames.reshape(films * length, *frames.shape[2:]))
            return unit(features.reshape(films, length, -1).mean(1))
        return np.concatenate(
            [
                self._encode_pictures(frames[start : start + self.batch_size])
                for start in range(0, len(frames), self.batch_size)
            ]
        )

    def encode_state(self, observation: FloatArray) -> FloatArray:
        """Not possible: a model of pictures and texts knows no states.

        Raises:
            NotImplementedError: always; the message says how to make a projection.
        """
        raise NotImplementedError(
            f"The encoder '{self.name}' has no state projection: make one with `anyskill encoder project --encoder "
            f'NAME_OR_FOLDER`, or use source="frames".'
        )

    @abstractmethod
    def _encode_texts(self, texts: list[str]) -> FloatArray:
        """Unit features (k, d) of texts that are not empty."""

    @abstractmethod
    def _encode_pictures(self, frames: NDArray[np.uint8]) -> FloatArray:
        """Unit features (n, d) of one batch of pictures (n, height, width, 3)."""


def unit(features: NDArray[Any]) -> FloatArray:
    """Features scaled to unit length, float32."""
    scaled: FloatArray = (features / np.linalg.norm(features, axis=-1, keepdims=True)).astype(np.float32)
    return scaled
