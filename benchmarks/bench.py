"""How fast the environments are, as ratios of speeds measured in turns in one run, so that they mean the same anywhere.

All speeds are controller steps (1/30 s of one humanoid) per second of wall time:

- physics: the native batch steps the same MJCF through the same PD targets and does nothing else,
- controller: its calls for the whole batch, without physics,
- environment: HumanoidLatent-v0 from `gym.make_vec`, controller, observations, rewards and endings included,
- subprocesses: Stable-Baselines3's `SubprocVecEnv` of the single HumanoidLatent-v0, at the better number of processes,
- HumanoidSoccer-v0 and the other scenes: the environment with its text reward against bare physics of the same scene,
- training: PPO on HumanoidText-v0 with the settings of `anyskill train`, learning included.
"""

import json
import statistics
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import gymnasium as gym
import numpy as np
import tyro
from mujoco.batch import Batch

from anyskill_envs.latent import HumanoidLatentVectorEnv
from anyskill_envs.simulation import CONTROLLER_STEPS, PHYSICS_STEPS

SCENES = ("HumanoidSoccer-v0", "HumanoidDoor-v0", "HumanoidChair-v0", "HumanoidPillar-v0")
BARS = {
    "controller / physics": 5.0,
    "environment / physics": 0.8,
    "environment / subprocesses": 3.0,
    "training": 3000.0,
}
BARS |= {f"{scene} / physics": 0.7 for scene in SCENES}


@dataclass(frozen=True)
class Options:
    """Measure the speed of the simulation."""

    num_envs: int = 512
    """Humanoids in the batch."""
    decisions: int = 12
    """High-level decisions per measurement."""
    rounds: int = 5
    """Measurements of each kind; the median counts."""
    training_envs: int = 128
    """Humanoids in training."""
    training_decisions: int = 96
    """Decisions of each humanoid in training."""
    num_threads: int = 0
    """Native threads; 0 for one per CPU."""
    controller: Path | None = None
    """Controller to run; the bundled one by default."""
    output: Path | None = None
    """JSON file to write the results to."""


def seconds(work: Callable[[], object]) -> float:
    """Wall time of a call."""
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


class Environment:
    """A batched environment of latents; remembers the PD targets of its first measurement."""

    def __init__(self, options: Options, environment_id: str = "HumanoidLatent-v0") -> None:
        made = gym.make_vec(
            f"anyskill_envs:{environment_id}",
            options.num_envs,
            controller=options.controller,
            num_threads=options.num_threads,
        ).unwrapped
        assert isinstance(made, HumanoidLatentVectorEnv)
        self.envs = made
        standing = self.envs.decoder.controller.standing_latents
        self.actions = standing[np.random.default_rng(0).integers(len(standing), size=options.num_envs)]
        self.decisions = options.decisions
        self.targets: list[np.ndarray] = []
        self.record()

    def record(self) -> None:
        """Run once and keep the targets, so that the bare physics do the same work."""
        controller = self.envs.decoder.controller
        self.envs.reset(seed=0)
        commands = self.envs.decoder.commands(self.actions)
        for _ in range(self.decisions * CONTROLLER_STEPS):
            self.targets.append(controller.act(self.envs.proprioception, commands).astype(float))
            self.envs.simulation.step(self.targets[-1])
            self.envs.proprioception = self.envs.simulation.observation()

    def speed(self) -> float:
        """Controller steps per second."""
        self.envs.reset(seed=0)

        def run() -> None:
            for _ in range(self.decisions):
                self.envs.step(self.actions)

        return self.envs.num_envs * self.decisions * CONTROLLER_STEPS / seconds(run)

    def controller_speed(self) -> float:
        """Controller steps per second of the controller alone."""
        controller, observation = self.envs.decoder.controller, self.envs.proprioception
        commands = self.envs.decoder.commands(self.actions)

        def run() -> None:
            for _ in self.targets:
                controller.act(observation, commands)

        return self.envs.num_envs * len(self.targets) / seconds(run)


class Physics:
    """The native batch alone, of the environment's own scene."""

    def __init__(self, environment: Environment, options: Options) -> None:
        simulation = environment.envs.simulation
        self.batch = Batch(simulation.model, len(simulation), simulation.batch.nthread)
        self.controls = self.batch.bind("ctrl")
        environment.envs.reset(seed=0)
        self.start = simulation.batch.state.copy()
        self.targets = environment.targets

    def speed(self) -> float:
        """Controller steps per second."""
        self.batch.state[:] = self.start

        def run() -> None:
            for targets in self.targets:
                self.controls[:] = targets
                self.batch.step(nstep=PHYSICS_STEPS)

        return self.batch.nsim * len(self.targets) / seconds(run)


