"""The folder of one training run: its file names, and what stands in the way of a new run."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path
from typing import Any

_MARKS = ("config.json", "checkpoint.zip", "report.json")
"""Files by which a folder is known to hold a run."""


def slug(text: str) -> str:
    """A folder name for a text: "Raise both arms!" becomes "raise-both-arms"."""
    return re.sub(r"[^\w]+", "-", text.lower()).strip("-")[:60].rstrip("-") or "run"


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
        from motion_data.files import write_whole  # here: it loads MuJoCo, which the help of a command does not need

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
                    f"'{path}' is no finished run: {needed.name} is missing. Finish it with --resume, or train one "
                    "(`anyskill train --help`)."
                )
        return folder
