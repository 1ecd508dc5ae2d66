"""Prints a Markdown table of finished runs from their reports: `python -m agents.text.table runs/*`."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from agents.training.run_folder import RunFolder

_COLUMNS = ("text", "success", "falls", "similarity, start to end", "training", "in all", "controller steps/s")


def row(report: dict[str, Any]) -> tuple[str, ...]:
    """The cells of one run's report."""
    evaluation, training = report["evaluation"], report["training"]
    success = evaluation["success_rate"]
    start, end = training["similarity"]["start"], training["similarity"]["end"]
    return (
        report["text"],
        "no check" if success is None else f"{success:.0%}",
        f"{evaluation['fall_rate']:.0%}",
        "" if start is None else f"{start:.2f} to {end:.2f}",
        f"{training['minutes']:.1f} min",
        f"{report['minutes_in_all']:.1f} min",
        f"{training['controller_steps_per_second']:,.0f}",
    )


def table(reports: Sequence[dict[str, Any]]) -> str:
    """A Markdown table with one row for each report."""
    lines = [_COLUMNS, tuple("---" for _ in _COLUMNS), *map(row, reports)]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in lines)


def main(folders: Sequence[str]) -> int:
    """Prints the table of the run folders that hold a report; returns 2 if none does."""
    paths = [RunFolder(Path(folder)).report for folder in folders]
    reports = [json.loads(path.read_text(encoding="utf-8")) for path in paths if path.is_file()]
    if not reports:
        print("Name run folders that hold a report.json: python -m agents.text.table runs/*", file=sys.stderr)
        return 2
    print(table(reports))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
