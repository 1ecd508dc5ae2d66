"""The batched environments: resets, endings inside a decision, independence of batch, threads and process."""

import hashlib
import subprocess
import sys
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from envs_common import LYING, assert_same
from gymnasium.vector import AutoresetMode
from small_models import write_controller

from anyskill_envs.actions import JointActions, LatentActions
from anyskill_envs.latent import HumanoidLatentVectorEnv
from anyskill_envs.observation import OBSERVATION_SIZE
from anyskill_envs.single import HumanoidEnv
from anyskill_envs.text import HumanoidTextVectorEnv
from anyskill_envs.vector import HumanoidVectorEnv
from anyskill_envs.wrappers import LatentAction, VectorLatentAction
from motion_data.skeleton import HEAD_CENTRE, JOINT_NAMES, forward_kinematics, joint_limits, rest_qpos
from rewards import RewardBatch, RewardOutput, make_reward

TESTS = Path(__file__).parent


def falling(height):
    """Lying on the back in the air, the middle of the head `height` metres above the floor, sinking at 1 m/s."""
    qpos = LYING.copy()
    positions, quaternions = forward_kinematics(qpos[None])
    w, x, y, z = quaternions[0, 2]
    lift = HEAD_CENTRE[0] * 2 * (x * z - w * y) + HEAD_CENTRE[2] * (1 - 2 * (x * x + y * y))
    qpos[2] += height - positions[0, 2, 2] - lift
    qvel = np.zeros(34)
    qvel[2] = -1.0
    return {"qpos": qpos, "qvel": qvel}


def states(*starts):
    """One initial state for several humanoids."""
    starts = [{"qpos": rest_qpos(), "qvel": np.zeros(34)} if start is None else start for start in starts]
    return {"initial_state": {name: np.stack([start[name] for start in starts]) for name in ("qpos", "qvel")}}


# Autoreset


def test_the_time_limit_of_the_registration_truncates_the_batch(controller_file):
    envs = gym.make_vec("HumanoidLatent-v0", num_envs=2, num_threads=1, controller=str(controller_file))
    assert envs.metadata["autoreset_mode"] == AutoresetMode.NEXT_STEP
    envs.reset(seed=0)
    still = np.zeros((2, 64), np.float32)
    for step in range(1, 61):
        _, _, terminated, truncated, _ = envs.step(still)
        assert not terminated.any()
        assert truncated.tolist() == [step == 60] * 2


def test_next_step_mode_spends_a_step_on_the_reset():
    envs = HumanoidVectorEnv(2, max_episode_steps=3, num_threads=1)
    envs.reset(seed=0)
    still = np.zeros((2, 28))
    for _ in range(3):
        observations, _, _, truncated, _ = envs.step(still)
    assert truncated.all()
    before = observations.copy()
    observations, rewards, terminated, truncated, infos = envs.step(still)
    assert not np.array_equal(observations, before)
    assert not rewards.any() and not terminated.any() and not truncated.any()
    assert not infos["controller_steps"].any()
    assert envs.step(still)[-1]["controller_steps"].tolist() == [1, 1]


def test_same_step_mode_returns_the_new_episode_and_keeps_the_old_ending():
    envs = HumanoidVectorEnv(3, max_episode_steps=4, autoreset_mode="SameStep", num_threads=1)
    reference = HumanoidVectorEnv(3, num_threads=1)
    start = states(None, falling(0.2), None)
    assert_same(envs.reset(seed=0, options=start), reference.reset(seed=0, options=start))
    still = np.zeros((3, 28))
    ended_early = False
    for _ in range(4):
        observations, rewards, terminated, truncated, infos = envs.step(still)
        expected = reference.step(still)
        if terminated.any():
            assert terminated.tolist() == [False, True, False] and not truncated.any()
            assert infos["_final_obs"].tolist() == infos["_final_info"].tolist() == [False, True, False]
            assert infos["final_obs"][0] is None
            np.testing.assert_array_equal(infos["final_obs"][1], expected[0][1])
            assert infos["final_info"]["head_height"][1] < 0.15 < infos["head_height"][1]
            assert infos["final_info"]["controller_steps"][1] == 1 and infos["controller_steps"][1] == 0
            assert not np.array_equal(observations[1], expected[0][1])
            np.testing.assert_array_equal(observations[[0, 2]], expected[0][[0, 2]])
            ended_early = True
            break
        assert_same((observations, rewards, terminated, infos), (*expected[:3], expected[4]))
    assert ended_early


