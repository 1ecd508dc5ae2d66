"""Files with one JSON object a line, and a stage that goes through one of them and can be stopped at any time."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

Record = dict[str, Any]
"""One line: `text`, and whatever else it had or a stage found out. `dropped` says why later stages pass it by."""


def read_records(path: Path) -> list[Record]:
    """Reads a file with one JSON object a line, each with a `text`; empty lines are passed over.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: A line is no JSON object with a text; the message has its number.
    """
    if not path.is_file():
        raise FileNotFoundError(f'There is no file \'{path}\'. Give one with a JSON object a line: {{"text": "wave"}}.')
    records = []
    # Not splitlines: a text may hold a line separator of Unicode, which is no end of a line here.
    for number, line in enumerate(path.read_text(encoding="utf-8").split("\n"), 1):
        if line.strip():
            records.append(_parse(line, f"Line {number} of '{path}'"))
    return records


def _parse(line: str, place: str) -> Record:
    try:
        record = json.loads(line)
    except json.JSONDecodeError as error:
        raise ValueError(f"{place} is no JSON ({error.msg}, column {error.colno}): {line.strip()[:60]}") from error
    if not isinstance(record, dict) or not isinstance(record.get("text"), str):
        raise ValueError(f'{place} must be a JSON object with a "text", such as {{"text": "wave the right hand"}}.')
    return record


def run_stage(
    source: Path,
    output: Path,
    settings: Record,
    stage: Callable[[list[Record]], Callable[[Record], Record]],
    progress: Callable[[Iterable[Record], int, int], Iterable[Record]] = lambda records, done, total: records,
) -> list[Record]:
    """Sends every record through a stage, and writes each as soon as it is done.

    The output has a line for every record of the source, in the same order, so a stage that was stopped goes on behind the
    last whole line. Dropped records are copied as they are.

    Args:
        source: File to read.
        output: File to write or to go on with.
        settings: What the result depends on beside the source; kept in a file beside the output.
        stage: Gets the records that are done already, and returns what turns a record into its result.
        progress: Wraps the records that are left, given how many are done and how many there are.

    Returns:
        All records of the output.

    Raises:
        FileNotFoundError: There is no source.
        ValueError: A line cannot be read, or the output was made from another source or with other settings.
    """
    if output.resolve() == source.resolve():
        raise ValueError(f"'{output}' is both source and output; choose another output.")
    records = read_records(source)
    done = _finished(output)
    _check(records, done, source, output, settings)
    apply = stage(done)
    output.parent.mkdir(parents=True, exist_ok=True)
    with output.open("a", encoding="utf-8") as file:
        for record in progress(records[len(done) :], len(done), len(records)):
            result = dict(record) if "dropped" in record else apply(dict(record))
            result.setdefault("source", record["text"])
            done.append(result)
            file.write(json.dumps(result, ensure_ascii=False) + "\n")
            file.flush()
    return done


def _finished(output: Path) -> list[Record]:
    """Records of an output; half a line at its end, which an interruption leaves, is cut off."""
    if not output.is_file():
        return []
    content = output.read_bytes()
    whole = content.rfind(b"\n") + 1
    if whole < len(content):
        os.truncate(output, whole)
    return read_records(output)


def _check(records: list[Record], done: list[Record], source: Path, output: Path, settings: Record) -> None:
    """Raises ValueError if the output is not the beginning of this stage's result."""
    beside = output.with_name(output.name + ".settings.json")
    another = f"'{output}' was made from another source than '{source}', or it has changed; choose another output."
    if len(done) > len(records):
        raise ValueError(another)
    for record, result in zip(records, done, strict=False):
        if result.get("source") != record.get("source", record["text"]):
            raise ValueError(another)
    if done and beside.is_file() and json.loads(beside.read_text(encoding="utf-8")) != settings:
        raise ValueError(f"'{output}' was begun with other options; choose another output, or delete it.")
    beside.parent.mkdir(parents=True, exist_ok=True)
    beside.write_text(json.dumps(settings, indent=2) + "\n", encoding="utf-8")


def kept(records: Iterable[Record]) -> Iterator[Record]:
    """The records that no stage dropped."""
    return (record for record in records if "dropped" not in record)
