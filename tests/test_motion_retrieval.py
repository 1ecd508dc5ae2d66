"""Retrieval databases: keys, exact search, files, and what goes wrong with them."""

from dataclasses import replace

import numpy as np
import pytest
from envs_common import walk_clip

from motion_data.clip import MotionClip
from motion_data.library import MotionLibrary
from motion_data.nearest import NearestKeys
from motion_data.retrieval import MotionDatabase, MotionDatabases, find_database, select_clips
from motion_data.retrieval_keys import KEY_LAYOUT, KEY_SIZE, course_key, turned, wished_course
from motion_data.skeleton import rest_qpos


@pytest.fixture(scope="module")
def database():
    clips = [walk_clip(f"speed_{speed}", speed, turn) for speed, turn in ((0.5, 0), (1, 0.6), (2, -0.6))]
    return MotionDatabase.from_clips(clips)


def test_keys_say_where_a_clip_goes(database):
    assert database.keys.shape == (len(database), KEY_SIZE) == (3 * 75, KEY_SIZE)
    speeds, turns = np.repeat([0.5, 1, 2], 75), np.repeat([0, 0.6, -0.6], 75)
    mean_velocity = database.keys[:, KEY_LAYOUT["mean_velocity"]]
    np.testing.assert_allclose(mean_velocity[:, 0], speeds, atol=0.02)
    np.testing.assert_allclose(database.speeds, speeds, atol=0.02)
    np.testing.assert_allclose(database.keys[:, KEY_LAYOUT["turn"]][:, 0], turns / 2, atol=1e-4)
    displacement = np.linalg.norm(database.keys[:, KEY_LAYOUT["displacement"]], axis=1)
    np.testing.assert_allclose(displacement, speeds / 2, rtol=0.03)


def test_keys_do_not_depend_on_place_and_heading(database):
    clip = walk_clip("speed_1", 1, 0.6)
    qpos = clip.qpos.copy()
    qpos[:, :3] = turned(qpos[:, :3], np.full(len(qpos), 2.0)) + [3, -1, 0]
    w, z = qpos[:, 3].copy(), qpos[:, 6].copy()
    qpos[:, 3], qpos[:, 6] = np.cos(1) * w - np.sin(1) * z, np.cos(1) * z + np.sin(1) * w
    moved = MotionDatabase.from_clips([MotionClip("moved", qpos)])
    np.testing.assert_allclose(moved.keys, database.keys[75:150], atol=1e-4)


def test_a_query_finds_the_key_that_equals_it(database):
    """The same clip, or its like."""
    queries = database.keys.copy()
    found = database.search(queries)
    np.testing.assert_allclose(database.keys[found], queries, atol=1e-3)


def test_wished_course_reaches_the_goal():
    velocity, goal = np.array([[1.0, 0.0], [2.0, 0.0]]), np.array([[1.0, 0.0], [0.0, 2.0]])
    straight, turning = course_key(*wished_course(velocity, np.zeros(2), goal))
    np.testing.assert_allclose(straight, [1, 0, 0.5, 0, 0], atol=1e-9)
    assert turning[0] < 1.5 and turning[3] > 0.1 and 0.5 < turning[4] <= 1
    kept = course_key(*wished_course(velocity, np.zeros(2), goal, face_goal=False))
    assert kept[1, 4] == 0 and kept[1, 1] > 0.5


@pytest.mark.parametrize("metric", [False, True])
def test_search_is_exact(metric):
    """Against brute force in float64: no other key is nearer, with several cells."""
    rng = np.random.default_rng(0)
    keys = (rng.normal(size=(5000, 8)) @ rng.normal(size=(8, KEY_SIZE))).astype(np.float32)
    queries = rng.normal(scale=4, size=(20, KEY_SIZE))
    weights = rng.uniform(0, 2, queries.shape)
    search = NearestKeys(keys)
    assert len(search._keys) > 3
    for used in (weights, np.ones_like(weights)):
        scaled = queries if metric else used * queries
        found = search.query(scaled, used if metric else None)
        measure = used if metric else np.ones_like(used)
        differences = measure[:, None] * (keys.astype(np.float64) - scaled.astype(np.float32)[:, None])
        distances = np.linalg.norm(differences, axis=2)
        np.testing.assert_allclose(distances[np.arange(20), found], distances.min(1), rtol=1e-5)