def test_disabled_mode_wants_a_reset_of_those_that_ended():
    envs = HumanoidVectorEnv(2, autoreset_mode=AutoresetMode.DISABLED, num_threads=1)
    envs.reset(seed=0, options=states(None, {"qpos": LYING, "qvel": np.zeros(34)}))
    still = np.zeros((2, 28))
    observations, _, terminated, _, _ = envs.step(still)
    assert terminated.tolist() == [False, True]
    with pytest.raises(gym.error.ResetNeeded, match=r"\[1\]"):
        envs.step(still)
    again, infos = envs.reset(options={"reset_mask": terminated})
    np.testing.assert_array_equal(again[0], observations[0])  # who was not reset goes on
    assert infos["head_height"][1] > 1.4
    envs.step(still)


def test_stepping_before_the_first_reset_is_refused():
    with pytest.raises(gym.error.ResetNeeded, match="reset"):
        HumanoidVectorEnv(1).step(np.zeros((1, 28)))


# Endings inside a decision


def test_a_humanoid_that_ends_inside_a_decision_is_held_and_the_others_go_on(controller_file):
    options = {"controller": controller_file, "num_threads": 1, "record_controller_steps": True}
    envs = HumanoidLatentVectorEnv(3, **options)
    companions = HumanoidLatentVectorEnv(2, **options)
    envs.reset(seed=0, options=states(None, falling(0.22), None))
    companions.reset(seed=0, options=states(None, None))
    actions = np.ones((3, 64))
    observations, rewards, terminated, truncated, infos = envs.step(actions)
    steps = infos["controller_steps"]
    assert terminated.tolist() == [False, True, False] and not truncated.any()
    assert 1 < steps[1] < 5 and steps[[0, 2]].tolist() == [5, 5]
    held = infos["controller_qpos"][1]
    np.testing.assert_array_equal(held[steps[1] - 1 :], np.broadcast_to(held[-1], (6 - steps[1], 35)))
    np.testing.assert_array_equal(envs.simulation.qpos[1], held[-1])
    assert (np.diff(held[: steps[1], 2]) < 0).all()
    # one of the executed steps ended the episode and earns nothing
    assert rewards[1] == pytest.approx((steps[1] - 1) / steps[1])
    np.testing.assert_array_equal(observations[[0, 2]], companions.step(actions[:2])[0])


def test_a_diverging_humanoid_ends_and_leaves_the_others_alone(controller_file):
    envs = HumanoidLatentVectorEnv(3, controller=controller_file, num_threads=1)
    companions = HumanoidLatentVectorEnv(2, controller=controller_file, num_threads=1)
    exploding = {"qpos": rest_qpos(), "qvel": np.full(34, 1e6)}
    envs.reset(seed=0, options=states(None, exploding, None))
    companions.reset(seed=0, options=states(None, None))
    actions = np.ones((3, 64))
    observations, rewards, terminated, _, infos = envs.step(actions)
    expected = companions.step(actions[:2])
    assert terminated.tolist() == infos["diverged"].tolist() == [False, True, False]
    assert rewards[1] == 0 and np.isfinite(observations).all()
    np.testing.assert_array_equal(observations[[0, 2]], expected[0])
    np.testing.assert_array_equal(rewards[[0, 2]], expected[1])


def test_a_fall_ends_the_episode_only_if_wanted(controller_file):
    qpos = rest_qpos()
    qpos[3:7] = [np.sqrt(0.5), np.sqrt(0.5), 0, 0]  # lying on the right side, head up on a bent neck
    qpos[7 + JOINT_NAMES.index("neck_x")] = -1.0
    qpos[7 + JOINT_NAMES.index("right_shoulder_x")] = -0.5
    qpos[2] = 0.24
    still = np.zeros((1, 28))
    for wanted in (False, True):
        envs = HumanoidVectorEnv(1, terminate_when_fallen=wanted, minimum_head_height=0.0)
        envs.reset(options={"initial_state": {"qpos": qpos}})
        assert envs.step(still)[2][0] == wanted


