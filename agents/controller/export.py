"""Writes a trained student as the ONNX files that environments read."""

from pathlib import Path

import numpy as np
import torch
from safetensors.torch import save_file
from torch import nn

from agents.controller.reference import ReferenceMotions
from agents.controller.student import Student
from anyskill_envs.controller import (
    CONTROLLER_FILE,
    ENCODER_FILE,
    LATENT_SIZE,
    LATENTS_FILE,
    LowLevelController,
    MotionEncoder,
    contract,
)
from anyskill_envs.observation import OBSERVATION_SIZE
from motion_data.files import write_whole
from motion_data.window import WINDOW_FEATURES, WINDOW_FRAMES
from rewards.onnx_files import export_module

_LATENT_EVERY = 5  # frames between the windows whose latents are stored: one high-level decision


def export_student(
    student: Student, motions: ReferenceMotions, folder: Path, version: str, training_data: str
) -> tuple[Path, Path]:
    """Writes ``llc.onnx``, ``motion_encoder.onnx`` and ``latents.npz`` and checks them against the torch model.

    Args:
        student: The trained controller.
        motions: Motions whose latents are stored by clip name.
        folder: Where to write.
        version: Version of these weights.
        training_data: One line on what it was trained on.

    Returns:
        Paths of the controller and of the encoder.

    Raises:
        RuntimeError: If ONNX and torch disagree by more than 1e-4.
    """
    folder.mkdir(parents=True, exist_ok=True)
    student = student.float().eval()
    details = {"version": version, "training_data": training_data, "licence": "MIT"}
    observation, latent = torch.randn(3, OBSERVATION_SIZE), nn.functional.normalize(torch.randn(3, LATENT_SIZE))
    window = torch.randn(3, WINDOW_FRAMES, WINDOW_FEATURES)
    controller_path = folder / CONTROLLER_FILE.name
    encoder_path = folder / ENCODER_FILE.name
    export_module(
        student.policy,
        {"observation": observation, "latent": latent},
        "target",
        controller_path,
        contract("low_level_controller", **details),
    )
    export_module(student.encoder, {"window": window}, "latent", encoder_path, contract("motion_encoder", **details))
    controller, encoder = LowLevelController.load(controller_path), MotionEncoder.load(encoder_path)
    with torch.no_grad():
        for name, exported, expected in (
            ("controller", controller.act(observation.numpy(), latent.numpy()), student.policy(observation, latent)),
            ("encoder", encoder.encode(window.numpy()), student.encoder(window)),
        ):
            difference = float(np.abs(exported - expected.numpy()).max())
            if difference > 1e-4:
                raise RuntimeError(f"The exported {name} differs from the torch model by {difference:.2g}.")
    _write_latents(encoder, motions, folder / LATENTS_FILE.name)
    return controller_path, encoder_path


def save_student(student: Student, folder: Path) -> Path:
    """Writes the weights of a student, ``student.safetensors``, with which another training can begin."""
    path = folder / "student.safetensors"
    weights = {name: value.contiguous() for name, value in student.state_dict().items()}
    write_whole(path, lambda temporary: save_file(weights, temporary))
    return path


def _write_latents(encoder: MotionEncoder, motions: ReferenceMotions, path: Path) -> None:
    frames = np.concatenate(
        [
            np.arange(start, start + length, _LATENT_EVERY)
            for start, length in zip(motions.starts, motions.lengths, strict=True)
        ]
    )
    latents = np.concatenate(
        [encoder.encode(motions.windows(part)) for part in np.array_split(frames, len(frames) // 500 + 1)]
    )
    window_ends = motions.ahead(frames, WINDOW_FRAMES - 1)
    tumbles = np.concatenate([[0], np.cumsum(~motions.upright)])
    arrays = {
        "names": np.array(motions.names),
        "clips": motions.clip_of_frame[frames],
        "latents": latents.astype(np.float32),
        "standing": tumbles[window_ends + 1] == tumbles[frames],
    }
    write_whole(path, lambda temporary: np.savez_compressed(temporary, **arrays))
