"""The part of PPO (Schulman et al. 2017) that the stages of controller training share.

Stable-Baselines3 trains the high level; here the actor is a residual or a frozen-encoder policy in bfloat16 on thousands
of humanoid-steps per second, for which its rollout buffer and float32 networks are too slow on two cores.
"""

from dataclasses import dataclass

import numpy as np
import torch
from torch import nn

from agents.controller.losses import clipped_surrogate
from agents.controller.networks import fast_arithmetic
from motion_data.skeleton import JOINT_NAMES

# Exploration by joint, radians: hips and abdomen move the whole body, so they get less.
JOINT_NOISE = torch.tensor([0.05 if name.split("_")[-2] in ("abdomen", "hip") else 0.08 for name in JOINT_NAMES])


@dataclass(frozen=True)
class PPOSettings:
    """What the update needs to know."""

    epochs: int = 4
    """Passes over the samples per update."""
    minibatch: int = 2048
    """Samples per gradient step."""
    learning_rate: float = 3e-4
    """First learning rate of the actor; it adapts to the divergence."""
    target_divergence: float = 0.08
    """Kullback-Leibler divergence per update that the learning rate aims at."""
    discount: float = 0.95
    """Discount factor."""
    trace: float = 0.9
    """Lambda of generalised advantage estimation."""
    clip: float = 0.2
    """Clipping of the probability ratio."""
    exploration: float = 0.75
    """Factor on the per-joint exploration noise (0.05 to 0.08 rad)."""


@dataclass
class Rollout:
    """Samples of one update, flat: ``(samples, ...)``."""

    actor_inputs: torch.Tensor
    critic_inputs: torch.Tensor
    means: torch.Tensor
    actions: torch.Tensor
    advantages: torch.Tensor
    returns: torch.Tensor
    neighbours: torch.Tensor | None = None
    """Mean of the actions before and after each; see :func:`neighbouring_means`. Needed for smoothness."""
    labels: torch.Tensor | None = None
    """What a teacher would do. Needed for imitation."""


def neighbouring_means(means: torch.Tensor, ends: torch.Tensor) -> torch.Tensor:
    """Mean of the means one step before and one step after, ``(steps, n, 28)``; where either is missing, the mean itself.

    Args:
        means: Means of the policy, ``(steps, n, 28)``.
        ends: 1 where an episode ended with the step, ``(steps, n)``.
    """
    neighbours = means.clone()
    whole = (ends[:-2] + ends[1:-1] == 0)[..., None]
    neighbours[1:-1] = torch.where(whole, 0.5 * (means[:-2] + means[2:]), means[1:-1])
    return neighbours


def generalised_advantages(
    rewards: torch.Tensor, values: torch.Tensor, ends: torch.Tensor, settings: PPOSettings
) -> tuple[torch.Tensor, torch.Tensor]:
    """Generalised advantage estimation (Schulman et al. 2016).

    Args:
        rewards: ``(steps, n)``.
        values: Of the states before each step and after the last, ``(steps + 1, n)``.
        ends: 1 where an episode ended with the step, ``(steps, n)``.
        settings: Discount and lambda.

    Returns:
        Normalised advantages and returns, each flat ``(steps * n,)``.
    """
    advantages = torch.empty_like(rewards)
    running = torch.zeros_like(rewards[0])
    for step in reversed(range(len(rewards))):
        alive = 1 - ends[step]
        surprise = rewards[step] + settings.discount * alive * values[step + 1] - values[step]
        running = surprise + settings.discount * settings.trace * alive * running
        advantages[step] = running
    returns = (advantages + values[:-1]).flatten()
    flat = advantages.flatten()
    return (flat - flat.mean()) / (flat.std() + 1e-6), returns


