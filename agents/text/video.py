"""Videos of recorded poses, with a caption."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from anyskill_envs.objects.scene import Scene
from anyskill_envs.rendering import SCENE_CAMERA, Camera, Look, VideoLook, make_renderer
from motion_data.skeleton import FRAME_RATE

WIDTH, HEIGHT = 854, 480
CAPTION_SIZE = 22
# Half from the front, from a little above: both arms, both legs and the way on the floor can be seen.
CAMERA = Camera(position=(2.35, -1.5, 1.3), follow="position", look_at_height=1.0)
SCENE_CAMERA_STEADY = dataclasses.replace(SCENE_CAMERA, follow="position")
"""The camera for objects, without its turning with the humanoid."""


def caption_strip(lines: Sequence[str], width: int) -> NDArray[np.uint8]:
    """A dark strip with lines of light text, uint8 `(height, width, 3)`."""
    from PIL import Image, ImageDraw, ImageFont

    font = ImageFont.load_default(CAPTION_SIZE)
    strip = Image.new("RGB", (width, 12 + (CAPTION_SIZE + 8) * len(lines)), (24, 28, 36))
    draw = ImageDraw.Draw(strip)
    for row, line in enumerate(lines):
        draw.text((14, 8 + row * (CAPTION_SIZE + 8)), line, font=font, fill=(240, 240, 240))
    return np.asarray(strip)


def write_video(
    path: Path,
    qpos: NDArray[np.float64],
    caption: Sequence[str],
    scene: Scene | None = None,
    frames_per_second: float = FRAME_RATE,
    look: VideoLook = "simulation",
) -> None:
    """Writes an H.264 video of 854 x 480.

    Args:
        path: The file, ending in .mp4.
        qpos: Poses, `(T, 35)`, or those of the scene.
        caption: Lines of text below the humanoid.
        scene: The objects beside it; none if None.
        frames_per_second: Rate of the poses.
        look: "simulation" shows the shapes that the physics knows, "mannequin" a skinned mannequin, "beside" both (as in
            figure 7 of AnySkill).

    Raises:
        ImportError: imageio-ffmpeg or Pillow is not installed, or what draws the mannequin.
        RenderingError: This machine cannot draw.
    """
    try:
        import imageio_ffmpeg

        strip = caption_strip(caption, WIDTH)
    except ImportError as error:
        raise ImportError(f'Videos need {error.name}: pip install "anyskill-envs[video]".') from error
    looks: tuple[Look, ...] = ("simulation", "mannequin") if look == "beside" else (look,)
    width = WIDTH // len(looks)
    renderers = [make_renderer(each, width, HEIGHT - len(strip), "video", scene) for each in looks]
    camera = SCENE_CAMERA_STEADY if scene else CAMERA
    writer = imageio_ffmpeg.write_frames(
        str(path), (WIDTH, HEIGHT), fps=frames_per_second, macro_block_size=2, quality=7, ffmpeg_log_level="error"
    )
    writer.send(None)  # starts ffmpeg
    try:
        for pose in qpos:
            views = np.concatenate([renderer.render(pose, camera) for renderer in renderers], axis=1)
            picture = np.concatenate([views, strip])
            writer.send(np.ascontiguousarray(picture))
    finally:
        writer.close()
        for renderer in renderers:
            renderer.close()
