"""Batched physics of humanoids: N simulations on MuJoCo's native thread pool."""

import copy
import os
from pathlib import Path

import mujoco
import numpy as np
from mujoco.batch import Batch

from anyskill_envs.objects.scene import Scene
from anyskill_envs.observation import observe
from motion_data.skeleton import HEAD_CENTRE, JOINT_NAMES, body_index, load_model

PHYSICS_STEPS = 4
"""Physics steps (1/120 s) per controller step (1/30 s)."""
CONTROLLER_STEPS = 5
"""Controller steps per high-level decision (1/6 s)."""

MAX_SPEED = 500.0
"""m/s and rad/s, far beyond what a body does: a faster simulation has blown up, though MuJoCo says nothing yet."""

_BAD_STATE = [
    mujoco.mjtWarning.mjWARN_BADQPOS.value,
    mujoco.mjtWarning.mjWARN_BADQVEL.value,
    mujoco.mjtWarning.mjWARN_BADQACC.value,
]
_VELOCITY_STAGE = mujoco.mjtStage.mjSTAGE_VEL.value
_NO_CONTACTS = mujoco.mjtDisableBit.mjDSBL_CONTACT.value | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT.value
_HEAD = body_index("head")


def _components(vectors: np.ndarray) -> np.ndarray:
    """A copy of vectors ``(..., 3)``, components first: ``(3, ...)``."""
    return np.array(np.moveaxis(vectors, -1, 0), order="C")


