"""Second and third stage: score what the filter left, and rewrite what scored well; by a language model or by rules."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import dataclass

from agents.texts import prompts, rules
from agents.texts.endpoint import ChatEndpoint
from agents.texts.lines import Record

Stage = Callable[[list[Record]], Callable[[Record], Record]]
HIGHEST = 10.0
CRITERIA = {"plainness": prompts.PLAINNESS, "clearness": prompts.CLEARNESS}
"""The two criteria of AnySkill's appendix A.1, and what a model is told about each."""

_REWRITE_TRIES = 3


@dataclass(frozen=True)
class Scorer:
    """Scores captions from 0 to 10 by each criterion.

    Attributes:
        endpoint: The language model; None scores by rules.
        least: A caption with a lower score by any criterion is dropped.
    """

    endpoint: ChatEndpoint | None
    least: float

    def __post_init__(self) -> None:
        if not 0 <= self.least <= HIGHEST:
            raise ValueError(f"least must be between 0 and {HIGHEST:g}, got {self.least}.")

    def __call__(self, record: Record) -> Record:
        """The record with its `scores`, dropped if one of them is too low or the model gave none."""
        scores = {}
        for name, criterion in CRITERIA.items():
            if self.endpoint is None:
                scores[name] = (rules.score_plainness if name == "plainness" else rules.score_clearness)(record["text"])
                continue
            answer = self.endpoint.ask(prompts.SCORE_INSTRUCTION.format(criterion=criterion), record["text"])
            score = read_score(answer)
            if score is None:
                return record | {"dropped": f"no score for {name} in the answer {answer[:60]!r}"}
            scores[name] = score
        result = record | {"scores": scores}
        low = [f"{name} {score:g}" for name, score in scores.items() if score < self.least]
        return result | {"dropped": f"{' and '.join(low)}, less than {self.least:g}"} if low else result


def read_score(answer: str) -> float | None:
    """The score in a model's answer, {"score": 7} or a bare number; None if there is none from 0 to 10."""
    found = re.search(r"\{[^{}]*\}", answer)
    try:
        value = float(json.loads(found.group())["score"]) if found else float(answer.strip().rstrip("."))
    except (ValueError, KeyError, TypeError):
        return None
    return value if 0 <= value <= HIGHEST else None


@dataclass(frozen=True)
class Rewriter:
    """Turns captions into instructions that keep the rules of appendix A.1.

    Attributes:
        endpoint: The language model; None rewrites by rules.
    """

    endpoint: ChatEndpoint | None

    def __call__(self, record: Record) -> Record:
        """The record with the instruction as its `text`; dropped if none could be found that keeps the rules."""
        text = record["text"]
        instruction = rules.rewrite(text) if self.endpoint is None else self._asked(self.endpoint, text)
        found = rules.faults(instruction)
        result = record | {"text": instruction, "rewritten_from": text}
        return (
            result | {"dropped": f"the instruction {instruction!r} breaks rules: {'; '.join(found)}"}
            if found
            else result
        )

    def _asked(self, endpoint: ChatEndpoint, text: str) -> str:
        """A model's instruction; told what is wrong with it, a model often mends it."""
        question = text
        instruction = ""
        for _ in range(_REWRITE_TRIES):
            answer = endpoint.ask(prompts.REWRITE_INSTRUCTION, question)
            lines = answer.splitlines()
            instruction = " ".join((lines[0] if lines else "").strip().strip("\"'“”.").lower().split())
            found = rules.faults(instruction)
            if not found:
                break
            question = prompts.REWRITE_AGAIN.format(text=text, answer=instruction, faults="; ".join(found))
        return instruction


def each_alone(function: Callable[[Record], Record]) -> Stage:
    """A stage that looks at every record alone."""
    return lambda done: function
