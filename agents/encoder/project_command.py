"""`anyskill encoder project`: a state projection for any encoder, so that rewards need no pictures."""

from __future__ import annotations

import dataclasses
import json
import shutil
from pathlib import Path

import numpy as np
import torch

from agents.encoder.export import write_state_tower
from agents.encoder.projecting import collect_states, fit_projection, image_features, measure_speed
from anyskill_envs.controller import LowLevelController
from anyskill_envs.objects.scene import Scene
from anyskill_envs.rendering import Camera, camera_of
from rewards.encoders import load_encoder
from rewards.projection import (
    FRONT_VIEW,
    OBSERVATION_SIZE,
    ProjectedEncoder,
    StateProjection,
    projection_contract,
    projection_path,
)


def project(
    encoder: str,
    states: int = 20000,
    steps: int = 6000,
    objects: tuple[str, ...] = (),
    camera: tuple[float, float, float] | None = None,
    out: Path | None = None,
    seed: int = 0,
    threads: int = 1,
) -> int:
    """Fit a state projection to an encoder's image features, so that `--encoder NAME` needs no rendering.

    The frozen controller is rolled out with random latents of its library; pictures of the states go through the encoder,
    and a small network learns the feature from the state. What is reported comes from rollouts that it was not fitted to.
    A run that was stopped goes on where it was.

    Args:
        encoder: Name of an encoder or its folder, as for `anyskill train --encoder`.
        states: How many states are drawn and encoded; nearly all of the time.
        steps: Steps of gradient descent.
        objects: Objects beside the humanoid, whose states the projection is then told.
        camera: Where the camera stands, metres ahead of the humanoid, to its left, above the floor; that of the
            environments if not given.
        out: File to write; if not given, the cache, where `--encoder NAME` finds the projection for the usual camera.
        seed: Seed of all randomness.
        threads: Threads of torch.
    """
    if states < 100 or steps < 1:
        raise ValueError(f"A projection needs at least 100 states and 1 step, not {states} and {steps}.")
    torch.set_num_threads(threads)
    scene = Scene(objects)
    view = camera_of(None if camera is None else {"position": camera}, scene)
    path = projection_path(encoder, view_name(view, scene)) if out is None else out
    made = load_encoder(encoder, projection=False)
    rng = np.random.default_rng(seed)
    collected = collect_states(states, scene, LowLevelController.load(num_threads=1), rng)
    work = path.with_name(f".{path.stem}.partial")
    settings = json.dumps([projection_contract(made), states, seed, dataclasses.asdict(view), objects])
    if not (work / "settings.json").is_file() or (work / "settings.json").read_text() != settings:
        shutil.rmtree(work, ignore_errors=True)
    work.mkdir(parents=True, exist_ok=True)
    (work / "settings.json").write_text(settings)
    features = np.array(image_features(made, collected.poses, scene, view, work / "features.npy"))
    fit = fit_projection(collected, features, steps, rng)
    metadata = projection_contract(made) | {
        "encoder": encoder,
        "camera": json.dumps(dataclasses.asdict(view)),
        "states": str(len(collected.poses)),
        "held_out_cosine": f"{fit.cosine:.4f}",
    }
    write_state_tower(path, fit.tower, metadata, collected.object_sizes)
    shutil.rmtree(work, ignore_errors=True)
    fitted = ProjectedEncoder(made, StateProjection(path))
    drawn, projected = measure_speed(fitted, collected.poses, collected.inputs[:, :OBSERVATION_SIZE], scene, view)
    print(f"Wrote {path}")
    print(f"cosine with the image feature on unseen rollouts: {fit.cosine:.3f}; 1 in 100 is below {fit.worst:.3f}")
    print(f"the mean feature alone: {fit.constant:.3f}; variance explained: {100 * fit.explained:.0f} %")
    print(
        f"per state: {1e6 * projected:.1f} us, with rendering {1e3 * drawn:.1f} ms: {drawn / projected:,.0f} times as fast"
    )
    if path != projection_path(encoder):
        print(f"In code: load_encoder({encoder!r}, projection={str(path)!r})")
    elif getattr(made, "has_state_projection", True):
        print(
            f"The encoder has a projection of its own; this one is load_encoder({encoder!r}, projection={str(path)!r})"
        )
    return 0


def view_name(camera: Camera, scene: Scene) -> str:
    """A file name for a camera and the objects that it shows; "front" for AnySkill's camera and the humanoid alone."""
    if camera == Camera() and not scene:
        return FRONT_VIEW
    numbers = "_".join(f"{value:g}" for value in camera.position)
    return "-".join([numbers, camera.follow, *scene.parts])
