"""Lines of the files of further wordings, in which "{side}" and "{other}" stand for left and right."""

from __future__ import annotations

_OTHER = {"left": "right", "right": "left"}


def sided_lines(text: str, side: str, owner: str, file: str) -> tuple[str, ...]:
    """The wordings of a block of text, one on each line.

    Args:
        text: the block.
        side: "left" or "right", which is filled in; "" for wordings without a side.
        owner: whose wordings they are.
        file: name of the file that holds them.

    Raises:
        ValueError: there is a side, and a wording names none.
    """
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    if not side:
        return tuple(lines)
    silent = [line for line in lines if "{side}" not in line and "{other}" not in line]
    if silent:
        raise ValueError(f'{file}: "{silent[0]}" of {owner} names no side; put {{side}} or {{other}} into it.')
    return tuple(line.format(side=side, other=_OTHER[side]) for line in lines)
