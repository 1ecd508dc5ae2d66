"""The library draws rare kinds of motion as often as common ones, and joins its clips into arrays."""

import logging
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from motion_data.authored import authored_clips
from motion_data.clip import MotionClip
from motion_data.joining import join
from motion_data.library import MotionLibrary, _mocap_clips
from motion_data.retrieval import DEFAULT_SELECTION, select_clips
from motion_data.skeleton import joint_limits, kinematics, rest_qpos


def clip(name, categories, frames=5):
    return MotionClip(name, np.tile(rest_qpos(), (frames, 1)), categories=categories)


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    return MotionLibrary.default(imported=tmp_path_factory.mktemp("none"))


def test_weights_are_inverse_category_frequencies():
    library = MotionLibrary(
        [clip("a", ("usual",)), clip("b", ("usual",)), clip("c", ("dance",)), clip("d", ("usual", "dance"))]
    )
    # usual has 3 clips, dance 2: 1/3, 1/3, 1/2 and their mean 5/12.
    expected = np.array([4, 4, 6, 5]) / 19
    np.testing.assert_allclose(library.weights, expected)
    drawn = Counter(library.sample(np.random.default_rng(0), 20000).tolist())
    np.testing.assert_allclose([drawn[index] / 20000 for index in range(4)], expected, atol=0.02)


def test_clips_are_joined_in_order():
    library = MotionLibrary([clip("a", ("usual",), 4), clip("b", ("usual",), 6)])
    assert library.starts.tolist() == [0, 4] and library.lengths.tolist() == [4, 6]
    assert library.qpos.shape == (10, 35) and library.qvel.shape == (10, 34)
    assert library.positions.shape == (10, 15, 3) and library.quaternions.shape == (10, 15, 4)
    assert library["b"].name == "b" and len(library) == 2


def test_mistakes_are_named():
    with pytest.raises(ValueError, match="at least one clip"):
        MotionLibrary([])
    with pytest.raises(ValueError, match="share a name: a"):
        MotionLibrary([clip("a", ("usual",)), clip("a", ("usual",))])
    with pytest.raises(ValueError, match="Unknown clip 'z'. The library has: a"):
        MotionLibrary([clip("a", ("usual",))])["z"]


def test_the_default_library_has_mocap_authored_and_mirrored_clips(library):
    assert {one.name for one in authored_clips()} <= set(library.names)
    assert {"walk", "backflip", "walk_mirrored", "salute_mirrored"} <= set(library.names)
    # What is symmetric, or has a twin by name, needs no mirror image.
    assert not {"squat_mirrored", "kick_left_mirrored", "stand_mirrored"} & set(library.names)
    assert library.weights.sum() == pytest.approx(1)
    assert np.isfinite(library.qvel).all()
    limits = joint_limits()
    assert (library.qpos[:, 7:] >= limits[:, 0] - 1e-6).all() and (library.qpos[:, 7:] <= limits[:, 1] + 1e-6).all()


def test_mocap_feet_are_on_the_floor(library):
    for name in ("walk", "punch", "crawl"):
        lowest = kinematics(library[name].qpos).lowest
        assert lowest.min() > -0.005 and np.median(lowest) < 0.03, name


def test_without_pybullet_it_warns_with_the_remedy(monkeypatch, tmp_path, caplog):
    _mocap_clips.cache_clear()
    monkeypatch.setattr("motion_data.deepmimic.importlib.util.find_spec", lambda name: None)
    with caplog.at_level(logging.WARNING):
        library = MotionLibrary.default(imported=tmp_path)
    assert "pip install" in caplog.text and "walk" not in library.names and "squat" in library.names


def test_imported_clips_join(tmp_path):
    clip("mine", ("imported",)).save(tmp_path / "mine.npz")
    library = MotionLibrary.default(mirrored=False, imported=tmp_path)
    assert "mine" in library.names
    # The only clip of its category: far more likely than one of many.
    assert library.weights[library.names.index("mine")] > 5 * library.weights[library.names.index("bow")]


def test_retrieval_walks_and_runs_and_neither_crawls_nor_turns_cartwheels(library):
    names = {clip.name for clip in select_clips(library, DEFAULT_SELECTION)}
    assert {"walk", "run", "jog", "walk_backward", "sidestep_left", "walk_in_a_curve_right", "stop_walking"} <= names
    assert {"turn_on_the_spot_left", "turn_on_the_spot_right"} <= names
    assert not {"cartwheel", "cartwheel_mirrored", "roll", "crawl"} & names


def test_a_joined_clip_goes_on_where_the_first_ends() -> None:
    clips = {clip.name: clip for clip in authored_clips()}
    turn, bow = clips["turn_left"], clips["bow"]
    joined = join(turn, bow, "turn_and_bow", ["turn and bow"], blend=10)
    assert len(joined) == len(turn) + 10 + len(bow) and joined.licence == "MIT"
    np.testing.assert_allclose(joined.qpos[: len(turn)], turn.qpos)
    # Neither a jump in place nor in direction: the bow begins facing where the turn ended.
    steps = np.abs(np.diff(joined.qpos[len(turn) - 1 : len(turn) + 11], axis=0))
    assert steps.max() < 0.05
    with pytest.raises(ValueError, match="frames per second"):
        join(turn, replace(bow, fps=60), "mixed", [])
