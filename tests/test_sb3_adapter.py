"""Stable-Baselines3 trains on the batched environments as on its own."""

import gymnasium as gym
import numpy as np
import pytest
from envs_common import arguments, assert_same
from gymnasium.wrappers.vector import RecordEpisodeStatistics
from stable_baselines3 import PPO
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.vec_env import VecMonitor, VecNormalize
from test_envs_batch import LYING, states

from agents.sb3 import VectorEnvAdapter, make_sb3_env, unstack_info
from anyskill_envs.latent import HumanoidLatentVectorEnv
from anyskill_envs.text import HumanoidTextVectorEnv
from anyskill_envs.vector import HumanoidVectorEnv


def make(controller_file, count=3, mode="SameStep", **kwargs):
    return HumanoidTextVectorEnv(
        count, **{"controller": controller_file, "encoder": "small", "num_threads": 1, "autoreset_mode": mode} | kwargs
    )


def test_steps_equal_a_loop_written_by_hand(controller_file):
    """The reference resets by hand, remembers last observations by hand and counts steps by hand."""
    limit = 4
    adapter = VectorEnvAdapter(make(controller_file, max_episode_steps=limit))
    envs = make(controller_file, mode="Disabled")
    start = states(None, {"qpos": LYING, "qvel": np.zeros(34)}, None)
    adapter.seed(9)
    adapter.set_options(start)
    observations, infos = envs.reset(seed=9, options=start)
    np.testing.assert_array_equal(adapter.reset(), observations)
    lengths = np.zeros(3, int)
    rng = np.random.default_rng(0)
    endings = set()
    for _ in range(10):
        actions = rng.uniform(-1, 1, (3, 64)).astype(np.float32)
        observations, rewards, terminated, _, infos = envs.step(actions)
        lengths += 1
        truncated = ~terminated & (lengths == limit)
        dones = terminated | truncated
        last = observations.copy()
        if dones.any():
            fresh, fresh_infos = envs.reset(options={"reset_mask": dones})
            observations = np.where(dones[:, None], fresh, observations)
            lengths[dones] = 0
        got_observations, got_rewards, got_dones, got_infos = adapter.step(actions)
        np.testing.assert_array_equal(got_observations, observations)
        np.testing.assert_array_equal(got_rewards, rewards.astype(np.float32))
        np.testing.assert_array_equal(got_dones, dones)
        assert got_rewards.dtype == np.float32 and len(got_infos) == 3
        for index, info in enumerate(got_infos):
            assert info["TimeLimit.truncated"] is bool(truncated[index])
            assert ("terminal_observation" in info) == dones[index]
            if dones[index]:
                np.testing.assert_array_equal(info["terminal_observation"], last[index])
                assert adapter.reset_infos[index]["head_height"] == fresh_infos["head_height"][index]
                endings.add((bool(terminated[index]), bool(truncated[index])))
            for key in ("reward_clip", "reward_style", "similarity", "head_height", "latent", "controller_steps"):
                np.testing.assert_array_equal(info[key], infos[key][index])
    assert endings == {(True, False), (False, True)}


def test_ppo_learns_two_updates(controller_file):
    env = make_sb3_env("HumanoidText-v0", 4, seed=0, **arguments("HumanoidText-v0", controller_file))
    assert isinstance(env, VecMonitor)
    model = PPO("MlpPolicy", env, n_steps=8, batch_size=16, n_epochs=1, policy_kwargs={"net_arch": [16]}, device="cpu")
    before = model.policy.state_dict()["action_net.weight"].clone()
    model.learn(64)
    assert model.num_timesteps == 64
    assert not before.equal(model.policy.state_dict()["action_net.weight"])
    env.close()


def test_normalisation_and_evaluation(controller_file):
    env = VecNormalize(
        make_sb3_env("HumanoidLatent-v0", 2, max_episode_steps=3, **arguments("HumanoidLatent-v0", controller_file))
    )
    model = PPO("MlpPolicy", env, n_steps=4, batch_size=8, n_epochs=1, device="cpu")
    model.learn(8)
    rewards, lengths = evaluate_policy(model, env, n_eval_episodes=4, return_episode_rewards=True)
    assert lengths == [3] * 4
    assert rewards == pytest.approx([3.0] * 4)  # 1 for each decision alive


def test_seeds_make_runs_repeatable(controller_file):
    def run(seed):
        env = make_sb3_env("HumanoidLatent-v0", 2, seed=seed, **arguments("HumanoidLatent-v0", controller_file))
        return env.reset(), env.step(np.ones((2, 64), np.float32))[0]

    assert_same(run(3), run(3))
    assert not np.array_equal(run(3)[0], run(4)[0])


def test_attributes_and_methods_belong_to_the_batch(controller_file):
    adapter = VectorEnvAdapter(RecordEpisodeStatistics(make(controller_file, text="squat down")))
    assert adapter.get_attr("texts") == [["squat down"] * 3] * 3
    assert adapter.get_attr("render_mode", indices=[0, 2]) == [None, None]
    assert adapter.env_is_wrapped(RecordEpisodeStatistics) == [True] * 3
    assert adapter.env_is_wrapped(gym.wrappers.TimeLimit, indices=0) == [False]
    assert not adapter.has_attr("nothing")
    adapter.set_attr("minimum_head_height", 0.5)
    assert adapter.env.unwrapped.minimum_head_height == 0.5
    with pytest.raises(ValueError, match="all humanoids"):
        adapter.set_attr("minimum_head_height", 0.5, indices=[1])
    assert len(adapter.env_method("has_ended")) == 3
    adapter.reset()
    assert adapter.step(np.zeros((3, 64), np.float32))[0].shape == (3, 223)


def test_pictures_are_tiled(controller_file):
    adapter = VectorEnvAdapter(make(controller_file, count=2, render_mode="rgb_array", width=16, height=16))
    adapter.reset()
    assert adapter.render().shape == (32, 16, 3) or adapter.render().shape == (16, 32, 3)
    adapter.close()


def test_other_autoreset_modes_are_refused(controller_file):
    with pytest.raises(ValueError, match='autoreset_mode="SameStep"'):
        VectorEnvAdapter(HumanoidLatentVectorEnv(2, controller=controller_file))
    with pytest.raises(TypeError, match="make_vec"):
        VectorEnvAdapter(gym.make("CartPole-v1"))


def test_humanoids_share_their_reset_options():
    adapter = VectorEnvAdapter(HumanoidVectorEnv(2, autoreset_mode="SameStep"))
    adapter.set_options([{"initial_state": "standing"}, {}])
    with pytest.raises(ValueError, match="same options"):
        adapter.reset()


def test_info_is_unstacked_by_its_masks():
    infos = {
        "speed": np.array([1.0, 2.0]),
        "_speed": np.array([True, True]),
        "goal": np.array([None, "here"], dtype=object),
        "_goal": np.array([False, True]),
        "episode": {"r": np.array([0.0, 3.0]), "_r": np.array([False, True])},
        "_episode": np.array([False, True]),
    }
    assert unstack_info(infos, 2) == [{"speed": 1.0}, {"speed": 2.0, "goal": "here", "episode": {"r": 3.0}}]
