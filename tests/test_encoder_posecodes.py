"""Low-level facts about poses, and the captions that are composed of them."""

import unittest.mock
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import nn

from agents.encoder.networks import StateTower, TextHead
from agents.encoder.posecodes import POSECODES
from agents.encoder.posecodes.grading import CODES, CodeChooser, grade, opposites, partners
from agents.encoder.posecodes.lessons import write_lessons, write_phrases
from agents.encoder.posecodes.wordings import FurtherWordings, check_stems, further_wordings
from agents.encoder.posecodes.writing import describe
from agents.encoder.token_states import TokenStore
from agents.encoder.towers import caption_features, widened
from motion_data.clip import swap_sides
from motion_data.skeleton import joint_index, joint_limits, mirror_qpos, rest_qpos
from rewards.minilm import load_minilm

FRAMES = (2, 14)


def _films(count: int, seed: int = 0) -> np.ndarray:
    """Random poses that rise, sink and turn within half a second, `(count, 2, 35)`."""
    rng = np.random.default_rng(seed)
    films = np.repeat(np.repeat(rest_qpos()[None, None], count, 0), 2, 1)
    low, high = joint_limits().T
    films[:, :, 7:] = rng.uniform(0.6 * low, 0.6 * high, (count, 2, len(low)))
    films[:, :, :3] += rng.normal(0, 0.1, (count, 2, 3))
    return films


def _column(name: str) -> int:
    return list(POSECODES).index(name)


def test_mirrored_pose_swaps_sides() -> None:
    """What is true of the left in a pose is true of the right in its mirror image, and nothing else changes."""
    films = _films(24)
    mirrored = np.stack([mirror_qpos(film) for film in films])
    grades = grade(films, FRAMES).astype(float)
    assert np.abs(grades[:, partners()] - grade(mirrored, FRAMES)).max() < 0.01
    assert np.ptp(grades, axis=0).mean() > 0.3, "these poses differ in most facts"


def test_grade_follows_the_angle() -> None:
    """The more an elbow is bent, the less it is straight and the more it is fully bent; the other elbow has no say."""
    films = np.repeat(np.repeat(rest_qpos()[None, None], 6, 0), 2, 1)
    low, high = joint_limits()[joint_index("right_elbow")]
    furthest = high if abs(high) > abs(low) else low
    films[:, :, 7 + joint_index("right_elbow")] = np.linspace(0, furthest, 6)[:, None]
    grades = grade(films, FRAMES).astype(float)
    straight, full = grades[:, _column("elbow_straight.right")], grades[:, _column("elbow_full.right")]
    assert (np.diff(straight) <= 0).all() and straight[0] == 1 and straight[-1] == 0
    assert (np.diff(full) >= 0).all() and full[0] == 0 and full[-1] > 0.8
    assert np.ptp(grades[:, _column("elbow_straight.left")]) == 0
    assert (grades[:, _column("elbow_straight.both")] <= straight).all()


def test_captions_depend_on_the_seed_alone() -> None:
    """Equal seeds write equal captions; the mirrored facts are said in the mirrored words."""
    mirror = partners()
    texts = set()
    for seed in range(60):
        facts = np.random.default_rng(seed).choice(len(CODES), 3, replace=False)
        text = describe([CODES[fact] for fact in facts], np.random.default_rng(seed))
        assert text == describe([CODES[fact] for fact in facts], np.random.default_rng(seed))
        mirrored = describe([CODES[fact] for fact in mirror[facts]], np.random.default_rng(seed))
        assert swap_sides(text) == mirrored
        texts.add(text)
    assert len(texts) == 60


def test_lessons_tell_what_is_true_and_what_is_not() -> None:
    """All facts of a lesson are true of its motion, and of the wrong ones exactly one is false."""
    films = _films(40, seed=3)
    grades = grade(films, FRAMES)
    rng = np.random.default_rng(0)
    rows, turned = np.arange(40), np.arange(40) % 2 == 0
    chooser = CodeChooser(grades, rng)
    lessons = write_lessons(chooser, rows, turned, rng)
    assert len(lessons) > 35
    different = [lesson for lesson in lessons if lesson.facts != lesson.wrong_facts]
    assert len(different) > 25
    for lesson in lessons:
        of_motion = chooser.of(np.array([lesson.row]), np.array([lesson.turned]))[0]
        assert of_motion[list(lesson.facts)].min() > 0.7
        wrong = set(lesson.wrong_facts) - set(lesson.facts)
        assert len(wrong) == (lesson in different)
        assert all(of_motion[fact] <= 0.3 for fact in wrong)


