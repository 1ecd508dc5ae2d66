"""What the bodies of a humanoid did in an episode, and what checks measure of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from motion_data.skeleton import FRAME_RATE, HEAD_CENTRE, body_index, heading, rest_qpos

JUDGED_SECONDS = 5.0
"""How much of the end of an episode a check looks at, in seconds."""

STANDING_HEIGHT = float(rest_qpos()[2])
"""Height of the pelvis in the rest pose, in metres."""

# A standing ankle is 0.075 m above the floor, on tiptoe about 0.15 m.
FOOT_DOWN_HEIGHT = 0.15
SUPPORT_FOOT_HEIGHT = 0.2
# One foot is ahead of the other when it leads by this much, in metres.
STEP_LENGTH = 0.05


@dataclass(frozen=True)
class Trajectory:
    """What the bodies of one humanoid did in one episode.

    Attributes:
        positions: Origins of the bodies in the world, metres, `(T, 15, 3)`.
        quaternions: Orientations of the bodies, w first, `(T, 15, 4)`.
        rate: Frames per second.

    Raises:
        ValueError: If the shapes do not fit together, or a number is not finite.
    """

    positions: np.ndarray
    quaternions: np.ndarray
    rate: float = FRAME_RATE

    def __post_init__(self) -> None:
        frames = len(self.positions)
        if frames == 0 or self.positions.shape != (frames, 15, 3) or self.quaternions.shape != (frames, 15, 4):
            raise ValueError(
                f"A trajectory needs positions (T, 15, 3) and quaternions (T, 15, 4) of at least one frame, got "
                f"{self.positions.shape} and {self.quaternions.shape}."
            )
        if not (np.isfinite(self.positions).all() and np.isfinite(self.quaternions).all()):
            raise ValueError("A trajectory must not hold NaN or infinite numbers.")

    def body(self, name: str) -> np.ndarray:
        """Positions of one body's origin, `(T, 3)`: a hand's is its wrist, a foot's its ankle."""
        return self.positions[:, body_index(name)]

    def height(self, name: str) -> np.ndarray:
        """Heights of one body's origin above the floor, `(T,)`."""
        return self.body(name)[:, 2]

    @property
    def head_height(self) -> np.ndarray:
        """Heights of the centre of the head, `(T,)`."""
        turn = Rotation.from_quat(self.quaternions[:, body_index("head")], scalar_first=True)
        return self.height("head") + turn.apply(HEAD_CENTRE)[:, 2]

    @property
    def facing(self) -> np.ndarray:
        """Horizontal unit vectors in which the pelvis faces, `(T, 2)`."""
        yaw = heading(self.quaternions[:, body_index("pelvis")])
        return np.stack([np.cos(yaw), np.sin(yaw)], axis=-1)

    def relative(self, name: str) -> np.ndarray:
        """Horizontal place of a body seen from the pelvis: how far in front and how far to the left, `(T, 2)`."""
        offset = (self.body(name) - self.body("pelvis"))[:, :2]
        forward = self.facing
        left = np.stack([-forward[:, 1], forward[:, 0]], axis=-1)
        return np.stack([(offset * forward).sum(-1), (offset * left).sum(-1)], axis=-1)

    def ending(self, seconds: float = JUDGED_SECONDS) -> Trajectory:
        """The last seconds of the trajectory, or all of it if it is shorter."""
        frames = max(1, round(seconds * self.rate))
        return Trajectory(self.positions[-frames:], self.quaternions[-frames:], self.rate)


Check = Callable[[Trajectory], bool]
"""Whether a motion is what a text says."""


def count_swings(values: np.ndarray, size: float) -> int:
    """Counts how often a signal travels by at least `size` between one turning point and the next.

    Args:
        values: The signal, `(T,)`.
        size: Smallest travel that counts; smaller wiggles are passed over.

    Returns:
        Number of swings: back and forth once is two.
    """
    swings = 0
    direction = 0
    low = high = values[0]
    for value in values[1:]:
        low, high = min(low, value), max(high, value)
        if direction <= 0 and value - low >= size:
            swings, direction, high = swings + 1, 1, value
        elif direction >= 0 and high - value >= size:
            swings, direction, low = swings + 1, -1, value
    return swings


def knee_bend(trajectory: Trajectory, side: str) -> np.ndarray:
    """Angle between thigh and shin in radians, 0 for a straight leg, `(T,)`. `side` is "left" or "right"."""
    thigh = trajectory.body(f"{side}_shin") - trajectory.body(f"{side}_thigh")
    shin = trajectory.body(f"{side}_foot") - trajectory.body(f"{side}_shin")
    cosine = (thigh * shin).sum(-1) / (np.linalg.norm(thigh, axis=-1) * np.linalg.norm(shin, axis=-1))
    return np.arccos(np.clip(cosine, -1.0, 1.0))


def count_steps(trajectory: Trajectory) -> int:
    """How often the foot in front changes; it leads by 5 cm or more."""
    lead = trajectory.relative("left_foot")[:, 0] - trajectory.relative("right_foot")[:, 0]
    in_front = np.sign(lead[np.abs(lead) >= STEP_LENGTH])
    return int((np.diff(in_front) != 0).sum())


def distance_along_facing(trajectory: Trajectory) -> tuple[float, float]:
    """How far the pelvis came along the mean direction in which it faced, and to the left of it; zeros if it spun evenly."""
    path = trajectory.body("pelvis")[:, :2]
    direction = trajectory.facing.mean(0)
    length = np.linalg.norm(direction)
    if length < 1e-6:
        return 0.0, 0.0
    x, y = direction / length
    moved = path[-1] - path[0]
    return float(moved @ (x, y)), float(moved @ (-y, x))
