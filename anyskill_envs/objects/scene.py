"""A humanoid and objects in one MuJoCo model: composed from their MJCF, placed by chance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from anyskill_envs.objects import load_object
from anyskill_envs.objects.base import Placement, SceneObject
from motion_data.skeleton import HUMANOID_XML, QPOS_SIZE, QVEL_SIZE, heading, load_model
from rewards.object_state import BLOCKS

FloatArray = NDArray[np.float64]

_TRIES = 1000
"""How often the places of a scene are drawn anew where one object would stand in another."""


@dataclass(frozen=True)
class Part:
    """Where one object of a scene stands in the arrays of its model.

    Attributes:
        item: the object.
        name: its name in the scene: the object's own, with a number from the second of that name on.
        body: index of its root body in the model.
        qpos: place of the pose of a free object in `qpos`, else None.
        qvel: place of the velocity of a free object in `qvel`, else None.
        pose: place of its position and quaternion in the poses of the scene.
        angles: indices of its hinges and slides in `qpos`.
        angle_velocities: indices of its hinges and slides in `qvel`.
    """

    item: SceneObject
    name: str
    body: int
    qpos: slice | None
    qvel: slice | None
    pose: slice
    angles: tuple[int, ...]
    angle_velocities: tuple[int, ...]

    @property
    def state_size(self) -> int:
        """Numbers of its :class:`rewards.object_state.ObjectState`, 15 and two for each joint."""
        return sum(BLOCKS.values()) + 2 * len(self.angles)

    @property
    def observed(self) -> tuple[str, ...]:
        """Blocks of its state that a policy observes."""
        if self.item.observed is not None:
            return self.item.observed
        base = ("position", "facing") if self.qpos is None else tuple(BLOCKS)
        return (*base, "angle", "angle_velocity") if self.angles else base


class Scene:
    """The humanoid and any number of objects, each object once or several times.

    In the model the humanoid comes first: the first 35 numbers of `qpos`, 34 of `qvel` and 15 bodies are those of the
    humanoid alone, so that everything made for it, the low-level controller above all, finds it unchanged. Names of an
    object's bodies, geoms and joints have the object's name before them: "ball/ball".

    A pose of the scene is `qpos`, followed by position and quaternion of each fixed object (7 numbers): all that is needed
    to draw it. Without fixed objects it is `qpos`.

    Args:
        objects: names of registered objects, or objects.

    Attributes:
        parts: the objects by their name in the scene, in their order.

    Raises:
        ValueError: an unknown name, or an MJCF that does not fit; the message says which and why.
    """

    def __init__(self, objects: Sequence[str | SceneObject] = ()) -> None:
        if isinstance(objects, str):
            raise ValueError(f"objects must be a list of names, such as [{objects!r}].")
        items = _named([load_object(item) for item in objects])
        self.model = _compiled(items) if items else load_model()
        self.parts = self._parts(items)

    @classmethod
    def of(cls, objects: Scene | Sequence[str | SceneObject]) -> Scene:
        """The scene itself, or one with these objects."""
        return objects if isinstance(objects, Scene) else cls(objects)

    def __bool__(self) -> bool:
        """Whether there is an object."""
        return bool(self.parts)

    @property
    def pose_size(self) -> int:
        """Numbers of a pose."""
        return int(self.model.nq + 7 * self.model.nmocap)

    @property
    def state_size(self) -> int:
        """Numbers of the states of all objects, one after the other."""
        return sum(part.state_size for part in self.parts.values())

    @cached_property
    def rest_pose(self) -> FloatArray:
        """The humanoid standing at the origin, each object in the middle of its ranges."""
        pose = self._unplaced(self.model.qpos0[None, :QPOS_SIZE])
        for part in self.parts.values():
            middle = [np.full(1, 0.5 * (low + high)) for low, high in part.item.placement.ranges]
            pose[:, part.pose] = self._at(part, pose[:, :QPOS_SIZE], *middle)
        return pose[0]

    def placements(
        self, changes: Mapping[str, Mapping[str, Any]] | None, base: Mapping[str, Placement] | None = None
    ) -> dict[str, Placement]:
        """The placement of each object, with some of their ranges replaced.

        Args:
            changes: ranges by name of the object, such as ``{"ball": {"distance": (1.0, 3.0), "bearing": 0.0}}``.
            base: the placements to begin with; the objects' own if None.

        Raises:
            ValueError: no object has this name, there is no such range, or a bad value.
        """
        changes = changes or {}
        unknown = sorted(set(changes) - set(self.parts))
        if unknown:
            names = ", ".join(self.parts) or "none"
            raise ValueError(f"There is no {unknown[0]!r} in the scene to be placed; its objects are: {names}.")
        base = base or {name: part.item.placement for name, part in self.parts.items()}
        return {name: base[name].changed(changes.get(name, {})) for name in self.parts}

    def place(
        self,
        qpos: FloatArray,
        qvel: FloatArray,
        placements: Mapping[str, Placement],
        noise: float,
        rng: np.random.Generator,
    ) -> tuple[FloatArray, FloatArray]:
        """Put the objects around humanoids, none into another.

        Args:
            qpos: the humanoids, ``(k, 35)``.
            qvel: their velocities, ``(k, 34)``.
            placements: where each object may stand.
            noise: half-width of the uniform noise on the velocities of the objects, m/s and rad/s.
            rng: where the randomness comes from.

        Returns:
            Poses ``(k, pose_size)`` and velocities ``(k, nv)`` of the scenes.

        Raises:
            ValueError: in these ranges the objects find no room beside each other.
        """
        count = len(qpos)
        poses = self._unplaced(qpos)
        velocities = np.zeros((count, self.model.nv))
        velocities[:, :QVEL_SIZE] = qvel
        velocities[:, QVEL_SIZE:] = rng.uniform(-noise, noise, (count, self.model.nv - QVEL_SIZE))
        rows = np.arange(count)
        for _ in range(_TRIES):
            taken = np.zeros(len(rows), bool)
            for index, (name, part) in enumerate(self.parts.items()):
                drawn = [rng.uniform(low, high, len(rows)) for low, high in placements[name].ranges]
                poses[rows, part.pose] = self._at(part, qpos[rows], *drawn)
                taken |= self._taken(poses[rows], part, list(self.parts.values())[:index])
            rows = rows[taken]
            if not len(rows):
                return poses, velocities
        raise ValueError(
            f"{', '.join(self.parts)} find no room beside each other in their ranges: place them further apart."
        )

    def _unplaced(self, qpos: FloatArray) -> FloatArray:
        """Poses of humanoids with the objects as the model has them."""
        poses = np.empty((len(qpos), self.pose_size))
        poses[:, : self.model.nq] = self.model.qpos0
        poses[:, :QPOS_SIZE] = qpos
        return poses

    def _at(
        self, part: Part, qpos: FloatArray, distance: FloatArray, bearing: FloatArray, yaw: FloatArray
    ) -> FloatArray:
        """Positions and quaternions ``(k, 7)`` of an object around humanoids ``(k, 35)``."""
        direction = heading(qpos[:, 3:7]) + bearing
        placed = np.empty((len(qpos), 7))
        placed[:, 0] = qpos[:, 0] + distance * np.cos(direction)
        placed[:, 1] = qpos[:, 1] + distance * np.sin(direction)
        placed[:, 2] = self.model.body_pos[part.body, 2]
        half = 0.5 * (direction + np.pi + yaw)  # at yaw 0 the object looks at the humanoid
        w, x, y, z = self.model.body_quat[part.body]
        cosine, sine = np.cos(half), np.sin(half)
        turned = (cosine * w - sine * z, cosine * x - sine * y, cosine * y + sine * x, cosine * z + sine * w)
        placed[:, 3:] = np.stack(turned, axis=-1)
        return placed

    @staticmethod
    def _taken(poses: FloatArray, part: Part, others: Sequence[Part]) -> NDArray[np.bool_]:
        """Where an object stands in another, ``(k,)``."""
        taken = np.zeros(len(poses), bool)
        for other in others:
            apart = poses[:, part.pose][:, :2] - poses[:, other.pose][:, :2]
            taken |= np.hypot(*apart.T) < part.item.radius + other.item.radius
        return taken

    def _parts(self, items: Mapping[str, SceneObject]) -> dict[str, Part]:
        model = self.model
        parts = {}
        # Found by their place, for bodies need no names: the world is body 0, and the first that stands in it the humanoid.
        roots = [body for body in range(1, model.nbody) if model.body_parentid[body] == 0][1:]
        for root, (name, item) in zip(roots, items.items(), strict=True):
            joints = [index for index in range(model.njnt) if model.body_rootid[model.jnt_bodyid[index]] == root]
            mocap = int(model.body_mocapid[root])
            qpos = qvel = None
            if mocap < 0:
                first, dof = int(model.jnt_qposadr[joints[0]]), int(model.jnt_dofadr[joints[0]])
                qpos, qvel = slice(first, first + 7), slice(dof, dof + 6)
                joints = joints[1:]
            anchor = int(model.nq) + 7 * mocap
            parts[name] = Part(
                item=item,
                name=name,
                body=root,
                qpos=qpos,
                qvel=qvel,
                pose=qpos or slice(anchor, anchor + 7),
                angles=tuple(int(model.jnt_qposadr[joint]) for joint in joints),
                angle_velocities=tuple(int(model.jnt_dofadr[joint]) for joint in joints),
            )
        return parts


def _named(objects: Sequence[SceneObject]) -> dict[str, SceneObject]:
    """The objects by their names in the scene; one whose name is taken gets a number behind it."""
    names: dict[str, SceneObject] = {}
    for item in objects:
        name, count = item.name, 1
        while name in names:
            count += 1
            name = f"{item.name}_{count}"
        names[name] = item
    return names


def _compiled(items: Mapping[str, SceneObject]) -> mujoco.MjModel:
    """The humanoid's model with objects after it.

    Raises:
        ValueError: MuJoCo does not understand an object's MJCF, or it is not one body of its own.
    """
    scene = mujoco.MjSpec.from_file(str(HUMANOID_XML))
    for name, item in items.items():
        text = item.mjcf.strip()
        if not text.startswith("<mujoco"):
            text = f"<mujoco><worldbody>{text}</worldbody></mujoco>"
        try:
            fragment = mujoco.MjSpec.from_string(text)
        except ValueError as error:
            raise ValueError(f"MuJoCo does not understand the MJCF of the object {item.name!r}: {error}") from error
        roots = list(fragment.worldbody.bodies)
        if len(roots) != 1 or fragment.worldbody.geoms:
            raise ValueError(
                f"The MJCF of the object {item.name!r} must hold one body in its world and nothing else, not {len(roots)} "
                f"bodies and {len(fragment.worldbody.geoms)} geoms."
            )
        root = roots[0]
        kinds = [joint.type for joint in root.joints]
        if kinds not in ([], [mujoco.mjtJoint.mjJNT_FREE]):
            raise ValueError(
                f"The outermost body of the object {item.name!r} must have a freejoint, or no joint at all; put hinges and "
                "slides into a body inside it."
            )
        if fragment.actuators or any(joint.type == mujoco.mjtJoint.mjJNT_BALL for joint in fragment.joints):
            raise ValueError(f"The object {item.name!r} may have hinges and slides only, and no actuators.")
        root.mocap = not kinds  # a fixed body that each scene of a batch can put elsewhere
        scene.attach(fragment, prefix=f"{name}/", frame=scene.worldbody.add_frame())
    try:
        return scene.compile()
    except ValueError as error:
        raise ValueError(f"MuJoCo cannot put {', '.join(items)} into one scene: {error}") from error