def test_every_posecode_has_many_wordings() -> None:
    """At least eight phrases for nearly every fact, each naming the side of a sided one; none is its own opposite."""
    phrases = write_phrases(np.random.default_rng(0), 60)
    assert np.mean([len(said) >= 8 for said in phrases]) > 0.97
    for code, said in zip(CODES, phrases, strict=True):
        if code.name.endswith((".left", ".right")):
            assert all("left" in text or "right" in text for text in said), code.name
    assert all(index not in others for index, others in enumerate(opposites()))


def test_phrases_of_a_mirror_image_are_the_same_but_for_the_sides() -> None:
    """So a composed caption and its wrong twin can differ in the side alone."""
    phrases = write_phrases(np.random.default_rng(0), 20)
    for index, other in enumerate(partners()):
        if index == other:
            continue
        assert [swap_sides(text) for text in phrases[index]] == phrases[other]


def test_further_wordings_become_parts_of_their_posecode() -> None:
    """Sides are filled in; those about both limbs are sorted by what they are."""
    code = POSECODES["elbow_straight.left"]
    written = further_wordings(code.name)
    assert len(written.nominals) >= 12 and set(written.nominals) <= set(code.nominals)
    assert all("left" in text or "right" in text for text in written.nominals + written.clauses + written.imperatives)
    both = further_wordings("elbow_straight.both")
    assert all(" is " in f" {text} " or " are " in text or " has " in text or " have " in text for text in both.clauses)
    assert further_wordings("elbow_straight.one") == FurtherWordings()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("elbow_straight:\n  nouns: an arm\n", "nouns"),
        ("elbow_straight:\n  nominals: the {side} arm\n  clauses: it is straight\n", "names no side"),
        ("elbow_of_a_fish:\n  nominals: the {side} fin\n", "there is no posecode elbow_of_a_fish"),
    ],
)
def test_a_wrong_file_of_wordings_is_refused(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "wordings.yaml"
    path.write_text(text)
    with pytest.raises(ValueError, match=message):
        further_wordings("elbow_straight.left", path)
        check_stems({code.stem for code in CODES}, path)


def test_wider_towers_begin_with_what_narrower_ones_compute() -> None:
    """A training can go on with wider hidden layers: at first nothing changes."""
    zeros, ones = np.zeros(30, np.float32), np.ones(30, np.float32)
    narrow, wide = StateTower(zeros, ones, 16, 24), StateTower(zeros, ones, 16, 40)
    states = torch.randn(9, 30, generator=torch.Generator().manual_seed(0))
    earlier = {f"state.{name}": value for name, value in narrow.state_dict().items()}
    modules = nn.ModuleDict({"state": wide})
    modules.load_state_dict(widened(earlier, modules))
    assert torch.allclose(narrow(states), wide(states), atol=1e-6)


def test_token_states_of_texts_of_different_lengths(tmp_path: Path) -> None:
    """A store gives the states of the sentence model, padded, also when it is read back."""
    texts = ["bend the left elbow", "the right foot is off the floor", "hands together"]
    store = TokenStore(texts, tmp_path / "tokens.npz")
    states, mask = store.batch([texts[0], texts[2]])
    expected = [load_minilm().token_states([text])[0][0] for text in texts]
    first, third = len(expected[0]), len(expected[2])
    assert mask.sum(1).tolist() == [first, third] == [store.length(texts[0]), store.length(texts[2])]
    assert states[0, :first] == pytest.approx(expected[0], abs=0.01)
    assert states[1, :third] == pytest.approx(expected[2], abs=0.01)
    again = TokenStore(texts, tmp_path / "tokens.npz")
    assert np.array_equal(again.batch([texts[1]])[0], store.batch([texts[1]])[0])


def test_a_caption_is_the_sum_of_its_clauses(tmp_path: Path) -> None:
    """In any order, whatever else is in the batch, and however long the clauses are."""
    clauses = ["bend the left elbow", "the right foot is off the floor", "hands together"]
    store = TokenStore(clauses, tmp_path / "tokens.npz")
    head = TextHead(16).eval()
    captions = [[clauses[0], clauses[1]], [clauses[2]], [clauses[1], clauses[0]], [clauses[0]], [clauses[1]]]
    one = {text: head(*map(torch.from_numpy, store.batch([text]))) for text in clauses}
    with unittest.mock.patch("agents.encoder.towers._without_some", lambda mask, rng: mask):
        features = caption_features(head, store, captions, np.random.default_rng(0))
    expected = nn.functional.normalize(one[clauses[0]] + one[clauses[1]], dim=-1)
    assert torch.allclose(features[[0]], expected, atol=1e-5) and torch.allclose(features[0], features[2], atol=1e-5)
    assert torch.allclose(features[[1]], one[clauses[2]], atol=1e-5)
