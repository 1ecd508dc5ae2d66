"""Contact sheets: one picture that shows a whole clip."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from motion_data.clip import MotionClip

View = Callable[[NDArray[np.float64]], NDArray[np.uint8]]
"""Draws one pose ``(35,)`` as a picture, uint8 ``(height, width, 3)``."""

_GAP = 4  # pixels between the pictures


def contact_sheet(
    clip: MotionClip, path: str | Path, views: Sequence[View], frames: int = 12, per_row: int = 6
) -> Path:
    """Writes a PNG with evenly spaced frames of a clip, each with its time.

    Args:
        clip: The clip.
        path: File to write.
        views: Every frame is drawn by each of them, one below the other, such as from the front and from the side.
        frames: Number of frames; at most as many as the clip has.
        per_row: Frames in a row.

    Returns:
        The path written.

    Raises:
        ValueError: If fewer than one frame or no view is asked for.
        ImportError: If Pillow is not installed.
    """
    if frames < 1 or per_row < 1 or not views:
        raise ValueError(
            f"A contact sheet needs frames >= 1, per_row >= 1 and a view; got {frames}, {per_row}, {views}."
        )
    chosen = evenly_spaced(len(clip), frames)
    columns = [np.concatenate([view(clip.qpos[frame]) for view in views]) for frame in chosen]
    return write_sheet(columns, [f"{frame / clip.fps:.2f} s" for frame in chosen], path, per_row)


def evenly_spaced(length: int, frames: int) -> NDArray[np.int_]:
    """Up to ``frames`` frames of a motion of that length, from its first to its last."""
    return np.linspace(0, length - 1, min(frames, length)).round().astype(int)


def write_sheet(columns: Sequence[NDArray[np.uint8]], captions: Sequence[str], path: str | Path, per_row: int) -> Path:
    """Writes pictures of the same size as one PNG.

    Args:
        columns: The pictures, uint8 ``(height, width, 3)`` each.
        captions: A few words in the corner of each.
        path: File to write.
        per_row: Pictures in a row.

    Returns:
        The path written.

    Raises:
        ImportError: If Pillow is not installed.
    """
    try:
        from PIL import Image, ImageDraw
    except ImportError as error:
        raise ImportError('A contact sheet needs Pillow: pip install "anyskill-envs[video]"') from error
    height, width = columns[0].shape[:2]
    rows = -(-len(columns) // per_row)
    across = min(per_row, len(columns))
    sheet = Image.new("RGB", (across * (width + _GAP) - _GAP, rows * (height + _GAP) - _GAP), "white")
    pen = ImageDraw.Draw(sheet)
    for index, (column, caption) in enumerate(zip(columns, captions, strict=True)):
        corner = (index % per_row * (width + _GAP), index // per_row * (height + _GAP))
        sheet.paste(Image.fromarray(column), corner)
        pen.text((corner[0] + 4, corner[1] + 2), caption, fill="black")
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    sheet.save(path)
    return path
