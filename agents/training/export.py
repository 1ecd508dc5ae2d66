"""Trained policies as ONNX files that carry their contract."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from agents.training.report import versions

if TYPE_CHECKING:
    from onnxruntime import InferenceSession
    from stable_baselines3 import PPO

FORMAT_VERSION = "1"


def file_hash(path: Path) -> str:
    """SHA-256 of a file, in hexadecimal."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def origin(model: PPO, controller: Path) -> dict[str, str]:
    """What the contract of every policy says about its making.

    Args:
        model: The trained model.
        controller: File of the low-level controller.
    """
    return {
        "training_decisions": str(model.num_timesteps),
        "controller_sha256": file_hash(controller),
        "versions": json.dumps(versions()),
    }


def export_policy(model: PPO, path: Path, contract: dict[str, str]) -> None:
    """Writes the deterministic policy of a PPO model as ONNX.

    Input `observation` float32 `(n, observation size)`; output `action` float32 `(n, action size)` in [-1, 1]: the mean
    action, clipped, which is what `model.predict(observation, deterministic=True)` returns.

    Args:
        model: The trained model with an MlpPolicy.
        path: Where to write the file.
        contract: Further metadata: the `kind` of policy, what its numbers mean, and its :func:`origin`.
    """
    import torch

    from rewards.onnx_files import export_module

    class DeterministicPolicy(torch.nn.Module):
        """Mean action of the Gaussian, clipped to the action space."""

        def __init__(self, policy: Any) -> None:
            super().__init__()
            self.hidden = policy.mlp_extractor.policy_net
            self.mean = policy.action_net

        def forward(self, observation: torch.Tensor) -> torch.Tensor:
            """Actions for observations."""
            return torch.clamp(self.mean(self.hidden(observation)), -1.0, 1.0)

    assert model.observation_space.shape is not None
    size = model.observation_space.shape[0]
    metadata = {
        "format_version": FORMAT_VERSION,
        "observation_size": str(size),
        "decisions_per_second": "6",
        "quaternion_order": "wxyz",
        **contract,
    }
    policy = DeterministicPolicy(model.policy)
    export_module(policy, {"observation": torch.zeros(2, size)}, "action", path, metadata)


def open_policy(path: Path, kind: str, name: str, command: str) -> tuple[InferenceSession, dict[str, str]]:
    """Opens an exported policy; needs neither torch nor Stable-Baselines3.

    Args:
        path: The file.
        kind: Entry "kind" of its contract.
        name: What such a file is called in messages, such as "text policy".
        command: The command that writes one.

    Returns:
        The session, from `observation` to `action`, and the contract.

    Raises:
        ValueError: The file cannot be read, or is of another kind.
    """
    from rewards.onnx_files import open_session

    try:
        session = open_session(path, num_threads=1)  # a small network: threads would only wait for each other
    except ValueError as error:
        raise ValueError(f"'{path}' is no readable ONNX file; write it again with `{command}`.") from error
    contract: dict[str, str] = dict(session.get_modelmeta().custom_metadata_map)
    if contract.get("kind") != kind:
        raise ValueError(f"'{path}' is an ONNX file, but no {name} of this project.")
    return session, contract
