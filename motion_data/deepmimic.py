"""Reader for DeepMimic motion files, and the 15 humanoid clips that the ``pybullet`` package ships."""

import importlib.util
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from motion_data.clip import MotionClip
from motion_data.retarget import fit_hinges, place_feet
from motion_data.skeleton import QPOS_SIZE, joint_index, joint_limits

# Columns of a DeepMimic frame after duration (1), root position (3) and root quaternion (4): a quaternion (w first)
# for a ball joint, one angle for a hinge.
_JOINTS = (
    ("abdomen", 4),
    ("neck", 4),
    ("right_hip", 4),
    ("right_knee", 1),
    ("right_ankle", 4),
    ("right_shoulder", 4),
    ("right_elbow", 1),
    ("left_hip", 4),
    ("left_knee", 1),
    ("left_ankle", 4),
    ("left_shoulder", 4),
    ("left_elbow", 1),
)
_FRAME_SIZE = 8 + sum(size for _, size in _JOINTS)

# name: (categories, labels)
_PYBULLET_CLIPS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "walk": (("move_around", "usual"), ("walk forward", "walk", "take a walk")),
    "run": (("move_around", "usual"), ("run forward", "run", "jog ahead")),
    "kick": (("act_in_place", "attack"), ("kick forward", "a martial arts kick")),
    "punch": (("act_in_place", "attack"), ("punch", "throw punches", "box")),
    "dance_a": (("combined", "dance"), ("dance", "a lively dance")),
    "dance_b": (("combined", "dance"), ("dance", "dance with swinging arms")),
    "jump": (("combined", "jump"), ("jump", "jump up", "leap")),
    "spin": (("combined", "jump"), ("spin in the air", "jump and spin around")),
    "spinkick": (("combined", "attack", "jump"), ("spinning kick", "spin and kick in the air")),
    "crawl": (("move_around", "crawl"), ("crawl forward on hands and knees", "crawl")),
    "getup_facedown": (("act_in_place", "usual"), ("get up from lying face down", "stand up from the floor")),
    "getup_faceup": (("act_in_place", "usual"), ("get up from lying on the back", "stand up from the floor")),
    "roll": (("move_around", "crawl"), ("roll forward on the floor", "a forward roll")),
    "cartwheel": (("move_around", "jump"), ("turn a cartwheel", "cartwheel")),
    "backflip": (("act_in_place", "jump"), ("backflip", "flip backward in the air")),
}
# The files mark nearly all clips as loops; these are the ones whose last pose really leads into the first.
_LOOPS = {"walk", "run", "crawl", "dance_a", "dance_b"}


def _to_z_up(quaternions: np.ndarray) -> np.ndarray:
    """DeepMimic axes (x forward, y up, z right) to ours, quaternions w first ``(T, 4)``."""
    w, x, y, z = (quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)).T
    return np.stack([w, x, -z, y], 1)


def read_deepmimic(
    path: str | Path, name: str | None = None, labels: tuple[str, ...] = (), categories: tuple[str, ...] = ("usual",)
) -> MotionClip:
    """Reads a DeepMimic motion file and retargets it to our skeleton at 30 frames per second.

    The ball joints are fitted with our three hinges (see :func:`motion_data.retarget.fit_hinges`), knees and elbows
    change sign, and the feet are placed on the floor frame by frame.

    Args:
        path: A JSON file with ``Frames`` of 44 numbers.
        name: Name of the clip; the file name without ``humanoid3d_`` if None.
        labels: Sentences that describe the motion.
        categories: Categories for balanced sampling.

    Returns:
        The clip, starting at the origin.

    Raises:
        FileNotFoundError: If the file does not exist.
        ValueError: If it is not a DeepMimic humanoid motion.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"No DeepMimic file at '{path}'.")
    try:
        content = json.loads(path.read_text())
        frames = np.array(content["Frames"], dtype=np.float64)
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(f"'{path}' is not a DeepMimic motion file: it needs JSON with 'Frames' ({error}).") from error
    if frames.ndim != 2 or frames.shape[1] != _FRAME_SIZE or len(frames) < 2:
        raise ValueError(f"'{path}' has frames of shape {frames.shape}, expected (at least 2, {_FRAME_SIZE}).")
    if not np.isfinite(frames).all():
        raise ValueError(f"'{path}' has NaN or infinite numbers. Repair or cut these frames.")

    qpos = np.zeros((len(frames), QPOS_SIZE))
    x, y, z = frames[:, 1:4].T
    qpos[:, :3] = np.stack([x, -z, y], 1)
    qpos[:, 3:7] = _to_z_up(frames[:, 4:8])
    column = 8
    limits = joint_limits()
    for joint, size in _JOINTS:
        values = frames[:, column : column + size]
        column += size
        if size == 1:
            qpos[:, 7 + joint_index(joint)] = np.clip(-values[:, 0], *limits[joint_index(joint)])
        else:
            hinges = [joint_index(f"{joint}_{axis}") for axis in "xzy"]
            rotations = Rotation.from_quat(_to_z_up(values), scalar_first=True).as_matrix()
            qpos[:, [7 + hinge for hinge in hinges]] = fit_hinges(rotations, limits[hinges])
    clip = MotionClip(
        name=name or path.stem.removeprefix("humanoid3d_"),
        qpos=_at_uniform_times(qpos, frames[:, 0]),
        fps=60.0,
        source=f"DeepMimic motion file {path.name}",
        licence="see the file's source",
        labels=labels,
        categories=categories,
        loop=content.get("Loop") == "wrap",
    ).resampled()
    placed = place_feet(clip.qpos)
    placed[:, :2] -= placed[0, :2]
    return replace(clip, qpos=placed)


def _at_uniform_times(qpos: np.ndarray, durations: np.ndarray, fps: float = 60.0) -> np.ndarray:
    """Frames of varying duration to a uniform rate."""
    times = np.concatenate([[0], np.cumsum(durations[:-1])])
    uniform = np.arange(0, times[-1] + 1e-6, 1 / fps)
    signs = np.sign((qpos[1:, 3:7] * qpos[:-1, 3:7]).sum(1))
    qpos = qpos.copy()
    qpos[1:, 3:7] *= np.cumprod(np.where(signs == 0, 1, signs))[:, None]
    sampled = np.stack([np.interp(uniform, times, column) for column in qpos.T], 1)
    sampled[:, 3:7] /= np.linalg.norm(sampled[:, 3:7], axis=1, keepdims=True)
    return sampled


def pybullet_clips() -> list[MotionClip]:
    """The 15 motion-captured humanoid clips of the ``pybullet`` package, retargeted.

    Raises:
        ModuleNotFoundError: If pybullet is not installed.
    """
    specification = importlib.util.find_spec("pybullet_data")
    if specification is None or specification.origin is None:
        raise ModuleNotFoundError("The mocap clips come with pybullet. Install it: pip install pybullet")
    folder = Path(specification.origin).parent / "data" / "motions"
    clips = []
    for name, (categories, labels) in _PYBULLET_CLIPS.items():
        clip = read_deepmimic(folder / f"humanoid3d_{name}.txt", name, labels, categories)
        clips.append(
            replace(
                clip,
                source=f"pybullet_data/data/motions/humanoid3d_{name}.txt (DeepMimic, Peng et al. 2018)",
                loop=name in _LOOPS,
                licence="as shipped in the pybullet package; not redistributed here",
            )
        )
    return clips
