"""Stage 1: one tracking policy for all clips, by PPO.

The policy corrects a feed-forward PD target: ``target = reference + 0.05 s * reference velocity + residual``. It sees the
reference, so it is the teacher of the latent-conditioned controller (:mod:`agents.controller.distill`), not the product.
"""

import logging
import os
import time
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np
import torch
from rich.progress import Progress
from torch import nn

from agents.controller.networks import Normalizer, fast_arithmetic, mlp
from agents.controller.reference import ReferenceMotions
from agents.controller.tracking import TRACKING_SIZE, Tracking, TrackingConfig
from motion_data.skeleton import JOINT_NAMES

_LOG = logging.getLogger(__name__)

# Exploration by joint, radians: hips and abdomen move the whole body, so they get less.
_NOISE = np.array(
    [0.05 if name.startswith(("abdomen", "right_hip", "left_hip")) else 0.08 for name in JOINT_NAMES], np.float32
)


@dataclass(frozen=True)
class TeacherConfig:
    """Settings of PPO (Schulman et al. 2017) for motion tracking; measured on two cores."""

    minutes: float = 60.0
    """Training time in minutes, over all sessions."""
    num_humanoids: int = 512
    """Humanoids simulated at once."""
    horizon: int = 16
    """Controller steps per update."""
    hidden: tuple[int, ...] = (512, 512)
    """Widths of actor and critic."""
    epochs: int = 4
    """Passes over the samples per update."""
    minibatch: int = 2048
    """Samples per gradient step."""
    learning_rate: float = 3e-4
    """First learning rate of the actor; it adapts to the Kullback-Leibler divergence."""
    target_divergence: float = 0.08
    """Divergence per update that the learning rate aims at."""
    discount: float = 0.95
    """Discount factor."""
    trace: float = 0.9
    """Lambda of generalised advantage estimation."""
    clip: float = 0.2
    """Clipping of the probability ratio."""
    exploration: float = 0.75
    """Factor on the per-joint exploration noise (0.05 to 0.08 rad)."""
    seed: int = 0
    """Seed of everything random."""
    threads: int = 0
    """Threads for physics and learning; 0 for one per CPU."""
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
    def act(self, policy_input: np.ndarray, feedforward: np.ndarray) -> np.ndarray:
        """Deterministic PD targets, float32 ``(n, 28)``."""
        with fast_arithmetic():
            residual = self.actor(self.normalizer(torch.from_numpy(policy_input))).float().numpy()
        return feedforward + residual

    @classmethod
    def load(cls, path: Path) -> "Teacher":
        """Reads the teacher of a training checkpoint."""
        state = torch.load(path, weights_only=True)
        teacher = cls(tuple(state["hidden"]))
        teacher.load_state_dict(state["model"])
        return teacher


