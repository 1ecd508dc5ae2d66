"""The main job: stock PPO of Stable-Baselines3 learns one text on a text environment; the run folder tells how it went."""

from __future__ import annotations

import dataclasses
import json
import os
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from agents.text.config import TrainConfig, TrainOptions
from agents.text.run_folder import RunFolder, slug, write_whole

if TYPE_CHECKING:
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import VecEnv

    from agents.progress import ProgressDisplay
    from agents.text.evaluate import Episode

SEARCH_SHARE = 0.2
"""Share of the training time after which the search begins no new round."""
PLAYED_HUMANOIDS = 32
"""Humanoids that play the policy without exploration; see `agents.text.best_policy`."""
_UNLIMITED_STEPS = 10**12
"""Steps for `PPO.learn`: the monitor stops it by the clock."""
_MAY_CHANGE_ON_RESUME = ("minutes", "evaluation_episodes", "video", "progress", "output", "resume", "overwrite")


def train(config: TrainOptions) -> int:
    """Learn a skill from a sentence.

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
    environment_id(config)  # a wrong name is told before the folder is touched
    folder = RunFolder(config.output or Path("runs") / slug(config.text))
    folder.prepare(config.resume, config.overwrite)
    if config.resume:
        config = _resumed(config, folder)
    started = time.monotonic()
    try:
        report = _run(config, folder, started)
    except KeyboardInterrupt:
        print(
            f"\nStopped. Continue with: anyskill train {config.text!r} --output {folder.path} --resume", file=sys.stderr
        )
        return 130
    _tell(folder, report)
    return 0


def _resumed(config: TrainConfig, folder: RunFolder) -> TrainConfig:
    """The options of the run in the folder, with what may change taken from the new ones."""
    saved = TrainConfig.from_json(json.loads(folder.config.read_text(encoding="utf-8")))
    if saved.text != config.text:
        raise ValueError(f"'{folder.path}' learns {saved.text!r}, not {config.text!r}; choose another --output.")
    changes = {name: getattr(config, name) for name in _MAY_CHANGE_ON_RESUME}
    changes["minutes"] = max(saved.minutes, config.minutes)
    return dataclasses.replace(saved, **changes)


def environment_id(config: TrainConfig) -> str:
    """The environment of a run, for `gym.make`.

    Raises:
        ValueError: There is no such environment, or it takes no text.
    """
    import gymnasium as gym
    from gymnasium.envs.registration import load_env_creator

    from anyskill_envs.text import HumanoidTextEnv

    entry = gym.registry[config.env].entry_point if config.env in gym.registry else None
    made_by: Any = load_env_creator(entry) if isinstance(entry, str) else entry
    if not (isinstance(made_by, type) and issubclass(made_by, HumanoidTextEnv)):
        known = [name for name, spec in gym.registry.items() if str(spec.entry_point).startswith("anyskill_envs.text:")]
        raise ValueError(
            f"There is no environment {config.env!r} that takes a text; those that do are: {', '.join(known)}."
        )
    return f"anyskill_envs:{config.env}"


def environment_options(config: TrainConfig) -> dict[str, Any]:
    """Arguments of the environment that a run's options stand for."""
    controller = None if config.controller is None else str(config.controller)
    options: dict[str, Any] = {"reward": config.reward, "encoder": config.encoder, "controller": controller}
    return options | ({"object_observation": False} if config.blind else {})


def make_environment(config: TrainConfig, num_envs: int) -> VecEnv:
    """The environment of a run as Stable-Baselines3 wants it."""
    from agents.sb3 import make_sb3_env
    from agents.text.shaping import EpisodeClock, ShapedReward

    options = environment_options(config)
    env = make_sb3_env(environment_id(config), num_envs, monitor=False, text=config.text, **options)
    return ShapedReward(EpisodeClock(env), config.alive_bonus, config.reward_scale)


def make_model(config: TrainConfig, env: VecEnv) -> PPO:
    """PPO with the options of a run, as Stable-Baselines3 ships it."""
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


def search_start(config: TrainConfig, model: PPO) -> dict[str, Any]:
    """Lets the policy start from what earns most in the motion library; returns what the report says about it."""
    import gymnasium as gym

    from agents.text.warm_start import warm_start

    options = environment_options(config)
    env = gym.make_vec(environment_id(config), num_envs=config.num_envs, text=config.text, **options)
    controller = env.unwrapped.decoder.controller  # type: ignore[attr-defined]
    report = warm_start(
        model,
        env,
        controller.latents,
        controller.clip_names,
        config.alive_bonus,
        config.seed,
        SEARCH_SHARE * 60 * config.minutes,
    )
    env.close()
    return report


