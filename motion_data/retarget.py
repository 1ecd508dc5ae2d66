"""Retargeting: joint rotations to our hinges, feet to the floor."""

import warnings

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from motion_data.skeleton import FRAME_RATE, lowest_point

_SMOOTHNESS = 0.05  # weight of squared differences of neighbouring frames (rad^2) against squared matrix entries
_MAGNITUDE = 1e-4  # keeps an undetermined twist near zero


def _axis_rotations(angle: np.ndarray, axis: int) -> tuple[np.ndarray, np.ndarray]:
    """Rotation matrices about one axis and their derivatives by the angle, each ``(T, 3, 3)``."""
    first, second = ((1, 2), (2, 0), (0, 1))[axis]
    matrix = np.zeros((len(angle), 3, 3))
    slope = np.zeros_like(matrix)
    cosine, sine = np.cos(angle), np.sin(angle)
    matrix[:, axis, axis] = 1
    matrix[:, first, first] = matrix[:, second, second] = cosine
    matrix[:, second, first], matrix[:, first, second] = sine, -sine
    slope[:, first, first] = slope[:, second, second] = -sine
    slope[:, second, first], slope[:, first, second] = cosine, -cosine
    return matrix, slope


def fit_hinges(rotations: np.ndarray, limits: np.ndarray) -> np.ndarray:
    """Angles of a three-hinge joint (order x, z, y) that follow a sequence of rotations smoothly, inside the limits.

    Near gimbal lock the exact angles jump; the fit trades a small rotation error for a smooth path: it minimises the
    squared distance of the rotation matrices plus a penalty on the differences between neighbouring frames.

    Args:
        rotations: Rotation of the joint relative to its parent, ``(T, 3, 3)``.
        limits: Lower and upper limits of the hinges in the order x, z, y, ``(3, 2)`` radians.

    Returns:
        Hinge angles in the order x, z, y, ``(T, 3)`` radians.
    """
    frames = len(rotations)
    with warnings.catch_warnings():  # in gimbal lock one angle is free: the fit below chooses it
        warnings.filterwarnings("ignore", message="Gimbal lock", category=UserWarning)
        exact = Rotation.from_matrix(rotations).as_euler("XZY")
    start = _continuous_angles(exact, limits)

    def objective(flat: np.ndarray) -> tuple[float, np.ndarray]:
        angles = flat.reshape(frames, 3)
        (rx, dx), (rz, dz), (ry, dy) = (_axis_rotations(angles[:, k], axis) for k, axis in enumerate((0, 2, 1)))
        error = rx @ rz @ ry - rotations
        gradient = np.stack([2 * (error * m).sum((1, 2)) for m in (dx @ rz @ ry, rx @ dz @ ry, rx @ rz @ dy)], -1)
        steps = np.diff(angles, axis=0)
        gradient[1:] += 2 * _SMOOTHNESS * steps
        gradient[:-1] -= 2 * _SMOOTHNESS * steps
        gradient += 2 * _MAGNITUDE * angles
        value = (error**2).sum() + _SMOOTHNESS * (steps**2).sum() + _MAGNITUDE * (angles**2).sum()
        return float(value), gradient.ravel()

    bounds = np.tile(limits, (frames, 1))
    start = np.clip(start, limits[:, 0], limits[:, 1])
    result = minimize(objective, start.ravel(), jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": 300})
    return result.x.reshape(frames, 3)


def _continuous_angles(angles: np.ndarray, limits: np.ndarray) -> np.ndarray:
    """The cheapest path through the equivalent Euler angles of each frame (two branches, turns of 2 pi), by Viterbi."""
    x, z, y = angles.T
    branches = np.stack([angles, np.stack([x + np.pi, np.pi - z, y + np.pi], -1)], 1)
    turns = 2 * np.pi * np.stack(np.meshgrid(*[(-1, 0, 1)] * 3), -1).reshape(-1, 3)
    candidates = (branches[:, :, None] + turns).reshape(len(angles), -1, 3)
    outside = np.maximum(limits[:, 0] - candidates, 0) + np.maximum(candidates - limits[:, 1], 0)
    node = 5 * outside.sum(-1) + 0.05 * np.abs(candidates).sum(-1)
    cost = node[0]
    back = np.zeros(candidates.shape[:2], int)
    for frame in range(1, len(angles)):
        step = np.abs(candidates[frame][:, None] - candidates[frame - 1][None]).sum(-1)
        total = cost[None] + 3 * step
        back[frame] = total.argmin(1)
        cost = total.min(1) + node[frame]
    path = np.empty((len(angles), 3))
    choice = int(cost.argmin())
    for frame in range(len(angles) - 1, -1, -1):
        path[frame] = candidates[frame, choice]
        choice = back[frame, choice]
    return path


def place_feet(qpos: np.ndarray, airborne: np.ndarray | None = None, fps: float = FRAME_RATE) -> np.ndarray:
    """Moves the root up or down frame by frame so that the lowest point rests on the floor.

    One offset for the whole clip leaves feet floating by centimetres where the source body has other proportions. The
    correction is smoothed over 0.1 s, so that it adds no jerk; frames in flight take the correction of their neighbours.

    Args:
        qpos: Poses, ``(T, 35)``.
        airborne: Frames in flight, ``(T,)`` bool; found from the height of the lowest point if None.
        fps: Frames per second.

    Returns:
        Poses with a corrected root height, ``(T, 35)``.
    """
    lowest = lowest_point(qpos)
    floor = np.percentile(lowest, 10)
    if airborne is None:
        # Feet of a walking mismatched body wander by up to 5 cm; what is higher than that is flight.
        airborne = lowest - floor > 0.06
    grounded = np.flatnonzero(~airborne)
    correction = np.interp(np.arange(len(qpos)), grounded, lowest[grounded]) if len(grounded) else lowest
    smooth = gaussian_filter1d(correction, 0.05 * fps, mode="nearest")
    placed = np.array(qpos, copy=True)
    placed[:, 2] -= smooth
    # Smoothing may leave a foot slightly under the floor; never start a simulation there.
    placed[:, 2] += np.maximum(-(lowest - smooth), 0)
    return placed
