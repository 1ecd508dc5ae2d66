"""A reward at work on a batch of humanoids: what it looks at is made out of their states."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from anyskill_envs.actions import FloatArray
from anyskill_envs.objects.scene import Scene
from anyskill_envs.objects.state import object_states
from anyskill_envs.observation import OBSERVATION_LAYOUT
from anyskill_envs.rendering import Camera, HumanoidRenderer
from motion_data.skeleton import heading
from rewards import EpisodicReward, RewardBatch, RewardFn, RewardOutput

STYLE_LIBRARY_SIZE = 128
"""Latents of the library that the nearest-latent style term looks through, as many as in AnySkill's code."""

_LATENT_NEEDS = {"latent", "style_latent", "library_latents"}
_PELVIS_VELOCITY = slice(
    OBSERVATION_LAYOUT["body_linear_velocities"].start, OBSERVATION_LAYOUT["body_linear_velocities"].start + 2
)


def require_objects(reward: RewardFn, scene: Scene) -> None:
    """Raises ValueError if a reward looks at an object, or the joint of one, and the scene has none such."""
    if "objects" in reward.needs and not scene:
        raise ValueError(
            "The reward looks at an object, but the scene of this environment has none: use an environment with one, "
            'such as HumanoidSoccer-v0, or name some: objects=["ball"].'
        )
    for part in getattr(reward, "parts", {}).values():  # of a sum
        require_objects(part, scene)
    named = getattr(reward, "object", None) if "objects" in reward.needs else None
    if named is not None and named not in scene.parts:
        raise ValueError(f"The reward looks at {named!r}, but the objects of the scene are: {', '.join(scene.parts)}.")
    looked_at = scene.parts if named is None else {named: scene.parts[named]}
    if "object_angle" in reward.needs and not any(part.angles for part in looked_at.values()):
        raise ValueError(
            f"The reward looks at the hinge of an object, but {', '.join(looked_at)} in the scene of this environment has "
            'none: use an environment with one, such as HumanoidDoor-v0, or another reward, such as "strike".'
        )


class HumanoidReward(EpisodicReward):
    """Rewards humanoids step by step for their states, drawing pictures only for a reward that needs them.

    All that it computes follows from proprioception, poses, latents and states of objects, which
    `record_controller_steps=True` puts into `info`: so the same object recomputes rewards on stored rollouts.

    Args:
        reward: the reward.
        texts: what each of the n humanoids should do.
        camera: where pictures are taken from.
        latents: the latents of the motion library ``(k, 64)``; None where actions are no latents.
        scene: the objects beside the humanoids; none if None.

    Attributes:
        style_latents: the latent of the library that each humanoid is compared with in this decision, ``(n, 64)``.
        library_latents: 128 latents of the library, always the same ones, for the nearest-latent style term.

    Raises:
        RenderingError: the reward looks at pictures, and none can be drawn on this machine.
        ValueError: the reward looks at latents or objects, and there are none.
    """

    def __init__(
        self,
        reward: RewardFn,
        texts: Sequence[str],
        camera: Camera,
        latents: NDArray[np.floating] | None = None,
        scene: Scene | None = None,
    ) -> None:
        self._scene = Scene() if scene is None else scene
        require_objects(reward, self._scene)
        if latents is None and reward.needs & _LATENT_NEEDS:
            raise ValueError(
                "The reward looks at latents of the controller, but the actions of this environment are none: use "
                'HumanoidLatent-v0, or a reward without style term (reward_kwargs={"style_weight": 0} for "clip").'
            )
        super().__init__(reward, texts)
        self._camera = camera
        self._renderer = HumanoidRenderer(scene=self._scene) if "frames" in reward.needs else None
        self._latents = np.zeros((1, 0), np.float32) if latents is None else latents.astype(np.float32)
        self.style_latents = np.zeros((len(self.texts), self._latents.shape[1]), np.float32)
        chosen = np.random.default_rng(0).permutation(len(self._latents))[:STYLE_LIBRARY_SIZE]
        self.library_latents = self._latents[chosen]

    def draw_style_latents(self, rng: np.random.Generator) -> None:
        """Draw the latents of the motion library to compare with, if the reward does."""
        if "style_latent" in self.reward.needs:
            self.style_latents = self._latents[rng.integers(len(self._latents), size=len(self.texts))]

    def style_info(self) -> dict[str, FloatArray]:
        """The drawn latents for `info`, if the reward used any: with them it can be recomputed."""
        return {"style_latent": self.style_latents.copy()} if "style_latent" in self.reward.needs else {}

    def start_from(
        self,
        ids: NDArray[np.int64],
        observation: FloatArray,
        qpos: NDArray[np.float64],
        objects: FloatArray | None = None,
    ) -> None:
        """Begin episodes of the humanoids `ids` ``(k,)`` in states as those of :meth:`of_step`, k rows."""
        self.start(ids, self._see(observation, qpos, objects=objects))

    def of_step(
        self,
        observation: FloatArray,
        qpos: NDArray[np.float64],
        latents: FloatArray | None = None,
        objects: FloatArray | None = None,
    ) -> RewardOutput:
        """Reward one controller step.

        Args:
            observation: proprioception after it, ``(n, 223)``.
            qpos: poses after it, ``(n, 35)``; of the whole scene if there are objects.
            latents: unit latents that drove it, ``(n, 64)``.
            objects: states of the objects after it, ``(n, m)``, see :func:`anyskill_envs.objects.state.object_vectors`.
        """
        return self(self._see(observation, qpos, latents, objects))

    def close(self) -> None:
        """Free the GL context."""
        if self._renderer is not None:
            self._renderer.close()

    def _see(
        self,
        observation: FloatArray,
        qpos: NDArray[np.float64],
        latents: FloatArray | None = None,
        objects: FloatArray | None = None,
    ) -> RewardBatch:
        needs = self.reward.needs
        frames = velocity = facing = None
        if self._renderer is not None:
            frames = np.stack([self._renderer.render(pose, self._camera) for pose in qpos])
        if needs & {"velocity", "facing"}:
            yaw = heading(qpos[:, 3:7])
            facing = np.stack([np.cos(yaw), np.sin(yaw)], axis=-1).astype(np.float32)
            ahead, aside = observation[:, _PELVIS_VELOCITY].T[:, :, None]
            left = np.stack([-facing[:, 1], facing[:, 0]], axis=-1)
            velocity = ahead * facing + aside * left
        return RewardBatch(
            observation=observation,
            frames=frames,
            latent=latents,
            style_latent=self.style_latents if latents is not None and "style_latent" in needs else None,
            library_latents=self.library_latents if "library_latents" in needs else None,
            velocity=velocity,
            facing=facing,
            objects=object_states(self._scene, objects) if objects is not None and self._scene else None,
        )
