"""How much a controller's motion is like the reference: can a clip be told by it, does it slide and jerk, is it symmetric."""

from typing import Any

import numpy as np

from agents.controller.reference import ReferenceMotions
from agents.controller.rollout import Controller, Encoder, Performance
from agents.controller.selection import ACROBATIC, base_name, unmirrored_clips, window_frames
from anyskill_envs.observation import MIRROR_INDEX, MIRROR_SIGN
from anyskill_envs.simulation import CONTROLLER_STEPS
from motion_data.metrics import foot_skate, jerk, sole_corners
from motion_data.skeleton import MIRROR_JOINT_SIGNS, MIRROR_JOINTS, kinematics
from motion_data.window import WINDOW_FRAMES, WINDOW_MIRROR_INDEX, WINDOW_MIRROR_SIGN, window_features

_LEAST_SPREAD = 0.02  # metres or radians: features that hardly change must not decide what a motion is


class MotionClassifier:
    """Names the clip that a motion performs: naive Bayes nearest neighbour on windows of 2 s (Boiman et al. 2008).

    A motion belongs to the clip c with the least sum over its windows w of min |w - v|^2 over the windows v of c. Features
    (:func:`motion_data.window.window_features`) are divided by their standard deviation over all reference windows.

    Args:
        windows: Windows of the reference clips, ``(n, 60, 39)``.
        clips: Clip of each window, ``(n,)``, in ascending order.
    """

    def __init__(self, windows: np.ndarray, clips: np.ndarray):
        self._scale = 1 / np.maximum(windows.reshape(-1, windows.shape[-1]).std(0), _LEAST_SPREAD)
        self._reference = (windows * self._scale).reshape(len(windows), -1)
        self._squares = (self._reference**2).sum(1)
        self.clips, self._first = np.unique(clips, return_index=True)

    def classify(self, windows: np.ndarray, motions: np.ndarray) -> np.ndarray:
        """Names motions.

        Args:
            windows: Their windows, ``(m, 60, 39)``.
            motions: Motion of each window, ``(m,)``, in ascending order.

        Returns:
            The clip of each motion, in the order of ``np.unique(motions)``.
        """
        flat = (windows * self._scale).reshape(len(windows), -1)
        squared = (flat**2).sum(1)[:, None] + self._squares - 2 * flat @ self._reference.T
        nearest = np.minimum.reduceat(np.maximum(squared, 0), self._first, axis=1)
        total = np.add.reduceat(nearest, np.unique(motions, return_index=True)[1], axis=0)
        return self.clips[total.argmin(1)]


def evaluate_naming(performance: Performance, motions: ReferenceMotions) -> dict[str, Any]:
    """Lets a classifier of the unmirrored reference clips name the clips from the simulated motion.

    Args:
        performance: Performances of unmirrored clips.
        motions: Reference motions.

    Returns:
        ``top1``, the share named right, mean over clips; ``named``, that share by clip; ``taken_for``, for each clip that
        is not always right, the wrong clip it is taken for most often.
    """
    frames = window_frames(motions, unmirrored_clips(motions))
    classifier = MotionClassifier(motions.windows(frames), motions.clip_of_frame[frames])
    windows, owners = [], []
    for index, length in enumerate(performance.lengths):
        begins = np.arange(0, max(1, length - 1 - 30), CONTROLLER_STEPS)
        within = np.minimum(begins[:, None] + np.arange(WINDOW_FRAMES), length - 1)
        windows.append(window_features(performance.qpos[index][within]))
        owners += [index] * len(begins)
    found = classifier.classify(np.concatenate(windows), np.array(owners))
    named, taken_for = {}, {}
    for clip in np.unique(performance.clips):
        mine = found[performance.clips == clip]
        named[motions.names[clip]] = float((mine == clip).mean())
        wrong = mine[mine != clip]
        if len(wrong):
            taken_for[motions.names[clip]] = motions.names[int(np.bincount(wrong).argmax())]
    return {"top1": float(np.mean(list(named.values()))), "named": named, "taken_for": taken_for}


def evaluate_smoothness(performance: Performance, motions: ReferenceMotions) -> dict[str, dict[str, float | None]]:
    """Foot skate (m/s, :func:`motion_data.metrics.foot_skate`) and jerk (m/s^3) against the reference.

    Both are averaged over the performances of clips without acrobatics; a clip whose feet never slide has no ratio of its
    own, so the ratio is that of the averages.

    Returns:
        For ``foot_skate`` and ``jerk``: ``simulation``, ``reference`` and their ``ratio`` (None if the reference has none).
    """
    rows = []
    for index, clip in enumerate(performance.clips):
        if base_name(motions.names[clip]) in ACROBATIC or performance.lengths[index] < 4:
            continue
        length = performance.lengths[index]
        begin = motions.starts[clip]
        reference = kinematics(motions.qpos[begin : begin + length])
        rows.append(
            [
                measure
                for positions, quaternions in (
                    (performance.positions[index, :length], performance.quaternions[index, :length]),
                    (reference.positions, reference.quaternions),
                )
                for measure in (foot_skate(sole_corners(positions, quaternions)), jerk(positions))
            ]
        )
    result: dict[str, dict[str, float | None]] = {}
    for column, name in enumerate(("foot_skate", "jerk")):
        # A clip without contact in one of both has no skate to compare.
        pairs = np.array([(row[column], row[column + 2]) for row in rows], float).reshape(-1, 2)
        pairs = pairs[np.isfinite(pairs).all(1)]
        simulated, expected = pairs.mean(0) if len(pairs) else (0.0, 0.0)
        result[name] = {
            "simulation": float(simulated),
            "reference": float(expected),
            "ratio": float(simulated / expected) if expected > 0 else None,
        }
    return result


def evaluate_symmetry(
    controller: Controller, encoder: Encoder, motions: ReferenceMotions, samples: int = 1000, seed: int = 0
) -> float:
    """How far the controller is from mirror symmetry: pi(M s, E(M w)) should be M pi(s, E(w)).

    Args:
        controller: The controller.
        encoder: Its encoder.
        motions: States s and windows w are frames of these.
        samples: How many frames.
        seed: Seed of their draw.

    Returns:
        Mean absolute difference of the two PD targets over frames and hinges, degrees.
    """
    frames = np.random.default_rng(seed).choice(len(motions), samples)
    observation, windows = motions.observations[frames], motions.windows(frames)
    mirrored = windows[..., WINDOW_MIRROR_INDEX] * WINDOW_MIRROR_SIGN
    targets = controller.act(observation, encoder.encode(windows))
    other = controller.act(observation[:, MIRROR_INDEX] * MIRROR_SIGN, encoder.encode(mirrored))
    return float(np.degrees(np.abs(other - targets[:, MIRROR_JOINTS] * MIRROR_JOINT_SIGNS).mean()))
