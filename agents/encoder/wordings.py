"""Reads the further wordings of the concepts from wordings.yaml, which says how they are written."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import yaml

from agents.encoder.concepts import Concept
from agents.encoder.sided_lines import sided_lines

WORDINGS = Path(__file__).with_suffix(".yaml")
"""The file of further wordings."""


def with_further_wordings(concepts: Sequence[Concept], path: Path = WORDINGS) -> tuple[Concept, ...]:
    """The concepts with the further wordings that a file gives them.

    Args:
        concepts: the concepts.
        path: the file: a text per name of a concept without its side, with one wording on each line.

    Raises:
        ValueError: the file has a name that is no concept, or a wording of a sided concept names no side. Names with a
            colon, such as "ball:kicking", may be missing: which there are depends on the objects and the clips.
    """
    texts: dict[str, str] = yaml.safe_load(path.read_text(encoding="utf-8"))
    written: list[Concept] = []
    names: set[str] = set()
    for concept in concepts:
        stem, side = _split(concept.name)
        names.add(stem)
        lines = sided_lines(texts.get(stem, ""), side, stem, path.name)
        written.append(replace(concept, further=lines))
    unknown = [name for name in texts if name not in names and ":" not in name]
    if unknown:
        raise ValueError(
            f"{path.name}: there is no concept {', '.join(unknown)}; name one of {', '.join(sorted(names))}."
        )
    return tuple(written)


def _split(name: str) -> tuple[str, str]:
    """Name of a concept without its side, and the side or nothing."""
    stem, _, side = name.rpartition(".")
    return (stem, side) if side in ("left", "right") else (name, "")
