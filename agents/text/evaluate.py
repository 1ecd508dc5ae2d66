"""Episodes of a trained policy: what it did, judged by similarity, falls and, where the text has one, a check."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from agents.text.checks import Trajectory, fell, find_check
from agents.text.object_checks import find_object_check
from agents.training.config import EPISODE_DECISIONS
from anyskill_envs.objects.scene import Scene
from motion_data.skeleton import FRAME_RATE, QPOS_SIZE, forward_kinematics

Policy = Callable[[NDArray[np.float32]], NDArray[np.float32]]
"""Observations `(n, 223)` to actions `(n, 64)`."""


@dataclass(frozen=True)
class Episode:
    """One episode of 10 s, or less if it terminated.

    Attributes:
        qpos: Poses at 30 Hz, `(T, 35)`; in a scene with objects its poses, of which these are the first numbers.
        observations: Proprioception at 30 Hz, `(T, 223)`.
        similarity: Mean similarity of text and motion; None if the reward reads no text.
        reward: Mean reward per decision over the whole episode; decisions after a termination count 0.
        fell: Whether it terminated by a fall, or the head came below 0.5 m.
        success: What the check says, and no fall; None for a text without a check.
    """

    qpos: NDArray[np.float64]
    observations: NDArray[np.float32]
    similarity: float | None
    reward: float
    fell: bool
    success: bool | None


def judge(
    qpos: NDArray[np.float64], terminated: bool, text: str, scene: Scene | None = None
) -> tuple[bool, bool | None]:
    """Whether the humanoid fell, and whether it did what the text says (None for a text without a check).

    Args:
        qpos: Poses `(T, 35)`, or those of the scene.
        terminated: Whether the episode ended by termination.
        text: The text.
        scene: The objects beside the humanoid, if any.
    """
    trajectory = Trajectory(*forward_kinematics(qpos[:, :QPOS_SIZE]))
    has_fallen = terminated or fell(trajectory)
    object_check = None if scene is None else find_object_check(text, scene)
    if object_check is not None:
        return has_fallen, object_check(qpos) and not has_fallen
    check = find_check(text)
    return has_fallen, None if check is None else check(trajectory) and not has_fallen


def scene_of(environment: str) -> Scene:
    """The scene of a registered environment, as its registration names the objects."""
    name = environment.rpartition(":")[2]  # "module:id", as gym.make takes it
    return Scene.of(gym.spec(name).kwargs.get("objects", ()))


def run_episodes(
    policy: Policy,
    text: str,
    episodes: int,
    seed: int,
    environment: str = "anyskill_envs:HumanoidText-v0",
    **options: Any,
) -> list[Episode]:
    """Runs episodes from slightly different standing poses, all at once.

    Args:
        policy: What acts; give a deterministic one.
        text: The text of the environment.
        episodes: How many.
        seed: Seed of the environment.
        environment: Id of the environment.
        **options: Further arguments of the environment.

    Returns:
        The episodes.
    """
    env = gym.make_vec(environment, num_envs=episodes, text=text, record_controller_steps=True, **options)
    scene: Scene = env.unwrapped.scene  # type: ignore[attr-defined]
    observation, _ = env.reset(seed=seed)
    frames: list[list[NDArray[np.float64]]] = [[] for _ in range(episodes)]
    seen: list[list[NDArray[np.float32]]] = [[] for _ in range(episodes)]
    similarity, reward_sum = np.zeros(episodes), np.zeros(episodes)
    compares = False
    decisions = np.zeros(episodes, np.int64)
    fallen = np.zeros(episodes, bool)
    running = np.ones(episodes, bool)
    for _ in range(EPISODE_DECISIONS):
        observation, reward, terminated, truncated, info = env.step(policy(observation))
        for index in np.flatnonzero(running).tolist():
            # after a termination inside a decision the humanoid keeps its state: only executed steps count
            executed = int(info["controller_steps"][index])
            frames[index].append(info["controller_qpos"][index, :executed])
            seen[index].append(info["controller_observations"][index, :executed])
        if "similarity" in info:
            compares = True
            similarity += np.where(running, info["similarity"], 0.0)
        reward_sum += np.where(running, reward, 0.0)
        decisions += running
        fallen |= running & terminated
        running &= ~(terminated | truncated)
        if not running.any():
            break
    env.close()
    results = []
    for index in range(episodes):
        qpos = np.concatenate(frames[index])
        has_fallen, success = judge(qpos, bool(fallen[index]), text, scene)
        results.append(
            Episode(
                qpos=qpos,
                observations=np.concatenate(seen[index]),
                similarity=float(similarity[index] / decisions[index]) if compares else None,
                reward=float(reward_sum[index] / EPISODE_DECISIONS),
                fell=has_fallen,
                success=success,
            )
        )
    return results


def save_rollouts(path: Path, episodes: list[Episode]) -> None:
    """Writes episodes to a file that :func:`load_rollouts` reads; it holds no pickle."""
    np.savez_compressed(
        path,
        lengths=np.array([len(episode.qpos) for episode in episodes]),
        qpos=np.concatenate([episode.qpos for episode in episodes]),
        observations=np.concatenate([episode.observations for episode in episodes]),
        # NaN: the reward reads no text
        similarity=np.array(
            [np.nan if episode.similarity is None else episode.similarity for episode in episodes], float
        ),
        reward=np.array([episode.reward for episode in episodes]),
        fell=np.array([episode.fell for episode in episodes]),
        # NaN: the text has no check
        success=np.array([np.nan if episode.success is None else episode.success for episode in episodes], float),
    )


def load_rollouts(path: Path) -> list[Episode]:
    """Reads the evaluation episodes of a run from its rollouts.npz.

    Raises:
        FileNotFoundError: There is no such file.
    """
    if not path.is_file():
        raise FileNotFoundError(
            f"'{path}' does not exist: the run is not finished, or of a version that recorded no episodes."
        )
    with np.load(path, allow_pickle=False) as archive:
        data = dict(archive)
    ends = np.cumsum(data["lengths"])[:-1]
    rows = zip(
        np.split(data["qpos"], ends),
        np.split(data["observations"], ends),
        [None if np.isnan(similarity) else float(similarity) for similarity in data["similarity"]],
        data["reward"].tolist(),
        data["fell"].tolist(),
        [None if np.isnan(success) else bool(success) for success in data["success"]],
        strict=True,
    )
    return [Episode(*row) for row in rows]


def summarise(episodes: list[Episode], text: str, scene: Scene | None = None) -> dict[str, Any]:
    """Rates and means of some episodes, as JSON values.

    `success_rate` is None for a text without a check, `similarity` for a reward that reads no text.
    """
    check = (scene and find_object_check(text, scene)) or find_check(text)
    similarities = [episode.similarity for episode in episodes if episode.similarity is not None]
    successes = [episode.success for episode in episodes if episode.success is not None]
    return {
        "episodes": len(episodes),
        "check": None if check is None else (check.__doc__ or "").strip().splitlines()[0],
        "success_rate": float(np.mean(successes)) if successes else None,
        "fall_rate": float(np.mean([episode.fell for episode in episodes])),
        "similarity": float(np.mean(similarities)) if similarities else None,
        "reward": float(np.mean([episode.reward for episode in episodes])),
        "seconds": [round(len(episode.qpos) / FRAME_RATE, 2) for episode in episodes],
    }
