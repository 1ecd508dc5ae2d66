"""Reader for AMASS motions (``.npz`` with SMPL, SMPL+H or SMPL-X parameters): joint rotations on a mean skeleton.

The body model's files are licensed and not needed: only the rotations of the 22 body joints and the root's path are used,
on a skeleton of average proportions. Body shape (``betas``), hands, face and soft tissue are ignored.
"""

import zipfile
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from motion_data.clip import MotionClip
from motion_data.joint_motion import Y_UP_TO_OURS, JointMotion, UpAxis, place_joints
from motion_data.joint_retarget import clip_name, retarget

# The 22 body joints in SMPL's order: (name, parent, place in the parent's frame in centimetres). The pose with all
# rotations zero is a T-pose: y up, facing z, x left. Proportions of an average adult, rounded, both sides alike.
# Our names say what SMPL's joints are to retargeting: SMPL calls the ball of the foot "foot".
_SKELETON: tuple[tuple[str, str, tuple[float, float, float]], ...] = (
    ("pelvis", "", (0, 0, 0)),
    ("left_hip", "pelvis", (7, -9, 0)),
    ("right_hip", "pelvis", (-7, -9, 0)),
    ("spine1", "pelvis", (0, 11, -3)),
    ("left_knee", "left_hip", (3, -38, 0)),
    ("right_knee", "right_hip", (-3, -38, 0)),
    ("spine2", "spine1", (0, 14, 0)),
    ("left_ankle", "left_knee", (-1, -40, -4)),
    ("right_ankle", "right_knee", (1, -40, -4)),
    ("spine3", "spine2", (0, 5, 3)),
    ("left_toe", "left_ankle", (3, -6, 12)),
    ("right_toe", "right_ankle", (-3, -6, 12)),
    ("neck", "spine3", (0, 21, -4)),
    ("left_collar", "spine3", (8, 12, -3)),
    ("right_collar", "spine3", (-8, 12, -3)),
    ("head", "neck", (0, 7, 5)),
    ("left_shoulder", "left_collar", (9, 3, -1)),
    ("right_shoulder", "right_collar", (-9, 3, -1)),
    ("left_elbow", "left_shoulder", (26, -1, -3)),
    ("right_elbow", "right_shoulder", (-26, -1, -3)),
    ("left_wrist", "left_elbow", (25, 1, 0)),
    ("right_wrist", "right_elbow", (-25, 1, 0)),
)
_JOINTS = len(_SKELETON)
_RATES = ("mocap_framerate", "mocap_frame_rate")
_WIDTHS = {66: "SMPL+H body", 72: "SMPL", 156: "SMPL+H", 165: "SMPL-X"}


def is_amass(path: str | Path) -> bool:
    """Whether an ``.npz`` file has the joint rotations of an AMASS motion."""
    try:
        with np.load(path, allow_pickle=False) as archive:
            return "poses" in archive.files
    except (OSError, ValueError, EOFError, zipfile.BadZipFile):
        return False


