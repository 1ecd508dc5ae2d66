"""One function that reads a motion file of any kind we know."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from motion_data.amass import is_amass, read_amass
from motion_data.asf_amc import read_amc
from motion_data.bvh import read_bvh
from motion_data.clip import MotionClip
from motion_data.deepmimic import read_deepmimic
from motion_data.joint_motion import UpAxis

KINDS = ".bvh; .amc (with its .asf); .npz of AMASS or of this project; .json or .txt of DeepMimic"
"""The motion files that can be read."""


def read_motion(
    path: str | Path,
    *,
    up: UpAxis | None = None,
    skeleton: str | Path | None = None,
    fps: float | None = None,
    joints: Mapping[str, str] | None = None,
) -> MotionClip:
    """Reads a motion file, by its extension, as a clip of our skeleton.

    Args:
        path: The file.
        up: Axis that points up (BVH, AMC, AMASS); found from the motion, z for AMASS, if None.
        skeleton: The ASF file of an AMC file; looked for beside it if None.
        fps: Frames per second of an AMC file, which does not say; 120 if None.
        joints: Names of the file's joints by role (BVH, AMC) where they are unusual; see
            :data:`motion_data.joint_motion.ROLES`.

    Returns:
        The clip, with the categories that its reader gives.

    Raises:
        FileNotFoundError: If there is no such file.
        ValueError: If the kind is unknown, an option does not fit it, or the file cannot be read.
    """
    path = Path(path)
    kind = path.suffix.lower()
    given = {"up": up, "skeleton": skeleton, "fps": fps, "joints": joints or None}
    if kind == ".bvh":
        return read_bvh(path, **_options(given, kind, "up", "joints"))
    if kind == ".amc":
        options = _options(given, kind, "up", "skeleton", "fps", "joints")
        return read_amc(path, asf=options.pop("skeleton", None), **options)
    if kind == ".asf":
        raise ValueError(f"'{path.name}' holds a skeleton without motion. Import an .amc file of it.")
    if kind == ".npz" and is_amass(path):
        return read_amass(path, **_options(given, ".npz", "up"))
    if kind == ".npz":
        _options(given, ".npz")
        return MotionClip.load(path)
    if kind in (".json", ".txt"):
        _options(given, kind)
        return read_deepmimic(path)
    raise ValueError(f"Cannot import '{path.name}': the known kinds are {KINDS}.")


def _options(given: Mapping[str, Any], kind: str, *allowed: str) -> dict[str, Any]:
    """The options that were given.

    Raises:
        ValueError: If one of them means nothing for this kind of file.
    """
    options = {name: value for name, value in given.items() if value is not None}
    wrong = sorted(set(options) - set(allowed))
    if wrong:
        raise ValueError(f"The option {', '.join(wrong)} means nothing for this {kind} file; leave it out.")
    return options
