"""RetrievalLocomotion-v0: a humanoid that is steered, by retrieving clips from a motion database."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from anyskill_envs.actions import FloatArray, RetrievalActions
from anyskill_envs.controller import ENCODER_FILE, LowLevelController, MotionEncoder
from anyskill_envs.goals import GOAL_SECONDS, GOAL_SPEED, Range, VelocityGoals, goal_distance
from anyskill_envs.retrieval_observation import STEERING_BOUNDS, observe_steering
from anyskill_envs.retrieved_clips import RetrievedClips
from anyskill_envs.simulation import CONTROLLER_STEPS
from anyskill_envs.single import HumanoidEnv
from anyskill_envs.vector import HumanoidVectorEnv
from motion_data.retrieval import DEFAULT_SELECTION, MotionDatabase
from motion_data.retrieval_keys import (
    CLIP_FRAMES,
    END_EFFECTOR_INDEX,
    course_key,
    state_key,
    wished_course,
)
from motion_data.skeleton import FRAME_RATE, heading
from rewards import RewardOutput

DatabaseSources = Mapping[str, MotionDatabase | str | Path]

_BODIES = np.array([0, *END_EFFECTOR_INDEX])


class RetrievalLocomotionVectorEnv(HumanoidVectorEnv):
    """Humanoids steered by retrieval; see :class:`RetrievalLocomotionEnv`.

    Args:
        num_envs: number of humanoids.
        databases: name of each motion database and what it is made of: a `MotionDatabase`, the path of a saved one
            (.npz) or of a folder of motion files, a category of the motion library, a pattern of its clips' names, or both.
            "move_around&usual" of the library, its locomotion without acrobatics and crawling, if None.
        database: the database in which episodes look: a name, "random" to draw one for each episode, or None for the
            first.
        query_period: decisions (1/6 s) between two retrievals; a clip that ends (after 3) is replaced in any case.
        weighting: what the action weights: the "query" before it is compared with keys (RACon), or the "metric" of the
            comparison.
        goal_speed: slowest and fastest goal, m/s.
        goal_seconds: shortest and longest time until the goal changes; None for goals that stay for the episode.
        face_goal: ask for clips that turn to where the goal points; otherwise for clips that keep the heading.
        goal_weight: weight of the reward for the humanoid's velocity.
        clip_weight: weight of the reward for the retrieved clip's velocity.
        motion_encoder: path of the controller's motion encoder, or a loaded one; if None, the file
            `motion_encoder.onnx` beside the controller.
        controller: path of the controller's ONNX file, or a loaded controller; the bundled one if None.
        num_threads: threads of physics and controller; 0 for one per CPU. Results do not depend on it.
        terminate_when_fallen: see :class:`HumanoidVectorEnv`; a fall ends the episode by default.
        **kwargs: arguments of :class:`HumanoidVectorEnv`.

    Raises:
        FileNotFoundError: there is no such controller or encoder.
        ValueError: an empty or unknown database, a clip shorter than 0.5 s, or another argument out of its range.
    """

    metadata: dict[str, Any] = HumanoidVectorEnv.metadata | {"render_fps": round(FRAME_RATE / CONTROLLER_STEPS)}
    reset_options: ClassVar[tuple[str, ...]] = (*HumanoidVectorEnv.reset_options, "database", "goal")
    decoder: RetrievalActions

    def __init__(
        self,
        num_envs: int = 1,
        *,
        databases: DatabaseSources | None = None,
        database: str | None = None,
        query_period: int = 1,
        weighting: str = "query",
        goal_speed: Range = GOAL_SPEED,
        goal_seconds: Range | None = GOAL_SECONDS,
        face_goal: bool = True,
        goal_weight: float = 0.8,
        clip_weight: float = 0.2,
        motion_encoder: MotionEncoder | str | Path | None = None,
        controller: LowLevelController | str | Path | None = None,
        num_threads: int = 0,
        terminate_when_fallen: bool = True,
        **kwargs: Any,
    ) -> None:
        if query_period < 1:
            raise ValueError(f"query_period must be 1 or more decisions, got {query_period}.")
        if weighting not in ("query", "metric"):
            raise ValueError(f'weighting must be "query" or "metric", got {weighting!r}.')
        for name, weight in (("goal_weight", goal_weight), ("clip_weight", clip_weight)):
            if not 0 <= weight < np.inf:
                raise ValueError(f"{name} must be a number from 0 on, got {weight}.")
        self.goals = VelocityGoals(max(num_envs, 1), goal_speed, goal_seconds)  # the base class refuses less
        self.face_goal = face_goal
        threads = num_threads if num_envs > 1 else 1
        decoder = RetrievalActions(controller, threads)
        if not isinstance(motion_encoder, MotionEncoder):
            beside = decoder.controller.path.with_name(ENCODER_FILE.name)
            motion_encoder = MotionEncoder.load(motion_encoder or beside, threads)
        sources = {"locomotion": DEFAULT_SELECTION} if databases is None else databases
        self.clips = RetrievedClips(max(num_envs, 1), sources, motion_encoder)
        if database not in (None, "random"):
            self.clips.databases.index(database)
        self._database = database
        self._period = query_period * CONTROLLER_STEPS
        self._metric = weighting == "metric"
        self._weights = goal_weight, clip_weight
        self._retrieved = np.zeros(max(num_envs, 1), bool)
        self._last: dict[str, NDArray[Any]] = {}
        super().__init__(
            num_envs,
            decoder=decoder,
            num_threads=num_threads,
            terminate_when_fallen=terminate_when_fallen,
            **kwargs,
        )

    # Steering, while running

    @property
    def databases(self) -> list[str]:
        """Names of the databases."""
        return list(self.clips.databases.names)

    def use_database(self, name: str, ids: Sequence[int] | NDArray[np.int64] | None = None) -> None:
        """Switch humanoids to another database, from their next decision on until their episode ends.

        Args:
            name: the database.
            ids: the humanoids; all if None.

        Raises:
            ValueError: there is no such database.
        """
        number = self.clips.databases.index(name)
        which = slice(None) if ids is None else np.asarray(ids)
        self.clips.choice[which] = number
        self.clips.age[which] = CLIP_FRAMES  # what they follow comes from another database: it is over

    def add_database(self, name: str, source: MotionDatabase | str | Path) -> None:
        """Add a database; a copy or an unpickled environment has only those of the constructor.

        Args:
            name: a name that is not taken.
            source: as in the constructor.

        Raises:
            ValueError: the name is taken, or the database cannot be made.
        """
        self.clips.add(name, source)

    def set_goal(self, speed: float, direction: float, ids: Sequence[int] | NDArray[np.int64] | None = None) -> None:
        """Set where humanoids shall go, until their goal changes or their episode ends.

        Args:
            speed: m/s; 0 to stand.
            direction: radians in the world, 0 along x, counter-clockwise.
            ids: the humanoids; all if None.

        Raises:
            ValueError: a number is not finite, or the speed out of range.
        """
        self.goals.set(np.arange(self.num_envs) if ids is None else np.asarray(ids), speed, direction)

    # What the base class asks for

    def make_observation_space(self) -> Box:
        """Proprioception, the goal and the retrieved clip; blocks as in `RETRIEVAL_LAYOUT`."""
        space = super().make_observation_space()
        high = STEERING_BOUNDS
        return Box(np.concatenate([space.low, -high]), np.concatenate([space.high, high]), dtype=np.float32)

    def observations(self, ids: NDArray[np.int64] | slice) -> FloatArray:
        """Observations of some humanoids, new arrays ``(k, 258)``."""
        steering = observe_steering(self.simulation.qpos[ids], self.goals.velocity[ids], self.clips, ids)
        return np.concatenate([super().observations(ids), steering], axis=1)

    def begin_episodes(self, ids: NDArray[np.int64], options: dict[str, Any]) -> None:
        """Draw goals and databases, and retrieve clips with all weights 1.

        Args:
            ids: indices of the humanoids, ``(k,)``.
            options: `goal`, a speed (m/s) and a direction (rad) for all; `database`, a name or "random".
        """
        self.goals.draw(ids, self.np_random)
        if options.get("goal") is not None:
            self.goals.set(ids, *options["goal"])
        name = options.get("database", self._database)
        if name == "random":
            self.clips.choice[ids] = self.np_random.integers(len(self.databases), size=len(ids))
        else:
            self.clips.choice[ids] = 0 if name is None else self.clips.databases.index(name)
        self._retrieve(ids, None)

    def begin_decision(self, commands: FloatArray, running: NDArray[np.bool_]) -> FloatArray:
        """Retrieve clips where it is time to, and turn weights into the latents of what the humanoids follow."""
        due = running & (self.clips.is_over | (self.clips.age % self._period == 0))
        ids = np.flatnonzero(due)
        if len(ids):
            self._retrieve(ids, commands[ids])
        self._retrieved = due
        return self.clips.latents

    def end_decision(self, executed: NDArray[np.int64]) -> None:
        """Step along the clips, and change goals whose time is up."""
        self._last = self._decision_info()
        self.clips.advance(executed)
        self.goals.advance(executed, self.np_random)

    def compute_reward(self, commands: FloatArray) -> RewardOutput:
        """How well the velocities of humanoid and retrieved clip agree with the goal: exp(-d), weighted."""
        goal, (goal_weight, clip_weight) = self.goals.velocity, self._weights
        return RewardOutput.from_terms(
            {
                "goal": goal_weight * np.exp(-goal_distance(self.simulation.qvel[:, :2], goal)),
                "clip": clip_weight * np.exp(-goal_distance(self.clips.velocities, goal)),
            }
        )

    def extra_info(self) -> dict[str, NDArray[Any]]:
        """What was retrieved and played, the goal of the decision, and how far it was missed at its end."""
        clips = self.clips
        return {
            **(self._last or self._decision_info()),
            "retrieved": self._retrieved.copy(),
            "clip": clips.names,
            "clip_seconds": clips.age / FRAME_RATE,
            "database": np.array(self.databases)[clips.choice],
        }

    def _decision_info(self) -> dict[str, NDArray[Any]]:
        """Goal, error and latent of the present decision, before the next goal is drawn."""
        goal = self.goals.velocity.copy()
        error = np.linalg.norm(self.simulation.qvel[:, :2] - goal, axis=1)
        return {"goal_velocity": goal, "velocity_error": error, "latent": self.clips.latents}

    # Retrieval

    def queries(self, ids: NDArray[np.int64]) -> NDArray[np.float64]:
        """Raw queries of some humanoids, ``(k, 32)``: their state, and the way that their goals ask for."""
        bodies = self.simulation
        quaternions = bodies.body_quaternions[ids, 0]
        velocities = bodies.body_linear_velocities[ids]
        state = state_key(bodies.body_positions[ids][:, _BODIES], quaternions, velocities[:, _BODIES])
        course = wished_course(velocities[:, 0, :2], heading(quaternions), self.goals.velocity[ids], self.face_goal)
        return np.concatenate([state, course_key(*course)], 1)

    def _retrieve(self, ids: NDArray[np.int64], weights: FloatArray | None) -> None:
        """Find clips for some humanoids and stitch them to where these are; all weights are 1 if None."""
        frames = self.clips.databases.search(self.clips.choice[ids], self.queries(ids), weights, self._metric)
        self.clips.stitch(ids, frames, self.simulation.qpos[ids])


class RetrievalLocomotionEnv(HumanoidEnv):
    """One humanoid steered with a goal velocity, through a retriever over the frozen controller (after RACon).

    A database holds clips of 0.5 s. At each decision the environment makes a query of the humanoid's state and its goal,
    the agent weights it, the nearest clip is stitched to where the humanoid is, and the controller gets the latent of
    the 2 s of motion that begin there. An action of zeros retrieves with equal weights: steering without learning.

    The retriever is that of RACon (Mu et al. 2024); its joint-level controller, trained together with it, is replaced
    by the frozen one.

    ## Action space

    `Box(-1, 1, (32,), float32)`: the weights of the 32 numbers of the query, minus 1; `KEY_LAYOUT` in
    `motion_data.retrieval_keys` names them. `weighting="query"` multiplies the standardised query with them, as RACon
    does; `"metric"` weights the distance instead. With a `query_period` above 1 the action counts only in decisions
    that retrieve, as `info["retrieved"]` says.

    ## Observation space

    `Box((258,), float32)`; `RETRIEVAL_LAYOUT` in `anyskill_envs.retrieval_observation` names the blocks: proprioception 223;
    the goal's direction (cosine, sine) in the heading frame and its speed (m/s); the clip's state 27 (velocity of the root,
    places and velocities of hands and feet, in its own heading frame), where it is (m) and turned to (cosine, sine) in the
    humanoid's heading frame, and how much of it is over, 0 to 1.

    ## Rewards

    `reward_goal`: 0.8 exp(-d) of the humanoid's velocity; `reward_clip`: 0.2 exp(-d) of the retrieved clip's mean
    velocity. d = (1 - cos(v, g)) + | |v| - |g| | for the goal g, in m/s; see `anyskill_envs.goals.goal_distance`.

    ## Starting state

    That of :class:`HumanoidEnv`. The goal is drawn: any direction, `goal_speed`, and drawn again after `goal_seconds`.
    `reset(options={"goal": (speed, direction), "database": name})` sets them; `set_goal` and `use_database` do so while
    it runs.

    ## Episode end

    That of :class:`HumanoidEnv`; a fall (a body other than feet and shins below 0.05 m) terminates unless
    `terminate_when_fallen=False`.

    ## Info

    `goal_velocity` (m/s in the world) of the decision and `velocity_error` (m/s) at its end, `retrieved` (whether the
    action counted), `clip` (name of the motion) and `clip_seconds` (how much of it is over), `database`, `latent`.

    ## Arguments

    Those of :class:`RetrievalLocomotionVectorEnv`, but `num_envs`, `max_episode_steps` and `autoreset_mode`.

    ## Version history

    v0: first version.
    """

    vector_class: ClassVar[type[RetrievalLocomotionVectorEnv]] = RetrievalLocomotionVectorEnv
    metadata: dict[str, Any] = RetrievalLocomotionVectorEnv.metadata
    vector: RetrievalLocomotionVectorEnv

    @property
    def databases(self) -> list[str]:
        """Names of the databases."""
        return self.vector.databases

    def use_database(self, name: str) -> None:
        """Switch to another database, from the next decision on; see the vector class."""
        self.vector.use_database(name)

    def add_database(self, name: str, source: MotionDatabase | str | Path) -> None:
        """Add a database; see the vector class."""
        self.vector.add_database(name, source)

    def set_goal(self, speed: float, direction: float) -> None:
        """Set where to go: m/s, and radians in the world; see the vector class."""
        self.vector.set_goal(speed, direction)
