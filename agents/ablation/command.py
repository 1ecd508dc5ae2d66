"""`anyskill ablate`: trains what is missing, then writes the report."""

from __future__ import annotations

import importlib.util
import signal
import sys
import time
from collections.abc import Sequence
from types import FrameType

from agents.ablation.config import AblationConfig, AblationOptions
from agents.ablation.jobs import Job, Outcome, run_jobs, usable_cores
from agents.ablation.plan import Run, plan

OVERHEAD_SECONDS = 60.0
"""What evaluation, export and video add to a run, until the first run has shown it."""
_LOG = "log.txt"


def ablate(config: AblationOptions) -> int:
    """Compare rewards: train each on every text with every seed, and write one report.

    Args:
        config: The options.

    Returns:
        0; 1 if a run failed; 130 after Ctrl-C, when the same command goes on.

    Raises:
        ValueError: An option has a bad value, or the output folder holds runs with other options.
    """
    for package in ("jinja2", "matplotlib", "rich", "stable_baselines3"):
        if importlib.util.find_spec(package) is None:
            raise ImportError(f'An ablation needs {package}: pip install "anyskill-envs[train]".')
    from agents.ablation.evaluator import choose_evaluator
    from agents.ablation.report import write_report

    runs = plan(config)
    # before anything is trained: a wrong name must not be found out after hours
    evaluator = choose_evaluator(config.evaluator, config.encoder, config.pictures)
    failed: list[str] = []
    if not config.report_only:
        signal.signal(signal.SIGTERM, _interrupt)  # the runs must not outlive this process
        try:
            failed = _train(config, [run for run in runs if not run.finished])
        except KeyboardInterrupt:
            print("\nStopped. The same command goes on.", file=sys.stderr)
            return 130
    page = write_report(config, runs, evaluator, failed)
    for line in failed:
        print(line, file=sys.stderr)
    if page is None:
        print("No run is finished, so there is nothing to report.", file=sys.stderr)
        return 1
    print(f"{sum(run.finished for run in runs)} of {len(runs)} runs are finished. {evaluator.note}\nReport: {page}")
    return 1 if failed else 0


def _interrupt(number: int, frame: FrameType | None) -> None:
    raise KeyboardInterrupt


def _train(config: AblationConfig, missing: Sequence[Run]) -> list[str]:
    """Trains the missing runs; returns a line for each that failed."""
    from agents.progress import ProgressDisplay

    if not missing:
        return []
    cores = usable_cores()
    if config.jobs:
        cores = [cores[index % len(cores)] for index in range(config.jobs)]
    clock = Clock(60.0 * config.minutes + OVERHEAD_SECONDS, len(missing), len(cores))
    jobs = [Job(run.name, run.command(), run.folder.path / _LOG) for run in missing]
    started = time.monotonic()
    with ProgressDisplay(clock.left([], []), config.progress) as display:

        def tell(ended: list[Outcome], running: list[tuple[Job, float]]) -> None:
            left = clock.left([each.seconds for each in ended], [seconds for _, seconds in running])
            passed = time.monotonic() - started
            note = f"{len(ended)} of {len(jobs)} runs, {len(running)} running"
            display.show(passed, "training", note, total=passed + left)

        outcomes = run_jobs(jobs, cores, tell)
    return [
        f"{each.job.name} ended with code {each.code}; its output is in {each.job.log}"
        for each in outcomes
        if each.code != 0
    ]


class Clock:
    """Estimates how long the rest takes.

    Args:
        expected: Seconds that a run is expected to take; the mean of those that have ended replaces it.
        count: How many runs there are.
        cores: How many run at a time.
    """

    def __init__(self, expected: float, count: int, cores: int) -> None:
        self._expected = expected
        self._count = count
        self._cores = cores

    def left(self, ended: Sequence[float], running: Sequence[float]) -> float:
        """Seconds that are left.

        Args:
            ended: Seconds that each ended run took.
            running: Seconds that each running one has taken so far.
        """
        each = sum(ended) / len(ended) if ended else self._expected
        begun = [max(each - seconds, 0.0) for seconds in running]
        waiting = self._count - len(ended) - len(running)
        # The work shared evenly, but a run cannot be split: no less than the longest that is under way.
        return max([(sum(begun) + waiting * each) / self._cores, *begun])
