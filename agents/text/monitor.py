"""What runs beside PPO while it learns a text."""

from __future__ import annotations

from typing import Any

import numpy as np

from agents.text.checks import FALL_HEAD_HEIGHT
from agents.training.monitor import TrainingMonitor


class TextMonitor(TrainingMonitor):
    """The training monitor with the measures of text skills.

    The history holds means over an update of `reward`, `similarity` (not there if the reward reads no text) and `lying`
    (share of decisions that end with the head centre below 0.5 m), and `falls`.
    """

    section = "text"

    def sums_of(self, infos: list[dict[str, Any]]) -> dict[str, float]:
        """Sums over the infos of one step of all humanoids."""
        sums = {
            # the environment's own reward, without the bonus
            "reward": sum(value for info in infos for name, value in info.items() if name.startswith("reward_")),
            "lying": float(np.sum([info["head_height"] < FALL_HEAD_HEIGHT for info in infos])),
        }
        if "similarity" in infos[0]:
            sums["similarity"] = float(np.sum([info["similarity"] for info in infos]))
        return sums

    def headline(self, entry: dict[str, float]) -> str:
        """What the progress bar says."""
        name = "similarity" if "similarity" in entry else "reward"
        return f"{name} {entry[name]:.3f}"
