"""Draws how the bars of the bundled controller moved with the hours of training, from the history of its model card.

Run in a clone with its history: `python tools/controller_progress.py docs/controller_progress.png`.
"""

import re
import subprocess
import sys

from matplotlib.figure import Figure

CARD = "anyskill_envs/weights/MODEL_CARD.md"
BARS = (
    "survival, mean over clips without acrobatics",
    "falls in 10 s, random latents of clips on the feet at 6 Hz",
    "falls after a push, standing or walking",
    "standing 6 s after lying, front or back",
    "foot skate over that of the reference",
    "jerk over that of the reference",
)


def git(*words: str) -> str:
    """What a git command prints."""
    return subprocess.run(["git", *words], check=True, capture_output=True, text=True).stdout


def history() -> dict[str, str]:
    """The last card of each version that has a table of bars, by version, oldest first."""
    cards: dict[str, str] = {}
    for commit in reversed(git("log", "--format=%h", "--", CARD).split()):
        card = git("show", f"{commit}:{CARD}")
        version = re.search(r"controller (\d+\.\d+)", card)
        if version and all(bar in card for bar in BARS):
            cards[version[1]] = card
    return cards


def main(path: str) -> None:
    """Prints the table and draws it."""
    cards = history()
    hours = []
    for card in cards.values():
        found = re.search(r"([\d.]+) hours", card)
        assert found, "the card does not say how long training took"
        hours.append(float(found[1]))
    figure = Figure(figsize=(12, 5.5), layout="constrained")
    for axes, bar in zip(figure.subplots(2, 3).flat, BARS, strict=True):
        rows = [
            re.search(rf"\| {re.escape(bar)} \| ([\d.]+)\S* .*?\| at (\w+) ([\d.]+)", card) for card in cards.values()
        ]
        values = [float(row[1]) for row in rows if row]
        limit = next(float(row[3]) for row in rows if row)
        axes.plot(hours, values, "o-")
        axes.axhline(limit, color="tab:red", linestyle="--", linewidth=1)
        axes.set(title=bar, xlabel="hours of training")
        axes.margins(0.15)
        axes.title.set_fontsize(9)
        axes.grid(alpha=0.3)
        for hour, value, version in zip(hours, values, cards, strict=True):
            axes.annotate(version, (hour, value), textcoords="offset points", xytext=(3, 5), fontsize=8)
        print(bar, dict(zip(cards, values, strict=True)), "bar", limit)
    figure.savefig(path, dpi=80)


if __name__ == "__main__":
    main(*sys.argv[1:])
