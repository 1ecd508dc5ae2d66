"""Which runs an ablation consists of, and how far each of them is."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass

from agents.ablation.config import AblationConfig, differences
from agents.text.config import TrainConfig
from agents.training.run_folder import RunFolder, slug


@dataclass(frozen=True)
class Run:
    """One cell of the comparison.

    Attributes:
        reward: The reward as it was named on the command line.
        text: What is learned.
        seed: Seed of training.
        config: Options of the run.
        folder: Where it is.
    """

    reward: str
    text: str
    seed: int
    config: TrainConfig
    folder: RunFolder

    @property
    def name(self) -> str:
        """What the run is called where people read it."""
        return f"{self.reward}, “{self.text}”, seed {self.seed}"

    @property
    def finished(self) -> bool:
        """Whether the run was trained and evaluated."""
        return self.folder.report.is_file() and self.folder.rollouts.is_file()

    def command(self) -> list[str]:
        """The command line that trains it, or goes on where its last checkpoint stands."""
        config = self.config
        words = [sys.executable, "-m", "agents.cli", "train", config.text]
        options: dict[str, object] = {
            "output": self.folder.path,
            "minutes": config.minutes,
            "seed": config.seed,
            "env": config.env,
            "num-envs": config.num_envs,
            "batch-size": config.batch_size,
            "warm-start": config.warm_start,
            "reward": config.reward,
            "encoder": config.encoder,
            "evaluation-episodes": config.evaluation_episodes,
        }
        if config.controller is not None:
            options["controller"] = config.controller
        for name, value in options.items():
            words += [f"--{name}", str(value)]
        words += ["--no-progress"] + ([] if config.video else ["--no-video"])
        if self.folder.checkpoint.is_file():
            words.append("--resume")
        elif self.folder.holds_run():
            words.append("--overwrite")
        return words


def plan(config: AblationConfig) -> list[Run]:
    """The runs of an ablation, seed by seed, so that an early look compares all rewards.

    Raises:
        ValueError: Two runs would share a folder, or a folder holds a run with other options.
    """
    runs = []
    for seed in config.seeds:
        for text in config.texts:
            for reward in config.rewards:
                path = config.output / slug(reward) / slug(text) / f"seed-{seed}"
                runs.append(Run(reward, text, seed, config.training(reward, text, seed, path), RunFolder(path)))
    if len({run.folder.path for run in runs}) < len(runs):
        raise ValueError("Two rewards or texts differ only in punctuation or behind their 60th letter; rename one.")
    for run in runs:
        if run.folder.config.is_file():
            saved = TrainConfig.from_json(json.loads(run.folder.config.read_text(encoding="utf-8")))
            differing = differences(saved, run.config)
            if differing:
                raise ValueError(
                    f"'{run.folder.path}' holds a run with other options ({'; '.join(differing)}); choose another --output, "
                    "or delete that folder."
                )
    return runs
