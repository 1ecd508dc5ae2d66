"""Makes docs/skills.png from the videos of finished runs: python tools/skills_picture.py RUN RUN ... (one column each).

docs/objects.png is made in the same way, with --output docs/objects.png --moments 0 0.15 0.4 0.9.
"""

import json
from pathlib import Path
from typing import Annotated

import imageio_ffmpeg
import numpy as np
import tyro
from PIL import Image, ImageDraw, ImageFont

CROP = (237, 20, 617, 430)
"""The part of a frame of 854 x 480 that shows the humanoid: left, top, right, bottom in pixels."""
TILE = (228, 246)
CAPTION = 30


def frames(video: Path, moments: tuple[float, ...]) -> list[np.ndarray]:
    """The frames of a video at some moments, `(height, width, 3)`."""
    reader = imageio_ffmpeg.read_frames(str(video))
    width, height = next(reader)["size"]
    film = [np.frombuffer(raw, np.uint8).reshape(height, width, 3) for raw in reader]
    return [film[int(share * (len(film) - 1))] for share in moments]


def main(
    runs: Annotated[list[Path], tyro.conf.Positional],
    output: Path = Path(__file__).parents[1] / "docs" / "skills.png",
    moments: tuple[float, ...] = (0.3, 0.55, 0.88),
) -> None:
    """Draws one column for each run, its text above the frames.

    Args:
        runs: run folders with config.json and video.mp4.
        output: the picture.
        moments: which frames are shown, as shares of the video.
    """
    sheet = Image.new("RGB", (TILE[0] * len(runs), CAPTION + TILE[1] * len(moments)), "white")
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(13)
    for column, run in enumerate(runs):
        text = json.loads((run / "config.json").read_text(encoding="utf-8"))["text"]
        draw.text((column * TILE[0] + 8, 7), text, font=font, fill=(30, 34, 42))
        for row, frame in enumerate(frames(run / "video.mp4", moments)):
            tile = Image.fromarray(frame).crop(CROP).resize(TILE, Image.Resampling.LANCZOS)
            sheet.paste(tile, (column * TILE[0], CAPTION + row * TILE[1]))
    output.parent.mkdir(exist_ok=True)
    sheet.save(output, optimize=True)


if __name__ == "__main__":
    tyro.cli(main)
