"""First stage: texts that are too short, too long, or nearly the same as an earlier one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from agents.texts.lines import Record, kept
from agents.texts.sentences import count_tokens, sentence_vector


@dataclass(frozen=True)
class FilterRules:
    """What is dropped. The numbers are those of AnySkill (Cui et al., CVPR 2024, appendix A.1).

    There the vectors were those of a language model of 7 billion parameters; here they are of a small sentence model, for
    which the same threshold drops closer paraphrases only.

    Attributes:
        fewest_tokens: A text with fewer is dropped.
        most_tokens: A text with more is dropped.
        duplicate_cosine: A text whose vector has a larger cosine with that of an earlier kept one is dropped.
    """

    fewest_tokens: int = 3
    most_tokens: int = 77
    duplicate_cosine: float = 0.92

    def __post_init__(self) -> None:
        if not 0 < self.fewest_tokens <= self.most_tokens:
            raise ValueError(f"Tokens must be at least 1 and in order, got {self.fewest_tokens} to {self.most_tokens}.")
        if not -1 <= self.duplicate_cosine <= 1:
            raise ValueError(f"duplicate_cosine must be between -1 and 1, got {self.duplicate_cosine}.")


class _Vectors:
    """Vectors of the texts that were kept so far, in an array that doubles when it is full."""

    def __init__(self) -> None:
        self._array = np.empty((64, 384), np.float32)
        self.texts: list[str] = []

    def add(self, text: str, vector: np.ndarray) -> None:
        if len(self.texts) == len(self._array):
            self._array = np.concatenate([self._array, np.empty_like(self._array)])
        self._array[len(self.texts)] = vector
        self.texts.append(text)

    def nearest(self, vector: np.ndarray) -> tuple[int, float]:
        cosines = self._array[: len(self.texts)] @ vector
        place = int(cosines.argmax())
        return place, float(cosines[place])


def filter_stage(rules: FilterRules) -> Callable[[list[Record]], Callable[[Record], Record]]:
    """The stage for :func:`agents.texts.lines.run_stage`."""

    def begin(done: list[Record]) -> Callable[[Record], Record]:
        vectors = _Vectors()
        for record in kept(done):
            vectors.add(record["text"], sentence_vector(record["text"]))

        def apply(record: Record) -> Record:
            text = record["text"]
            tokens = count_tokens(text)
            if tokens < rules.fewest_tokens:
                return record | {"dropped": f"{tokens} tokens, fewer than {rules.fewest_tokens}"}
            if tokens > rules.most_tokens:
                return record | {"dropped": f"{tokens} tokens, more than {rules.most_tokens}"}
            vector = sentence_vector(text)
            if vectors.texts:
                place, cosine = vectors.nearest(vector)
                if cosine > rules.duplicate_cosine:
                    return record | {"dropped": f"cosine {cosine:.3f} with {vectors.texts[place]!r}"}
            vectors.add(text, vector)
            return record

        return apply

    return begin
