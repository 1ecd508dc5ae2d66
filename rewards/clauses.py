"""Splits a text into clauses, each of which an encoder reads alone: what holds of a motion is their sum."""

from __future__ import annotations

import re

_BETWEEN = re.compile(r"\s*[,;:./!?]+(?:\s+(?:and|while|with|then|but|whereas)\b)?\s+|\s+(?:while|whilst|whereas)\s+")
_SHORTEST = 2
"""Words of a clause at least; a single word, as in "slowly, carefully walk", stays with what follows."""


def split_clauses(text: str) -> list[str]:
    """The clauses of a text: "squat down, the arms up while looking left" has three.

    Args:
        text: the text.

    Returns:
        At least one clause, in lower case with single spaces and without the full stop.
    """
    words = " ".join(text.lower().split()).strip(" .!,;")
    clauses: list[str] = []
    kept = ""
    for part in _BETWEEN.split(words):
        joined = f"{kept} {part}".strip()
        kept = ""
        if len(joined.split()) < _SHORTEST:
            kept = joined
        else:
            clauses.append(joined)
    if kept and clauses:
        clauses[-1] = f"{clauses[-1]} {kept}"
    return clauses or [kept or words]
