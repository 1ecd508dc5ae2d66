"""Humanoids that imitate: episodes, latents that change, and the frames that the discriminator judges."""

import numpy as np

from agents.controller.calm.config import EpisodeConfig
from agents.controller.calm.demonstrations import Demonstrations
from agents.controller.calm.discriminator import head_height, imitation_features
from anyskill_envs.observation import OBSERVATION_SIZE
from anyskill_envs.simulation import HumanoidSimulation
from motion_data.skeleton import rest_qpos

_DROPPED = 128  # bodies dropped for starts on the floor
_DROP_STEPS = 75  # controller steps until they lie
_DROP_TARGETS = 0.5  # radians, random targets while they fall
_MATCHED_FRAMES = 30  # a matched start lies in the first second of its window


class Episodes:
    """Many humanoids under latents that are renewed at random times.

    Args:
        demonstrations: The reference motions.
        num_humanoids: How many run at once.
        rng: Source of all random draws.
        config: How episodes run.
        num_threads: Threads of the physics; 0 for one per CPU.

    Attributes:
        window: First frame of the window whose latent each humanoid follows, ``(n,)``.
        renewed: Humanoids whose window was renewed by the last step or reset, ``(n,)`` bool.
        observation: Current observations, float32 ``(n, 223)``.
        fall_height: Height of the centre of the head below which an episode ends, metres.
    """

    def __init__(
        self,
        demonstrations: Demonstrations,
        num_humanoids: int,
        rng: np.random.Generator,
        config: EpisodeConfig | None = None,
        num_threads: int = 0,
    ):
        self.config = config or EpisodeConfig()
        self._demonstrations, self._rng = demonstrations, rng
        self.simulation = HumanoidSimulation(num_humanoids, num_threads)
        self.fall_height = self.config.fall_height
        if self.config.fall_margin is not None:
            lowest = float(head_height(demonstrations.motions.observations).min())
            self.fall_height = max(self.fall_height, lowest - self.config.fall_margin)
        self._lying = self._drop() if self.config.fallen_starts else None
        n = num_humanoids
        self.window = np.zeros(n, int)
        self.renewed = np.ones(n, bool)
        self._age = np.zeros(n, int)
        self._hold_left = np.zeros(n, int)
        self._lenient = np.zeros(n, int)
        self.observation = np.zeros((n, OBSERVATION_SIZE), np.float32)
        length = int(demonstrations.offsets.max()) + 1
        self._history = np.zeros((n, length, demonstrations.features.shape[1]), np.float32)
        self.reset(np.arange(n))

    def _drop(self) -> np.ndarray:
        """Poses of bodies that lie on the floor, ``(128, 35)``."""
        qpos = np.tile(rest_qpos(), (_DROPPED, 1))
        # Normalised Gaussian quaternions are uniform over rotations.
        qpos[:, 3:7] = self._rng.standard_normal((_DROPPED, 4))
        qpos[:, 3:7] /= np.linalg.norm(qpos[:, 3:7], axis=1, keepdims=True)
        simulation = HumanoidSimulation(_DROPPED)
        simulation.reset(np.arange(_DROPPED), qpos)
        for _ in range(_DROP_STEPS):
            simulation.step(self._rng.uniform(-_DROP_TARGETS, _DROP_TARGETS, (_DROPPED, 28)))
        return simulation.qpos.copy()

    def reset(self, ids: np.ndarray) -> None:
        """Starts new episodes."""
        if not len(ids):
            return
        config, rng, demonstrations, count = self.config, self._rng, self._demonstrations, len(ids)
        motions = demonstrations.motions
        window = demonstrations.windows(rng, count)
        start = np.where(rng.random(count) < config.matched_starts, window, demonstrations.windows(rng, count))
        clips = motions.clip_of_frame[start]
        frame = motions.ahead(start, rng.integers(0, _MATCHED_FRAMES, count))
        qpos, qvel = motions.qpos[frame].copy(), motions.qvel[frame].copy()
        reference = rng.random(count) < config.reference_starts
        qpos[~reference], qvel[~reference] = rest_qpos(), 0
        qpos[:, 7:] += config.joint_noise * rng.standard_normal((count, 28))
        qvel += config.velocity_noise * rng.standard_normal(qvel.shape)
        lying = rng.random(count) < config.fallen_starts
        if self._lying is not None:
            qpos[lying] = self._lying[rng.integers(len(self._lying), size=int(lying.sum()))]
            qvel[lying] = 0
        self.simulation.reset(ids, qpos, qvel)
        self.observation[ids] = self.simulation.observation()[ids]
        # A start in a clip has a past, that of the clip; any other has stood or lain there.
        self._history[ids] = imitation_features(self.observation[ids], qvel[:, 6:])[:, None]
        from_clip = reference & ~lying
        past = demonstrations.past(clips[from_clip], frame[from_clip], np.arange(1, self._history.shape[1]))
        self._history[ids[from_clip], 1:] = past
        self._begin(ids, window)
        self._lenient[ids] = np.where(lying, config.recovery_steps, 0)

    def _begin(self, ids: np.ndarray, window: np.ndarray) -> None:
        self._age[ids] = 0
        self._hold_left[ids] = self._rng.integers(*self.config.hold_steps, len(ids))
        self.window[ids] = window
        self.renewed[ids] = True

    def step(self, targets: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Advances one controller step and starts new episodes where one ended.

        Args:
            targets: PD targets, ``(n, 28)`` radians.

        Returns:
            The transitions that the discriminator judges, float32 ``(n, frames, 125)``, newest frame first; fell
            ``(n,)`` bool; ended without a fall ``(n,)`` bool.
        """
        config, rng = self.config, self._rng
        diverged = self.simulation.step(targets)
        self.observation = self.simulation.observation()
        newest = imitation_features(self.observation, self.simulation.qvel[:, 6:])
        self._history = np.concatenate([newest[:, None], self._history[:, :-1]], 1)
        transitions = self._history[:, self._demonstrations.offsets]
        self._age += 1
        self._hold_left -= 1
        self._lenient = np.maximum(self._lenient - 1, 0)
        fell = diverged | ((head_height(self.observation) < self.fall_height) & (self._lenient == 0))
        truncated = ~fell & (self._age >= config.episode_steps)
        self.renewed = self._hold_left <= 0
        switching = np.flatnonzero(self.renewed)
        self.window[switching] = self._demonstrations.windows(rng, len(switching))
        self._hold_left[switching] = rng.integers(*config.hold_steps, len(switching))
        stays = fell & ~diverged & (rng.random(len(fell)) < config.recovery)
        lying = np.flatnonzero(stays)
        self._begin(lying, self._demonstrations.windows(rng, len(lying)))
        self._lenient[lying] = config.recovery_steps
        self.reset(np.flatnonzero((fell | truncated) & ~stays))
        return transitions, fell, truncated
