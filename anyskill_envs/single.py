"""One humanoid as a `gymnasium.Env`: a batch of one."""

from __future__ import annotations

from typing import Any, ClassVar

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import ArrayLike, NDArray

from anyskill_envs.actions import FloatArray
from anyskill_envs.rebuilding import RebuiltFromArguments
from anyskill_envs.vector import HumanoidVectorEnv


class HumanoidEnv(RebuiltFromArguments, gym.Env[FloatArray, FloatArray]):
    """One humanoid whose action is 28 PD targets: :class:`HumanoidVectorEnv` with a batch of one.

    A new environment names its vector class and inherits the rest::

        class MyEnv(HumanoidEnv):
            vector_class = MyVectorEnv
            metadata = MyVectorEnv.metadata

    ## Action space

    `Box(-1, 1, (28,), float32)`: the PD target of each hinge, scaled as `anyskill_envs.actions.JointActions` says, held
    for 1/30 s.

    ## Observation space

    `Box((223,), float32)`, AnySkill's proprioception in the heading frame; `OBSERVATION_LAYOUT` in
    `anyskill_envs.observation` names the blocks: root height 1 (m), positions of 14 bodies from the pelvis 42 (m),
    x and z axes of 15 bodies 90, linear velocities 45 (m/s), angular velocities 45 (rad/s). Objects append what is seen
    of them, see docs/objects.md.

    ## Rewards

    `reward_alive`: 1 for each controller step that does not end the episode.

    ## Starting state

    The rest pose with small uniform noise, facing x, or a random frame of the motion clips (`initial_state="library"`).
    `reset(options={"initial_state": ...})` takes either name or a dictionary with `qpos` and `qvel`. Objects are placed
    around it by chance; `reset(options={"placement": ...})` says where for this episode.

    ## Episode end

    Terminated when the centre of the head is below `minimum_head_height`, when a body fell to the floor (if
    `terminate_when_fallen`), or when the simulation diverged. Truncated by the registered time limit only.

    ## Arguments

    Those of the vector class, but `num_envs`, `max_episode_steps` and `autoreset_mode`.

    Attributes:
        vector: the batch of one.
    """

    vector_class: ClassVar[type[HumanoidVectorEnv]] = HumanoidVectorEnv
    metadata: dict[str, Any] = HumanoidVectorEnv.metadata

    def __init__(self, *, render_mode: str | None = None, **kwargs: Any) -> None:
        self.vector = self.vector_class(
            num_envs=1, autoreset_mode=AutoresetMode.DISABLED, render_mode=render_mode, **kwargs
        )
        self.render_mode = render_mode
        self.metadata = self.vector.metadata
        self.action_space = self.vector.single_action_space
        self.observation_space = self.vector.single_observation_space

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[FloatArray, dict[str, Any]]:
        """Start a new episode.

        Args:
            seed: seeds the random generator.
            options: `initial_state`, see the class; subclasses may know more.

        Returns:
            Observation ``(223,)`` and `info`.

        Raises:
            ValueError: an unknown option or a bad value of one.
        """
        super().reset(seed=seed)
        self.vector.np_random = self.np_random  # one generator: the one that Gymnasium seeds
        observation, info = self.vector.reset(options=options)
        return observation[0], _first(info)

    def step(self, action: ArrayLike) -> tuple[FloatArray, float, bool, bool, dict[str, Any]]:
        """Execute an action; `truncated` is always False: the time limit belongs to the `TimeLimit` wrapper.

        Raises:
            ValueError: an action of a wrong shape, or not finite.
            gymnasium.error.ResetNeeded: the episode has ended or was never begun.
        """
        observation, reward, terminated, truncated, info = self.vector.step(np.asarray(action)[None])
        return observation[0], float(reward[0]), bool(terminated[0]), bool(truncated[0]), _first(info)

    def render(self) -> NDArray[np.uint8] | None:
        """The picture, uint8 ``(height, width, 3)``; None in a window or without a render mode."""
        frames = self.vector.render()
        return None if frames is None else frames[0]

    def close(self) -> None:
        """Free the GL context and close the window."""
        self.vector.close()


def _first(info: dict[str, Any]) -> dict[str, Any]:
    """The info of the first humanoid, without the masks of the vector format; numbers become Python's."""
    entries = {key: value[0] for key, value in info.items() if not key.startswith("_")}
    return {key: value.item() if value.ndim == 0 else value for key, value in entries.items()}
