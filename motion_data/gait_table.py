"""The bundled gaits: ``assets/gaits.yaml`` names them and their numbers, :mod:`motion_data.gait_plan` plans their motion."""

from collections.abc import Mapping
from dataclasses import fields
from functools import cache
from pathlib import Path
from typing import Any

from motion_data.clip import MotionClip
from motion_data.clip_table import clip_and_twin, read_table
from motion_data.gait import Gait
from motion_data.gait_plan import pose_gaits

GAITS_YAML = Path(__file__).parent / "assets" / "gaits.yaml"
"""The table of gaits."""


def read_gaits(path: str | Path = GAITS_YAML) -> list[MotionClip]:
    """Builds the clips of a table of gaits.

    Args:
        path: YAML file with ``gaits``: name, labels, categories, optionally ``mirror`` (name of a second clip, reflected
            left to right), and fields of :class:`motion_data.gait.Gait`.

    Returns:
        The clips, in the order of the file; a mirrored twin follows its original.

    Raises:
        FileNotFoundError: If there is no such file.
        ValueError: If an entry cannot be understood; the message names the clip.
    """
    entries = read_table(path, "gaits")["gaits"]
    gaits = [_gait(name, entry) for name, entry in entries.items()]
    clips = []
    for (name, entry), gait, qpos in zip(entries.items(), gaits, pose_gaits(gaits), strict=True):
        clips += clip_and_twin(name, entry, qpos, "planned by this project", gait.loops)
    return clips


def _gait(name: str, entry: Mapping[str, Any]) -> Gait:
    numbers = {key: value for key, value in entry.items() if key not in ("labels", "categories", "mirror")}
    known = [field.name for field in fields(Gait)]
    unknown = sorted(set(numbers) - set(known))
    if unknown:
        raise ValueError(f"Gait '{name}': unknown fields {unknown}. A gait knows {', '.join(known)}.")
    for key, value in numbers.items():
        if not isinstance(value, (int, float)):
            raise ValueError(f"Gait '{name}': {key} must be a number, got {value!r}.")
    try:
        return Gait(**numbers)
    except ValueError as error:
        raise ValueError(f"Gait '{name}': {error}") from error


@cache
def _bundled() -> tuple[MotionClip, ...]:
    return tuple(read_gaits())


def gait_clips() -> list[MotionClip]:
    """The bundled gaits at 30 frames per second."""
    return list(_bundled())


def flight_gaits() -> set[str]:
    """Names of the bundled gaits with a phase of flight, mirrored twins included."""
    entries = read_table(GAITS_YAML, "gaits")["gaits"]
    flying = [(name, entry) for name, entry in entries.items() if _gait(name, entry).runs]
    return {name for name, _ in flying} | {entry["mirror"] for _, entry in flying if "mirror" in entry}
