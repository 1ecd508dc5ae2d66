"""`anyskill encoder evaluate`: measures an encoder, and writes the figures into its card."""

from __future__ import annotations

from pathlib import Path

from agents.encoder.card import update_figures
from agents.encoder.config import captions_of
from agents.encoder.evaluation import evaluate
from agents.encoder.material import motion_library, prepare_captions
from rewards.encoders import load_encoder


def evaluate_command(
    encoder: str = "bundled", json: bool = False, card: Path | None = None, pictures: int = 400
) -> int:
    """Measure all that the card of an encoder shows, on motions, captions and sentences that no training uses.

    Text to pose among 100 distinct poses, by captions of other rules and by a hundred freely written sentences; left or
    right, up or down, which limb; paraphrases; how near the state projection is to the image tower, and how much faster.

    Args:
        encoder: Name of an encoder or its folder, as for `anyskill train --encoder`.
        json: Print JSON instead of a table.
        card: Markdown file whose figures are replaced; written anew if there is none.
        pictures: How many films are drawn for the image tower.
    """
    made = load_encoder(encoder)
    settings = getattr(made, "metadata", {}).get("training", "{}")
    captions = prepare_captions(captions_of(settings), motion_library())
    report = evaluate(made, captions, pictures)
    print(report.json if json else report.table)
    if card is not None:
        update_figures(card, report, encoder)
    return 0