def test_kneeling_is_no_fall():
    qpos = rest_qpos()
    for side in ("right", "left"):
        qpos[7 + JOINT_NAMES.index(f"{side}_knee")] = np.pi / 2
        qpos[7 + JOINT_NAMES.index(f"{side}_ankle_y")] = 1.0
    qpos[2] = 0.42 + 0.045  # knees just in the floor
    envs = HumanoidVectorEnv(1, terminate_when_fallen=True)
    envs.reset(options={"initial_state": {"qpos": qpos}})
    assert not envs.step(np.zeros((1, 28)))[2][0]


# Actions


def test_joint_actions_reach_the_limits_and_zero_is_the_rest_pose():
    joints = JointActions()
    low, high = joint_limits().T
    assert not joints.commands(np.zeros((1, 28))).any()
    assert (joints.commands(-np.ones((1, 28)))[0] < low).all()
    assert (joints.commands(np.ones((1, 28)))[0] > high).all()
    targets = np.random.default_rng(0).uniform(low, high, (50, 28))
    actions = joints.actions(targets)
    assert (np.abs(actions) < 1).all()
    np.testing.assert_allclose(joints.commands(actions), targets, atol=1e-6)


def test_latent_actions_are_clipped_and_put_on_the_sphere_and_zero_means_idle(controller_file):
    latents = LatentActions(controller_file)
    commands = latents.commands([np.full(64, 5.0), np.full(64, 1e-4), np.zeros(64)])
    np.testing.assert_allclose(commands[:2], 1 / 8, rtol=1e-5)
    np.testing.assert_array_equal(commands[2], latents.controller.anchors["idle"])


def test_info_reports_the_latent_that_was_played(controller_file):
    env = gym.make("HumanoidLatent-v0", controller=str(controller_file))
    env.reset(seed=0)
    walk = env.unwrapped.latents["walk"]
    np.testing.assert_allclose(env.step(walk)[-1]["latent"], walk, atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(env.step(np.full(64, 0.3))[-1]["latent"]), 1, atol=1e-6)


def test_wrapped_joint_level_batch_is_the_latent_environment(controller_file):
    wrapped = VectorLatentAction(HumanoidVectorEnv(4, max_episode_steps=20, num_threads=1), controller_file)
    latent = HumanoidLatentVectorEnv(4, max_episode_steps=4, controller=controller_file, num_threads=1)
    assert wrapped.action_space == latent.action_space
    assert wrapped.metadata == latent.metadata
    rng = np.random.default_rng(0)
    assert_same(wrapped.reset(seed=1), latent.reset(seed=1))
    for _ in range(6):  # past the end of the episode
        actions = rng.uniform(-1, 1, (4, 64))
        assert_same(wrapped.step(actions), latent.step(actions))


def test_wrapped_single_environment_is_the_latent_environment(controller_file):
    wrapped = LatentAction(gym.make("HumanoidJoints-v0"), controller_file)
    latent = gym.make("HumanoidLatent-v0", controller=str(controller_file))
    np.testing.assert_array_equal(wrapped.reset(seed=1)[0], latent.reset(seed=1)[0])
    options = {"initial_state": falling(0.35)}
    for env in (wrapped, latent):
        env.reset(options=options)
    terminated = False
    while not terminated:
        one, other = wrapped.step(np.ones(64)), latent.step(np.ones(64))
        # targets pass through the joint actions and lose their last bit
        np.testing.assert_allclose(one[0], other[0], atol=1e-4)
        assert one[1:4] == other[1:4]
        assert one[4].keys() == other[4].keys()
        assert one[4]["controller_steps"] == other[4]["controller_steps"]
        terminated = one[2]
    assert one[4]["controller_steps"] < 5


def test_the_time_limit_of_a_wrapped_environment_counts_its_own_steps(tmp_path):
    wrapped = LatentAction(gym.make("HumanoidJoints-v0"), write_controller(tmp_path, swing=0.0))
    wrapped.reset(seed=0)
    steps = [wrapped.step(np.ones(64)) for _ in range(60)]  # of 300 joint-level ones
    assert [step[3] for step in steps] == [False] * 59 + [True]
    assert wrapped.spec.to_json()


