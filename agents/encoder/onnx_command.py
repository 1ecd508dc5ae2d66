"""`anyskill encoder export`: a CLIP-like model of transformers as ONNX files."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro


def export(name: Annotated[str, tyro.conf.Positional], folder: Annotated[Path, tyro.conf.Positional]) -> int:
    """Write a CLIP-like model of transformers as ONNX files, which any --encoder takes.

    Args:
        name: Name of the model on the Hugging Face hub, or its folder.
        folder: Where to; use it as --encoder FOLDER.
    """
    from rewards.encoders import HUB_PREFIX
    from rewards.onnx_encoder import export_encoder
    from rewards.transformers_encoder import TransformersEncoder

    difference = export_encoder(TransformersEncoder(name.removeprefix(HUB_PREFIX)), folder)
    print(f"Wrote {folder}; its features differ from those of transformers by {difference:.1g} at most.")
    return 0
