"""Measurements of short motions, from which rules decide how far a sentence is true.

All come from body positions and orientations over half a second, none from joint angles, so that they mean the same for
simulated and for kinematic motion. Lengths in metres, speeds in m/s, angles in radians; "forward" and "left" are those
of the pelvis's heading in the last frame.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from motion_data.skeleton import FRAME_RATE, HEAD_CENTRE, body_index, heading

Array = NDArray[np.float64]

WINDOW = 15
"""Frames of a short motion, the last of which is the state it is about."""
SIDES = ("right", "left")


def ramp(value: Array, start: float, end: float) -> Array:
    """0 before `start`, 1 from `end` on, linear between; `start` may be the greater one."""
    return np.clip((value - start) / (end - start), 0.0, 1.0)


def near(value: Array, best: float, tolerance: float) -> Array:
    """1 at `best`, falling linearly to 0 at a distance of `tolerance`."""
    return np.clip(1.0 - np.abs(value - best) / tolerance, 0.0, 1.0)


def partly(*values: Array) -> Array:
    """How far several demands are met together: half the mean, half the worst, so that each one met counts a little."""
    stacked = np.stack(values)
    return 0.5 * stacked.mean(0) + 0.5 * stacked.min(0)


def _axis(quaternions: Array, column: int) -> Array:
    """One column of the rotation matrices of quaternions (..., 4): where a body's own axis points."""
    w, x, y, z = np.moveaxis(quaternions, -1, 0)
    columns = (
        (1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)),
        (2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)),
        (2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)),
    )
    return np.stack(columns[column], -1)


