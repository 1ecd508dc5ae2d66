"""What a finished run learned, in numbers: measured on its recorded evaluation episodes, and kept beside them."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from agents.ablation.evaluator import Evaluator
from agents.ablation.plan import Run
from agents.text.evaluate import Episode, load_rollouts, scene_of
from agents.training.run_folder import RunFolder
from motion_data.library import MotionLibrary
from motion_data.metrics import (
    foot_skate,
    frechet_distance,
    frechet_floor,
    jerk,
    multimodality,
    nearest_distance,
    sole_corners,
)
from motion_data.motion_features import windowed_features
from motion_data.skeleton import QPOS_SIZE, kinematics

MEASURES_FILE = "measures.json"
_VERSION = 2
_SHORTEST = 4
"""Frames below which an episode has no jerk and no features: it fell at once."""


@dataclass(frozen=True)
class Measure:
    """A column of the report.

    Attributes:
        key: Its name in results.json.
        label: Its name for people, with its unit.
        better: Which way is better.
        digits: Decimals that are shown.
        percent: Whether it is a share, shown in percent.
        meaning: One sentence for the report.
    """

    key: str
    label: str
    better: Literal["higher", "lower", ""]
    digits: int
    meaning: str
    percent: bool = False

    def show(self, value: float) -> str:
        """The number as text."""
        if not np.isfinite(value):
            return "–"
        return f"{100 * value:.0f} %" if self.percent else f"{value:.{self.digits}f}"


MEASURES = (
    Measure("clip_s", "CLIP_S", "higher", 1, "100 x cosine of text and motion by the evaluator, mean over an episode."),
    Measure(
        "success", "success", "higher", 0, "Share of the episodes that pass the text's check and do not fall.", True
    ),
    Measure("fall", "falls", "lower", 0, "Share of the episodes with a fall.", True),
    Measure(
        "jerk", "jerk, m/s³", "lower", 0, "Smoothness: mean size of the third derivative of the paths of the bodies."
    ),
    Measure(
        "naturalness",
        "Fréchet distance",
        "lower",
        1,
        "Naturalness: squared Fréchet distance of 2 s windows to those of the motion library, in 88 posture and kinetic "
        "features (motion_data/motion_features.py), each divided by its standard deviation in the library. The library shows "
        "many skills, so one skill is never near it as a whole: compare runs of the same texts.",
    ),
    Measure(
        "library_distance",
        "nearest in library",
        "lower",
        2,
        "Naturalness of what is done, whatever is not: mean distance of 2 s windows to the most similar one of the library, "
        "in the same features.",
    ),
    Measure("foot_skate", "foot skate, m/s", "lower", 3, "Mean speed of the soles over the floor while they touch it."),
    Measure(
        "multimodality",
        "diversity within a text",
        "",
        2,
        "Mean distance between two episodes of a run in these features (multimodality, Guo et al. 2020).",
    ),
)
"""What is measured of each run, in the order of the report."""


class LibraryFeatures:
    """Features of the motion library, by whose spread all features are measured.

    Args:
        library: The library; the project's own if None.
    """

    def __init__(self, library: MotionLibrary | None = None) -> None:
        clips = (library or MotionLibrary.default()).clips
        raw = np.concatenate([windowed_features(clip.qpos) for clip in clips if len(clip) >= _SHORTEST])
        self._mean = raw.mean(0)
        self._scale = np.maximum(raw.std(0), 1e-3)  # m, m/s or m/s^2; the pelvis has no place relative to itself
        self.features = self.normalised(raw)

    def normalised(self, features: NDArray[np.float64]) -> NDArray[np.float64]:
        """Features in units of their spread in the library."""
        return (features - self._mean) / self._scale

    @cached_property
    def floor(self) -> float:
        """Fréchet distance between random halves of the library: less cannot be told from none."""
        return frechet_floor(self.features, np.random.default_rng(0))


def measure_run(run: Run, evaluator: Evaluator, library: LibraryFeatures) -> dict[str, Any]:
    """Numbers of one finished run; measured once, then read from its folder.

    Returns:
        A value for each of `MEASURES` (None if it cannot be measured), `episode_features` `(episodes, 88)` for the
        diversity of several runs, and `similarity`, `reward_per_decision`, `decisions` and `minutes` from the run's own report.
    """
    path = run.folder.path / MEASURES_FILE
    made_from = {
        "version": _VERSION,
        "evaluator": evaluator.digest,
        "library": round(float(np.abs(library.features).sum()), 3),
        "rollouts": run.folder.rollouts.stat().st_mtime_ns,
    }
    if path.is_file():
        kept = json.loads(path.read_text(encoding="utf-8"))
        if kept["made_from"] == made_from:
            return kept["values"]
    values = _measure(load_rollouts(run.folder.rollouts), run, evaluator, library)
    RunFolder(run.folder.path).write_json(path, {"made_from": made_from, "values": values})
    return values


def _measure(episodes: list[Episode], run: Run, evaluator: Evaluator, library: LibraryFeatures) -> dict[str, Any]:
    moving = [episode.qpos[:, :QPOS_SIZE] for episode in episodes if len(episode.qpos) >= _SHORTEST]
    windows = [library.normalised(windowed_features(qpos)) for qpos in moving]
    poses = [kinematics(qpos) for qpos in moving]
    means = np.array([each.mean(0) for each in windows])
    successes = [float(episode.success) for episode in episodes if episode.success is not None]
    motions = [(episode.qpos, episode.observations) for episode in episodes]
    scores = evaluator.scores(motions, run.text, scene_of(run.config.env))
    skates = np.array([foot_skate(sole_corners(pose.positions, pose.quaternions)) for pose in poses])
    together = np.concatenate(windows) if windows else np.zeros((0, 1))
    values: dict[str, float | None] = {
        "clip_s": float(np.mean(scores)),
        "success": float(np.mean(successes)) if successes else None,
        "fall": float(np.mean([episode.fell for episode in episodes])),
        "jerk": float(np.mean([jerk(pose.positions) for pose in poses])) if poses else None,
        "naturalness": frechet_distance(together, library.features) if len(together) > 1 else None,
        "library_distance": nearest_distance(together, library.features) if len(together) > 1 else None,
        "foot_skate": float(np.nanmean(skates)) if np.isfinite(skates).any() else None,
        "multimodality": (multimodality(means[None], np.random.default_rng(0), pairs=200) if len(means) > 1 else None),
    }
    report = json.loads(run.folder.report.read_text(encoding="utf-8"))
    return values | {
        "episode_features": means.tolist(),
        "similarity": report["evaluation"]["similarity"],
        "reward_per_decision": report["evaluation"]["reward"],
        "decisions": report["training"]["decisions"],
        "minutes": report["training"]["minutes"],
    }
