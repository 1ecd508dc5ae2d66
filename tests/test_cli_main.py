"""The command line: every command exists, help is instant, and a mistake is answered with one sentence."""

import json
import subprocess
import sys

import pytest

from agents import cli
from agents.doctor import Finding, _attempt, doctor

TARGETS = {
    " ".join([name, subcommand]).strip(): target
    for name, command in cli.COMMANDS.items()
    for subcommand, target in (command.subcommands | ({"": command.target} if command.target else {})).items()
}


@pytest.mark.parametrize("words", TARGETS)
def test_every_command_has_help(words, capsys):
    with pytest.raises(SystemExit) as stop:
        cli.main([*words.split(), "--help"])
    assert stop.value.code == 0
    function = cli.load_function(TARGETS[words])
    first_line = (function.__doc__ or "").strip().splitlines()[0]
    shown = " ".join(capsys.readouterr().out.split())
    # a command whose options are a dataclass shows that one's description
    assert first_line in shown or words == "train"


def test_help_loads_nothing_heavy():
    code = (
        "import sys\nfrom agents import cli\n"
        "try: cli.main(['--help'])\nexcept SystemExit: pass\n"
        "heavy = {'torch', 'mujoco', 'numpy', 'gymnasium', 'stable_baselines3', 'tyro'} & set(sys.modules)\n"
        "sys.exit(f'loaded: {heavy}' if heavy else 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert all(name in done.stdout for name in cli.COMMANDS)


def test_help_of_training_loads_no_torch():
    code = (
        "import sys\nfrom agents import cli\n"
        "try: cli.main(['train', '--help'])\nexcept SystemExit: pass\n"
        "sys.exit('torch' in sys.modules or 'mujoco' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True).returncode == 0


@pytest.mark.parametrize("words", [["dance"], ["motions"], ["motions", "sing"], ["train"], ["train", "x", "--what"]])
def test_wrong_words_end_with_code_2(words, capsys):
    with pytest.raises(SystemExit) as stop:
        cli.main(words)
    assert stop.value.code == 2
    assert "Traceback" not in capsys.readouterr().err


def test_no_words_show_the_help(capsys):
    assert cli.main([]) == 2
    assert "doctor" in capsys.readouterr().out


def test_a_users_mistake_is_one_sentence(capsys, monkeypatch):
    monkeypatch.delenv("ANYSKILL_TRACEBACK", raising=False)
    assert cli.main(["train", "squat down", "--minutes", "-1"]) == 2
    error = capsys.readouterr().err
    assert "minutes must be a positive number, got -1.0." in error
    assert "Traceback" not in error


def test_the_traceback_can_be_asked_for(monkeypatch, tmp_path):
    monkeypatch.setenv("ANYSKILL_TRACEBACK", "1")
    with pytest.raises(FileNotFoundError):
        cli.main(["play", str(tmp_path)])


def test_a_fault_of_ours_keeps_its_traceback(monkeypatch):
    def broken(json_output: bool = False) -> int:
        """Breaks."""
        raise RuntimeError("a bug")

    monkeypatch.setattr("agents.doctor.doctor", broken)
    with pytest.raises(RuntimeError, match="a bug"):
        cli.main(["doctor"])


def test_a_failed_look_is_a_finding_with_its_fix():
    def broken() -> str:
        raise OSError("first line\nno such library")

    assert _attempt("x", broken, "install it") == Finding("x", False, "no such library", "install it", True)


def test_the_doctor_finds_the_core_healthy_and_names_a_fix_for_the_rest(capsys):
    code = doctor(json_output=True)
    report = json.loads(capsys.readouterr().out)
    assert (code, report["ok"]) == (0, True), [finding for finding in report["findings"] if not finding["ok"]]
    names = [finding["name"] for finding in report["findings"]]
    assert {"machine", "physics", "low-level controller", "environment"} <= set(names)
    assert all(finding["fix"] for finding in report["findings"] if not finding["ok"])


def test_an_unhealthy_core_fails_the_doctor(monkeypatch, capsys):
    monkeypatch.setattr("agents.doctor.examine", lambda: [Finding("physics", False, "broken", "mend it")])
    assert doctor() == 1
    assert "mend it" in capsys.readouterr().out
