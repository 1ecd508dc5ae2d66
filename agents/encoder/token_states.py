"""Token states of many texts by the frozen sentence model, kept in a file and handed out in batches."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional
from tqdm import tqdm

from rewards.minilm import TOKEN_SIZE, load_minilm

_LAYERS, _HEADS, _AT_ONCE = 6, 12, 32


def _read(texts: list[str]) -> list[NDArray[np.float16]]:
    """Token states of texts, `(tokens, 384)` each; many texts of one length at once, which is faster than one by one.

    What comes out differs from :meth:`rewards.minilm.MiniLm.token_states` in the last digits of float32 alone.
    """
    model = load_minilm()
    weights = {name: torch.from_numpy(np.array(value, np.float32)) for name, value in model._weights.items()}
    tokens = [model._tokenizer.encode(text).ids for text in texts]
    order = sorted(range(len(texts)), key=lambda row: len(tokens[row]))
    parts: list[NDArray[np.float16]] = [np.zeros((0, TOKEN_SIZE), np.float16)] * len(texts)
    progress = tqdm(total=len(texts), desc="reading captions", unit="text")
    with torch.inference_mode():
        for _, same in groupby(order, key=lambda row: len(tokens[row])):
            rows = list(same)
            for start in range(0, len(rows), _AT_ONCE):
                some = rows[start : start + _AT_ONCE]
                states = _forward(weights, torch.tensor([tokens[row] for row in some])).numpy()
                for row, state in zip(some, states, strict=True):
                    parts[row] = state.astype(np.float16)
                progress.update(len(some))
    progress.close()
    return parts


def _forward(weights: dict[str, Tensor], tokens: Tensor) -> Tensor:
    """Last hidden states `(k, tokens, 384)` of texts of one length."""

    def linear(name: str, x: Tensor) -> Tensor:
        return functional.linear(x, weights[f"{name}.weight"], weights[f"{name}.bias"])

    def norm(name: str, x: Tensor) -> Tensor:
        return functional.layer_norm(x, (TOKEN_SIZE,), weights[f"{name}.weight"], weights[f"{name}.bias"], 1e-12)

    count, length = tokens.shape
    x = weights["embeddings.word_embeddings.weight"][tokens]
    x = (
        x
        + weights["embeddings.position_embeddings.weight"][:length]
        + weights["embeddings.token_type_embeddings.weight"][0]
    )
    x = norm("embeddings.LayerNorm", x)
    for layer in range(_LAYERS):
        name = f"encoder.layer.{layer}."
        query, key, value = (
            linear(f"{name}attention.self.{kind}", x).reshape(count, length, _HEADS, -1).transpose(1, 2)
            for kind in ("query", "key", "value")
        )
        mixed = (
            functional.scaled_dot_product_attention(query, key, value)
            .transpose(1, 2)
            .reshape(count, length, TOKEN_SIZE)
        )
        x = norm(f"{name}attention.output.LayerNorm", x + linear(f"{name}attention.output.dense", mixed))
        hidden = functional.gelu(linear(f"{name}intermediate.dense", x))
        x = norm(f"{name}output.LayerNorm", x + linear(f"{name}output.dense", hidden))
    return x


class TokenStore:
    """Token states of texts, one after another without padding.

    Args:
        texts: the texts; equal ones are kept once.
        cache: file that keeps them; it is made again when it holds other texts.
    """

    def __init__(self, texts: Sequence[str], cache: Path) -> None:
        unique = list(dict.fromkeys(texts))
        self._row = {text: row for row, text in enumerate(unique)}
        if cache.is_file():
            with np.load(cache, allow_pickle=False) as archive:
                if "starts" in archive and archive["texts"].tolist() == unique:
                    self._states, self._starts = archive["states"], archive["starts"]
                    return
        parts = _read(unique)
        self._states = np.concatenate(parts) if parts else np.zeros((0, TOKEN_SIZE), np.float16)
        self._starts = np.cumsum([0, *(len(part) for part in parts)])
        cache.parent.mkdir(parents=True, exist_ok=True)
        np.savez(cache, texts=np.array(unique), states=self._states, starts=self._starts)

    def length(self, text: str) -> int:
        """Tokens of a text of the store."""
        row = self._row[text]
        return int(self._starts[row + 1] - self._starts[row])

    def batch(self, texts: Sequence[str]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """States `(k, tokens, 384)` of k texts of the store, and masks `(k, tokens)`, 0 for padding."""
        lengths = [self.length(text) for text in texts]
        states = np.zeros((len(texts), max(lengths), TOKEN_SIZE), np.float32)
        mask = np.zeros((len(texts), max(lengths)), np.float32)
        for place, (text, length) in enumerate(zip(texts, lengths, strict=True)):
            start = self._starts[self._row[text]]
            states[place, :length] = self._states[start : start + length]
            mask[place, :length] = 1.0
        return states, mask
