"""Checks of fifteen further texts; like those of `agents.text.checks` they were written before any policy learned these.

A pose counts if it is held for half of the last 5 s. Distances are in metres, "left" and "in front" are seen from the pelvis.
"""

from __future__ import annotations

import numpy as np

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
from motion_data.skeleton import heading

SHOULDER_LEVEL = 0.2
"""How far a hand at shoulder height may be above or below the shoulder."""
REACH = 0.4
"""How far a stretched arm takes the hand from its shoulder, horizontally; the whole arm is 0.53 long."""
AT_THE_HEAD = 0.25
AT_THE_HIP = 0.3
BEND_ANGLE = np.radians(45.0)
LEAN_ANGLE = np.radians(12.0)
LIFTED_FOOT = 0.25
KNEELING_KNEE = 0.2
# From the guard to a straight arm it is 0.14.
PUNCH_TRAVEL = 0.12
PUNCH_REACH = 0.35
STANDING_HEAD = 1.0
BACKWARD_DISTANCE = 1.0
SIDEWAYS_DISTANCE = 1.0
TURN_ANGLE = np.radians(90.0)
RUN_SPEED = 1.8
RUN_STEPS = 8
MARCH_STEPS = 3
MARCH_DISTANCE = 1.5


def _held(mask: np.ndarray) -> bool:
    return bool(mask.mean() >= 0.5)


