"""Stage 1: one tracking policy for all clips, by PPO.

The policy corrects a feed-forward PD target: ``target = reference + 0.05 s * reference velocity + residual``. It sees the
reference, so it is the teacher of the latent-conditioned controller (:mod:`agents.controller.distill`), not the product.
"""

import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors.torch import load_file
from torch import nn
from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn

from agents.controller.networks import Normalizer, fast_arithmetic, mlp
from agents.controller.ppo import PPO, PPOSettings, Rollout, generalised_advantages, neighbouring_means
from agents.controller.reference import ReferenceMotions
from agents.controller.stage import Stage
from agents.controller.tracking import TRACKING_SIZE, Tracking, TrackingConfig


@dataclass(frozen=True)
class TeacherConfig:
    """Settings of PPO (Schulman et al. 2017) for motion tracking, chosen for two cores."""

    minutes: float = 60.0
    """Training time in minutes, over all sessions."""
    num_humanoids: int = 512
    """Humanoids simulated at once."""
    horizon: int = 16
    """Controller steps per update."""
    hidden: tuple[int, ...] = (512, 512)
    """Widths of actor and critic."""
    ppo: PPOSettings = field(default_factory=PPOSettings)
    """Settings of the update."""
    averaging: float = 0.98
    """Decay of the running mean of the weights, per update: single updates gain one clip and lose another for a while."""
    smoothness: float = 0.05
    """Weight of the loss on trembling; see :class:`agents.controller.ppo.PPO`."""
    settling: float = 0.25
    """Last share of the time, in which updates are smaller: two dances and the run were only then performed whole."""
    settling_divergence: float = 0.03
    """Divergence per update that the learning rate aims at in that time."""
    seed: int = 0
    """Seed of everything random."""
    threads: int = 0
    """Threads for physics and learning; 0 for one per CPU."""
    initial: Path | None = None
    """Weights (safetensors) to begin with when there is no checkpoint yet."""
    tracking: TrackingConfig = field(default_factory=TrackingConfig)
    """How episodes run."""


class Teacher(nn.Module):
    """The tracking policy: normalised input to a residual on the feed-forward targets."""

    def __init__(self, hidden: tuple[int, ...] = (512, 512)):
        super().__init__()
        self.hidden = tuple(hidden)
        self.normalizer = Normalizer(TRACKING_SIZE)
        self.actor = mlp([TRACKING_SIZE, *hidden, 28], final_scale=0.01)
        self.critic = mlp([TRACKING_SIZE, *hidden, 1])

    @torch.no_grad()
    def targets(self, tracking: Tracking) -> np.ndarray:
        """Deterministic PD targets for the humanoids of a tracking task, float32 ``(n, 28)``."""
        with fast_arithmetic():
            residual = self.actor(self.normalizer(torch.from_numpy(tracking.policy_input()))).float().numpy()
        return tracking.targets(residual).astype(np.float32)

    @classmethod
    def load(cls, path: Path) -> "Teacher":
        """Reads the teacher of a training checkpoint: the running mean of its weights."""
        state = torch.load(path, weights_only=True)
        teacher = cls(tuple(state["hidden"]))
        if "averaged" not in state:
            teacher.load_state_dict(state["model"])
            return teacher
        averaged = AveragedModel(teacher)
        averaged.load_state_dict(state["averaged"])
        return averaged.module  # type: ignore[return-value]


