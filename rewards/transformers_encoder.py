"""Any CLIP-like model of `transformers` as an encoder, with that model's own preprocessing."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rewards.base import FloatArray
from rewards.clip_like import ClipLikeEncoder, unit

INSTALL = 'Install what it needs: pip install "anyskill-envs[encoder]"'


class TransformersEncoder(ClipLikeEncoder):
    """A model of `transformers` that has features of texts and of pictures in one space: CLIP, SigLIP, AltCLIP, ...

    Pictures go through the model's own image processor in its Pillow form, which every machine has and which gives the
    same pixels everywhere; texts through its tokenizer. The model runs on the CPU in float32.

    It has no state projection, so rewards render the humanoid; that costs far more than the physics.

    Args:
        name: name of the model on the Hugging Face hub, or a folder with config.json, weights, preprocessor_config.json
            and the tokenizer's files. A model that was downloaded before is read from the hub's cache, without network.
        batch_size: pictures that go through the model at once.

    Attributes:
        name: where the model comes from.
        feature_size: length of the features.
        model, tokenizer, image_processor: the parts of the model, those of `transformers`.
        max_tokens: longer texts are cut.
        padding: how the tokenizer fills up shorter texts.

    Raises:
        ImportError: `transformers`, `torch` or `pillow` is not installed.
        FileNotFoundError: the model is neither here nor can it be downloaded; the message says what to do.
        ValueError: the model is not CLIP-like.
    """

    def __init__(self, name: str | Path, batch_size: int = 64) -> None:
        if batch_size < 1:
            raise ValueError(f"batch_size must be at least 1, not {batch_size}.")
        try:
            import torch
            import transformers
        except ImportError as error:
            raise ImportError(f"Encoders of transformers need the package {error.name!r}. {INSTALL}") from error
        self.name = str(name)
        self.batch_size = batch_size
        with errors_that_help(self.name):
            model: Any = load_part(transformers.AutoModel, self.name, dtype=torch.float32)
            if not (hasattr(model, "get_text_features") and hasattr(model, "get_image_features")):
                raise ValueError(f"{type(model).__name__} of '{name}' is no CLIP-like model: choose one, e.g. a CLIP.")
            self.model: Any = model.eval()
            self.tokenizer: Any = load_part(transformers.AutoTokenizer, self.name)
            wave, kick = self.tokenizer(["wave", "kick"])["input_ids"]
            if wave == kick:  # what transformers makes of missing files is a tokenizer that knows no words
                raise OSError("its tokenizer knows no words: tokenizer.json, or vocab.json and merges.txt, is missing")
            self.image_processor: Any = load_part(transformers.AutoImageProcessor, self.name, backend="pil")
        text_config = getattr(model.config, "text_config", model.config)
        # Tokenizers that were saved without a limit of their own report an astronomic one.
        self.max_tokens = min(self.tokenizer.model_max_length, getattr(text_config, "max_position_embeddings", 77))
        # SigLIP was trained on texts that are padded to their full length, and reads the padding.
        self.padding = "max_length" if model.config.model_type.startswith("siglip") else True
        self.feature_size = self.encode_text(["a humanoid"]).shape[1]

    def _encode_texts(self, texts: list[str]) -> FloatArray:
        inputs = self.tokenizer(
            texts, padding=self.padding, truncation=True, max_length=self.max_tokens, return_tensors="pt"
        )
        return self._features(self.model.get_text_features, inputs)

    def _encode_pictures(self, frames: NDArray[np.uint8]) -> FloatArray:
        inputs = self.image_processor(images=list(frames), input_data_format="channels_last", return_tensors="pt")
        return self._features(self.model.get_image_features, inputs)

    def _features(self, function: Any, inputs: Any) -> FloatArray:
        import torch

        with torch.inference_mode():
            output = function(**inputs)
        # Newer versions of transformers return the whole output of the tower, of which this is the projected feature.
        return unit(getattr(output, "pooler_output", output).numpy())


def load_part(kind: Any, name: str, **kwargs: Any) -> Any:
    """Reads a part of a model from a folder or from the hub's cache, and only if it is not there from the network."""
    try:
        return kind.from_pretrained(name, local_files_only=True, **kwargs)
    except OSError:
        if Path(name).is_dir():
            raise
    return kind.from_pretrained(name, **kwargs)


@contextmanager
def errors_that_help(name: str) -> Iterator[None]:
    """Replaces the many errors of a failed download by one that says how to go on."""
    try:
        yield
    except ImportError as error:
        raise ImportError(f"The encoder '{name}' needs a package that is not installed ({error}). {INSTALL}") from error
    except OSError as error:
        reason = str(error).strip().splitlines()[0].split(". ")[0].rstrip(".")
        if Path(name).is_dir():
            message = (
                f"The folder '{name}' does not hold a whole model of transformers ({reason}). It needs config.json, the "
                "weights, preprocessor_config.json and the tokenizer's files."
            )
        else:
            message = (
                f"The encoder '{name}' is not on this machine and cannot be downloaded ({reason}). Where there is a "
                f'network, run `hf download {name} --local-dir FOLDER`; then give that folder: encoder="FOLDER".'
            )
        raise FileNotFoundError(message) from error
