"""The 223-number observation of the low-level and high-level policies (AnySkill, CALM: facts of the released code).

Everything is expressed in the root's heading frame: origin at the root, turned by the root's heading. That is the twist
about the vertical axis, not the direction of the x axis as in the released code: see :func:`motion_data.skeleton.heading`.
"""

import numpy as np
from gymnasium.spaces import Box

from motion_data.skeleton import BODY_NAMES, MIRROR_BODIES

Components = tuple[np.ndarray, np.ndarray, np.ndarray]
"""The x, y and z of vectors, each ``(...)``."""
_BODIES = len(BODY_NAMES)

OBSERVATION_LAYOUT: dict[str, slice] = {}
"""Name of each block of the observation and its place."""
_offset = 0
for _name, _size in (
    ("root_height", 1),
    ("body_positions", 3 * (_BODIES - 1)),
    ("body_rotations", 6 * _BODIES),
    ("body_linear_velocities", 3 * _BODIES),
    ("body_angular_velocities", 3 * _BODIES),
):
    OBSERVATION_LAYOUT[_name] = slice(_offset, _offset + _size)
    _offset += _size
OBSERVATION_SIZE = _offset
"""223."""
OBSERVATION_BOUNDS = {
    "root_height": 100.0,  # m
    "body_positions": 3.0,  # m from the pelvis
    "body_rotations": 1.0,  # numbers of rotation matrices
    "body_linear_velocities": 100.0,  # m/s
    "body_angular_velocities": 300.0,  # rad/s
}
"""Bounds of each block, far outside of what a humanoid does: they keep a violent tumble finite for a policy."""


def proprioception_space() -> Box:
    """Space of the observation of one humanoid."""
    high = np.empty(OBSERVATION_SIZE, np.float32)
    for name, place in OBSERVATION_LAYOUT.items():
        high[place] = OBSERVATION_BOUNDS[name]
    return Box(-high, high, dtype=np.float32)


def observe(
    positions: np.ndarray, quaternions: np.ndarray, linear_velocities: np.ndarray, angular_velocities: np.ndarray
) -> np.ndarray:
    """Builds observations from body states in the world frame.

    Args:
        positions: Origins of the bodies, ``(n, 15, 3)`` metres; the root comes first.
        quaternions: Orientations, w first, ``(n, 15, 4)``.
        linear_velocities: Velocities of the origins, ``(n, 15, 3)`` m/s.
        angular_velocities: Angular velocities, ``(n, 15, 3)`` rad/s.

    Returns:
        Observations, float32 ``(n, 223)``: root height; positions of the other 14 bodies relative to the root; for each
        body the first (x axis, "tangent") and third (z axis, "normal") column of its rotation matrix; linear velocities;
        angular velocities; all turned into the heading frame. See :data:`OBSERVATION_LAYOUT`.
    """
    count = len(positions)
    # All that follows the root height are vectors. With their components apart, arrays are contiguous, and turned in a third
    # of the time.
    vectors = np.empty((3, count, (OBSERVATION_SIZE - 1) // 3), np.float32)

    def block(name: str) -> np.ndarray:
        place = OBSERVATION_LAYOUT[name]
        return vectors[..., (place.start - 1) // 3 : (place.stop - 1) // 3]

    places = np.array(np.moveaxis(positions, -1, 0), order="C")
    block("body_positions")[:] = places[..., 1:] - places[..., :1]
    axes = rotation_axes(np.ascontiguousarray(np.moveaxis(quaternions, -1, 0), np.float32))
    for column, axis in enumerate(axes):
        for component, numbers in enumerate(axis):
            block("body_rotations")[component, :, column::2] = numbers
    block("body_linear_velocities")[:] = np.moveaxis(linear_velocities, -1, 0)
    block("body_angular_velocities")[:] = np.moveaxis(angular_velocities, -1, 0)

    cosine, sine = (part[:, None] for part in heading_direction(quaternions[:, 0]))
    observation = np.empty((count, OBSERVATION_SIZE), np.float32)
    observation[:, 0] = positions[:, 0, 2]
    turn_to_heading(observation[:, 1:].reshape(count, -1, 3), vectors, cosine, sine)
    return observation


def heading_direction(quaternions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cosine and sine of the heading of orientations ``(n, 4)``, float32 ``(n,)`` each."""
    w, _, _, z = np.moveaxis(quaternions, -1, 0)
    # Cosine and sine of twice the angle of (w, z): see motion_data.skeleton.heading.
    square = np.maximum(w * w + z * z, 1e-9)
    return ((w * w - z * z) / square).astype(np.float32), (2 * w * z / square).astype(np.float32)


def turn_to_heading(target: np.ndarray, vectors: np.ndarray | Components, cosine: np.ndarray, sine: np.ndarray) -> None:
    """Writes world vectors, turned by minus the heading, into an array or view.

    Args:
        target: where to write, ``(..., 3)``.
        vectors: the vectors, components first, ``(3, ...)``.
        cosine: cosine of the heading, of a shape that broadcasts with ``(...)``.
        sine: its sine.
    """
    x, y, z = vectors
    target[..., 0] = cosine * x + sine * y
    target[..., 1] = cosine * y - sine * x
    target[..., 2] = z


def rotation_axes(quaternions: np.ndarray) -> tuple[Components, Components]:
    """Components, each ``(...)``, of the first and third columns of rotation matrices of quaternions ``(4, ...)``."""
    w, x, y, z = quaternions
    first = (1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y))
    third = (2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y))
    return first, third


def _mirror_map() -> tuple[np.ndarray, np.ndarray]:
    """Source index and sign of every number of a mirrored observation."""
    index, sign = np.arange(OBSERVATION_SIZE), np.ones(OBSERVATION_SIZE, np.float32)
    vector = np.array([1, -1, 1], np.float32)  # a reflection in the x-z plane reverses y of vectors ...
    axial = -vector  # ... and x and z of angular velocities
    # Reflected rotation matrices are M R M with M = diag(1, -1, 1): y of the x and z axes is reversed.
    for name, per_body, signs, bodies in (
        ("body_positions", 3, vector, MIRROR_BODIES[1:] - 1),
        ("body_rotations", 6, np.tile(vector, 2), MIRROR_BODIES),
        ("body_linear_velocities", 3, vector, MIRROR_BODIES),
        ("body_angular_velocities", 3, axial, MIRROR_BODIES),
    ):
        place = OBSERVATION_LAYOUT[name]
        index[place] = (place.start + bodies[:, None] * per_body + np.arange(per_body)).ravel()
        sign[place] = np.tile(signs, len(bodies))
    return index, sign


MIRROR_INDEX, MIRROR_SIGN = _mirror_map()
"""``observation[..., MIRROR_INDEX] * MIRROR_SIGN`` is the observation of the humanoid reflected in its x-z plane."""
