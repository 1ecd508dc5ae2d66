"""A reward is the same from gym.make, from a wrapper and from a stored rollout; wrappers fit any environment."""

import json
import pickle
import warnings

import gymnasium as gym
import numpy as np
import pytest
from envs_common import arguments, assert_same, warnings_are_errors
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env
from small_models import SmallEncoder
from stable_baselines3.common.env_checker import check_env as check_env_sb3

from anyskill_envs.humanoid_reward import HumanoidReward
from anyskill_envs.latent import HumanoidLatentVectorEnv
from anyskill_envs.rendering import Camera
from anyskill_envs.reward_wrappers import TextReward, VectorTextReward
from anyskill_envs.text import HumanoidTextVectorEnv
from anyskill_envs.wrappers import LatentAction
from rewards import make_reward

TEXT = "wave the right hand"
# Every registered reward in one sum, with both forms of the style term.
WEIGHTS = {"clip": 0.5, "style": 0.2, "delta": 10.0, "avgpool": 0.3, "vlm-rm": 0.4, "clip-s": 0.1, "velocity": 0.2}
PARTS = {"style": {"form": "nearest"}, "avgpool": {"window": 7}}
EVERYTHING = {"reward": WEIGHTS, "reward_kwargs": PARTS, "encoder": "small"}


def same_rewards(ours, theirs):
    """The wrapper's info has what the environment's info has, the rewards that it replaced, and the controller steps."""
    more = {"original_reward", "original_reward_alive", "controller_observations", "controller_qpos"}
    if "_similarity" in ours:
        more |= {f"_{key}" for key in more}
    assert theirs.keys() - ours.keys() == more
    for key, value in ours.items():
        if isinstance(value, dict):
            same_rewards(value, theirs[key])
        elif value is not None and np.asarray(value).dtype != object:
            np.testing.assert_array_equal(theirs[key], value, err_msg=key)


def test_wrapper_and_gym_make_give_the_same_single(controller_file):
    shared = {"controller": str(controller_file), "num_threads": 1, "terminate_when_fallen": True}
    made = gym.make("HumanoidText-v0", text=TEXT, **shared, **EVERYTHING)
    wrapped = TextReward(gym.make("HumanoidLatent-v0", **shared), TEXT, **EVERYTHING)
    for seed in (3, None):
        first, second = made.reset(seed=seed), wrapped.reset(seed=seed)
        np.testing.assert_array_equal(first[0], second[0])
        same_rewards(first[1], second[1])
        for action in np.random.default_rng(0).uniform(-1, 1, (3, 64)):
            ours, theirs = made.step(action), wrapped.step(action)
            assert ours[1:4] == theirs[1:4]
            same_rewards(ours[4], theirs[4])
            terms = [value for key, value in theirs[4].items() if key.startswith("reward_")]
            assert theirs[1] == pytest.approx(sum(terms), abs=1e-12)


@pytest.mark.parametrize("mode", ["NextStep", "SameStep", "Disabled"])
def test_wrapper_and_gym_make_give_the_same_vector(controller_file, mode):
    """Through the ends of episodes, in every autoreset mode."""
    shared = {"controller": controller_file, "num_threads": 1, "max_episode_steps": 2, "autoreset_mode": mode}
    texts = [TEXT, "squat down", TEXT]
    made = HumanoidTextVectorEnv(3, text=texts, terminate_when_fallen=False, **shared, **EVERYTHING)
    wrapped = VectorTextReward(HumanoidLatentVectorEnv(3, **shared), texts, **EVERYTHING)
    same_rewards(made.reset(seed=1)[1], wrapped.reset(seed=1)[1])
    for step, actions in enumerate(np.random.default_rng(0).uniform(-1, 1, (5, 3, 64))):
        ours, theirs = made.step(actions), wrapped.step(actions)
        for one, other in zip(ours[:4], theirs[:4], strict=True):
            np.testing.assert_array_equal(one, other)
        same_rewards(ours[4], theirs[4])
        if mode == "Disabled" and (step + 1) % 2 == 0:
            options = {"reset_mask": ours[3], "text": ["kick"] * 3}
            same_rewards(made.reset(options=dict(options))[1], wrapped.reset(options=dict(options))[1])
            assert wrapped.texts == ["kick"] * 3


