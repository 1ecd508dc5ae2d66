"""Stage 2: distil the tracking policy into a latent-conditioned controller, by DAgger (Ross et al. 2011).

The student acts, the teacher labels the states that the student visits. The student's latent comes from the reference
window alone and is held for random times, while the reference goes on or starts the window again; so a latent is an
intent: it does not see the state, and freezing it keeps the behaviour going.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors.torch import load_file
from torch import nn
from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn

from agents.controller.evaluate import evaluate_random
from agents.controller.losses import alignment_loss, uniformity_loss
from agents.controller.networks import fast_arithmetic
from agents.controller.reference import ReferenceMotions
from agents.controller.selection import base_name
from agents.controller.stage import Stage
from agents.controller.student import WINDOW_OFFSETS, Student
from agents.controller.teacher import Teacher
from agents.controller.tracking import Tracking, TrackingConfig
from anyskill_envs.controller import LATENT_SIZE
from anyskill_envs.observation import MIRROR_INDEX, MIRROR_SIGN
from motion_data.library import mirror_name, missing_mirrors
from motion_data.skeleton import MIRROR_JOINT_SIGNS, MIRROR_JOINTS
from motion_data.window import WINDOW_FEATURES, WINDOW_MIRROR_INDEX, WINDOW_MIRROR_SIGN


@dataclass(frozen=True)
class DistillConfig:
    """Settings of distillation, chosen for two cores."""

    minutes: float = 25.0
    """Training time in minutes, over all sessions."""
    num_humanoids: int = 512
    """Humanoids simulated at once."""
    horizon: int = 16
    """Controller steps between learning."""
    buffer_rollouts: int = 60
    """How many of the last rollouts are learned from."""
    gradient_steps: int = 24
    """Gradient steps per rollout."""
    batch: int = 4096
    """Samples per gradient step; half are mirrored, but for those of symmetric clips."""
    learning_rate: float = 1e-3
    """First learning rate from nothing; it falls linearly, at last to 3 %."""
    later_rate: float = 4e-4
    """The same for a training that begins with trained weights."""
    averaging: float = 0.9995
    """Decay of the running mean of the weights, per gradient step: the mean is what training yields."""
    large_error: float = 0.05
    """Errors beyond this (radians) count by their size instead of its square."""
    latent_noise: float = 0.1
    """Length of the random vector added to a latent before it is normalised again: what is close must act alike."""
    action_noise: float = 0.02
    """Standard deviation of the noise on the student's targets, radians."""
    uniformity: float = 0.005
    """Weight of CALM's uniformity loss: spreads the latents over the sphere."""
    alignment: float = 0.005
    """Weight of CALM's alignment loss: windows of one clip within 0.5 s lie close together."""
    seed: int = 0
    """Seed of everything random."""
    threads: int = 0
    """Threads for physics and learning; 0 for one per CPU."""
    initial: Path | None = None
    """Weights (safetensors) to begin with when there is no checkpoint yet."""
    tracking: TrackingConfig = field(
        default_factory=lambda: TrackingConfig(
            failure_distance=0.4,
            episode_steps=300,
            mean_holds=(3, 5, 5, 15, 60, 150, 150),
            unsettled=0.2,
            synchronise_after=15,
        )
    )
    """How episodes run."""

    @property
    def first_rate(self) -> float:
        """The learning rate with which this training begins."""
        return self.later_rate if self.initial else self.learning_rate


