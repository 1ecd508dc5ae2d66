"""Texts are read clause by clause."""

import numpy as np
import pytest

from rewards.bundled import READS_CLAUSES, BundledEncoder
from rewards.clauses import split_clauses


@pytest.mark.parametrize(
    ("text", "clauses"),
    [
        ("Raise both arms above the head!", ["raise both arms above the head"]),
        ("squat down, the arms up while looking left", ["squat down", "the arms up", "looking left"]),
        ("the left arm is bent. The right knee is straight.", ["the left arm is bent", "the right knee is straight"]),
        ("slowly, carefully walk forward", ["slowly carefully walk forward"]),
        ("stand up, now", ["stand up now"]),
        ("a person walks, and then sits down", ["a person walks", "then sits down"]),
        ("bend the left elbow and the right knee", ["bend the left elbow and the right knee"]),
        ("kick", ["kick"]),
    ],
)
def test_split_clauses(text, clauses):
    assert split_clauses(text) == clauses


def test_what_a_list_demands_is_the_sum_of_its_clauses():
    encoder = BundledEncoder(cache="")
    both, first, second = encoder.encode_text(["squat down, raise both arms", "squat down", "raise both arms"])
    if not encoder.reads_clauses:
        pytest.skip(f"the bundled text tower has no {READS_CLAUSES}")
    total = first + second
    np.testing.assert_allclose(both, total / np.linalg.norm(total), atol=1e-6)
