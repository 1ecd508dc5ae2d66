"""What the report of a text skill says about its training."""

from __future__ import annotations

from typing import Any

import numpy as np

PANELS = (
    ("similarity", "similarity of text and motion", "#1b6ca8"),
    ("reward", "reward per decision", "#5a8f29"),
    ("falls", "episodes ended by a fall", "#c0392b"),
)
"""Key in the history, title and colour of what is drawn."""


def similarity_ends(history: list[dict[str, Any]]) -> dict[str, float | None]:
    """Mean similarity with exploration over the first and the last tenth of the updates.

    Both are None without history, and for a reward that reads no text.
    """
    values = [entry["similarity"] for entry in history if "similarity" in entry]
    if not values:
        return {"start": None, "end": None}
    count = max(1, len(values) // 10)
    return {"start": float(np.mean(values[:count])), "end": float(np.mean(values[-count:]))}
