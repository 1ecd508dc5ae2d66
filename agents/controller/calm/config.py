"""Settings of CALM: the paper's, and some that learn on two CPU cores."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

from agents.controller.calm.losses import TERMS, LossForm, Term
from agents.controller.ppo import PPOSettings


@dataclass(frozen=True)
class EpisodeConfig:
    """How episodes of imitation run; the defaults are those of the released code."""

    episode_steps: int = 300
    """Longest episode, controller steps (Table A1)."""
    hold_steps: tuple[int, int] = (10, 150)
    """A latent is held for a whole number of controller steps from the first to below the second."""
    reference_starts: float = 0.5
    """Share of the episodes that start in a frame of a clip; the others start in the rest pose."""
    matched_starts: float = 0.0
    """Share of those whose first latent is that of the motion they start in; a random motion's otherwise."""
    fallen_starts: float = 0.1
    """Share of the episodes that start lying, from a body that was dropped."""
    recovery: float = 0.2
    """Chance that the episode after a fall starts as the body lies."""
    recovery_steps: int = 60
    """Controller steps in which an episode that starts lying may stay down."""
    fall_height: float = 0.3
    """An episode ends when the centre of the head is lower (metres)."""
    fall_margin: float | None = None
    """If given, it ends as soon as the head is this much (metres) below its lowest place in the clips."""
    joint_noise: float = 0.0
    """Standard deviation of the initial joint angles around those of the frame, radians."""
    velocity_noise: float = 0.0
    """Standard deviation of the initial velocities, m/s and rad/s."""


