"""The clip that each humanoid follows: retrieved, stitched to where the humanoid is, and stepped along."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from anyskill_envs.actions import FloatArray
from anyskill_envs.controller import LATENT_SIZE, MotionEncoder
from motion_data.retrieval import MotionDatabase, MotionDatabases
from motion_data.retrieval_keys import CLIP_FRAMES, turned
from motion_data.skeleton import FRAME_RATE, heading
from motion_data.window import WINDOW_FRAMES, window_features

_CHUNK = 1024


class RetrievedClips:
    """Clips of 0.5 s that humanoids follow, and the latents that make the controller follow them.

    The latent of a frame is that of the 2 s of motion that begin with it; a motion that ends sooner stays in its last
    pose. Latents of all frames are computed once, when a database is added.

    Args:
        count: Humanoids.
        databases: What :class:`motion_data.retrieval.MotionDatabases` takes.
        encoder: The motion encoder of the controller.

    Attributes:
        databases: The databases.
        choice: Number of the database that each humanoid looks in, ``(n,)``.
        age: Frames since the clip was retrieved, ``(n,)``, at most 15.

    Raises:
        ValueError: If there is no database, or one cannot be made.
    """

    def __init__(self, count: int, databases: Mapping[str, MotionDatabase | str | Path], encoder: MotionEncoder):
        self.databases = MotionDatabases(databases)
        self._encoder = encoder
        self._latents = np.empty((0, LATENT_SIZE), np.float32)
        self._encode_new()
        self.choice = np.zeros(count, np.int64)
        self.age = np.zeros(count, np.int64)
        self._first = np.zeros(count, np.int64)
        self._turn = np.zeros(count)  # from the heading of the clip to that of the humanoid
        self._place = np.zeros((count, 2))  # of the humanoid, when the clip was stitched to it

    def add(self, name: str, source: MotionDatabase | str | Path) -> None:
        """Adds a database.

        Raises:
            ValueError: If the name is taken, or the database cannot be made.
        """
        self.databases.add(name, source)
        self._encode_new()

    def _encode_new(self) -> None:
        last, qpos = self.databases.last, self.databases.qpos
        rows = [self._latents]
        for start in range(len(self._latents), len(qpos), _CHUNK):
            frames = np.arange(start, min(start + _CHUNK, len(qpos)))
            index = np.minimum(frames[:, None] + np.arange(WINDOW_FRAMES), last[frames, None])
            rows.append(self._encoder.encode(window_features(qpos[index])))
        self._latents = np.concatenate(rows)

    def stitch(self, ids: NDArray[np.int64], frames: NDArray[np.int64], qpos: NDArray[np.float64]) -> None:
        """Lets humanoids follow the clips that begin at `frames`, moved and turned to where they are.

        Args:
            ids: The humanoids, ``(k,)``.
            frames: First frames of their clips, ``(k,)``.
            qpos: Their poses, ``(k, 35)``.
        """
        self._first[ids] = frames
        self.age[ids] = 0
        self._turn[ids] = heading(qpos[:, 3:7]) - heading(self.databases.qpos[frames, 3:7])
        self._place[ids] = qpos[:, :2]

    def advance(self, executed: NDArray[np.int64]) -> None:
        """Steps along the clips by frames ``(n,)``; a clip is over after 15."""
        self.age = np.minimum(self.age + executed, CLIP_FRAMES)

    @property
    def is_over(self) -> NDArray[np.bool_]:
        """Humanoids whose clip has ended, ``(n,)``."""
        return self.age >= CLIP_FRAMES

    @property
    def frames(self) -> NDArray[np.int64]:
        """The frame of the databases where each clip stands, ``(n,)``."""
        return self._first + self.age

    @property
    def latents(self) -> FloatArray:
        """The latents of these frames, ``(n, 64)``."""
        return self._latents[self.frames]

    @property
    def states(self) -> FloatArray:
        """The part of a key that these frames determine, ``(n, 27)``."""
        return self.databases.states[self.frames]

    @property
    def names(self) -> NDArray[np.str_]:
        """Name of the motion that each clip is part of, ``(n,)``."""
        return self.databases.motion_names(self._first)

    @property
    def headings(self) -> NDArray[np.float64]:
        """Headings of the stitched clips, ``(n,)`` radians in the world."""
        return heading(self.databases.qpos[self.frames, 3:7]) + self._turn

    @property
    def places(self) -> NDArray[np.float64]:
        """Horizontal places of the roots of the stitched clips, ``(n, 2)`` metres in the world."""
        way = self.databases.qpos[self.frames, :2] - self.databases.qpos[self._first, :2]
        return self._place + turned(way, self._turn)

    @property
    def velocities(self) -> NDArray[np.float64]:
        """Mean horizontal velocities of the stitched clips over their 0.5 s, ``(n, 2)`` m/s in the world."""
        qpos, end = self.databases.qpos, self._first + CLIP_FRAMES
        way = qpos[end, :2] - qpos[self._first, :2]
        return turned(way, self._turn) * (FRAME_RATE / CLIP_FRAMES)

    def pose(self, index: int, age: int | None = None) -> NDArray[np.float64]:
        """A stitched pose of one humanoid's clip, ``(35,)``: that in which it stands, or that of another age in frames."""
        first = self._first[index]
        pose = self.databases.qpos[first + (self.age[index] if age is None else age)].astype(np.float64)
        pose[:2] = self._place[index] + turned(pose[:2] - self.databases.qpos[first, :2], self._turn[index])
        w, x, y, z = pose[3:7]
        cosine, sine = np.cos(0.5 * self._turn[index]), np.sin(0.5 * self._turn[index])
        # the turn about the vertical axis comes after the clip's own rotation
        pose[3:7] = cosine * w - sine * z, cosine * x - sine * y, cosine * y + sine * x, cosine * z + sine * w
        return pose
