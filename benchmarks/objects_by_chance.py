"""What is done with an object by whoever follows one latent of the controller for the whole episode: docs/objects.md.

A trained policy has to be compared with this. Each latent is that of a clip by its name, and nothing looks at the object.
Objects stand where the environments put them, drawn anew for each episode, or at the same place in each, in the middle of
these ranges, as AnySkill's do (its policy is blind to them). Episodes are run and judged as those of a trained policy are.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro

from agents.text.evaluate import run_episodes, scene_of
from anyskill_envs.controller import LowLevelController

SKILLS = (
    ("HumanoidSoccer-v0", "kick the ball", "walk"),
    ("HumanoidDoor-v0", "open the door", "walk"),
    ("HumanoidPillar-v0", "strike the pillar", "walk"),
    ("HumanoidChair-v0", "sit on the chair", "sit_low"),
)
"""Environment, text with a check in agents/text/object_checks.py, and clip whose latent is held."""


@dataclass(frozen=True)
class Options:
    """Measure what one latent does with an object by chance."""

    episodes: int = 100
    """Episodes of 10 s of each row and placement."""
    seed: int = 0
    """Seed of starts and placements."""
    num_threads: int = 0
    """Native threads; 0 for one per CPU. Results do not depend on it."""
    controller: Path | None = None
    """Controller to run; the bundled one by default."""


def middle_placement(environment: str) -> dict[str, dict[str, float]]:
    """Placement that puts each object of an environment in the middle of its ranges (metres, radians)."""
    return {
        name: {field: float(np.mean(getattr(part.item.placement, field))) for field in ("distance", "bearing", "yaw")}
        for name, part in scene_of(environment).parts.items()
    }


def rates(environment: str, text: str, latent: np.ndarray, options: Options, **arguments: Any) -> tuple[float, float]:
    """Shares of the episodes with success and with a fall.

    Args:
        environment: Id of the environment.
        text: Text with a check.
        latent: Action that is held, `(64,)`.
        options: Options of the measurement.
        **arguments: Further arguments of the environment.
    """
    episodes = run_episodes(
        lambda observations: np.tile(latent, (len(observations), 1)),
        text,
        options.episodes,
        options.seed,
        environment,
        reward="velocity",  # any: success and falls are judged from poses, and this one needs no encoder
        controller=options.controller,
        num_threads=options.num_threads,
        **arguments,
    )
    if any(episode.success is None for episode in episodes):
        raise ValueError(f"The text {text!r} has no check in {environment}: add one to agents/text/object_checks.py.")
    return float(np.mean([episode.success for episode in episodes])), float(
        np.mean([episode.fell for episode in episodes])
    )


def main(options: Annotated[Options, tyro.conf.arg(name="")]) -> None:
    """Print the table of docs/objects.md."""
    latents = LowLevelController.load(options.controller).anchors
    print("| text | latent | success | falls | same place each time: success | falls |")
    print("|---|---|---|---|---|---|")
    for environment, text, clip in SKILLS:
        drawn = rates(environment, text, latents[clip], options)
        middle = rates(environment, text, latents[clip], options, placement=middle_placement(environment))
        shares = " | ".join(f"{100 * share:.0f} %" for share in (*drawn, *middle))
        print(f"| {text} | `{clip}` | {shares} |", flush=True)


if __name__ == "__main__":
    tyro.cli(main)