def test_logged_rewards_are_recomputed_from_a_stored_rollout(controller_file):
    envs = HumanoidTextVectorEnv(
        2, text=TEXT, controller=controller_file, num_threads=1, record_controller_steps=True, **EVERYTHING
    )
    observations, _ = envs.reset(seed=0)
    start = observations.copy(), envs.simulation.qpos.copy()
    rng = np.random.default_rng(0)
    stored = [envs.step(rng.uniform(-1, 1, (2, 64))) for _ in range(3)]

    reward = make_reward(WEIGHTS, encoder="small", **PARTS)
    again = HumanoidReward(reward, [TEXT] * 2, Camera(), envs.decoder.controller.latents)
    again.start_from(np.arange(2), *start)
    for _, rewards, _, _, infos in stored:
        again.style_latents = infos["style_latent"]
        outputs = [
            again.of_step(infos["controller_observations"][:, step], infos["controller_qpos"][:, step], infos["latent"])
            for step in range(5)
        ]
        np.testing.assert_allclose(rewards, np.mean([output.total for output in outputs], axis=0), atol=1e-5)
        for name in outputs[0].terms:
            mean = np.mean([output.terms[name] for output in outputs], axis=0)
            np.testing.assert_allclose(infos[f"reward_{name}"], mean, atol=1e-6)


def test_pictures_are_drawn_for_a_reward_that_looks_at_them(controller_file, monkeypatch):
    class Painter:
        """Draws a pose as noise of its own."""

        def __init__(self, scene):
            assert not scene  # no objects

        def render(self, qpos, camera):
            assert camera == Camera((2.0, 0.0, 1.0))
            return np.random.default_rng(abs(int(qpos[0] * 1e12))).integers(0, 255, (64, 64, 3), dtype=np.uint8)

        def close(self):
            pass

    monkeypatch.setattr("anyskill_envs.humanoid_reward.HumanoidRenderer", Painter)
    kwargs = {"reward": "avgpool", "reward_kwargs": {"source": "frames", "window": 2}, "encoder": "small"}
    shared = {"controller": str(controller_file), "num_threads": 1, "camera": {"position": (2.0, 0.0, 1.0)}}
    made = gym.make("HumanoidText-v0", text=TEXT, **shared, **kwargs)
    wrapped = TextReward(gym.make("HumanoidLatent-v0", **shared), TEXT, **kwargs)
    made.reset(seed=0), wrapped.reset(seed=0)
    action = np.full(64, 0.3)
    one, other = made.step(action), wrapped.step(action)
    assert one[1] == other[1] != 0
    made.close(), wrapped.close()


def test_velocity_is_that_of_the_pelvis_in_the_world(controller_file):
    """Turned to the left and thrown to the right: the reward sees world directions."""
    turned = {"qpos": np.zeros(35), "qvel": np.zeros(34)}
    turned["qpos"][2:7] = 3.0, np.sqrt(0.5), 0, 0, np.sqrt(0.5)  # in the air, facing y
    turned["qvel"][:2] = 1.0, -2.0
    rewards = {}
    for direction in ((1, 0), (0, -1)):
        envs = HumanoidTextVectorEnv(
            1,
            reward={"velocity": 1.0},
            reward_kwargs={"velocity": {"direction": direction, "face": (0, 1), "speed": 2.0}},
            controller=controller_file,
            record_controller_steps=True,
            num_threads=1,
        )
        envs.reset(options={"initial_state": turned})
        infos = envs.step(np.zeros((1, 64)))[4]
        rewards[direction] = float(infos["reward_velocity"][0])
        assert infos["reward_facing"][0] == pytest.approx(0.3, abs=0.01)
        assert "similarity" not in infos
    # t is the component at right angles to the direction: -2 and 1 m/s
    assert rewards[1, 0] == pytest.approx(0.7 * np.exp(-0.25 * (1.0 + 0.1 * 4.0)), abs=0.03)
    assert rewards[0, -1] == pytest.approx(0.7 * np.exp(-0.25 * (0.0 + 0.1 * 1.0)), abs=0.03)


