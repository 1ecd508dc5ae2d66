"""A training run from options to report, as all jobs have it that learn with PPO; a job says what is its own."""

from __future__ import annotations

import json
import os
import sys
import time
from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np

from agents.training.config import EPISODE_DECISIONS, PPOOptions
from agents.training.run_folder import RunFolder

if TYPE_CHECKING:
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import VecEnv

    from agents.progress import ProgressDisplay
    from agents.training.monitor import TrainingMonitor

Options = TypeVar("Options", bound=PPOOptions)

PLAYED_HUMANOIDS = 32
"""Humanoids that play the policy without exploration; see `agents.training.best_policy`."""
EVALUATION_SEED = 1_000_000
"""Added to the seed of training for the evaluation, so that no start state was seen before."""
_PLAY_SEED = 2_000_000
"""Added to the seed of training for the plays of the best policy."""
_UNLIMITED_STEPS = 10**12
"""Steps for `PPO.learn`: the monitor stops it by the clock."""


class TrainingJob(ABC, Generic[Options]):
    """What one kind of training has of its own; :func:`run` does the rest.

    Args:
        config: The options, of a resumed run those that :func:`begin` returned.
        folder: The run's folder, made ready by :func:`begin`.

    Attributes:
        started: When the run began, by `time.monotonic`.
    """

    def __init__(self, config: Options, folder: RunFolder) -> None:
        self.config = config
        self.folder = folder
        self.started = time.monotonic()

    @property
    @abstractmethod
    def command(self) -> str:
        """The command line of such a run, without the options."""

    @abstractmethod
    def make_environment(self, num_envs: int) -> VecEnv:
        """The environment as Stable-Baselines3 wants it."""

    @abstractmethod
    def make_monitor(self, display: ProgressDisplay, budget: float, progress: dict[str, Any]) -> TrainingMonitor:
        """What runs beside PPO."""

    def prepare_model(self, model: PPO, display: ProgressDisplay) -> dict[str, Any]:
        """Changes a new model before PPO begins, if the job does.

        Returns:
            Entries of the run's progress; "seconds", if this was part of the training time.
        """
        return {}

    @abstractmethod
    def finish(
        self, model: PPO, training: dict[str, Any], progress: dict[str, Any], display: ProgressDisplay
    ) -> dict[str, Any]:
        """Evaluates, exports and draws; the policy is saved already.

        Args:
            model: The trained model.
            training: What the report of every job says about the training.
            progress: Progress of the run: "history" has an entry for each update, and there is what
                :meth:`prepare_model` returned.
            display: The progress display.

        Returns:
            The job's part of the report, with the training.
        """

    @abstractmethod
    def tell(self, report: dict[str, Any]) -> None:
        """Prints what was reached."""


def require_training() -> None:
    """Must be called before anything loads torch.

    Raises:
        ImportError: A package for training is missing.
    """
    # An idle thread that spins steals the core from the physics threads; must be set before torch starts its pool.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    try:
        import stable_baselines3  # noqa: F401
    except ImportError as error:
        raise ImportError(f'Training needs {error.name}: pip install "anyskill-envs[train]".') from error


def begin(config: Options, folder: RunFolder) -> Options:
    """Makes the folder ready for a run, and returns the options that count: those of a resumed run are in its folder.

    Raises:
        FileExistsError: The folder holds a run, and neither resume nor overwrite was asked for.
        FileNotFoundError: There is nothing to resume.
        ValueError: The run to resume is another one.
    """
    folder.prepare(config.resume, config.overwrite)
    if not config.resume:
        return config
    saved = type(config).from_json(json.loads(folder.config.read_text(encoding="utf-8")))
    return config.resuming(saved, folder.path)


