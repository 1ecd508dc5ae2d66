"""Did the humanoid do it? Checks of text skills from body positions alone.

They were written before any policy was trained, and training never sees them: a policy learns from its text reward, and
a check then judges the motion by geometry. Every check looks at the last 5 s of an episode, so that the time it takes
to get into the motion counts neither way.

A text without a check has none to fail: its report holds the similarity and the falls only.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from motion_data.skeleton import FRAME_RATE, HEAD_CENTRE, body_index, heading, rest_qpos

JUDGED_SECONDS = 5.0
"""How much of the end of an episode a check looks at, in seconds."""

FALL_HEAD_HEIGHT = 0.5
"""Metres: a head centre lower than this is that of a lying body. Standing it is at 1.53, in a deep squat at 0.9."""

STANDING_HEIGHT = float(rest_qpos()[2])
"""Height of the pelvis in the rest pose, in metres."""

# A standing ankle is 0.075 m above the floor, on tiptoe about 0.15 m.
FOOT_DOWN_HEIGHT = 0.15
SUPPORT_FOOT_HEIGHT = 0.2
SQUAT_HEIGHT = 0.65 * STANDING_HEIGHT
SQUAT_KNEE_BEND = np.radians(60.0)
KICK_FOOT_HEIGHT = 0.4
KICK_PELVIS_HEIGHT = 0.6
# Several times back and forth; a hand that merely trembles with the body's balance moves by 2 or 3 cm.
WAVE_SWING = 0.1
WAVE_SWINGS = 6
WALK_DISTANCE = 2.0
WALK_HEAD_HEIGHT = 1.0
# One foot is ahead of the other when it leads by this much, in metres; four changes are four steps in 5 s.
STEP_LENGTH = 0.05
WALK_STEPS = 4


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


def fell(trajectory: Trajectory) -> bool:
    """Whether the head centre came below 0.5 m at any time of the episode."""
    return bool((trajectory.head_height < FALL_HEAD_HEIGHT).any())


def raises_both_arms(trajectory: Trajectory) -> bool:
    """Both hands are higher than the head centre in at least half of the last 5 s."""
    end = trajectory.ending()
    lower_hand = np.minimum(end.height("left_hand"), end.height("right_hand"))
    return bool((lower_hand > end.head_height).mean() >= 0.5)


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


def waves_right_hand(trajectory: Trajectory) -> bool:
    """The right hand swings at shoulder height or above, while the left hand stays down.

    In the last 5 s: the right hand is above the right shoulder in at least half of the time, and there makes at least
    6 swings (three times back and forth) of 0.1 m or more, sideways or forward and back, measured from the pelvis; the
    left hand is below the left shoulder in more than half of the time.
    """
    end = trajectory.ending()
    raised = end.height("right_hand") > end.height("right_upper_arm")
    left_down = end.height("left_hand") < end.height("left_upper_arm")
    if raised.mean() < 0.5 or left_down.mean() <= 0.5:
        return False
    hand = end.relative("right_hand")[raised]
    return max(count_swings(hand[:, axis], WAVE_SWING) for axis in (0, 1)) >= WAVE_SWINGS


def knee_bend(trajectory: Trajectory, side: str) -> np.ndarray:
    """Angle between thigh and shin in radians, 0 for a straight leg, `(T,)`. `side` is "left" or "right"."""
    thigh = trajectory.body(f"{side}_shin") - trajectory.body(f"{side}_thigh")
    shin = trajectory.body(f"{side}_foot") - trajectory.body(f"{side}_shin")
    cosine = (thigh * shin).sum(-1) / (np.linalg.norm(thigh, axis=-1) * np.linalg.norm(shin, axis=-1))
    return np.arccos(np.clip(cosine, -1.0, 1.0))


def squats(trajectory: Trajectory) -> bool:
    """The humanoid is down in a squat for at least half of the last 5 s.

    Down in a squat: the pelvis is lower than 65 % of its standing height, both ankles are lower than 0.15 m (the feet
    are on the floor), both knees are bent by at least 60 degrees. Squatting up and down counts if it is down half of
    the time.
    """
    end = trajectory.ending()
    down = end.height("pelvis") < SQUAT_HEIGHT
    feet = np.maximum(end.height("left_foot"), end.height("right_foot")) < FOOT_DOWN_HEIGHT
    knees = np.minimum(knee_bend(end, "left"), knee_bend(end, "right")) > SQUAT_KNEE_BEND
    return bool((down & feet & knees).mean() >= 0.5)


def kicks_with_left_leg(trajectory: Trajectory) -> bool:
    """The left foot goes up while the humanoid stands on the right one.

    In the last 5 s: at least once the left ankle is above 0.4 m while the right ankle is below 0.2 m and the pelvis
    above 0.6 m; and the left ankle is above 0.4 m more often than the right one.
    """
    end = trajectory.ending()
    left, right = end.height("left_foot"), end.height("right_foot")
    standing = (right < SUPPORT_FOOT_HEIGHT) & (end.height("pelvis") > KICK_PELVIS_HEIGHT)
    kicking = (left > KICK_FOOT_HEIGHT) & standing
    more_often = (left > KICK_FOOT_HEIGHT).sum() > (right > KICK_FOOT_HEIGHT).sum()
    return bool(kicking.any() and more_often)


def walks_forward(trajectory: Trajectory) -> bool:
    """The humanoid walks on its feet in the direction that it faces.

    In the last 5 s: the pelvis moves by at least 2 m along the mean facing direction, the head centre is above 1 m
    throughout, and the foot in front changes at least 4 times (it leads by 5 cm or more).
    """
    end = trajectory.ending()
    path = end.body("pelvis")[:, :2]
    direction = end.facing.mean(0)
    length = np.linalg.norm(direction)
    if length < 1e-6:  # spinning evenly: it faces nowhere
        return False
    distance = (path[-1] - path[0]) @ direction / length
    lead = end.relative("left_foot")[:, 0] - end.relative("right_foot")[:, 0]
    in_front = np.sign(lead[np.abs(lead) >= STEP_LENGTH])
    steps = int((np.diff(in_front) != 0).sum())
    return bool(distance >= WALK_DISTANCE and (end.head_height > WALK_HEAD_HEIGHT).all() and steps >= WALK_STEPS)


CHECKS: dict[str, Check] = {
    "raise both arms above the head": raises_both_arms,
    "wave the right hand": waves_right_hand,
    "squat down": squats,
    "kick with the left leg": kicks_with_left_leg,
    "walk forward": walks_forward,
}
"""Normalised text and its check."""


def normalise_text(text: str) -> str:
    """Lower case, single spaces, no punctuation: "Squat  down!" becomes "squat down"."""
    return " ".join(re.sub(r"[^\w\s]", " ", text.lower()).split())


def find_check(text: str) -> Check | None:
    """The check for a text, or None if it has none."""
    return CHECKS.get(normalise_text(text))
