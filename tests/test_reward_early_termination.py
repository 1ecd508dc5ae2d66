"""Early termination: the paper's two rules on scripted similarities, single and in every autoreset mode."""

import gymnasium as gym
import numpy as np
import pytest
from envs_common import arguments, warnings_are_errors
from gymnasium.spaces import Box, Discrete
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from anyskill_envs.early_termination import EarlyTermination, VectorEarlyTermination
from anyskill_envs.latent import HumanoidLatentVectorEnv
from anyskill_envs.reward_wrappers import VectorTextReward

# Falls at the steps 2, 3, 5, 6, 7 and 8 of the episode.
SIMILARITY = [0.5, 0.4, 0.3, 0.6, 0.5, 0.4, 0.3, 0.2, 0.9, 1.0]


class Scripted(gym.Env):
    """An episode with given similarities; it observes the number of its steps."""

    observation_space = Box(0, 100, (1,), np.float32)
    action_space = Discrete(2)

    def __init__(self, similarity=SIMILARITY):
        self.similarity = similarity

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.steps = 0
        return np.zeros(1, np.float32), {"similarity": 0.0}

    def step(self, action):
        self.steps += 1
        similarity = self.similarity[self.steps - 1]
        return np.array([self.steps], np.float32), 1.0, False, self.steps == 10, {"similarity": similarity}


def ends(env, episodes=1):
    """The steps after which episodes terminate; None for those that do not."""
    found = []
    for _ in range(episodes):
        env.reset()
        terminated = truncated = False
        while not (terminated or truncated):
            observation, _, terminated, truncated, info = env.step(0)
            assert info["early_termination"] == terminated
        found.append(int(observation[0]) if terminated else None)
    return found


@pytest.mark.parametrize(
    ("rule", "patience", "expected"),
    [
        ("successive", 2, 3),
        ("successive", 3, 7),
        ("successive", 4, 8),
        ("successive", 5, None),
        ("cumulative", 3, 5),
        ("cumulative", 6, 8),
        ("cumulative", 7, None),
        ("off", 1, None),
    ],
)
def test_rules(rule, patience, expected):
    env = EarlyTermination(Scripted(), rule, patience, probability=1.0)
    assert ends(env, 2) == [expected] * 2  # the second episode starts to count anew


def test_eight_falls_end_four_of_five_episodes_and_then_the_count_starts_anew():
    falling = [1.0 - 0.1 * step for step in range(10)]
    env = EarlyTermination(Scripted(falling))
    env.reset(seed=0)
    found = ends(env, 500)
    assert set(found) == {9, None}  # 8 falls need 9 similarities; the ninth fall is the first of a new count
    assert found.count(9) / 500 == pytest.approx(0.8, abs=0.05)


@pytest.mark.parametrize("mode", list(AutoresetMode))
def test_vector_environments_are_reset_as_their_mode_says(mode):
    steady = list(np.linspace(0, 1, 10))
    envs = SyncVectorEnv([Scripted, lambda: Scripted(steady)], autoreset_mode=mode)
    envs = VectorEarlyTermination(envs, "successive", 3, probability=1.0)
    envs.reset(seed=0)
    seen = []
    for _ in range(10):
        observations, _, terminated, truncated, infos = envs.step(np.zeros(2, int))
        seen.append(observations[:, 0].tolist())
        assert infos["_early_termination"].all() or mode == AutoresetMode.SAME_STEP
        if terminated.any() or truncated.any():
            break
    assert terminated.tolist() == [True, False] and not truncated.any() and len(seen) == 7
    if mode == AutoresetMode.SAME_STEP:
        assert observations[:, 0].tolist() == [0, 7]
        assert infos["_final_obs"].tolist() == [True, False]
        assert infos["final_obs"][0] == 7 and infos["final_obs"][1] is None
        assert infos["final_info"]["similarity"][0] == 0.3
        assert infos["final_info"]["early_termination"][0] and not infos["early_termination"].any()
        after = envs.step(np.zeros(2, int))
    elif mode == AutoresetMode.NEXT_STEP:
        assert observations[:, 0].tolist() == [7, 7] and infos["early_termination"].tolist() == [True, False]
        observations, rewards, terminated, _, infos = envs.step(np.zeros(2, int))
        assert observations[:, 0].tolist() == [0, 8] and rewards.tolist() == [0, 1] and not terminated.any()
        assert infos["similarity"][0] == 0 and not infos["early_termination"].any()
        after = envs.step(np.zeros(2, int))
    else:
        observations, _ = envs.reset(options={"reset_mask": terminated})
        assert observations[:, 0].tolist() == [0, 7]
        after = envs.step(np.zeros(2, int))
    assert after[0][0, 0] == 1 and not after[2].any()


def test_humanoids_with_a_text_reward_are_given_up_and_start_anew(controller_file):
    envs = HumanoidLatentVectorEnv(3, controller=controller_file, num_threads=1, autoreset_mode="SameStep")
    envs = VectorEarlyTermination(VectorTextReward(envs, "squat", encoder="small"), "cumulative", 2, probability=1.0)
    envs.reset(seed=0)
    rng = np.random.default_rng(0)
    given_up = 0
    for _ in range(8):
        observations, _, terminated, _, infos = envs.step(rng.uniform(-1, 1, (3, 64)))
        for index in np.flatnonzero(terminated):
            given_up += 1
            assert (
                infos["final_info"]["early_termination"][index] and infos["final_info"]["controller_steps"][index] == 5
            )
            assert infos["controller_steps"][index] == 0 and infos["similarity"][index] == 0
            assert not np.array_equal(infos["final_obs"][index], observations[index])
    assert given_up


def test_conventions_and_errors(controller_file):
    env = gym.make("HumanoidText-v0", **arguments("HumanoidText-v0", controller_file))
    env = EarlyTermination(env, "cumulative")
    with warnings_are_errors():
        env.reset(seed=0)
        assert env.step(np.zeros(64, np.float32))[4]["early_termination"] is False
        assert gym.envs.registration.EnvSpec.from_json(env.spec.to_json()) == env.spec
    for kwargs, message in [
        ({"rule": "never"}, "successive"),
        ({"patience": 0}, "patience"),
        ({"probability": 2}, "prob"),
    ]:
        with pytest.raises(ValueError, match=message):
            EarlyTermination(env, **kwargs)
    blind = EarlyTermination(gym.make("CartPole-v1"))
    blind.reset()
    with pytest.raises(ValueError, match="wrap the environment in TextReward"):
        blind.step(0)
