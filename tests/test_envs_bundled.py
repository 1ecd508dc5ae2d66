"""The environments as they come, with the bundled controller and encoder."""

import gymnasium as gym
import numpy as np
import pytest
from envs_common import IDS, assert_same, warnings_are_errors
from gymnasium.utils.env_checker import check_env
from stable_baselines3.common.env_checker import check_env as check_env_sb3

from anyskill_envs.controller import LowLevelController
from anyskill_envs.latent import HumanoidLatentVectorEnv
from anyskill_envs.observation import OBSERVATION_SIZE


@pytest.mark.parametrize("environment_id", IDS)
def test_checkers_have_no_complaint(environment_id):
    env = gym.make(environment_id)
    with warnings_are_errors():
        check_env(env.unwrapped, skip_render_check=True)
        check_env_sb3(env, warn=True)


def test_named_latents_are_unit_vectors():
    latents = gym.make("HumanoidLatent-v0").unwrapped.latents
    assert {"idle", "walk", "wave_right_hand", "squat"} <= set(latents)
    np.testing.assert_allclose(np.linalg.norm(list(latents.values()), axis=1), 1, atol=1e-4)


def test_zero_actions_stand_for_ten_seconds():
    envs = gym.make_vec("HumanoidLatent-v0", num_envs=8)
    envs.reset(seed=0)
    still = np.zeros((8, 64))
    steps = [envs.step(still) for _ in range(60)]
    assert sum(step[2].any() for step in steps) == 0
    assert steps[-1][3].all()
    assert (steps[-1][4]["distance_from_origin"] < 1).all()


def test_controller_output_depends_neither_on_batch_nor_on_threads():
    rng = np.random.default_rng(0)
    observations = rng.normal(size=(64, OBSERVATION_SIZE)).astype(np.float32)
    latents = rng.normal(size=(64, 64)).astype(np.float32)
    one, two = LowLevelController.load(num_threads=1), LowLevelController.load(num_threads=2)
    together = one.act(observations, latents)
    np.testing.assert_array_equal(two.act(observations, latents), together)
    alone = np.concatenate([one.act(observations[i : i + 1], latents[i : i + 1]) for i in range(64)])
    np.testing.assert_allclose(alone, together, atol=1e-5)


def test_rollouts_do_not_depend_on_threads():
    rollouts = []
    for num_threads in (1, 2):
        envs = HumanoidLatentVectorEnv(32, num_threads=num_threads, autoreset_mode="SameStep")
        rng = np.random.default_rng(0)
        rollouts.append([envs.reset(seed=0)] + [envs.step(rng.normal(size=(32, 64))) for _ in range(5)])
    assert_same(*rollouts)


def test_text_similarity_prefers_the_pose_that_the_text_describes():
    from motion_data.skeleton import joint_index, rest_qpos

    raised = rest_qpos()
    raised[7 + joint_index("right_shoulder_y")] = raised[7 + joint_index("left_shoulder_y")] = np.radians(-175)
    poses = np.stack([rest_qpos(), raised])
    envs = gym.make_vec(
        "HumanoidText-v0", num_envs=2, text="raise both arms above the head", record_controller_steps=True
    )
    envs.reset(seed=0, options={"initial_state": {"qpos": poses}})
    standing, arms_up = envs.unwrapped.compute_reward(np.zeros((2, 64), np.float32)).similarity
    assert arms_up > standing
