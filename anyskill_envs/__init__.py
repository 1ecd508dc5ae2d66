"""Physically simulated humanoids as Gymnasium environments. Importing this package registers them.

>>> import gymnasium as gym, anyskill_envs
>>> env = gym.make("HumanoidText-v0", text="raise both arms above the head")  # doctest: +SKIP
>>> envs = gym.make_vec("HumanoidText-v0", num_envs=128, text="raise both arms above the head")  # doctest: +SKIP
>>> env = gym.make("HumanoidSoccer-v0", text="kick the ball")  # doctest: +SKIP
"""

from typing import Any

import gymnasium as gym

EPISODE_SECONDS = 10
"""Default length of an episode."""


def _register(environment_id: str, env: str, vector_env: str, decisions_per_second: int, **kwargs: Any) -> None:
    """Register an environment and its batched form, each "module:Class" of this package, with its own defaults."""
    gym.register(
        environment_id,
        entry_point=f"anyskill_envs.{env}",
        vector_entry_point=f"anyskill_envs.{vector_env}",
        max_episode_steps=EPISODE_SECONDS * decisions_per_second,
        kwargs=kwargs,
    )


_TEXT = ("text:HumanoidTextEnv", "text:HumanoidTextVectorEnv", 6)

_register("HumanoidJoints-v0", "single:HumanoidEnv", "vector:HumanoidVectorEnv", 30)
_register("HumanoidLatent-v0", "latent:HumanoidLatentEnv", "latent:HumanoidLatentVectorEnv", 6)
_register("HumanoidText-v0", *_TEXT)
_register("HumanoidSoccer-v0", *_TEXT, objects=["ball"], text="kick the ball")
_register("HumanoidDoor-v0", *_TEXT, objects=["door"], text="open the door")
_register("HumanoidChair-v0", *_TEXT, objects=["chair"], text="sit on the chair")
_register("HumanoidPillar-v0", *_TEXT, objects=["pillar"], text="strike the pillar")
_register("RetrievalLocomotion-v0", "retrieval:RetrievalLocomotionEnv", "retrieval:RetrievalLocomotionVectorEnv", 6)
