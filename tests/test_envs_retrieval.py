"""RetrievalLocomotion-v0: what steering, retrieval and rewards do; the general conventions are tested for all ids."""

import gymnasium as gym
import numpy as np
import pytest
from envs_common import LYING, arguments, assert_same, walk_clip

from anyskill_envs.goals import VelocityGoals, goal_distance
from anyskill_envs.retrieval_observation import RETRIEVAL_LAYOUT
from motion_data.retrieval import MotionDatabase
from motion_data.skeleton import heading, rest_qpos

ID = "RetrievalLocomotion-v0"


@pytest.fixture(scope="module")
def databases():
    straight = [walk_clip(f"straight_{speed}", speed, 0.0) for speed in (0.5, 2.0)]
    turning = [walk_clip(f"turn_{turn}", 1.0, turn) for turn in (-1.5, 1.5)]
    return {"straight": MotionDatabase.from_clips(straight), "turning": MotionDatabase.from_clips(turning)}


@pytest.fixture
def make(controller_file, databases):
    def build(num_envs=4, **kwargs):
        options = arguments(ID, controller_file) | {"databases": databases, "reset_noise_scale": 0.0} | kwargs
        return gym.make_vec(ID, num_envs=num_envs, **options)

    return build


def still(envs):
    return np.zeros(envs.action_space.shape, np.float32)


def test_the_goal_decides_what_is_retrieved(make):
    envs = make(goal_seconds=None)
    on_the_way = {"qpos": rest_qpos(), "qvel": [1.2, *np.zeros(33)]}
    envs.reset(seed=0, options={"initial_state": on_the_way})
    base = envs.unwrapped
    base.use_database("turning", [2, 3])
    for index, (speed, direction) in enumerate([(0.5, 0), (2.0, 0), (1.0, 1.5), (1.0, -1.5)]):
        base.set_goal(speed, direction, [index])
    info = envs.step(still(envs))[4]
    assert info["clip"].tolist() == ["straight_0.5", "straight_2.0", "turn_1.5", "turn_-1.5"]
    assert info["database"].tolist() == ["straight", "straight", "turning", "turning"]
    assert info["retrieved"].all()
    np.testing.assert_allclose(info["goal_velocity"][1], [2, 0], atol=1e-12)
    np.testing.assert_allclose(info["reward_clip"][:2], 0.2, atol=0.02)  # the clip's own velocity is the goal's


def test_weights_change_what_is_retrieved(make):
    envs = make(goal_seconds=None, goal_speed=(2.0, 2.0))
    frames = []
    for action in (0.0, -1.0):
        envs.reset(seed=1)
        envs.step(np.full(envs.action_space.shape, action, np.float32))
        frames.append(envs.unwrapped.clips.frames.copy())
    assert (frames[0] != frames[1]).any()


def test_stitch_or_step(make):
    """A clip begins where the humanoid is; it is stepped along until the period is over, or the clip."""
    envs = make(query_period=2, goal_seconds=None)
    envs.reset(seed=0)
    clips, simulation = envs.unwrapped.clips, envs.unwrapped.simulation
    np.testing.assert_allclose(clips.places, simulation.qpos[:, :2])
    np.testing.assert_allclose(clips.headings, heading(simulation.qpos[:, 3:7]), atol=1e-12)
    np.testing.assert_allclose(heading(clips.pose(0)[3:7]), clips.headings[0], atol=1e-6)
    history = [envs.step(still(envs))[4] for _ in range(6)]
    assert [info["retrieved"][0] for info in history] == [True, False] * 3
    np.testing.assert_allclose([info["clip_seconds"][0] for info in history], [1 / 6, 1 / 3] * 3)
    forced = make(query_period=10)
    forced.reset(seed=0)
    flags = [forced.step(still(forced))[4]["retrieved"][0] for _ in range(7)]
    assert flags == [True, False, False, True, False, False, True]


def test_databases_are_switched_and_added_while_running(make):
    envs = make(query_period=3)
    envs.reset(seed=0)
    envs.step(still(envs))
    base = envs.unwrapped
    base.add_database("new", MotionDatabase.from_clips([walk_clip("brand_new", 1.2)]))
    base.use_database("new", [1])
    info = envs.step(still(envs))[4]
    assert info["database"].tolist() == ["straight", "new", "straight", "straight"]
    assert info["clip"][1] == "brand_new"
    # switching takes effect at once, not only when the period is over
    assert info["retrieved"].tolist() == [False, True, False, False]


def test_a_database_for_each_episode(make):
    envs = make(num_envs=32, database="random")
    envs.reset(seed=0)
    assert set(envs.unwrapped.clips.choice.tolist()) == {0, 1}
    envs.reset(options={"database": "turning", "goal": (1.5, np.pi / 2)})
    assert set(envs.unwrapped.clips.choice.tolist()) == {1}
    np.testing.assert_allclose(envs.unwrapped.goals.velocity, np.tile([0, 1.5], (32, 1)), atol=1e-12)


