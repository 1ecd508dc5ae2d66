"""Every registered environment, single and batched, keeps the conventions of Gymnasium and Stable-Baselines3."""

import json
import pickle

import gymnasium as gym
import numpy as np
import pytest
from envs_common import IDS, LYING, arguments, assert_same, warnings_are_errors
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env
from gymnasium.utils.passive_env_checker import env_render_passive_checker
from stable_baselines3.common.env_checker import check_env as check_env_sb3

from anyskill_envs.observation import OBSERVATION_SIZE


@pytest.fixture(params=IDS)
def environment_id(request):
    return request.param


@pytest.fixture
def kwargs(environment_id, controller_file):
    return arguments(environment_id, controller_file)


@pytest.fixture
def env(environment_id, kwargs):
    env = gym.make(environment_id, **kwargs)
    yield env
    env.close()


def test_the_ids_of_the_readme_are_registered():
    assert {"HumanoidJoints-v0", "HumanoidLatent-v0", "HumanoidText-v0"} <= set(IDS)
    assert {f"Humanoid{scene}-v0" for scene in ("Soccer", "Door", "Chair", "Pillar")} <= set(IDS)


def test_gymnasium_checker_has_no_complaint(env):
    with warnings_are_errors():
        check_env(env.unwrapped, skip_render_check=True)  # pictures have a test of their own, windows need a screen


def test_stable_baselines3_checker_has_no_complaint(env):
    with warnings_are_errors():
        check_env_sb3(env, warn=True)


def test_pictures(environment_id, kwargs):
    env = gym.make(environment_id, render_mode="rgb_array", width=64, height=48, **kwargs)
    env.reset(seed=0)
    with warnings_are_errors():
        env_render_passive_checker(env.unwrapped)
    first, second = env.render(), env.render()
    assert first.shape == (48, 64, 3) and first.dtype == np.uint8
    assert first.std() > 5  # there is something to see
    np.testing.assert_array_equal(first, second)
    assert not np.shares_memory(first, second)
    env.close()


def test_pictures_change_neither_physics_nor_randomness(environment_id, kwargs):
    plain = gym.make(environment_id, **kwargs)
    drawn = gym.make(environment_id, render_mode="rgb_array", width=32, height=32, **kwargs)
    plain.action_space.seed(0)
    assert_same(plain.reset(seed=3), drawn.reset(seed=3))
    for _ in range(3):
        action = plain.action_space.sample()
        drawn.render()
        assert_same(plain.step(action), drawn.step(action))
    state = plain.unwrapped.np_random.bit_generator.state
    assert state == drawn.unwrapped.np_random.bit_generator.state
    drawn.close()


def test_same_seed_same_rollout(environment_id, kwargs):
    first, second = (gym.make(environment_id, **kwargs) for _ in range(2))
    first.action_space.seed(0)
    assert_same(first.reset(seed=5), second.reset(seed=5))
    for _ in range(5):
        action = first.action_space.sample()
        assert_same(first.step(action), second.step(action))


def test_starts_are_random_and_observations_move(env):
    observations = [env.reset(seed=seed)[0] for seed in range(3)]
    observations += [env.step(env.action_space.sample())[0] for _ in range(5)]
    spread = np.ptp(observations, axis=0)
    assert np.isfinite(observations).all()
    assert not np.array_equal(observations[0], observations[1])
    assert (spread[:OBSERVATION_SIZE] > 0).all()
    # an upright object at rest has a rotation and an angle that stay what they are, but it is seen from elsewhere
    assert (spread[OBSERVATION_SIZE : OBSERVATION_SIZE + 3] > 0).all()


def test_info_has_the_same_keys_at_every_step_and_terms_add_up(env):
    _, info = env.reset(seed=0)
    keys, shapes = set(info), {key: np.shape(value) for key, value in info.items()}
    assert keys >= {"x_position", "x_velocity", "distance_from_origin", "head_height", "diverged", "controller_steps"}
    assert not keys & {"episode", "TimeLimit.truncated", "terminal_observation", "final_obs", "final_info"}
    for _ in range(4):
        _, reward, _, _, info = env.step(env.action_space.sample())
        assert set(info) == keys
        assert {key: np.shape(value) for key, value in info.items()} == shapes
        terms = [value for key, value in info.items() if key.startswith("reward_")]
        assert terms and reward == pytest.approx(sum(terms), abs=1e-12)


