"""What runs beside PPO: the time budget, the history of the run, its checkpoints and the progress bar."""

from __future__ import annotations

import io
import json
import time
import zipfile
from abc import abstractmethod
from pathlib import Path
from typing import Any

from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv

from agents.progress import ProgressDisplay
from agents.training.run_folder import RunFolder
from anyskill_envs.simulation import CONTROLLER_STEPS
from motion_data.files import write_whole

CHECKPOINT_SECONDS = 60.0

_PROGRESS_FILE = "progress.json"


def save_checkpoint(model: PPO, path: Path, progress: dict[str, Any]) -> None:
    """Writes model, optimiser and progress into one zip file, whole or not at all.

    Args:
        model: The model.
        path: The file, ending in .zip; `PPO.load` reads it too.
        progress: What else is needed to continue, JSON values.
    """

    def write(temporary: Path) -> None:
        buffer = io.BytesIO()
        model.save(buffer)
        with zipfile.ZipFile(buffer, "a") as archive:
            archive.writestr(_PROGRESS_FILE, json.dumps(progress))
        temporary.write_bytes(buffer.getvalue())

    write_whole(path, write)


def load_checkpoint(path: Path, env: VecEnv) -> tuple[PPO, dict[str, Any]]:
    """Reads a checkpoint.

    Args:
        path: The file.
        env: The environment to go on with.

    Returns:
        The model with its optimiser and step count, and the progress.

    Raises:
        ValueError: The file is broken, or from a run with other spaces.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            progress = json.loads(archive.read(_PROGRESS_FILE))
        model = PPO.load(path, env=env, device="cpu")
    except (zipfile.BadZipFile, KeyError, ValueError, AssertionError) as error:
        raise ValueError(
            f"'{path}' cannot be read as a checkpoint of this run ({error}); start anew with --overwrite."
        ) from error
    return model, progress


class DecayingRate:
    """A learning rate that falls linearly with the time used: late updates only settle what was found.

    Stable-Baselines3 would decay by steps, but the training is stopped by the clock.

    Args:
        initial: The first learning rate.
        last: The last one as a share of the first.
    """

    def __init__(self, initial: float, last: float = 0.1) -> None:
        self.initial = initial
        self.last = last
        self.used = 0.0
        """Share of the training time used so far."""

    def __call__(self, progress_remaining: float) -> float:
        """The present rate; the argument is what Stable-Baselines3 passes, and not needed."""
        return self.initial * (1 - (1 - self.last) * min(self.used, 1.0))


class TrainingMonitor(BaseCallback):
    """Stops PPO when its time is over; keeps its learning rate, history, TensorBoard, checkpoints and progress up to date.

    The history has one entry per update: `seconds` of training, `decisions` taken, the means over the update of what the
    job measures (:meth:`sums_of`), and `falls` (share of the episodes that ended in it which ended by termination; None if
    none ended).

    Args:
        folder: The run's folder.
        display: The progress display.
        budget: Seconds of training, those before a resumption included.
        progress: Progress of the run so far, with "seconds" and "history"; further entries are kept.
    """

    section: str
    """Section of TensorBoard."""

    def __init__(self, folder: RunFolder, display: ProgressDisplay, budget: float, progress: dict[str, Any]) -> None:
        super().__init__()
        self.progress = progress
        self._folder = folder
        self._display = display
        self._budget = budget
        self._seconds_before = float(progress["seconds"])
        self._start = time.monotonic()
        self._last_checkpoint = self._start
        self._sums: dict[str, float] = {}
        self._count = 0
        self._ended = self._fallen = 0
        self._new_decisions = 0

    @property
    def seconds(self) -> float:
        """Seconds of training so far, those before a resumption included."""
        return self._seconds_before + time.monotonic() - self._start

    @property
    def controller_steps_per_second(self) -> float:
        """Controller steps per second of this process, learning included."""
        return self._new_decisions * CONTROLLER_STEPS / max(time.monotonic() - self._start, 1e-9)

    def _on_training_start(self) -> None:
        model = self.model
        assert isinstance(model, PPO)
        self._usual_schedule, self._rate = model.lr_schedule, DecayingRate(model.lr_schedule(1.0))
        model.lr_schedule = self._rate

    def _on_training_end(self) -> None:
        # the saved policy must load where this package is not installed
        model = self.model
        assert isinstance(model, PPO)
        model.lr_schedule = self._usual_schedule

    @abstractmethod
    def sums_of(self, infos: list[dict[str, Any]]) -> dict[str, float]:
        """What the history holds the means of: sums over the infos of one step of all humanoids."""

    @abstractmethod
    def headline(self, entry: dict[str, float]) -> str:
        """What the progress bar says about an entry of the history."""

    def _on_step(self) -> bool:
        infos: list[dict[str, Any]] = self.locals["infos"]
        self._count += len(infos)
        self._new_decisions += len(infos)
        for name, value in self.sums_of(infos).items():
            self._sums[name] = self._sums.get(name, 0.0) + value
        for info, done in zip(infos, self.locals["dones"], strict=True):
            if done:
                self._ended += 1
                self._fallen += not info.get("TimeLimit.truncated", False)
        return self.seconds < self._budget

    def _on_rollout_end(self) -> None:
        self._rate.used = self.seconds / self._budget
        if not self._count:
            return
        entry = {name: value / self._count for name, value in self._sums.items()}
        entry |= {"seconds": self.seconds, "decisions": self.num_timesteps}
        history_entry = entry | {"falls": self._fallen / self._ended if self._ended else None}
        self.progress["history"].append(history_entry)
        for name, value in history_entry.items():
            if value is not None and name not in ("seconds", "decisions"):
                self.logger.record(f"{self.section}/{name}", value)
        speed = self.controller_steps_per_second
        self.logger.record(f"{self.section}/controller_steps_per_second", speed)
        note = f"{self.headline(entry)}, {speed:,.0f} controller steps/s"
        self._display.show(self.seconds, "learning", note)
        self._sums, self._count, self._ended, self._fallen = {}, 0, 0, 0

    def _on_rollout_start(self) -> None:
        # between two updates the model is consistent
        if time.monotonic() - self._last_checkpoint >= CHECKPOINT_SECONDS:
            self.save()

    def save(self) -> None:
        """Writes a checkpoint."""
        self.progress["seconds"] = self.seconds
        save_checkpoint(self.model, self._folder.checkpoint, self.progress)  # type: ignore[arg-type]
        self._last_checkpoint = time.monotonic()
