"""Options of the main job; one dataclass that is command line, documentation and logged configuration at once."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import tyro

Look = Literal["simulation", "mesh", "beside"]
"""What a video shows: the shapes that the physics knows, a skinned mannequin, or both beside each other."""


@dataclass(frozen=True)
class TrainConfig:
    """Learn a skill from a sentence: PPO of Stable-Baselines3 on HumanoidText-v0, or on an environment with an object.

    The defaults are chosen for two CPU cores. The run folder then holds policy.zip (Stable-Baselines3), policy.onnx,
    video.mp4, curve.png, rollouts.npz (the evaluation episodes), report.json and TensorBoard events.
    """

    text: tyro.conf.Positional[str]
    """What the humanoid shall do, e.g. "raise both arms above the head"."""

    env: str = "HumanoidText-v0"
    """Environment: HumanoidText-v0, or one with an object: HumanoidSoccer-v0, HumanoidDoor-v0, HumanoidChair-v0,
    HumanoidPillar-v0."""

    blind: bool = False
    """The policy does not observe the objects, as in AnySkill."""

    output: Path | None = None
    """Run folder; runs/<the text> by default."""

    minutes: float = 8.0
    """Training time (search and PPO) in minutes of wall clock; evaluation and video come on top, about one minute."""

    seed: int = 0
    """Seed of everything that is drawn."""

    num_envs: int = 128
    """Humanoids that learn together."""

    resume: bool = False
    """Continue the run in the output folder where its last checkpoint stands; minutes counts from its very start."""

    overwrite: bool = False
    """Start anew although the output folder holds a run; the old one is deleted."""

    warm_start: Literal["search", "none"] = "search"
    """"search" first plays pieces of the motion library and lets the policy start from the one with the highest reward;
    "none" starts from no direction at all."""

    reward: str = "clip"
    """Name of the reward, or a weighted sum such as "clip+0.5*velocity"; docs/rewards.md has them all."""

    alive_bonus: float = 0.5
    """Added to the reward of each decision that does not end in a fall; see agents/text/shaping.py."""

    encoder: str = "bundled"
    """Name of the encoder that compares text and motion."""

    controller: Path | None = None
    """Low-level controller (ONNX); the bundled one by default."""

    evaluation_episodes: int = 20
    """Episodes of 10 s with the deterministic policy after training."""

    video: bool = True
    """Write video.mp4."""

    progress: bool = True
    """Show a progress bar."""

    learning_rate: float = 1e-4
    """Step size of Adam at the start; it falls linearly to a tenth by the end."""

    decisions_per_update: int = 16
    """High-level decisions (1/6 s) of each humanoid between two updates."""

    batch_size: int = 512
    """Decisions in a minibatch."""

    epochs: int = 8
    """Passes over the collected decisions in an update."""

    discount: float = 0.95
    """Discount per decision; 0.95 looks about 3 s ahead."""

    gae_lambda: float = 0.9
    """Lambda of generalised advantage estimation."""

    exploration: float = 0.06
    """Standard deviation of each of the 64 action numbers at the start, where the mean action has unit length:
    0.06 turns the latent by about 25 degrees."""

    target_kl: float = 0.1
    """An update stops early when the policy has moved further than this."""

    hidden: tuple[int, ...] = (256, 128)
    """Hidden layers of the policy and of the value function, tanh."""

    def __post_init__(self) -> None:
        if not self.text.strip():
            raise ValueError(
                'The text is empty. Say what the humanoid shall do, e.g. "raise both arms above the head".'
            )
        positive = {
            name: getattr(self, name)
            for name in ("minutes", "num_envs", "evaluation_episodes", "learning_rate", "decisions_per_update")
            + ("batch_size", "epochs", "exploration", "target_kl")
        }
        for name, value in positive.items():
            if not (np.isfinite(value) and value > 0):
                raise ValueError(f"{name} must be a positive number, got {value}.")
        for name in ("discount", "gae_lambda"):
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"{name} must be between 0 and 1, got {getattr(self, name)}.")
        if not 0 <= self.alive_bonus < np.inf:
            raise ValueError(f"alive_bonus must be a number from 0 on, got {self.alive_bonus}.")
        if self.seed < 0:
            raise ValueError(f"seed must be 0 or more, got {self.seed}.")
        if self.batch_size > self.num_envs * self.decisions_per_update:
            raise ValueError(
                f"batch_size {self.batch_size} is more than the num_envs x decisions_per_update = "
                f"{self.num_envs * self.decisions_per_update} decisions of an update; lower it."
            )
        if self.resume and self.overwrite:
            raise ValueError("resume and overwrite exclude each other; choose one.")

    @property
    def reward_scale(self) -> float:
        """Factor of the shaped reward, one minus the discount: a value is then a mean of rewards."""
        return max(1.0 - self.discount, 1e-3)

    def to_json(self) -> dict[str, Any]:
        """The options as JSON values; :meth:`from_json` reads them."""
        values = dataclasses.asdict(self)
        return json.loads(json.dumps(values, default=str))

    @classmethod
    def from_json(cls, values: dict[str, Any]) -> TrainConfig:
        """Options from :meth:`to_json`."""
        values = dict(values)
        for name in ("output", "controller"):
            values[name] = Path(values[name]) if values[name] is not None else None
        values["hidden"] = tuple(values["hidden"])
        return cls(**values)


TrainOptions = Annotated[TrainConfig, tyro.conf.arg(name="")]
"""A `TrainConfig` whose fields are options without a prefix."""
