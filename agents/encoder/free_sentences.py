"""A hundred sentences that somebody would say, and the motions they are about; none is in the captions of training."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from agents.encoder.dataset import FILM_FRAMES
from agents.encoder.measurements import WINDOW
from anyskill_envs.simulation import HumanoidSimulation
from motion_data.clip import MotionClip
from motion_data.skeleton import differentiate, forward_kinematics, joint_limits, rest_qpos

SENTENCES_FILE = Path(__file__).with_name("free_sentences.txt")
_SPEED = 1.08  # none of the speeds at which clips are trained on
_NOISE = 0.05  # rad, standard deviation of an offset of each joint


@dataclass(frozen=True)
class Moments:
    """The moments that the sentences are about.

    Attributes:
        sentences: the sentences, n of them.
        clips: name of the clip of each.
        observations: states, float32 `(n, 223)`.
        films: poses of the four frames up to each state, `(n, 4, 35)`.
    """

    sentences: tuple[str, ...]
    clips: tuple[str, ...]
    observations: NDArray[np.float32]
    films: NDArray[np.float32]


def read_sentences(path: Path = SENTENCES_FILE) -> list[tuple[str, str]]:
    """Clip and sentence of each line."""
    lines = [line for line in path.read_text(encoding="utf-8").splitlines() if line and not line.startswith("#")]
    return [(clip.strip(), sentence.strip()) for clip, _, sentence in (line.partition("|") for line in lines)]


def telling_frame(clip: MotionClip) -> int:
    """The frame whose bodies are nearly as far from the rest pose as they get; half-way where the clip does not begin in it.

    Distances are seen from the pelvis. Half-way also in a gait, which has no way in and out.
    """
    positions, _ = forward_kinematics(clip.qpos)
    rest, _ = forward_kinematics(rest_qpos()[None])
    offset = (positions - positions[:, :1]) - (rest - rest[:, :1])
    apart = np.linalg.norm(offset, axis=2).mean(1)
    if clip.loop or apart[0] > 0.5 * apart.max():
        return len(clip) // 2
    return int(np.argmax(apart >= 0.95 * apart.max()))


def sentence_moments(clips: list[MotionClip], rng: np.random.Generator) -> Moments:
    """The moments of the sentences whose clips are there: at a speed of their own, every joint a little off.

    Args:
        clips: the motion library.
        rng: draws the offsets.
    """
    library = {clip.name: clip for clip in clips}
    pairs = [(name, sentence) for name, sentence in read_sentences() if name in library]
    films = np.empty((len(pairs), len(FILM_FRAMES), 35), np.float32)
    last = np.empty((len(pairs), 35))
    velocities = np.empty((len(pairs), 34))
    limits = joint_limits()
    for row, (name, _) in enumerate(pairs):
        clip = library[name].resampled().at_speed(_SPEED)
        clip = clip.repeated(1.5)
        end = max(telling_frame(clip), WINDOW - 1)
        window = np.array(clip.qpos[max(0, end + 1 - WINDOW) : end + 1])
        window = np.concatenate([np.repeat(window[:1], WINDOW - len(window), 0), window])
        window[:, 7:] = np.clip(window[:, 7:] + rng.normal(0, _NOISE, window.shape[1] - 7), *limits.T)
        films[row], last[row], velocities[row] = window[list(FILM_FRAMES)], window[-1], differentiate(window)[-1]
    simulation = HumanoidSimulation(len(pairs), num_threads=1)
    simulation.reset(np.arange(len(pairs)), last, velocities)
    return Moments(
        tuple(sentence for _, sentence in pairs), tuple(name for name, _ in pairs), simulation.observation(), films
    )
