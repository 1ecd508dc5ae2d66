"""Options of the main job; one dataclass that is command line, documentation and logged configuration at once."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from pathlib import Path
from typing import Annotated, ClassVar, Literal, Self

import numpy as np
import tyro

from agents.training.config import PPOOptions


@dataclass(frozen=True)
class TrainConfig(PPOOptions):
    """Learn a skill from a sentence: PPO of Stable-Baselines3 on HumanoidText-v0, or on an environment with an object.

    The defaults are chosen for two CPU cores. The run folder then holds policy.zip (Stable-Baselines3), policy.onnx,
    video.mp4, curve.png, rollouts.npz (the evaluation episodes), report.json and TensorBoard events.
    """

    MAY_CHANGE_ON_RESUME: ClassVar[tuple[str, ...]] = (*PPOOptions.MAY_CHANGE_ON_RESUME, "video")

    text: tyro.conf.Positional[str]
    """What the humanoid shall do, e.g. "raise both arms above the head"."""

    _: KW_ONLY

    output: Path | None = None
    """Run folder; runs/<the text> by default."""

    minutes: float = 8.0
    """Training time (search and PPO) in minutes of wall clock; evaluation and video come on top, about one minute."""

    exploration: float = 0.06
    """Standard deviation of each of the 64 action numbers at the start, where the mean action has unit length:
    0.06 turns the latent by about 25 degrees."""

    env: str = "HumanoidText-v0"
    """Environment: HumanoidText-v0, or one with an object: HumanoidSoccer-v0, HumanoidDoor-v0, HumanoidChair-v0,
    HumanoidPillar-v0."""

    blind: bool = False
    """The policy does not observe the objects, as in AnySkill."""

    warm_start: Literal["search", "none"] = "search"
    """"search" first plays pieces of the motion library and lets the policy start from the one with the highest reward;
    "none" starts from no direction at all."""

    reward: str = "clip"
    """Name of the reward, or a weighted sum such as "clip+0.5*velocity"; docs/rewards.md has them all."""

    alive_bonus: float = 0.5
    """Added to the reward of each decision that does not end in a fall; see agents/text/shaping.py."""

    encoder: str = "bundled"
    """Name of the encoder that compares text and motion."""

    video: bool = True
    """Write video.mp4."""

    def __post_init__(self) -> None:
        if not self.text.strip():
            raise ValueError(
                'The text is empty. Say what the humanoid shall do, e.g. "raise both arms above the head".'
            )
        super().__post_init__()
        if not 0 <= self.alive_bonus < np.inf:
            raise ValueError(f"alive_bonus must be a number from 0 on, got {self.alive_bonus}.")

    @property
    def reward_scale(self) -> float:
        """Factor of the shaped reward, one minus the discount: a value is then a mean of rewards."""
        return max(1.0 - self.discount, 1e-3)

    def resuming(self, saved: Self, folder: Path) -> Self:
        """The options of a saved run, with what may change taken from these.

        Raises:
            ValueError: The saved run learns another text.
        """
        if saved.text != self.text:
            raise ValueError(f"'{folder}' learns {saved.text!r}, not {self.text!r}; choose another --output.")
        return super().resuming(saved, folder)


TrainOptions = Annotated[TrainConfig, tyro.conf.arg(name="")]
"""A `TrainConfig` whose fields are options without a prefix."""
