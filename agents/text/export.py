"""Trained policies as ONNX files that carry their contract, and playing them without torch."""

from __future__ import annotations

import hashlib
import json
import logging
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from agents.text.clock import CLOCK_SIZE
from anyskill_envs.observation import OBSERVATION_LAYOUT, OBSERVATION_SIZE

if TYPE_CHECKING:
    from stable_baselines3 import PPO

KIND = "anyskill-text-policy"
FORMAT_VERSION = "1"
PARITY_TOLERANCE = 1e-5
"""Largest difference between an exported action and that of Stable-Baselines3."""


def file_hash(path: Path) -> str:
    """SHA-256 of a file, in hexadecimal."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def export_policy(model: PPO, path: Path, contract: dict[str, str]) -> None:
    """Writes the deterministic policy of a PPO model as ONNX.

    Input `observation` float32 `(n, 283)`, proprioception and time (see `agents.text.clock`); output `action` float32
    `(n, 64)` in [-1, 1]: the mean action, clipped, which is what `model.predict(observation, deterministic=True)` returns.

    Args:
        model: The trained model with an MlpPolicy.
        path: Where to write the file.
        contract: Further metadata, such as the text and the controller's hash.
    """
    import onnx
    import torch

    class DeterministicPolicy(torch.nn.Module):
        """Mean action of the Gaussian, clipped to the action space."""

        def __init__(self, policy: Any) -> None:
            super().__init__()
            self.hidden = policy.mlp_extractor.policy_net
            self.mean = policy.action_net

        def forward(self, observation: torch.Tensor) -> torch.Tensor:
            """Actions `(n, 64)` for observations `(n, 283)`."""
            return torch.clamp(self.mean(self.hidden(observation)), -1.0, 1.0)

    assert model.observation_space.shape is not None and model.action_space.shape is not None
    size = model.observation_space.shape[0]
    example = torch.zeros(2, size)
    logging.getLogger("torch.onnx").setLevel(logging.ERROR)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the exporter warns about its own internals
        program = torch.onnx.export(
            DeterministicPolicy(model.policy).eval(),
            (example,),
            input_names=["observation"],
            output_names=["action"],
            dynamic_shapes={"observation": {0: torch.export.Dim("n")}},
            dynamo=True,
            verbose=False,
        )
    assert program is not None
    proto = program.model_proto
    metadata = {
        "kind": KIND,
        "format_version": FORMAT_VERSION,
        "observation_size": str(size),
        "clock_size": str(CLOCK_SIZE),
        "observation_layout": json.dumps({name: [p.start, p.stop] for name, p in OBSERVATION_LAYOUT.items()}),
        "action": "direction of the controller's latent; the environment scales it to unit length",
        "latent_size": str(model.action_space.shape[0]),
        "decisions_per_second": "6",
        "quaternion_order": "wxyz",
        **contract,
    }
    onnx.helper.set_model_props(proto, metadata)
    onnx.save(proto, str(path))


class OnnxPolicy:
    """A trained policy from `policy.onnx`; needs neither torch nor Stable-Baselines3.

    Args:
        path: The file.
        observation_size: Numbers that the environment observes, without the time.

    Attributes:
        contract: The metadata of the file.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: The file is no policy of this project, or one for another observation.
    """

    def __init__(self, path: Path, observation_size: int = OBSERVATION_SIZE) -> None:
        import onnxruntime

        if not path.is_file():
            raise FileNotFoundError(f"There is no policy at '{path}'. Train one with `anyskill train \"<text>\"`.")
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = 1  # a small network: threads would only wait for each other
        try:
            self._session = onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
        except Exception as error:  # onnxruntime has an exception for each way in which a file can be broken
            raise ValueError(f"'{path}' is no readable ONNX file; write it again with `anyskill train`.") from error
        self.contract: dict[str, str] = dict(self._session.get_modelmeta().custom_metadata_map)
        if self.contract.get("kind") != KIND:
            raise ValueError(f"'{path}' is an ONNX file, but no text policy of this project.")
        if self.contract["observation_size"] != str(observation_size + CLOCK_SIZE):
            raise ValueError(
                f"'{path}' takes {self.contract['observation_size']} observation numbers, this version of the "
                f"environment and its clock give {observation_size + CLOCK_SIZE}; train the policy again."
            )

    def __call__(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """Actions `(n, 64)` for observations with time `(n, 283)`."""
        return self._session.run(["action"], {"observation": np.asarray(observation, np.float32)})[0]


def parity_error(model: PPO, path: Path, observations: NDArray[np.float32]) -> float:
    """Largest difference between the actions of an exported policy and of its model.

    Args:
        model: The model that was exported.
        path: The ONNX file.
        observations: `(n, 283)`, best from real episodes.

    Returns:
        The largest absolute difference.

    Raises:
        RuntimeError: It is larger than 1e-5, so the file must not be used.
    """
    expected, _ = model.predict(observations, deterministic=True)
    policy = OnnxPolicy(path, observations.shape[1] - CLOCK_SIZE)
    error = float(np.abs(policy(observations) - expected).max())
    if not error <= PARITY_TOLERANCE:
        raise RuntimeError(
            f"The exported policy '{path}' differs from Stable-Baselines3's by {error:.2g}, more than "
            f"{PARITY_TOLERANCE}."
        )
    return error
