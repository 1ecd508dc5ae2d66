"""The main job: stock PPO of Stable-Baselines3 learns one text on a text environment; the run folder tells how it went."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from agents.text.config import TrainConfig, TrainOptions
from agents.training.run import EVALUATION_SEED, TrainingJob, begin, require_training, run
from agents.training.run_folder import RunFolder, slug

if TYPE_CHECKING:
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import VecEnv

    from agents.progress import ProgressDisplay
    from agents.text.evaluate import Episode
    from agents.text.monitor import TextMonitor

SEARCH_SHARE = 0.2
"""Share of the training time after which the search begins no new round."""
SEEING_SEARCH_SHARE = 0.4
"""The same where an object is seen: most of what is learned there is learned by the search."""


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
    require_training()
    environment_id(config)  # a wrong name is told before the folder is touched
    folder = RunFolder(config.output or Path("runs") / slug(config.text))
    return run(TextJob(begin(config, folder), folder))


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


def search_start(config: TrainConfig, model: PPO) -> dict[str, Any]:
    """Lets the policy start from what earns most in the motion library; returns what the report says about it."""
    import gymnasium as gym

    from agents.text.steering import sees_object
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
        (SEEING_SEARCH_SHARE if sees_object(env) else SEARCH_SHARE) * 60 * config.minutes,
    )
    env.close()
    return report


def controller_file(config: TrainConfig) -> Path:
    """The low-level controller's file that a run uses."""
    from anyskill_envs.controller import CONTROLLER_FILE

    return config.controller or CONTROLLER_FILE


class TextJob(TrainingJob[TrainConfig]):
    """Learns one text."""

    @property
    def command(self) -> str:
        """The command line of such a run."""
        return f"anyskill train {self.config.text!r}"

    def make_environment(self, num_envs: int) -> VecEnv:
        """The text environment, shaped for PPO."""
        return make_environment(self.config, num_envs)

    def make_monitor(self, display: ProgressDisplay, budget: float, progress: dict[str, Any]) -> TextMonitor:
        """The monitor of text skills."""
        from agents.text.monitor import TextMonitor

        return TextMonitor(self.folder, display, budget, progress)

    def prepare_model(self, model: PPO, display: ProgressDisplay) -> dict[str, Any]:
        """Searches the motion library for a start, unless that is not wanted."""
        if self.config.warm_start == "none":
            return {"search": None}
        display.show(0.0, "searching the motion library")
        report = search_start(self.config, model)
        return {"search": report, "seconds": time.monotonic() - self.started}

    def finish(
        self, model: PPO, training: dict[str, Any], progress: dict[str, Any], display: ProgressDisplay
    ) -> dict[str, Any]:
        """Evaluates, exports, draws the curve and films."""
        from agents.doctor import cpu_count
        from agents.text.clock import ClockedPolicy
        from agents.text.evaluate import run_episodes, save_rollouts, scene_of, summarise
        from agents.text.export import export_text_policy, parity_error
        from agents.text.report import PANELS, similarity_ends
        from agents.training.export import origin
        from agents.training.report import plot_curve
        from motion_data.files import write_whole

        config, folder, history = self.config, self.folder, progress["history"]
        evaluation_seed = config.seed + EVALUATION_SEED
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

        contract = {"text": config.text, "environment": config.env, "reward": config.reward}
        contract |= origin(model, controller_file(config))
        export_text_policy(model, folder.onnx, contract)
        parity = parity_error(model, folder.onnx, np.concatenate(seen))

        title = f"“{config.text}”: {model.num_timesteps:,} decisions on {cpu_count()} CPUs"
        write_whole(folder.curve, lambda path: plot_curve(path, history, title, PANELS))
        return {
            "text": config.text,
            "evaluation": evaluation,
            "training": training | {"similarity": similarity_ends(history), "search": progress["search"]},
            "onnx_largest_difference": parity,
            "video": self._film(episodes[0], display) if config.video else None,
        }

    def _film(self, episode: Episode, display: ProgressDisplay) -> str:
        """Writes the video of an evaluation episode; a machine that cannot draw must not lose the run for it."""
        from agents.text.evaluate import scene_of
        from agents.text.video import write_video
        from anyskill_envs.rendering import RenderingError
        from motion_data.files import write_whole

        display.show(60.0 * self.config.minutes, "writing the video")
        text, scene = self.config.text, scene_of(self.config.env)
        try:
            write_whole(self.folder.video, lambda path: write_video(path, episode.qpos, [text], scene))
        except (ImportError, RenderingError) as error:
            print(f"No video: {error}", file=sys.stderr)
            return f"not written: {error}"
        return self.folder.video.name

    def tell(self, report: dict[str, Any]) -> None:
        """Prints how the evaluation went and where everything is."""
        evaluation = report["evaluation"]
        episodes = evaluation["episodes"]
        success, similarity = evaluation["success_rate"], evaluation["similarity"]
        if success is not None:
            print(f"{success:.0%} of {episodes} episodes succeeded. The check: {evaluation['check']}")
        measured = "" if similarity is None else f", mean similarity {similarity:.3f}"
        print(
            f"Falls in {evaluation['fall_rate']:.0%} of {episodes} episodes{measured}; "
            f"{report['minutes_in_all']:.1f} minutes in all."
        )
        path = self.folder.path
        print(f"Policy, video, curve and report are in {path}; watch it with: anyskill play {path}")
