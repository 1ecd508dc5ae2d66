"""Did the humanoid do it? Checks of text skills from body positions alone.

They were written before any policy was trained, and training never sees them: a policy learns from its text reward, and
a check then judges the motion by geometry. Every check looks at the last 5 s of an episode, so that the time it takes
to get into the motion counts neither way.

A text without a check has none to fail: its report holds the similarity and the falls only.
"""

from __future__ import annotations

import re

import numpy as np

from agents.text.further_checks import FURTHER_CHECKS
from agents.text.trajectory import (
    FOOT_DOWN_HEIGHT,
    STANDING_HEIGHT,
    SUPPORT_FOOT_HEIGHT,
    Check,
    Trajectory,
    count_steps,
    count_swings,
    distance_along_facing,
    knee_bend,
)

FALL_HEAD_HEIGHT = 0.5
"""Metres: a head centre lower than this is that of a lying body. Standing it is at 1.53, in a deep squat at 0.9."""

SQUAT_HEIGHT = 0.65 * STANDING_HEIGHT
SQUAT_KNEE_BEND = np.radians(60.0)
KICK_FOOT_HEIGHT = 0.4
KICK_PELVIS_HEIGHT = 0.6
# Several times back and forth; a hand that merely trembles with the body's balance moves by 2 or 3 cm.
WAVE_SWING = 0.1
WAVE_SWINGS = 6
WALK_DISTANCE = 2.0
WALK_HEAD_HEIGHT = 1.0
WALK_STEPS = 4


def fell(trajectory: Trajectory) -> bool:
    """Whether the head centre came below 0.5 m at any time of the episode."""
    return bool((trajectory.head_height < FALL_HEAD_HEIGHT).any())


def raises_both_arms(trajectory: Trajectory) -> bool:
    """Both hands are higher than the head centre in at least half of the last 5 s."""
    end = trajectory.ending()
    lower_hand = np.minimum(end.height("left_hand"), end.height("right_hand"))
    return bool((lower_hand > end.head_height).mean() >= 0.5)


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
    forward, _ = distance_along_facing(end)
    upright = (end.head_height > WALK_HEAD_HEIGHT).all()
    return bool(forward >= WALK_DISTANCE and upright and count_steps(end) >= WALK_STEPS)


CHECKS: dict[str, Check] = {
    "raise both arms above the head": raises_both_arms,
    "wave the right hand": waves_right_hand,
    "squat down": squats,
    "kick with the left leg": kicks_with_left_leg,
    "walk forward": walks_forward,
    **FURTHER_CHECKS,
}
"""Normalised text and its check."""


def normalise_text(text: str) -> str:
    """Lower case, single spaces, no punctuation: "Squat  down!" becomes "squat down"."""
    return " ".join(re.sub(r"[^\w\s]", " ", text.lower()).split())


def find_check(text: str) -> Check | None:
    """The check for a text, or None if it has none."""
    return CHECKS.get(normalise_text(text))
