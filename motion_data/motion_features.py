"""What a piece of motion looks like in 88 numbers, without any trained model: for Frechet distance and diversity."""

from __future__ import annotations

import numpy as np

from motion_data.skeleton import BODY_NAMES, FRAME_RATE, heading, kinematics

WINDOW_SECONDS = 2.0
STRIDE_SECONDS = 0.5

_BODIES = len(BODY_NAMES)
MOTION_FEATURE_SIZE = 1 + 3 * (_BODIES - 1) + 3 * _BODIES
"""Mean posture: pelvis height and 14 bodies relative to it, x, y, z; then 3 kinetic numbers of each of 15 bodies."""


def motion_features(qpos: np.ndarray, fps: float = FRAME_RATE) -> np.ndarray:
    """Posture and kinetic features of one piece of motion.

    The kinetic part is that of Onuma, Faloutsos and Hodgins 2008 ("FMDistance"), by which Li et al. 2021 ("AI
    Choreographer") compute their Frechet distance FID_k: of each body the mean energy of horizontal and of vertical
    motion and the mean energy of acceleration. Here roots are taken, so that the numbers are m/s, m/s and m/s^2, and no
    outlier rules the fitted normal. It knows nothing about posture, which the first part adds: the mean height of the
    pelvis, and the mean positions of the other bodies relative to it in the heading frame, in metres.

    It does not depend on where the motion takes place and which way it faces.

    Args:
        qpos: Poses, ``(T, 35)``, T at least 3.
        fps: Frames per second.

    Returns:
        Features, ``(88,)``.

    Raises:
        ValueError: If there are fewer than 3 frames.
    """
    if len(qpos) < 3:
        raise ValueError(f"Features of motion need at least 3 frames, got {len(qpos)}.")
    return _features_of(kinematics(qpos).positions, qpos, fps)


def windowed_features(
    qpos: np.ndarray,
    fps: float = FRAME_RATE,
    window_seconds: float = WINDOW_SECONDS,
    stride_seconds: float = STRIDE_SECONDS,
) -> np.ndarray:
    """Features of overlapping windows of a motion.

    Args:
        qpos: Poses, ``(T, 35)``, T at least 3.
        fps: Frames per second.
        window_seconds: Length of a window; a shorter motion is one window of its own length.
        stride_seconds: From the start of one window to that of the next.

    Returns:
        Features, ``(windows, 88)``.

    Raises:
        ValueError: If there are fewer than 3 frames.
    """
    if len(qpos) < 3:
        raise ValueError(f"Features of motion need at least 3 frames, got {len(qpos)}.")
    positions = kinematics(qpos).positions
    length = max(3, min(len(qpos), round(window_seconds * fps)))
    starts = range(0, len(qpos) - length + 1, max(1, round(stride_seconds * fps)))
    parts = [slice(start, start + length) for start in starts]
    return np.stack([_features_of(positions[part], qpos[part], fps) for part in parts])


def _features_of(positions: np.ndarray, qpos: np.ndarray, fps: float) -> np.ndarray:
    yaw = heading(qpos[:, 3:7])[:, None]
    x, y, z = np.moveaxis(positions[:, 1:] - positions[:, :1], -1, 0)
    local = np.stack([np.cos(yaw) * x + np.sin(yaw) * y, np.cos(yaw) * y - np.sin(yaw) * x, z], -1)
    velocity = np.diff(positions, axis=0) * fps
    acceleration = np.diff(positions, n=2, axis=0) * fps**2
    kinetic = np.stack(
        [
            (velocity[..., :2] ** 2).sum(-1).mean(0),
            (velocity[..., 2] ** 2).mean(0),
            (acceleration**2).sum(-1).mean(0),
        ]
    )
    return np.concatenate([[positions[:, 0, 2].mean()], local.mean(0).ravel(), np.sqrt(kinetic).ravel()])
