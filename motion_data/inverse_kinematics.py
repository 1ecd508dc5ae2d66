"""Closed-form inverse kinematics of the humanoid's arms and legs, and its centre of mass.

Both limbs are two straight bones with a hinge between them, hung on three hinges in the order x, z, y. So the distance
of the end gives the bend of the middle hinge, and the rotation of the upper bone decomposes into the three hinges.
"""

from functools import cache
from typing import NamedTuple

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from motion_data.skeleton import BODY_NAMES, JOINT_NAMES, joint_limits, kinematics, load_model

SIDES = ("right", "left")
_STRAIGHTEST = 0.9995  # a limb never quite stretches: at full length the bend would change infinitely fast


def _offset(body: str) -> np.ndarray:
    """Origin of a body in the frame of its parent, ``(3,)`` metres."""
    return load_model().body(body).pos.copy()


THIGH = -_offset("right_shin")[2]
SHIN = -_offset("right_foot")[2]
LEG = (THIGH + SHIN) * _STRAIGHTEST
"""Longest distance from hip to ankle in metres."""
UPPER_ARM = -_offset("right_lower_arm")[2]
LOWER_ARM = -_offset("right_hand")[2] - load_model().geom("right_hand").pos[2]
"""Elbow to the centre of the hand in metres."""


def _joint_columns(*names: str) -> list[int]:
    return [JOINT_NAMES.index(name) for name in names]


LEG_COLUMNS = {
    side: _joint_columns(
        *(f"{side}_{joint}" for joint in ("hip_x", "hip_z", "hip_y", "knee", "ankle_x", "ankle_z", "ankle_y"))
    )
    for side in SIDES
}
"""Columns of a leg's seven hinges among the 28, by side."""
ARM_COLUMNS = {
    side: _joint_columns(*(f"{side}_{joint}" for joint in ("shoulder_x", "shoulder_z", "shoulder_y", "elbow")))
    for side in SIDES
}
"""Columns of an arm's four hinges among the 28, by side."""


class LegSolution(NamedTuple):
    """One leg over T frames."""

    angles: np.ndarray
    """Hip x, z, y, knee, ankle x, z, y, ``(T, 7)`` radians."""
    hip: np.ndarray
    """Position of the hip joint, ``(T, 3)``."""
    knee: np.ndarray
    """Position of the knee joint, ``(T, 3)``."""
    ankle: np.ndarray
    """Position of the ankle joint, ``(T, 3)``; nearer than asked where the leg was too short."""


def solve_leg(
    side: str,
    pelvis: np.ndarray,
    pelvis_rotation: np.ndarray,
    ankle: np.ndarray,
    foot_rotation: np.ndarray,
    leftward: np.ndarray,
    softness: np.ndarray,
) -> LegSolution:
    """Hinge angles that put a foot where it should be.

    Args:
        side: ``right`` or ``left``.
        pelvis: Position of the pelvis, ``(T, 3)``.
        pelvis_rotation: Its orientation, ``(T, 3, 3)``.
        ankle: Where the ankle should be, ``(T, 3)``; pulled towards the hip if out of reach.
        foot_rotation: Orientation of the foot, ``(T, 3, 3)``.
        leftward: Direction of the knee's axis, ``(T, 3)``; the knee bends in the plane across it.
        softness: Metres before full length over which the leg eases into it, ``(T,)``; 0 for a leg that stands. The
            knee of a stretched leg would otherwise snap, for the last millimetre of length is many degrees.

    Returns:
        The hinge angles and joint positions.
    """
    hip = pelvis + pelvis_rotation @ _offset(f"{side}_thigh")
    reach = ankle - hip
    distance = np.linalg.norm(reach, axis=1)
    margin = np.maximum(softness, 1e-9)
    beyond = np.maximum(distance - (LEG - margin), 0)
    eased = np.minimum(distance, LEG - margin) + margin * (1 - np.exp(-beyond / margin))
    ankle = hip + reach * (eased / distance)[:, None]
    upper, bend = _two_bones(THIGH, SHIN, ankle - hip, leftward)
    shin = upper @ _about_y(bend)
    hip_angles = Rotation.from_matrix(np.swapaxes(pelvis_rotation, 1, 2) @ upper).as_euler("XZY")
    ankle_angles = Rotation.from_matrix(np.swapaxes(shin, 1, 2) @ foot_rotation).as_euler("XZY")
    knee = hip - THIGH * upper[..., 2]
    return LegSolution(np.concatenate([hip_angles, bend[:, None], ankle_angles], 1), hip, knee, ankle)


