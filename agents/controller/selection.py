"""Which clips of a set of reference motions stand, walk, travel or get up; found from the motion, not from names."""

import numpy as np

from agents.controller.reference import IN_PLACE, ReferenceMotions
from anyskill_envs.simulation import CONTROLLER_STEPS
from motion_data.clip import MIRRORED_SUFFIX
from motion_data.gait_table import flight_gaits
from motion_data.skeleton import FRAME_RATE, body_index, heading, kinematics

ACROBATIC = {"backflip", "cartwheel", "roll", "spin", "spinkick"}
"""Clips with flight or acrobatics, reported apart."""
FLIGHT = {"jump", "run"} | flight_gaits()
"""Clips with a phase of flight, reported apart from those without."""

_PLANTED = 0.06  # metres that an ankle of a standing clip may move
_WALKING_SPEED = (0.3, 2.0)  # metres per second
_STRAIGHT = 0.9  # a walk goes nearly straight on: its distance over the length of its path
_TURN = np.pi / 6  # a clip that turns by more is one to steer with
_LYING_HEIGHT = 0.4  # metres: a root below it lies


def frames_of(motions: ReferenceMotions, clip: int) -> slice:
    """The frames of a clip."""
    return slice(int(motions.starts[clip]), int(motions.starts[clip] + motions.lengths[clip]))


def base_name(name: str) -> str:
    """Name of a clip without the ending of its mirror image."""
    return name.removesuffix(MIRRORED_SUFFIX)


def unmirrored_clips(motions: ReferenceMotions) -> np.ndarray:
    """Clips that are no mirror images, ``(k,)`` indices."""
    return np.array([clip for clip, name in enumerate(motions.names) if name == base_name(name)], int)


def on_feet_clips(motions: ReferenceMotions) -> np.ndarray:
    """Clips that stay on their feet, travelling or not, without acrobatics, ``(k,)`` indices."""
    return np.array(
        [
            clip
            for clip, name in enumerate(motions.names)
            if motions.upright[frames_of(motions, clip)].all() and base_name(name) not in ACROBATIC
        ],
        int,
    )


def upright_clips(motions: ReferenceMotions) -> np.ndarray:
    """Clips that stay on their feet, or on one of them, without travelling (0.6 m), ``(k,)`` indices."""
    chosen = []
    for clip in range(len(motions.names)):
        frames = frames_of(motions, clip)
        if motions.upright[frames].all() and np.ptp(motions.qpos[frames, :2], axis=0).max() < IN_PLACE:
            chosen.append(clip)
    return np.array(chosen, int)


def standing_clips(motions: ReferenceMotions) -> np.ndarray:
    """Clips that stand: upright with both feet planted (neither ankle moves by 6 cm), ``(k,)`` indices."""
    return np.array([clip for clip in upright_clips(motions) if _ankle_travel(motions, clip) < _PLANTED], int)


def _ankle_travel(motions: ReferenceMotions, clip: int) -> float:
    positions = kinematics(motions.qpos[frames_of(motions, clip)]).positions
    return float(np.ptp(positions[:, [body_index("right_foot"), body_index("left_foot")]], axis=0).max())


def quiet_clips(motions: ReferenceMotions) -> np.ndarray:
    """The standing clip whose joints move least, ``(1,)``, or none, ``(0,)``."""
    standing = standing_clips(motions)
    if not len(standing):
        return standing
    speed = [np.abs(motions.qvel[frames_of(motions, clip), 6:]).mean() for clip in standing]
    return standing[[int(np.argmin(speed))]]


def walking_clips(motions: ReferenceMotions) -> np.ndarray:
    """Loops on the feet that move straight on at 0.3 to 2 m/s, ``(k,)`` indices."""
    chosen = []
    for clip in on_feet_clips(motions):
        frames = frames_of(motions, clip)
        path = motions.qpos[frames, :2]
        distance = np.linalg.norm(path[-1] - path[0])
        straight = distance > _STRAIGHT * np.linalg.norm(np.diff(path, axis=0), axis=1).sum()
        speed = distance * FRAME_RATE / (motions.lengths[clip] - 1)
        if motions.seamless[frames.start] and straight and _WALKING_SPEED[0] <= speed <= _WALKING_SPEED[1]:
            chosen.append(clip)
    return np.array(chosen, int)


def steering_clips(motions: ReferenceMotions) -> np.ndarray:
    """Clips on the feet that travel at least 0.3 m or turn by at least 30 degrees, ``(k,)`` indices."""
    chosen = []
    for clip in on_feet_clips(motions):
        qpos = motions.qpos[frames_of(motions, clip)]
        travel = np.linalg.norm(qpos[:, :2] - qpos[0, :2], axis=1).max()
        yaw = np.unwrap(heading(qpos[:, 3:7]))
        if travel > 0.5 * IN_PLACE or np.abs(yaw - yaw[0]).max() > _TURN:
            chosen.append(clip)
    return np.array(chosen, int)


def get_up_clips(motions: ReferenceMotions) -> dict[str, np.ndarray]:
    """Clips that begin lying and end on the feet: ``front`` (face down) and ``back``, each ``(k,)`` indices."""
    chosen: dict[str, list[int]] = {"front": [], "back": []}
    for clip in range(len(motions.names)):
        frames = frames_of(motions, clip)
        first = motions.qpos[frames.start]
        if first[2] < _LYING_HEIGHT and not motions.upright[frames.start] and motions.upright[frames.stop - 1]:
            w, x, y, z = first[3:7]
            # World z of the root's forward axis: towards the floor when it lies on its front.
            chosen["front" if x * z - w * y < 0 else "back"].append(clip)
    return {side: np.array(clips, int) for side, clips in chosen.items()}


def window_frames(motions: ReferenceMotions, clips: np.ndarray, every: int = CONTROLLER_STEPS) -> np.ndarray:
    """Frames of some clips that begin a window of at least 1 s, one every few controller steps, ``(k,)``."""
    frames = [
        np.arange(motions.starts[c], max(motions.starts[c] + 1, motions.last[motions.starts[c]] - 30), every)
        for c in clips
    ]
    return np.concatenate(frames) if frames else np.zeros(0, int)
