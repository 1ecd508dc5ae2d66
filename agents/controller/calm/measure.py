"""Does it imitate? Measurements during training, and their curves."""

from pathlib import Path
from typing import Any

import numpy as np

from agents.controller.calm.demonstrations import Demonstrations
from agents.controller.evaluate import evaluate_clips
from agents.controller.student import Student
from anyskill_envs.observation import OBSERVATION_LAYOUT
from anyskill_envs.simulation import HumanoidSimulation
from motion_data.skeleton import BODY_NAMES

_HELD_STEPS = 60  # controller steps under one latent: the length of its window
_LOOK_EVERY = 5
_EPISODES = 4  # per clip


def measure(student: Student, demonstrations: Demonstrations) -> dict[str, float]:
    """How well the clips are performed.

    Returns:
        ``error_mm`` and ``survival`` of z = E(window) renewed at 6 Hz, frame against frame, mean over clips (see
        :func:`agents.controller.evaluate.evaluate_clips`); and of a latent held for 2 s from a start in its clip, every
        1/6 s: ``nearest_mm``, mean body distance to the nearest frame of the latent's clip (a discriminator that sees a
        third of a second does not ask for the right phase), and ``named``, share in which the frame nearest of all
        belongs to that clip.
    """
    clips = evaluate_clips(student, student, demonstrations.motions, episodes=_EPISODES, limit=90)
    return {
        "error_mm": float(np.mean([row["error_mm"] for row in clips.values()])),
        "survival": float(np.mean([row["survival"] for row in clips.values()])),
        **_held_latents(student, demonstrations),
    }


def _held_latents(student: Student, demonstrations: Demonstrations) -> dict[str, float]:
    motions = demonstrations.motions
    room = np.maximum(motions.lengths - _HELD_STEPS, 1)
    phase = np.linspace(0, 1, _EPISODES)[:, None] * (room - 1)
    frames = (motions.starts + phase.astype(int)).ravel()
    clips = motions.clip_of_frame[frames]
    latent = student.encode(motions.windows(frames))
    simulation = HumanoidSimulation(len(frames))
    simulation.reset(np.arange(len(frames)), motions.qpos[frames], motions.qvel[frames])
    reference = _body_places(motions.observations)
    own, named = [], []
    for step in range(1, _HELD_STEPS + 1):
        simulation.step(student.act(simulation.observation(), latent))
        if step % _LOOK_EVERY:
            continue
        places = _body_places(simulation.observation())
        distance = np.stack([np.linalg.norm(place - reference, axis=-1).mean(1) for place in places])
        nearest = np.minimum.reduceat(distance, motions.starts, axis=1)
        own.append(nearest[np.arange(len(clips)), clips])
        named.append(nearest.argmin(1) == clips)
    return {"nearest_mm": float(1000 * np.mean(own)), "named": float(np.mean(named))}


def _body_places(observations: np.ndarray) -> np.ndarray:
    """Positions of the bodies in the heading frame, with the root's height, ``(n, 15, 3)``."""
    places = np.zeros((len(observations), len(BODY_NAMES), 3), np.float32)
    places[:, 1:] = observations[:, OBSERVATION_LAYOUT["body_positions"]].reshape(len(observations), -1, 3)
    places[..., 2] += observations[:, :1]
    return places


def plot_curves(path: Path, history: list[dict[str, Any]], title: str) -> None:
    """Draws what the discriminator says, the reward, and the measured errors over minutes of training.

    Args:
        path: The picture, ending in .png.
        history: Entries of :class:`agents.controller.calm.trainer.CalmTrainer`.
        title: Title of the picture.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13, 3.4), layout="constrained")
    FigureCanvasAgg(figure)
    minutes = [entry["seconds"] / 60 for entry in history]
    panels: list[tuple[str, dict[str, str], tuple[float, float] | None]] = [
        (
            "discriminator: mean D",
            {"real": "real", "fake": "policy", "mismatched": "real, other latent"},
            (-0.02, 1.02),
        ),
        ("reward per step (eq. 2)", {"reward": ""}, None),
        (
            "body distance (mm)",
            {"error_mm": "clip at the same time, 6 Hz", "nearest_mm": "nearest frame of the clip, held"},
            None,
        ),
        (
            "shares",
            {"survival": "clips survived", "named": "nearest frame is of the clip", "falls": "falls per second"},
            (-0.02, 1.02),
        ),
    ]
    for axes, (label, lines, limits) in zip(figure.subplots(1, len(panels)), panels, strict=True):
        for key, name in lines.items():
            values = np.array([entry[key] for entry in history], float)
            axes.plot(minutes, values, label=name or None, linewidth=1.6, marker="." if len(history) < 20 else None)
        axes.set_title(label, fontsize=10)
        axes.set_xlabel("minutes of training")
        axes.grid(alpha=0.3)
        if limits:
            axes.set_ylim(limits)
        if len(lines) > 1:
            axes.legend(fontsize=7)
    figure.suptitle(title, fontsize=11)
    figure.savefig(path, dpi=110)