class PPO:
    """Actor and critic with their optimisers.

    Args:
        actor: Inputs to mean PD targets or residuals, ``(n, 28)``.
        critic: Inputs to values, ``(n, 1)``.
        settings: Settings of the update.
        effort: Weight of the squared mean action (in units of 0.08 rad): the smallest correction that works.
        smoothness: Weight of the squared distance of a mean action from those around it (in units of 0.08 rad). A policy
            that trembles pays; one that moves steadily does not. After CAPS (Mysore et al. 2021), whose temporal term
            compares with the next action alone and so punishes motion too.
        imitation: Weight of the distance of a mean action from the teacher's (in units of 0.08 rad; squares below 0.05
            rad). After kickstarting (Schmitt et al. 2018): what is learned anew costs nothing of what the teacher can do.

    Attributes:
        learning_rate: Current learning rate of the actor.
        target_divergence: What it aims at; a trainer may lower it as it goes.
    """

    def __init__(
        self,
        actor: nn.Module,
        critic: nn.Module,
        settings: PPOSettings,
        effort: float = 0.0,
        smoothness: float = 0.0,
        imitation: float = 0.0,
    ):
        self.actor, self.critic, self.settings, self._effort = actor, critic, settings, effort
        self._smoothness, self._imitation = smoothness, imitation
        self.noise = JOINT_NOISE * settings.exploration
        self.learning_rate = settings.learning_rate
        self.target_divergence = settings.target_divergence
        self.actor_optimizer = torch.optim.Adam(actor.parameters(), lr=self.learning_rate, fused=True)
        self.critic_optimizer = torch.optim.Adam(critic.parameters(), lr=1e-3, fused=True)

    def state(self) -> dict[str, object]:
        """What a checkpoint needs beside the networks."""
        return {
            "actor_optimizer": self.actor_optimizer.state_dict(),
            "critic_optimizer": self.critic_optimizer.state_dict(),
            "learning_rate": self.learning_rate,
        }

    def restore(self, state: dict[str, object]) -> None:
        """Takes up what :meth:`state` returned."""
        self.actor_optimizer.load_state_dict(state["actor_optimizer"])  # type: ignore[arg-type]
        self.critic_optimizer.load_state_dict(state["critic_optimizer"])  # type: ignore[arg-type]
        self.learning_rate = float(state["learning_rate"])  # type: ignore[arg-type]

    def learn(self, rollout: Rollout, update_actor: bool = True) -> float:
        """One update; returns the divergence of the new policy from the old."""
        settings = self.settings
        divergences: list[float] = []
        for _ in range(settings.epochs):
            for batch in torch.randperm(len(rollout.returns)).split(settings.minibatch):
                with fast_arithmetic():
                    value = self.critic(rollout.critic_inputs[batch]).float()[:, 0]
                _descend(self.critic_optimizer, (value - rollout.returns[batch]).square().mean())
                if not update_actor:
                    continue
                with fast_arithmetic():
                    mean = self.actor(rollout.actor_inputs[batch]).float()
                old, action, advantage = rollout.means[batch], rollout.actions[batch], rollout.advantages[batch]
                loss = clipped_surrogate(mean, old, action, advantage, self.noise, settings.clip).mean()
                if self._effort:
                    loss = loss + self._effort * (mean / 0.08).square().mean()
                if self._smoothness:
                    assert rollout.neighbours is not None, "smoothness needs the neighbouring means"
                    away = (mean - rollout.neighbours[batch]) / 0.08
                    loss = loss + self._smoothness * away.square().mean()
                if self._imitation:
                    assert rollout.labels is not None, "imitation needs the teacher's actions"
                    apart = nn.functional.smooth_l1_loss(mean, rollout.labels[batch], beta=0.05)
                    loss = loss + self._imitation * apart / 0.08
                _descend(self.actor_optimizer, loss, self.actor)
                divergences.append(float(0.5 * ((mean.detach() - old) / self.noise).square().sum(-1).mean()))
        divergence = float(np.mean(divergences[-4:])) if divergences else 0.0
        self._adapt(divergence)
        return divergence

    def _adapt(self, divergence: float) -> None:
        if divergence > 2 * self.target_divergence:
            self.learning_rate = max(self.learning_rate / 1.3, 3e-6)
        elif 0 < divergence < self.target_divergence / 2:
            self.learning_rate = min(self.learning_rate * 1.3, 1e-3)
        for group in self.actor_optimizer.param_groups:
            group["lr"] = self.learning_rate


def _descend(optimizer: torch.optim.Optimizer, loss: torch.Tensor, clipped: nn.Module | None = None) -> None:
    optimizer.zero_grad()
    loss.backward()
    if clipped is not None:
        nn.utils.clip_grad_norm_(clipped.parameters(), 1.0)
    optimizer.step()
