"""Figures of the report, as SVG text that goes into the page."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from agents.ablation.measure import MEASURES, Measure
from agents.ablation.plan import Run

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Okabe and Ito: told apart by colour-blind people as well.
_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#555555", "#b8a800")
_MARKS = ("o", "^", "D", "v", "P", "X", "<", ">")
_POINTS = 200
"""Points of a training curve."""
_SMOOTHING = 0.05
"""Share of the training over which a curve is averaged."""


def colours(rewards: Sequence[str]) -> dict[str, str]:
    """A colour for each reward."""
    return {reward: _COLOURS[index % len(_COLOURS)] for index, reward in enumerate(rewards)}


def _figure(width: float, height: float) -> Figure:
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasSVG(figure)
    return figure


def svg(figure: Figure) -> str:
    """A figure as an SVG element, the same for the same figure."""
    import matplotlib

    buffer = io.StringIO()
    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": "ablation", "font.family": "sans-serif"}):
        figure.savefig(buffer, format="svg", metadata={"Date": None})
    text = buffer.getvalue()
    return text[text.index("<svg") :]


def resampled(history: Sequence[dict[str, Any]], key: str, grid: NDArray[np.float64]) -> NDArray[np.float64]:
    """A smoothed training curve at given numbers of decisions; NaN behind its end."""
    steps = np.array([entry["decisions"] for entry in history], float)
    values = np.array([np.nan if entry.get(key) is None else entry[key] for entry in history], float)
    known = np.isfinite(values)
    if not known.any():
        return np.full(len(grid), np.nan)
    steps, values = steps[known], values[known]
    width = max(1, round(_SMOOTHING * len(values)))
    sums = np.concatenate([[0.0], np.cumsum(values)])
    ends = np.arange(1, len(values) + 1)
    starts = np.maximum(ends - width, 0)
    smooth = (sums[ends] - sums[starts]) / (ends - starts)
    return np.interp(grid, steps, smooth, right=np.nan)


def plot_curves(runs: Sequence[Run], histories: Sequence[Sequence[dict[str, Any]]], rewards: Sequence[str]) -> str:
    """Similarity over training, one panel for each text: AnySkill's figure A5.

    A thin line is one seed, the thick one their mean. All rewards are drawn by the same quantity, the similarity of text and
    motion by the encoder of the rewards; one that reads no text has none and is left out.
    """
    texts = list(dict.fromkeys(run.text for run in runs))
    columns = min(3, len(texts))
    rows = -(-len(texts) // columns)
    figure = _figure(4.2 * columns, 2.9 * rows + 0.4)
    axes = np.atleast_1d(figure.subplots(rows, columns, squeeze=False)).ravel()
    palette = colours(rewards)
    longest = max((history[-1]["decisions"] for history in histories if history), default=1)
    grid = np.linspace(0, longest, _POINTS)
    for panel, text in zip(axes, texts, strict=False):
        for reward in rewards:
            own = [
                resampled(history, "similarity", grid)
                for run, history in zip(runs, histories, strict=True)
                if (run.text, run.reward) == (text, reward) and history
            ]
            stacked = np.array(own)
            if not np.nan_to_num(stacked).any():  # a reward that reads no text has none
                continue
            if len(stacked) > 1:
                panel.plot(grid / 1000, stacked.T, color=palette[reward], linewidth=0.7, alpha=0.5)
            seen = np.isfinite(stacked).all(0)  # where some seeds have ended a mean would jump
            panel.plot(grid[seen] / 1000, stacked[:, seen].mean(0), color=palette[reward], linewidth=1.8, label=reward)
        panel.set_title(f"“{text}”", fontsize=10)
        panel.set_xlabel("thousand decisions", fontsize=9)
        panel.set_ylabel("similarity", fontsize=9)
        panel.grid(alpha=0.3)
    for panel in axes[len(texts) :]:
        panel.set_visible(False)
    # of all panels: in the first one a reward may still be missing
    drawn = {label: line for panel in axes for line, label in zip(*panel.get_legend_handles_labels(), strict=True)}
    labels = [reward for reward in rewards if reward in drawn]
    if labels:
        handles = [drawn[reward] for reward in labels]
        figure.legend(handles, labels, loc="outside lower center", ncols=min(len(labels), 6), frameon=False, fontsize=9)
    return svg(figure)


def plot_measures(
    runs: Sequence[Run], values: Sequence[dict[str, Any]], rewards: Sequence[str], summary: dict[str, Any]
) -> str:
    """Every measure by reward: a dot for each run, their mean, and its 95 % interval if they are enough for one."""
    columns = 3
    rows = -(-len(MEASURES) // columns)
    figure = _figure(4.2 * columns, (0.9 + 0.32 * len(rewards)) * rows)
    palette = colours(rewards)
    rng = np.random.default_rng(0)
    names = [f"{reward} ({summary['rewards'][reward]['runs']} runs)" for reward in rewards]
    panels = np.atleast_1d(figure.subplots(rows, columns)).ravel()
    for number, (panel, measure) in enumerate(zip(panels, MEASURES, strict=False)):
        for row, reward in enumerate(rewards):
            own = [each[measure.key] for run, each in zip(runs, values, strict=True) if run.reward == reward]
            dots = np.array([value for value in own if value is not None], float)
            panel.plot(
                dots, row + rng.uniform(-0.2, 0.2, len(dots)), ".", color=palette[reward], alpha=0.5, markersize=6
            )
            summed = summary["rewards"][reward][measure.key]
            if summed is not None:
                panel.plot(summed["mean"], row, "|", color=palette[reward], markersize=14, markeredgewidth=2.5)
                if summed["low"] is not None:
                    panel.plot([summed["low"], summed["high"]], [row, row], color=palette[reward], linewidth=2)
        panel.set_yticks(range(len(rewards)), names if number % columns == 0 else [""] * len(rewards), fontsize=9)
        panel.set_ylim(len(rewards) - 0.5, -0.5)
        if measure.percent:
            panel.set_xlim(-0.03, 1.03)
        panel.set_title(_title(measure), fontsize=10)
        panel.grid(alpha=0.3, axis="x")
    for panel in panels[len(MEASURES) :]:
        panel.set_visible(False)
    return svg(figure)


def _title(measure: Measure) -> str:
    arrow = {"higher": " (more is better)", "lower": " (less is better)", "": ""}[measure.better]
    return measure.label + arrow


def plot_agreement(runs: Sequence[Run], values: Sequence[dict[str, Any]], rewards: Sequence[str]) -> str:
    """Success over CLIP_S, a mark for each run of a text with a check; empty if there is none."""
    pairs = [(run, each["clip_s"], each["success"]) for run, each in zip(runs, values, strict=True)]
    known = [pair for pair in pairs if None not in pair]
    if not known:
        return ""
    figure = _figure(7.6, 3.4)
    panel = figure.subplots()
    palette = colours(rewards)
    texts = list(dict.fromkeys(run.text for run, _, _ in known))
    marks = {text: _MARKS[index % len(_MARKS)] for index, text in enumerate(texts)}
    for run, x, y in known:
        panel.plot(x, y, marks[run.text], color=palette[run.reward], alpha=0.7, markersize=6)
    for reward in [reward for reward in rewards if any(run.reward == reward for run, _, _ in known)]:
        panel.plot([], [], "s", color=palette[reward], label=reward)
    for text, mark in marks.items():
        panel.plot([], [], mark, color="#888888", label=f"“{text}”")
    panel.set_xlabel("CLIP_S")
    panel.set_ylabel("success")
    panel.set_ylim(-0.04, 1.04)
    panel.grid(alpha=0.3)
    figure.legend(loc="outside right upper", fontsize=8, frameon=False)
    return svg(figure)
