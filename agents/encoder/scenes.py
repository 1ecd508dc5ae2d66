"""Scenes with objects for the encoder: where objects are put, and their states as the state tower takes them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from agents.encoder.measurements import SIDES
from anyskill_envs.objects import Placement
from anyskill_envs.objects.scene import Scene
from motion_data.skeleton import body_index, differentiate, forward_kinematics, heading
from rewards.object_state import BLOCKS

# Latents of these clips bring about what captions speak of; half of all latents are drawn from them.
_FAVOURED = {
    "ball": ("kick", "walk", "run", "step_forward"),
    "chair": ("sit", "squat", "crouch", "step_backward", "kick"),
    "door": ("push", "walk", "kick", "step_forward"),
    "pillar": ("punch", "kick", "push", "walk", "uppercut"),
}
_WITH_SIDES = ("door",)
"""Objects whose mirror image is another object: the hinge of the door is on the left."""
ROLLING = ("ball",)
"""Objects that may roll when nobody touches them."""
_REACH = 0.45
"""Metres from the pelvis at which a step or an arm reaches an object."""
_KICKED = {"chair": 0.22, "door": 0.02, "pillar": 0.2}
"""Objects that stand where a raised foot reaches, some of the time: metres from the origin to the surface."""
_RAISED = 0.35
"""Height of a raised ankle in metres, and its least distance from the pelvis."""
_SEATED = (0.45, 0.64)
"""Heights of a pelvis, in metres, under which the seat of the chair may stand."""
_VECTORS = np.tile([1.0, -1.0, 1.0], 4)
_MIRRORED_BLOCKS = np.concatenate([_VECTORS, [-1.0, 1.0, -1.0]]).astype(np.float32)
"""Sign of each of the 15 numbers of a free object in the mirror: y of vectors, x and z of the angular velocity."""


class ObjectLayout:
    """Where the state of each known object stands in the second input of the state tower.

    For each object in order: whether it is there (1 or 0), and its state, zeros if it is not; see
    :class:`rewards.bundled.BundledEncoder`.

    Args:
        objects: names of registered objects.

    Attributes:
        names: these names.
        scenes: a scene for each of them, the object alone beside the humanoid.
        sizes: numbers of the state of each object.
    """

    def __init__(self, objects: Sequence[str]) -> None:
        self.names = tuple(objects)
        self.scenes = {name: Scene([name]) for name in self.names}
        self.sizes = {name: scene.state_size for name, scene in self.scenes.items()}
        self._starts = dict(
            zip(self.names, np.cumsum([0, *(1 + size for size in self.sizes.values())])[:-1], strict=True)
        )

    @property
    def size(self) -> int:
        """Numbers of the second input, 0 without objects."""
        return sum(1 + size for size in self.sizes.values())

    def fill(self, name: str, vectors: NDArray[np.float32]) -> NDArray[np.float32]:
        """The second input `(n, size)` of scenes with this object in these states `(n, m)`."""
        block = np.zeros((len(vectors), self.size), np.float32)
        start = self._starts[name]
        block[:, start] = 1.0
        block[:, start + 1 : start + 1 + vectors.shape[1]] = vectors
        return block

    def state(self, name: str, objects: NDArray[np.float32]) -> NDArray[np.float32]:
        """The states `(n, m)` of an object in second inputs `(n, size)`."""
        start = self._starts[name] + 1
        return objects[:, start : start + self.sizes[name]]

    def there(self, name: str, objects: NDArray[np.float32]) -> NDArray[np.bool_]:
        """Which second inputs `(n, size)` are of scenes with this object, `(n,)`."""
        present: NDArray[np.bool_] = objects[:, self._starts[name]] > 0
        return present

    @property
    def mirror_sign(self) -> NDArray[np.float32]:
        """Sign of each number in the mirror, `(size,)`; says nothing of objects that have sides."""
        sign = np.ones(self.size, np.float32)
        for start in self._starts.values():
            sign[start + 1 : start + 1 + sum(BLOCKS.values())] = _MIRRORED_BLOCKS
        return sign

    @property
    def sided(self) -> list[int]:
        """Columns that are 1 where an object stands that has no mirror image among the objects."""
        return [start for name, start in self._starts.items() if any(name.endswith(kind) for kind in _WITH_SIDES)]

    def has_mirror_image(self, objects: NDArray[np.float32]) -> NDArray[np.bool_]:
        """Which scenes `(n, size)` have a mirror image among scenes, `(n,)`."""
        return np.asarray((objects[:, self.sided] <= 0).all(1))


def favoured_clips(name: str) -> tuple[str, ...]:
    """Parts of names of clips that have to do with an object."""
    return _FAVOURED.get(name, ("walk", "step", "kick", "punch", "push"))


def training_placements(scene: Scene) -> list[dict[str, Placement]]:
    """Where the objects of a scene are put: as in an episode, within reach, and anywhere up to 3 m away."""
    own = scene.placements(None)
    first = {name: min(place.distance[0], _REACH) for name, place in own.items()}
    around = {"bearing": (-np.pi, np.pi), "yaw": (-np.pi, np.pi)}
    return [
        own,
        {name: place.changed({"distance": (first[name], first[name] + 0.25)}) for name, place in own.items()},
        {name: place.changed({"distance": (max(first[name], 0.6), 3.0), **around}) for name, place in own.items()},
    ]


def raised_foot(motion: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Where a raised foot is, the farther one of two.

    Args:
        motion: poses `(frames, 35)`.

    Returns:
        How far its ankle is from the pelvis, horizontally, in metres, 0 where none is raised; and its direction in radians
        from the heading; each `(frames,)`.
    """
    positions, _ = forward_kinematics(motion)
    feet = np.stack([positions[:, body_index(f"{side}_foot")] for side in SIDES], 1)
    offsets = (feet - positions[:, :1])[..., :2]
    reaches = np.where(feet[..., 2] > _RAISED, np.linalg.norm(offsets, axis=2), 0.0)
    rows, farther = np.arange(len(motion)), np.argmax(reaches, axis=1)
    across = offsets[rows, farther]
    direction = np.arctan2(across[:, 1], across[:, 0]) - heading(motion[:, 3:7])
    reach: NDArray[np.float64] = reaches[rows, farther]
    return reach, (direction + np.pi) % (2 * np.pi) - np.pi


