"""Stage 3: fine-tune the distilled controller by PPO under random latents, switches and pushes; the encoder stays.

Distillation copies what the teacher does where the teacher has been; here the controller itself learns to keep its feet
under changes of intent and disturbances, while the tracking reward keeps its skills.
"""

import copy
import logging
import os
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import torch
from rich.progress import Progress
from torch import nn

from agents.controller.evaluate import evaluate_random
from agents.controller.networks import Normalizer, fast_arithmetic, mlp
from agents.controller.ppo import PPO, PPOSettings, Rollout, generalised_advantages
from agents.controller.reference import ReferenceMotions
from agents.controller.student import Student
from agents.controller.tracking import TRACKING_SIZE, Tracking, TrackingConfig
from anyskill_envs.controller import LATENT_SIZE
from anyskill_envs.observation import OBSERVATION_SIZE

_LOG = logging.getLogger(__name__)
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
            switch_probabilities=(0.0, 0.1, 0.5, 1.0),
            push_probability=0.005,
        )
    )
    """How episodes run: more switches than in the stages before."""


class FinetuneTrainer:
    """PPO on the student's policy, resumable from its checkpoint.

    Args:
        student: The distilled controller.
        motions: The reference motions.
        folder: Where the checkpoint ``finetuned.pt`` lives.
        config: Settings.
    """

    def __init__(self, student: Student, motions: ReferenceMotions, folder: Path, config: FinetuneConfig):
        self.config, self.motions = config, motions
        self.path = folder / "finetuned.pt"
        torch.set_num_threads(config.threads or len(os.sched_getaffinity(0)))
        torch.manual_seed(config.seed)
        self.student = copy.deepcopy(student)
        self.critic_normalizer = Normalizer(_CRITIC_INPUT)
        self.critic = mlp([_CRITIC_INPUT, 512, 512, 1])
        self.ppo = PPO(self.student.policy.network, self.critic, config.ppo, effort=0.0)
        self.samples, self.seconds = 0, 0.0
        if self.path.exists():
            state = torch.load(self.path, weights_only=True)
            self.student.load_state_dict(state["model"])
            self.critic.load_state_dict(state["critic"])
            self.critic_normalizer.load_state_dict(state["critic_normalizer"])
            self.ppo.restore(state)
            self.samples, self.seconds = state["samples"], state["seconds"]
        rng = np.random.default_rng((config.seed, self.samples))
        self.tracking = Tracking(motions, config.num_humanoids, rng, config.tracking, config.threads)
        self._latent = torch.zeros(config.num_humanoids, LATENT_SIZE)

    def save(self) -> None:
        """Writes the checkpoint, whole or not at all."""
        temporary = self.path.with_suffix(".tmp")
        state = {
            "model": self.student.state_dict(),
            "critic": self.critic.state_dict(),
            "critic_normalizer": self.critic_normalizer.state_dict(),
            "samples": self.samples,
            "seconds": self.seconds,
            **self.ppo.state(),
        }
        torch.save(state, temporary)
        os.replace(temporary, self.path)

    def train(self) -> Student:
        """Trains until the time is used up; saves every minute."""
        budget, saved, update = 60 * self.config.minutes, time.monotonic(), 0
        with Progress() as progress:
            bar = progress.add_task("fine-tuning", total=budget, completed=int(self.seconds))
            while self.seconds < budget:
                start = time.monotonic()
                reward, failures, divergence = self._update()
                self.seconds += time.monotonic() - start
                update += 1
                text = f"fine-tuning: reward {reward:.3f}, failures {failures:.4f}/step"
                progress.update(bar, completed=self.seconds, description=text)
                if update % 20 == 0:
                    _LOG.info(
                        "%.0f s %.2f M samples %s divergence %.3f", self.seconds, self.samples / 1e6, text, divergence
                    )
                if update % 200 == 0:
                    falls = evaluate_random(self.student, self.student, self.motions, episodes=100)
                    _LOG.info("falls under random latents of standing clips: %.2f", falls)
                if time.monotonic() - saved > 60:
                    self.save()
                    saved = time.monotonic()
        self.save()
        return self.student

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

    def _update(self) -> tuple[float, float, float]:
        rollout, reward, failures = self._collect()
        divergence = self.ppo.learn(rollout, update_actor=self.seconds > self.config.critic_seconds)
        self.samples += len(rollout.returns)
        return reward, failures, divergence
