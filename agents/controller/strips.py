"""Strips: for each clip one picture of the reference above what the controller makes of it, at the same moments."""

from pathlib import Path

import numpy as np

from agents.controller.reference import ReferenceMotions
from agents.controller.rollout import Controller, Encoder, perform
from anyskill_envs.rendering import Camera, HumanoidRenderer
from motion_data.contact_sheet import evenly_spaced, write_sheet
from motion_data.skeleton import FRAME_RATE

_WIDTH, _HEIGHT = 160, 200
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