class TeacherTrainer:
    """PPO on :class:`Tracking`, resumable from its checkpoint.

    Args:
        motions: The reference motions; they may change between sessions.
        folder: Where the checkpoint ``teacher.pt`` lives.
        config: Settings.
    """

    def __init__(self, motions: ReferenceMotions, folder: Path, config: TeacherConfig):
        self.config = config
        self.path = folder / "teacher.pt"
        folder.mkdir(parents=True, exist_ok=True)
        torch.set_num_threads(config.threads or len(os.sched_getaffinity(0)))
        torch.manual_seed(config.seed)
        self.teacher = Teacher(config.hidden)
        self.learning_rate = config.learning_rate
        self.actor_optimizer = torch.optim.Adam(self.teacher.actor.parameters(), lr=self.learning_rate, fused=True)
        self.critic_optimizer = torch.optim.Adam(self.teacher.critic.parameters(), lr=1e-3, fused=True)
        self.samples = 0
        self.seconds = 0.0
        if self.path.exists():
            self._restore()
        # A resumed run continues with fresh episodes: a new stream of random numbers, still determined by the seed.
        rng = np.random.default_rng((config.seed, self.samples))
        self.tracking = Tracking(motions, config.num_humanoids, rng, config.tracking, config.threads)
        self._noise = torch.from_numpy(_NOISE) * config.exploration

    def _restore(self) -> None:
        state = torch.load(self.path, weights_only=True)
        self.teacher.load_state_dict(state["model"])
        self.actor_optimizer.load_state_dict(state["actor_optimizer"])
        self.critic_optimizer.load_state_dict(state["critic_optimizer"])
        self.learning_rate, self.samples, self.seconds = state["learning_rate"], state["samples"], state["seconds"]

    def save(self) -> None:
        """Writes the checkpoint, whole or not at all."""
        temporary = self.path.with_suffix(".tmp")
        torch.save(
            {
                "hidden": list(self.config.hidden),
                "model": self.teacher.state_dict(),
                "actor_optimizer": self.actor_optimizer.state_dict(),
                "critic_optimizer": self.critic_optimizer.state_dict(),
                "learning_rate": self.learning_rate,
                "samples": self.samples,
                "seconds": self.seconds,
                "config": {key: value for key, value in asdict(self.config).items() if key != "tracking"},
            },
            temporary,
        )
        os.replace(temporary, self.path)

    def train(self) -> Teacher:
        """Trains until the time is used up; saves every minute."""
        budget = 60 * self.config.minutes
        saved = time.monotonic()
        with Progress() as progress:
            bar = progress.add_task("tracking", total=budget, completed=self.seconds)
            update = 0
            while self.seconds < budget:
                start = time.monotonic()
                statistics = self._update()
                self.seconds += time.monotonic() - start
                description = f"tracking: reward {statistics['reward']:.3f}, failures {statistics['failures']:.4f}/step"
                progress.update(bar, completed=self.seconds, description=description)
                update += 1
                if update % 20 == 0:
                    _LOG.info("%.0f s %.2f M samples %s", self.seconds, self.samples / 1e6, _format(statistics))
                if time.monotonic() - saved > 60:
                    self.save()
                    saved = time.monotonic()
        self.save()
        return self.teacher

    def _update(self) -> dict[str, float]:
        config, teacher, tracking = self.config, self.teacher, self.tracking
        steps, n = config.horizon, config.num_humanoids
        inputs = torch.empty(steps, n, TRACKING_SIZE, dtype=torch.bfloat16)
        means, actions = torch.empty(steps, n, 28), torch.empty(steps, n, 28)
        values, rewards = torch.empty(steps + 1, n), torch.empty(steps, n)
        ends = torch.empty(steps, n)
        failures = 0.0
        begin = time.monotonic()
        for step in range(steps):
            raw = torch.from_numpy(tracking.policy_input())
            if step % 4 == 0:
                teacher.normalizer.update(raw)
            with torch.no_grad(), fast_arithmetic():
                normal = teacher.normalizer(raw)
                means[step] = teacher.actor(normal).float()
                values[step] = teacher.critic(normal).float()[:, 0]
            actions[step] = means[step] + self._noise * torch.randn(n, 28)
            inputs[step] = normal
            reward, failed, truncated = tracking.step(tracking.feedforward() + actions[step].numpy())
            # Scaled so that values lie in [0, 1]; a truncated episode is worth what the critic expects of its state.
            rewards[step] = torch.from_numpy(reward) * (1 - config.discount)
            rewards[step] += config.discount * values[step] * torch.from_numpy(truncated)
            ends[step] = torch.from_numpy(failed | truncated)
            failures += failed.mean() / steps
        with torch.no_grad(), fast_arithmetic():
            values[steps] = teacher.critic(teacher.normalizer(torch.from_numpy(tracking.policy_input()))).float()[:, 0]
        rolled = time.monotonic()
        advantages = _advantages(rewards, values, ends, config.discount, config.trace)
        returns = (advantages + values[:-1]).flatten()
        advantages = advantages.flatten()
        advantages = (advantages - advantages.mean()) / (advantages.std() + 1e-6)
        divergence = self._learn(inputs.flatten(0, 1), means.flatten(0, 1), actions.flatten(0, 1), advantages, returns)
        self.samples += steps * n
        return {
            "reward": float(rewards.mean()) / (1 - config.discount),
            "failures": float(failures),
            "divergence": divergence,
            "learning_rate": self.learning_rate,
            "rollout_s": rolled - begin,
            "learning_s": time.monotonic() - rolled,
        }

    def _learn(
        self,
        inputs: torch.Tensor,
        old_means: torch.Tensor,
        actions: torch.Tensor,
        advantages: torch.Tensor,
        returns: torch.Tensor,
    ) -> float:
        config, teacher = self.config, self.teacher
        critic_only = self.samples < 60_000  # a first estimate of the values before the actor follows them
        divergences: list[float] = []
        for _ in range(config.epochs):
            for batch in torch.randperm(len(inputs)).split(config.minibatch):
                chosen = inputs[batch]
                with fast_arithmetic():
                    value = teacher.critic(chosen).float()[:, 0]
                loss = (value - returns[batch]).square().mean()
                self.critic_optimizer.zero_grad()
                loss.backward()
                self.critic_optimizer.step()
                if critic_only:
                    continue
                with fast_arithmetic():
                    mean = teacher.actor(chosen).float()
                old, action, advantage = old_means[batch], actions[batch], advantages[batch]
                scaled_old, scaled_new = (action - old) / self._noise, (action - mean) / self._noise
                ratio = (0.5 * (scaled_old.square() - scaled_new.square()).sum(-1)).clamp(-10, 10).exp()
                surrogate = torch.minimum(ratio * advantage, ratio.clamp(1 - config.clip, 1 + config.clip) * advantage)
                small = 1e-3 * (mean / 0.08).square().mean()  # the smallest correction that works
                loss = -surrogate.mean() + small
                self.actor_optimizer.zero_grad()
                loss.backward()
                nn.utils.clip_grad_norm_(teacher.actor.parameters(), 1.0)
                self.actor_optimizer.step()
                divergences.append(float(0.5 * ((mean.detach() - old) / self._noise).square().sum(-1).mean()))
        if not divergences:
            return 0.0
        divergence = float(np.mean(divergences[-4:]))
        if divergence > 2 * config.target_divergence:
            self.learning_rate = max(self.learning_rate / 1.3, 3e-5)
        elif divergence < config.target_divergence / 2:
            self.learning_rate = min(self.learning_rate * 1.3, 1e-3)
        for group in self.actor_optimizer.param_groups:
            group["lr"] = self.learning_rate
        return divergence


