"""The latent-conditioned controller as a torch model: motion encoder and policy."""

import numpy as np
import torch
from torch import nn

from agents.controller.networks import Normalizer, fast_arithmetic, mlp
from anyskill_envs.controller import LATENT_SIZE
from anyskill_envs.observation import OBSERVATION_SIZE
from motion_data.window import WINDOW_FEATURES

# Frames of the 2 s window that the encoder looks at: dense where the motion is about to happen, sparse later.
WINDOW_OFFSETS = (0, 1, 2, 3, 4, 6, 8, 10, 13, 16, 20, 25, 30, 36, 43, 51, 59)
ENCODER_INPUT = len(WINDOW_OFFSETS) * WINDOW_FEATURES


class MotionEncoderNetwork(nn.Module):
    """``E(window) -> z``: windows ``(n, 60, 39)`` to unit vectors ``(n, 64)``."""

    offsets: torch.Tensor

    def __init__(self) -> None:
        super().__init__()
        self.register_buffer("offsets", torch.tensor(WINDOW_OFFSETS), persistent=False)
        self.normalizer = Normalizer(ENCODER_INPUT)
        self.network = mlp([ENCODER_INPUT, 512, 256, LATENT_SIZE])

    def forward(self, windows: torch.Tensor) -> torch.Tensor:
        """Latents of whole windows."""
        return self.encode_flat(windows[:, self.offsets].flatten(1))

    def encode_flat(self, inputs: torch.Tensor) -> torch.Tensor:
        """Latents of the chosen frames of windows, ``(n, ENCODER_INPUT)``."""
        latent = self.network(self.normalizer(inputs)).float()
        return latent / (latent.norm(dim=-1, keepdim=True) + 1e-6)


class PolicyNetwork(nn.Module):
    """``pi(target | s, z)``: observations ``(n, 223)`` and latents ``(n, 64)`` to PD targets ``(n, 28)``."""

    def __init__(self, hidden: tuple[int, ...] = (768, 512)) -> None:
        super().__init__()
        self.normalizer = Normalizer(OBSERVATION_SIZE)
        self.network = mlp([OBSERVATION_SIZE + LATENT_SIZE, *hidden, 28])

    def forward(self, observation: torch.Tensor, latent: torch.Tensor) -> torch.Tensor:
        """PD targets in radians; the latent is scaled to unit variance per number."""
        return self.network(torch.cat([self.normalizer(observation), latent * LATENT_SIZE**0.5], -1)).float()


class Student(nn.Module):
    """Encoder and policy together, with the interface of the ONNX controller and encoder."""

    def __init__(self) -> None:
        super().__init__()
        self.encoder = MotionEncoderNetwork()
        self.policy = PolicyNetwork()

    @torch.no_grad()
    def act(self, observation: np.ndarray, latent: np.ndarray) -> np.ndarray:
        """PD targets, float32 ``(n, 28)``."""
        with fast_arithmetic():
            return self.policy(torch.from_numpy(observation), torch.from_numpy(latent)).numpy()

    @torch.no_grad()
    def encode(self, windows: np.ndarray) -> np.ndarray:
        """Latents of windows ``(n, 60, 39)``, float32 ``(n, 64)``."""
        with fast_arithmetic():
            return self.encoder(torch.from_numpy(windows)).numpy()
