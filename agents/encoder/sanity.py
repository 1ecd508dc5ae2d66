"""Does the score put the right motions first? Mean scores of clips for a few texts, beside idling, falling and mirrored."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from agents.encoder.rollouts import simulated_tracks
from anyskill_envs.simulation import HumanoidSimulation
from motion_data.clip import MotionClip
from rewards.encoders import Encoder

# A text, the clips that do it, and the clips that do it on the wrong side.
SANITY_TEXTS: tuple[tuple[str, tuple[str, ...], tuple[str, ...]], ...] = (
    ("raise both arms above the head", ("raise_both_arms", "raise_both_arms_sideways", "stretch_up"), ()),
    ("wave the right hand", ("wave_right_hand",), ("wave_left_hand",)),
    ("squat down", ("squat", "squat_hold"), ()),
    ("kick with the left leg", ("kick_left",), ("kick_right",)),
    ("walk forward", ("walk", "slow_walk"), ("step_backward",)),
)


@dataclass(frozen=True)
class SanityRow:
    """Scores of one text.

    Attributes:
        text: the text.
        matching: mean score of the frames of the clips that do it; the best half of each clip's frames, since clips
            begin and end in the idle stand.
        best_other: highest such score of another clip, and that clip's name.
        mirrored: the same of the clips that do it on the wrong side, or NaN.
        idle: mean score of standing idle.
        fallen: mean score of bodies that lie where they fell.
    """

    text: str
    matching: float
    best_other: tuple[float, str]
    mirrored: float
    idle: float
    fallen: float


def clip_observations(clip: MotionClip) -> NDArray[np.float32]:
    """Observation of every frame of a clip, `(frames, 223)`."""
    clip = clip.resampled()
    simulation = HumanoidSimulation(len(clip), num_threads=1)
    simulation.reset(np.arange(len(clip)), clip.qpos, clip.qvel)
    return simulation.observation()


def fallen_observations(rng: np.random.Generator, idle: MotionClip, count: int = 32) -> NDArray[np.float32]:
    """Observations of bodies that were pushed over, `(count, 223)`."""
    frames = 90
    poses = np.repeat(np.repeat(idle.qpos[:1, None], frames, 0), count, 1).copy()
    poses[0, :, 3:7] = [np.cos(0.5), 0.0, np.sin(0.5), 0.0]  # tilted so far that they fall
    poses[:, :, 7:] += rng.normal(0, 0.4, (1, count, poses.shape[2] - 7))
    velocities = np.zeros((frames, count, 34))
    fallen, speeds = simulated_tracks(rng, poses, velocities)
    simulation = HumanoidSimulation(count, num_threads=1)
    simulation.reset(np.arange(count), fallen[-1], speeds[-1])
    return simulation.observation()


def best_half(scores: NDArray[np.float32]) -> float:
    """Mean of the better half."""
    return float(np.sort(scores)[len(scores) // 2 :].mean())


def sanity_table(encoder: Encoder, clips: Sequence[MotionClip], rng: np.random.Generator) -> list[SanityRow]:
    """One row for each of `SANITY_TEXTS`; `clips` are those of the library, without mirror images."""
    features = {clip.name: encoder.encode_state(clip_observations(clip)) for clip in clips}
    idle = next(clip for clip in clips if clip.name == "stand")
    fallen = encoder.encode_state(fallen_observations(rng, idle))
    rows = []
    for text, matching, mirrored in SANITY_TEXTS:
        wanted = encoder.encode_text([text])[0]
        scores = {name: best_half(feature @ wanted) for name, feature in features.items()}
        others = {name: score for name, score in scores.items() if name not in matching}
        best = max(others, key=lambda name: others[name])
        rows.append(
            SanityRow(
                text,
                float(np.mean([scores[name] for name in matching])),
                (others[best], best),
                float(np.mean([scores[name] for name in mirrored])) if mirrored else float("nan"),
                float((features["stand"] @ wanted).mean()),
                float((fallen @ wanted).mean()),
            )
        )
    return rows