def test_observation_shows_goal_and_clip_in_the_heading_frame(make):
    envs = make(num_envs=1)
    observation, _ = envs.reset(seed=0, options={"goal": (2.0, np.pi / 2)})
    (row,) = observation
    np.testing.assert_allclose(row[RETRIEVAL_LAYOUT["goal_direction"]], [0, 1], atol=1e-6)
    np.testing.assert_allclose(row[RETRIEVAL_LAYOUT["goal_speed"]], 2, atol=1e-6)
    np.testing.assert_allclose(row[RETRIEVAL_LAYOUT["clip_heading"]], [1, 0], atol=1e-6)
    assert row[RETRIEVAL_LAYOUT["clip_state"]][0] == pytest.approx(envs.unwrapped.clips.states[0, 0])


def test_goals_change_in_time_and_stay_in_range():
    rng = np.random.default_rng(0)
    goals = VelocityGoals(200, (0.5, 3.0), (4.0, 7.0))
    goals.draw(np.arange(200), rng)
    changes = []
    for _ in range(6 * 60):
        before = goals.velocity.copy()
        goals.advance(np.full(200, 5), rng)
        changes.append((goals.velocity != before).any(1))
        speed = np.linalg.norm(goals.velocity, axis=1)
        assert (speed >= 0.5).all() and (speed <= 3).all()
    times = [np.diff(np.flatnonzero(row)) / 6 for row in np.array(changes).T]
    times = np.concatenate(times)
    assert times.min() >= 4 - 1 / 6 and times.max() <= 7 + 1 / 6
    assert np.ptp(np.arctan2(goals.velocity[:, 1], goals.velocity[:, 0])) > 6


def test_goal_distance():
    goal = np.array([[1.0, 0], [1, 0], [1, 0], [0, 0], [0, 0]])
    velocity = np.array([[1.0, 0], [-1, 0], [0, 0], [0, 0], [0, 2]])
    np.testing.assert_allclose(goal_distance(velocity, goal), [0, 2, 2, 0, 2])


def test_results_do_not_depend_on_the_batch_and_are_repeatable(make):
    """Humanoid 0 of a batch does what it does alone, if goal and start are the same."""
    rollouts = []
    for count in (1, 3, 3):
        envs = make(num_envs=count, goal_seconds=None)
        envs.reset(seed=0, options={"goal": (1.0, 0.5)})
        rollouts.append([envs.step(np.full(envs.action_space.shape, 0.3, np.float32)) for _ in range(4)])
    assert_same(rollouts[1], rollouts[2])
    for alone, batch in zip(rollouts[0], rollouts[1], strict=True):
        np.testing.assert_allclose(batch[0][0], alone[0][0], atol=1e-4)


def test_ended_episodes_start_anew_with_a_new_goal(make):
    envs = make(num_envs=2, autoreset_mode="SameStep")
    envs.reset(seed=0, options={"initial_state": {"qpos": LYING}})
    goals = envs.unwrapped.goals.velocity.copy()
    observation, _, terminated, _, info = envs.step(still(envs))
    assert terminated.all()
    assert (envs.unwrapped.goals.velocity != goals).all()
    assert (envs.unwrapped.clips.age == 0).all()
    assert set(info["final_info"]["clip"]) <= {"straight_0.5", "straight_2.0"}
    assert np.isfinite(observation).all()


@pytest.mark.parametrize(
    ("kwargs", "message"),
    [
        ({"databases": {}}, "at least one motion database"),
        ({"databases": {"x": "no_such_thing.npz"}}, "No motion database"),
        ({"database": "zombie"}, "Unknown motion database 'zombie'"),
        ({"query_period": 0}, "query_period"),
        ({"weighting": "keys"}, "weighting"),
        ({"goal_speed": (2, 1)}, "goal_speed"),
        ({"goal_speed": 2.0}, "goal_speed must be two"),
        ({"goal_speed": (0.5, np.nan)}, "goal_speed"),
        ({"goal_seconds": (0, 1)}, "goal_seconds"),
        ({"goal_weight": -1}, "goal_weight"),
    ],
)
def test_bad_arguments_are_named(make, kwargs, message):
    with pytest.raises(ValueError, match=message):
        make(**kwargs)


def test_bad_goals_and_names_are_refused_while_running(make):
    envs = make()
    envs.reset(seed=0)
    for goal in ((np.nan, 0.0), (1.0, np.inf), (-1.0, 0.0), (100.0, 0.0)):
        with pytest.raises(ValueError, match="A goal is a speed"):
            envs.unwrapped.set_goal(*goal)
    with pytest.raises(ValueError, match="Unknown motion database"):
        envs.unwrapped.use_database("zombie")
    with pytest.raises(ValueError, match="Unknown motion database"):
        envs.reset(options={"database": "zombie"})
    with pytest.raises(ValueError, match="NaN"):
        envs.step(np.full(envs.action_space.shape, np.nan))