def solve_arm(side: str, hand: np.ndarray, elbow_out: float) -> np.ndarray:
    """Shoulder and elbow angles that put the hand at a point.

    Args:
        side: ``right`` or ``left``.
        hand: Where the centre of the hand should be, ``(3,)`` metres in the frame of the torso, from the middle
            between the shoulders.
        elbow_out: Direction of the elbow: 0 points it down, pi / 2 out to the side, in radians.

    Returns:
        Shoulder x, z, y and elbow, ``(4,)`` radians.

    Raises:
        ValueError: If the hand is further away than the arm is long.
    """
    shoulder = _offset(f"{side}_upper_arm")
    reach = np.asarray(hand, float) - [0, shoulder[1], 0] - [shoulder[0], 0, 0]
    distance = np.linalg.norm(reach)
    longest = (UPPER_ARM + LOWER_ARM) * _STRAIGHTEST
    if distance > longest + 0.02:
        raise ValueError(
            f"The {side} hand at {np.round(hand, 2).tolist()} is {distance:.2f} m from its shoulder, the arm reaches "
            f"{longest:.2f} m. Move the hand closer."
        )
    reach *= min(1, longest / distance)
    outward = -1.0 if side == "right" else 1.0
    elbow_direction = np.array([0, outward * np.sin(elbow_out), -np.cos(elbow_out)])
    # The elbow points away from the bend; the hinge's axis is across the arm's line and that direction.
    axis = np.cross(reach, elbow_direction)[None]
    upper, bend = _two_bones(UPPER_ARM, LOWER_ARM, reach[None], axis, forward=False)
    angles = Rotation.from_matrix(upper).as_euler("XZY")[0]
    limits = joint_limits()[ARM_COLUMNS[side]]
    return np.append(_nearest_branch(angles, limits[:3]), -bend[0])


def _nearest_branch(angles: np.ndarray, limits: np.ndarray) -> np.ndarray:
    """Of all x, z, y angles of the same rotation, those inside the limits that are smallest."""
    x, z, y = angles
    turns = 2 * np.pi * np.stack(np.meshgrid(*[(-1, 0, 1)] * 3), -1).reshape(-1, 3)
    candidates = np.concatenate([angles + turns, np.array([x + np.pi, np.pi - z, y + np.pi]) + turns])
    outside = np.maximum(limits[:, 0] - candidates, 0) + np.maximum(candidates - limits[:, 1], 0)
    return candidates[(100 * outside.sum(1) + np.abs(candidates).sum(1)).argmin()]


def _two_bones(
    first: float, second: float, reach: np.ndarray, axis: np.ndarray, forward: bool = True
) -> tuple[np.ndarray, np.ndarray]:
    """Orientation of the upper bone and bend of the middle hinge, ``(T, 3, 3)`` and ``(T,)`` (never negative).

    Both bones point along their negative z. ``axis`` is roughly the y axis of the upper bone. The middle joint stands
    on the forward side of the line (a knee), or behind it (an elbow) if ``forward`` is False.
    """
    distance = np.linalg.norm(reach, axis=-1)
    down = reach / distance[:, None]
    across = axis - (axis * down).sum(-1, keepdims=True) * down
    across /= np.linalg.norm(across, axis=-1, keepdims=True)
    straight = np.stack([np.cross(across, -down), across, -down], -1)
    bend = np.arccos(np.clip((distance**2 - first**2 - second**2) / (2 * first * second), -1, 1))
    swing = np.arctan2(second * np.sin(bend), first + second * np.cos(bend))
    return straight @ _about_y(-swing if forward else swing), bend


def _about_y(angle: np.ndarray) -> np.ndarray:
    return Rotation.from_euler("y", angle[:, None]).as_matrix()


@cache
def _masses() -> tuple[np.ndarray, np.ndarray]:
    """Mass and centre of mass in its own frame of each body, ``(15,)`` and ``(15, 3)``."""
    model = load_model()
    # body_ipos is the centre of mass in the body frame.
    return model.body_mass[1:].copy(), model.body_ipos[1:].copy()


def centre_of_mass(qpos: np.ndarray, bodies: tuple[str, ...] = BODY_NAMES) -> np.ndarray:
    """Centre of mass of some bodies of the poses ``(T, 35)``, ``(T, 3)`` in the world frame."""
    pose = kinematics(qpos)
    indices = [BODY_NAMES.index(name) for name in bodies]
    mass, local = (array[indices] for array in _masses())
    rotations = Rotation.from_quat(pose.quaternions[:, indices].reshape(-1, 4), scalar_first=True)
    offsets = rotations.apply(np.tile(local, (len(pose.positions), 1))).reshape(-1, len(indices), 3)
    return np.einsum("tbk,b->tk", pose.positions[:, indices] + offsets, mass) / mass.sum()


def body_mass(name: str) -> float:
    """Mass of a body in kilograms."""
    return float(_masses()[0][BODY_NAMES.index(name)])


def body_centre(name: str) -> np.ndarray:
    """Centre of mass of a body in its own frame, ``(3,)`` metres."""
    return _masses()[1][BODY_NAMES.index(name)]


def floor_reach(side: str) -> np.ndarray:
    """Corners of a foot's sole in the frame of the foot, ``(4, 3)`` metres."""
    geom = load_model().geom(f"{side}_foot")
    if geom.type != mujoco.mjtGeom.mjGEOM_BOX:
        raise ValueError(f"The geom {side}_foot must be a box to place its sole on the floor.")
    signs = np.array([(1, 1), (1, -1), (-1, -1), (-1, 1)])
    corners = np.concatenate([signs * geom.size[:2], np.full((4, 1), -geom.size[2])], 1)
    return geom.pos + corners
