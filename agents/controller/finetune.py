"""Stage 3: fine-tune the distilled controller by PPO under random latents, switches and pushes; the encoder stays.

Distillation copies what the teacher does where the teacher has been; here the controller itself learns to keep its feet
under changes of intent and disturbances, while the tracking reward keeps its skills.
"""

import copy
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn

from agents.controller.evaluate import evaluate_random
from agents.controller.networks import Normalizer, fast_arithmetic, mlp
from agents.controller.ppo import PPO, PPOSettings, Rollout, generalised_advantages
from agents.controller.reference import ReferenceMotions
from agents.controller.stage import Stage
from agents.controller.student import Student
from agents.controller.tracking import TRACKING_SIZE, Tracking, TrackingConfig
from anyskill_envs.controller import LATENT_SIZE
from anyskill_envs.observation import OBSERVATION_SIZE

_CRITIC_INPUT = TRACKING_SIZE + LATENT_SIZE


@dataclass(frozen=True)
class FinetuneConfig:
    """Settings of fine-tuning."""

    minutes: float = 15.0
    """Training time in minutes, over all sessions."""
    num_humanoids: int = 512
    """Humanoids simulated at once."""
    horizon: int = 16
    """Controller steps per update."""
    latent_noise: float = 0.3
    """Length of the random vector added to a latent before it is normalised again."""
    critic_seconds: float = 40.0
    """The critic learns alone for so long."""
    seed: int = 0
    """Seed of everything random."""
    threads: int = 0
    """Threads for physics and learning; 0 for one per CPU."""
    ppo: PPOSettings = field(
        default_factory=lambda: PPOSettings(
            learning_rate=1e-4, target_divergence=0.03, discount=0.97, trace=0.93, exploration=0.5, epochs=3
        )
    )
    """Settings of the update."""
    tracking: TrackingConfig = field(
        default_factory=lambda: TrackingConfig(
            failure_distance=0.6,
            episode_steps=300,
            grace_steps=45,
            mean_holds=(3, 5, 15, 60, 200),
            unsettled=0.6,
        )
    )
    """How episodes run: more switches and pushes than in the stages before."""


class FinetuneTrainer(Stage):
    """PPO on the student's policy, resumable from its checkpoint.

    Args:
        student: The distilled controller.
        motions: The reference motions.
        folder: Where the checkpoint ``finetuned.pt`` lives.
        config: Settings.
    """

    def __init__(self, student: Student, motions: ReferenceMotions, folder: Path, config: FinetuneConfig):
        super().__init__(folder / "finetuned.pt", config.minutes, config.seed, config.threads)
        self.config, self.motions = config, motions
        self.student = copy.deepcopy(student)
        self.critic_normalizer = Normalizer(_CRITIC_INPUT)
        self.critic = mlp([_CRITIC_INPUT, 512, 512, 1])
        self.ppo = PPO(self.student.policy.network, self.critic, config.ppo, effort=0.0)
        if self.checkpoint:
            self.student.load_state_dict(self.checkpoint["model"])
            self.critic.load_state_dict(self.checkpoint["critic"])
            self.critic_normalizer.load_state_dict(self.checkpoint["critic_normalizer"])
            self.ppo.restore(self.checkpoint)
        self.tracking = Tracking(motions, config.num_humanoids, self.rng, config.tracking, config.threads)
        self._latent = torch.zeros(config.num_humanoids, LATENT_SIZE)

    def state(self) -> dict[str, Any]:
        """Networks and optimisers."""
        return {
            "model": self.student.state_dict(),
            "critic": self.critic.state_dict(),
            "critic_normalizer": self.critic_normalizer.state_dict(),
            **self.ppo.state(),
        }

    def train(self) -> Student:
        """Trains until the time is used up."""
        self.run()
        return self.student

    def update(self) -> dict[str, float]:
        """One rollout and one update of PPO."""
        rollout, reward, failures = self._collect()
        divergence = self.ppo.learn(rollout, update_actor=self.seconds > self.config.critic_seconds)
        self.samples += len(rollout.returns)
        return {"reward": reward, "failures": failures, "divergence": divergence}

    def inspect(self) -> dict[str, float]:
        """Falls under random latents of standing clips."""
        return {"falls under random latents": evaluate_random(self.student, self.student, self.motions, episodes=100)}

    def _critic_input(self) -> torch.Tensor:
        raw = torch.cat([torch.from_numpy(self.tracking.policy_input()), self._latent * LATENT_SIZE**0.5], 1)
        self.critic_normalizer.update(raw)
        return self.critic_normalizer(raw)

    def _renew_latents(self) -> None:
        renewed = np.flatnonzero(self.tracking.renewed)
        if not len(renewed):
            return
        windows = torch.from_numpy(self.motions.windows(self.tracking.window[renewed]))
        with fast_arithmetic():
            latent = self.student.encoder(windows)
        latent = latent + self.config.latent_noise * torch.randn_like(latent) / LATENT_SIZE**0.5
        self._latent[renewed] = nn.functional.normalize(latent, dim=-1)

    @torch.no_grad()
    def _collect(self) -> tuple[Rollout, float, float]:
        config, tracking, policy = self.config, self.tracking, self.student.policy
        steps, n, discount = config.horizon, config.num_humanoids, config.ppo.discount
        inputs = torch.empty(steps, n, OBSERVATION_SIZE + LATENT_SIZE, dtype=torch.bfloat16)
        critic_inputs = torch.empty(steps, n, _CRITIC_INPUT, dtype=torch.bfloat16)
        means, actions = torch.empty(steps, n, 28), torch.empty(steps, n, 28)
        values, rewards, ends = torch.empty(steps + 1, n), torch.empty(steps, n), torch.empty(steps, n)
        failures = 0.0
        for step in range(steps):
            self._renew_latents()
            observation = policy.normalizer(torch.from_numpy(tracking.observation))
            inputs[step] = torch.cat([observation, self._latent * LATENT_SIZE**0.5], 1)
            critic_inputs[step] = self._critic_input()
            with fast_arithmetic():
                means[step] = policy.network(inputs[step]).float()
                values[step] = self.critic(critic_inputs[step]).float()[:, 0]
            actions[step] = means[step] + self.ppo.noise * torch.randn(n, 28)
            reward, failed, truncated = tracking.step(actions[step].numpy())
            rewards[step] = torch.from_numpy(reward) * (1 - discount)
            rewards[step] += discount * values[step] * torch.from_numpy(truncated)
            ends[step] = torch.from_numpy(failed | truncated)
            failures += float(failed.mean()) / steps
        with fast_arithmetic():
            values[steps] = self.critic(self._critic_input()).float()[:, 0]
        advantages, returns = generalised_advantages(rewards, values, ends, config.ppo)
        rollout = Rollout(
            inputs.flatten(0, 1),
            critic_inputs.flatten(0, 1),
            means.flatten(0, 1),
            actions.flatten(0, 1),
            advantages,
            returns,
        )
        return rollout, float(rewards.mean()) / (1 - discount), failures