class TeacherTrainer(Stage):
    """PPO on :class:`Tracking`, resumable from its checkpoint.

    Args:
        motions: The reference motions; they may change between sessions.
        folder: Where the checkpoint ``teacher.pt`` lives.
        config: Settings.
    """

    def __init__(self, motions: ReferenceMotions, folder: Path, config: TeacherConfig):
        super().__init__(folder / "teacher.pt", config.minutes, config.seed, config.threads)
        self.config = config
        self.teacher = Teacher(config.hidden)
        self.ppo = PPO(self.teacher.actor, self.teacher.critic, config.ppo, effort=1e-3, smoothness=config.smoothness)
        if self.checkpoint:
            self.teacher.load_state_dict(self.checkpoint["model"])
            self.ppo.restore(self.checkpoint)
        elif config.initial:
            self.teacher.load_state_dict(load_file(config.initial))
        self._averaged = AveragedModel(self.teacher, multi_avg_fn=get_ema_multi_avg_fn(config.averaging))
        if self.checkpoint and "averaged" in self.checkpoint:
            self._averaged.load_state_dict(self.checkpoint["averaged"])
        self.tracking = Tracking(motions, config.num_humanoids, self.rng, config.tracking, config.threads)
        if self.checkpoint:
            self.tracking.restore_failures(self.checkpoint.get("failures", {}))

    @property
    def averaged(self) -> Teacher:
        """The policy with the running mean of the weights: what training yields."""
        teacher = self._averaged.module
        assert isinstance(teacher, Teacher)
        return teacher

    def state(self) -> dict[str, Any]:
        """Networks and optimisers."""
        return {
            "hidden": list(self.config.hidden),
            "model": self.teacher.state_dict(),
            "averaged": self._averaged.state_dict(),
            **self.ppo.state(),
            "failures": self.tracking.failures_by_name(),
        }

    def train(self) -> Teacher:
        """Trains until the time is used up."""
        self.run()
        return self.averaged

    def update(self) -> dict[str, float]:
        """One rollout and one update of PPO."""
        config, teacher, tracking, ppo = self.config, self.teacher, self.tracking, self.ppo
        steps, n, discount = config.horizon, config.num_humanoids, config.ppo.discount
        inputs = torch.empty(steps, n, TRACKING_SIZE, dtype=torch.bfloat16)
        means, actions = torch.empty(steps, n, 28), torch.empty(steps, n, 28)
        values, rewards, ends = torch.empty(steps + 1, n), torch.empty(steps, n), torch.empty(steps, n)
        failures = 0.0
        if self.seconds > (1 - config.settling) * self.budget:
            ppo.target_divergence = config.settling_divergence
        begin = time.monotonic()
        for step in range(steps):
            raw = torch.from_numpy(tracking.policy_input())
            if step % 4 == 0:
                teacher.normalizer.update(raw)
            with torch.no_grad(), fast_arithmetic():
                inputs[step] = normal = teacher.normalizer(raw)
                means[step] = teacher.actor(normal).float()
                values[step] = teacher.critic(normal).float()[:, 0]
            actions[step] = means[step] + ppo.noise * torch.randn(n, 28)
            reward, failed, truncated = tracking.step(tracking.targets(actions[step].numpy()))
            # Scaled so that values lie in [0, 1]; a truncated episode is worth what the critic expects of its state.
            rewards[step] = torch.from_numpy(reward) * (1 - discount)
            rewards[step] += discount * values[step] * torch.from_numpy(truncated)
            ends[step] = torch.from_numpy(failed | truncated)
            failures += failed.mean() / steps
        with torch.no_grad(), fast_arithmetic():
            values[steps] = teacher.critic(teacher.normalizer(torch.from_numpy(tracking.policy_input()))).float()[:, 0]
        rolled = time.monotonic()
        advantages, returns = generalised_advantages(rewards, values, ends, config.ppo)
        flat = inputs.flatten(0, 1)
        neighbours = neighbouring_means(means, ends).flatten(0, 1)
        rollout = Rollout(flat, flat, means.flatten(0, 1), actions.flatten(0, 1), advantages, returns, neighbours)
        # The critic gets a first estimate of the values before the actor follows them.
        divergence = ppo.learn(rollout, update_actor=self.samples >= 60_000)
        self._averaged.update_parameters(teacher)
        self.samples += steps * n
        return {
            "reward": float(rewards.mean()) / (1 - discount),
            "failures": float(failures),
            "divergence": divergence,
            "rate": ppo.learning_rate,
            "rollout_s": rolled - begin,
            "learning_s": time.monotonic() - rolled,
        }