class DistillTrainer(Stage):
    """DAgger from a teacher to a :class:`Student`, resumable from its checkpoint.

    Args:
        teacher: The tracking policy.
        motions: The reference motions.
        folder: Where the checkpoint ``student.pt`` lives.
        config: Settings.
    """

    def __init__(self, teacher: Teacher, motions: ReferenceMotions, folder: Path, config: DistillConfig):
        super().__init__(folder / "student.pt", config.minutes, config.seed, config.threads)
        self.config, self.teacher, self.motions = config, teacher, motions
        self.student = Student()
        self.optimizer = torch.optim.AdamW(self.student.parameters(), config.first_rate, weight_decay=1e-4, fused=True)
        if self.checkpoint:
            self.student.load_state_dict(self.checkpoint["model"])
            self.optimizer.load_state_dict(self.checkpoint["optimizer"])
        elif config.initial:
            self.student.load_state_dict(load_file(config.initial))
        self.tracking = Tracking(motions, config.num_humanoids, self.rng, config.tracking, config.threads)
        self.averaged = AveragedModel(self.student, multi_avg_fn=get_ema_multi_avg_fn(config.averaging))
        if self.checkpoint and "averaged" in self.checkpoint:
            self.averaged.load_state_dict(self.checkpoint["averaged"])
        self._window_inputs = self._all_window_inputs()
        if not self.checkpoint and not config.initial:
            self.student.encoder.normalizer.update(self._window_inputs)
            with torch.no_grad():
                last = self.student.policy.network[-1]
                assert isinstance(last, nn.Linear)
                last.bias.copy_(torch.from_numpy(motions.feedforward.mean(0)))
        # The teacher does a clip in the same way as its twin, but a symmetric clip not as its own mirror image: there
        # mirrored labels would contradict it.
        one_sided = {base_name(clip.name) for clip in missing_mirrors(motions.clips)}
        twins = {name for name in motions.names if mirror_name(name) != name} & set(map(mirror_name, motions.names))
        may_mirror = [name in one_sided | twins for name in motions.names]
        self._may_mirror = torch.tensor(may_mirror)[motions.clip_of_frame]
        self._latent = torch.zeros(config.num_humanoids, LATENT_SIZE)
        self._observations: list[torch.Tensor] = []
        self._windows: list[torch.Tensor] = []
        self._targets: list[torch.Tensor] = []

    def _all_window_inputs(self) -> torch.Tensor:
        """Encoder inputs of every frame's window, ``(F, ENCODER_INPUT)``."""
        parts = []
        for chunk in np.array_split(np.arange(len(self.motions)), max(1, len(self.motions) // 2000)):
            parts.append(self.motions.windows(chunk)[:, WINDOW_OFFSETS].reshape(len(chunk), -1))
        return torch.from_numpy(np.concatenate(parts))

    def state(self) -> dict[str, Any]:
        """Network and optimiser."""
        return {
            "model": self.student.state_dict(),
            "averaged": self.averaged.state_dict(),
            "optimizer": self.optimizer.state_dict(),
        }

    def train(self) -> Student:
        """Trains until the time is used up."""
        self.run()
        assert isinstance(self.averaged.module, Student)
        return self.averaged.module

    def update(self) -> dict[str, float]:
        """One rollout and its gradient steps."""
        rate = self.config.first_rate * max(0.03, 1 - self.seconds / self.budget)
        for group in self.optimizer.param_groups:
            group["lr"] = rate
        failures, loss = self._rollout(), self._learn()
        return {"target error (rad)": loss, "failures": failures}

    def inspect(self) -> dict[str, float]:
        """Falls under random latents of standing clips."""
        return {"falls under random latents": evaluate_random(self.student, self.student, self.motions, episodes=100)}

    def _rollout(self) -> float:
        config, tracking = self.config, self.tracking
        observations, windows, targets = [], [], []
        failures = 0.0
        imitate = (
            self.samples < 3 * config.horizon * config.num_humanoids
        )  # the first rollouts show the teacher's states
        for _ in range(config.horizon):
            label = self.teacher.targets(tracking)
            renewed = np.flatnonzero(tracking.renewed)
            observation = torch.from_numpy(tracking.observation)
            self.student.policy.normalizer.update(observation)
            with torch.no_grad(), fast_arithmetic():
                if len(renewed):
                    self._latent[renewed] = self._encode(self._window_inputs[tracking.window[renewed]])
                action = self.student.policy(observation, self._latent).numpy()
            observations.append(observation)
            windows.append(torch.from_numpy(tracking.window.copy()))
            targets.append(torch.from_numpy(label))
            if imitate:
                action = label
            noise = config.action_noise * torch.randn(action.shape).numpy()
            _, failed, _ = tracking.step(action + noise)
            failures += failed.mean() / config.horizon
        for buffer, new in ((self._observations, observations), (self._windows, windows), (self._targets, targets)):
            buffer.append(torch.cat(new))
            del buffer[: -config.buffer_rollouts]
        self.samples += config.horizon * config.num_humanoids
        return float(failures)

    def _encode(self, inputs: torch.Tensor) -> torch.Tensor:
        """Latents with noise, on the sphere again."""
        latent = self.student.encoder.encode_flat(inputs)
        latent = latent + self.config.latent_noise * torch.randn_like(latent) / LATENT_SIZE**0.5
        return latent / latent.norm(dim=-1, keepdim=True)

    def _learn(self) -> float:
        config = self.config
        losses: list[float] = []
        for _ in range(config.gradient_steps):
            # A quarter of each batch comes from the newest rollout, the rest from three random ones.
            chosen = [len(self._targets) - 1, *torch.randint(len(self._targets), (3,)).tolist()]
            rows = [torch.randint(len(self._targets[k]), (config.batch // 4,)) for k in chosen]
            observation = torch.cat([self._observations[k][r] for k, r in zip(chosen, rows, strict=True)])
            window = torch.cat([self._windows[k][r] for k, r in zip(chosen, rows, strict=True)])
            target = torch.cat([self._targets[k][r] for k, r in zip(chosen, rows, strict=True)])
            inputs = self._window_inputs[window]
            mirror = (torch.rand(len(target)) < 0.5) & self._may_mirror[window]
            observation = torch.where(mirror[:, None], _mirror_observation(observation), observation)
            target = torch.where(mirror[:, None], _mirror_targets(target), target)
            inputs = torch.where(mirror[:, None], _mirror_windows(inputs), inputs)
            shift = int(torch.randint(1, 16, ()))  # up to 0.5 s
            later = torch.from_numpy(self.motions.ahead(window.numpy(), shift))
            with fast_arithmetic():
                latent = self._encode(inputs)
                action = self.student.policy(observation, latent)
                few = slice(0, 512)
                aligned = self.student.encoder.encode_flat(self._window_inputs[window[few]])
                shifted = self.student.encoder.encode_flat(self._window_inputs[later[few]])
            # Right after a switch the target depends on what was before, which the student cannot know. Squares would
            # be ruled by those few large errors, at the price of precision everywhere else.
            error = nn.functional.smooth_l1_loss(action, target, beta=config.large_error)
            loss = error + config.uniformity * uniformity_loss(aligned)
            loss = loss + config.alignment * alignment_loss(aligned, shifted)
            self.optimizer.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(self.student.parameters(), 1.0)
            self.optimizer.step()
            self.averaged.update_parameters(self.student)
            losses.append(float((action - target).detach().abs().mean()))
        return float(np.mean(losses))


def _mirror_observation(observation: torch.Tensor) -> torch.Tensor:
    return observation[:, MIRROR_INDEX] * torch.from_numpy(MIRROR_SIGN)


def _mirror_targets(target: torch.Tensor) -> torch.Tensor:
    return target[:, MIRROR_JOINTS] * torch.from_numpy(MIRROR_JOINT_SIGNS.astype(np.float32))


def _mirror_windows(inputs: torch.Tensor) -> torch.Tensor:
    frames = inputs.view(len(inputs), len(WINDOW_OFFSETS), WINDOW_FEATURES)
    return (frames[..., WINDOW_MIRROR_INDEX] * torch.from_numpy(WINDOW_MIRROR_SIGN)).flatten(1)
