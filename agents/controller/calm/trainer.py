"""CALM: encoder, policy, critic and conditional discriminator, trained end to end."""

import json
import logging
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors.torch import load_file
from torch import nn

from agents.controller.calm.config import CalmConfig
from agents.controller.calm.demonstrations import Demonstrations
from agents.controller.calm.discriminator import IMITATION_FEATURES, Discriminator
from agents.controller.calm.episodes import Episodes
from agents.controller.calm.losses import discriminator_loss, gradient_penalty, squared_weights, style_reward
from agents.controller.calm.measure import measure, plot_curves
from agents.controller.calm.replay import Replay
from agents.controller.calm.update import ImitationRollout, JointPPO, policy_input
from agents.controller.networks import fast_arithmetic, mlp
from agents.controller.ppo import generalised_advantages
from agents.controller.reference import ReferenceMotions
from agents.controller.stage import Stage
from agents.controller.student import PolicyNetwork, Student
from anyskill_envs.controller import LATENT_SIZE
from anyskill_envs.observation import OBSERVATION_SIZE

_LOG = logging.getLogger(__name__)
_JUDGED_AT_ONCE = 8192


class CalmTrainer(Stage):
    """Adversarial imitation with latents, resumable from its checkpoint.

    Args:
        motions: The reference motions.
        folder: Where the checkpoint ``calm.pt``, ``history.json`` and ``curve.png`` live.
        config: Settings; those of the paper if None.
        weights: Probability of each clip, ``(clips,)``; equal ones if None.

    Attributes:
        student: Encoder and policy.
        discriminator: D(s, s' | z).
        history: Mean figures and measurements, one entry per ``measure_seconds``.

    Raises:
        ValueError: If the initial weights have other widths than the policy.
    """

    def __init__(
        self,
        motions: ReferenceMotions,
        folder: Path,
        config: CalmConfig | None = None,
        weights: np.ndarray | None = None,
    ):
        self.config = config = config or CalmConfig()
        super().__init__(folder / "calm.pt", config.minutes, config.seed, config.threads)
        self.motions = motions
        self.demonstrations = Demonstrations(
            motions, weights, config.offsets, config.window_overhang, config.other_clip
        )
        self.student = Student()
        self.student.policy = PolicyNetwork(config.hidden)
        self.critic = mlp([OBSERVATION_SIZE + LATENT_SIZE, *config.hidden, 1])
        self.discriminator = Discriminator(len(config.offsets), config.style_hidden, config.discriminator_hidden)
        self.history: list[dict[str, float]] = []
        self.ppo = JointPPO(self.student, self.critic, config, self.demonstrations)
        self.discriminator_optimizer = torch.optim.Adam(
            self.discriminator.parameters(), lr=config.discriminator_rate, fused=True
        )
        if self.checkpoint:
            self._restore(self.checkpoint)
        else:
            self._initialise()
        self.replay = Replay(config.replay, (len(config.offsets), IMITATION_FEATURES), config.replay_share)
        self.episodes = Episodes(self.demonstrations, config.num_humanoids, self.rng, config.episodes, config.threads)
        humanoid = np.linspace(0, 1, config.num_humanoids)
        self._exploring = 1 - np.exp(10 * (humanoid - 1)) if config.greedy_humanoids else np.ones(config.num_humanoids)
        self._latent = torch.zeros(config.num_humanoids, LATENT_SIZE)
        self._since: list[dict[str, float]] = []
        self._measured = self.seconds

    def _initialise(self) -> None:
        """Before the first update: normalisation by the clips, and a policy that holds their mean pose."""
        motions, student = self.motions, self.student
        if self.config.initial:
            try:
                student.load_state_dict(load_file(self.config.initial))
            except RuntimeError as error:
                raise ValueError(
                    f"'{self.config.initial}' does not fit a policy of widths {self.config.hidden}; the bundled weights fit "
                    "the laptop preset."
                ) from error
        else:
            student.encoder.normalizer.update(self.demonstrations.window_inputs)
            student.policy.normalizer.update(torch.from_numpy(motions.observations))
            last = student.policy.network[-1]
            assert isinstance(last, nn.Linear)
            with torch.no_grad():
                last.weight.mul_(0.1)
                last.bias.copy_(torch.from_numpy(motions.qpos[:, 7:].mean(0)))
        self.discriminator.normalizer.update(torch.from_numpy(self.demonstrations.features))

    def _restore(self, checkpoint: dict[str, Any]) -> None:
        self.student.load_state_dict(checkpoint["model"])
        self.critic.load_state_dict(checkpoint["critic"])
        self.discriminator.load_state_dict(checkpoint["discriminator"])
        self.discriminator_optimizer.load_state_dict(checkpoint["discriminator_optimizer"])
        self.ppo.restore(checkpoint)
        self.history = checkpoint["history"]

    def state(self) -> dict[str, Any]:
        """Networks, optimisers and history; the replay buffer fills again."""
        return {
            "model": self.student.state_dict(),
            "critic": self.critic.state_dict(),
            "discriminator": self.discriminator.state_dict(),
            "discriminator_optimizer": self.discriminator_optimizer.state_dict(),
            "history": self.history,
            **self.ppo.state(),
        }

    def save(self) -> None:
        """Writes the checkpoint, the history and its curves."""
        super().save()
        if self.history:
            self.path.with_name("history.json").write_text(json.dumps(self.history, indent=1), encoding="utf-8")
            plot_curves(self.path.with_name("curve.png"), self.history, f"CALM: {', '.join(self.motions.names)}")

    def train(self) -> Student:
        """Trains until the time is used up."""
        self.run()
        if self._since:
            self._measure()
            self.save()
        return self.student

    def update(self) -> dict[str, float]:
        """One rollout, one update of the policy and one of the discriminator."""
        config = self.config
        rollout, transitions, figures = self._collect()
        update_actor = not config.initial or self.samples >= config.critic_samples
        figures |= self.ppo.learn_jointly(rollout, self.rng, update_actor)
        if not len(self.replay):
            self.replay.add(transitions, rollout.windows, self.rng)
        steps = [self._teach_discriminator(transitions, rollout.windows) for _ in range(config.discriminator_steps)]
        figures |= {name: float(np.mean([step[name] for step in steps])) for name in steps[0]}
        self.replay.add(transitions, rollout.windows, self.rng)
        self.samples += len(rollout.returns)
        self._since.append(figures)
        if self.seconds - self._measured >= config.measure_seconds:
            self._measure()
        return figures

    def _measure(self) -> None:
        means = {name: float(np.mean([entry[name] for entry in self._since])) for name in self._since[0]}
        measured = measure(self.student, self.demonstrations)
        self.history.append({"seconds": self.seconds, "samples": self.samples, **means, **measured})
        _LOG.info("%.0f s: %s", self.seconds, ", ".join(f"{name} {value:.3g}" for name, value in measured.items()))
        self._since, self._measured = [], self.seconds

    def _encode(self, windows: np.ndarray | torch.Tensor) -> torch.Tensor:
        with torch.no_grad(), fast_arithmetic():
            return self.student.encoder.encode_flat(self.demonstrations.window_inputs[windows])

    @torch.no_grad()
    def _collect(self) -> tuple[ImitationRollout, torch.Tensor, dict[str, float]]:
        config, episodes, policy = self.config, self.episodes, self.student.policy
        steps, n, discount = config.horizon, config.num_humanoids, config.ppo.discount
        observations = torch.empty(steps, n, OBSERVATION_SIZE, dtype=torch.bfloat16)
        windows, latents = torch.empty(steps, n, dtype=torch.long), torch.empty(steps, n, LATENT_SIZE)
        transitions = torch.empty(steps, n, len(config.offsets), IMITATION_FEATURES, dtype=torch.float16)
        means, actions = torch.empty(steps, n, 28), torch.empty(steps, n, 28)
        values, ends, cut = torch.empty(steps + 1, n), torch.empty(steps, n), torch.empty(steps, n)
        noisy = torch.from_numpy(self.rng.random((steps, n)) < self._exploring).float()
        falls = 0.0
        self._latent[:] = self._encode(episodes.window)  # the encoder has learned since
        for step in range(steps + 1):
            renewed = np.flatnonzero(episodes.renewed)
            if len(renewed):
                self._latent[renewed] = self._encode(episodes.window[renewed])
            raw = torch.from_numpy(episodes.observation)
            normal = policy.normalizer(raw).to(torch.bfloat16)
            inputs = policy_input(normal.float(), self._latent)
            with fast_arithmetic():
                values[step] = self.critic(inputs).float()[:, 0]
                if step == steps:
                    break
                means[step] = policy.network(inputs).float()
            policy.normalizer.update(raw)
            observations[step], latents[step] = normal, self._latent
            windows[step] = torch.from_numpy(episodes.window)
            actions[step] = means[step] + self.ppo.noise * torch.randn(n, 28) * noisy[step, :, None]
            judged, fell, truncated = episodes.step(actions[step].numpy())
            transitions[step] = torch.from_numpy(judged)
            ends[step] = torch.from_numpy(fell | truncated)
            cut[step] = torch.from_numpy(truncated)
            falls += float(fell.mean()) / steps
        style = style_reward(self._judge(transitions.flatten(0, 1), latents.flatten(0, 1)), config.reward_scale)
        # Scaled so that values have the size of rewards; a truncated episode is worth what the critic expects.
        rewards = style.view(steps, n) * (1 - discount) + discount * values[:-1] * cut
        advantages, returns = generalised_advantages(rewards, values, ends, config.ppo)
        rollout = ImitationRollout(
            observations.flatten(0, 1),
            windows.flatten(),
            noisy.flatten(),
            means.flatten(0, 1),
            actions.flatten(0, 1),
            advantages,
            returns,
        )
        return rollout, transitions.flatten(0, 1), {"reward": float(style.mean()), "falls": 30 * falls}

    def _judge(self, transitions: torch.Tensor, latents: torch.Tensor) -> torch.Tensor:
        discriminator = self.discriminator
        with torch.no_grad(), fast_arithmetic():
            return torch.cat(
                [
                    discriminator(discriminator.normalise(some), latent)
                    for some, latent in zip(
                        transitions.split(_JUDGED_AT_ONCE), latents.split(_JUDGED_AT_ONCE), strict=True
                    )
                ]
            )

    def _teach_discriminator(self, transitions: torch.Tensor, windows: torch.Tensor) -> dict[str, float]:
        """One gradient step on eq. 1 with the regularisers of the released code."""
        config, discriminator, rng = self.config, self.discriminator, self.rng
        count = config.discriminator_batch
        new = torch.from_numpy(rng.integers(len(windows), size=count))
        old, old_windows = self.replay.sample(rng, count)
        real_windows = self.demonstrations.windows(rng, count)
        real = self.demonstrations.transitions(rng, real_windows)
        discriminator.normalizer.update(torch.cat([real[:, 0], transitions[new, 0].float()]))
        fake = discriminator.normalise(torch.cat([transitions[new], old]))
        fake_latents = self._encode(torch.cat([windows[new], old_windows]))
        normal = discriminator.normalise(real).requires_grad_()
        latents = self._encode(real_windows).requires_grad_(config.penalise_latent)
        if config.mismatched_source == "reference":
            mismatched, follows = normal.detach(), real_windows
        else:
            mismatched, follows = fake[:count], windows[new].numpy()
        other_latents = self._encode(self.demonstrations.other_windows(rng, follows))
        with fast_arithmetic():
            real_logits = discriminator(normal, latents)
            both = discriminator(torch.cat([fake, mismatched]), torch.cat([fake_latents, other_latents]))
        fake_logits, mismatched_logits = both[: 2 * count], both[2 * count :]
        penalty = gradient_penalty(real_logits, *([normal, latents] if config.penalise_latent else [normal]))
        layers = list(discriminator.linear_layers())
        loss = (
            discriminator_loss(real_logits, fake_logits, mismatched_logits, config.terms, config.form)
            + config.penalty * penalty
            + config.logit_decay * squared_weights(layers[-1:])
            + config.weight_decay * squared_weights(layers)
        )
        fooled = float(fake_logits.detach().sigmoid().mean())
        if fooled >= config.discriminator_rest:
            self.discriminator_optimizer.zero_grad()
            loss.backward()
            self.discriminator_optimizer.step()
        return {
            "real": float(real_logits.detach().sigmoid().mean()),
            "fake": fooled,
            "mismatched": float(mismatched_logits.detach().sigmoid().mean()),
            "penalty": float(penalty.detach()),
        }
