"""The command `anyskill`: one table of commands, each read by tyro from the function that does the work.

A command's module is imported only when the command runs, so `anyskill --help` needs neither torch nor MuJoCo.
"""

from __future__ import annotations

import argparse
import importlib
import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Command:
    """One entry of the command line.

    Attributes:
        help: One line for the table of `anyskill --help`.
        target: "module:function" of a command without sub-commands, or of one whose first word may be none of them.
        subcommands: Name of each sub-command and its "module:function".
    """

    help: str
    target: str = ""
    subcommands: dict[str, str] = field(default_factory=dict)


COMMANDS: dict[str, Command] = {
    "train": Command("learn a skill from a sentence", "agents.text.train:train"),
    "play": Command(
        "watch a trained skill, or write a video of it; or steer a humanoid",
        "agents.text.play:play",
        subcommands={"retrieval": "agents.retrieval.play:play"},
    ),
    "train-retrieval": Command("learn to retrieve clips that the humanoid can follow", "agents.retrieval.train:train"),
    "evaluate": Command("measure what was trained", subcommands={"retrieval": "agents.retrieval.evaluate:evaluate"}),
    "ablate": Command("compare rewards: train each on the same texts, and report", "agents.ablation.command:ablate"),
    "motions": Command(
        "list the motion clips, draw one, or import your own",
        subcommands={
            "list": "agents.motions_cli:list_motions",
            "show": "agents.motions_cli:show_motion",
            "import": "agents.motions_cli:import_motion",
        },
    ),
    "controller": Command(
        "train, evaluate or draw the low-level controller",
        subcommands={
            "train": "agents.controller.commands:train",
            "evaluate": "agents.controller.commands:evaluate",
            "show": "agents.controller.commands:show",
            "calm": "agents.controller.calm.command:calm",
        },
    ),
    "encoder": Command(
        "measure an encoder, fit its state projection, train the bundled one, export a CLIP-like model",
        subcommands={
            "evaluate": "agents.encoder.evaluate_command:evaluate_command",
            "project": "agents.encoder.project_command:project",
            "train": "agents.encoder.train:train",
            "export": "agents.encoder.onnx_command:export",
        },
    ),
    "texts": Command(
        "make instructions of captions: filter, score, rewrite",
        subcommands={
            "filter": "agents.texts.commands:filter_texts",
            "score": "agents.texts.commands:score_texts",
            "rewrite": "agents.texts.commands:rewrite_texts",
        },
    ),
    "doctor": Command("say what this machine can do", "agents.doctor:doctor"),
}

# What a user can mend: shown as one sentence. Anything else is a fault of ours and keeps its traceback.
USER_ERRORS = (ValueError, FileNotFoundError, FileExistsError, NotADirectoryError, ImportError)


def load_function(target: str) -> Callable[..., Any]:
    """Imports the function that a "module:function" string names."""
    module, _, name = target.partition(":")
    return getattr(importlib.import_module(module), name)


def _usage() -> str:
    width = max(map(len, COMMANDS)) + 2
    lines = ["commands:"]
    for name, command in COMMANDS.items():
        subcommands = f" ({' | '.join(command.subcommands)})" if command.subcommands else ""
        lines.append(f"  {name:<{width}}{command.help}{subcommands}")
    lines.append("\n`anyskill COMMAND --help` shows a command's options.")
    return "\n".join(lines)


def _run(target: str, prog: str, arguments: Sequence[str]) -> int:
    import tyro

    result = tyro.cli(
        load_function(target),
        args=list(arguments),
        prog=prog,
        # A function may take its options as one dataclass: its fields are then options without a prefix.
        config=(tyro.conf.OmitArgPrefixes,),
    )
    return result if isinstance(result, int) else 0


def _is_user_error(error: Exception) -> bool:
    if isinstance(error, RuntimeError):
        # Imported here: it loads MuJoCo, which a command that fails with it has loaded already.
        from anyskill_envs.rendering import RenderingError

        return isinstance(error, RenderingError)
    return isinstance(error, USER_ERRORS)


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs one command.

    Args:
        arguments: Words after `anyskill`; those of the process by default.

    Returns:
        The exit code: 0 when all went well, 2 for a mistake that the printed sentence says how to mend.
    """
    parser = argparse.ArgumentParser(
        prog="anyskill",
        description="Physically simulated humanoids that learn skills from text.",
        epilog=_usage(),
        formatter_class=argparse.RawDescriptionHelpFormatter,
        usage="anyskill COMMAND ...",
    )
    parser.add_argument("command", choices=COMMANDS, metavar="COMMAND", help="one of those below")
    words = list(sys.argv[1:] if arguments is None else arguments)
    if not words:
        parser.print_help()
        return 2
    name = parser.parse_args(words[:1]).command
    command, rest, prog = COMMANDS[name], words[1:], f"anyskill {name}"
    target = command.target
    if rest[:1] and rest[0] in command.subcommands:
        target, rest, prog = command.subcommands[rest[0]], rest[1:], f"{prog} {rest[0]}"
    elif not target:
        nested = argparse.ArgumentParser(prog=prog, description=command.help, usage=f"{prog} COMMAND ...")
        nested.add_argument("command", choices=command.subcommands, help="its --help shows its options")
        choice = nested.parse_args(rest[:1]).command
        target, rest, prog = command.subcommands[choice], rest[1:], f"{prog} {choice}"
    try:
        return _run(target, prog, rest)
    except Exception as error:
        if os.environ.get("ANYSKILL_TRACEBACK") or not _is_user_error(error):
            raise
        print(f"{prog}: {error}\n(ANYSKILL_TRACEBACK=1 shows where)", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print(f"{prog}: stopped", file=sys.stderr)
        return 130


if __name__ == "__main__":
    sys.exit(main())
