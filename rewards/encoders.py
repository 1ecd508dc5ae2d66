"""What an encoder is: text, pictures and states in one space of unit vectors, found by name in a registry."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from rewards.base import FloatArray, resolve


@runtime_checkable
class Encoder(Protocol):
    """Text, pictures and states as unit vectors of one size: their dot product is their similarity.

    An encoder without a state projection raises NotImplementedError in `encode_state`; rewards that use it then need frames.
    """

    feature_size: int

    def encode_text(self, texts: list[str]) -> FloatArray:
        """Unit features (k, d) of k texts."""
        ...

    def encode_image(self, frames: NDArray[np.uint8]) -> FloatArray:
        """Unit features (n, d) of pictures (n, height, width, 3), or of short films (n, k, height, width, 3)."""
        ...

    def encode_state(self, observation: FloatArray) -> FloatArray:
        """Unit features (n, d) of proprioceptive observations (n, 223)."""
        ...


_ENCODERS: dict[str, str | Callable[..., Encoder]] = {"bundled": "rewards.bundled:BundledEncoder"}


def encoder_names() -> list[str]:
    """Names that `load_encoder` knows, sorted."""
    return sorted(_ENCODERS)


def register_encoder(name: str, target: str | Callable[..., Encoder]) -> None:
    """Make an encoder known by name.

    Args:
        name: the name for `load_encoder` and for the `encoder` argument of rewards.
        target: a callable that builds the encoder, or "package.module:Name" of one.

    Raises:
        ValueError: the name is taken.
    """
    if name in _ENCODERS:
        raise ValueError(f"An encoder named {name!r} exists already; choose another name.")
    _ENCODERS[name] = target


def load_encoder(name: str = "bundled", **kwargs: Any) -> Encoder:
    """Build an encoder by name.

    Args:
        name: one of `encoder_names()`.
        **kwargs: arguments of the encoder's constructor.

    Raises:
        ValueError: no encoder has this name; the message lists those that exist.
    """
    if name not in _ENCODERS:
        raise ValueError(f"Unknown encoder {name!r}; the encoders that exist are: {', '.join(encoder_names())}.")
    encoder: Encoder = resolve(_ENCODERS[name])(**kwargs)
    return encoder
