"""Low-level facts about short motions, and captions composed of them; after PoseScript (Delmas et al., ECCV 2022)."""

# Each of these fills the table. Their order is that of the posecodes, on which the draws of captions depend.
# isort: off
from agents.encoder.posecodes import limbs, places, body, movements  # noqa: F401

# isort: on
from agents.encoder.posecodes.base import POSECODES, Posecode
from agents.encoder.posecodes.wordings import check_stems

check_stems({code.stem for code in POSECODES.values()})

__all__ = ["POSECODES", "Posecode"]
"""All posecodes by name, and their type."""
