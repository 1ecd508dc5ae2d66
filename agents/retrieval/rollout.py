"""Episodes in which a retriever follows goals, recorded for their measures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.retrieval.retriever import Retriever
from anyskill_envs.observation import OBSERVATION_LAYOUT
from anyskill_envs.retrieval import RetrievalLocomotionVectorEnv
from anyskill_envs.simulation import CONTROLLER_STEPS
from motion_data.retrieval_keys import turned
from motion_data.skeleton import FRAME_RATE, heading

DECISIONS_PER_SECOND = FRAME_RATE / CONTROLLER_STEPS
_LINEAR = OBSERVATION_LAYOUT["body_linear_velocities"].start


@dataclass(frozen=True)
class Rollout:
    """Episodes of one retriever, recorded at 30 Hz.

    Attributes:
        qpos: Poses of each episode, ``(T, 35)`` each.
        velocity: Horizontal velocities of the root in the world, ``(T, 2)`` m/s each.
        goal: Goals, ``(T, 2)`` m/s each.
        clip_error: Distance of each retrieved clip's mean velocity to the goal, one for each decision, m/s.
        fell: Episodes that terminated, ``(n,)``.
        names: What was retrieved, one for each decision.
    """

    qpos: list[NDArray[np.float64]]
    velocity: list[NDArray[np.float64]]
    goal: list[NDArray[np.float64]]
    clip_error: NDArray[np.float64]
    fell: NDArray[np.bool_]
    names: list[str]

    @property
    def errors(self) -> NDArray[np.float64]:
        """Mean velocity error of each episode, ``(n,)`` m/s."""
        pairs = zip(self.velocity, self.goal, strict=True)
        return np.array([np.linalg.norm(velocity - goal, axis=1).mean() for velocity, goal in pairs])


def make_environment(episodes: int, options: Mapping[str, Any], **changes: Any) -> RetrievalLocomotionVectorEnv:
    """The batch of an evaluation."""
    return RetrievalLocomotionVectorEnv(episodes, **dict(options) | {"record_controller_steps": True} | changes)


def roll_out(
    env: RetrievalLocomotionVectorEnv,
    retriever: Retriever,
    seconds: float,
    seed: int,
    goals: Mapping[float, tuple[NDArray[np.float64], NDArray[np.float64]]] | None = None,
) -> Rollout:
    """Runs one episode of each humanoid.

    Args:
        env: The batch.
        retriever: What acts.
        seconds: Length of an episode that does not terminate.
        seed: Seed of starts and goals.
        goals: Speeds and directions ``(n,)`` to set at some moments (seconds); the environment's own goals if None.

    Returns:
        The episodes.
    """
    count = env.num_envs
    changes = {round(moment * DECISIONS_PER_SECOND): goal for moment, goal in (goals or {}).items()}
    observation, _ = env.reset(seed=seed)
    running, fell = np.ones(count, bool), np.zeros(count, bool)
    rows: list[list[tuple[NDArray[Any], NDArray[Any], NDArray[Any]]]] = [[] for _ in range(count)]
    clip_error: list[float] = []
    names: list[str] = []
    for decision in range(round(seconds * DECISIONS_PER_SECOND)):
        if decision in changes:
            for index, (speed, direction) in enumerate(zip(*changes[decision], strict=True)):
                env.set_goal(float(speed), float(direction), [index])
            observation = env.observations(slice(None))
        observation, _, terminated, truncated, info = env.step(retriever(observation))
        poses, proprioception = info["controller_qpos"], info["controller_observations"]
        velocity = turned(proprioception[:, :, _LINEAR : _LINEAR + 2], heading(poses[..., 3:7]))
        error = np.linalg.norm(env.clips.velocities - info["goal_velocity"], axis=1)
        for index in np.flatnonzero(running).tolist():
            # after a termination inside a decision the humanoid keeps its state: only executed steps count
            done = int(info["controller_steps"][index])
            goal = np.tile(info["goal_velocity"][index], (done, 1))
            rows[index].append((poses[index, :done], velocity[index, :done], goal))
            clip_error.append(float(error[index]))
            names.append(str(info["clip"][index]))
        fell |= running & terminated
        running &= ~(terminated | truncated)
        if not running.any():
            break
    joined = [[np.concatenate(parts) for parts in zip(*episode, strict=True)] for episode in rows]
    qpos, velocities, wished = map(list, zip(*joined, strict=True))
    return Rollout(qpos, velocities, wished, np.array(clip_error), fell, names)
