"""Lengths and vectors of sentences, by the sentence model that the bundled encoder reads texts with."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rewards.minilm import load_minilm, verified_folder


@cache
def _tokenizer() -> Any:
    import tokenizers

    tokenizer = tokenizers.Tokenizer.from_file(str(verified_folder() / "tokenizer.json"))
    tokenizer.no_truncation()
    tokenizer.no_padding()
    return tokenizer


def count_tokens(text: str) -> int:
    """Tokens of a text, without those that mark its start and end."""
    return len(_tokenizer().encode(text, add_special_tokens=False).ids)


def sentence_vector(text: str) -> NDArray[np.float32]:
    """Unit vector of a sentence, `(384,)`: the mean of its token states, as all-MiniLM-L6-v2 was trained for."""
    states, mask = load_minilm().token_states([" ".join(text.lower().split())])
    mean = (states[0] * mask[0, :, None]).sum(0) / mask[0].sum()
    vector: NDArray[np.float32] = mean / np.linalg.norm(mean)
    return vector