def test_round_trip_without_pickle(database, tmp_path):
    file = database.save(tmp_path / "folder" / "database.npz")
    with np.load(file, allow_pickle=False) as archive:
        assert {"header", "keys", "qpos"} <= set(archive.files)
    loaded = MotionDatabase.load(file)
    assert loaded.names == database.names
    for name in ("qpos", "states", "lengths", "windows", "keys", "mean", "scale", "last"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(database, name))
    queries = database.keys[::7] + 0.1
    np.testing.assert_array_equal(loaded.search(queries), database.search(queries))
    assert list(tmp_path.rglob("*")) == [tmp_path / "folder", file]


def test_folder_and_loops(tmp_path):
    clip = walk_clip("loop", turn=0.0, frames=31)
    MotionClip("loop", clip.qpos, loop=True).save(tmp_path / "loop.npz")
    walk_clip("once", turn=0.0, frames=31).save(tmp_path / "once.npz")
    database = find_database(tmp_path)
    assert database.names == ("loop", "once")
    # each frame of a loop begins a clip; of the other motion only those with 0.5 s left do
    assert len(database) == 30 + 16
    assert (database.last[database.windows] >= database.windows + 15).all()


def test_several_databases_by_name(database):
    slow = MotionDatabase.from_clips([walk_clip("slow", 0.2, 0.0)])
    databases = MotionDatabases({"all": database, "slow": slow})
    choice = np.array([0, 1, 0, 1])
    queries = np.repeat(database.keys[[200, 20]], 2, 0)
    frames = databases.search(choice, queries)
    assert databases.motion_names(frames).tolist() == ["speed_2", "slow", "speed_0.5", "slow"]
    databases.add("more", walk_database("late"))
    frames = databases.search(np.array([0, 2]), queries[:2])
    assert databases.motion_names(frames).tolist() == ["speed_2", "late"]
    assert databases["slow"] is slow


def walk_database(name):
    return MotionDatabase.from_clips([walk_clip(name)])


def test_clips_are_selected_by_category_and_name():
    clips = [replace(walk_clip(name), categories=kinds) for name, kinds in CLIPS.items()]
    library = MotionLibrary(clips)
    for selection, names in (
        ("move_around", ["walk", "walk_fast", "cartwheel"]),
        ("walk*", ["walk", "walk_fast"]),
        ("move_around & usual", ["walk", "walk_fast"]),
        ("usual&*fast", ["walk_fast"]),
    ):
        assert [clip.name for clip in select_clips(library, selection)] == names
    with pytest.raises(ValueError, match="'fly' is no motion database.*jump, move_around, usual"):
        select_clips(library, "fly")


CLIPS = {
    "walk": ("move_around", "usual"),
    "walk_fast": ("move_around", "usual"),
    "cartwheel": ("move_around", "jump"),
}


def test_errors_name_the_fix(database, tmp_path):
    with pytest.raises(ValueError, match="empty"):
        MotionDatabase.from_clips([])
    with pytest.raises(ValueError, match="'short' has 12 frames .* at least 16"):
        MotionDatabase.from_clips([walk_clip("short", frames=12)])
    with pytest.raises(ValueError, match="at least one motion database"):
        MotionDatabases({})
    with pytest.raises(ValueError, match="Unknown motion database 'zombie'.*: all"):
        MotionDatabases({"all": database})["zombie"]
    with pytest.raises(ValueError, match="name that is not taken"):
        MotionDatabases({"all": database}).add("all", database)
    for bad in (np.nan, np.inf):
        queries = database.keys[:2].copy()
        queries[1, 3] = bad
        with pytest.raises(ValueError, match="NaN or infinity"):
            database.search(queries)
    with pytest.raises(ValueError, match="shape"):
        database.search(database.keys[0])
    with pytest.raises(ValueError, match="holds no motion file"):
        MotionDatabase.from_folder(tmp_path)
    with pytest.raises(ValueError, match="No motion database"):
        find_database(tmp_path / "nothing.npz")
    MotionClip("clip", np.tile(rest_qpos(), (20, 1))).save(tmp_path / "clip.npz")
    (tmp_path / "cut.npz").write_bytes(database.save(tmp_path / "whole.npz").read_bytes()[:5000])
    for name in ("clip.npz", "cut.npz"):
        with pytest.raises(ValueError, match="not a motion database"):
            MotionDatabase.load(tmp_path / name)
