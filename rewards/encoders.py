"""What an encoder is: text, pictures and states in one space of unit vectors, found by name in a registry."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from rewards.base import FloatArray, resolve


@runtime_checkable
class Encoder(Protocol):
    """Text, pictures and states as unit vectors of one size: their dot product is their similarity.

    An encoder without a state projection says so with an attribute `has_state_projection = False` and raises
    NotImplementedError in `encode_state`; rewards that use it then look at pictures.
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


@runtime_checkable
class SceneEncoder(Protocol):
    """An encoder whose state projection can also be told about objects beside the humanoid.

    `object_sizes` names the objects that it knows, with the size of their state; empty if it knows none.
    """

    object_sizes: dict[str, int]

    def encode_state(self, observation: FloatArray, objects: Mapping[str, FloatArray] | None = None) -> FloatArray:
        """Unit features (n, d) of observations (n, 223) and states of objects by name, (n, m) each."""
        ...


HUB_PREFIX = "hf:"
_TRANSFORMERS_ENCODER = "rewards.transformers_encoder:TransformersEncoder"
_ONNX_ENCODER = "rewards.onnx_encoder:OnnxEncoder"
_BUNDLED_ENCODER = "rewards.bundled:BundledEncoder"
_ENCODERS: dict[str, str | Callable[..., Encoder]] = {"bundled": _BUNDLED_ENCODER}


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


def load_encoder(
    name: str = "bundled", *, projection: str | Path | bool = True, num_threads: int | None = None, **kwargs: Any
) -> Encoder:
    """Build an encoder by name.

    An encoder that knows no states gets the state projection that `anyskill encoder project` has cached for it, if it has;
    rewards then need no pictures.

    Args:
        name: one of `encoder_names()`; or "hf:" and the name of a CLIP-like model on the Hugging Face hub, such as
            "hf:laion/CLIP-ViT-B-32-laion2B-s34B-b79K" (the paper's); or the folder of such a model, or of one that
            `anyskill encoder export` has written, or of one that `anyskill encoder train --out` has written.
        projection: file of another state projection; False for none.
        num_threads: threads of onnxruntime within one call, 0 for one per CPU, for what runs on it; its default if None,
            which is one thread for state projections: many single environments share the CPUs.
        **kwargs: arguments of the encoder's constructor.

    Raises:
        ValueError: no encoder has this name; the message lists those that exist. Or the projection does not fit.
    """
    encoder = _load(name, num_threads, **kwargs)
    if projection is False or (projection is True and getattr(encoder, "has_state_projection", True)):
        return encoder
    from rewards.projection import with_projection

    return with_projection(
        encoder, name, None if projection is True else projection, 1 if num_threads is None else num_threads
    )


def _load(name: str, num_threads: int | None, **kwargs: Any) -> Encoder:
    threads = {} if num_threads is None else {"num_threads": num_threads}
    if name in _ENCODERS:
        if "num_threads" in inspect.signature(resolve(_ENCODERS[name])).parameters:
            kwargs = threads | kwargs
        return _build(_ENCODERS[name], **kwargs)
    if name.startswith(HUB_PREFIX):
        return _build(_TRANSFORMERS_ENCODER, name=name.removeprefix(HUB_PREFIX), **kwargs)
    if (Path(name) / "image.onnx").is_file() and (Path(name) / "text.onnx").is_file():
        return _build(_ONNX_ENCODER, folder=name, **threads, **kwargs)
    if (Path(name) / "state_projection.onnx").is_file() and (Path(name) / "text_head.onnx").is_file():
        return _build(_BUNDLED_ENCODER, folder=name, **threads, **kwargs)
    if Path(name).is_dir():
        return _build(_TRANSFORMERS_ENCODER, name=name, **kwargs)
    raise ValueError(
        f"Unknown encoder {name!r}; the encoders that exist are: {', '.join(encoder_names())}, "
        f'"{HUB_PREFIX}<name of a CLIP-like model on the Hugging Face hub>", or the folder of such a model.'
    )


def _build(target: str | Callable[..., Encoder], **kwargs: Any) -> Encoder:
    encoder: Encoder = resolve(target)(**kwargs)
    return encoder
