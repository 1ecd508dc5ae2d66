"""HumanoidLatent-v0: the humanoid driven through the low-level controller."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

from anyskill_envs.actions import FloatArray, LatentActions
from anyskill_envs.controller import LowLevelController
from anyskill_envs.single import HumanoidEnv
from anyskill_envs.vector import HumanoidVectorEnv
from motion_data.skeleton import FRAME_RATE


class HumanoidLatentVectorEnv(HumanoidVectorEnv):
    """Humanoids that follow latents of the low-level controller; see :class:`HumanoidLatentEnv`.

    Args:
        num_envs: number of humanoids.
        controller: path of the controller's ONNX file, or a loaded controller; the bundled one if None.
        num_threads: threads of physics and controller; 0 for one per CPU. Results do not depend on it.
        **kwargs: arguments of :class:`HumanoidVectorEnv`.

    Raises:
        FileNotFoundError: there is no such controller file.
        ValueError: the file is not a controller for this humanoid, or another argument is out of its range.
    """

    metadata: dict[str, Any] = HumanoidVectorEnv.metadata | {
        "render_fps": round(FRAME_RATE / LatentActions.controller_steps)
    }
    decoder: LatentActions

    def __init__(
        self,
        num_envs: int = 1,
        *,
        controller: LowLevelController | str | Path | None = None,
        num_threads: int = 0,
        **kwargs: Any,
    ) -> None:
        # One humanoid needs one thread: single environments are run in many processes at once.
        decoder = LatentActions(controller, num_threads if num_envs > 1 else 1)
        super().__init__(num_envs, decoder=decoder, num_threads=num_threads, **kwargs)

    @property
    def latents(self) -> dict[str, FloatArray]:
        """Named latents of the controller, ``(64,)`` each: `latents["walk"]` is an action that walks."""
        return self.decoder.controller.anchors


class HumanoidLatentEnv(HumanoidEnv):
    """One humanoid driven by latents: the ground that tasks for high-level policies stand on.

    ## Action space

    `Box(-1, 1, (64,), float32)`: a latent of the frozen low-level controller, clipped, L2-normalised, and held for five
    controller steps (1/6 s). Zero stands for the controller's "idle" anchor. `env.unwrapped.latents` holds named ones.

    ## Observation space, starting state, episode end

    Those of :class:`HumanoidEnv`. The loop of five controller steps stops at a termination.

    ## Rewards

    `reward_alive`: the share of the executed controller steps that did not end the episode. A task replaces it by a
    subclass with its own `compute_reward`, or by a wrapper.

    ## Arguments

    Those of :class:`HumanoidLatentVectorEnv`, but `num_envs`, `max_episode_steps` and `autoreset_mode`.

    ## Version history

    v0: first version.
    """

    vector_class: ClassVar[type[HumanoidLatentVectorEnv]] = HumanoidLatentVectorEnv
    metadata: dict[str, Any] = HumanoidLatentVectorEnv.metadata
    vector: HumanoidLatentVectorEnv

    @property
    def latents(self) -> dict[str, FloatArray]:
        """Named latents of the controller, ``(64,)`` each: `latents["walk"]` is an action that walks."""
        return self.vector.latents
