"""Reads the further wordings of the posecodes from wordings.yaml, which says how they are written."""

from __future__ import annotations

import re
from collections.abc import Collection
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import yaml

from agents.encoder.captions import gerund
from agents.encoder.sided_lines import sided_lines

WORDINGS = Path(__file__).with_suffix(".yaml")
"""The file of further wordings."""
_PARTS = ("nominals", "clauses", "imperatives", "both")


@dataclass(frozen=True)
class FurtherWordings:
    """What other people say for a posecode; the fields are those of :class:`agents.encoder.posecodes.Posecode`."""

    nominals: tuple[str, ...] = ()
    clauses: tuple[str, ...] = ()
    imperatives: tuple[str, ...] = ()


def further_wordings(name: str, path: Path = WORDINGS) -> FurtherWordings:
    """The further wordings of a posecode; none if the file has none.

    Args:
        name: name of the posecode; ".left", ".right" and ".both" at its end say the side, ".one" has no wordings.
        path: the file.

    Raises:
        ValueError: an entry has an unknown part, or a wording of a side names none.
    """
    stem, _, side = name.partition(".")
    entry = _read(path).get(stem, {})
    if side == "one":
        return FurtherWordings()
    if side == "both":
        return _sorted(sided_lines(entry.get("both", ""), "", stem, path.name))
    return FurtherWordings(*(sided_lines(entry.get(part, ""), side, stem, path.name) for part in _PARTS[:3]))


def check_stems(stems: Collection[str], path: Path = WORDINGS) -> None:
    """Makes sure that the file speaks of posecodes that exist.

    Args:
        stems: their names without side.
        path: the file.

    Raises:
        ValueError: there is a wording of something else.
    """
    unknown = [stem for stem in _read(path) if stem not in stems]
    if unknown:
        raise ValueError(f"{path.name}: there is no posecode {unknown[0]}; name one of {', '.join(sorted(stems))}.")


@cache
def _read(path: Path) -> dict[str, dict[str, str]]:
    entries: dict[str, dict[str, str]] = yaml.safe_load(path.read_text(encoding="utf-8"))
    for stem, entry in entries.items():
        unknown = [part for part in entry if part not in _PARTS]
        if unknown:
            raise ValueError(f"{path.name}: {stem} has the part {unknown[0]!r}; there are {', '.join(_PARTS)}.")
    return entries


def _sorted(lines: tuple[str, ...]) -> FurtherWordings:
    """Tells sentences and orders from noun phrases."""
    clauses = tuple(line for line in lines if re.search(r"\b(is|are|has|have)\b", line))
    imperatives = tuple(line for line in lines if line not in clauses and gerund(line))
    return FurtherWordings(tuple(line for line in lines if line not in clauses + imperatives), clauses, imperatives)
