"""Small real models for tests: an ONNX controller with the true contract, a random CLIP, an encoder of texts and states."""

import hashlib
import string
from pathlib import Path

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from anyskill_envs.controller import LATENT_SIZE, contract
from anyskill_envs.observation import OBSERVATION_SIZE
from motion_data.skeleton import JOINT_NAMES

ANCHORS = ("walk", "idle", "wave_right", "squat")


def write_controller(folder: Path, swing: float = 0.01, hidden: int = 64, **overrides: str) -> Path:
    """Write a controller, one hidden layer wide, with its latents beside it.

    Args:
        folder: Where.
        swing: Size of the targets around the rest pose in radians; 0 stands still.
        hidden: Width of the hidden layer.
        overrides: Entries of the contract to falsify.

    Returns:
        Path of the ONNX file.
    """
    rng = np.random.default_rng(7)
    inputs = OBSERVATION_SIZE + LATENT_SIZE
    weights = {
        "first": rng.normal(0, 0.3, (inputs, hidden)).astype(np.float32),
        "second": (rng.normal(0, swing, (hidden, len(JOINT_NAMES))) / np.sqrt(hidden)).astype(np.float32),
    }
    nodes = [
        helper.make_node("Concat", ["observation", "latent"], ["state"], axis=1),
        helper.make_node("MatMul", ["state", "first"], ["drive"]),
        helper.make_node("Tanh", ["drive"], ["features"]),
        helper.make_node("MatMul", ["features", "second"], ["target"]),
    ]
    graph = helper.make_graph(
        nodes,
        "controller",
        [
            helper.make_tensor_value_info("observation", TensorProto.FLOAT, ["n", OBSERVATION_SIZE]),
            helper.make_tensor_value_info("latent", TensorProto.FLOAT, ["n", LATENT_SIZE]),
        ],
        [helper.make_tensor_value_info("target", TensorProto.FLOAT, ["n", len(JOINT_NAMES)])],
        [numpy_helper.from_array(value, name) for name, value in weights.items()],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    helper.set_model_props(model, contract("low_level_controller") | overrides)
    path = folder / "llc.onnx"
    onnx.save(model, path)

    latents = rng.normal(size=(3 * len(ANCHORS), LATENT_SIZE)).astype(np.float32)
    np.savez(
        folder / "latents.npz",
        latents=latents / np.linalg.norm(latents, axis=1, keepdims=True),
        names=np.array(ANCHORS),
        clips=np.repeat(np.arange(len(ANCHORS)), 3),
        standing=np.repeat([False, True, True, True], 3),
    )
    return path


def write_clip(folder: Path, seed: int = 0) -> Path:
    """Write a random CLIP of two tiny towers, saved as a downloaded model is; needs torch and transformers.

    Args:
        folder: Where.
        seed: Seed of the weights.

    Returns:
        The folder.
    """
    import torch
    import transformers

    words = ["<|startoftext|>", "<|endoftext|>", *string.ascii_lowercase]
    vocabulary = {word: index for index, word in enumerate(words + [f"{letter}</w>" for letter in words[2:]])}
    tower = {"hidden_size": 16, "intermediate_size": 16, "num_hidden_layers": 1, "num_attention_heads": 2}
    config = transformers.CLIPConfig(
        text_config=tower
        | {"vocab_size": len(vocabulary), "max_position_embeddings": 20, "bos_token_id": 0, "eos_token_id": 1},
        vision_config=tower | {"image_size": 32, "patch_size": 8},
        projection_dim=12,
    )
    with torch.random.fork_rng():
        torch.manual_seed(seed)
        transformers.CLIPModel(config).save_pretrained(folder)
    transformers.CLIPTokenizer(vocab=vocabulary, merges=[]).save_pretrained(folder)
    # Not CLIP's own numbers: the preprocessing must come from the folder.
    transformers.CLIPImageProcessorPil(
        size={"shortest_edge": 36}, crop_size={"height": 32, "width": 32}, image_mean=[0.3, 0.4, 0.5]
    ).save_pretrained(folder)
    return folder


class SmallEncoder:
    """Features of 16 numbers: texts by their hash, states and pictures by a fixed random projection."""

    feature_size = 16

    def encode_text(self, texts: list[str]) -> np.ndarray:
        seeds = [int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "big") for text in texts]
        return _unit(np.stack([np.random.default_rng(seed).normal(size=self.feature_size) for seed in seeds]))

    def encode_image(self, frames: np.ndarray) -> np.ndarray:
        means = frames.reshape(len(frames), -1)[:, ::997] / 255.0
        return _unit(means @ np.random.default_rng(1).normal(size=(means.shape[1], self.feature_size)))

    def encode_state(self, observation: np.ndarray) -> np.ndarray:
        return _unit(observation @ np.random.default_rng(2).normal(size=(OBSERVATION_SIZE, self.feature_size)))


def _unit(values: np.ndarray) -> np.ndarray:
    return (values / np.linalg.norm(values, axis=1, keepdims=True)).astype(np.float32)
