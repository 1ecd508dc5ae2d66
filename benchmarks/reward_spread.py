"""How large the text rewards are: what `REWARD_SCALES` in agents/ablation/config.py is chosen by, and docs/ablation.md.

Humanoids follow latents that are drawn from the motion library, one for each humanoid and episode; one that falls starts
anew with another. The same latents are drawn for each reward and text. The spread of a reward is the standard deviation of
the rewards of decisions within a text, pooled over the texts: the root of the mean of their variances.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import gymnasium as gym
import numpy as np
import tyro
from gymnasium.vector import AutoresetMode

from agents.ablation.config import REWARD_SCALES, scaled
from agents.text.checks import CHECKS
from anyskill_envs.controller import LowLevelController


@dataclass(frozen=True)
class Options:
    """Measure the standard deviation of each reward within a text."""

    num_envs: int = 40
    """Humanoids of each text."""
    decisions: int = 48
    """High-level decisions (1/6 s) of each humanoid."""
    seed: int = 0
    """Seed of starts and latents."""
    encoder: str = "bundled"
    """Encoder of the rewards."""
    num_threads: int = 0
    """Native threads; 0 for one per CPU. Results do not depend on it."""
    controller: Path | None = None
    """Controller to run; the bundled one by default."""


def spread(reward: str, options: Options) -> float:
    """Standard deviation of a reward of a decision within a text, pooled over the texts."""
    controller = LowLevelController.load(options.controller, options.num_threads)
    texts = list(CHECKS)
    env = gym.make_vec(
        "anyskill_envs:HumanoidText-v0",
        num_envs=len(texts) * options.num_envs,
        text=[text for text in texts for _ in range(options.num_envs)],
        reward=reward,
        encoder=options.encoder,
        controller=controller,
        num_threads=options.num_threads,
        autoreset_mode=AutoresetMode.SAME_STEP,
    )
    env.reset(seed=options.seed)
    rng = np.random.default_rng(options.seed)
    chosen = np.zeros((len(texts), options.num_envs), np.int64)
    renewed = np.ones(chosen.shape, bool)
    rewards = np.zeros((options.decisions, *chosen.shape))
    for decision in range(options.decisions):
        # one draw for all texts, so that they see the same latents until the first fall
        chosen = np.where(renewed, rng.integers(len(controller.latents), size=options.num_envs), chosen)
        _, reward_of_decision, terminated, truncated, _ = env.step(controller.latents[chosen.reshape(-1)])
        rewards[decision] = reward_of_decision.reshape(chosen.shape)
        renewed = (terminated | truncated).reshape(chosen.shape)
    env.close()
    return float(np.sqrt(rewards.var(axis=(0, 2)).mean()))


def main(options: Annotated[Options, tyro.conf.arg(name="")]) -> None:
    """Print the table of docs/ablation.md, and what is left of the differences."""
    print("| reward | trained as | standard deviation of a decision's reward, unscaled | scaled |")
    print("|---|---|---|---|")
    for reward, scale in REWARD_SCALES.items():
        found = spread(reward, options)
        print(f"| `{reward}` | `{scaled(reward)}` | {found:.3f} | {scale * found:.3f} |", flush=True)


if __name__ == "__main__":
    tyro.cli(main)
