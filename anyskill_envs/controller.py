"""The frozen low-level controller and its motion encoder: ONNX files that carry their own contract.

The controller is ``pi(target | observation, latent)``; the encoder turns a 2 s motion window into a latent. Both are
deterministic. Training writes these files (:mod:`agents.controller.export`); everything else only reads them.
"""

import hashlib
import json
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from anyskill_envs.observation import OBSERVATION_LAYOUT, OBSERVATION_SIZE
from anyskill_envs.simulation import CONTROLLER_STEPS, PHYSICS_STEPS
from motion_data.skeleton import HUMANOID_XML, JOINT_NAMES
from motion_data.window import WINDOW_FEATURES, WINDOW_FRAMES
from rewards.onnx_files import open_session

LATENT_SIZE = 64
FORMAT_VERSION = "2"
"""2: the heading is the twist about the vertical axis (:func:`motion_data.skeleton.heading`); 1: the x axis's direction."""
WEIGHTS = Path(__file__).parent / "weights"
CONTROLLER_FILE = WEIGHTS / "llc.onnx"
ENCODER_FILE = WEIGHTS / "motion_encoder.onnx"
LATENTS_FILE = WEIGHTS / "latents.npz"

_REPAIR = "Train one with `anyskill controller train`, or reinstall the package to get the bundled one."


class ContractError(ValueError):
    """A weight file does not fit this version of the package or this body."""


def xml_digest(xml: str | Path = HUMANOID_XML) -> str:
    """SHA-256 of an MJCF file, hexadecimal."""
    return hashlib.sha256(Path(xml).read_bytes()).hexdigest()


def contract(kind: str, **details: str) -> dict[str, str]:
    """What a weight file must agree on with the code that runs it; all values are strings, as ONNX metadata must be.

    Args:
        kind: ``low_level_controller`` or ``motion_encoder``.
        details: Further entries, such as training data, version and licence.
    """
    return {
        "format_version": FORMAT_VERSION,
        "kind": kind,
        "latent_size": str(LATENT_SIZE),
        "joint_names": json.dumps(JOINT_NAMES),
        "observation_layout": json.dumps({name: [s.start, s.stop] for name, s in OBSERVATION_LAYOUT.items()}),
        "window": json.dumps([WINDOW_FRAMES, WINDOW_FEATURES]),
        "action_type": "pd_target_radians",
        "physics_rate": "120",
        "physics_steps": str(PHYSICS_STEPS),
        "controller_steps": str(CONTROLLER_STEPS),
        "quaternion_order": "wxyz",
        "model_xml_sha256": xml_digest(),
        **details,
    }


_CHECKED = (
    "format_version",
    "kind",
    "latent_size",
    "joint_names",
    "observation_layout",
    "window",
    "action_type",
    "physics_steps",
    "controller_steps",
    "model_xml_sha256",
)


class _OnnxModel:
    """An ONNX file with a checked contract; pickles by its path.

    Args:
        path: The file.
        kind: Expected kind of contract.
        num_threads: Threads of onnxruntime within one call; 0 for one per CPU.
    """

    kind = ""

    def __init__(self, path: str | Path, num_threads: int = 0):
        self.path = Path(path)
        self._num_threads = num_threads
        if not self.path.is_file():
            raise FileNotFoundError(f"No {self.kind.replace('_', ' ')} at '{self.path}'. {_REPAIR}")
        self._load()

    def _load(self) -> None:
        try:
            self._session = open_session(self.path, self._num_threads)
        except ValueError as error:
            raise ContractError(f"{error} {_REPAIR}") from error
        self.metadata: dict[str, str] = dict(self._session.get_modelmeta().custom_metadata_map)
        expected = contract(self.kind)
        wrong = [
            f"{name} is {self.metadata.get(name, 'missing')}, expected {expected[name]}"
            for name in _CHECKED
            if self.metadata.get(name) != expected[name]
        ]
        if wrong:
            raise ContractError(
                f"'{self.path}' does not fit this package as its {self.kind.replace('_', ' ')}: {'; '.join(wrong)}. "
                f"{_REPAIR}"
            )

    def __getstate__(self) -> dict[str, Any]:
        return {"path": self.path, "_num_threads": self._num_threads}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._load()