def scenes_around(
    rng: np.random.Generator, motions: Sequence[NDArray[np.float64]], name: str, scene: Scene
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Motions with an object that rests somewhere beside them: what is said of it must not depend on the pose.

    The controller seldom stands in a T-pose, and never walks to an object on purpose; here any pose is near and far,
    and gaits go to the object, past it and away. Chairs stand under some bodies that sit.

    Args:
        rng: draws places.
        motions: motions of one length, each `(frames, 35)`.
        name: the object.
        scene: its scene.

    Returns:
        Poses `(frames, n, pose_size)` and velocities `(frames, n, nv)`.
    """
    own = scene.placements(None)
    around = {"bearing": (-np.pi, np.pi), "yaw": (-np.pi, np.pi)}
    ahead = {"bearing": (-0.7, 0.7), "yaw": (-0.5, 0.5)}
    least = own[name].distance[0] if name != "chair" else _REACH
    poses, velocities = [], []
    for motion in motions:
        frame = int(rng.integers(len(motion)))
        near_by = {"distance": (min(least, 0.6), 1.2), **(ahead if rng.random() < 0.5 else around)}
        far = {"distance": (1.0, 3.6), **(ahead if rng.random() < 0.6 else around)}
        change = near_by if rng.random() < 0.4 else far
        seated = np.flatnonzero((motion[:, 2] > _SEATED[0]) & (motion[:, 2] < _SEATED[1]))
        if name == "chair" and len(seated) and rng.random() < 0.7:
            frame = int(rng.choice(seated))
            change = {"distance": (0.0, 0.2), "bearing": (2.7, 3.6), "yaw": (-0.2, 0.2)}
        elif name in _KICKED and rng.random() < 0.6:
            reach, direction = raised_foot(motion)
            if reach.max() > _RAISED:
                frame = int(np.argmax(reach))
                nearest, bearing = reach[frame] + _KICKED[name] + 0.03, direction[frame]
                change = {
                    "distance": (nearest, nearest + 0.25),
                    "bearing": (bearing - 0.1, bearing + 0.1),
                    "yaw": (-0.3, 0.3),
                }
        place = {name: own[name].changed(change)}
        placed, _ = scene.place(motion[frame : frame + 1, :35], np.zeros((1, 34)), place, 0.0, rng)
        track = np.repeat(placed, len(motion), 0)
        track[:, :35] = motion
        poses.append(track)
        velocities.append(np.zeros((len(motion), scene.model.nv)))
        velocities[-1][:, :34] = differentiate(motion)
    return np.stack(poses, 1), np.stack(velocities, 1)
