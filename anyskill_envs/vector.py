"""The batched environment that every other environment of the project is made of."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import gymnasium as gym
import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from anyskill_envs.actions import ActionDecoder, FloatArray, JointActions
from anyskill_envs.objects import SceneObject
from anyskill_envs.objects.scene import Scene
from anyskill_envs.objects.state import object_vectors, observation_bounds, observe_objects
from anyskill_envs.observation import OBSERVATION_SIZE, observe, proprioception_space
from anyskill_envs.rebuilding import RebuiltFromArguments
from anyskill_envs.rendering import HumanoidRenderer, camera_of
from anyskill_envs.simulation import HumanoidSimulation
from anyskill_envs.starts import START_NAMES, draw_starts
from anyskill_envs.vector_info import final_entries, reward_entries, state_entries, with_masks
from anyskill_envs.viewer import HumanoidViewer
from motion_data.skeleton import BODY_NAMES, FRAME_RATE, QPOS_SIZE, QVEL_SIZE
from rewards import RewardOutput

FALL_HEIGHT = 0.05
"""Metres: AnySkill's termination height of bodies that should not touch the floor."""
# AnySkill exempts the feet only; a shin that lies on the floor is kneeling, not falling.
_MAY_TOUCH_FLOOR = ("right_foot", "left_foot", "right_shin", "left_shin")
_SHOULD_STAY_UP = [index for index, name in enumerate(BODY_NAMES) if name not in _MAY_TOUCH_FLOOR]


