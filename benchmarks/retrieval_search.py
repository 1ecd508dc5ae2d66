"""What the search of RetrievalLocomotion-v0 costs: its share of a step at 50,000 clips and 256 humanoids.

The database is synthetic: poses of the library's locomotion with noise, so that keys lie as those of real motion do.
Queries are those that the environment makes of simulated states and drawn goals, weighted as training does at its start
(1 with a deviation of 0.2). Weights that are uniform from 0 to 2 are as far from 1 as an action can be; fewer cells are then
ruled out. For comparison the same queries go through one product with all keys, without cells, and through a k-d tree. Times
are of the processor, all measured in one run.
"""

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import tyro
from scipy.spatial import KDTree

from anyskill_envs.retrieval import RetrievalLocomotionVectorEnv
from motion_data.nearest import NearestKeys
from motion_data.retrieval import DEFAULT_SELECTION, MotionDatabase, find_database

BAR = 0.05


@dataclass(frozen=True)
class Options:
    """Measure what searching the motion database costs."""

    clips: int = 50_000
    """Clips of 0.5 s in the database."""
    num_envs: int = 256
    """Humanoids."""
    rounds: int = 9
    """Measurements; the median counts."""
    database: str = DEFAULT_SELECTION
    """What the synthetic database is made of."""
    num_threads: int = 1
    """Threads of the simulation; the processor time of a step hardly depends on it."""


def synthetic_keys(database: MotionDatabase, count: int) -> np.ndarray:
    """Raw keys ``(count, 32)``: those of a database again and again, each copy with smooth noise of its own."""
    rng = np.random.default_rng(0)
    copies = -(-count // len(database))
    deviation = database.keys.std(0)
    parts = []
    for _ in range(copies):
        factor = rng.uniform(0.8, 1.25, database.keys.shape[1])
        offset = 0.2 * deviation * rng.normal(size=database.keys.shape[1])
        parts.append(database.keys * factor + offset + 0.02 * deviation * rng.normal(size=database.keys.shape))
    return np.concatenate(parts)[:count]


def cost(work: Callable[[], object]) -> float:
    """Processor time of a call in seconds."""
    start = time.process_time()
    work()
    return time.process_time() - start


def main(options: Annotated[Options, tyro.conf.arg(name="")]) -> int:
    """Print the share; exit code 1 if the bar is missed."""
    source = find_database(options.database)
    keys = synthetic_keys(source, options.clips)
    standardised = (keys - source.mean) * source.scale
    large = NearestKeys(standardised)
    tree = KDTree(standardised)
    product = np.concatenate([standardised.T, -0.5 * (standardised**2).sum(1)[None]]).astype(np.float32)
    rng = np.random.default_rng(1)
    env = RetrievalLocomotionVectorEnv(options.num_envs, databases={"source": source}, num_threads=options.num_threads)
    env.reset(seed=0)
    zeros = np.zeros(env.action_space.shape, np.float32)
    everyone = np.arange(options.num_envs)
    large.query(np.zeros((2, keys.shape[1])))  # warm-up
    large.query(np.zeros((2, keys.shape[1])), np.ones((2, keys.shape[1])))
    steps: list[float] = []
    searches: dict[str, list[float]] = {
        name: [] for name in ("weighted query", "weighted query, uniform", "weighted metric", "all keys", "k-d tree")
    }
    for _ in range(options.rounds):
        steps.append(cost(lambda: env.step(zeros)))
        raw = np.clip(env.queries(everyone), keys.min(0), keys.max(0))
        query = (raw - source.mean) * source.scale
        usual, uniform = np.clip(rng.normal(1, 0.2, query.shape), 0, 2), rng.uniform(0, 2, query.shape)
        searches["weighted query"].append(cost(lambda q=query, w=usual: large.query(w * q)))
        searches["weighted query, uniform"].append(cost(lambda q=query, w=uniform: large.query(w * q)))
        searches["weighted metric"].append(cost(lambda q=query, w=usual: large.query(q, w)))
        rows = np.concatenate([usual * query, np.ones((len(query), 1))], 1).astype(np.float32)
        searches["all keys"].append(cost(lambda rows=rows: (rows @ product).argmax(1)))
        searches["k-d tree"].append(cost(lambda q=query, w=usual: tree.query(w * q)))
    missed = False
    step = statistics.median(steps)
    print(f"step of {options.num_envs} humanoids           {1e3 * step:8.1f} ms of the processor")
    for name, times in searches.items():
        median = statistics.median(times)
        # the step already holds a search in the small database, which is left in: it is small
        share = median / (step + median)
        verdict = f"   (bar {BAR:.0%}: {'missed' if share > BAR else 'ok'})" if name == "weighted query" else ""
        print(f"search, {name:<25}{1e3 * median:8.1f} ms, {share:.1%} of a step with it{verdict}")
        missed |= name == "weighted query" and share > BAR
    return int(missed)


if __name__ == "__main__":
    raise SystemExit(tyro.cli(main))
