"""`anyskill motions list | show | import`: the motion clips of the project and the user's own."""

from __future__ import annotations

import json as json_format
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import tyro

from motion_data.library import MotionLibrary, imports_folder
from motion_data.readers import read_motion


def list_motions(category: str | None = None, mirrored: bool = False, json: bool = False) -> int:
    """List the motion clips: name, length, sampling weight, categories and what they show.

    Args:
        category: Only clips of this category.
        mirrored: Also list the mirror images that the library adds.
        json: Print JSON instead of a table.

    Returns:
        0.

    Raises:
        ValueError: No clip has the category.
    """
    library = MotionLibrary.default(mirrored=mirrored)
    rows = [
        {
            "name": clip.name,
            "seconds": round(clip.duration, 2),
            "weight": round(float(weight), 5),
            "categories": list(clip.categories),
            "labels": list(clip.labels),
            "source": clip.source,
            "licence": clip.licence,
        }
        for clip, weight in zip(library.clips, library.weights, strict=True)
        if category is None or category in clip.categories
    ]
    if not rows:
        known = sorted({name for clip in library.clips for name in clip.categories})
        raise ValueError(f"No clip has the category '{category}'. The categories are: {', '.join(known)}.")
    if json:
        print(json_format.dumps(rows, indent=1))
        return 0
    width = max(len(str(row["name"])) for row in rows)
    for clip, weight in zip(library.clips, library.weights, strict=True):
        if category is None or category in clip.categories:
            label = clip.labels[0] if clip.labels else ""
            print(
                f"{clip.name:<{width}} {clip.duration:5.1f} s {weight:6.2%}  {', '.join(clip.categories):<27} {label}"
            )
    print(f"{len(rows)} clips, {sum(float(str(row['seconds'])) for row in rows):.0f} s")
    return 0


def show_motion(
    name: Annotated[str, tyro.conf.Positional],
    output: Path | None = None,
    frames: int = 12,
) -> int:
    """Write a contact sheet of a clip: evenly spaced frames from the front and from the side.

    Args:
        name: Name of the clip, as `anyskill motions list` prints it.
        output: The PNG file; NAME.png if not given.
        frames: How many frames.

    Returns:
        0.

    Raises:
        ValueError: There is no such clip, or frames is not positive.
        RenderingError: This machine cannot draw.
    """
    from anyskill_envs.rendering import Camera, HumanoidRenderer
    from motion_data.contact_sheet import contact_sheet

    clip = MotionLibrary.default()[name]
    renderer = HumanoidRenderer(width=200, height=240, preset="video")
    cameras = [
        Camera(position=(3.0, 0.0, 1.0), follow="position", look_at_height=0.9),
        Camera(position=(0.0, -3.0, 1.0), follow="position", look_at_height=0.9),
    ]
    views = [partial(renderer.render, camera=camera) for camera in cameras]
    try:
        path = contact_sheet(clip, output or Path(f"{name}.png"), views, frames)
    finally:
        renderer.close()
    print(f"{name}: {clip.duration:.1f} s, {clip.labels[0] if clip.labels else 'no label'}; wrote {path}")
    return 0


def import_motion(
    file: Annotated[Path, tyro.conf.Positional],
    name: str | None = None,
    label: tuple[str, ...] = (),
    category: tuple[str, ...] = ("imported",),
    up: Literal["y", "z"] | None = None,
    skeleton: Path | None = None,
    fps: float | None = None,
    joints: dict[str, str] | None = None,
    licence: str = "unknown",
    overwrite: bool = False,
) -> int:
    """Import a motion file into your own folder of clips; the library then has it.

    Reads BVH (.bvh), Acclaim (.amc with its .asf), AMASS (.npz), DeepMimic (.json, .txt) and clips of this project
    (.npz). The folder is ANYSKILL_CACHE/motions, by default ~/.cache/anyskill/motions.

    Args:
        file: The motion file.
        name: Name of the clip; from the file's name if not given.
        label: One or more sentences that say what is done.
        category: One or more categories for balanced sampling.
        up: Axis that points up; found from the motion if not given.
        skeleton: The .asf file of an .amc file; looked for beside it if not given.
        fps: Frames per second of an .amc file, which does not say; 120 if not given.
        joints: Names of joints that are not found by themselves, such as `right_knee Shin_R`.
        licence: Licence of the motion.
        overwrite: Replace an imported clip of the same name.

    Returns:
        0.

    Raises:
        FileNotFoundError: There is no such file.
        FileExistsError: A clip of that name exists.
        ValueError: The file cannot be read, or its joints cannot be mapped.
    """
    clip = read_motion(file, up=up, skeleton=skeleton, fps=fps, joints=joints)
    clip = replace(
        clip,
        name=name or clip.name,
        labels=label or clip.labels or ((name or clip.name).replace("_", " "),),
        categories=category,
        licence=licence if licence != "unknown" else clip.licence,
    )
    if not clip.name.replace("_", "").replace("-", "").isalnum():
        raise ValueError(f"A clip's name has letters, digits, - and _ only, got '{clip.name}'. Choose one with --name.")
    path = imports_folder() / f"{clip.name}.npz"
    if path.exists() and not overwrite:
        raise FileExistsError(f"You have imported a clip '{clip.name}' already. Pass --overwrite, or another --name.")
    if not path.exists() and clip.name in MotionLibrary.default().names:
        raise FileExistsError(f"The library has a clip '{clip.name}' already. Choose another name with --name.")
    clip.save(path)
    print(f"Imported {clip.name}: {clip.duration:.1f} s, {len(clip)} frames; wrote {path}")
    print(f"Look at it: anyskill motions show {clip.name}")
    return 0
