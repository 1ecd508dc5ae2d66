"""A progress bar over wall-clock time, for the terminal and for log files."""

from __future__ import annotations

import time
from types import TracebackType
from typing import Self

import numpy as np

LINE_SECONDS = 30.0
"""Where there is no terminal for a progress bar, a line is printed this often."""


class ProgressDisplay:
    """A progress bar over wall-clock seconds with the time left; lines of text where there is no terminal.

    Args:
        total: Seconds that the whole takes.
        shown: False shows nothing.
    """

    def __init__(self, total: float, shown: bool) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

        self._total = total
        self._console = Console()
        self._last_line = -np.inf
        self._lines = shown and not self._console.is_terminal
        self._bar = Progress(
            TextColumn("{task.fields[stage]}"),
            BarColumn(),
            TextColumn("{task.percentage:>3.0f} %"),
            TimeElapsedColumn(),
            TextColumn("{task.fields[left]} left"),
            TextColumn("{task.fields[note]}"),
            console=self._console,
            disable=not shown or self._lines,
        )
        self._task = self._bar.add_task("train", total=total, stage="starting", left="", note="")

    def __enter__(self) -> Self:
        self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._bar.stop()

    def show(self, seconds: float, stage: str, note: str = "", total: float | None = None) -> None:
        """Shows that `seconds` of the total are over; a new total replaces one that was an estimate."""
        if total is not None:
            self._total = max(total, 1e-9)
            self._bar.update(self._task, total=self._total)
        seconds = min(seconds, self._total)
        minutes, rest = divmod(round(self._total - seconds), 60)
        left = f"{minutes}:{rest:02d}"
        self._bar.update(self._task, completed=seconds, stage=stage, left=left, note=note)
        if self._lines and time.monotonic() - self._last_line >= LINE_SECONDS:
            self._last_line = time.monotonic()
            print(f"{stage}: {seconds / self._total:.0%}, {left} left, {note}", flush=True)
