"""The conditional discriminator D(s, s' | z) and what it sees of the humanoid."""

from collections.abc import Iterator, Sequence

import numpy as np
import torch
from torch import nn

from agents.controller.networks import Normalizer, mlp
from anyskill_envs.controller import LATENT_SIZE
from anyskill_envs.observation import OBSERVATION_LAYOUT
from motion_data.skeleton import BODY_NAMES, HEAD_CENTRE, JOINT_NAMES, load_model

_PARENTS = load_model().body_parentid[1:] - 1
# Hands are welded: they have no rotation of their own.
_JOINTED = np.flatnonzero((load_model().body_jntnum[1:] > 0) & (_PARENTS >= 0))
_KEY_BODIES = [BODY_NAMES.index(name) - 1 for name in ("right_hand", "left_hand", "right_foot", "left_foot")]
_HEAD = BODY_NAMES.index("head")

IMITATION_FEATURES = 1 + 6 + 3 + 3 + 6 * len(_JOINTED) + len(JOINT_NAMES) + 3 * len(_KEY_BODIES)
"""125 numbers per frame: root height, rotation, velocity and turning; joint rotations; hinge velocities; hands and feet."""


def imitation_features(observation: np.ndarray, hinge_velocities: np.ndarray) -> np.ndarray:
    """What the discriminator sees of one frame (AMP, Peng et al. 2021; as the released code of CALM and AnySkill).

    Args:
        observation: Observations, ``(n, 223)``.
        hinge_velocities: ``qvel[6:]``, ``(n, 28)`` rad/s.

    Returns:
        Float32 ``(n, 125)``: root height; root rotation without heading (two columns); root velocity and angular
        velocity in the heading frame; for each of the 12 jointed bodies its rotation relative to its parent (two
        columns); hinge velocities; hands and feet relative to the root in the heading frame.
    """
    count = len(observation)
    columns = observation[:, OBSERVATION_LAYOUT["body_rotations"]].reshape(count, len(BODY_NAMES), 2, 3)
    parent = columns[:, _PARENTS[_JOINTED]]
    frame = np.stack([parent[:, :, 0], np.cross(parent[:, :, 1], parent[:, :, 0]), parent[:, :, 1]], 2)
    relative = columns[:, _JOINTED] @ frame.swapaxes(2, 3)  # columns of R_parent^T R_child
    positions = observation[:, OBSERVATION_LAYOUT["body_positions"]].reshape(count, -1, 3)
    root = [
        observation[:, start : start + size]
        for start, size in (
            (OBSERVATION_LAYOUT["root_height"].start, 1),
            (OBSERVATION_LAYOUT["body_rotations"].start, 6),
            (OBSERVATION_LAYOUT["body_linear_velocities"].start, 3),
            (OBSERVATION_LAYOUT["body_angular_velocities"].start, 3),
        )
    ]
    parts = [*root, relative.reshape(count, -1), hinge_velocities, positions[:, _KEY_BODIES].reshape(count, -1)]
    return np.concatenate(parts, 1, dtype=np.float32)


def head_height(observation: np.ndarray) -> np.ndarray:
    """Height of the centre of the head in metres, ``(n,)``, read off observations ``(n, 223)``."""
    place = OBSERVATION_LAYOUT["body_positions"].start + 3 * (_HEAD - 1)
    rotation = OBSERVATION_LAYOUT["body_rotations"].start + 6 * _HEAD
    forward, _, up = HEAD_CENTRE
    lift = forward * observation[:, rotation + 2] + up * observation[:, rotation + 5]
    return observation[:, 0] + observation[:, place + 2] + lift


class Discriminator(nn.Module):
    """Logit of the probability that some consecutive frames come from the reference motion that the latent stands for.

    Args:
        frames: Frames of a transition.
        style_hidden: Widths of the branch that reads the latent; the last is joined to the frames, after a tanh.
        hidden: Widths of the layers after that.
    """

    def __init__(
        self, frames: int, style_hidden: Sequence[int] = (512, 256, 64), hidden: Sequence[int] = (1024, 1024, 512)
    ):
        super().__init__()
        self.normalizer = Normalizer(IMITATION_FEATURES)
        self.style = mlp([LATENT_SIZE, *style_hidden])
        self.network = mlp([frames * IMITATION_FEATURES + style_hidden[-1], *hidden, 1])

    def normalise(self, transitions: torch.Tensor) -> torch.Tensor:
        """Normalised frames, flat: ``(n, frames, 125)`` to float32 ``(n, frames * 125)``."""
        return self.normalizer(transitions.float()).flatten(1)

    def forward(self, normal: torch.Tensor, latents: torch.Tensor) -> torch.Tensor:
        """Logits of normalised transitions ``(n, frames * 125)`` under latents ``(n, 64)``, float32 ``(n,)``."""
        style = torch.tanh(self.style(latents * LATENT_SIZE**0.5))
        return self.network(torch.cat([normal, style], 1)).float()[:, 0]

    def linear_layers(self) -> Iterator[nn.Linear]:
        """All layers with weights, the one that gives the logit last."""
        return (module for part in (self.style, self.network) for module in part if isinstance(module, nn.Linear))