class Subprocesses:
    """Single environments in processes of their own, as Stable-Baselines3 does it."""

    def __init__(self, count: int, options: Options) -> None:
        from stable_baselines3.common.vec_env import SubprocVecEnv

        controller = str(options.controller) if options.controller else None

        def make() -> gym.Env:
            # "module:id" registers the environments in the process
            return gym.make("anyskill_envs:HumanoidLatent-v0", controller=controller, num_threads=1)

        self.envs = SubprocVecEnv([make] * count)
        self.envs.reset()
        self.decisions = options.decisions
        self.actions = np.zeros((count, *self.envs.action_space.shape), np.float32)

    def speed(self) -> float:
        """Controller steps per second."""

        def run() -> None:
            for _ in range(self.decisions):
                self.envs.step(self.actions)

        return self.envs.num_envs * self.decisions * CONTROLLER_STEPS / seconds(run)


def training_speed(options: Options) -> float:
    """Controller steps per second of the main job's PPO, as `anyskill train` sets it up."""
    import torch

    from agents.text.config import TrainConfig
    from agents.text.train import make_environment
    from agents.training.run import make_model

    torch.set_num_threads(1)  # as the main job does
    config = TrainConfig(
        text="raise both arms above the head", num_envs=options.training_envs, controller=options.controller
    )
    env = make_environment(config, config.num_envs)
    model = make_model(config, env)
    model.learn(config.decisions_per_update * config.num_envs)  # warm-up
    before = model.num_timesteps
    elapsed = seconds(lambda: model.learn(options.training_decisions * config.num_envs, reset_num_timesteps=False))
    env.close()
    return (model.num_timesteps - before) * CONTROLLER_STEPS / elapsed


def in_turns(environment: Environment, options: Options) -> list[tuple[float, float]]:
    """Speeds of bare physics and of the environment, measured one after the other."""
    physics = Physics(environment, options)
    return [(physics.speed(), environment.speed()) for _ in range(options.rounds)]


def measure(options: Options) -> dict[str, float]:
    """All speeds and ratios."""
    environment = Environment(options)
    pairs = in_turns(environment, options)
    physics = statistics.median(first for first, _ in pairs)
    controller = statistics.median(environment.controller_speed() for _ in range(options.rounds))
    results = {
        "physics": physics,
        "controller": controller,
        "controller / physics": controller / physics,
        "environment": statistics.median(second for _, second in pairs),
        "environment / physics": statistics.median(second / first for first, second in pairs),
    }
    threads = environment.envs.simulation.batch.nthread
    best: list[tuple[float, float]] = []
    for count in (threads, 4 * threads):
        subprocesses = Subprocesses(count, options)
        subprocesses.speed()  # warm-up
        best = max(best, [(subprocesses.speed(), environment.speed()) for _ in range(options.rounds)])
        subprocesses.envs.close()
    results["subprocesses"] = statistics.median(first for first, _ in best)
    results["environment / subprocesses"] = statistics.median(second / first for first, second in best)
    for scene in SCENES:
        pairs = in_turns(Environment(options, scene), options)
        results[f"{scene} / physics"] = statistics.median(second / first for first, second in pairs)
    results["training"] = training_speed(options)
    return results


def main(options: Annotated[Options, tyro.conf.arg(name="")]) -> int:
    """Print a table; exit code 1 if a bar is missed."""
    results = measure(options)
    missed = False
    for name, value in results.items():
        bar = BARS.get(name)
        missed |= bar is not None and value < bar
        unit = "" if "/" in name else " controller steps/s"
        verdict = "" if bar is None else f"   (bar {bar:g}: {'missed' if value < bar else 'ok'})"
        print(
            f"{name:<28}{value:>10.3g}{unit}{verdict}" if "/" in name else f"{name:<28}{value:>10,.0f}{unit}{verdict}"
        )
    if options.output is not None:
        report = {"options": {key: str(value) for key, value in asdict(options).items()}, "results": results}
        options.output.write_text(json.dumps(report, indent=2) + "\n")
    return int(missed)


if __name__ == "__main__":
    raise SystemExit(tyro.cli(main))
