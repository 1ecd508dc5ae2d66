"""`anyskill train-retrieval`: stock PPO of Stable-Baselines3 learns to weight the queries of RetrievalLocomotion-v0."""

from __future__ import annotations

import dataclasses
import json
import os
import sys
import time
from typing import TYPE_CHECKING, Any

import numpy as np

from agents.retrieval.config import RetrievalConfig, RetrievalOptions
from agents.text.run_folder import RunFolder, write_whole

if TYPE_CHECKING:
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import VecEnv

ENVIRONMENT = "anyskill_envs:RetrievalLocomotion-v0"
_UNLIMITED_STEPS = 10**12
"""Steps for `PPO.learn`: the monitor stops it by the clock."""
_MAY_CHANGE_ON_RESUME = ("minutes", "evaluation_episodes", "progress", "output", "resume", "overwrite")
_PANELS = (
    ("velocity_error", "velocity error at decisions, m/s", "#1b6ca8"),
    ("reward", "reward per decision", "#5a8f29"),
    ("falls", "episodes ended by a fall", "#c0392b"),
)


def train(config: RetrievalOptions) -> int:
    """Train a retriever: PPO of Stable-Baselines3 on RetrievalLocomotion-v0, over the frozen controller.

    Args:
        config: The options.

    Returns:
        0; 130 after Ctrl-C, when --resume continues the run.

    Raises:
        FileExistsError: The run folder holds a run, and neither resume nor overwrite was asked for.
        FileNotFoundError: There is nothing to resume, or no such controller.
        ValueError: An option has a bad value.
    """
    # An idle thread that spins steals the core from the physics threads; must be set before torch starts its pool.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    try:
        import stable_baselines3  # noqa: F401
    except ImportError as error:
        raise ImportError(f'Training needs {error.name}: pip install "anyskill-envs[train]".') from error
    folder = RunFolder(config.output)
    folder.prepare(config.resume, config.overwrite)
    if config.resume:
        saved = RetrievalConfig.from_json(json.loads(folder.config.read_text(encoding="utf-8")))
        changes = {name: getattr(config, name) for name in _MAY_CHANGE_ON_RESUME}
        config = dataclasses.replace(saved, **changes | {"minutes": max(saved.minutes, config.minutes)})
    try:
        report = _run(config, folder)
    except KeyboardInterrupt:
        print(f"\nStopped. Continue with: anyskill train-retrieval --output {folder.path} --resume", file=sys.stderr)
        return 130
    from agents.retrieval.evaluate import as_table

    print(as_table(report["evaluation"]))
    print(f"Retriever, curve and report are in {folder.path}; steer it with: anyskill play retrieval {folder.path}")
    return 0


def make_environment(config: RetrievalConfig) -> VecEnv:
    """The environment of a run as Stable-Baselines3 wants it."""
    from agents.sb3 import make_sb3_env

    return make_sb3_env(ENVIRONMENT, config.num_envs, seed=config.seed, monitor=False, **config.environment_options)


def make_model(config: RetrievalConfig, env: VecEnv) -> PPO:
    """PPO with the options of a run, as Stable-Baselines3 ships it.

    The last layer of a new policy is small, so it begins near zeros: retrieval with all weights 1.
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


def _run(config: RetrievalConfig, folder: RunFolder) -> dict[str, Any]:
    import torch
    from stable_baselines3.common.logger import configure
    from stable_baselines3.common.utils import set_random_seed

    from agents.progress import ProgressDisplay
    from agents.retrieval.monitor import RetrievalMonitor
    from agents.text.monitor import load_checkpoint

    torch.set_num_threads(1)  # small networks: more threads cost more than they bring
    started = time.monotonic()
    env = make_environment(config)
    folder.write_json(folder.config, config.to_json())
    budget = 60.0 * config.minutes
    with ProgressDisplay(budget, config.progress) as display:
        if config.resume:
            model, progress = load_checkpoint(folder.checkpoint, env)
            set_random_seed(config.seed + model.num_timesteps)
            env.seed(config.seed + model.num_timesteps)
        else:
            model, progress = make_model(config, env), {"seconds": 0.0, "history": []}
        model.set_logger(configure(str(folder.tensorboard), ["tensorboard"]))
        monitor = RetrievalMonitor(folder, display, budget, progress)
        if progress["seconds"] < budget:
            model.learn(_UNLIMITED_STEPS, callback=monitor, reset_num_timesteps=not config.resume)
            monitor.save()
        display.show(budget, "evaluating")
        env.close()
    write_whole(folder.policy, model.save)
    report = _finish(config, folder, model, monitor.progress)
    report["minutes_in_all"] = (time.monotonic() - started) / 60
    folder.write_json(folder.report, report)
    return report


def _finish(config: RetrievalConfig, folder: RunFolder, model: PPO, progress: dict[str, Any]) -> dict[str, Any]:
    """Exports, evaluates and draws the curve."""
    from agents.doctor import cpu_count
    from agents.retrieval.evaluate import evaluate_retrievers
    from agents.retrieval.retriever import export_retriever, load_retriever, unlearned
    from agents.text.export import file_hash
    from agents.text.report import plot_curve, versions
    from anyskill_envs.controller import CONTROLLER_FILE

    contract = {
        "databases": json.dumps(config.environment_options["databases"]),
        "training_decisions": str(model.num_timesteps),
        "controller_sha256": file_hash(config.controller or CONTROLLER_FILE),
        "versions": json.dumps(versions()),
    }
    write_whole(folder.onnx, lambda path: export_retriever(model, path, contract))
    title = f"retriever: {model.num_timesteps:,} decisions on {cpu_count()} CPUs"
    write_whole(folder.curve, lambda path: plot_curve(path, progress["history"], title, _PANELS))
    evaluation = evaluate_retrievers(
        {"un-learned": unlearned, "trained": load_retriever(folder.onnx)},
        config.environment_options,
        config.evaluation_episodes,
        # not the seed of training, so that no start and no goal was seen before
        seed=config.seed + 1_000_000,
    )
    return {
        "evaluation": evaluation,
        "training": {"minutes": progress["seconds"] / 60, "decisions": model.num_timesteps},
        "cpus": cpu_count(),
        "versions": versions(),
        "config": config.to_json(),
        "history": progress["history"],
    }
