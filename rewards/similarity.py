"""What all rewards share that compare a text with what is seen: encoder, features and their cosine."""

from __future__ import annotations

from typing import Literal

import numpy as np

from rewards.base import FloatArray, RewardBatch
from rewards.encoders import Encoder, SceneEncoder, load_encoder

Source = Literal["state", "frames"]


class SimilarityReward:
    """Base of rewards about the similarity of a text and an image.

    A subclass adds to `needs` what it looks at beside the text, and sets `history` if it looks back.

    Args:
        encoder: an encoder or its name.
        source: "state" takes image features from the encoder's state projection and needs no rendering, "frames" from
            rendered pictures. None is "state" if the encoder has a state projection, else "frames".

    Raises:
        ValueError: `source` is none of these, or is "state" and the encoder has no state projection.
    """

    history: int = 0

    def __init__(self, encoder: str | Encoder = "bundled", source: Source | None = None) -> None:
        if source not in ("state", "frames", None):
            raise ValueError(f'source must be "state" or "frames", not {source!r}.')
        self.encoder = load_encoder(encoder) if isinstance(encoder, str) else encoder
        projects = getattr(self.encoder, "has_state_projection", True)
        if source == "state" and not projects:
            raise ValueError(
                f"The encoder {encoder!r} has no state projection: make one with `anyskill encoder project --encoder NAME`, "
                'choose source="frames", or leave source out.'
            )
        self.source: Source = source or ("state" if projects else "frames")
        self.needs: frozenset[str] = frozenset({self.source, "text"})

    def encode_text(self, texts: list[str]) -> FloatArray:
        """Unit features (k, d) of k texts."""
        return self.encoder.encode_text(texts)

    def image_feature(self, batch: RewardBatch) -> FloatArray:
        """Unit features (n, d) of what the batch shows: those it carries, else encoded from its states or frames."""
        if batch.image_feature is not None:
            return batch.image_feature
        if self.source == "state":
            assert batch.observation is not None  # `require` has seen to it
            if batch.objects and isinstance(self.encoder, SceneEncoder) and self.encoder.object_sizes:
                vectors = {name: state.vector for name, state in batch.objects.items()}
                return self.encoder.encode_state(batch.observation, vectors)
            return self.encoder.encode_state(batch.observation)
        assert batch.frames is not None
        return self.encoder.encode_image(batch.frames)


def cosine(features: FloatArray, batch: RewardBatch) -> FloatArray:
    """Cosine of unit features (n, d) with the text of each row, shape (n,)."""
    assert batch.text_feature is not None
    product: FloatArray = (features * np.atleast_2d(batch.text_feature)).sum(axis=-1, dtype=np.float32)
    return product


def past_features(batch: RewardBatch, count: int) -> FloatArray:
    """The features of the last `count` steps before this one, (n, count, d).

    Raises:
        ValueError: the batch holds fewer.
    """
    past = batch.past_features
    assert past is not None  # `require` has seen to it
    if past.ndim != 3 or past.shape[1] < count:
        raise ValueError(
            f"RewardBatch.past_features must hold {count} earlier steps, (n, {count}, d), but its shape is {past.shape}."
        )
    return past[:, past.shape[1] - count :]
