"""Physically simulated humanoids as Gymnasium environments. Importing this package registers them.

>>> import gymnasium as gym, anyskill_envs
>>> env = gym.make("HumanoidText-v0", text="raise both arms above the head")  # doctest: +SKIP
>>> envs = gym.make_vec("HumanoidText-v0", num_envs=128, text="raise both arms above the head")  # doctest: +SKIP
"""

import gymnasium as gym

EPISODE_SECONDS = 10
"""Default length of an episode."""


def _register(environment_id: str, env: str, vector_env: str, decisions_per_second: int) -> None:
    """Register an environment and its batched form, each "module:Class" of this package."""
    gym.register(
        environment_id,
        entry_point=f"anyskill_envs.{env}",
        vector_entry_point=f"anyskill_envs.{vector_env}",
        max_episode_steps=EPISODE_SECONDS * decisions_per_second,
    )


_register("HumanoidJoints-v0", "single:HumanoidEnv", "vector:HumanoidVectorEnv", 30)
_register("HumanoidLatent-v0", "latent:HumanoidLatentEnv", "latent:HumanoidLatentVectorEnv", 6)
_register("HumanoidText-v0", "text:HumanoidTextEnv", "text:HumanoidTextVectorEnv", 6)
