"""The further wordings of the concepts: complete, sided, mirrored, and correct English in every template."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
import yaml

from agents.encoder.captions import variants, write_captions
from agents.encoder.concepts import CONCEPTS, Concept
from agents.encoder.config import EncoderConfig
from agents.encoder.material import all_concepts, motion_library
from agents.encoder.sampling import CaptionSampler
from agents.encoder.wordings import WORDINGS, with_further_wordings
from motion_data.clip import swap_sides

_SIDE = re.compile(r"\b(left|right)(ward|wards)?\b")


@pytest.fixture(scope="module")
def concepts() -> tuple[Concept, ...]:
    return all_concepts(motion_library(), EncoderConfig().objects)


def test_every_concept_has_further_wordings(concepts: tuple[Concept, ...]) -> None:
    few = {
        concept.name: len(concept.further)
        for concept in concepts
        if len(concept.further) < 3 and len(concept.phrases) < 20
    }
    assert not few
    assert min(len(concept.further) for concept in concepts if concept.name in CONCEPTS) >= 20
    names = {concept.name.removesuffix(".left").removesuffix(".right") for concept in concepts}
    assert set(yaml.safe_load(WORDINGS.read_text(encoding="utf-8"))) == names


def test_no_further_wording_is_a_wording_of_anything_else(concepts: tuple[Concept, ...]) -> None:
    further = Counter(phrase for concept in concepts for phrase in concept.further)
    own = {phrase for concept in concepts for phrase in concept.phrases}
    assert [phrase for phrase, count in further.items() if count > 1 or phrase in own] == []


def test_sides_are_named_and_mirrored(concepts: tuple[Concept, ...]) -> None:
    by_name = {concept.name: concept for concept in concepts}
    for name, concept in by_name.items():
        mirrored = tuple(swap_sides(phrase) for phrase in concept.further)
        assert by_name[swap_sides(name)].further == mirrored, name
        if name.endswith((".left", ".right")):
            assert all(_SIDE.search(phrase) for phrase in concept.further), name
        else:
            assert not any(_SIDE.search(phrase) for phrase in concept.further), name


@pytest.mark.parametrize(
    ("phrase", "caption"),
    [
        ("grab the top shelf with the two hands", "the humanoid grabs the top shelf with the two hands"),
        ("beg for mercy with folded hands", "a person begging for mercy with folded hands"),
        ("carry a baby on the left arm", "a robot carries a baby on the left arm"),
        ("tie your shoelace", "a person is tying their shoelace"),
        ("refuse and fold the arms", "a person refuses and folds the arms"),
        ("do not gesture", "a person is not gesturing"),
        ("as if held at gunpoint", "pose: as if held at gunpoint"),
        ("both knees on the ground", "a person with both knees on the ground"),
    ],
)
def test_templates_make_english(phrase: str, caption: str) -> None:
    assert caption in variants(phrase)


@pytest.mark.parametrize("phrase", ["the wrists are below the waist", "both shins lie on the floor", "like a frog"])
def test_sentences_and_comparisons_stay_as_they_are(phrase: str) -> None:
    assert variants(phrase) == [f"pose: {phrase}"]


def test_a_wrong_file_is_refused_in_one_sentence(tmp_path: Path) -> None:
    path = tmp_path / "wordings.yaml"
    path.write_text("arms_upp: |\n  surrender\n", encoding="utf-8")
    with pytest.raises(ValueError, match="there is no concept arms_upp"):
        with_further_wordings(tuple(CONCEPTS.values()), path)
    path.write_text("arm_up: |\n  hail a cab\n", encoding="utf-8")
    with pytest.raises(ValueError, match='"hail a cab" of arm_up names no side'):
        with_further_wordings(tuple(CONCEPTS.values()), path)


def test_concepts_are_drawn_equally_often_whatever_the_number_of_wordings(concepts: tuple[Concept, ...]) -> None:
    captions = write_captions(np.random.default_rng(0), concepts=concepts, pairs=0)
    assert len(captions.training) < 30_000
    sampler = CaptionSampler(captions, np.random.default_rng(1))
    drawn = Counter(captions.training[index].concepts[0] for index in sampler.draw(10 * len(concepts)))
    assert set(drawn.values()) == {10}
