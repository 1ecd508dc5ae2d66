"""What the YAML files of authored and planned clips share: how they are read, and what an entry says about its clip."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from motion_data.clip import MotionClip


def read_table(path: str | Path, clips: str) -> dict[str, Any]:
    """The content of a YAML file.

    Args:
        path: The file.
        clips: Name of the part that holds the entries of the clips by name.

    Raises:
        FileNotFoundError: If there is no such file.
        ValueError: If it has no such part.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"No file of clips at '{path}'.")
    content = yaml.load(path.read_text(encoding="utf-8"), Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader))
    if not isinstance(content, dict) or not isinstance(content.get(clips), dict):
        raise ValueError(f"'{path}' has no entries under `{clips}:`.")
    return content


def clip_and_twin(name: str, entry: Mapping[str, Any], qpos: np.ndarray, source: str, loop: bool) -> list[MotionClip]:
    """The clip of an entry with its labels and categories; and, if the entry has ``mirror``, its reflection of that name.

    Args:
        name: Name of the clip.
        entry: Its entry in the file.
        qpos: Its poses at 30 frames per second, ``(T, 35)``.
        source: Where it comes from.
        loop: Whether its last pose leads into its first.

    Raises:
        ValueError: If the entry has no labels or no categories.
    """
    for field in ("labels", "categories"):
        if not isinstance(entry.get(field), list):
            raise ValueError(f"Clip '{name}': `{field}` must be a list of texts.")
    labels, categories = tuple(entry["labels"]), tuple(entry["categories"])
    clip = MotionClip(name, qpos, source=source, licence="MIT", labels=labels, categories=categories, loop=loop)
    return [clip, replace(clip.mirrored(), name=entry["mirror"])] if "mirror" in entry else [clip]