@dataclass(frozen=True)
class CalmConfig:
    """Settings of CALM; the defaults are AnySkill's Table A1, and the released code where the table is silent."""

    minutes: float = 60.0
    """Training time in minutes, over all sessions."""
    num_humanoids: int = 4096
    """Humanoids simulated at once."""
    horizon: int = 32
    """Controller steps per update: 131,072 samples."""
    ppo: PPOSettings = field(
        default_factory=lambda: PPOSettings(
            epochs=6, minibatch=16384, learning_rate=2e-5, discount=0.99, trace=0.95, clip=0.2, exploration=1.0
        )
    )
    """Settings of PPO's update. The target divergence counts only if the rate adapts."""
    adaptive_rate: bool = False
    """Whether the learning rate follows the divergence, as in the other stages; constant otherwise."""
    critic_rate: float = 2e-5
    """Learning rate of the critic."""
    action_log_std: float | None = -2.9
    """Logarithm of the exploration noise, in units of each joint's range of targets; None for the other stages' noise."""
    greedy_humanoids: bool = True
    """Humanoid i of N explores with probability 1 - exp(10 (i / (N - 1) - 1)) only: the last ones act without noise."""
    critic_weight: float = 5.0
    """Weight of the critic's loss; it matters for the encoder, which both losses train."""
    bound_weight: float = 10.0
    """Weight of mean targets beyond the range of targets."""
    max_gradient: float | None = None
    """Longest gradient of policy and encoder; None for no limit."""
    critic_samples: int = 0
    """Samples for which critic and discriminator learn alone if there are initial weights, so as not to spoil those."""

    alignment: float = 1.0
    """Weight of the alignment loss within the encoder's regularisation."""
    uniformity: float = 0.5
    """Weight of the uniformity loss within the encoder's regularisation."""
    encoder_weight: float = 0.1
    """Weight of the encoder's regularisation: effective weights 0.1 and 0.05."""
    encoder_batch: int = 4096
    """Windows per gradient step for the encoder's regularisation."""

    terms: tuple[Term, ...] = TERMS
    """Terms of the discriminator's loss that count; the released configurations leave "mismatched" out."""
    form: LossForm = "equation"
    """How the terms are added up: as eq. 1 has them, or pooled as in the released code."""
    mismatched_source: Literal["reference", "policy"] = "reference"
    """Whose transitions the mismatched term judges: eq. 1 and the code say the reference's, the paper's text the policy's."""
    other_clip: bool = False
    """Whether mismatched latents come from another clip; with few clips a random one is too often a match."""
    penalty: float = 5.0
    """Weight of the gradient penalty."""
    penalise_latent: bool = False
    """Whether the penalty includes the gradient in the latent (eq. 1 read literally; the code leaves it out)."""
    logit_decay: float = 0.01
    """Weight of the squared weights of the discriminator's last layer."""
    weight_decay: float = 1e-4
    """Weight of all squared weights of the discriminator."""
    discriminator_rate: float = 2e-5
    """Learning rate of the discriminator."""
    discriminator_batch: int = 4096
    """Samples of each kind per gradient step of the discriminator."""
    discriminator_steps: int = 48
    """Gradient steps of the discriminator per update: as many as the policy's."""
    discriminator_rest: float = 0.0
    """The discriminator takes no step while its mean D of the policy's transitions is lower than this."""
    replay: int = 200_000
    """Transitions of the policy that are kept for the discriminator."""
    replay_share: float = 0.01
    """Share of each rollout that enters the buffer once it is full."""
    reward_scale: float = 1.0
    """Scale of the reward: 1 in eq. 2, 2 in the released code."""

    offsets: tuple[int, ...] = tuple(range(10))
    """Frames that the discriminator sees, counted back from now."""
    window_overhang: int = 0
    """Frames by which a window may reach beyond the end of its clip, where the last pose is repeated."""
    hidden: tuple[int, ...] = (1024, 1024, 512)
    """Widths of the policy and of the critic."""
    discriminator_hidden: tuple[int, ...] = (1024, 1024, 512)
    """Widths of the discriminator."""
    style_hidden: tuple[int, ...] = (512, 256, 64)
    """Widths of the discriminator's branch for the latent."""
    episodes: EpisodeConfig = field(default_factory=EpisodeConfig)
    """How episodes run."""

    measure_seconds: float = 300.0
    """Training time between measurements of the tracking error."""
    initial: Path | None = None
    """Weights (safetensors) of encoder and policy to begin with when there is no checkpoint yet."""
    seed: int = 0
    """Seed of everything random."""
    threads: int = 0
    """Threads for physics and learning; 0 for one per CPU."""

    def begun_with(self, initial: Path) -> "CalmConfig":
        """The same, begun with weights that already perform: less exploration, and a slower start of learning."""
        ppo = replace(self.ppo, exploration=0.75, learning_rate=min(self.ppo.learning_rate, 1e-4))
        return replace(self, initial=initial, ppo=ppo)

    @classmethod
    def laptop(cls) -> "CalmConfig":
        """What learns a few clips on two cores: smaller batches and networks, and starts and ends that save samples."""
        return cls(
            num_humanoids=512,
            horizon=16,
            ppo=PPOSettings(
                epochs=3,
                minibatch=2048,
                learning_rate=3e-4,
                target_divergence=0.06,
                discount=0.97,
                trace=0.95,
                exploration=1.25,
            ),
            adaptive_rate=True,
            critic_rate=1e-3,
            action_log_std=None,
            greedy_humanoids=False,
            max_gradient=1.0,
            critic_samples=60_000,
            encoder_batch=256,
            other_clip=True,
            penalty=10.0,
            discriminator_rate=1e-4,
            discriminator_batch=512,
            discriminator_steps=4,
            discriminator_rest=0.05,
            replay=50_000,
            replay_share=0.1,
            offsets=(0, 1, 3, 6, 9),
            window_overhang=30,
            hidden=(768, 512),
            discriminator_hidden=(512, 256),
            style_hidden=(256, 64),
            episodes=EpisodeConfig(
                episode_steps=200,
                hold_steps=(30, 150),
                reference_starts=1.0,
                matched_starts=0.8,
                fallen_starts=0.0,
                recovery=0.0,
                fall_margin=0.25,
                joint_noise=0.02,
                velocity_noise=0.1,
            ),
            measure_seconds=60.0,
        )


PRESETS: dict[str, Callable[[], CalmConfig]] = {"laptop": CalmConfig.laptop, "paper": CalmConfig}
"""The configurations by name."""
