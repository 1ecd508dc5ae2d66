"""`anyskill texts`: filter, score and rewrite captions, one JSON object a line in and out."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import tyro

from agents.texts.endpoint import ChatEndpoint
from agents.texts.filter import FilterRules, filter_stage
from agents.texts.judge import Rewriter, Scorer, Stage, each_alone
from agents.texts.lines import Record, kept, run_stage

Source = Annotated[Path, tyro.conf.Positional]
Output = Annotated[Path, tyro.conf.Positional]


def filter_texts(
    source: Source,
    output: Output,
    fewest_tokens: int = 3,
    most_tokens: int = 77,
    duplicate_cosine: float = 0.92,
    progress: bool = True,
) -> int:
    """Drop captions that are too short, too long, or nearly the same as an earlier one.

    Every line of the source comes out again; a dropped one says why under "dropped", and later stages pass it by.

    Args:
        source: File with a JSON object a line, each with a "text".
        output: File to write; one that was begun is continued.
        fewest_tokens: Captions with fewer tokens are dropped.
        most_tokens: Captions with more tokens are dropped.
        duplicate_cosine: Captions with a larger cosine to an earlier one are dropped.
        progress: Show a progress bar.
    """
    rules = FilterRules(fewest_tokens, most_tokens, duplicate_cosine)
    return _run(source, output, {"stage": "filter", **asdict(rules)}, filter_stage(rules), "filtering", progress)


def score_texts(
    source: Source,
    output: Output,
    least: float = 6.0,
    endpoint: str | None = None,
    model: str = "",
    progress: bool = True,
) -> int:
    """Score captions from 0 to 10 by how plain and how clear they are, and drop the lower ones.

    Args:
        source: File with a JSON object a line, such as the filter's output.
        output: File to write; one that was begun is continued.
        least: Captions with a lower score by either criterion are dropped.
        endpoint: Address of an OpenAI-compatible server, such as http://localhost:8000/v1; rules that work offline if left
            out. A key is read from the environment variable ANYSKILL_API_KEY.
        model: Name of the model there.
        progress: Show a progress bar.
    """
    scorer = Scorer(_endpoint(endpoint, model), least)
    settings = {"stage": "score", "least": least, "model": model if endpoint else "rules"}
    return _run(source, output, settings, each_alone(scorer), "scoring", progress)


def rewrite_texts(
    source: Source, output: Output, endpoint: str | None = None, model: str = "", progress: bool = True
) -> int:
    """Turn captions into short instructions about one posture or movement.

    Args:
        source: File with a JSON object a line, such as the scored captions.
        output: File to write; one that was begun is continued.
        endpoint: Address of an OpenAI-compatible server, such as http://localhost:8000/v1; rules that work offline if left
            out. A key is read from the environment variable ANYSKILL_API_KEY.
        model: Name of the model there.
        progress: Show a progress bar.
    """
    rewriter = Rewriter(_endpoint(endpoint, model))
    settings = {"stage": "rewrite", "model": model if endpoint else "rules"}
    return _run(source, output, settings, each_alone(rewriter), "rewriting", progress)


def _endpoint(address: str | None, model: str) -> ChatEndpoint | None:
    if address is None and model:
        raise ValueError(f"--model {model} needs the --endpoint where it runs; without both, rules do the work.")
    return None if address is None else ChatEndpoint(address, model)


def _run(source: Path, output: Path, settings: Record, stage: Stage, doing: str, shown: bool) -> int:
    def progress(records: Iterable[Record], done: int, total: int) -> Iterable[Record]:
        try:
            from tqdm import tqdm
        except ImportError:  # a bar is no reason to need a package
            return records
        bar: Iterable[Record] = tqdm(records, desc=doing, initial=done, total=total, unit="text", disable=not shown)
        return bar

    records = run_stage(source, output, settings, stage, progress)
    left = sum(1 for _ in kept(records))
    print(f"{left} of {len(records)} texts are left; all are in {output}, with the reason where one was dropped.")
    return 0
