"""What an action means: from the numbers of an agent to PD targets of the 28 hinges."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Protocol

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import ArrayLike, NDArray

from anyskill_envs.controller import LowLevelController
from anyskill_envs.simulation import CONTROLLER_STEPS
from motion_data.retrieval_keys import KEY_SIZE
from motion_data.skeleton import JOINT_NAMES, joint_limits

FloatArray = NDArray[np.float32]

IDLE_ANCHOR = "idle"
"""Name of the latent that a zero action stands for."""
MARGIN = 0.25
"""Radians by which joint targets may pass the limits of their hinge."""


class ActionDecoder(Protocol):
    """Turns a batch of actions into PD targets, closed loop, for a fixed number of controller steps."""

    @property
    def space(self) -> Box[Any]:
        """Action space of one humanoid."""
        ...

    @property
    def controller_steps(self) -> int:
        """Controller steps (1/30 s) for which an action is held."""
        ...

    def commands(self, actions: ArrayLike) -> FloatArray:
        """Check a batch of actions ``(n, ...)`` and bring it into the form that :meth:`targets` takes."""
        ...

    def targets(self, observation: FloatArray, commands: FloatArray) -> NDArray[np.floating]:
        """PD targets ``(n, 28)`` in radians for observations ``(n, 223)`` and commands."""
        ...

    def info(self, commands: FloatArray) -> dict[str, FloatArray]:
        """What `info` should say about the commands, each ``(n, ...)``."""
        ...


def checked_actions(actions: ArrayLike, size: int) -> FloatArray:
    """Actions as float32 ``(n, size)``, clipped to [-1, 1].

    Raises:
        ValueError: another shape, or a number that is not finite.
    """
    array = np.asarray(actions, dtype=np.float32)
    if array.ndim != 2 or array.shape[1] != size:
        raise ValueError(f"A batch of actions must have the shape (num_envs, {size}), got {array.shape}.")
    if not np.isfinite(array).all():
        raise ValueError("An action holds NaN or infinity; check the policy that produced it.")
    return np.clip(array, -1.0, 1.0)


class JointActions:
    """Actions are PD targets: 0 is the rest pose, -1 and 1 are the limits of the hinge widened by `MARGIN`.

    Targets reach past the limits because a PD controller needs an error to push. Each side has a scale of its own,
    since many ranges are lopsided (an elbow bends one way only) and zero should be standing.
    """

    controller_steps = 1

    def __init__(self) -> None:
        low, high = joint_limits().astype(np.float32).T
        self._down, self._up = MARGIN - low, high + MARGIN
        self.space: Box[Any] = Box(-1.0, 1.0, (len(JOINT_NAMES),), np.float32)

    def commands(self, actions: ArrayLike) -> FloatArray:
        """Targets in radians ``(n, 28)`` of actions ``(n, 28)``."""
        checked = checked_actions(actions, len(JOINT_NAMES))
        return checked * np.where(checked < 0, self._down, self._up)

    def targets(self, observation: FloatArray, commands: FloatArray) -> FloatArray:
        """The commands: they are targets already."""
        return commands

    def actions(self, targets: ArrayLike) -> FloatArray:
        """Actions ``(n, 28)`` that stand for PD targets ``(n, 28)`` in radians; the inverse of :meth:`commands`."""
        array = np.asarray(targets, np.float32)
        return np.clip(array / np.where(array < 0, self._down, self._up), -1.0, 1.0)

    def info(self, commands: FloatArray) -> dict[str, FloatArray]:
        """Nothing."""
        return {}


class LatentActions:
    """Actions are latents of the low-level controller, L2-normalised, and held for five controller steps.

    An action is clipped to [-1, 1] and projected onto the unit sphere. Zero has no direction: it stands for the
    controller's "idle" anchor, quiet standing, whatever was played before, so that the environment remembers nothing.

    Args:
        controller: the controller or the path of its ONNX file; the bundled one if None.
        num_threads: threads of the controller; 0 for one per CPU. Its output does not depend on it.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: the file is not a controller for this humanoid.
    """

    controller_steps = CONTROLLER_STEPS

    def __init__(self, controller: LowLevelController | str | Path | None = None, num_threads: int = 0) -> None:
        if not isinstance(controller, LowLevelController):
            controller = LowLevelController.load(controller, num_threads)
        self.controller = controller
        self.space: Box[Any] = Box(-1.0, 1.0, (controller.latent_size,), np.float32)
        anchors = controller.anchors
        self.idle = np.asarray(anchors.get(IDLE_ANCHOR, controller.standing_latents[0]), np.float32)

    def commands(self, actions: ArrayLike) -> FloatArray:
        """Unit latents ``(n, 64)`` of actions ``(n, 64)``."""
        latents = checked_actions(actions, self.controller.latent_size)
        length = np.linalg.norm(latents, axis=1, keepdims=True)
        return np.where(length > 1e-6, latents / np.maximum(length, 1e-6), self.idle)

    def targets(self, observation: FloatArray, commands: FloatArray) -> NDArray[np.floating]:
        """One step of the controller."""
        return self.controller.act(observation, commands)

    def info(self, commands: FloatArray) -> dict[str, FloatArray]:
        """The unit latent that was played."""
        return {"latent": commands.copy()}


class RetrievalActions:
    """Actions are weights of the query: 0 stands for the weight 1, -1 for 0 and 1 for 2.

    Args:
        controller: the controller or the path of its ONNX file; the bundled one if None.
        num_threads: threads of the controller; 0 for one per CPU.
    """

    controller_steps = CONTROLLER_STEPS

    def __init__(self, controller: LowLevelController | str | Path | None, num_threads: int) -> None:
        if not isinstance(controller, LowLevelController):
            controller = LowLevelController.load(controller, num_threads)
        self.controller = controller
        self.space: Box[Any] = Box(-1.0, 1.0, (KEY_SIZE,), np.float32)

    def commands(self, actions: ArrayLike) -> FloatArray:
        """Weights ``(n, 32)`` of actions ``(n, 32)``."""
        return 1 + checked_actions(actions, KEY_SIZE)

    def targets(self, observation: FloatArray, commands: FloatArray) -> NDArray[np.floating]:
        """One step of the controller; the environment has made latents of the weights."""
        return self.controller.act(observation, commands)

    def info(self, commands: FloatArray) -> dict[str, FloatArray]:
        """Nothing: the environment knows more."""
        return {}