# Any environment


class Dial(gym.Env):
    """Turns by an action; its picture shows how far."""

    metadata = {"render_modes": ["rgb_array"], "render_fps": 10}
    observation_space = gym.spaces.Box(-1.0, 1.0, (2,), np.float32)
    action_space = gym.spaces.Discrete(2)

    def __init__(self, render_mode=None, steps=100):
        self.render_mode, self.steps = render_mode, steps

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.angle, self.count = self.np_random.uniform(0, 6), 0
        return self.observation(), {}

    def step(self, action):
        self.angle += 0.1 + action
        self.count += 1
        return self.observation(), 1.0, False, self.count == self.steps, {"reward_turn": 1.0}

    def observation(self):
        return np.array([np.cos(self.angle), np.sin(self.angle)], np.float32)

    def render(self):
        picture = np.random.default_rng(1).uniform(0, 1, (40, 60, 3)) + self.observation()[0]
        return np.uint8(60 * (picture + 1))


FRAMES = {"encoder": SmallEncoder(), "reward_kwargs": {"source": "frames"}}


def test_another_environment_is_rewarded_for_its_pictures():
    env, plain = TextReward(Dial("rgb_array"), "a dial at noon", reward="delta", **FRAMES), Dial()
    env.reset(seed=0, options={"text": "a dial at one"}), plain.reset(seed=0)
    assert env.text == "a dial at one"
    encoder, before = SmallEncoder(), plain.render()
    text = encoder.encode_text(["a dial at one"])[0]
    for action in (0, 1, 1):
        _, reward, _, _, info = env.step(action)
        plain.step(action)
        change = (encoder.encode_image(plain.render()[None]) - encoder.encode_image(before[None]))[0] @ text
        before = plain.render()
        assert reward == info["reward_delta"] == pytest.approx(change, abs=1e-6) != 0
        assert info["original_reward"] == info["original_reward_turn"] == 1.0 and "reward_turn" not in info


def test_a_batch_of_other_environments_gets_the_same_rewards():
    def make():
        return Dial("rgb_array", steps=3)

    single = TextReward(make(), "a dial at noon", reward="avgpool", **FRAMES)
    envs = VectorTextReward(gym.vector.SyncVectorEnv([make] * 2), "a dial at noon", reward="avgpool", **FRAMES)
    single.reset(seed=4), envs.reset(seed=[3, 4])
    for action in (0, 1, 0):
        _, rewards, _, truncated, infos = envs.step(np.array([1, action]))
        _, reward, _, _, _ = single.step(action)
        assert rewards[1] == infos["reward_avgpool"][1] == reward
        assert infos["original_reward_turn"].tolist() == [1, 1] == infos["_original_reward_turn"].tolist()
    assert truncated.all()
    _, rewards, _, _, infos = envs.step(np.array([0, 0]))  # the step that Gymnasium spends on a reset
    assert not rewards.any() and not infos["similarity"].any()
    same_step = gym.vector.SyncVectorEnv([make], autoreset_mode="SameStep")
    with pytest.raises(ValueError, match="last picture of an episode is lost"):
        VectorTextReward(same_step, "a dial at noon", reward="avgpool", **FRAMES)