def _run(config: TrainConfig, folder: RunFolder, started: float) -> dict[str, Any]:
    import torch
    from stable_baselines3.common.logger import configure
    from stable_baselines3.common.utils import set_random_seed

    from agents.progress import ProgressDisplay
    from agents.text.best_policy import BestPolicy, restore_best
    from agents.text.clock import CLOCK_SIZE
    from agents.text.monitor import TrainingMonitor, load_checkpoint

    torch.set_num_threads(1)  # small networks: more threads cost more than they bring
    env = make_environment(config, config.num_envs)
    folder.write_json(folder.config, config.to_json())
    budget = 60.0 * config.minutes
    with ProgressDisplay(budget, config.progress) as display:
        if config.resume:
            model, progress = load_checkpoint(folder.checkpoint, env)
            set_random_seed(config.seed + model.num_timesteps)
            env.seed(config.seed + model.num_timesteps)
        else:
            model = make_model(config, env)
            progress = {"seconds": 0.0, "history": [], "search": None}
            if config.warm_start == "search":
                display.show(0.0, "searching the motion library")
                progress["search"] = search_start(config, model)
                progress["seconds"] = time.monotonic() - started
        model.set_logger(configure(str(folder.tensorboard), ["tensorboard"]))
        monitor = TrainingMonitor(folder, display, budget, progress)
        if progress["seconds"] < budget:
            stage = make_environment(config, min(config.num_envs, PLAYED_HUMANOIDS))
            best = BestPolicy(stage, CLOCK_SIZE, config.seed + 2_000_000, folder.best, progress)
            model.learn(_UNLIMITED_STEPS, callback=[best, monitor], reset_num_timesteps=not config.resume)
            monitor.save()  # the policy as training left it, to go on from
            stage.close()
        restore_best(model, folder.best, progress)
        display.show(budget, "evaluating")
        env.close()
        write_whole(folder.policy, model.save)
        return _finish(config, folder, model, monitor.progress, monitor.controller_steps_per_second, started, display)


def _finish(
    config: TrainConfig,
    folder: RunFolder,
    model: PPO,
    progress: dict[str, Any],
    speed: float,
    started: float,
    display: ProgressDisplay,
) -> dict[str, Any]:
    """Evaluates, exports and writes the report."""
    from agents.doctor import cpu_count
    from agents.text.clock import ClockedPolicy
    from agents.text.evaluate import run_episodes, save_rollouts, scene_of, summarise
    from agents.text.export import export_policy, file_hash, parity_error
    from agents.text.report import plot_curve, similarity_ends, versions
    from anyskill_envs.simulation import CONTROLLER_STEPS

    history = progress["history"]
    # not the seed of training, so that no start state was seen before
    evaluation_seed = config.seed + 1_000_000
    seen: list[NDArray[np.float32]] = []

    def act(observation: NDArray[np.float32]) -> NDArray[np.float32]:
        seen.append(observation)
        return model.predict(observation, deterministic=True)[0]

    episodes = run_episodes(
        ClockedPolicy(act),
        config.text,
        config.evaluation_episodes,
        evaluation_seed,
        environment_id(config),
        **environment_options(config),
    )
    write_whole(folder.rollouts, lambda path: save_rollouts(path, episodes))
    evaluation = summarise(episodes, config.text, scene_of(config.env)) | {"seed": evaluation_seed}

    contract = {
        "text": config.text,
        "environment": config.env,
        "reward": config.reward,
        "training_decisions": str(model.num_timesteps),
        "controller_sha256": file_hash(controller_file(config)),
        "versions": json.dumps(versions()),
    }
    write_whole(folder.onnx, lambda path: export_policy(model, path, contract))
    parity = parity_error(model, folder.onnx, np.concatenate(seen))

    title = f"“{config.text}”: {model.num_timesteps:,} decisions on {cpu_count()} CPUs"
    write_whole(folder.curve, lambda path: plot_curve(path, history, title))
    report: dict[str, Any] = {
        "text": config.text,
        "evaluation": evaluation,
        "training": {
            "minutes": progress["seconds"] / 60,
            "decisions": model.num_timesteps,
            "controller_steps": model.num_timesteps * CONTROLLER_STEPS,
            "controller_steps_per_second": speed,
            "similarity": similarity_ends(history),
            "search": progress["search"],
            "plays": progress.get("plays", []),
            "kept": progress.get("kept"),
        },
        "onnx_largest_difference": parity,
        "cpus": cpu_count(),
        "versions": versions(),
        "config": config.to_json(),
        "video": _film(config, folder, episodes[0], display) if config.video else None,
        "minutes_in_all": (time.monotonic() - started) / 60,
        "history": history,
    }
    folder.write_json(folder.report, report)
    return report


def controller_file(config: TrainConfig) -> Path:
    """The low-level controller's file that a run uses."""
    from anyskill_envs.controller import CONTROLLER_FILE

    return config.controller or CONTROLLER_FILE


def _film(config: TrainConfig, folder: RunFolder, episode: Episode, display: ProgressDisplay) -> str:
    """Writes the video of the first evaluation episode; a machine that cannot draw must not lose the run for it."""
    from agents.text.evaluate import scene_of
    from agents.text.video import write_video
    from anyskill_envs.rendering import RenderingError

    display.show(60.0 * config.minutes, "writing the video")
    try:
        write_whole(folder.video, lambda path: write_video(path, episode.qpos, [config.text], scene_of(config.env)))
    except (ImportError, RenderingError) as error:
        print(f"No video: {error}", file=sys.stderr)
        return f"not written: {error}"
    return folder.video.name


def _tell(folder: RunFolder, report: dict[str, Any]) -> None:
    evaluation = report["evaluation"]
    episodes = evaluation["episodes"]
    success = evaluation["success_rate"]
    if success is not None:
        print(f"{success:.0%} of {episodes} episodes succeeded. The check: {evaluation['check']}")
    print(
        f"Falls in {evaluation['fall_rate']:.0%} of {episodes} episodes, mean similarity "
        f"{evaluation['similarity']:.3f}; {report['minutes_in_all']:.1f} minutes in all."
    )
    print(f"Policy, video, curve and report are in {folder.path}; watch it with: anyskill play {folder.path}")
