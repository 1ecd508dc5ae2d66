"""Trained retrievers: written as ONNX, read from a run folder, an ONNX file or a Stable-Baselines3 file."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from agents.training.export import export_policy, open_policy
from anyskill_envs.retrieval_observation import RETRIEVAL_LAYOUT, RETRIEVAL_OBSERVATION_SIZE
from motion_data.retrieval_keys import KEY_LAYOUT, KEY_SIZE

if TYPE_CHECKING:
    from stable_baselines3 import PPO

KIND = "anyskill-retriever"
Retriever = Callable[[NDArray[np.float32]], NDArray[np.float32]]
"""Observations `(n, 258)` to actions `(n, 32)`."""


def unlearned(observation: NDArray[np.float32]) -> NDArray[np.float32]:
    """Retrieval with all weights 1, as in motion matching and DReCon: actions of zeros."""
    return np.zeros((len(observation), KEY_SIZE), np.float32)


def _layout(places: dict[str, slice]) -> str:
    return json.dumps({name: [place.start, place.stop] for name, place in places.items()})


def export_retriever(model: PPO, path: Path, contract: dict[str, str]) -> None:
    """Writes the deterministic policy of a PPO model as ONNX: `observation` `(n, 258)` to `action` `(n, 32)`.

    Args:
        model: The trained model with an MlpPolicy.
        path: Where to write the file.
        contract: Further metadata, such as the databases and the controller's hash.
    """
    layout = {"observation_layout": _layout(RETRIEVAL_LAYOUT), "key_layout": _layout(KEY_LAYOUT)}
    action = "weights of the query, minus 1"
    export_policy(model, path, {"kind": KIND, "action": action, **layout, **contract})


class OnnxRetriever:
    """A retriever from an ONNX file; needs neither torch nor Stable-Baselines3.

    Args:
        path: The file.

    Attributes:
        contract: The metadata of the file.

    Raises:
        ValueError: The file is no retriever of this project, or one for other observations or keys.
    """

    def __init__(self, path: Path) -> None:
        self._session, self.contract = open_policy(path, KIND, "retriever", "anyskill train-retrieval")
        expected = {"observation_layout": _layout(RETRIEVAL_LAYOUT), "key_layout": _layout(KEY_LAYOUT)}
        if any(self.contract.get(name) != value for name, value in expected.items()):
            raise ValueError(
                f"'{path}' was trained for other observations or keys than this version has; train it again with "
                "`anyskill train-retrieval`."
            )

    def __call__(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """Actions `(n, 32)` for observations `(n, 258)`."""
        return self._session.run(["action"], {"observation": np.asarray(observation, np.float32)})[0]


def load_retriever(path: Path) -> Retriever:
    """A retriever from a file.

    Args:
        path: A run folder of `anyskill train-retrieval`, its policy.onnx, or a .zip file of any Stable-Baselines3 PPO.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: It is no retriever of this project.
    """
    file = path / "policy.onnx" if path.is_dir() else path
    if not file.is_file():
        raise FileNotFoundError(f"No retriever at '{file}'. Train one with `anyskill train-retrieval`.")
    if file.suffix != ".zip":
        return OnnxRetriever(file)
    from stable_baselines3 import PPO

    model = PPO.load(file, device="cpu")
    shapes = model.observation_space.shape, model.action_space.shape
    if shapes != ((RETRIEVAL_OBSERVATION_SIZE,), (KEY_SIZE,)):
        raise ValueError(f"'{file}' has spaces of the shapes {shapes}; it was not trained on RetrievalLocomotion-v0.")
    return lambda observation: model.predict(observation, deterministic=True)[0]