class Measurements:
    """Measurements of n short motions.

    Args:
        positions: origins of the bodies, `(n, WINDOW, 15, 3)` metres in the world.
        quaternions: orientations of the bodies, w first, `(n, WINDOW, 15, 4)`.
    """

    def __init__(self, positions: Array, quaternions: Array) -> None:
        self.positions = positions
        self.quaternions = quaternions
        yaw = heading(quaternions[:, -1, 0])
        self._cosine, self._sine = np.cos(yaw)[:, None], np.sin(yaw)[:, None]

    def __len__(self) -> int:
        """Number of motions n."""
        return len(self.positions)

    def _turn(self, vectors: Array) -> Array:
        """World vectors `(n, ..., 3)` in the heading frame of the last frame."""
        shape = (len(self),) + (1,) * (vectors.ndim - 2)
        cosine, sine = self._cosine.reshape(shape), self._sine.reshape(shape)
        x, y, z = np.moveaxis(vectors, -1, 0)
        return np.stack([cosine * x + sine * y, cosine * y - sine * x, z], -1)

    def point(self, body: str) -> Array:
        """A body's place seen from the pelvis, in the last frame `(n, 3)`: forward, left, up."""
        return self._turn(self.positions[:, -1, body_index(body)] - self.positions[:, -1, 0])

    def height(self, body: str) -> Array:
        """Height of a body's origin above the floor, `(n,)`: a foot's is its ankle, a shin's its knee."""
        return self.positions[:, -1, body_index(body), 2]

    def axis(self, body: str, column: int) -> Array:
        """Direction of a body's own x, y or z axis (column 0, 1, 2), in the heading frame, `(n, 3)`."""
        return self._turn(_axis(self.quaternions[:, -1, body_index(body)], column))

    def velocity(self, body: str, frames: int = 4) -> Array:
        """Mean velocity of a body relative to the pelvis over the last frames, heading frame, `(n, 3)`."""
        track = self._track(body)
        return (track[:, -1] - track[:, -1 - frames]) * (FRAME_RATE / frames)

    def speed(self, body: str, frames: int = 10) -> Array:
        """Root mean square speed of a body relative to the pelvis over the last frames, `(n,)`."""
        steps = np.diff(self._track(body)[:, -1 - frames :], axis=1) * FRAME_RATE
        return np.sqrt((steps**2).sum(-1).mean(1))

    def _track(self, body: str) -> Array:
        """A body's path seen from the pelvis, each frame in its own heading frame, `(n, WINDOW, 3)`."""
        offset = self.positions[:, :, body_index(body)] - self.positions[:, :, 0]
        yaw = heading(self.quaternions[:, :, 0])
        cosine, sine = np.cos(yaw), np.sin(yaw)
        x, y, z = np.moveaxis(offset, -1, 0)
        return np.stack([cosine * x + sine * y, cosine * y - sine * x, z], -1)

    def apart(self, first: str, second: str) -> Array:
        """Distance of two bodies' origins, `(n,)`."""
        gap = self.positions[:, -1, body_index(first)] - self.positions[:, -1, body_index(second)]
        return np.linalg.norm(gap, axis=-1)

    def bend(self, upper: str, middle: str, lower: str) -> Array:
        """Angle at the middle joint, 0 if the limb is straight, `(n,)`."""
        last = self.positions[:, -1]
        first = last[:, body_index(middle)] - last[:, body_index(upper)]
        second = last[:, body_index(lower)] - last[:, body_index(middle)]
        cosine = (first * second).sum(-1) / (np.linalg.norm(first, axis=-1) * np.linalg.norm(second, axis=-1))
        return np.arccos(np.clip(cosine, -1, 1))

    # The measurements that many rules share.

    @cached_property
    def pelvis_height(self) -> Array:
        """0.905 when standing."""
        return self.height("pelvis")

    @cached_property
    def head_centre(self) -> Array:
        """Centre of the head seen from the pelvis, `(n, 3)`."""
        forward, _, up = HEAD_CENTRE
        return self.point("head") + forward * self.axis("head", 0) + up * self.axis("head", 2)

    @cached_property
    def head_height(self) -> Array:
        """Height of the head's centre, 1.53 when standing."""
        return self.pelvis_height + self.head_centre[:, 2]

    @cached_property
    def travel(self) -> Array:
        """Mean velocity of the pelvis over the last 0.2 s, heading frame, `(n, 3)`."""
        path = self.positions[:, :, 0]
        return self._turn((path[:, -1] - path[:, -7]) * (FRAME_RATE / 6))

    @cached_property
    def turning(self) -> Array:
        """Yaw rate of the pelvis over the last 0.2 s, positive to the left, rad/s, `(n,)`."""
        yaw = heading(self.quaternions[:, [-7, -1], 0])
        return ((yaw[:, 1] - yaw[:, 0] + np.pi) % (2 * np.pi) - np.pi) * (FRAME_RATE / 6)

    @cached_property
    def uprightness(self) -> Array:
        """1 if the trunk is upright, 0 if it is level, -1 if it is upside down."""
        return self.axis("torso", 2)[:, 2]

    @cached_property
    def on_feet(self) -> Array:
        """0 for lying and fallen bodies, 1 for bodies that are carried by their legs, knees or seat."""
        return ramp(self.uprightness, 0.1, 0.6) * ramp(self.head_height, 0.45, 0.85)

    @cached_property
    def standing(self) -> Array:
        """1 if the body stands on its legs with the trunk upright."""
        return ramp(self.pelvis_height, 0.55, 0.8) * ramp(self.uprightness, 0.4, 0.85)

    @cached_property
    def steady(self) -> Array:
        """1 if the pelvis hardly moves."""
        return ramp(np.linalg.norm(self.travel[:, :2], axis=-1), 0.5, 0.12) * ramp(np.abs(self.turning), 1.0, 0.3)

    @cached_property
    def liveliness(self) -> Array:
        """Speed of the fastest hand or foot seen from the pelvis, `(n,)`."""
        return np.max([self.speed(f"{side}_{part}") for side in SIDES for part in ("hand", "foot")], axis=0)

    def memo(self, name: str, side: str, compute: Any) -> Array:
        """A value per side that many rules use, computed once."""
        store: dict[tuple[str, str], Array] = self.__dict__.setdefault("_memo", {})
        if (name, side) not in store:
            store[name, side] = compute()
        return store[name, side]

    def hand_above_head(self, side: str) -> Array:
        """Height of a hand over the head's centre."""
        return self.memo("above", side, lambda: self.height(f"{side}_hand") - self.head_height)

    def hand_from_shoulder(self, side: str) -> Array:
        """A hand seen from its shoulder `(n, 3)`: forward, outward, up."""
        offset = self.point(f"{side}_hand") - self.point(f"{side}_upper_arm")
        return offset * np.array([1.0, 1.0 if side == "left" else -1.0, 1.0])

    def foot_from_pelvis(self, side: str) -> Array:
        """A foot seen from the pelvis `(n, 3)`: forward, outward, up."""
        return self.point(f"{side}_foot") * np.array([1.0, 1.0 if side == "left" else -1.0, 1.0])

    def elbow(self, side: str) -> Array:
        """Bend of an elbow, 0 if straight."""
        return self.bend(f"{side}_upper_arm", f"{side}_lower_arm", f"{side}_hand")

    def knee(self, side: str) -> Array:
        """Bend of a knee, 0 if straight."""
        return self.bend(f"{side}_thigh", f"{side}_shin", f"{side}_foot")

    def arm_raised(self, side: str) -> Array:
        """0 for a hanging arm, 0.35 for a hand at shoulder height, 1 for a hand well above the head."""
        above = self.hand_above_head(side)
        return 0.35 * ramp(above, -0.7, -0.15) + 0.65 * ramp(above, -0.15, 0.2)

    def arm_lowered(self, side: str) -> Array:
        """1 for a hanging arm, 0 from shoulder height on."""
        return ramp(self.hand_from_shoulder(side)[:, 2], -0.05, -0.4)

    def foot_down(self, side: str) -> Array:
        """1 if the foot is on the floor or nearly so."""
        return ramp(self.height(f"{side}_foot"), 0.3, 0.13)
