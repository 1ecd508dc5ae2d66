"""Keys of motion retrieval: 32 numbers that say what a body does now and where it is going within the next 0.5 s.

RACon (Mu et al. 2024, "Retrieval-augmented simulated character locomotion control", section 3.2) names the initial
velocity of the root, the mean velocity and the end effectors, "etc."; velocities of the end effectors, displacement and
turn at the end are this project's choice. A query is made by the same two functions as a key: :func:`state_key` of the
present state, and :func:`course_key` of the way that the goal asks for.
"""

import numpy as np

from motion_data.skeleton import FRAME_RATE, body_index, heading

CLIP_FRAMES = 15
"""Frame intervals of a retrieved clip: 0.5 s at 30 frames per second."""
END_EFFECTORS = ("right_hand", "left_hand", "right_foot", "left_foot")
"""Bodies whose places and velocities describe the pose."""
END_EFFECTOR_INDEX = np.array([body_index(name) for name in END_EFFECTORS])
"""Where they stand in arrays of bodies."""
VELOCITY_HALF_LIFE = 0.1
"""Seconds after which a wished velocity or heading is half reached. The springs in Holden's demonstration of learned motion
matching (2020) take 0.27 s; here a body that hurries more comes nearer to its goals."""
LEAD = 0.35
"""Share of the speed that is missing by which a query asks for more than the goal: the body stays behind what it follows."""
FASTEST_TURN = 2.0
"""rad/s that a query asks for at most: only acrobatics turn faster, and a database that has them would answer with them."""

_BLOCKS = {
    "root_velocity": 3,  # m/s, now
    "end_effector_positions": 3 * len(END_EFFECTORS),  # m from the root
    "end_effector_velocities": 3 * len(END_EFFECTORS),  # m/s
    "mean_velocity": 2,  # m/s, forward and leftward, over 0.5 s
    "displacement": 2,  # m, after 0.5 s
    "turn": 1,  # rad, after 0.5 s
}
_ends = np.cumsum(list(_BLOCKS.values()))
KEY_LAYOUT: dict[str, slice] = {
    name: slice(int(end) - size, int(end)) for (name, size), end in zip(_BLOCKS.items(), _ends, strict=True)
}
"""Name of each block of a key and its place. All vectors are in the root's heading frame of the first moment, except
`mean_velocity`, which is in that of each moment."""
KEY_SIZE = int(_ends[-1])
"""32."""
BLOCK_SCALE = np.concatenate([np.full(size, size**-0.5) for size in _BLOCKS.values()])
"""Factor of each standardised number that lets every block count alike, however many numbers it has, ``(32,)``."""

_SMALLEST_DEVIATIONS = {
    "root_velocity": 0.5,
    "end_effector_positions": 0.1,
    "end_effector_velocities": 0.5,
    "mean_velocity": 0.5,
    "displacement": 0.25,
    "turn": 0.5,
}
SMALLEST_DEVIATION = np.concatenate([np.full(size, _SMALLEST_DEVIATIONS[name]) for name, size in _BLOCKS.items()])
"""Standard deviations below which a key is not scaled up, ``(32,)``, in its units: where nearly all clips walk straight on,
a wish to turn would otherwise outweigh everything else."""

STATE_SIZE = KEY_LAYOUT["mean_velocity"].start
"""27: the numbers of a key that the present state determines."""


def turned(vectors: np.ndarray, yaw: np.ndarray) -> np.ndarray:
    """Vectors ``(..., 2 or 3)`` turned about the vertical axis by angles ``(...)`` in radians."""
    cosine, sine = np.cos(yaw), np.sin(yaw)
    result = np.array(vectors, float)
    result[..., 0] = cosine * vectors[..., 0] - sine * vectors[..., 1]
    result[..., 1] = sine * vectors[..., 0] + cosine * vectors[..., 1]
    return result


def wrapped(angle: np.ndarray) -> np.ndarray:
    """Angles brought into [-pi, pi)."""
    return (angle + np.pi) % (2 * np.pi) - np.pi