def make_model(config: PPOOptions, env: VecEnv) -> PPO:
    """PPO with the options of a run, as Stable-Baselines3 ships it.

    The last layer of a new policy is small, so its mean action begins near zeros.
    """
    from stable_baselines3 import PPO

    return PPO(
        "MlpPolicy",
        env,
        learning_rate=config.learning_rate,
        n_steps=config.decisions_per_update,
        batch_size=config.batch_size,
        n_epochs=config.epochs,
        gamma=config.discount,
        gae_lambda=config.gae_lambda,
        target_kl=config.target_kl,
        policy_kwargs={
            "net_arch": {"pi": list(config.hidden), "vf": list(config.hidden)},
            "log_std_init": float(np.log(config.exploration)),
        },
        seed=config.seed,
        device="cpu",
    )


def run(job: TrainingJob[Any]) -> int:
    """Trains until the time is over, keeps the policy that earns most, and writes the report.

    Returns:
        0; 130 after Ctrl-C, when --resume continues the run.
    """
    try:
        report = _train(job)
    except KeyboardInterrupt:
        print(f"\nStopped. Continue with: {job.command} --output {job.folder.path} --resume", file=sys.stderr)
        return 130
    job.tell(report)
    return 0


def _train(job: TrainingJob[Any]) -> dict[str, Any]:
    import torch
    from stable_baselines3.common.logger import configure

    from agents.progress import ProgressDisplay
    from agents.training.best_policy import BestPolicy, restore_best
    from motion_data.files import write_whole

    torch.set_num_threads(1)  # small networks: more threads cost more than they bring
    config, folder = job.config, job.folder
    env = job.make_environment(config.num_envs)
    folder.write_json(folder.config, config.to_json())
    budget = 60.0 * config.minutes
    with ProgressDisplay(budget, config.progress) as display:
        model, progress = _first_model(job, env, display)
        model.set_logger(configure(str(folder.tensorboard), ["tensorboard"]))
        monitor = job.make_monitor(display, budget, progress)
        if progress["seconds"] < budget:
            stage = job.make_environment(min(config.num_envs, PLAYED_HUMANOIDS))
            best = BestPolicy(stage, EPISODE_DECISIONS, config.seed + _PLAY_SEED, folder.best, progress)
            model.learn(_UNLIMITED_STEPS, callback=[best, monitor], reset_num_timesteps=not config.resume)
            monitor.save()  # the policy as training left it, to go on from
            stage.close()
        restore_best(model, folder.best, progress)
        display.show(budget, "evaluating")
        env.close()
        write_whole(folder.policy, model.save)
        return _report(job, model, progress, monitor.controller_steps_per_second, display)


def _first_model(job: TrainingJob[Any], env: VecEnv, display: ProgressDisplay) -> tuple[PPO, dict[str, Any]]:
    """The model to begin or to go on with, and the progress of its run."""
    from stable_baselines3.common.utils import set_random_seed

    from agents.training.monitor import load_checkpoint

    config = job.config
    if config.resume:
        model, progress = load_checkpoint(job.folder.checkpoint, env)
        set_random_seed(config.seed + model.num_timesteps)
        env.seed(config.seed + model.num_timesteps)
        return model, progress
    model = make_model(config, env)
    return model, {"seconds": 0.0, "history": []} | job.prepare_model(model, display)


def _report(
    job: TrainingJob[Any], model: PPO, progress: dict[str, Any], speed: float, display: ProgressDisplay
) -> dict[str, Any]:
    """Lets the job evaluate, and writes report.json."""
    from agents.doctor import cpu_count
    from agents.training.report import versions
    from anyskill_envs.simulation import CONTROLLER_STEPS

    training = {
        "minutes": progress["seconds"] / 60,
        "decisions": model.num_timesteps,
        "controller_steps": model.num_timesteps * CONTROLLER_STEPS,
        "controller_steps_per_second": speed,
        "plays": progress.get("plays", []),
        "kept": progress.get("kept"),
    }
    report = job.finish(model, training, progress, display) | {
        "cpus": cpu_count(),
        "versions": versions(),
        "config": job.config.to_json(),
        "minutes_in_all": (time.monotonic() - job.started) / 60,
        "history": progress["history"],
    }
    job.folder.write_json(job.folder.report, report)
    return report
