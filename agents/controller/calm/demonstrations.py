"""Draws from the reference motions: windows to encode, and transitions that belong to them."""

import numpy as np
import torch

from agents.controller.calm.discriminator import imitation_features
from agents.controller.reference import ReferenceMotions
from agents.controller.student import WINDOW_OFFSETS
from motion_data.window import WINDOW_FRAMES

_ALIGNMENT_FRAMES = 15  # 0.5 s


class Demonstrations:
    """The reference motions as CALM samples them: clips by weight, 2 s windows, transitions inside of a window.

    Args:
        motions: The reference motions.
        weights: Probability of each clip, ``(clips,)``; equal ones if None.
        offsets: Frames of a transition, counted back from its last one: ``(0, 1, ..., 9)`` in CALM.
        overhang: Frames by which a window may reach beyond the end of its clip, where the last pose is repeated.
        other_clip: Whether the latent of a mismatched pair comes from another clip, if there is one; from any clip
            otherwise, as in the papers.

    Attributes:
        features: What the discriminator sees of every frame, float32 ``(F, 125)``.
        window_inputs: What the encoder sees of the window that begins at every frame, ``(F, ENCODER_INPUT)``.
    """

    def __init__(
        self,
        motions: ReferenceMotions,
        weights: np.ndarray | None = None,
        offsets: tuple[int, ...] = tuple(range(10)),
        overhang: int = 0,
        other_clip: bool = False,
    ):
        self.motions = motions
        self.offsets = np.array(offsets)
        self._weights = np.full(len(motions.names), 1 / len(motions.names)) if weights is None else np.asarray(weights)
        self._other_clip = other_clip and len(motions.names) > 1
        self._last_start = np.maximum(motions.starts, motions.starts + motions.lengths - WINDOW_FRAMES + overhang)
        self._last_start = np.minimum(self._last_start, motions.starts + motions.lengths - 1)
        self.features = imitation_features(motions.observations, motions.qvel[:, 6:])
        self.window_inputs = _window_inputs(motions)

    def windows(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """First frames of random windows, ``(count,)``."""
        clips = rng.choice(len(self._weights), count, p=self._weights)
        return self._windows_of(rng, clips)

    def _windows_of(self, rng: np.random.Generator, clips: np.ndarray) -> np.ndarray:
        return rng.integers(self.motions.starts[clips], self._last_start[clips] + 1)

    def other_windows(self, rng: np.random.Generator, windows: np.ndarray) -> np.ndarray:
        """Windows whose latents do not belong to transitions of the given windows, the same shape."""
        if not self._other_clip:
            return self.windows(rng, len(windows))
        clip = self.motions.clip_of_frame[windows]
        shares = np.tile(self._weights, (len(windows), 1))
        shares[np.arange(len(windows)), clip] = 0
        bounds = np.cumsum(shares, 1)
        other = (rng.random(len(windows)) * bounds[:, -1])[:, None] >= bounds
        return self._windows_of(rng, np.minimum(other.sum(1), len(self._weights) - 1))

    def later_windows(self, rng: np.random.Generator, windows: np.ndarray) -> np.ndarray:
        """Windows of the same clips up to 0.5 s later, the same shape."""
        latest = self._last_start[self.motions.clip_of_frame[windows]]
        return np.minimum(windows + rng.integers(0, _ALIGNMENT_FRAMES + 1, len(windows)), latest)

    def transitions(self, rng: np.random.Generator, windows: np.ndarray) -> torch.Tensor:
        """A random transition inside of each window, float32 ``(n, frames, 125)``, newest frame first."""
        ends = windows + rng.integers(self.offsets.max(), WINDOW_FRAMES, len(windows))
        return torch.from_numpy(self.past(self.motions.clip_of_frame[windows], ends, self.offsets))

    def past(self, clips: np.ndarray, ends: np.ndarray, offsets: np.ndarray) -> np.ndarray:
        """Features of frames and of those before them; beyond either end of a clip its last frame there is repeated.

        Args:
            clips: Clip of each row, ``(n,)``.
            ends: Newest frame of each row, ``(n,)``.
            offsets: How far to go back, ``(k,)``.

        Returns:
            Features, float32 ``(n, k, 125)``.
        """
        first = self.motions.starts[clips][:, None]
        last = first + self.motions.lengths[clips][:, None] - 1
        return self.features[np.clip(ends[:, None] - offsets, first, last)]


def _window_inputs(motions: ReferenceMotions) -> torch.Tensor:
    parts = []
    for chunk in np.array_split(np.arange(len(motions)), max(1, len(motions) // 2000)):
        parts.append(motions.windows(chunk)[:, WINDOW_OFFSETS].reshape(len(chunk), -1))
    return torch.from_numpy(np.concatenate(parts))
