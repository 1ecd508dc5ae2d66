"""Options of the comparison of rewards, and the scales that make their rewards comparable."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from agents.text.config import TrainConfig
from rewards import make_reward, reward_names
from rewards.base import takes_argument
from rewards.weighted_sum import parse_weights

REWARD_SCALES: dict[str, float] = {
    "clip": 1.0,  #    0.037
    "avgpool": 0.5,  # 0.062
    "vlm-rm": 0.8,  #  0.038
    "clip-s": 0.2,  #  0.079
    "velocity": 0.2,  # 0.252
    "delta": 50.0,  #  0.006, see below
}
"""Factor of a reward that is named alone, so that all are of the size of `clip`.

PPO normalises advantages, but the bonus for not falling (0.5), the value function and the clipped gradient do see how
large a reward is: without a scale a comparison of rewards would be one of sizes. The comments hold what they are chosen
by, as `benchmarks/reward_spread.py` prints it with controller 0.5 and encoder 5: the standard deviation of the reward of a
decision within a text, over 40 humanoids that follow latents of the motion library for 48 decisions each, on the texts of
agents/text/checks.py. The factors are those of an earlier encoder, and rough.

`delta` is a difference of similarities, and its sum over an episode telescopes, so its factor follows from its returns:
averaged over the 5 controller steps of a decision it is (c_t - c_(t-1)) / 5, and with the discount 0.95 the discounted sum
of k times that differs from 0.5 times the discounted sum of c_t, the return of `clip`, by a constant if k = 5 * 0.5 /
(1 - 0.95) = 50 (Ng, Harada and Russell 1999: shaping by a potential). AnySkill's early code has 800: "800*delta".
"""


@dataclass(frozen=True)
class AblationConfig:
    """Compare rewards: train each on every text with every seed, and write one report.

    Runs take one core each and are folders as `anyskill train` makes them. The same command again goes on where it was
    stopped, and more rewards, texts or seeds may be added to it; report.html and results.json are written anew each time.
    """

    rewards: tuple[str, ...] = ("clip", "avgpool", "vlm-rm", "clip-s", "clip+0.2*velocity")
    """Names of rewards, or weighted sums such as "clip+0.2*velocity", with blanks or commas between them. A name alone is
    scaled to the size of clip, see agents/ablation/config.py; a sum is taken as it stands. Others are compared with the
    first."""

    texts: tuple[str, ...] = (
        "raise both arms above the head",
        "wave the right hand",
        "squat down",
        "walk forward",
    )
    """What the humanoid shall do; texts of agents/text/checks.py have a success rate."""

    seeds: tuple[int, ...] = (0, 1, 2)
    """Seeds of training."""

    output: Path = Path("runs/ablation")
    """Folder of the runs and of the report."""

    minutes: float = 8.0
    """Training time of each run on its core, in minutes of wall clock."""

    jobs: int = 0
    """Runs at a time; 0 for one per CPU that this process may use."""

    evaluator: str | None = None
    """Encoder that judges the results (CLIP_S): a name or a folder. By default the bundled evaluator if it is there, else
    the encoder of the reward."""

    pictures: bool = False
    """Let the evaluator look at rendered pictures although it has a state projection; slower."""

    report_only: bool = False
    """Train nothing; measure and report the runs that are finished."""

    env: str = "HumanoidText-v0"
    """Environment of all runs, as in `anyskill train`; rewards such as strike need one with an object."""

    blind: bool = False
    """The policies do not observe the objects, as in AnySkill."""

    encoder: str = "bundled"
    """Encoder of the rewards."""

    controller: Path | None = None
    """Low-level controller (ONNX); the bundled one by default."""

    num_envs: int = 128
    """Humanoids that learn together in each run."""

    warm_start: Literal["search", "none"] = "search"
    """As in `anyskill train`; the search is guided by each run's own reward."""

    evaluation_episodes: int = 20
    """Episodes of 10 s by which each run is judged."""

    video: bool = True
    """Write a video of each run."""

    progress: bool = True
    """Show a progress bar."""

    def __post_init__(self) -> None:
        names = [name.strip() for entry in self.rewards for name in entry.split(",")]
        object.__setattr__(self, "rewards", tuple(name for name in names if name))
        for name in ("rewards", "texts", "seeds"):
            values = getattr(self, name)
            if not values:
                raise ValueError(f"An ablation needs at least one of {name}.")
            if len(set(values)) < len(values):
                raise ValueError(f"An entry of {name} occurs twice: {', '.join(map(str, values))}.")
        if self.jobs < 0:
            raise ValueError(f"jobs must be 0 (one per CPU) or more, got {self.jobs}.")
        # the options that runs have as well are checked there
        first = self.training(self.rewards[0], self.texts[0], self.seeds[0], self.output)
        for reward in self.rewards:
            _check_reward(reward, first)

    def training(self, reward: str, text: str, seed: int, folder: Path) -> TrainConfig:
        """The options of one run.

        Raises:
            ValueError: An option has a bad value.
        """
        return TrainConfig(
            text,
            output=folder,
            minutes=self.minutes,
            seed=seed,
            env=self.env,
            blind=self.blind,
            num_envs=self.num_envs,
            batch_size=min(512, 16 * self.num_envs),
            warm_start=self.warm_start,
            reward=scaled(reward),
            encoder=self.encoder,
            controller=self.controller,
            evaluation_episodes=self.evaluation_episodes,
            video=self.video,
            progress=False,
        )


AblationOptions = Annotated[AblationConfig, tyro.conf.arg(name="")]
"""An `AblationConfig` whose fields are options without a prefix."""

# What a run's result does not depend on.
_WITHOUT_EFFECT = ("output", "progress", "resume", "overwrite", "video")


def scaled(reward: str) -> str:
    """A reward with its scale: "delta" becomes "50*delta", a sum stays as it is spelled."""
    scale = REWARD_SCALES.get(reward, 1.0)
    return reward if scale == 1.0 else f"{scale:g}*{reward}"


def differences(saved: TrainConfig, wanted: TrainConfig) -> list[str]:
    """Options in which two runs differ so that their results do, as "name is ..., not ..."."""
    names = [field.name for field in dataclasses.fields(TrainConfig) if field.name not in _WITHOUT_EFFECT]
    pairs = [(name, getattr(saved, name), getattr(wanted, name)) for name in names]
    return [f"{name} is {ours}, not {theirs}" for name, ours, theirs in pairs if ours != theirs]


def _check_reward(reward: str, run: TrainConfig) -> None:
    """Raises ValueError if a reward is unknown, or looks at an object that the environment of a run does not have."""
    # here: they load MuJoCo, which the help of a command does not need
    from agents.text.evaluate import scene_of
    from agents.text.train import environment_id
    from anyskill_envs.humanoid_reward import require_objects

    names = [reward] if reward in reward_names() else list(parse_weights(reward))
    unknown = [name for name in names if name not in reward_names()]
    if unknown:
        raise ValueError(f"Unknown reward {unknown[0]!r}; the rewards that exist are: {', '.join(reward_names())}.")
    scene = scene_of(environment_id(run))
    for name in names:
        if not takes_argument(name, "encoder"):  # one with an encoder looks at no object, and would load its weights
            try:
                require_objects(make_reward(name), scene)
            except ValueError as error:
                raise ValueError(f"The reward {reward!r} does not fit --env {run.env}. {error}") from error
