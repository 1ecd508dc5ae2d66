"""Runs commands side by side, one on each core."""

from __future__ import annotations

import os
import subprocess
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

POLL_SECONDS = 0.2
PATIENCE_SECONDS = 20.0
"""How long a command that is told to stop may take before it is killed."""

# Libraries that would otherwise start a thread for each core of the machine.
_ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")


@dataclass(frozen=True)
class Job:
    """A command to run.

    Attributes:
        name: What it is called where people read it.
        command: Its words.
        log: File that gets its output.
    """

    name: str
    command: Sequence[str]
    log: Path


@dataclass(frozen=True)
class Outcome:
    """How a command ended.

    Attributes:
        job: The command.
        code: Its exit code.
        seconds: How long it took.
    """

    job: Job
    code: int
    seconds: float


def usable_cores() -> list[int]:
    """Numbers of the cores that this process may use."""
    return sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else list(range(os.cpu_count() or 1))


def run_jobs(
    jobs: Sequence[Job],
    cores: Sequence[int],
    tell: Callable[[list[Outcome], list[tuple[Job, float]]], None] = lambda ended, running: None,
) -> list[Outcome]:
    """Runs commands, each on one core with one thread, as many at a time as there are cores.

    Args:
        jobs: The commands, in the order in which they start.
        cores: Numbers of the cores; where a process cannot be tied to one, their count is what matters.
        tell: Called several times a second with what has ended, and what runs since how many seconds.

    Returns:
        How each ended, in that order.

    Raises:
        KeyboardInterrupt: Ctrl-C was pressed; the running commands were told to stop and have ended.
    """
    waiting = list(jobs)
    free = list(enumerate(cores))  # numbered places, for two may be on one core
    running: dict[int, tuple[Job, subprocess.Popen[bytes], float]] = {}
    ended: list[Outcome] = []
    try:
        while waiting or running:
            while waiting and free:
                place, core = free.pop(0)
                job = waiting.pop(0)
                running[place] = (job, _start(job, core), time.monotonic())
            for place, (job, process, started) in list(running.items()):
                if process.poll() is not None:
                    ended.append(Outcome(job, process.returncode, time.monotonic() - started))
                    del running[place]
                    free.append((place, cores[place]))
            tell(ended, [(job, time.monotonic() - started) for job, _, started in running.values()])
            if running and (not waiting or not free):
                time.sleep(POLL_SECONDS)
    finally:
        _stop([process for _, process, _ in running.values()])
    return ended


def _start(job: Job, core: int) -> subprocess.Popen[bytes]:
    job.log.parent.mkdir(parents=True, exist_ok=True)
    with job.log.open("ab") as log:
        # In a session of its own: Ctrl-C in the terminal stops it from here only, in order.
        process = subprocess.Popen(
            job.command,
            stdout=log,
            stderr=subprocess.STDOUT,
            stdin=subprocess.DEVNULL,
            env=os.environ | _ONE_THREAD,
            start_new_session=True,
        )
    if hasattr(os, "sched_setaffinity"):
        with suppress(OSError):  # it has ended already, or the core was taken away
            os.sched_setaffinity(process.pid, {core})
    return process


def _stop(processes: list[subprocess.Popen[bytes]]) -> None:
    for process in processes:
        with suppress(OSError):
            process.terminate()  # a run goes on from its last checkpoint, whatever ended it
    deadline = time.monotonic() + PATIENCE_SECONDS
    for process in processes:
        try:
            process.wait(max(0.1, deadline - time.monotonic()))
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
