"""`anyskill train-retrieval`: stock PPO of Stable-Baselines3 learns to weight the queries of RetrievalLocomotion-v0."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from agents.retrieval.config import RetrievalConfig, RetrievalOptions
from agents.training.run import EVALUATION_SEED, TrainingJob, begin, require_training, run
from agents.training.run_folder import RunFolder

if TYPE_CHECKING:
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import VecEnv

    from agents.progress import ProgressDisplay
    from agents.retrieval.monitor import RetrievalMonitor

ENVIRONMENT = "anyskill_envs:RetrievalLocomotion-v0"
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
    require_training()
    folder = RunFolder(config.output)
    return run(RetrievalJob(begin(config, folder), folder))


class RetrievalJob(TrainingJob[RetrievalConfig]):
    """Learns to weight the queries; a new policy's actions are near zeros, which is retrieval with all weights 1."""

    command = "anyskill train-retrieval"

    def make_environment(self, num_envs: int) -> VecEnv:
        """The environment of retrieval locomotion."""
        from agents.sb3 import make_sb3_env

        return make_sb3_env(ENVIRONMENT, num_envs, monitor=False, **self.config.environment_options)

    def make_monitor(self, display: ProgressDisplay, budget: float, progress: dict[str, Any]) -> RetrievalMonitor:
        """The monitor of retrieval locomotion."""
        from agents.retrieval.monitor import RetrievalMonitor

        return RetrievalMonitor(self.folder, display, budget, progress)

    def finish(
        self, model: PPO, training: dict[str, Any], progress: dict[str, Any], display: ProgressDisplay
    ) -> dict[str, Any]:
        """Exports, draws the curve and evaluates, with un-learned retrieval beside it."""
        from agents.doctor import cpu_count
        from agents.retrieval.evaluate import evaluate_retrievers
        from agents.retrieval.retriever import export_retriever, load_retriever, unlearned
        from agents.training.export import origin
        from agents.training.report import plot_curve
        from anyskill_envs.controller import CONTROLLER_FILE
        from motion_data.files import write_whole

        config, folder = self.config, self.folder
        contract = {"databases": json.dumps(config.environment_options["databases"])}
        contract |= origin(model, config.controller or CONTROLLER_FILE)
        export_retriever(model, folder.onnx, contract)
        title = f"retriever: {model.num_timesteps:,} decisions on {cpu_count()} CPUs"
        write_whole(folder.curve, lambda path: plot_curve(path, progress["history"], title, _PANELS))
        evaluation = evaluate_retrievers(
            {"un-learned": unlearned, "trained": load_retriever(folder.onnx)},
            config.environment_options,
            config.evaluation_episodes,
            seed=config.seed + EVALUATION_SEED,
        )
        return {"evaluation": evaluation, "training": training}

    def tell(self, report: dict[str, Any]) -> None:
        """Prints the evaluation and where everything is."""
        from agents.retrieval.evaluate import as_table

        print(as_table(report["evaluation"]))
        path = self.folder.path
        print(f"Retriever, curve and report are in {path}; steer it with: anyskill play retrieval {path}")
