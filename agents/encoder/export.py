"""Writes trained towers as the ONNX files of an encoder, with their contract, and checks them against torch."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from agents.encoder.networks import ImageTower, TextHead
from anyskill_envs.observation import OBSERVATION_LAYOUT
from motion_data.files import write_whole
from rewards.bundled import FILM_FRAMES, MIRRORED, OBSERVATION_SIZE, READS_CLAUSES, contract
from rewards.minilm import TOKEN_SIZE
from rewards.onnx_files import export_module, open_session

VERSION = "6"
_TOLERANCE = 1e-4


def write_module(
    module: nn.Module, inputs: dict[str, Tensor], dynamic: tuple, path: Path, metadata: dict[str, str]
) -> None:
    """Exports a module whole or not at all; its output is called "feature".

    Args:
        module: the module.
        inputs: an example of each input, by name.
        dynamic: for each input which of its axes may have any length.
        path: the file.
        metadata: what the file says of itself.

    Raises:
        RuntimeError: the file gives another result than torch.
    """

    def write(temporary: Path) -> None:
        export_module(module, inputs, "feature", temporary, metadata, dynamic)
        with torch.no_grad():
            expected = module(*inputs.values()).numpy()
        given = {name: value.numpy() for name, value in inputs.items()}
        found = open_session(temporary, 0).run(["feature"], given)[0]
        difference = float(np.abs(found - expected).max())
        if difference > _TOLERANCE:
            raise RuntimeError(f"The exported '{path.name}' differs from the torch model by {difference:.2g}.")

    write_whole(path, write)


def write_state_tower(
    path: Path, state: nn.Module, metadata: Mapping[str, str], object_sizes: Mapping[str, int]
) -> None:
    """Writes a state tower.

    Args:
        path: the file.
        state: the tower: observations, and states of objects, to features.
        metadata: what the file says of itself, beside the layout of its inputs.
        object_sizes: which objects its second input is about, and how many numbers it takes of each; empty for none.
    """
    generator = torch.Generator().manual_seed(0)
    batch = torch.export.Dim("batch")
    layout = str({name: [place.start, place.stop] for name, place in OBSERVATION_LAYOUT.items()})
    inputs = {"observation": torch.randn(5, OBSERVATION_SIZE, generator=generator)}
    details = {"observation_layout": layout}
    if object_sizes:
        inputs["objects"] = torch.randn(5, sum(1 + size for size in object_sizes.values()), generator=generator)
        details["object_sizes"] = json.dumps(dict(object_sizes))
    write_module(state, inputs, tuple({0: batch} for _ in inputs), path, {**metadata, **details})


def export_towers(
    folder: Path,
    state: nn.Module,
    text: TextHead,
    feature_size: int,
    trained_on: str,
    object_sizes: Mapping[str, int] | None = None,
    training: str = "{}",
) -> None:
    """Writes the state projection and the text head.

    Args:
        folder: where to.
        state: the state tower with its mirror image.
        text: the text head.
        feature_size: size of the shared space.
        trained_on: one line about the data, for the metadata.
        object_sizes: see :func:`write_state_tower`.
        training: settings as JSON from which the captions of the training can be written again.
    """
    generator = torch.Generator().manual_seed(1)
    count, length = torch.export.Dim("texts"), torch.export.Dim("tokens", max=512)
    details = {"feature_size": str(feature_size), "version": VERSION, "trained_on": trained_on, "training": training}
    write_state_tower(folder / "state_projection.onnx", state, contract("state") | details, object_sizes or {})
    tokens, mask = torch.randn(3, 9, TOKEN_SIZE, generator=generator), torch.ones(3, 9)
    mask[0, 5:] = 0
    write_module(
        text,
        {"tokens": tokens, "mask": mask},
        ({0: count, 1: length}, {0: count, 1: length}),
        folder / "text_head.onnx",
        contract("text") | details | {READS_CLAUSES: "1", MIRRORED: "1"},
    )


def export_image_tower(folder: Path, image: ImageTower, size: int, feature_size: int, trained_on: str) -> None:
    """Writes the image tower.

    Args:
        folder: where to.
        image: the image tower.
        size: pixels per side of its frames.
        feature_size: size of the shared space.
        trained_on: one line about the data, for the metadata.
    """
    films = torch.randint(0, 256, (3, FILM_FRAMES, size, size, 3), generator=torch.Generator().manual_seed(0)).float()
    details = {"feature_size": str(feature_size), "version": VERSION, "trained_on": trained_on, "image_size": str(size)}
    write_module(
        image,
        {"films": films},
        ({0: torch.export.Dim("batch")},),
        folder / "image_tower.onnx",
        contract("image") | details,
    )
