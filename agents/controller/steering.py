"""Where latents lead: the speeds and turn rates that a controller reaches under single, frozen latents."""

from typing import Any

import numpy as np

from agents.controller.reference import ReferenceMotions
from agents.controller.rollout import Controller, Encoder, falls, held, start
from agents.controller.selection import steering_clips, window_frames
from motion_data.skeleton import FRAME_RATE, heading

WANTED_SPEEDS = (0.5, 1.0, 1.5, 2.0, 2.5, 3.0)
"""Forward speeds (m/s) for which a latent should exist."""

_SECONDS, _SKIPPED = 4.0, 1.0  # the first second is not measured: the start state has a speed of its own
_EVERY = 10  # controller steps between the windows whose latents are tried
_SHARES = (0.25, 0.5, 0.75)  # where between two clips
_STRAIGHT = 10.0  # degrees/s
_AIMED = 0.8  # share of the speed that must point in a direction for a latent to count as leading there


def travel(roots: np.ndarray) -> np.ndarray:
    """Mean velocity over ground in the heading frame, and mean turn rate.

    Args:
        roots: Root positions x, y and yaw over time, ``(n, T, 3)``, metres and radians.

    Returns:
        Forward m/s, leftward m/s, turn to the left in degrees/s, ``(n, 3)``.
    """
    yaw = np.unwrap(roots[..., 2], axis=1)
    x, y = np.moveaxis(np.diff(roots[..., :2], axis=1), -1, 0)
    middle = 0.5 * (yaw[:, 1:] + yaw[:, :-1])
    forward = np.cos(middle) * x + np.sin(middle) * y
    leftward = np.cos(middle) * y - np.sin(middle) * x
    duration = (roots.shape[1] - 1) / FRAME_RATE
    turned = np.degrees(yaw[:, -1] - yaw[:, 0])
    return np.stack([forward.sum(1), leftward.sum(1), turned], 1) / duration


def evaluate_steering(controller: Controller, encoder: Encoder, motions: ReferenceMotions) -> dict[str, Any]:
    """Holds the latent of each window of the clips that travel or turn for 4 s and measures where it leads.

    Returns:
        ``fastest``: for ``forward``, ``backward``, ``left``, ``right`` (m/s) and ``turn_left``, ``turn_right``
        (degrees/s) the highest ``speed`` of a latent under which the humanoid did not fall, and its ``clip`` (0, "" if none);
        ``nearest_forward``: for each of :data:`WANTED_SPEEDS` the nearest forward speed of a latent, those
        between the windows of two clips of neighbouring speed included, and ``largest_gap``,
        how far the worst of them is off; ``clips``: by clip the mean ``forward``, ``leftward``, ``turn_left`` over its
        latents (of those without a fall), the same of the reference, and ``falls``.
    """
    frames = window_frames(motions, steering_clips(motions), _EVERY)
    if not len(frames):
        return {"fastest": {}, "nearest_forward": {}, "largest_gap": None, "clips": {}}
    clips = motions.clip_of_frame[frames]
    latents = encoder.encode(motions.windows(frames))
    reached, fell = _held_for_long(controller, motions, frames, latents)
    wanted = _reference_travel(motions, frames)
    names = [motions.names[clip] for clip in clips]
    measures = ("forward", "leftward", "turn_left")
    rows = {}
    for clip in np.unique(clips):
        mine = clips == clip
        upright = mine & ~fell
        mean = reached[upright].mean(0) if upright.any() else np.full(3, np.nan)
        rows[motions.names[clip]] = {
            **{name: None if np.isnan(value) else float(value) for name, value in zip(measures, mean, strict=True)},
            **{f"reference_{name}": float(value) for name, value in zip(measures, wanted[mine].mean(0), strict=True)},
            "falls": float(fell[mine].mean()),
        }
    upright = np.flatnonzero(~fell)
    between, between_fell = _held_for_long(controller, motions, *_between(motions, frames, latents, wanted))
    nearest = _nearest_forward(np.concatenate([reached[upright], between[~between_fell]]))
    return {
        "fastest": _fastest(reached[upright], [names[index] for index in upright]),
        "nearest_forward": nearest,
        "largest_gap": max((abs(float(wanted) - speed) for wanted, speed in nearest.items()), default=None),
        "clips": rows,
    }


