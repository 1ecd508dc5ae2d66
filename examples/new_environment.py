"""A task of your own: a vector environment with its reward, a single one that names it, and one line that registers it.

python examples/new_environment.py
"""

import gymnasium as gym
import numpy as np

from anyskill_envs.latent import HumanoidLatentEnv, HumanoidLatentVectorEnv
from rewards import RewardOutput


class HumanoidForwardVectorEnv(HumanoidLatentVectorEnv):
    """Humanoids rewarded for walking along x at 1 m/s."""

    def compute_reward(self, commands: np.ndarray) -> RewardOutput:
        """Reward of one controller step, by terms ``(n,)`` that add up to it."""
        error = self.simulation.qvel[:, 0] - 1.0
        return RewardOutput.from_terms({"speed": np.exp(-2 * error**2), "alive": 0.1 * ~self.has_ended()})


class HumanoidForwardEnv(HumanoidLatentEnv):
    """One humanoid rewarded for walking along x at 1 m/s."""

    vector_class = HumanoidForwardVectorEnv


gym.register(
    "HumanoidForward-v0", HumanoidForwardEnv, vector_entry_point=HumanoidForwardVectorEnv, max_episode_steps=60
)

envs = gym.make_vec("HumanoidForward-v0", num_envs=8)
envs.reset(seed=0)
for name in ("idle", "walk"):
    actions = np.tile(envs.unwrapped.latents[name], (8, 1))
    envs.reset(seed=0)
    rewards = [envs.step(actions)[1] for _ in range(18)]
    print(f"{name:<6} mean reward {np.mean(rewards):.2f}")
envs.close()