def test_only_the_time_limit_truncates(env):
    """Standing still, the episode ends by the registered limit, and that is no termination."""
    env.reset(seed=0)
    still = np.zeros(env.action_space.shape, np.float32)
    for step in range(1, env.spec.max_episode_steps + 1):
        _, _, terminated, truncated, _ = env.step(still)
        assert not terminated
        assert truncated == (step == env.spec.max_episode_steps)


def test_the_unwrapped_environment_never_truncates(env):
    limit, env = env.spec.max_episode_steps, env.unwrapped
    env.reset(seed=0)
    still = np.zeros(env.action_space.shape, np.float32)
    assert not any(env.step(still)[3] for _ in range(limit + 2))


def test_a_lying_humanoid_terminates(env):
    env.reset(options={"initial_state": {"qpos": LYING}})
    _, _, terminated, truncated, info = env.step(np.zeros(env.action_space.shape, np.float32))
    assert terminated and not truncated
    assert info["controller_steps"] == 1
    with pytest.raises(gym.error.ResetNeeded, match="call reset"):
        env.step(np.zeros(env.action_space.shape, np.float32))


def test_pickle_and_json_make_the_same_environment(env):
    unpickled = pickle.loads(pickle.dumps(env))
    respecified = gym.make(EnvSpec.from_json(env.spec.to_json()))
    assert unpickled.spec == env.spec
    assert json.loads(env.spec.to_json())["kwargs"] == env.spec.kwargs
    env.action_space.seed(1)
    action = env.action_space.sample()
    expected = env.reset(seed=1), env.step(action)
    for other in (unpickled, respecified):
        assert_same((other.reset(seed=1), other.step(action)), expected)


def test_frames_per_second_follow_the_agent_step(env):
    assert env.metadata["render_fps"] == (30 if env.spec.id == "HumanoidJoints-v0" else 6)
    assert type(env.unwrapped).metadata["render_fps"] == env.metadata["render_fps"]


def test_batch_of_one_equals_the_single_environment(environment_id, kwargs, env):
    vector = gym.make_vec(environment_id, num_envs=1, **kwargs)
    env.action_space.seed(0)
    observation, info = env.reset(seed=2)
    observations, infos = vector.reset(seed=2)
    np.testing.assert_array_equal(observations[0], observation)
    for _ in range(4):
        action = env.action_space.sample()
        observation, reward, terminated, truncated, info = env.step(action)
        observations, rewards, terminations, truncations, infos = vector.step(action[None])
        np.testing.assert_array_equal(observations[0], observation)
        assert (rewards[0], terminations[0], truncations[0]) == (reward, terminated, truncated)
        for key, value in info.items():
            np.testing.assert_array_equal(infos[key][0], value)


def test_vector_environment_keeps_the_conventions(environment_id, kwargs):
    with warnings_are_errors():
        envs = gym.make_vec(environment_id, num_envs=3, **kwargs)
        envs.action_space.seed(0)
        previous, infos = envs.reset(seed=0)
        single = gym.make(environment_id, **kwargs)
        assert envs.single_action_space == single.action_space
        assert envs.single_observation_space == single.observation_space
        keys = set(infos)
        assert previous in envs.observation_space
        for _ in range(3):
            observations, rewards, terminations, truncations, infos = envs.step(envs.action_space.sample())
            assert observations in envs.observation_space
            assert observations.dtype == np.float32
            assert rewards.shape == (3,) and rewards.dtype == np.float64 and np.isfinite(rewards).all()
            assert terminations.dtype == truncations.dtype == bool
            assert set(infos) == keys
            assert all(len(infos[key]) == 3 and infos[f"_{key}"].all() for key in keys if not key.startswith("_"))
            assert not np.shares_memory(previous, observations)
            previous = observations
        envs.close()
        envs.close()


def test_gymnasiums_own_vectorisation_works_too(environment_id, kwargs):
    envs = gym.make_vec(environment_id, num_envs=2, vectorization_mode="sync", **kwargs)
    envs.action_space.seed(0)
    observations, _ = envs.reset(seed=0)
    assert observations in envs.observation_space
    assert envs.step(envs.action_space.sample())[0] in envs.observation_space