def _advantages(
    rewards: torch.Tensor, values: torch.Tensor, ends: torch.Tensor, discount: float, trace: float
) -> torch.Tensor:
    """Generalised advantage estimation (Schulman et al. 2016), ``(steps, n)``."""
    advantages = torch.empty_like(rewards)
    running = torch.zeros_like(rewards[0])
    for step in reversed(range(len(rewards))):
        alive = 1 - ends[step]
        surprise = rewards[step] + discount * alive * values[step + 1] - values[step]
        running = surprise + discount * trace * alive * running
        advantages[step] = running
    return advantages


def _format(statistics: dict[str, float]) -> str:
    return " ".join(f"{name} {value:.4g}" for name, value in statistics.items())


@torch.no_grad()
def evaluate_tracking(
    teacher: Teacher, motions: ReferenceMotions, episodes: int = 8, limit: int = 90, distance: float = 0.4
) -> dict[str, tuple[float, float, float]]:
    """Follows each clip from several phases.

    Returns:
        For each clip: share of episodes survived, share of frames survived, mean body error of the survivors (metres).
    """
    from agents.controller.tracking import tracking_distance

    clips = np.repeat(np.arange(len(motions.names)), episodes)
    room = np.maximum(motions.lengths[clips] - 1 - limit, 0)
    phase = (np.tile(np.linspace(0, 1, episodes), len(motions.names)) * room).astype(int)
    config = TrackingConfig(failure_distance=np.inf, episode_steps=10**9)
    tracking = Tracking(motions, len(clips), np.random.default_rng(0), config)
    tracking.reset(np.arange(len(clips)), motions.starts[clips] + phase)
    length = np.minimum(motions.lengths[clips] - 1 - phase, limit)
    alive = np.ones(len(clips), bool)
    survived, error = np.zeros(len(clips)), np.zeros(len(clips))
    for step in range(limit):
        targets = teacher.act(tracking.policy_input(), tracking.feedforward())
        tracking.simulation.step(targets)
        tracking.frame = motions.ahead(tracking.frame, 1)
        tracking.observation = tracking.simulation.observation()
        apart = tracking_distance(tracking.observation, motions.observations[tracking.frame])
        running = step < length
        alive &= ~(running & (apart > distance))
        survived += alive & running
        error += np.where(alive & running, apart, 0)
    return {
        name: (
            float(alive[clips == clip].mean()),
            float((survived / length)[clips == clip].mean()),
            float(error[clips == clip].sum() / max(1, survived[clips == clip].sum())),
        )
        for clip, name in enumerate(motions.names)
    }
