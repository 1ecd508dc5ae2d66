"""Features of a 2 s motion window: what the motion encoder sees, in the heading frame of the window's first pose."""

import numpy as np

from motion_data.skeleton import MIRROR_JOINT_SIGNS, MIRROR_JOINTS, heading

WINDOW_FRAMES = 60
"""Frames of a window: 2 s at 30 frames per second."""

WINDOW_FEATURES = 1 + 2 + 2 + 6 + 28
"""Numbers per frame: root height, root displacement (x, y), heading (cosine, sine), root rotation without heading
(two columns), hinge angles."""

WINDOW_MIRROR_INDEX = np.concatenate([np.arange(11), 11 + MIRROR_JOINTS])
"""Source index of each feature under reflection in the x-z plane."""
WINDOW_MIRROR_SIGN = np.concatenate([[1, 1, -1, 1, -1, 1, -1, 1, 1, -1, 1], MIRROR_JOINT_SIGNS]).astype(np.float32)
"""Sign of each feature under reflection."""


def window_features(qpos: np.ndarray) -> np.ndarray:
    """Describes windows of motion independently of where they are and which way they face.

    Args:
        qpos: Poses of n windows, ``(n, 60, 35)``.

    Returns:
        Features, float32 ``(n, 60, 39)``, in the order of :data:`WINDOW_FEATURES`.

    Raises:
        ValueError: If the shape is another.
    """
    if qpos.ndim != 3 or qpos.shape[1:] != (WINDOW_FRAMES, 35):
        raise ValueError(f"Motion windows must have shape (n, {WINDOW_FRAMES}, 35), got {qpos.shape}.")
    features = np.empty((*qpos.shape[:2], WINDOW_FEATURES), np.float32)
    yaw = heading(qpos[..., 3:7])
    start = yaw[:, :1]
    cosine, sine = np.cos(start), np.sin(start)
    x, y = np.moveaxis(qpos[..., :2] - qpos[:, :1, :2], -1, 0)
    features[..., 0] = qpos[..., 2]
    features[..., 1] = cosine * x + sine * y
    features[..., 2] = cosine * y - sine * x
    features[..., 3] = np.cos(yaw - start)
    features[..., 4] = np.sin(yaw - start)
    features[..., 5:11] = _tilt(qpos[..., 3:7], yaw)
    features[..., 11:] = qpos[..., 7:]
    return features


def _tilt(quaternions: np.ndarray, yaw: np.ndarray) -> np.ndarray:
    """First and third column of the root's rotation matrix after removing its heading, ``(..., 6)``."""
    w, x, y, z = np.moveaxis(quaternions, -1, 0)
    cosine, sine = np.cos(yaw), np.sin(yaw)
    first = (1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y))
    third = (2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y))
    return np.stack(
        [number for a, b, c in (first, third) for number in (cosine * a + sine * b, cosine * b - sine * a, c)], -1
    )
