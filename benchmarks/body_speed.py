"""How fast the physics of this project's humanoid are beside those of another MJCF, measured in turns in one run.

    python benchmarks/body_speed.py amp_humanoid.xml

Both bodies hold their rest pose, are pushed over and lie, with the same sequence of pushes, so that they touch the floor
alike. A body with motors, as those of Isaac Gym, whose joints carry the gains as stiffness and damping, gets position
actuators with them: half the damping and armature of at least 0.03, without which the AMP humanoid blows up at 120 Hz. Both
run at 120 Hz with our solver settings (the other's own would be unstable there), with contacts between body and floor alone.
"""

import json
import statistics
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import mujoco
import numpy as np
import tyro
from mujoco.batch import Batch

from anyskill_envs.simulation import PHYSICS_STEPS
from motion_data.skeleton import HUMANOID_XML


@dataclass(frozen=True)
class Options:
    """Measure the speed of two bodies."""

    mjcf: Annotated[Path, tyro.conf.Positional]
    """The other body."""
    num_humanoids: int = 512
    """Humanoids in each batch."""
    steps: int = 90
    """Controller steps per measurement."""
    rounds: int = 5
    """Measurements of each; the median counts."""
    num_threads: int = 0
    """Native threads; 0 for one per CPU."""


def prepared(path: Path) -> mujoco.MjModel:
    """A body of an MJCF with position actuators and our solver settings, at 120 Hz, that touches only the floor."""
    spec = mujoco.MjSpec.from_file(str(path))
    ours = mujoco.MjSpec.from_file(str(HUMANOID_XML)).option
    spec.option.timestep, spec.option.integrator = ours.timestep, ours.integrator
    spec.option.disableflags, spec.option.cone = ours.disableflags, ours.cone
    spec.option.iterations, spec.option.ls_iterations = ours.iterations, ours.ls_iterations
    motors = {actuator.target: actuator for actuator in spec.actuators if not float(actuator.gainprm[0]) > 1}
    for joint in spec.joints:
        if joint.name not in motors:
            continue
        force = 2 * float(motors[joint.name].gear[0])
        stiffness, damping = float(np.ravel(joint.stiffness)[0]), float(np.ravel(joint.damping)[0])
        spec.delete(motors[joint.name])
        joint.stiffness, joint.damping = np.zeros(3), np.array([0.5, 0.0, 0.0])
        joint.armature = max(joint.armature, 0.03)
        added = spec.add_actuator(name=joint.name, target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        added.set_to_position(kp=stiffness, kv=damping / 2)
        added.forcelimited, added.forcerange = True, [-force, force]
    for geom in spec.geoms:
        if geom.type == mujoco.mjtGeom.mjGEOM_PLANE:
            geom.contype, geom.conaffinity = 1, 0
        elif geom.contype or geom.conaffinity:
            geom.contype, geom.conaffinity = 0, 1
        geom.condim = 3
    return spec.compile()


def episode(batch: Batch, options: Options) -> tuple[float, float]:
    """Controller steps per second, and contacts per humanoid, while the batch stands, falls and lies."""
    pushes = np.random.default_rng(0).normal(size=(options.num_humanoids, 3)) * [60.0, 60.0, 0.0]
    batch.reset()
    external, contacts = batch.bind("xfrc_applied"), batch.bind("ncon")
    counts = []
    start = time.perf_counter()
    for step in range(options.steps):
        external[:, 1] = 0.0
        if step < options.steps // 2:
            external[:, 1, :3] = pushes
        batch.step(nstep=PHYSICS_STEPS)
        counts.append(contacts.mean())
    seconds = time.perf_counter() - start
    return options.num_humanoids * options.steps / seconds, float(np.mean(counts))


def main() -> None:
    """Prints the speeds as JSON."""
    options = tyro.cli(Options)
    models = {"ours": prepared(HUMANOID_XML), "other": prepared(options.mjcf)}
    batches = {name: Batch(model, options.num_humanoids, options.num_threads) for name, model in models.items()}
    results: dict[str, list[tuple[float, float]]] = {name: [] for name in batches}
    for _ in range(options.rounds):
        for name, batch in batches.items():
            results[name].append(episode(batch, options))
    speeds = {name: statistics.median(speed for speed, _ in rows) for name, rows in results.items()}
    for name, rows in results.items():
        print(
            json.dumps(
                {
                    "body": name,
                    "controller_steps_per_second": round(speeds[name]),
                    "contacts": round(rows[0][1], 2),
                    "ours_over_it": round(speeds["ours"] / speeds[name], 2),
                }
            )
        )


if __name__ == "__main__":
    main()