def test_wrappers_refuse_other_environments(controller_file):
    with pytest.raises(TypeError, match="joint-level"):
        LatentAction(gym.make("CartPole-v1"), controller_file)
    with pytest.raises(TypeError, match="joint-level"):
        LatentAction(gym.make("HumanoidLatent-v0", controller=str(controller_file)), controller_file)
    with pytest.raises(TypeError, match="joint-level"):
        VectorLatentAction(HumanoidLatentVectorEnv(2, controller=controller_file), controller_file)


# A new environment is one file and one line


class HeightVectorEnv(HumanoidVectorEnv):
    """Rewards a high head."""

    def compute_reward(self, commands):
        height = self.simulation.head_height
        return RewardOutput.from_terms({"height": height, "effort": -0.01 * np.square(commands).sum(1)})


class HeightEnv(HumanoidEnv):
    """One humanoid rewarded for a high head."""

    vector_class = HeightVectorEnv


def test_a_new_environment_needs_only_its_reward(controller_file):
    env = HeightEnv()
    env.reset(seed=0)
    _, reward, _, _, info = env.step(np.full(28, 0.1))
    assert info["reward_height"] == pytest.approx(info["head_height"])
    assert info["reward_effort"] < 0
    assert reward == info["reward_height"] + info["reward_effort"]
    assert LatentAction(env, controller_file).step(np.ones(64))[1] == pytest.approx(reward, abs=0.1)


# Start states


def test_library_starts_come_from_motion_clips():
    envs = HumanoidVectorEnv(16, initial_state="library", num_threads=1)
    envs.reset(seed=0)
    poses = envs.simulation.qpos.copy()
    assert not poses[:, :2].any()
    assert np.ptp(poses[:, 7:], axis=0).max() > 0.3
    envs.reset(seed=0, options={"initial_state": "standing"})
    assert np.abs(envs.simulation.qpos[:, 7:]).max() <= 0.02
    envs.reset(seed=0)
    np.testing.assert_array_equal(envs.simulation.qpos, poses)


# Determinism


def test_alone_and_in_a_batch_of_64_the_physics_are_the_same_bit_for_bit():
    alone, batch = HumanoidVectorEnv(1, num_threads=1), HumanoidVectorEnv(64, num_threads=2)
    rng = np.random.default_rng(0)
    poses = np.tile(rest_qpos(), (64, 1))
    poses[:, 7:] += rng.normal(0, 0.05, (64, 28))
    alone.reset(options={"initial_state": {"qpos": poses[17]}})
    batch.reset(options={"initial_state": {"qpos": poses}})
    for _ in range(30):
        actions = rng.uniform(-0.3, 0.3, (64, 28))
        one, all_of_them = alone.step(actions[17:18]), batch.step(actions)
        np.testing.assert_array_equal(one[0][0], all_of_them[0][17])
        np.testing.assert_array_equal(alone.simulation.qpos[0], batch.simulation.qpos[17])


def test_the_controller_says_the_same_alone_and_in_a_batch_of_64(controller_file):
    controller = LatentActions(controller_file).controller
    rng = np.random.default_rng(0)
    observations = rng.normal(size=(64, OBSERVATION_SIZE)).astype(np.float32)
    latents = rng.normal(size=(64, 64)).astype(np.float32)
    together = controller.act(observations, latents)
    alone = np.concatenate([controller.act(observations[i : i + 1], latents[i : i + 1]) for i in range(64)])
    np.testing.assert_allclose(alone, together, atol=1e-5)


def rollout_digest(controller: str, num_threads: int) -> str:
    """SHA-256 of everything that a rollout of HumanoidText-v0 returns."""
    envs = HumanoidTextVectorEnv(
        6,
        controller=controller,
        encoder="small",
        num_threads=num_threads,
        max_episode_steps=5,
        autoreset_mode="SameStep",
    )
    rng = np.random.default_rng(0)
    observations, infos = envs.reset(seed=11)
    digest = hashlib.sha256(observations.tobytes())
    for _ in range(12):
        observations, rewards, terminated, truncated, infos = envs.step(rng.uniform(-1, 1, (6, 64)))
        for array in (observations, rewards, terminated, truncated, infos["reward_style"], envs.simulation.qpos):
            digest.update(array.tobytes())
    return digest.hexdigest()


