"""Every example runs."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parent.parent / "examples"
ARGUMENTS = {
    "random_latents.py": ["--steps", "13"],
    "train_with_sb3.py": ["--humanoids", "4", "--decisions", "64", "--output", "{folder}/policy.zip"],
    "new_environment.py": [],
    "record_video.py": ["idle", "--decisions", "2", "--size", "64", "--output", "{folder}/video.mp4"],
}


def test_every_example_is_known_here():
    assert {path.name for path in EXAMPLES.glob("*.py")} == set(ARGUMENTS)


@pytest.mark.parametrize("name", sorted(ARGUMENTS))
def test_example(name, tmp_path):
    arguments = [argument.format(folder=tmp_path) for argument in ARGUMENTS[name]]
    run = subprocess.run(
        [sys.executable, str(EXAMPLES / name), *arguments],
        capture_output=True,
        text=True,
        timeout=300,
        env={**os.environ, "PYTHONPATH": str(EXAMPLES.parent)},
    )
    assert run.returncode == 0, run.stdout + run.stderr
    assert run.stdout
    for argument in arguments:
        if argument.startswith(str(tmp_path)):
            assert Path(argument).stat().st_size > 1000
