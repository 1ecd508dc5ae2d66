"""What rewards and encoders are told about an object beside the humanoid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float32]

BLOCKS = {"position": 3, "rotation": 6, "linear_velocity": 3, "angular_velocity": 3}
"""Blocks that every object has, and their sizes; `angle` and `angle_velocity` follow, one number for each of its joints."""


@dataclass(frozen=True)
class ObjectState:
    """State of one object in each of n scenes, in the heading frame of the humanoid: origin at its pelvis, x forward.

    Attributes:
        position: where the object is, metres from the pelvis, shape (n, 3).
        rotation: x and z axis of the object, shape (n, 6).
        linear_velocity: of its origin, m/s, shape (n, 3); that in the world, seen along the axes of the heading frame.
        angular_velocity: rad/s, shape (n, 3).
        angle: of each of its hinges and slides, rad or m, shape (n, j); j is 0 for most objects.
        angle_velocity: rad/s or m/s, shape (n, j).
    """

    position: FloatArray
    rotation: FloatArray
    linear_velocity: FloatArray
    angular_velocity: FloatArray
    angle: FloatArray
    angle_velocity: FloatArray

    def __len__(self) -> int:
        """Number of scenes n."""
        return len(self.position)

    @property
    def vector(self) -> FloatArray:
        """All blocks in their order, shape (n, 15 + 2 j)."""
        names = (*BLOCKS, "angle", "angle_velocity")
        return np.concatenate([getattr(self, name) for name in names], axis=1)

    @classmethod
    def from_vector(cls, vector: FloatArray) -> ObjectState:
        """The state whose `vector` this is, shape (n, 15 + 2 j)."""
        joints = (vector.shape[1] - sum(BLOCKS.values())) // 2
        ends = np.cumsum([*BLOCKS.values(), joints])
        return cls(*np.split(vector, ends, axis=1))