def test_same_seed_same_bits_in_another_process_and_with_other_threads(controller_file):
    script = f"""
import sys
sys.path.insert(0, "tests")
import test_envs_batch
print(test_envs_batch.rollout_digest({str(controller_file)!r}, 1))
"""
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, cwd=TESTS.parent, timeout=120)
    assert run.returncode == 0, run.stderr
    here = rollout_digest(str(controller_file), 1)
    assert run.stdout.strip() == here
    assert rollout_digest(str(controller_file), 2) == here


def test_importing_and_stepping_loads_no_torch_and_is_quick(controller_file):
    script = f"""
import sys, time
start = time.process_time()
import gymnasium, anyskill_envs
imported = time.process_time() - start
envs = gymnasium.make_vec("HumanoidLatent-v0", num_envs=2, controller={str(controller_file)!r})
envs.reset(seed=0)
envs.step(envs.action_space.sample())
ready = time.process_time() - start
loaded = [name for name in ("torch", "stable_baselines3", "transformers", "matplotlib") if name in sys.modules]
print(loaded, imported, ready)
assert not loaded, loaded
assert ready < 4, ready  # seconds of CPU; about one on an idle machine
"""
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, cwd=TESTS.parent, timeout=120)
    assert run.returncode == 0, run.stdout + run.stderr


# Text


def text_envs(controller_file, count=4, **kwargs):
    return HumanoidTextVectorEnv(count, controller=controller_file, encoder="small", num_threads=1, **kwargs)


def test_the_reward_can_be_recomputed_from_stored_observations(controller_file):
    envs = text_envs(controller_file, text="wave the right hand", record_controller_steps=True)
    envs.reset(seed=0, options=states(None, falling(0.2), None, None))
    reward_fn = make_reward("clip", encoder="small")
    feature = reward_fn.encode_text(["wave the right hand"])[0]
    rng = np.random.default_rng(0)
    steps_seen = set()
    for _ in range(3):
        _, rewards, _, _, infos = envs.step(rng.uniform(-1, 1, (4, 64)))
        for index in range(4):
            steps = infos["controller_steps"][index]
            steps_seen.add(int(steps))
            if steps == 0:  # the step that Gymnasium spends on a reset
                continue
            output = reward_fn(
                RewardBatch(
                    observation=infos["controller_observations"][index, :steps],
                    text_feature=feature,
                    latent=np.tile(infos["latent"][index], (steps, 1)),
                    style_latent=np.tile(infos["style_latent"][index], (steps, 1)),
                )
            )
            assert rewards[index] == pytest.approx(output.total.mean(), abs=1e-6)
            assert infos["similarity"][index] == pytest.approx(output.similarity.mean(), abs=1e-6)
            for name, term in output.terms.items():
                assert infos[f"reward_{name}"][index] == pytest.approx(term.mean(), abs=1e-6)
    assert len(steps_seen & {1, 2, 3, 4}) == 1 and 5 in steps_seen


def test_the_text_decides_the_reward(controller_file):
    first, second = (text_envs(controller_file, text=text) for text in ("squat down", "wave both hands"))
    for envs in (first, second):
        envs.reset(seed=0)
    actions = np.ones((4, 64))
    one, other = first.step(actions), second.step(actions)
    np.testing.assert_array_equal(one[0], other[0])
    assert not np.allclose(one[4]["similarity"], other[4]["similarity"])
    # a new text at reset does the same as a new environment
    first.reset(seed=0, options={"text": "wave both hands"})
    assert first.texts == ["wave both hands"] * 4
    np.testing.assert_array_equal(first.step(actions)[4]["similarity"], other[4]["similarity"])


def test_each_humanoid_may_have_a_text_and_observe_it(controller_file):
    envs = text_envs(controller_file, count=2, text=["squat down", "wave both hands"], text_observation=True)
    observations, _ = envs.reset(seed=0)
    assert envs.single_observation_space.shape == (OBSERVATION_SIZE + 16,)
    assert observations in envs.observation_space
    features = make_reward("clip", encoder="small").encode_text(["squat down", "wave both hands"])
    np.testing.assert_array_equal(observations[:, OBSERVATION_SIZE:], features)


def test_a_reward_that_looks_at_pictures_gets_them(controller_file):
    envs = text_envs(controller_file, count=2, reward_kwargs={"source": "frames"})
    envs.reset(seed=0)
    similarity = envs.step(np.ones((2, 64)))[4]["similarity"]
    assert np.isfinite(similarity).all() and (np.abs(similarity) <= 1).all()
    envs.close()
