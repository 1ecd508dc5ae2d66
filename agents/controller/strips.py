"""Strips: for each clip one picture of the reference above what the controller makes of it, at the same moments."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from agents.controller.reference import ReferenceMotions
from agents.controller.rollout import Controller, Encoder, perform
from anyskill_envs.rendering import Camera, HumanoidRenderer
from motion_data.contact_sheet import evenly_spaced, write_sheet
from motion_data.skeleton import FRAME_RATE

_WIDTH, _HEIGHT = 160, 200
_PAGE_STRIPS, _PAGE_COLUMNS = 16, 2
_PAGE_CAPTION = 14  # pixels above each strip
# Half from the front, half from the side: limbs show in both directions. It walks along but does not turn along.
_CAMERA = Camera(position=(1.9, -1.9, 1.0), follow="position", look_at_height=0.85)


def draw_strips(
    controller: Controller, encoder: Encoder, motions: ReferenceMotions, folder: str | Path, frames: int = 10
) -> list[Path]:
    """Performs each clip once from its first frame and draws it.

    Args:
        controller: The controller.
        encoder: Its encoder.
        motions: The clips.
        folder: Where the pictures go, ``NAME.png``.
        frames: Pictures in a row.

    Returns:
        The paths written, in the order of the clips.

    Raises:
        ValueError: If frames is not positive.
        RenderingError: If this machine cannot draw.
    """
    if frames < 1:
        raise ValueError(f"A strip needs at least one frame, got {frames}.")
    renderer = HumanoidRenderer(_WIDTH, _HEIGHT, preset="video")
    performance = perform(controller, encoder, motions, np.arange(len(motions.names)))
    paths = []
    try:
        for clip, name in enumerate(motions.names):
            chosen = evenly_spaced(int(performance.lengths[clip]), frames)
            columns = [
                np.concatenate(
                    [
                        renderer.render(motions.qpos[motions.starts[clip] + frame], _CAMERA),
                        renderer.render(performance.qpos[clip, frame], _CAMERA),
                    ]
                )
                for frame in chosen
            ]
            captions = [f"{frame / FRAME_RATE:.2f} s" for frame in chosen]
            paths.append(write_sheet(columns, captions, Path(folder) / f"{name}.png", per_row=frames))
    finally:
        renderer.close()
    return paths


def write_pages(strips: Sequence[Path], folder: str | Path, width: int = 640) -> list[Path]:
    """Puts small copies of many strips on a few pages, each under the name of its clip.

    Args:
        strips: Pictures that :func:`draw_strips` wrote.
        folder: Where the pages go, ``page_1.webp`` and so on.
        width: Width of a strip on a page, pixels.

    Returns:
        The paths written.

    Raises:
        ValueError: If there is no strip.
    """
    from PIL import Image, ImageDraw

    if not strips:
        raise ValueError("No strips to put on pages. Draw at least one first.")
    Path(folder).mkdir(parents=True, exist_ok=True)
    pages: list[Path] = []
    for begin in range(0, len(strips), _PAGE_STRIPS):
        names = strips[begin : begin + _PAGE_STRIPS]
        pictures = [Image.open(path) for path in names]
        small = [picture.resize((width, round(picture.height * width / picture.width))) for picture in pictures]
        height = max(picture.height for picture in small) + _PAGE_CAPTION
        rows = -(-len(small) // _PAGE_COLUMNS)
        page = Image.new("RGB", (_PAGE_COLUMNS * (width + _PAGE_CAPTION), rows * height), "white")
        pen = ImageDraw.Draw(page)
        for index, (path, picture) in enumerate(zip(names, small, strict=True)):
            corner = (index % _PAGE_COLUMNS * (width + _PAGE_CAPTION), index // _PAGE_COLUMNS * height)
            pen.text(corner, path.stem.replace("_", " "), fill="black")
            page.paste(picture, (corner[0], corner[1] + _PAGE_CAPTION))
        pages.append(Path(folder) / f"page_{len(pages) + 1}.webp")
        page.save(pages[-1], quality=75)
    return pages
