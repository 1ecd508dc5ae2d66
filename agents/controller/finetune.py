"""Stage 3: fine-tune the distilled controller by PPO under random latents, switches and pushes; the encoder stays.

Distillation copies what the teacher does, who sees the reference; here the controller itself learns to keep its feet while
intents are held, change, and pushes come. Tracking rewards it, and the teacher goes on showing what it would do.
"""

import copy
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn
from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn

from agents.controller.evaluate import evaluate_random
from agents.controller.networks import Normalizer, fast_arithmetic, mlp
from agents.controller.ppo import PPO, PPOSettings, Rollout, generalised_advantages, neighbouring_means
from agents.controller.reference import ReferenceMotions
from agents.controller.stage import Stage
from agents.controller.student import Student
from agents.controller.teacher import Teacher
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
    smoothness: float = 0.05
    """Weight of the loss on trembling; see :class:`agents.controller.ppo.PPO`."""
    imitation: float = 1.5
    """Weight of the loss on the distance from the teacher's actions; see :class:`agents.controller.ppo.PPO`."""
    averaging: float = 0.99
    """Decay of the running mean of the weights, per update."""
    share: float = 0.5
    """What training yields lies between the distilled weights (0) and that mean (1). In between, most of what
    fine-tuning gains is kept, and less of the skills is lost that it harms (Wortsman et al. 2022, "Robust fine-tuning")."""
    seed: int = 0
    """Seed of everything random."""
    threads: int = 0
    """Threads for physics and learning; 0 for one per CPU."""
    ppo: PPOSettings = field(
        default_factory=lambda: PPOSettings(
            learning_rate=1e-4, target_divergence=0.05, discount=0.98, trace=0.93, exploration=0.4, epochs=3
        )
    )
    """Settings of the update."""
    tracking: TrackingConfig = field(
        default_factory=lambda: TrackingConfig(
            failure_distance=0.5,
            episode_steps=300,
            grace_steps=45,
            mean_holds=(3, 5, 5, 60, 200, 200),
            unsettled=0.4,
            synchronise_after=15,
        )
    )
    """How episodes run: more switches and pushes than in the stages before."""


class FinetuneTrainer(Stage):
    """PPO on the student's policy, resumable from its checkpoint.

    Args:
        student: The distilled controller.
        teacher: The tracking policy it was distilled from.
        motions: The reference motions.
        folder: Where the checkpoint ``finetuned.pt`` lives.
        config: Settings.
    """

    def __init__(
        self, student: Student, teacher: Teacher, motions: ReferenceMotions, folder: Path, config: FinetuneConfig
    ):
        super().__init__(folder / "finetuned.pt", config.minutes, config.seed, config.threads)
        self.config, self.motions = config, motions
        self.student, self.teacher, self._distilled = copy.deepcopy(student), teacher, student
        self.critic_normalizer = Normalizer(_CRITIC_INPUT)
        self.critic = mlp([_CRITIC_INPUT, 512, 512, 1])
        network = self.student.policy.network
        self.ppo = PPO(network, self.critic, config.ppo, smoothness=config.smoothness, imitation=config.imitation)
        if self.checkpoint:
            self.student.load_state_dict(self.checkpoint["model"])
            self.critic.load_state_dict(self.checkpoint["critic"])
            self.critic_normalizer.load_state_dict(self.checkpoint["critic_normalizer"])
            self.ppo.restore(self.checkpoint)
        self.averaged = AveragedModel(self.student, multi_avg_fn=get_ema_multi_avg_fn(config.averaging))
        if self.checkpoint:
            self.averaged.load_state_dict(self.checkpoint["averaged"])
        self.tracking = Tracking(motions, config.num_humanoids, self.rng, config.tracking, config.threads)
        if self.checkpoint:
            self.tracking.restore_failures(self.checkpoint.get("failures", {}))
        self._latent = torch.zeros(config.num_humanoids, LATENT_SIZE)

    def state(self) -> dict[str, Any]:
        """Networks and optimisers."""
        return {
            "model": self.student.state_dict(),
            "averaged": self.averaged.state_dict(),
            "critic": self.critic.state_dict(),
            "critic_normalizer": self.critic_normalizer.state_dict(),
            **self.ppo.state(),
            "failures": self.tracking.failures_by_name(),
        }

    def train(self) -> Student:
        """Trains until the time is used up."""
        self.run()
        result = copy.deepcopy(self._distilled)
        with torch.no_grad():
            for value, tuned in zip(result.parameters(), self.averaged.module.parameters(), strict=True):
                value.lerp_(tuned, self.config.share)
        return result

    def update(self) -> dict[str, float]:
        """One rollout and one update of PPO."""
        rollout, reward, failures = self._collect()
        assert rollout.labels is not None
        error = float((rollout.means - rollout.labels).abs().mean())
        divergence = self.ppo.learn(rollout, update_actor=self.seconds > self.config.critic_seconds)
        self.averaged.update_parameters(self.student)
        self.samples += len(rollout.returns)
        return {"reward": reward, "failures": failures, "target error (rad)": error, "divergence": divergence}

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
        means, actions, labels = (torch.empty(steps, n, 28) for _ in range(3))
        upright = torch.empty(steps, n)
        values, rewards, ends = torch.empty(steps + 1, n), torch.empty(steps, n), torch.empty(steps, n)
        failures = 0.0
        for step in range(steps):
            self._renew_latents()
            observation = policy.normalizer(torch.from_numpy(tracking.observation))
            inputs[step] = torch.cat([observation, self._latent * LATENT_SIZE**0.5], 1)
            critic_inputs[step] = self._critic_input()
            labels[step] = torch.from_numpy(self.teacher.targets(tracking))
            upright[step] = torch.from_numpy(self.motions.upright[tracking.frame])
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
        # On the floor the teacher's labels alone teach: there exploration harms more than it finds.
        advantages *= upright.flatten()
        rollout = Rollout(
            inputs.flatten(0, 1),
            critic_inputs.flatten(0, 1),
            means.flatten(0, 1),
            actions.flatten(0, 1),
            advantages,
            returns,
            neighbouring_means(means, ends).flatten(0, 1),
            labels.flatten(0, 1),
        )
        return rollout, float(rewards.mean()) / (1 - discount), failures
