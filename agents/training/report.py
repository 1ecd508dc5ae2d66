"""What reports of runs share: the versions that a result depends on, and curve.png with what training looked like."""

from __future__ import annotations

import importlib.metadata
import platform
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

_PACKAGES = ("anyskill-envs", "gymnasium", "mujoco", "numpy", "onnxruntime", "stable-baselines3", "torch")


def versions() -> dict[str, str]:
    """Versions of Python and of the packages that matter for a result."""
    found = {"python": platform.python_version(), "system": f"{platform.system()} {platform.machine()}"}
    for name in _PACKAGES:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            found[name] = "not installed"
    return found


def _smooth(values: list[float | None], width: int) -> np.ndarray:
    """Running mean over the last `width` values; None counts as missing."""
    array = np.array([np.nan if value is None else value for value in values], float)
    known = np.isfinite(array)
    if not len(array):
        return array
    window = np.ones(width)
    sums = np.convolve(np.where(known, array, 0.0), window)[: len(array)]
    counts = np.convolve(known, window)[: len(array)]
    return np.divide(sums, counts, out=np.full(len(array), np.nan), where=counts > 0)


def plot_curve(path: Path, history: list[dict[str, Any]], title: str, panels: Sequence[tuple[str, str, str]]) -> None:
    """Draws measures over minutes of training; what the history does not measure is left out.

    Args:
        path: The picture, ending in .png.
        history: Entries of `agents.training.monitor.TrainingMonitor`.
        title: Title of the picture.
        panels: Key in the history, title and colour of each panel.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 3.2), layout="constrained")
    FigureCanvasAgg(figure)
    panels = [panel for panel in panels if not history or panel[0] in history[-1]]
    minutes = [entry["seconds"] / 60 for entry in history]
    width = max(1, len(history) // 50)
    for axes, (key, label, colour) in zip(figure.subplots(1, len(panels)), panels, strict=True):
        values = [entry.get(key) for entry in history]
        axes.plot(minutes, np.array(values, float), color=colour, alpha=0.25, linewidth=1)
        axes.plot(minutes, _smooth(values, width), color=colour, linewidth=2)
        axes.set_title(label, fontsize=10)
        axes.set_xlabel("minutes of training")
        axes.grid(alpha=0.3)
        if key == "falls":
            axes.set_ylim(-0.02, 1.02)
    figure.suptitle(title, fontsize=11)
    figure.savefig(path, dpi=110)