def _hand_from_shoulder(trajectory: Trajectory, side: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """How far a hand is in front of its shoulder, outwards of it and above it, each `(T,)`."""
    hand, shoulder = trajectory.relative(f"{side}_hand"), trajectory.relative(f"{side}_upper_arm")
    forward, left = (hand - shoulder).T
    above = trajectory.height(f"{side}_hand") - trajectory.height(f"{side}_upper_arm")
    return forward, left if side == "left" else -left, above


def _trunk(trajectory: Trajectory) -> tuple[np.ndarray, np.ndarray]:
    """Angles by which the line from pelvis to head leans forward and to the left, radians `(T,)`."""
    rise = trajectory.height("head") - trajectory.height("pelvis")
    forward, left = trajectory.relative("head").T
    return np.arctan2(forward, rise), np.arctan2(left, rise)


def _on_both_feet(trajectory: Trajectory) -> np.ndarray:
    return np.maximum(trajectory.height("left_foot"), trajectory.height("right_foot")) < SUPPORT_FOOT_HEIGHT


def _upright(trajectory: Trajectory) -> bool:
    return bool((trajectory.head_height > STANDING_HEAD).all())


def raises_right_arm(trajectory: Trajectory) -> bool:
    """The right hand is above the head centre, the left one below its shoulder, at the same time, in half of the time."""
    end = trajectory.ending()
    left_down = end.height("left_hand") < end.height("left_upper_arm")
    return _held((end.height("right_hand") > end.head_height) & left_down)


def spreads_both_arms(trajectory: Trajectory) -> bool:
    """Both hands are 0.4 or more outwards of their shoulders and within 0.2 of their height."""
    end = trajectory.ending()
    sides = [_hand_from_shoulder(end, side) for side in ("left", "right")]
    return _held(np.all([(out > REACH) & (np.abs(above) < SHOULDER_LEVEL) for _, out, above in sides], axis=0))


def stretches_both_arms_forward(trajectory: Trajectory) -> bool:
    """Both hands are 0.4 or more in front of their shoulders and within 0.2 of their height."""
    end = trajectory.ending()
    sides = [_hand_from_shoulder(end, side) for side in ("left", "right")]
    return _held(np.all([(ahead > REACH) & (np.abs(above) < SHOULDER_LEVEL) for ahead, _, above in sides], axis=0))


def puts_both_hands_on_the_head(trajectory: Trajectory) -> bool:
    """Both hands are within 0.25 of the head centre."""
    end = trajectory.ending()
    centre = end.body("head") + (0, 0, 1) * (end.head_height - end.height("head"))[:, None]
    gaps = [np.linalg.norm(end.body(f"{side}_hand") - centre, axis=1) for side in ("left", "right")]
    return _held(np.maximum(*gaps) < AT_THE_HEAD)


def puts_both_hands_on_the_hips(trajectory: Trajectory) -> bool:
    """Both hands are within 0.3 of the hip joint of their side, and the elbows further out than the hands."""
    end = trajectory.ending()
    there = np.ones(len(end.positions), bool)
    for side, sign in (("left", 1.0), ("right", -1.0)):
        there &= np.linalg.norm(end.body(f"{side}_hand") - end.body(f"{side}_thigh"), axis=1) < AT_THE_HIP
        there &= sign * (end.relative(f"{side}_lower_arm") - end.relative(f"{side}_hand"))[:, 1] > 0
    return _held(there)


def bends_forward(trajectory: Trajectory) -> bool:
    """The trunk leans forward by 45 degrees or more on straight enough legs: hips above 65 % of their standing height."""
    end = trajectory.ending()
    high = end.height("pelvis") > 0.65 * STANDING_HEIGHT
    return _held((_trunk(end)[0] > BEND_ANGLE) & high & _on_both_feet(end))


def leans_to_the_left(trajectory: Trajectory) -> bool:
    """The trunk leans to the left by 12 degrees or more, on both feet."""
    end = trajectory.ending()
    return _held((_trunk(end)[1] > LEAN_ANGLE) & _on_both_feet(end))


def stands_on_the_left_leg(trajectory: Trajectory) -> bool:
    """The right ankle is above 0.25 while the left one is below 0.2 and the head centre above 1."""
    end = trajectory.ending()
    stands = (end.height("left_foot") < SUPPORT_FOOT_HEIGHT) & (end.head_height > STANDING_HEAD)
    return _held((end.height("right_foot") > LIFTED_FOOT) & stands)


def punches_with_the_right_hand(trajectory: Trajectory) -> bool:
    """The right hand shoots forward and comes back at least twice, further than the left one, on both feet.

    It travels by 0.12 or more, seen from its shoulder, between turning points (two punches are three such ways at least), is at
    some time at about shoulder height and 0.35 in front of the shoulder, and travels more often than the left hand.
    """
    end = trajectory.ending()
    ahead, _, above = _hand_from_shoulder(end, "right")
    struck = (ahead > PUNCH_REACH) & (np.abs(above) < 1.5 * SHOULDER_LEVEL)
    swings = count_swings(ahead, PUNCH_TRAVEL)
    other = count_swings(_hand_from_shoulder(end, "left")[0], PUNCH_TRAVEL)
    return bool(struck.any() and swings >= 3 and swings > other and _upright(end))


def kneels(trajectory: Trajectory) -> bool:
    """At least one knee is below 0.2, and the trunk is within 45 degrees of upright."""
    end = trajectory.ending()
    knee = np.minimum(end.height("left_shin"), end.height("right_shin"))
    forward, left = _trunk(end)
    return _held((knee < KNEELING_KNEE) & (np.maximum(np.abs(forward), np.abs(left)) < BEND_ANGLE))


def walks_backward(trajectory: Trajectory) -> bool:
    """The pelvis moves by 1 or more against the direction that it faces, upright, in at least four steps."""
    end = trajectory.ending()
    forward, _ = distance_along_facing(end)
    return bool(-forward >= BACKWARD_DISTANCE and _upright(end) and count_steps(end) >= 4)


def walks_sideways_to_the_right(trajectory: Trajectory) -> bool:
    """The pelvis moves by 1 or more to the right, and further so than forward or back, upright."""
    end = trajectory.ending()
    forward, left = distance_along_facing(end)
    return bool(-left >= SIDEWAYS_DISTANCE and -left > abs(forward) and _upright(end))


def turns_to_the_left(trajectory: Trajectory) -> bool:
    """The pelvis turns to the left by 90 degrees or more in all, upright."""
    end = trajectory.ending()
    yaw = np.unwrap(heading(end.quaternions[:, 0]))
    return bool(yaw[-1] - yaw[0] >= TURN_ANGLE and _upright(end))


def runs_forward(trajectory: Trajectory) -> bool:
    """The pelvis moves at 1.8 m/s or more along the direction that it faces, upright, in at least eight steps."""
    end = trajectory.ending()
    forward, _ = distance_along_facing(end)
    seconds = len(end.positions) / end.rate
    return bool(forward >= RUN_SPEED * seconds and _upright(end) and count_steps(end) >= RUN_STEPS)


def marches_on_the_spot(trajectory: Trajectory) -> bool:
    """Each foot is lifted above 0.2, while the other one is down, at least three times in turns, on the spot.

    The pelvis ends within 1.5 of where it was 5 s before.
    """
    end = trajectory.ending()
    left, right = end.height("left_foot"), end.height("right_foot")
    lifted = np.where((left > SUPPORT_FOOT_HEIGHT) & (right < FOOT_DOWN_HEIGHT), 1, 0)
    lifted -= np.where((right > SUPPORT_FOOT_HEIGHT) & (left < FOOT_DOWN_HEIGHT), 1, 0)
    turns = lifted[lifted != 0]
    changes = int((np.diff(turns) != 0).sum())
    path = end.body("pelvis")[:, :2]
    stays = np.linalg.norm(path[-1] - path[0]) < MARCH_DISTANCE
    bent = np.maximum(knee_bend(end, "left"), knee_bend(end, "right")).max() > np.radians(45)
    return bool(changes >= MARCH_STEPS - 1 and stays and bent and _upright(end))


FURTHER_CHECKS: dict[str, Check] = {
    "raise the right arm": raises_right_arm,
    "spread both arms to the sides": spreads_both_arms,
    "stretch both arms forward": stretches_both_arms_forward,
    "put both hands on the head": puts_both_hands_on_the_head,
    "put both hands on the hips": puts_both_hands_on_the_hips,
    "bend forward": bends_forward,
    "lean to the left": leans_to_the_left,
    "stand on the left leg": stands_on_the_left_leg,
    "punch with the right hand": punches_with_the_right_hand,
    "kneel down": kneels,
    "walk backward": walks_backward,
    "walk sideways to the right": walks_sideways_to_the_right,
    "turn to the left": turns_to_the_left,
    "run forward": runs_forward,
    "march on the spot": marches_on_the_spot,
}
"""Normalised text and its check."""
