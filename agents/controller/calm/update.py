"""PPO's update with the motion encoder in the loop: the encoder learns from the policy's and the critic's loss."""

from dataclasses import dataclass

import numpy as np
import torch
from torch import nn

from agents.controller.calm.config import CalmConfig
from agents.controller.calm.demonstrations import Demonstrations
from agents.controller.calm.losses import bound_loss
from agents.controller.losses import alignment_loss, clipped_surrogate, uniformity_loss
from agents.controller.networks import fast_arithmetic
from agents.controller.ppo import PPO
from agents.controller.student import Student
from anyskill_envs.controller import LATENT_SIZE
from motion_data.skeleton import JOINT_NAMES, joint_limits


def target_range() -> tuple[torch.Tensor, torch.Tensor]:
    """Middle and half-width of each joint's range of PD targets in the released code, each ``(28,)`` radians.

    Joints with three hinges: symmetric, 1.2 times the largest limit of the three, at most pi. Elbows and knees: 1.4 times
    the range of the hinge.
    """
    limits = joint_limits()
    centre, reach = limits.mean(1), 0.7 * (limits[:, 1] - limits[:, 0])
    joints = [name.rsplit("_", 1)[0] for name in JOINT_NAMES]
    for index, name in enumerate(JOINT_NAMES):
        if name.endswith(("_x", "_y", "_z")):
            own = [joint == joints[index] for joint in joints]
            centre[index], reach[index] = 0.0, min(1.2 * np.abs(limits[own]).max(), np.pi)
    return torch.from_numpy(centre).float(), torch.from_numpy(reach).float()


@dataclass
class ImitationRollout:
    """Samples of one update, flat: ``(samples, ...)``."""

    observations: torch.Tensor
    """Normalised observations, ``(samples, 223)``."""
    windows: torch.Tensor
    """First frame of the window whose latent was followed, ``(samples,)``."""
    noisy: torch.Tensor
    """Whether the action was drawn, ``(samples,)``; a mean that was executed says nothing about the policy's gradient."""
    means: torch.Tensor
    actions: torch.Tensor
    advantages: torch.Tensor
    returns: torch.Tensor


def policy_input(observations: torch.Tensor, latents: torch.Tensor) -> torch.Tensor:
    """Input of the policy's network and of the critic: ``(n, 223)`` and ``(n, 64)`` to ``(n, 287)``."""
    return torch.cat([observations, latents * LATENT_SIZE**0.5], 1)


class JointPPO(PPO):
    """PPO on encoder, policy and critic with one loss.

    Args:
        student: Encoder and policy.
        critic: :func:`policy_input` to values, ``(n, 1)``.
        config: Settings.
        demonstrations: Where windows come from.
    """

    def __init__(self, student: Student, critic: nn.Module, config: CalmConfig, demonstrations: Demonstrations):
        super().__init__(student, critic, config.ppo, effort=0.0)
        self._student, self._config, self._demonstrations = student, config, demonstrations
        self._centre, self._reach = target_range()
        if config.action_log_std is not None:
            self.noise = self._reach * np.exp(config.action_log_std)
        for group in self.critic_optimizer.param_groups:
            group["lr"] = config.critic_rate

    def learn_jointly(
        self, rollout: ImitationRollout, rng: np.random.Generator, update_actor: bool = True
    ) -> dict[str, float]:
        """One update: total loss = PPO + 5 critic + 10 bound + 0.1 (alignment + 0.5 uniformity) by default.

        Args:
            rollout: The samples.
            rng: Source of the windows for the encoder's losses.
            update_actor: Whether policy and encoder learn too; the critic always does.

        Returns:
            Means of ``divergence`` (of the new policy from the old, last pass), ``alignment`` and ``uniformity``.
        """
        figures: list[tuple[float, float, float]] = []
        batches = 0
        for _ in range(self.settings.epochs):
            order = torch.randperm(len(rollout.returns)).split(self.settings.minibatch)
            batches = len(order)
            for batch in order:
                figures.append(self._step(rollout, batch, rng, update_actor))
        divergence = float(np.mean([figure[0] for figure in figures[-batches:]])) if update_actor else 0.0
        if self._config.adaptive_rate and update_actor:
            self._adapt(divergence)
        _, alignment, uniformity = np.mean(figures, 0)
        return {"divergence": divergence, "alignment": float(alignment), "uniformity": float(uniformity)}

    def _step(
        self, rollout: ImitationRollout, batch: torch.Tensor, rng: np.random.Generator, update_actor: bool
    ) -> tuple[float, float, float]:
        config = self._config
        # Many samples share a window: encode each window once.
        windows, place = rollout.windows[batch].unique(return_inverse=True)
        with torch.set_grad_enabled(update_actor), fast_arithmetic():
            latents = self._encode(windows)[place]
            inputs = policy_input(rollout.observations[batch].float(), latents)
            mean = self._student.policy.network(inputs).float()
        with fast_arithmetic():
            value = self.critic(inputs).float()[:, 0]
        loss = config.critic_weight * (value - rollout.returns[batch]).square().mean()
        alignment, uniformity = self._encoder_losses(rng)
        old, noisy = rollout.means[batch], rollout.noisy[batch]
        if update_actor:
            surrogate = clipped_surrogate(
                mean, old, rollout.actions[batch], rollout.advantages[batch], self.noise, self.settings.clip
            )
            own = surrogate + config.bound_weight * bound_loss(mean, self._centre, self._reach)
            loss = loss + (own * noisy).sum() / noisy.sum().clamp_min(1)
            loss = loss + config.encoder_weight * (config.alignment * alignment + config.uniformity * uniformity)
        self.actor_optimizer.zero_grad()
        self.critic_optimizer.zero_grad()
        loss.backward()
        if update_actor:
            if config.max_gradient is not None:
                nn.utils.clip_grad_norm_(self._student.parameters(), config.max_gradient)
            self.actor_optimizer.step()
        self.critic_optimizer.step()
        divergence = 0.5 * ((mean.detach() - old) / self.noise).square().sum(-1).mean()
        return float(divergence), float(alignment.detach()), float(uniformity.detach())

    def _encoder_losses(self, rng: np.random.Generator) -> tuple[torch.Tensor, torch.Tensor]:
        demonstrations, count = self._demonstrations, self._config.encoder_batch
        windows = demonstrations.windows(rng, count)
        later = demonstrations.later_windows(rng, windows)
        with fast_arithmetic():
            latents = self._encode(torch.from_numpy(np.concatenate([windows, later])))
        return alignment_loss(latents[:count], latents[count:]), uniformity_loss(latents[:count])

    def _encode(self, windows: torch.Tensor) -> torch.Tensor:
        return self._student.encoder.encode_flat(self._demonstrations.window_inputs[windows])
