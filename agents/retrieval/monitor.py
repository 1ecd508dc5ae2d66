"""What runs beside PPO while it trains a retriever."""

from __future__ import annotations

from typing import Any

import numpy as np

from agents.training.monitor import TrainingMonitor


class RetrievalMonitor(TrainingMonitor):
    """The training monitor with the measures of locomotion.

    The history holds means over an update of `reward`, `velocity_error` (m/s, at the end of decisions) and `action_size`
    (mean absolute deviation of the weights from 1), and `falls`.
    """

    section = "retrieval"

    def sums_of(self, infos: list[dict[str, Any]]) -> dict[str, float]:
        """Sums over the infos of one step of all humanoids."""
        actions = np.asarray(self.locals["clipped_actions"])
        return {
            "reward": float(np.sum([info["reward_goal"] + info["reward_clip"] for info in infos])),
            "velocity_error": float(np.sum([info["velocity_error"] for info in infos])),
            "action_size": float(np.abs(actions).mean() * len(infos)),
        }

    def headline(self, entry: dict[str, float]) -> str:
        """What the progress bar says."""
        return f"velocity error {entry['velocity_error']:.2f} m/s"