class HumanoidVectorEnv(RebuiltFromArguments, VectorEnv[FloatArray, FloatArray, NDArray[Any]]):
    """Humanoids in one native batch, as a `gymnasium.vector.VectorEnv`.

    This class is joint-level: an action is 28 PD targets, held for one controller step (1/30 s). Subclasses change what
    an action means (`decoder`), the reward, the start, the end and what is observed:

    - :meth:`compute_reward`: the reward of one controller step, by terms,
    - :meth:`has_ended`: who terminated,
    - :meth:`start_states`: states in which episodes start,
    - :meth:`begin_episodes`, :meth:`begin_decision`, :meth:`end_decision`: draw what an episode or a decision needs,
    - :meth:`observations`, :meth:`make_observation_space`: what is observed,
    - :meth:`extra_info`: more entries of `info`.

    One :meth:`step` runs the decoder's number of controller steps. A humanoid that terminates inside keeps its state
    while the others go on; rewards, terms and similarity are averaged over the controller steps that it executed.

    `info` has the same keys at every step, each an array ``(num_envs, ...)`` beside its mask ``_key``: `reward_<term>`
    for every term of the reward (they add up to it), `similarity` if the reward compares with a text, `x_position` and
    `distance_from_origin` (m), `x_velocity` (m/s) of the pelvis, `head_height` (m), `controller_steps` executed,
    `diverged`, and what the decoder adds (`latent`). Each object adds `<object>_distance` (m, horizontally from the
    pelvis), `<object>_speed` (m/s) and, if it has joints, `<object>_angle`. After a reset, whatever belongs to a step is
    zero.

    Args:
        num_envs: number of humanoids.
        decoder: what an action means; joint targets if None.
        max_episode_steps: controller steps divided by those of an action after which an episode is truncated; never if
            None. `gym.make_vec` fills in the registered number; single environments leave it to `TimeLimit`.
        autoreset_mode: "NextStep" (the default of Gymnasium), "SameStep" (what Stable-Baselines3 wants) or "Disabled",
            or a member of `gymnasium.vector.AutoresetMode`.
        render_mode: None, "rgb_array" (pictures of all humanoids) or "human" (a window with the first one).
        width: width of pictures in pixels.
        height: height of pictures in pixels.
        camera: fields of `anyskill_envs.rendering.Camera`; by default in front of the humanoid, or, with objects, beside it
            so that both are seen.
        num_threads: native threads; 0 for one per CPU. Results do not depend on it.
        initial_state: "standing" starts from the rest pose, "library" from a random frame of the motion clips.
        reset_noise_scale: half-width of the uniform noise at the start: joint angles (rad), velocities (rad/s, m/s).
        minimum_head_height: an episode terminates when the centre of the head is lower, in metres.
        terminate_when_fallen: terminate as well when a body other than feet and shins is below 0.05 m.
        record_controller_steps: add `controller_observations` ``(k, 223)`` and `controller_qpos` ``(k, 35)`` of the k
            controller steps of an action to `info`, for rewards to be recomputed and for smooth videos. With objects,
            the latter are poses of the scene, and `controller_objects` holds the states of the objects.
        objects: names of objects that stand beside each humanoid, such as ``["ball", "door"]``, or
            `anyskill_envs.objects.SceneObject`; see docs/objects.md.
        placement: where they stand at the start, by object: ``{"ball": {"distance": (1.0, 3.0), "bearing": 0.0}}``; what is
            left out is the object's own. See :class:`anyskill_envs.objects.Placement`.
        object_observation: append the objects to the observation; False is AnySkill's policy, which does not see them.

    Raises:
        ValueError: an argument is out of its range; the message says which values exist.
        RenderingError: pictures or a window were asked for and cannot be had on this machine.
    """

    metadata: dict[str, Any] = {
        "render_modes": ["human", "rgb_array"],
        "render_fps": round(FRAME_RATE / JointActions.controller_steps),
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }
    reset_options: ClassVar[tuple[str, ...]] = ("initial_state", "placement")
    """Options of :meth:`reset` beside `reset_mask`."""
    decoder: ActionDecoder

    def __init__(
        self,
        num_envs: int = 1,
        *,
        decoder: ActionDecoder | None = None,
        max_episode_steps: int | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        render_mode: str | None = None,
        width: int = 480,
        height: int = 480,
        camera: Mapping[str, Any] | None = None,
        num_threads: int = 0,
        initial_state: str = "standing",
        reset_noise_scale: float = 0.02,
        minimum_head_height: float = 0.15,
        terminate_when_fallen: bool = False,
        record_controller_steps: bool = False,
        objects: Scene | Sequence[str | SceneObject] = (),
        placement: Mapping[str, Mapping[str, Any]] | None = None,
        object_observation: bool = True,
    ) -> None:
        if num_envs < 1:
            raise ValueError(f"num_envs must be at least 1, got {num_envs}.")
        if max_episode_steps is not None and max_episode_steps < 1:
            raise ValueError(f"max_episode_steps must be at least 1 or None, got {max_episode_steps}.")
        if initial_state not in START_NAMES:
            raise ValueError(f"initial_state must be one of {', '.join(START_NAMES)}, got {initial_state!r}.")
        if not 0 <= reset_noise_scale < np.inf:
            raise ValueError(f"reset_noise_scale must be a number from 0 on, got {reset_noise_scale}.")
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise ValueError(f"render_mode must be None, 'human' or 'rgb_array', got {render_mode!r}.")
        self.num_envs = num_envs
        self.decoder = JointActions() if decoder is None else decoder
        self.autoreset_mode = _autoreset_mode(autoreset_mode)
        self.metadata = self.metadata | {
            "autoreset_mode": self.autoreset_mode,
            "render_fps": round(FRAME_RATE / self.decoder.controller_steps),
        }
        self.initial_state = initial_state
        self.reset_noise_scale = reset_noise_scale
        self.minimum_head_height = minimum_head_height
        self.terminate_when_fallen = terminate_when_fallen
        self.record_controller_steps = record_controller_steps

        self.scene = Scene.of(objects)
        self._placements = self.scene.placements(placement)
        self.object_observation = object_observation
        # Objects that find no room beside each other are an error now, not in the middle of a training run.
        rest, still = self.scene.rest_pose[None, :QPOS_SIZE], np.zeros((1, QVEL_SIZE))
        self.scene.place(rest, still, self._placements, 0.0, np.random.default_rng(0))

        self.render_mode = render_mode
        self._camera = camera_of(camera, self.scene)
        self._renderer = None
        if render_mode == "rgb_array":
            self._renderer = HumanoidRenderer(width, height, "video", scene=self.scene)
        self._viewer = HumanoidViewer(1 / FRAME_RATE, self.scene) if render_mode == "human" else None

        self.simulation = HumanoidSimulation(num_envs, num_threads, scene=self.scene)
        self.proprioception = self.simulation.observation()
        self.object_vectors = object_vectors(self.simulation)
        self._controller_step_limit = max_episode_steps and max_episode_steps * self.decoder.controller_steps
        self._elapsed = np.zeros(num_envs, np.int64)
        self._ended = np.zeros(num_envs, bool)
        self._was_reset = False
        self._reward_keys: tuple[str, ...] = ()

        self._proprioception_space = proprioception_space()
        self.single_action_space = self.decoder.space
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.single_observation_space = self.make_observation_space()
        self.observation_space = batch_space(self.single_observation_space, num_envs)

    # What subclasses change

    def make_observation_space(self) -> Box:
        """Space of the observation of one humanoid: proprioception, and the objects unless it is blind to them."""
        space = self._proprioception_space
        if not (self.scene and self.object_observation):
            return space
        bounds = observation_bounds(self.scene)
        return Box(np.concatenate([space.low, -bounds]), np.concatenate([space.high, bounds]), dtype=np.float32)

    def observations(self, ids: NDArray[np.int64] | slice) -> FloatArray:
        """Observations of some humanoids, new arrays ``(k, ...)``: proprioception and objects within their bounds."""
        space = self._proprioception_space
        observations = np.clip(self.proprioception[ids], space.low, space.high)
        if not (self.scene and self.object_observation):
            return observations
        bounds = observation_bounds(self.scene)
        seen = np.clip(observe_objects(self.scene, self.object_vectors[ids]), -bounds, bounds)
        return np.concatenate([observations, seen], axis=1)

    def compute_reward(self, commands: FloatArray) -> RewardOutput:
        """Reward of the controller step that was just executed, for all humanoids; here 1 for being alive.

        Args:
            commands: the commands that the decoder made of the actions, ``(n, ...)``.

        Returns:
            Terms ``(n,)`` that add up to the reward; the same terms every time.
        """
        return RewardOutput.from_terms({"alive": ~self.has_ended()})

    def has_ended(self) -> NDArray[np.bool_]:
        """Humanoids whose state ends the episode, ``(n,)``."""
        ended = self.simulation.head_height < self.minimum_head_height
        if self.terminate_when_fallen:
            ended |= (self.simulation.body_positions[:, _SHOULD_STAY_UP, 2] < FALL_HEIGHT).any(1)
        return ended

    def start_states(self, count: int, initial_state: Any) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Draw states in which the episodes of humanoids start; objects are placed around them afterwards.

        Args:
            count: number of humanoids k.
            initial_state: what :func:`anyskill_envs.starts.draw_starts` takes.

        Returns:
            qpos ``(k, 35)`` and qvel ``(k, 34)``.

        Raises:
            ValueError: the state is none of these.
        """
        return draw_starts(initial_state, count, self.reset_noise_scale, self.np_random)

    def begin_episodes(self, ids: NDArray[np.int64], options: dict[str, Any]) -> None:
        """Called when humanoids `ids` were put into new start states.

        Args:
            ids: indices of the humanoids, ``(k,)``.
            options: the options of :meth:`reset`; empty when an episode starts by itself.

        Raises:
            ValueError: an option has a bad value.
        """

    def begin_decision(self, commands: FloatArray, running: NDArray[np.bool_]) -> FloatArray:
        """Called before the controller steps of an action, to draw what they need.

        Args:
            commands: the commands that the decoder made of the actions, ``(n, ...)``.
            running: humanoids that act, ``(n,)``; the others wait for their reset.

        Returns:
            The commands that the decoder's `targets` get, ``(n, ...)``; here the same.
        """
        return commands

    def end_decision(self, executed: NDArray[np.int64]) -> None:
        """Called after the controller steps of an action, before `info` and the observation are made.

        Args:
            executed: controller steps that each humanoid executed, ``(n,)``.
        """

    def extra_info(self) -> dict[str, NDArray[Any]]:
        """More entries of `info`, new arrays ``(n, ...)``; the same keys every time."""
        return {}

    # Gymnasium's interface

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[FloatArray, dict[str, Any]]:
        """Start new episodes.

        Args:
            seed: seeds the one random generator of the batch.
            options: `reset_mask` ``(num_envs,)`` bool, the humanoids to reset (all by default); for this reset only
                `initial_state`, see :func:`anyskill_envs.starts.draw_starts`, and `placement`, see the class;
                subclasses may know more.

        Returns:
            Observations of all humanoids and `info`.

        Raises:
            ValueError: an unknown option or a bad value of one.
        """
        return self.reset_with(self.decoder, seed=seed, options=options)

    def step(
        self, actions: ArrayLike
    ) -> tuple[FloatArray, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Execute actions ``(num_envs, ...)``.

        Returns:
            Observations, rewards, terminated, truncated and `info`. In "SameStep" mode `info["final_obs"]` and
            `info["final_info"]` hold the last observation and info of episodes that ended.

        Raises:
            ValueError: actions of a wrong shape, or not finite.
            gymnasium.error.ResetNeeded: in "Disabled" mode, an episode has ended and was not reset.
        """
        return self.step_with(self.decoder, actions)

    def reset_with(
        self, decoder: ActionDecoder, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[FloatArray, dict[str, Any]]:
        """:meth:`reset` for actions that another decoder understands; this is what wrappers of the actions call."""
        super().reset(seed=seed)
        options = dict(options or {})
        ids = self._ids_of_mask(options.pop("reset_mask", None))
        unknown = sorted(set(options) - set(self.reset_options))
        if unknown:
            known = ", ".join(("reset_mask", *self.reset_options))
            raise ValueError(f"Unknown reset option {unknown[0]!r}; the options that exist are: {known}.")
        self._start_episodes(ids, options)
        self._was_reset = True
        return self.observations(slice(None)), with_masks(self._info_after_reset(decoder), np.ones(self.num_envs, bool))

    def step_with(
        self, decoder: ActionDecoder, actions: ArrayLike
    ) -> tuple[FloatArray, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """:meth:`step` with actions that another decoder understands; this is what wrappers of the actions call."""
        if len(np.atleast_1d(actions)) != self.num_envs:
            raise ValueError(f"Expected {self.num_envs} actions, one for each humanoid, got shape {np.shape(actions)}.")
        commands = decoder.commands(actions)
        self._check_order()
        resetting = self._ended.copy()
        if resetting.any():  # only in "NextStep" mode
            self._start_episodes(np.flatnonzero(resetting), {})

        info, terminated = self._execute(decoder, commands, ~resetting)
        reward = np.sum([value for key, value in info.items() if key.startswith("reward_")], axis=0)
        truncated = np.zeros(self.num_envs, bool)
        if self._controller_step_limit is not None:
            truncated = ~terminated & (self._elapsed >= self._controller_step_limit)
        done = terminated | truncated
        observation = self.observations(slice(None))
        final: dict[str, Any] = {}
        if self.autoreset_mode != AutoresetMode.SAME_STEP:
            self._ended = done
        elif done.any():
            final = final_entries(observation, info, done)
            ids = np.flatnonzero(done)
            self._start_episodes(ids, {})
            observation[ids] = self.observations(ids)
            for key, value in self._info_after_reset(decoder).items():
                info[key][ids] = value[ids]
        return observation, reward, terminated, truncated, with_masks(info, np.ones(self.num_envs, bool)) | final

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """Pictures of all humanoids, uint8 ``(height, width, 3)`` each; None in a window or without a render mode."""
        if self._viewer is not None:
            self._viewer.show(self.simulation.poses[0])
        if self._renderer is None:
            return None
        return tuple(self._renderer.render(pose, self._camera) for pose in self.simulation.poses)

    def close_extras(self, **kwargs: Any) -> None:
        """Free the GL context and close the window."""
        for display in (self._renderer, self._viewer):
            if display is not None:
                display.close()

    # How a step works

    def _check_order(self) -> None:
        if not self._was_reset:
            raise gym.error.ResetNeeded("Call reset() before the first step.")
        if self.autoreset_mode == AutoresetMode.DISABLED and self._ended.any():
            raise gym.error.ResetNeeded(
                f"The episodes of the humanoids {np.flatnonzero(self._ended).tolist()} have ended: call reset(), or "
                'reset(options={"reset_mask": mask}) for these only, before the next step.'
            )

    def _ids_of_mask(self, mask: Any) -> NDArray[np.int64]:
        if mask is None:
            return np.arange(self.num_envs)
        mask = np.asarray(mask)
        if mask.dtype != bool or mask.shape != (self.num_envs,) or not mask.any():
            raise ValueError(
                f"options['reset_mask'] must be a boolean array of shape ({self.num_envs},) with at least one True, "
                f"got {mask!r}."
            )
        return np.flatnonzero(mask)

    def _start_episodes(self, ids: NDArray[np.int64], options: dict[str, Any]) -> None:
        """Put some humanoids into start states, as `options` say."""
        placements = self.scene.placements(options.get("placement"), self._placements)
        qpos, qvel = self.start_states(len(ids), options.get("initial_state", self.initial_state))
        if self.scene:
            qpos, qvel = self.scene.place(qpos, qvel, placements, self.reset_noise_scale, self.np_random)
        self.simulation.reset(ids, qpos, qvel)
        bodies = self.simulation
        self.proprioception[ids] = observe(
            bodies.body_positions[ids],
            bodies.body_quaternions[ids],
            bodies.body_linear_velocities[ids],
            bodies.body_angular_velocities[ids],
        )
        self.object_vectors[ids] = object_vectors(self.simulation, ids)
        self._elapsed[ids] = 0
        self._ended[ids] = False
        self.begin_episodes(ids, options)

    def _execute(
        self, decoder: ActionDecoder, commands: FloatArray, running: NDArray[np.bool_]
    ) -> tuple[dict[str, NDArray[Any]], NDArray[np.bool_]]:
        """Run the controller steps of one action; returns `info` without masks, and who terminated."""
        commands = np.where(running[:, None], commands, np.float32(0))
        terminated = np.zeros(self.num_envs, bool)
        diverged = np.zeros(self.num_envs, bool)
        executed = np.zeros(self.num_envs, np.int64)
        sums: dict[str, NDArray[np.float64]] = {}
        records: list[tuple[FloatArray, NDArray[np.float64], FloatArray]] = []
        commands = self.begin_decision(commands, running)
        for _ in range(decoder.controller_steps):
            targets = decoder.targets(self.proprioception, commands)
            broken = self.simulation.step(targets, None if running.all() else running) & running
            self.proprioception = self.simulation.observation()
            self.object_vectors = object_vectors(self.simulation)
            executed += running
            self._elapsed += running
            # A diverged simulation stands in the rest pose again: nothing that it shows deserves a reward.
            counted = running & ~broken
            for key, value in reward_entries(self.compute_reward(commands)).items():
                sums[key] = sums.get(key, 0.0) + np.where(counted, value, 0.0)
            diverged |= broken
            terminated |= running & (broken | self.has_ended())
            running = running & ~terminated
            if self._controller_step_limit is not None:
                running &= self._elapsed < self._controller_step_limit
            if self.record_controller_steps:
                records.append((self.proprioception, self.simulation.poses.copy(), self.object_vectors))
            if self._viewer is not None:
                self._viewer.show(self.simulation.poses[0])
        self.end_decision(executed)
        self._reward_keys = tuple(sums)
        info: dict[str, NDArray[Any]] = state_entries(self.simulation, self.object_vectors)
        info |= {key: value / np.maximum(executed, 1) for key, value in sums.items()}
        info |= {"diverged": diverged, "controller_steps": executed} | decoder.info(commands) | self.extra_info()
        if self.record_controller_steps:
            info["controller_observations"] = np.stack([observation for observation, _, _ in records], 1)
            info["controller_qpos"] = np.stack([pose for _, pose, _ in records], 1)
            if self.scene:
                info["controller_objects"] = np.stack([vectors for _, _, vectors in records], 1)
        return info, terminated

    def _info_after_reset(self, decoder: ActionDecoder) -> dict[str, NDArray[Any]]:
        """The keys of :meth:`_execute` for humanoids that have not acted yet: their state, and zeros."""
        count = self.num_envs
        commands = decoder.commands(np.zeros((count, *decoder.space.shape), np.float32))
        if not self._reward_keys:
            self._reward_keys = tuple(reward_entries(self.compute_reward(commands)))
        info = state_entries(self.simulation, self.object_vectors)
        info |= {key: np.zeros(count) for key in self._reward_keys}
        info |= {"diverged": np.zeros(count, bool), "controller_steps": np.zeros(count, np.int64)}
        info |= {key: np.zeros_like(value) for key, value in decoder.info(commands).items()}
        info |= {key: np.zeros_like(value) for key, value in self.extra_info().items()}
        if self.record_controller_steps:
            info["controller_observations"] = np.zeros((count, decoder.controller_steps, OBSERVATION_SIZE), np.float32)
            info["controller_qpos"] = np.zeros((count, decoder.controller_steps, self.simulation.pose_size))
            if self.scene:
                shape = (count, decoder.controller_steps, self.scene.state_size)
                info["controller_objects"] = np.zeros(shape, np.float32)
        return info


def _autoreset_mode(mode: AutoresetMode | str) -> AutoresetMode:
    try:
        return AutoresetMode(mode)
    except ValueError:
        names = ", ".join(repr(member.value) for member in AutoresetMode)
        raise ValueError(f"autoreset_mode must be one of {names}, got {mode!r}.") from None
