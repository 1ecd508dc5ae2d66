"""Writing files so that an interruption never leaves half of one."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any


def write_whole(path: Path, write: Callable[[Path], Any]) -> None:
    """Writes a file under a temporary name and renames it; the folder is made if there is none.

    Args:
        path: Where the file shall be.
        write: Writes it to the path that it gets: in the same folder, with the same suffix, of this process alone.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.stem}.{os.getpid()}.partial{path.suffix}")
    try:
        write(temporary)
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)
