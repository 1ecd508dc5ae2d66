"""The humanoid's skeleton: names, limits, forward kinematics and mirroring, read from its MJCF.

Conventions of the whole project: metres, seconds, radians; z up, x forward, y left; quaternions w first. A pose is
``qpos`` of 35 numbers: root position (3), root quaternion (4), hinge angles (28).
"""

from functools import cache
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np

HUMANOID_XML = Path(__file__).parent / "assets" / "humanoid.xml"
"""Path of the humanoid's MJCF."""

QPOS_SIZE, QVEL_SIZE = 35, 34
"""Numbers of the humanoid's pose, and of its velocity."""
FRAME_RATE = 30.0
"""Controller steps per second; clips are resampled to it."""

HEAD_CENTRE = (0.01, 0.0, 0.165)
"""Centre of the head in the frame of the head body, whose origin is the neck joint."""


@cache
def load_model(xml: str | Path = HUMANOID_XML) -> mujoco.MjModel:
    """Compiles an MJCF file.

    Args:
        xml: Path of the file.

    Returns:
        The model; the same object for the same path, so treat it as read-only.

    Raises:
        FileNotFoundError: If the file does not exist.
        ValueError: If MuJoCo cannot compile it; the message is MuJoCo's.
    """
    path = Path(xml)
    if not path.is_file():
        raise FileNotFoundError(f"No MJCF file at '{path}'. Pass the path of an existing MJCF file.")
    return mujoco.MjModel.from_xml_path(str(path))


def _names(model: mujoco.MjModel, kind: int, count: int, first: int) -> tuple[str, ...]:
    return tuple(mujoco.mj_id2name(model, kind, index) for index in range(first, count))


_MODEL = load_model()
BODY_NAMES = _names(_MODEL, mujoco.mjtObj.mjOBJ_BODY.value, _MODEL.nbody, 1)
"""The 15 bodies, in the order of every array of bodies."""
JOINT_NAMES = _names(_MODEL, mujoco.mjtObj.mjOBJ_JOINT.value, _MODEL.njnt, 1)
"""The 28 hinges, in the order of ``qpos[7:]``, of controls and of PD targets."""


def body_index(name: str) -> int:
    """Position of a body in arrays of shape ``(..., 15, ...)``.

    Raises:
        ValueError: If there is no such body; the message lists them.
    """
    if name not in BODY_NAMES:
        raise ValueError(f"Unknown body '{name}'. The bodies are: {', '.join(BODY_NAMES)}.")
    return BODY_NAMES.index(name)


def joint_index(name: str) -> int:
    """Position of a hinge in arrays of shape ``(..., 28)``.

    Raises:
        ValueError: If there is no such hinge; the message lists them.
    """
    if name not in JOINT_NAMES:
        raise ValueError(f"Unknown joint '{name}'. The joints are: {', '.join(JOINT_NAMES)}.")
    return JOINT_NAMES.index(name)


def joint_limits() -> np.ndarray:
    """Lower and upper limit of each hinge in radians, ``(28, 2)``."""
    return load_model().jnt_range[1:].copy()


def rest_qpos() -> np.ndarray:
    """The rest pose, ``(35,)``: standing at the origin, facing x, arms down."""
    return load_model().qpos0.copy()


class Kinematics(NamedTuple):
    """Poses of all bodies over T frames, in the world frame."""

    positions: np.ndarray
    """Origins of the bodies, ``(T, 15, 3)``."""
    quaternions: np.ndarray
    """Orientations of the bodies, ``(T, 15, 4)``."""
    clearance: np.ndarray
    """Height of the lowest point of each body, as far as it can touch the floor, ``(T, 15)``."""

    @property
    def lowest(self) -> np.ndarray:
        """Height of the lowest point of the humanoid, ``(T,)``."""
        return self.clearance.min(1)


def kinematics(qpos: np.ndarray) -> Kinematics:
    """Forward kinematics of a sequence of poses.

    Args:
        qpos: Poses, ``(T, 35)``.

    Returns:
        Body positions, orientations and the lowest point of each frame.
    """
    model = load_model()
    data = mujoco.MjData(model)
    qpos = np.atleast_2d(qpos)
    frames = len(qpos)
    positions = np.empty((frames, model.nbody - 1, 3))
    quaternions = np.empty((frames, model.nbody - 1, 4))
    geom_positions = np.empty((frames, model.ngeom, 3))
    geom_z_axes = np.empty((frames, model.ngeom, 3))
    for frame in range(frames):
        data.qpos[:] = qpos[frame]
        mujoco.mj_kinematics(model, data)
        positions[frame] = data.xpos[1:]
        quaternions[frame] = data.xquat[1:]
        geom_positions[frame] = data.geom_xpos
        geom_z_axes[frame] = data.geom_xmat[:, 6:9]
    return Kinematics(positions, quaternions, _clearance(model, geom_positions, geom_z_axes))


