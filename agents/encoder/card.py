"""The model card of an encoder: its text, and figures that are replaced when they are measured again."""

from __future__ import annotations

from pathlib import Path

from agents.encoder.config import EncoderConfig
from agents.encoder.evaluation import EncoderReport
from agents.encoder.export import VERSION
from agents.encoder.sanity import SanityRow

TEMPLATE = Path(__file__).parent / "model_card_template.md"
BEGIN, END = "<!-- figures: written by `anyskill encoder evaluate` -->", "<!-- end of figures -->"


def figures_text(report: EncoderReport) -> str:
    """The part of a card that is measured, between its marks."""
    motions, drawn = report.motions
    parts = [BEGIN, "", f"{motions} held-out motions, {drawn} of them drawn.", "", report.table, ""]
    if report.sanity:
        parts += [
            "Mean score of the better half of each clip's frames (state projection), against the best clip that does something",
            "else, the same skill on the wrong side, idling, and bodies that lie where they fell:",
            "",
            "| text | matching clips | best other clip | wrong side | idle | fallen |",
            "|---|---|---|---|---|---|",
            *map(_sanity_line, report.sanity),
            "",
        ]
    return "\n".join([*parts, END])


def _sanity_line(row: SanityRow) -> str:
    line = (
        f"| {row.text} | {row.matching:.2f} | {row.best_other[0]:.2f} ({row.best_other[1]}) | {row.mirrored:.2f} | "
        f"{row.idle:.2f} | {row.fallen:.2f} |"
    )
    return line.replace("nan", "-")


def update_figures(path: Path, report: EncoderReport, encoder: str) -> None:
    """Replaces the figures of a card.

    Args:
        path: the card; a short one is written if there is none.
        report: the figures.
        encoder: name of the encoder, for a new card.

    Raises:
        ValueError: there is a file without the marks between which figures stand.
    """
    if not path.is_file():
        path.write_text(f"# {encoder}\n\n{figures_text(report)}\n", encoding="utf-8")
        return
    text = path.read_text(encoding="utf-8")
    before, begin, rest = text.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise ValueError(f"'{path}' has no lines '{BEGIN}' and '{END}' between which its figures could stand.")
    path.write_text(before + figures_text(report) + after, encoding="utf-8")


_LESSONS = """- **Low-level facts**: some five hundred posecodes (`agents/encoder/posecodes`), after PoseScript (Delmas et al.,
  ECCV 2022): bends of joints, where limbs point, heights and places of hands, elbows, knees and feet, trunk and head, what
  touches the floor, simple velocities. Beside phrases that are put together of parts there are some 100 for each that were
  written one by one (`agents/encoder/posecodes/wordings.yaml`, by helpers who knew the rules of the posecodes, but not the
  captions and sentences below). {} motions are described by one to four facts that are true of them, rare ones more often, in
  many registers; each a second time in other words and once with one fact exchanged for another side, direction or limb.
  Further captions are composed of phrases in each step, with a second wording and a wrong one, too. A caption is to find its
  motion in the batch (cross-entropy), to agree with its paraphrase, and to be nearer to its motion than the wrong one.
"""


def write_card(path: Path, config: EncoderConfig, report: EncoderReport) -> None:
    """Writes the card of a trained encoder.

    Args:
        path: the card.
        config: settings of the training.
        report: its figures.
    """
    text = TEMPLATE.read_text(encoding="utf-8")
    known = ", ".join(config.objects) if config.objects else "none"
    values = {
        "title": f"{'Evaluator' if config.evaluator else 'Bundled'} encoder, version {VERSION}",
        "purpose": (
            "It judges what policies learn (`anyskill ablate`) and is never a reward"
            if config.evaluator
            else 'It rewards policies that learn from text (`rewards.make_reward("clip")`)'
        ),
        "command": "anyskill encoder train --evaluator" if config.evaluator else "anyskill encoder train",
        "cameras": (
            f"cameras within {57.3 * config.cameras.angle:.0f} degrees of the front, {config.cameras.distance[0]} to "
            f"{config.cameras.distance[1]} m away"
        ),
        "objects": known,
        "hidden": str(config.symmetric_hidden),
        "seed": str(config.seed),
        "steps": str(config.steps),
        "feature_size": str(config.feature_size),
        "image_motions": str(config.image_motions),
        "image_size": str(config.image_size),
        "lessons": _LESSONS.format(config.lessons) if config.lessons else "",
        "figures": figures_text(report),
    }
    for name, value in values.items():
        text = text.replace("{{" + name + "}}", value)
    path.write_text(text, encoding="utf-8")
