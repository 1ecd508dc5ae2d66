"""Did the humanoid do it with the object? Checks of text skills in scenes, from recorded poses alone.

As those of `agents.text.checks` they were written before any policy was trained, and training never sees them. They look
at the whole episode, because what is done to an object is done once. Contact is measured by geometry: a body touches an
object when their surfaces are less than 1 cm apart at a controller step (1/30 s).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property

import mujoco
import numpy as np
from numpy.typing import NDArray

from agents.text.checks import normalise_text
from anyskill_envs.objects.scene import Scene
from anyskill_envs.rendering import set_pose
from motion_data.skeleton import BODY_NAMES, FRAME_RATE

TOUCHING = 0.01
"""Metres between two surfaces that count as contact."""
KICK_DISTANCE, KICK_SECONDS = 1.0, 3.0
NEAR_BALL = 0.6
OPEN_ANGLE = np.radians(45.0)
SITTING_SECONDS = 1.0
UPRIGHT = 0.9
"""Vertical part of the z axis of a chair that stands."""

FEET = ("left_foot", "right_foot")
HANDS = ("left_hand", "right_hand")


class SceneTrajectory:
    """What the humanoid and the objects of a scene did in one episode.

    Args:
        scene: The scene.
        poses: Its poses, `(T, pose_size)`.
        rate: Poses per second.

    Raises:
        ValueError: The poses are none of this scene, or not finite.
    """

    def __init__(self, scene: Scene, poses: NDArray[np.float64], rate: float = FRAME_RATE) -> None:
        if poses.ndim != 2 or not len(poses) or poses.shape[1] != scene.pose_size or not np.isfinite(poses).all():
            raise ValueError(
                f"A trajectory of this scene needs finite poses (T, {scene.pose_size}) of at least one frame, got "
                f"{poses.shape}."
            )
        self.scene = scene
        self.poses = poses
        self.rate = rate

    def position(self, name: str) -> NDArray[np.float64]:
        """Positions of an object, `(T, 3)`."""
        return self.poses[:, self.scene.parts[name].pose][:, :3]

    def uprightness(self, name: str) -> NDArray[np.float64]:
        """Vertical part of an object's z axis, `(T,)`: 1 upright, 0 lying."""
        _, x, y, _ = self.poses[:, self.scene.parts[name].pose][:, 3:].T
        return 1 - 2 * (x * x + y * y)

    def angle(self, name: str) -> NDArray[np.float64]:
        """Angles of an object's first joint, `(T,)` radians."""
        return self.poses[:, self.scene.parts[name].angles[0]]

    def distance(self, name: str) -> NDArray[np.float64]:
        """Horizontal distances between pelvis and object, `(T,)` metres."""
        return np.hypot(*(self.position(name) - self.poses[:, :3])[:, :2].T)

    def touches(self, bodies: Sequence[str], name: str, geoms: Sequence[str] = ()) -> NDArray[np.bool_]:
        """When one of some bodies of the humanoid touches an object, `(T,)`.

        Args:
            bodies: Names of bodies.
            name: The object.
            geoms: Names of the object's geoms that count; all that collide if empty.
        """
        model = self.scene.model
        own = [
            geom
            for geom in range(model.ngeom)
            if model.geom_conaffinity[geom] and model.body(model.geom_bodyid[geom]).name in bodies
        ]
        others = [
            geom
            for geom in range(model.ngeom)
            if model.geom_contype[geom]
            and model.body_rootid[model.geom_bodyid[geom]] == self.scene.parts[name].body
            and (not geoms or model.geom(geom).name.removeprefix(f"{name}/") in geoms)
        ]
        touching = np.zeros(len(self.poses), bool)
        data = self._data
        for frame, pose in enumerate(self.poses):
            set_pose(model, data, pose)
            touching[frame] = any(
                mujoco.mj_geomDistance(model, data, first, second, TOUCHING, None) < TOUCHING
                for first in own
                for second in others
            )
        return touching

    @cached_property
    def _data(self) -> mujoco.MjData:
        return mujoco.MjData(self.scene.model)


SceneCheck = Callable[[SceneTrajectory, str], bool]
"""A trajectory and the name of the object to whether it was done."""


def kicks_ball(trajectory: SceneTrajectory, ball: str) -> bool:
    """A foot touches the ball, and within 3 s the ball is 1 m or more from where it was touched."""
    path = trajectory.position(ball)[:, :2]
    later = round(KICK_SECONDS * trajectory.rate) + 1
    touched = np.flatnonzero(trajectory.touches(FEET, ball))
    return any(np.hypot(*(path[t : t + later] - path[t]).T).max() >= KICK_DISTANCE for t in touched)


def walks_to_ball(trajectory: SceneTrajectory, ball: str) -> bool:
    """The pelvis comes within 0.6 m of the ball, horizontally."""
    return bool((trajectory.distance(ball) <= NEAR_BALL).any())


def opens_door(trajectory: SceneTrajectory, door: str) -> bool:
    """The door stands open by more than 45 degrees after a body of the humanoid touched its leaf."""
    is_open = trajectory.angle(door) > OPEN_ANGLE
    if not is_open.any():
        return False
    touched = trajectory.touches(BODY_NAMES, door, ("leaf", "handle"))
    return bool(touched[: int(np.argmax(is_open)) + 1].any())


def kicks_door(trajectory: SceneTrajectory, door: str) -> bool:
    """A foot touches the leaf of the door."""
    return bool(trajectory.touches(FEET, door, ("leaf",)).any())


def strikes_pillar(trajectory: SceneTrajectory, pillar: str) -> bool:
    """A hand or a foot touches the pillar."""
    return bool(trajectory.touches(FEET + HANDS, pillar).any())


def sits_on_chair(trajectory: SceneTrajectory, chair: str) -> bool:
    """The pelvis is on the seat of the standing chair for 1 s without a break."""
    on_seat = trajectory.touches(("pelvis",), chair, ("seat",))
    on_seat &= trajectory.poses[:, 2] > trajectory.position(chair)[:, 2]
    on_seat &= trajectory.uprightness(chair) > UPRIGHT
    needed = round(SITTING_SECONDS * trajectory.rate)
    counts = np.convolve(on_seat, np.ones(needed, int), mode="valid") if len(on_seat) >= needed else np.zeros(1)
    return bool((counts >= needed).any())


OBJECT_CHECKS: dict[str, tuple[str, SceneCheck]] = {
    "kick the ball": ("ball", kicks_ball),
    "walk to the ball": ("ball", walks_to_ball),
    "open the door": ("door", opens_door),
    "kick the door": ("door", kicks_door),
    "strike the pillar": ("pillar", strikes_pillar),
    "sit on the chair": ("chair", sits_on_chair),
}
"""Normalised text, the kind of object that it is about, and its check."""


def find_object_check(text: str, scene: Scene) -> Callable[[NDArray[np.float64]], bool] | None:
    """The check for a text in a scene, of poses `(T, pose_size)`.

    Args:
        text: The text.
        scene: The scene; the first object of the kind that the text is about counts.

    Returns:
        The check; None if the text has none, or the scene has no such object.
    """
    kind, check = OBJECT_CHECKS.get(normalise_text(text), ("", None))
    name = next((name for name, part in scene.parts.items() if part.item.kind == kind), None)
    if check is None or name is None:
        return None

    def judged(poses: NDArray[np.float64]) -> bool:
        return check(SceneTrajectory(scene, poses), name)

    judged.__doc__ = check.__doc__
    return judged