def _clearance(model: mujoco.MjModel, positions: np.ndarray, z_axes: np.ndarray) -> np.ndarray:
    """Lowest points of floor-touching geoms by body; ``z_axes`` is the world z row of each geom's rotation matrix."""
    touching = np.flatnonzero((model.geom_bodyid > 0) & (model.geom_conaffinity > 0))
    size, kind = model.geom_size[touching], model.geom_type[touching]
    slope = np.abs(z_axes[:, touching])
    sphere = size[:, 0] + 0 * slope[..., 0]
    capsule = size[:, 0] + slope[..., 2] * size[:, 1]
    box = (slope * size).sum(-1)
    reach = np.select(
        [kind == mujoco.mjtGeom.mjGEOM_SPHERE, kind == mujoco.mjtGeom.mjGEOM_CAPSULE], [sphere, capsule], box
    )
    lowest = np.full((len(positions), model.nbody - 1), np.inf)
    np.minimum.at(lowest.T, model.geom_bodyid[touching] - 1, (positions[:, touching, 2] - reach).T)
    return lowest


def forward_kinematics(qpos: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """World positions ``(T, 15, 3)`` and quaternions ``(T, 15, 4)`` of the bodies for poses ``(T, 35)``."""
    result = kinematics(qpos)
    return result.positions, result.quaternions


def lowest_point(qpos: np.ndarray) -> np.ndarray:
    """Height of the lowest point of the humanoid in each of the poses ``(T, 35)``, ``(T,)``."""
    return kinematics(qpos).lowest


def differentiate(qpos: np.ndarray, rate: float = FRAME_RATE) -> np.ndarray:
    """Velocities of a sequence of poses by central differences, one-sided at the ends.

    Args:
        qpos: Poses, ``(T, 35)``.
        rate: Frames per second.

    Returns:
        Velocities as MuJoCo's ``qvel``, ``(T, 34)``: root linear velocity in the world frame, root angular velocity in
        the root's own frame, hinge velocities.
    """
    model = load_model()
    forward = np.zeros((len(qpos) - 1, model.nv))
    for frame in range(len(qpos) - 1):
        mujoco.mj_differentiatePos(model, forward[frame], 1 / rate, qpos[frame], qpos[frame + 1])
    velocity = np.empty((len(qpos), model.nv))
    velocity[0], velocity[-1] = forward[0], forward[-1]
    velocity[1:-1] = 0.5 * (forward[1:] + forward[:-1])
    return velocity


def heading(quaternion: np.ndarray) -> np.ndarray:
    """Angle about the vertical axis, radians: the twist of the swing-twist decomposition.

    Upright it is where the x axis points, as in AMP, ASE and CALM. But that is undefined where the x axis is vertical,
    and flips by half a turn nearby: in every moment of crawling, lying and getting up. The twist is undefined only
    upside-down.

    Args:
        quaternion: Orientations, w first, ``(..., 4)``.

    Returns:
        Angles in ``[-pi, pi)``, ``(...)``.
    """
    quaternion = np.asarray(quaternion)
    angle = 2 * np.arctan2(quaternion[..., 3], quaternion[..., 0])
    return (angle + np.pi) % (2 * np.pi) - np.pi


def _swap_side(name: str) -> str:
    if name.startswith("right_"):
        return "left_" + name.removeprefix("right_")
    if name.startswith("left_"):
        return "right_" + name.removeprefix("left_")
    return name


MIRROR_BODIES = np.array([BODY_NAMES.index(_swap_side(name)) for name in BODY_NAMES])
"""Index of each body's partner on the other side."""
MIRROR_JOINTS = np.array([JOINT_NAMES.index(_swap_side(name)) for name in JOINT_NAMES])
"""Index of each hinge's partner on the other side."""
# Reflection in the x-z plane keeps rotations about y and reverses those about x and z; elbows and knees turn about y.
MIRROR_JOINT_SIGNS = np.array([-1.0 if name.endswith(("_x", "_z")) else 1.0 for name in JOINT_NAMES])
"""Sign of each hinge angle under reflection in the x-z plane."""


def mirror_qpos(qpos: np.ndarray) -> np.ndarray:
    """Reflects poses ``(..., 35)`` in the x-z plane (left becomes right)."""
    mirrored = np.array(qpos, copy=True)
    mirrored[..., 1] *= -1
    mirrored[..., 4] *= -1
    mirrored[..., 6] *= -1
    mirrored[..., 7:] = qpos[..., 7:][..., MIRROR_JOINTS] * MIRROR_JOINT_SIGNS
    return mirrored
