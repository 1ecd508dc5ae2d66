"""What sentences mean: each concept has phrases and a rule that says how far a short motion fulfils it, from 0 to 1.

The rules grade: a hand half-way up is worth more than a hanging one, because these grades become the reward a policy
climbs. They also say no: a fallen body, the other limb, or standing still where the text says moving score low.

"{side}" and "{other}" in a phrase stand for left and right; a concept with them exists for both sides.
"""

# Each of these fills the table. Their order is that of the concepts, on which the draws of captions depend.
# isort: off
from agents.encoder.concepts import arms, trunk, legs, travel, whole  # noqa: F401

# isort: on
from agents.encoder.concepts.base import CONCEPTS, Concept

__all__ = ["CONCEPTS", "Concept"]
