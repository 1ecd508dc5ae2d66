"""Models of `transformers` as ONNX files: the same features, computed by onnxruntime instead of torch."""

from __future__ import annotations

import os
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import onnxruntime
from numpy.typing import NDArray

from rewards.base import FloatArray
from rewards.clip_like import ClipLikeEncoder, unit
from rewards.onnx_files import export_module, open_session
from rewards.transformers_encoder import INSTALL, TransformersEncoder, errors_that_help, load_part

KIND = "anyskill-clip-encoder"
FORMAT_VERSION = "1"
IMAGE_FILE, TEXT_FILE = "image.onnx", "text.onnx"
PARITY_TOLERANCE = 1e-4
"""Largest difference between an exported feature and that of `transformers`."""

_PROBES = ["wave the right hand", "squat", "raise both arms above the head and hold them there"]


class OnnxEncoder(ClipLikeEncoder):
    """A model of `transformers` that :func:`export_encoder` has written.

    Pictures and texts are prepared by the model's own image processor and tokenizer, whose files lie beside the towers.

    Args:
        folder: the exported files.
        batch_size: pictures that go through the model at once.
        num_threads: threads of onnxruntime within one call; 0 for one per CPU.

    Raises:
        FileNotFoundError: a file is missing.
        ImportError: `transformers` or `pillow` is not installed.
        ValueError: a file is no tower of such an encoder.
    """

    def __init__(self, folder: str | Path, batch_size: int = 64, num_threads: int = 0) -> None:
        if batch_size < 1:
            raise ValueError(f"batch_size must be at least 1, not {batch_size}.")
        self.folder = Path(folder)
        self.batch_size = batch_size
        self.num_threads = num_threads
        self._open()

    def _open(self) -> None:
        try:
            import transformers
        except ImportError as error:
            raise ImportError(f"Exported encoders need the package {error.name!r}. {INSTALL}") from error
        self._image, contract = self._session(IMAGE_FILE)
        self._text, text_contract = self._session(TEXT_FILE)
        self.name = contract["source"]
        self.feature_size = int(contract["feature_size"])
        self._max_tokens = int(text_contract["max_tokens"])
        with errors_that_help(str(self.folder)):
            self._tokenizer: Any = load_part(transformers.AutoTokenizer, str(self.folder))
            self._image_processor: Any = load_part(transformers.AutoImageProcessor, str(self.folder), backend="pil")

    def _session(self, file: str) -> tuple[onnxruntime.InferenceSession, dict[str, str]]:
        path = self.folder / file
        if not path.is_file():
            raise FileNotFoundError(
                f"There is no '{path}'. Write it with `anyskill encoder export NAME {self.folder}`."
            )
        try:
            session = open_session(path, self.num_threads)
        except ValueError as error:
            raise ValueError(f"{error} Write it again with `anyskill encoder export`.") from error
        contract = dict(session.get_modelmeta().custom_metadata_map)
        if contract.get("kind") != KIND or contract.get("format_version") != FORMAT_VERSION:
            raise ValueError(f"'{path}' was not written by this version of `anyskill encoder export`; write it again.")
        return session, contract

    def _encode_texts(self, texts: list[str]) -> FloatArray:
        inputs = self._tokenizer(
            texts, padding="max_length", truncation=True, max_length=self._max_tokens, return_tensors="np"
        )
        wanted = [each.name for each in self._text.get_inputs()]
        return unit(self._text.run(["feature"], {name: np.asarray(inputs[name], np.int64) for name in wanted})[0])

    def _encode_pictures(self, frames: NDArray[np.uint8]) -> FloatArray:
        inputs = self._image_processor(images=list(frames), input_data_format="channels_last", return_tensors="np")
        return unit(self._image.run(["feature"], {"pixel_values": np.asarray(inputs["pixel_values"], np.float32)})[0])

    def __getstate__(self) -> dict[str, Any]:
        return {"folder": self.folder, "batch_size": self.batch_size, "num_threads": self.num_threads}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._open()


def export_encoder(encoder: TransformersEncoder, folder: Path) -> float:
    """Writes a model of `transformers` as two ONNX files, with what prepares pictures and texts beside them.

    Texts are padded to the model's full length, which changes no feature: padding is masked, or stands behind the token
    that is read, or is what the model was trained with.

    Args:
        encoder: the model.
        folder: where to; it must be empty or not there yet, and is whole or not there at all afterwards.

    Returns:
        The largest difference between its features and those of `transformers`, on random pictures and three texts.

    Raises:
        FileExistsError: the folder is there already and not empty.
        ImportError: `onnx` or `onnxscript` is not installed.
        RuntimeError: the difference is more than 1e-4.
    """
    if folder.exists() and any(folder.iterdir()):
        raise FileExistsError(f"'{folder}' is not empty; choose another folder.")
    try:
        import onnx  # noqa: F401
        import onnxscript  # noqa: F401
    except ImportError as error:
        raise ImportError(f'The export needs {error.name}: pip install "anyskill-envs[train]".') from error
    temporary = folder.with_name(f".{folder.name}.partial")
    shutil.rmtree(temporary, ignore_errors=True)
    temporary.mkdir(parents=True)
    try:
        difference = _write(encoder, temporary)
        if folder.exists():
            folder.rmdir()
        os.replace(temporary, folder)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
    return difference


def _write(encoder: TransformersEncoder, folder: Path) -> float:
    import torch

    class Tower(torch.nn.Module):
        """One tower of the model, from prepared inputs to the projected feature."""

        def __init__(self, function: str, names: list[str]) -> None:
            super().__init__()
            self.model = encoder.model
            self.function = function
            self.names = names

        def forward(self, first: torch.Tensor, second: torch.Tensor | None = None) -> torch.Tensor:
            """Features of a batch."""
            inputs = dict(zip(self.names, (first, second), strict=False))
            output = getattr(self.model, self.function)(**inputs)
            feature: torch.Tensor = getattr(output, "pooler_output", output)
            return feature

    pictures = np.random.default_rng(0).integers(0, 256, (3, 64, 48, 3), dtype=np.uint8)
    pixels = encoder.image_processor(images=list(pictures), input_data_format="channels_last", return_tensors="pt")
    tokens = encoder.tokenizer(
        _PROBES, padding="max_length", truncation=True, max_length=encoder.max_tokens, return_tensors="pt"
    )
    names = [name for name in ("input_ids", "attention_mask") if name in tokens]
    contract = {
        "kind": KIND,
        "format_version": FORMAT_VERSION,
        "source": encoder.name,
        "feature_size": str(encoder.feature_size),
        "max_tokens": str(encoder.max_tokens),
    }
    image, text = Tower("get_image_features", ["pixel_values"]), Tower("get_text_features", names)
    export_module(image, {"pixel_values": pixels["pixel_values"]}, "feature", folder / IMAGE_FILE, contract)
    export_module(text, {name: tokens[name] for name in names}, "feature", folder / TEXT_FILE, contract)
    encoder.model.config.save_pretrained(folder)
    encoder.tokenizer.save_pretrained(folder)
    encoder.image_processor.save_pretrained(folder)
    exported = OnnxEncoder(folder)
    difference = max(
        float(np.abs(exported.encode_image(pictures) - encoder.encode_image(pictures)).max()),
        float(np.abs(exported.encode_text(_PROBES) - encoder.encode_text(_PROBES)).max()),
    )
    if not difference <= PARITY_TOLERANCE:
        raise RuntimeError(
            f"The exported features of '{encoder.name}' differ from those of transformers by {difference:.2g}, more than "
            f"{PARITY_TOLERANCE}."
        )
    return difference
