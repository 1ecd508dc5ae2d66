"""Trained text skills as ONNX files, and playing them without torch."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from agents.text.clock import CLOCK_SIZE
from agents.training.export import export_policy, open_policy
from anyskill_envs.observation import OBSERVATION_LAYOUT, OBSERVATION_SIZE

if TYPE_CHECKING:
    from stable_baselines3 import PPO

KIND = "anyskill-text-policy"
PARITY_TOLERANCE = 1e-5
"""Largest difference between an exported action and that of Stable-Baselines3."""


def export_text_policy(model: PPO, path: Path, contract: dict[str, str]) -> None:
    """Writes the deterministic policy of a PPO model as ONNX: `observation` `(n, 283)` to `action` `(n, 64)`.

    The observation is proprioception and time, see `agents.text.clock`.

    Args:
        model: The trained model with an MlpPolicy.
        path: Where to write the file.
        contract: Further metadata, such as the text and the controller's hash.
    """
    assert model.action_space.shape is not None
    metadata = {
        "kind": KIND,
        "clock_size": str(CLOCK_SIZE),
        "observation_layout": json.dumps({name: [p.start, p.stop] for name, p in OBSERVATION_LAYOUT.items()}),
        "action": "direction of the controller's latent; the environment scales it to unit length",
        "latent_size": str(model.action_space.shape[0]),
    }
    export_policy(model, path, metadata | contract)


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
        if not path.is_file():
            raise FileNotFoundError(f"There is no policy at '{path}'. Train one with `anyskill train \"<text>\"`.")
        self._session, self.contract = open_policy(path, KIND, "text policy", "anyskill train")
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