def _held_for_long(
    controller: Controller, motions: ReferenceMotions, frames: np.ndarray, latents: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Where latents lead that are held for 4 s from the states of frames, ``(n, 3)``, and who fell, ``(n,)``."""
    if not len(frames):
        return np.zeros((0, 3)), np.zeros(0, bool)
    simulation = start(motions, frames, np.random.default_rng(0))
    record = []

    def note(step: int) -> None:
        if step >= round(_SKIPPED * FRAME_RATE):
            record.append(np.column_stack([simulation.qpos[:, :2], heading(simulation.qpos[:, 3:7])]))

    fell = falls(controller, simulation, held(latents), _SECONDS, note)
    reached = travel(np.stack(record, 1)) if len(record) > 1 else np.zeros((len(frames), 3))
    return reached, fell


def _between(
    motions: ReferenceMotions, frames: np.ndarray, latents: np.ndarray, wanted: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Latents between the first windows of two clips that go straight ahead at neighbouring speeds.

    Args:
        motions: The reference motions.
        frames: Windows, ``(n,)``.
        latents: Their latents, ``(n, 64)``.
        wanted: What the reference does in them, ``(n, 3)``.

    Returns:
        The windows of the slower clips, ``(k,)``, and the latents, ``(k, 64)``.
    """
    forward, leftward, turn = wanted.T
    straight = (forward > 0.3) & (np.abs(leftward) < 0.1) & (np.abs(turn) < _STRAIGHT)
    ahead = np.flatnonzero(straight)
    first = ahead[np.unique(motions.clip_of_frame[frames[ahead]], return_index=True)[1]]
    first = first[np.argsort(forward[first])]
    mixed = [(1 - share) * latents[first[:-1]] + share * latents[first[1:]] for share in _SHARES]
    middle = np.concatenate(mixed)
    between = middle / np.linalg.norm(middle, axis=1, keepdims=True)
    return np.tile(frames[first[:-1]], len(_SHARES)), between.astype(latents.dtype)


def _reference_travel(motions: ReferenceMotions, frames: np.ndarray) -> np.ndarray:
    """What the reference does in the windows, ``(n, 3)``; a window that ends with its clip counts as far as it goes."""
    rows = []
    for frame in frames:
        qpos = motions.qpos[frame : min(frame + 60, motions.last[frame]) + 1]
        rows.append(travel(np.column_stack([qpos[:, :2], heading(qpos[:, 3:7])])[None])[0])
    return np.array(rows)


def _fastest(reached: np.ndarray, names: list[str]) -> dict[str, dict[str, Any]]:
    speed = np.linalg.norm(reached[:, :2], axis=1)
    forward, leftward, turn = reached.T
    directions = {
        "forward": np.where(forward > _AIMED * speed, forward, 0),
        "backward": np.where(-forward > _AIMED * speed, -forward, 0),
        "left": np.where(leftward > _AIMED * speed, leftward, 0),
        "right": np.where(-leftward > _AIMED * speed, -leftward, 0),
        "turn_left": np.maximum(turn, 0),
        "turn_right": np.maximum(-turn, 0),
    }
    return {
        name: {"speed": float(values.max(initial=0)), "clip": names[int(values.argmax())] if values.any() else ""}
        for name, values in directions.items()
    }


def _nearest_forward(reached: np.ndarray) -> dict[str, float]:
    forward = reached[reached[:, 0] > _AIMED * np.linalg.norm(reached[:, :2], axis=1), 0]
    if not len(forward):
        return {}
    return {f"{wanted:g}": float(forward[np.abs(forward - wanted).argmin()]) for wanted in WANTED_SPEEDS}