def state_key(positions: np.ndarray, root_quaternion: np.ndarray, velocities: np.ndarray) -> np.ndarray:
    """The part of a key that the present state determines.

    Args:
        positions: Origins of root and end effectors, ``(n, 5, 3)`` metres in the world.
        root_quaternion: Orientation of the root, w first, ``(n, 4)``.
        velocities: Their velocities, ``(n, 5, 3)`` m/s in the world.

    Returns:
        Blocks `root_velocity` to `end_effector_velocities`, ``(n, 27)``.
    """
    yaw = heading(root_quaternion)[:, None]
    offsets = turned(positions[:, 1:] - positions[:, :1], -yaw)
    velocities = turned(velocities, -yaw)
    return np.concatenate([part.reshape(len(part), -1) for part in (velocities[:, :1], offsets, velocities[:, 1:])], 1)


def course_key(places: np.ndarray, yaw: np.ndarray) -> np.ndarray:
    """The part of a key that the way over the next 0.5 s determines.

    Args:
        places: Horizontal places of the root at 16 moments, ``(n, 16, 2)`` metres.
        yaw: Its headings, ``(n, 16)`` radians.

    Returns:
        Blocks `mean_velocity`, `displacement` and `turn`, ``(n, 5)``.
    """
    velocities = turned(np.diff(places, axis=1) * FRAME_RATE, -yaw[:, :-1])
    displacement = turned(places[:, -1] - places[:, 0], -yaw[:, 0])
    return np.concatenate([velocities.mean(1), displacement, wrapped(yaw[:, -1:] - yaw[:, :1])], 1)


def wished_course(
    velocity: np.ndarray, yaw: np.ndarray, goal: np.ndarray, face_goal: bool = True
) -> tuple[np.ndarray, np.ndarray]:
    """The way over the next 0.5 s on which heading and velocity approach a goal exponentially, the former at most at 2 rad/s.

    Who faces the goal goes where the heading points, the slower the more is left to be turned; a body that looks elsewhere
    first turns and then runs. Who is slower than the goal is asked for more than it (:data:`LEAD`), who is faster for less.

    Args:
        velocity: Horizontal velocity of the root, ``(n, 2)`` m/s.
        yaw: Heading, ``(n,)`` radians.
        goal: Wished velocity, ``(n, 2)`` m/s.
        face_goal: Turn to where the goal points; otherwise the heading stays. It stays too if the goal is to stand.

    Returns:
        Places from the origin ``(n, 16, 2)`` and headings ``(n, 16)``, for :func:`course_key`.
    """
    time = np.arange(CLIP_FRAMES + 1) / FRAME_RATE
    left = 2.0 ** (-time / VELOCITY_HALF_LIFE)
    speed, direction = np.linalg.norm(goal, axis=1), np.arctan2(goal[:, 1], goal[:, 0])
    along = (velocity * goal).sum(1) / np.maximum(speed, 1e-6)
    asked = speed + LEAD * (speed - np.clip(along, 0.0, 2 * speed))
    turns = (speed > 1e-6) & face_goal
    turn = wrapped(direction - yaw) * turns
    most = FASTEST_TURN * time
    headings = yaw[:, None] + np.clip(turn[:, None] * (1 - left), -most, most)
    # Who has to turn far first turns: a body does not run where it does not look.
    ahead = np.maximum(np.cos(direction[:, None] - headings), 0.0)
    wished = np.where(
        turns[:, None, None],
        (asked[:, None] * ahead)[..., None] * np.stack([np.cos(headings), np.sin(headings)], -1),
        (goal * (asked / np.maximum(speed, 1e-6))[:, None])[:, None],
    )
    kept = left[1]
    velocities = [velocity]
    for frame in range(CLIP_FRAMES):
        velocities.append(wished[:, frame + 1] + kept * (velocities[-1] - wished[:, frame + 1]))
    path = np.stack(velocities, 1)
    steps = (path[:, 1:] + path[:, :-1]) / (2 * FRAME_RATE)
    places = np.concatenate([np.zeros((len(goal), 1, 2)), np.cumsum(steps, axis=1)], axis=1)
    return places, headings