def test_another_environment_is_rewarded_for_its_state_if_the_encoder_reads_it():
    class DialEncoder(SmallEncoder):
        def encode_state(self, observation):
            assert observation.shape[1] == 2
            return super().encode_state(np.pad(observation, ((0, 0), (0, 221)), constant_values=1.0))

    kwargs = {"reward": "clip", "reward_kwargs": {"style_weight": 0.0}, "encoder": DialEncoder()}
    single = TextReward(Dial(steps=2), "noon", **kwargs)
    envs = gym.vector.SyncVectorEnv([lambda: Dial(steps=2)], autoreset_mode="SameStep")
    envs = VectorTextReward(envs, "noon", **kwargs)
    single.reset(seed=0), envs.reset(seed=0)
    for _ in range(2):
        _, rewards, _, _, infos = envs.step(np.array([1]))
        assert rewards[0] == single.step(1)[1]
    # the reward belongs to the last state of the old episode, and the new one has none yet
    assert infos["final_info"]["reward_clip"][0] == rewards[0] and infos["reward_clip"][0] == 0


@pytest.mark.parametrize(
    ("make", "kwargs", "message"),
    [
        (lambda: gym.make("CartPole-v1"), {}, "latent, style_latent, which only the humanoids"),
        (lambda: gym.make("CartPole-v1"), {"reward": "velocity"}, "facing, velocity"),
        (lambda: gym.make("CartPole-v1"), {"reward": "vlm-rm"}, r"cannot read.*\"source\": \"frames\""),
        (lambda: gym.make("CliffWalking-v1"), {"reward": "vlm-rm"}, "that are arrays, not Discrete"),
        (lambda: gym.make("CartPole-v1"), {"reward": "delta", "reward_kwargs": {"source": "frames"}}, "rgb_array"),
        (lambda: gym.make("HumanoidJoints-v0"), {}, "HumanoidLatent-v0"),
        (lambda: gym.make("HumanoidJoints-v0"), {"text": " "}, "text is empty"),
        (lambda: gym.make("HumanoidJoints-v0"), {"reward": "clop"}, "clop"),
    ],
)
def test_what_does_not_fit_is_refused_at_once(make, kwargs, message):
    with pytest.raises(ValueError, match=message):
        TextReward(make(), **{"text": TEXT, "encoder": "small"} | kwargs)


def test_wrappers_of_the_other_kind_are_refused(controller_file):
    envs = HumanoidLatentVectorEnv(2, controller=controller_file, num_threads=1)
    with pytest.raises(TypeError, match="VectorTextReward"):
        TextReward(envs, TEXT, encoder="small")
    with pytest.raises(TypeError, match="use TextReward"):
        VectorTextReward(gym.make("CartPole-v1"), TEXT, encoder="small")


# Conventions


def test_checkers_have_no_complaint(controller_file):
    env = gym.make("HumanoidLatent-v0", **arguments("HumanoidLatent-v0", controller_file))
    env = TextReward(env.unwrapped, TEXT, **EVERYTHING)
    with warnings_are_errors():
        check_env_sb3(env, warn=True)
    with warnings_are_errors():
        warnings.filterwarnings("ignore", message=".*is different from the unwrapped version")  # said of every wrapper
        check_env(env, skip_render_check=True)


def test_pickle_and_json_make_the_same_wrapper(controller_file):
    env = gym.make("HumanoidLatent-v0", **arguments("HumanoidLatent-v0", controller_file))
    env = TextReward(env, TEXT, **EVERYTHING)
    action = np.full(64, 0.2)
    expected = env.reset(seed=1), env.step(action)
    specification = env.spec.to_json()
    assert json.loads(specification)["additional_wrappers"][-1]["kwargs"]["text"] == TEXT
    for other in (pickle.loads(pickle.dumps(env)), gym.make(EnvSpec.from_json(specification))):
        assert_same((other.reset(seed=1), other.step(action)), expected)


def test_joint_level_humanoids_can_be_wrapped_before_their_actions(controller_file):
    shared = {"num_threads": 1}
    joints = TextReward(gym.make("HumanoidJoints-v0", **shared), TEXT, reward="delta", encoder="small")
    env = LatentAction(joints, str(controller_file))
    made = gym.make(
        "HumanoidText-v0", text=TEXT, reward="delta", encoder="small", controller=str(controller_file), **shared
    )
    env.reset(seed=0), made.reset(seed=0)
    action = np.full(64, 0.3)
    assert env.step(action)[1] == pytest.approx(made.step(action)[1], abs=1e-5)