def parse_amass(path: str | Path, up: UpAxis = "z") -> JointMotion:
    """Reads an AMASS motion.

    Args:
        path: The file, with ``poses`` ``(T, 66, 72, 156 or 165)`` (axis-angle, radians), ``trans`` ``(T, 3)`` (metres)
            and ``mocap_framerate``.
        up: Axis of the world that points up; z in AMASS.

    Returns:
        The 22 body joints in our axes. ``trans`` counts as the pelvis; in SMPL the two differ by a constant.

    Raises:
        FileNotFoundError: If there is no such file.
        ValueError: If it is no AMASS motion, or has NaN or no frames.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"No AMASS file at '{path}'.")
    if up not in ("y", "z"):
        raise ValueError(f"The up axis is y or z, not '{up}'.")
    poses, root, fps = _arrays(path)
    to_ours = Y_UP_TO_OURS if up == "y" else np.eye(3)
    local = Rotation.from_rotvec(poses.reshape(-1, 3)).as_matrix().reshape(len(poses), _JOINTS, 3, 3)
    # SMPL's T-pose in our axes; the root's rotation leads from SMPL's axes into the world's.
    local = Y_UP_TO_OURS @ local @ Y_UP_TO_OURS.T
    local[:, 0] = to_ours @ Y_UP_TO_OURS.T @ local[:, 0]
    names = [name for name, _, _ in _SKELETON]
    parents = tuple(names.index(parent) if parent else -1 for _, parent, _ in _SKELETON)
    offsets = np.array([place for _, _, place in _SKELETON]) / 100 @ Y_UP_TO_OURS.T
    translations = np.tile(offsets, (len(poses), 1, 1))
    translations[:, 0] = root @ to_ours.T
    return JointMotion(tuple(names), parents, offsets, *place_joints(parents, translations, local), fps)


def _arrays(path: Path) -> tuple[np.ndarray, np.ndarray, float]:
    """Rotation vectors of the body ``(T, 66)``, the root's path ``(T, 3)`` and frames per second."""
    try:
        with np.load(path, allow_pickle=False) as archive:
            missing = [name for name in ("poses", "trans") if name not in archive.files]
            rates = [name for name in _RATES if name in archive.files]
            if missing or not rates:
                missing += [] if rates else ["mocap_framerate"]
                raise ValueError(f"it has no {', '.join(missing)}, only {', '.join(archive.files) or 'nothing'}")
            poses = np.asarray(archive["poses"], float)
            root = np.asarray(archive["trans"], float)
            fps = float(archive[rates[0]])
    except (OSError, ValueError, TypeError, EOFError, zipfile.BadZipFile) as error:
        raise ValueError(f"'{path}' is not an AMASS motion ({error}).") from error
    if poses.ndim != 2 or poses.shape[1] not in _WIDTHS:
        widths = ", ".join(f"{width} ({model})" for width, model in _WIDTHS.items())
        raise ValueError(f"'{path}' has poses of shape {poses.shape}, expected (frames, n) with n one of {widths}.")
    if root.shape != (len(poses), 3):
        raise ValueError(
            f"'{path}' has {len(poses)} poses but trans of shape {root.shape}, expected ({len(poses)}, 3)."
        )
    if not len(poses):
        raise ValueError(f"'{path}' has no frames.")
    poses = poses[:, : 3 * _JOINTS]
    bad = np.flatnonzero(~(np.isfinite(poses).all(1) & np.isfinite(root).all(1)))
    if len(bad):
        raise ValueError(f"'{path}' has NaN or infinite numbers, first in frame {bad[0]}. Repair or cut these frames.")
    if not (np.isfinite(fps) and fps > 0):
        raise ValueError(f"'{path}' has the frame rate {fps}.")
    return poses, root, fps


def read_amass(
    path: str | Path,
    name: str | None = None,
    *,
    up: UpAxis = "z",
    labels: tuple[str, ...] = (),
    categories: tuple[str, ...] = ("imported",),
    licence: str = "unknown",
) -> MotionClip:
    """Reads an AMASS motion and retargets it to our skeleton at 30 frames per second.

    Args:
        path: The file.
        name: Name of the clip; the file's name without ``_poses`` or ``_stageii`` if None.
        up: Axis of the world that points up; z in AMASS.
        labels: Sentences that describe the motion.
        categories: Categories for balanced sampling.
        licence: Licence of the motion; AMASS's own allows no redistribution.

    Returns:
        The clip; see :func:`motion_data.joint_retarget.retarget`.

    Raises:
        FileNotFoundError: If there is no such file.
        ValueError: If it is no AMASS motion, or has NaN or no frames.
    """
    path = Path(path)
    motion = parse_amass(path, up)
    name = name or clip_name(path.stem.removesuffix("_poses").removesuffix("_stageii"))
    # The joints are in our axes already, so z is up.
    return retarget(motion, path, name, up="z", labels=labels, categories=categories, licence=licence)
