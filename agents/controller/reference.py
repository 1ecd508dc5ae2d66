"""Reference motions as flat arrays of frames, ready for batched tracking."""

from collections.abc import Sequence

import numpy as np

from anyskill_envs.observation import OBSERVATION_SIZE
from anyskill_envs.simulation import HumanoidSimulation
from motion_data.clip import MIRRORED_SUFFIX, MotionClip
from motion_data.library import mirror_name
from motion_data.window import WINDOW_FRAMES, window_features

IN_PLACE = 0.6
"""Metres that the root of a clip may move without travelling."""

_CHUNK = 1024
_LOOP_SECONDS = 5.0
_STILL = 0.25  # metres that it may move where a window shows only a part of a loop
_LEAD = 0.05  # seconds: PD control lags behind its target by about this much


class ReferenceMotions:
    """Clips one after another, with everything tracking needs per frame.

    Args:
        clips: Motion clips at 30 frames per second; loops are continued to at least 5 s.

    Attributes:
        names: Name of each clip.
        starts: First frame of each clip, ``(clips,)``.
        lengths: Frames of each clip, ``(clips,)``.
        clip_of_frame: Clip of each frame, ``(F,)``.
        last: Last frame of each frame's clip, ``(F,)``.
        qpos: Poses, ``(F, 35)``.
        qvel: Velocities, ``(F, 34)``.
        observations: What the humanoid would observe in this state, ``(F, 223)``.
        feedforward: Joint angles led by 0.05 s, ``(F, 28)``: PD control follows them closely.
        table: Observations and feed-forward side by side, ``(F, 223 + 28)``.
        period: Frames after which a held motion window starts again: whole cycles of a loop, else the window, ``(F,)``.
        seamless: Whether the window can start again without a jump (loops), ``(F,)`` bool.
        upright: Frames in which the humanoid is on its feet, ``(F,)`` bool.
        holdable: Frames of clips whose windows can be the intent for long: on the feet, and in place or a loop that a
            window shows whole. What comes after a window of any other clip cannot be known from it, ``(F,)`` bool.
        reflected: Frames of mirror images, and of clips whose twin (left and right exchanged in the name) comes first in
            the alphabet: they are to be performed as its mirror image, ``(F,)`` bool.

    Raises:
        ValueError: If there is no clip, or two clips have the same name.
    """

    def __init__(self, clips: Sequence[MotionClip]):
        if not clips:
            raise ValueError("No clips to train on. Pass at least one motion clip.")
        self.names = [clip.name for clip in clips]
        twice = {name for name in self.names if self.names.count(name) > 1}
        if twice:
            raise ValueError(f"Clips with the same name: {', '.join(sorted(twice))}. Rename them.")
        clips = [clip.resampled() for clip in clips]
        cycles = [len(clip) - 1 if clip.loop else WINDOW_FRAMES - 1 for clip in clips]
        period = [cycle * max(1, (WINDOW_FRAMES - 1) // cycle) for cycle in cycles]
        looping = [clip.loop for clip in clips]
        clips = [clip.repeated(_LOOP_SECONDS) for clip in clips]
        self.clips = clips
        self.lengths = np.array([len(clip) for clip in clips])
        self.starts = np.concatenate([[0], np.cumsum(self.lengths)[:-1]])
        self.period = np.repeat(period, self.lengths)
        self.seamless = np.repeat(looping, self.lengths)
        self.clip_of_frame = np.repeat(np.arange(len(clips)), self.lengths)
        self.last = np.repeat(self.starts + self.lengths - 1, self.lengths)
        self.qpos = np.concatenate([clip.qpos for clip in clips])
        self.qvel = np.concatenate([clip.qvel for clip in clips])
        self.observations, head = self._observe()
        self.feedforward = (self.qpos[:, 7:] + _LEAD * self.qvel[:, 6:]).astype(np.float32)
        self.table = np.concatenate([self.observations, self.feedforward], 1)
        self.reflected = np.repeat([self._is_reflected(name) for name in self.names], self.lengths)
        self.upright = (self.qpos[:, 2] > 0.5) & (head > 0.9)
        on_feet = np.logical_and.reduceat(self.upright, self.starts)
        travel = np.array([np.ptp(clip.qpos[:, :2], axis=0).max() for clip in clips])
        known = np.where(looping, (np.array(cycles) < WINDOW_FRAMES) | (travel < _STILL), travel < IN_PLACE)
        self.holdable = np.repeat(on_feet & known, self.lengths)

    def __len__(self) -> int:
        """Number of frames."""
        return len(self.qpos)

    def _is_reflected(self, name: str) -> bool:
        twin = mirror_name(name)
        return name.endswith(MIRRORED_SUFFIX) or (twin in self.names and twin < name)

    def _observe(self) -> tuple[np.ndarray, np.ndarray]:
        frames = len(self.qpos)
        simulation = HumanoidSimulation(min(_CHUNK, frames))
        observations = np.empty((frames, OBSERVATION_SIZE), np.float32)
        head = np.empty(frames)
        for start in range(0, frames, _CHUNK):
            first = min(start, frames - len(simulation))
            chunk = slice(first, first + len(simulation))
            simulation.reset(np.arange(len(simulation)), self.qpos[chunk], self.qvel[chunk])
            observations[chunk] = simulation.observation()
            head[chunk] = simulation.head_height
        return observations, head

    def ahead(self, frames: np.ndarray, steps: int | np.ndarray) -> np.ndarray:
        """Frames some steps later, stopping at the end of each clip."""
        return np.minimum(frames + steps, self.last[frames])

    def windows(self, frames: np.ndarray) -> np.ndarray:
        """The 2 s motion windows that begin at the given frames, float32 ``(n, 60, features)``.

        A window that reaches beyond its clip repeats the last pose.
        """
        frames = np.asarray(frames)
        index = np.minimum(frames[:, None] + np.arange(WINDOW_FRAMES), self.last[frames][:, None])
        return window_features(self.qpos[index])