class HumanoidSimulation:
    """N humanoids, each in a world of its own, stepped together.

    Results do not depend on the number of threads or on the other humanoids, bit for bit.

    Args:
        num_humanoids: How many.
        num_threads: Native threads; 0 for one per CPU (never more than humanoids).
        xml: MJCF file; its first body must be our humanoid. The project's own if None.
        scene: Objects beside each humanoid, instead of a file; none if None.

    Attributes:
        scene: The objects.
        model: The MuJoCo model (read-only).
        qpos: Live positions ``(n, nq)``; after writing, call :meth:`refresh`.
        qvel: Live velocities ``(n, nv)``; after writing, call :meth:`refresh`.

    Raises:
        FileNotFoundError: If the MJCF does not exist.
        ValueError: If a number is out of range, the MJCF has other joints, or there is both a file and a scene.
    """

    def __init__(
        self, num_humanoids: int, num_threads: int = 0, xml: str | Path | None = None, scene: Scene | None = None
    ):
        if num_humanoids < 1:
            raise ValueError(f"num_humanoids must be at least 1, got {num_humanoids}.")
        if num_threads < 0:
            raise ValueError(f"num_threads must be 0 (one per CPU) or more, got {num_threads}.")
        if xml is not None and scene is not None:
            raise ValueError("A simulation is of an MJCF file or of a scene, not of both: leave one out.")
        self.scene = Scene() if scene is None else scene
        self.model = self.scene.model if xml is None else load_model(xml)
        actuated = tuple(self.model.actuator(index).name for index in range(self.model.nu))
        if actuated != JOINT_NAMES:
            raise ValueError(
                f"'{xml}' has the actuators {actuated}; a body for this controller needs the {len(JOINT_NAMES)} position "
                f"actuators {JOINT_NAMES} in this order."
            )
        cpus = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
        threads = min(num_threads or cpus, num_humanoids)
        self._batch = Batch(self.model, num_humanoids, threads)
        # A physics step leaves positions and velocities of bodies one substep behind. A second batch brings them up to
        # date: it looks for no contacts, which costs half of what the same would cost in the first.
        bare = copy.copy(self.model)
        bare.opt.disableflags |= _NO_CONTACTS
        self._kinematics = Batch(bare, num_humanoids, threads)
        self.qpos = self._batch.bind("qpos")
        self.qvel = self._batch.bind("qvel")
        self._controls = self._batch.bind("ctrl")
        self._warmstart = self._batch.bind("qacc_warmstart")
        self._external = self._batch.bind("xfrc_applied")
        self._anchor_positions = self._batch.bind("mocap_pos")
        self._anchor_quaternions = self._batch.bind("mocap_quat")
        bodies = slice(1, 1 + 15)
        self.world_positions = self._kinematics.bind("xpos")
        """World positions of everything in the model, ``(n, bodies, 3)``: world, humanoid, objects; read-only view."""
        self.world_quaternions = self._kinematics.bind("xquat")
        """World orientations of the same, w first, ``(n, bodies, 4)``, read-only view."""
        self.body_positions = self.world_positions[:, bodies]
        """World positions of the humanoid's bodies, ``(n, 15, 3)``, read-only view."""
        self.body_quaternions = self.world_quaternions[:, bodies]
        """World orientations of the humanoid's bodies, w first, ``(n, 15, 4)``, read-only view."""
        # MuJoCo's spatial velocity: angular first, linear at the centre of mass of the kinematic tree.
        self._world_spatial = self._kinematics.bind("cvel")
        self._spatial = self._world_spatial[:, bodies]
        self._tree_centre = self._kinematics.bind("subtree_com")[:, 1]
        self._rest = self.model.qpos0 if xml is not None else self.scene.rest_pose
        self._batch.reset(stage=mujoco.mjtStage.mjSTAGE_NONE.value)
        self.refresh()
        self._warnings = self._bad_states()

    def __len__(self) -> int:
        """Number of humanoids."""
        return self._batch.nsim

    @property
    def batch(self) -> Batch:
        """The native batch of the physics. Fields that it derives from the state are one substep behind it, as in MuJoCo."""
        return self._batch

    @property
    def pose_size(self) -> int:
        """Numbers of a pose: `qpos`, then position and quaternion of each object that stands fixed."""
        return len(self._rest)

    @property
    def poses(self) -> np.ndarray:
        """All that is needed to draw the simulations, ``(n, pose_size)``; see :class:`anyskill_envs.objects.scene.Scene`.

        Without fixed objects it is `qpos` itself.
        """
        if not self.model.nmocap:
            return self.qpos
        anchors = np.concatenate([self._anchor_positions, self._anchor_quaternions], axis=2)
        return np.concatenate([self.qpos, anchors.reshape(len(self), -1)], axis=1)

    def angular_velocities(self, body: int) -> np.ndarray:
        """World angular velocities of one body of the model, ``(n, 3)`` rad/s."""
        return self._world_spatial[:, body, :3]

    @property
    def body_angular_velocities(self) -> np.ndarray:
        """World angular velocities of the bodies, ``(n, 15, 3)`` rad/s."""
        return self._spatial[..., :3]

    @property
    def body_linear_velocities(self) -> np.ndarray:
        """World velocities of the bodies' origins, ``(n, 15, 3)`` m/s."""
        x, y, z = _components(self.body_positions - self._tree_centre[:, None])
        wx, wy, wz = _components(self._spatial[..., :3])
        velocity = _components(self._spatial[..., 3:])
        # v_origin = v_centre + w x (origin - centre), written out: np.cross is slower
        velocity[0] += wy * z - wz * y
        velocity[1] += wz * x - wx * z
        velocity[2] += wx * y - wy * x
        return np.moveaxis(velocity, 0, -1)

    @property
    def head_height(self) -> np.ndarray:
        """Height of the centre of the head, ``(n,)`` metres."""
        w, x, y, z = np.moveaxis(self.body_quaternions[:, _HEAD], -1, 0)
        forward, _, up = HEAD_CENTRE
        lift = forward * 2 * (x * z - w * y) + up * (1 - 2 * (x * x + y * y))
        return self.body_positions[:, _HEAD, 2] + lift

    def observation(self) -> np.ndarray:
        """Observations of all humanoids, float32 ``(n, 223)``."""
        return observe(
            self.body_positions, self.body_quaternions, self.body_linear_velocities, self.body_angular_velocities
        )

    def reset(self, ids: np.ndarray, qpos: np.ndarray | None = None, qvel: np.ndarray | None = None) -> None:
        """Puts some humanoids into given states.

        Args:
            ids: Indices of the humanoids, ``(k,)``.
            qpos: Poses ``(k, pose_size)``; the rest pose if None.
            qvel: Velocities ``(k, nv)``; zero if None.
        """
        ids = np.asarray(ids)
        if not len(ids):
            return
        poses = np.broadcast_to(self._rest if qpos is None else qpos, (len(ids), self.pose_size))
        self.qpos[ids] = poses[:, : self.model.nq]
        anchors = poses[:, self.model.nq :].reshape(len(ids), -1, 7)
        self._anchor_positions[ids], self._anchor_quaternions[ids] = anchors[..., :3], anchors[..., 3:]
        self.qvel[ids] = 0 if qvel is None else qvel
        self._controls[ids] = self.qpos[ids, 7 : 7 + len(JOINT_NAMES)]
        self._warmstart[ids] = 0
        self._external[ids] = 0
        self.refresh(ids)

    def refresh(self, ids: np.ndarray | None = None) -> None:
        """Recomputes positions and velocities of bodies from the state, as after a write to ``qpos`` or ``qvel``."""
        if ids is None:
            self._kinematics.state[:] = self._batch.state
        else:
            ids = np.asarray(ids, np.int32)
            self._kinematics.state[ids] = self._batch.state[ids]
        self._kinematics.forward(ids, stage=_VELOCITY_STAGE)

    def push(self, body: str, forces: np.ndarray) -> None:
        """Sets a constant external force on one body until it is set again.

        Args:
            body: Name of the body.
            forces: Forces in the world frame, ``(n, 3)`` newtons.
        """
        self._external[:, 1 + body_index(body), :3] = forces

    def step(self, targets: np.ndarray, active: np.ndarray | None = None) -> np.ndarray:
        """Advances by one controller step (1/30 s).

        Args:
            targets: PD targets, ``(n, 28)`` radians.
            active: Humanoids to advance, ``(n,)`` bool; the others keep their state. All if None.

        Returns:
            Humanoids whose simulation diverged, ``(n,)`` bool; they were put back into the rest pose, the others are
            untouched.
        """
        # MuJoCo refuses non-finite controls for the whole batch with a warning; a NaN here is a diverged humanoid.
        broken = ~np.isfinite(targets).all(1)
        self._controls[:] = np.where(broken[:, None], 0.0, targets)
        ids = None if active is None else np.flatnonzero(active).astype(np.int32)
        if ids is not None and not len(ids):
            return np.zeros(len(self), bool)
        self._batch.step(ids, nstep=PHYSICS_STEPS)
        self.refresh(ids)
        warnings = self._bad_states()
        diverged = (warnings != self._warnings) | broken | ~(np.abs(self.qvel) < MAX_SPEED).all(1)
        self._warnings = warnings
        if diverged.any():
            self.reset(np.flatnonzero(diverged))
        return diverged

    def _bad_states(self) -> np.ndarray:
        """How often MuJoCo found a bad state, per humanoid, ``(n,)``."""
        return np.asarray(self._batch.warning)[:, _BAD_STATE, 1].sum(1)