class LowLevelController(_OnnxModel):
    """Turns observations and latents into PD targets.

    Args:
        path: Controller file.
        num_threads: Threads of onnxruntime within one call; 0 for one per CPU.

    Raises:
        FileNotFoundError: If there is no such file.
        ContractError: If the file is broken or was made for another body, layout or rate.
    """

    kind = "low_level_controller"

    @classmethod
    def load(cls, path: str | Path | None = None, num_threads: int = 0) -> "LowLevelController":
        """Reads a controller, the bundled one if ``path`` is None."""
        return cls(path or CONTROLLER_FILE, num_threads)

    @property
    def latent_size(self) -> int:
        """Size of the latent, 64."""
        return LATENT_SIZE

    def act(self, observation: np.ndarray, latent: np.ndarray) -> np.ndarray:
        """PD targets for a batch of humanoids.

        Args:
            observation: Float32 ``(n, 223)``.
            latent: Unit vectors, float32 ``(n, 64)``.

        Returns:
            Targets in radians, float32 ``(n, 28)``.

        Raises:
            ValueError: If a shape is wrong.
        """
        if observation.shape[1:] != (OBSERVATION_SIZE,) or latent.shape != (len(observation), LATENT_SIZE):
            raise ValueError(
                f"The controller takes observations (n, {OBSERVATION_SIZE}) and latents (n, {LATENT_SIZE}), got "
                f"{observation.shape} and {latent.shape}."
            )
        inputs = {"observation": observation.astype(np.float32, copy=False), "latent": latent.astype(np.float32)}
        return self._session.run(["target"], inputs)[0]

    @cached_property
    def _bank(self) -> dict[str, np.ndarray]:
        path = self.path.with_name(LATENTS_FILE.name)
        if not path.is_file():
            raise FileNotFoundError(f"No latents of the training clips at '{path}', beside the controller. {_REPAIR}")
        with np.load(path, allow_pickle=False) as archive:
            return {name: archive[name] for name in archive.files}

    @property
    def latents(self) -> np.ndarray:
        """Latents of all windows of the training clips, one every 1/6 s, unit vectors ``(k, 64)``."""
        return self._bank["latents"]

    @property
    def clip_names(self) -> np.ndarray:
        """Name of the clip of each of :attr:`latents`, ``(k,)``."""
        return self._bank["names"][self._bank["clips"]]

    @property
    def standing_latents(self) -> np.ndarray:
        """Latents of windows in which the humanoid stays on its feet, ``(k, 64)``."""
        return self.latents[self._bank["standing"]]

    @property
    def anchors(self) -> dict[str, np.ndarray]:
        """A latent for each training clip by name: that of its first window."""
        first = np.unique(self._bank["clips"], return_index=True)[1]
        return {str(self.clip_names[index]): self.latents[index] for index in first}


class MotionEncoder(_OnnxModel):
    """Turns 2 s motion windows into latents of the controller.

    Args:
        path: Encoder file.
        num_threads: Threads of onnxruntime within one call; 0 for one per CPU.

    Raises:
        FileNotFoundError: If there is no such file.
        ContractError: If the file is broken or was made for another body, layout or rate.
    """

    kind = "motion_encoder"

    @classmethod
    def load(cls, path: str | Path | None = None, num_threads: int = 0) -> "MotionEncoder":
        """Reads an encoder, the bundled one if ``path`` is None."""
        return cls(path or ENCODER_FILE, num_threads)

    def encode(self, windows: np.ndarray) -> np.ndarray:
        """Latents of motion windows.

        Args:
            windows: Features of :func:`motion_data.window.window_features`, float32 ``(n, 60, 39)``.

        Returns:
            Unit vectors, float32 ``(n, 64)``.

        Raises:
            ValueError: If the shape is wrong.
        """
        if windows.shape[1:] != (WINDOW_FRAMES, WINDOW_FEATURES):
            raise ValueError(f"Windows must be (n, {WINDOW_FRAMES}, {WINDOW_FEATURES}), got {windows.shape}.")
        return self._session.run(["latent"], {"window": windows.astype(np.float32, copy=False)})[0]
