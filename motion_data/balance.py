"""Balance: where the centre of mass must be, and the pose of the whole body that has it there, feet in place.

Whoever plans a motion says what the upper body does, where the feet go and which of them carries the weight. This module
finds the path of the centre of mass, the pelvis by iteration and the legs by inverse kinematics.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_banded
from scipy.ndimage import gaussian_filter1d, maximum_filter1d
from scipy.spatial.transform import Rotation

from motion_data.inverse_kinematics import (
    LEG,
    LEG_COLUMNS,
    LegSolution,
    body_centre,
    body_mass,
    centre_of_mass,
    floor_reach,
    solve_leg,
)
from motion_data.skeleton import BODY_NAMES, FRAME_RATE, JOINT_NAMES, load_model, rest_qpos

UPPER_JOINTS = tuple(name for name in JOINT_NAMES if not any(part in name for part in ("hip", "knee", "ankle")))
"""Hinges that a plan sets directly; the others follow from the feet."""
FOOT_FIELDS = ("x", "y", "turn", "lift", "pitch", "roll")
GRAVITY = 9.81
CENTRE_HEIGHT = 0.9
"""Metres of the centre of mass above the floor."""
STIFFNESS = GRAVITY / CENTRE_HEIGHT
"""Of the linear inverted pendulum, per second squared."""
_NATURAL_BEND = 0.006  # metres the pelvis stands lower than on straight legs
_LEG_SOFTNESS = 0.03  # metres over which a leg in the air eases into its full length
_SOFT_LIFT = 0.03  # metres of lift from which it does so in full
_LEG_RESERVE = 0.9925  # share of the leg's length that a standing leg may use
_EASE_FRAMES = 8  # frames in which the pelvis eases into the limit that a stretched leg sets
_BALANCE_ITERATIONS = 8
_UPPER_BODIES = tuple(name for name in BODY_NAMES if not any(part in name for part in ("thigh", "shin", "foot")))


def balanced_path(
    pressure: np.ndarray, loop: bool = False, fps: float = FRAME_RATE, stiffness: float | np.ndarray = STIFFNESS
) -> np.ndarray:
    """Path of the centre of mass whose weight really rests where it is wanted, also while it accelerates.

    A body whose centre of mass c accelerates presses the floor not below c but at ``c - (h / g) c''`` (the zero-moment
    point of Vukobratovic's linear inverted pendulum). This solves for c: it sways ahead of each step, as a walker does.
    With a stiffness ``k = (z'' + g) / z`` that varies over time, ``k c - c'' = k pressure`` holds for any vertical
    motion, also for a run: k is 0 in flight.

    Args:
        pressure: Where the weight should rest in each frame, ``(T, 2)`` metres.
        loop: Whether the motion goes on from its last frame with its first; otherwise it is at rest at both ends.
        fps: Frames per second.
        stiffness: g / h of a centre at a constant height h, or that of each frame, ``(T,)``, per second squared.

    Returns:
        Path of the centre of mass on the floor plane, ``(T, 2)`` metres.
    """
    stiffness = np.broadcast_to(stiffness, len(pressure))
    if loop:  # the middle one of three rounds
        rounds = np.concatenate([np.arange(len(pressure) - 1)] * 2 + [np.arange(len(pressure))])
        path = balanced_path(pressure[rounds], fps=fps, stiffness=stiffness[rounds])
        return path[len(pressure) - 1 : 2 * len(pressure) - 1]
    after = np.full(len(pressure), fps**2)
    after[-1] = 0
    before = np.concatenate([[0.0], after[:-1]])
    bands = np.stack([-before, stiffness + before + after, -after])
    return solve_banded((1, 1), bands, stiffness[:, None] * pressure)


def pose_body(
    upper: np.ndarray,
    rotation: Rotation,
    target: np.ndarray,
    feet: Mapping[str, "FootPath"],
    lower: np.ndarray,
    lengths: Sequence[int],
    ease: int = _EASE_FRAMES,
) -> np.ndarray:
    """Poses with the feet in place and the centre of mass where it should be.

    Args:
        upper: Angles of :data:`UPPER_JOINTS` in radians, ``(T, joints)``.
        rotation: Orientation of the pelvis, T of them.
        target: Where the centre of mass should be on the floor plane, ``(T, 2)`` metres.
        feet: The feet by side.
        lower: Metres that the pelvis is lower than standing, ``(T,)``; more where a leg is too short.
        lengths: Frames of each clip, for several may be solved at once.
        ease: Frames in which the pelvis eases into the limit that a stretched leg sets.

    Returns:
        Poses, ``(T, 35)``.
    """
    matrix = rotation.as_matrix()
    qpos = np.tile(rest_qpos(), (len(upper), 1))
    qpos[:, 3:7] = rotation.as_quat(scalar_first=True)
    qpos[:, [7 + JOINT_NAMES.index(name) for name in UPPER_JOINTS]] = upper
    qpos[:, :3] = 0
    upper_centre = centre_of_mass(qpos, _UPPER_BODIES)
    standing = rest_qpos()[2] - _NATURAL_BEND - lower
    pelvis = np.concatenate([target - upper_centre[:, :2], standing[:, None]], 1)
    legs: dict[str, LegSolution] = {}
    for _ in range(_BALANCE_ITERATIONS):
        pelvis[:, 2] = _reachable_height(pelvis, matrix, feet, standing, lengths, ease)
        legs = {
            side: solve_leg(side, pelvis, matrix, foot.ankle, foot.rotation, foot.leftward, foot.softness)
            for side, foot in feet.items()
        }
        pelvis[:, :2] += target - _whole_centre(pelvis + upper_centre, legs, feet)
    pelvis[:, 2] = _reachable_height(pelvis, matrix, feet, standing, lengths, ease)
    qpos[:, :3] = pelvis
    for side, foot in feet.items():
        solution = solve_leg(side, pelvis, matrix, foot.ankle, foot.rotation, foot.leftward, foot.softness)
        qpos[:, [7 + column for column in LEG_COLUMNS[side]]] = solution.angles
    return qpos


@dataclass(frozen=True)
class FootPath:
    """Pose of one foot over T frames.

    Attributes:
        side: ``right`` or ``left``.
        ankle: Position of the ankle joint, ``(T, 3)`` metres.
        rotation: Orientation of the foot, ``(T, 3, 3)``.
        leftward: Direction of the knee's axis, ``(T, 3)``.
        lift: Metres that the foot is in the air, ``(T,)``; 0 while it bears weight.
    """

    side: str
    ankle: np.ndarray
    rotation: np.ndarray
    leftward: np.ndarray
    lift: np.ndarray

    @property
    def softness(self) -> np.ndarray:
        """Metres over which the leg eases into its full length, ``(T,)``: none while the foot stands."""
        raised = np.clip(self.lift / _SOFT_LIFT, 0, 1)
        return _LEG_SOFTNESS * raised**2 * (3 - 2 * raised)

    @classmethod
    def place(cls, side: str, channels: np.ndarray) -> "FootPath":
        """Foot whose lowest point is ``lift`` above the floor; it pitches about its toe edge or its heel edge.

        Args:
            side: ``right`` or ``left``.
            channels: Values of :data:`FOOT_FIELDS`, ``(T, 6)``.
        """
        x, y, turn, lift, pitch, roll = channels.T
        rotation = Rotation.from_euler("ZYX", np.stack([turn, pitch, roll], 1)).as_matrix()
        corners = floor_reach(side)
        middle = corners.mean(0)
        flat = Rotation.from_euler("z", turn[:, None]).as_matrix()
        edge = np.where(pitch[:, None] > 0, corners[:, 0].max(), corners[:, 0].min()) * np.array([1, 0, 0])
        edge = edge + [0, middle[1], middle[2]]
        place = np.stack([x, y, np.zeros_like(x)], 1)
        ankle = place + np.einsum("tij,tj->ti", flat, edge - middle) - np.einsum("tij,tj->ti", rotation, edge)
        lowest = np.einsum("tj,kj->tk", rotation[:, 2], corners).min(1)
        ankle[:, 2] = lift - lowest
        return cls(side, ankle, rotation, flat[:, :, 1], lift)


def _reachable_height(
    pelvis: np.ndarray,
    matrix: np.ndarray,
    feet: Mapping[str, FootPath],
    wanted: np.ndarray,
    lengths: Sequence[int],
    ease: int,
) -> np.ndarray:
    """The wanted height of the pelvis, lowered smoothly to what the standing legs can reach, ``(T,)``."""
    missing = np.zeros_like(wanted)
    for side, foot in feet.items():
        offset = matrix @ load_model().body(f"{side}_thigh").pos
        apart = ((foot.ankle - pelvis - offset)[:, :2] ** 2).sum(1)
        reach = np.sqrt(np.maximum((_LEG_RESERVE * LEG) ** 2 - apart, 0.01))
        # A lifted foot need not reach its place, so it frees the pelvis with the first centimetres.
        highest = foot.ankle[:, 2] + reach - offset[:, 2] + 5 * foot.lift
        missing = np.maximum(missing, wanted - highest)
    # The largest lack within a window, averaged over no more than that window, is never less than the lack itself.
    for clip in np.split(missing, np.cumsum(lengths)[:-1]):
        widest = maximum_filter1d(clip, 2 * ease + 1, mode="nearest")
        clip[:] = gaussian_filter1d(widest, ease / 2.5, mode="nearest", radius=ease)
    return wanted - missing


def _whole_centre(upper: np.ndarray, legs: Mapping[str, LegSolution], feet: Mapping[str, FootPath]) -> np.ndarray:
    """Centre of mass on the floor plane from the upper body's and the legs' joints, ``(T, 2)``."""
    total = sum(body_mass(name) for name in _UPPER_BODIES)
    moment = total * upper
    for side, leg in legs.items():
        for body, start, end in (("thigh", leg.hip, leg.knee), ("shin", leg.knee, leg.ankle)):
            name = f"{side}_{body}"
            share = -body_centre(name)[2] / np.linalg.norm(start - end, axis=1, keepdims=True)
            moment = moment + body_mass(name) * (start + share * (end - start))
            total += body_mass(name)
        foot = f"{side}_foot"
        moment = moment + body_mass(foot) * (leg.ankle + feet[side].rotation @ body_centre(foot))
        total += body_mass(foot)
    return (moment / total)[:, :2]
