"""The folder of one training run: its file names, and writing that leaves whole files only."""

from __future__ import annotations

import json
import os
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

_MARKS = ("config.json", "checkpoint.zip", "report.json")
"""Files by which a folder is known to hold a run."""


def slug(text: str) -> str:
    """A folder name for a text: "Raise both arms!" becomes "raise-both-arms"."""
    return re.sub(r"[^\w]+", "-", text.lower()).strip("-")[:60].rstrip("-") or "run"


def write_whole(path: Path, write: Callable[[Path], Any]) -> None:
    """Writes a file under a temporary name and renames it, so that an interruption never leaves half a file.

    Args:
        path: Where the file shall be.
        write: Writes it to the path that it gets, which has the same suffix.
    """
    temporary = path.with_name(f".{path.stem}.partial{path.suffix}")
    write(temporary)
    os.replace(temporary, path)


class RunFolder:
    """Paths of a run.

    Args:
        path: The folder.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.config = path / "config.json"
        self.checkpoint = path / "checkpoint.zip"
        self.best = path / "best.zip"
        self.policy = path / "policy.zip"
        self.onnx = path / "policy.onnx"
        self.video = path / "video.mp4"
        self.curve = path / "curve.png"
        self.rollouts = path / "rollouts.npz"
        self.report = path / "report.json"
        self.tensorboard = path / "tensorboard"

    def holds_run(self) -> bool:
        """Whether a run was started here."""
        return any((self.path / name).exists() for name in _MARKS)

    def prepare(self, resume: bool, overwrite: bool) -> None:
        """Makes the folder ready for a run.

        Args:
            resume: A run shall be continued.
            overwrite: A run that is here shall be deleted.

        Raises:
            FileExistsError: A run is here, and neither was asked for.
            FileNotFoundError: There is nothing to resume.
            NotADirectoryError: The path is a file.
        """
        if self.path.exists() and not self.path.is_dir():
            raise NotADirectoryError(f"'{self.path}' is a file; choose another --output.")
        if resume:
            if not self.checkpoint.exists():
                raise FileNotFoundError(
                    f"'{self.path}' has no checkpoint.zip to resume from; leave --resume out to start a new run there."
                )
            return
        if self.holds_run():
            if not overwrite:
                raise FileExistsError(
                    f"'{self.path}' holds a run already. Continue it with --resume, replace it with --overwrite, or "
                    "choose another --output."
                )
            files = (self.config, self.checkpoint, self.best, self.policy, self.onnx, self.video, self.curve)
            for entry in (*files, self.rollouts, self.report):
                entry.unlink(missing_ok=True)
            shutil.rmtree(self.tensorboard, ignore_errors=True)
        self.path.mkdir(parents=True, exist_ok=True)

    def write_json(self, path: Path, value: Any) -> None:
        """Writes a JSON file whole."""
        text = json.dumps(value, indent=2, default=str) + "\n"
        write_whole(path, lambda temporary: temporary.write_text(text, encoding="utf-8"))

    @classmethod
    def existing(cls, path: Path) -> RunFolder:
        """The folder of a run that has a trained policy.

        Raises:
            FileNotFoundError: There is none; the message says which file is missing.
        """
        folder = cls(path)
        for needed in (folder.config, folder.policy):
            if not needed.exists():
                raise FileNotFoundError(
                    f"'{path}' is no finished run: {needed.name} is missing. Train one with "
                    '`anyskill train "<text>"`, or finish it with --resume.'
                )
        return folder
