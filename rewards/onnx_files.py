"""ONNX files: opening one for inference, and exporting a module to one."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import onnxruntime

from motion_data.files import write_whole

if TYPE_CHECKING:
    from torch import Tensor, nn


def open_session(path: Path, num_threads: int) -> onnxruntime.InferenceSession:
    """Opens a file for inference on the CPU.

    Args:
        path: The file.
        num_threads: Threads of one call; 0 for one per CPU.

    Raises:
        ValueError: It is not a readable ONNX file.
    """
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = num_threads
    options.log_severity_level = 3
    # Threads that spin while they wait for the next call would take the cores away from the physics.
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    try:
        return onnxruntime.InferenceSession(path.read_bytes(), options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime raises several unrelated types for a broken file
        raise ValueError(f"'{path}' is not a readable ONNX file ({error}).") from error


def export_module(
    module: nn.Module,
    inputs: dict[str, Tensor],
    output: str,
    path: Path,
    metadata: dict[str, str],
    dynamic_axes: Sequence[dict[int, Any]] | None = None,
) -> None:
    """Writes a module as ONNX, whole or not at all.

    Args:
        module: The module; it is put into evaluation mode.
        inputs: An example of each input, by name.
        output: Name of the output.
        path: The file.
        metadata: What the file says of itself.
        dynamic_axes: For each input the axes that may have any length, as `torch.export.Dim`s; the first axis if None.
    """
    import onnx
    import torch

    batch = torch.export.Dim("batch")
    axes = tuple({0: batch} for _ in inputs) if dynamic_axes is None else tuple(dynamic_axes)

    def write(temporary: Path) -> None:
        torch.onnx.export(
            module.eval(),
            tuple(inputs.values()),
            temporary,
            input_names=list(inputs),
            output_names=[output],
            dynamic_shapes=axes,
            dynamo=True,
            external_data=False,
            verbose=False,
        )
        model = onnx.load(temporary)
        onnx.helper.set_model_props(model, metadata)
        onnx.save(model, temporary)

    logging.getLogger("torch.onnx").setLevel(logging.ERROR)  # it tells everyone who has no torchvision
    with warnings.catch_warnings(), torch.no_grad():
        warnings.simplefilter("ignore")  # the exporter warns about its own internals
        write_whole(path, write)
