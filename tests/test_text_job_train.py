"""The main job from options to report, on small models: what it writes, how it resumes, and what it refuses."""

import dataclasses
import json

import envs_common  # noqa: F401  (registers the encoder "small")
import gymnasium as gym
import numpy as np
import onnx
import pytest
from gymnasium.spaces import Box
from gymnasium.vector.utils import batch_space
from stable_baselines3 import PPO

from agents.sb3 import VectorEnvAdapter
from agents.text import checks
from agents.text.candidates import Candidate
from agents.text.clock import CLOCK_SIZE, ClockedPolicy, with_clock
from agents.text.config import TrainConfig
from agents.text.evaluate import judge, load_rollouts, run_episodes
from agents.text.export import OnnxPolicy, parity_error
from agents.text.monitor import TextMonitor
from agents.text.play import play
from agents.text.report import PANELS, similarity_ends
from agents.text.search import SETTLE_DECISIONS, Earnings, search, summary
from agents.text.shaping import EpisodeClock
from agents.text.steering import SteeredCandidate
from agents.text.train import make_environment, search_start, train
from agents.text.warm_start import policy_earnings, warm_start
from agents.training.monitor import load_checkpoint
from agents.training.report import plot_curve
from agents.training.run import make_model
from agents.training.run_folder import RunFolder, slug
from anyskill_envs.objects.scene import Scene
from motion_data.files import write_whole
from motion_data.skeleton import joint_index, rest_qpos

TEXT = "raise both arms above the head"


def small_config(folder, controller, **changes):
    options = {
        "text": TEXT, "output": folder, "minutes": 0.05, "num_envs": 8, "batch_size": 64, "hidden": (16,),
        "encoder": "small", "controller": controller, "evaluation_episodes": 2, "warm_start": "none", "progress": False,
        "video": False,
    }  # fmt: skip
    return TrainConfig(**(options | changes))


@pytest.fixture(scope="module")
def finished(tmp_path_factory, controller_file):
    """A finished run of three seconds, with search and video."""
    config = small_config(tmp_path_factory.mktemp("runs") / "arms", controller_file, video=True, num_envs=16)
    assert train(config) == 0
    return RunFolder(config.output), config


def test_a_run_writes_all_it_promises(finished):
    folder, config = finished
    for path in (folder.config, folder.checkpoint, folder.policy, folder.onnx, folder.curve, folder.report):
        assert path.stat().st_size > 0
    assert list(folder.tensorboard.iterdir())
    assert not list(folder.path.glob(".*partial*"))
    report = json.loads(folder.report.read_text())
    assert report["text"] == TEXT
    assert report["config"]["seed"] == config.seed
    assert report["training"]["decisions"] == PPO.load(folder.policy).num_timesteps > 0
    assert report["training"]["controller_steps"] == 5 * report["training"]["decisions"]
    assert report["training"]["controller_steps_per_second"] > 0
    assert report["evaluation"]["episodes"] == 2
    assert report["evaluation"]["check"].startswith("Both hands")
    assert 0 <= report["evaluation"]["fall_rate"] <= 1
    assert {"seconds", "decisions", "similarity", "reward", "falls"} <= report["history"][0].keys()
    assert report["video"] == "video.mp4"


def test_the_policy_that_earned_most_without_exploration_is_kept(finished):
    folder, _ = finished
    training = json.loads(folder.report.read_text())["training"]
    assert len(training["plays"]) >= 2
    assert training["kept"]["reward"] == max(play["reward"] for play in training["plays"])
    kept, best = PPO.load(folder.policy).policy.state_dict(), PPO.load(folder.best).policy.state_dict()
    for name, weights in best.items():
        np.testing.assert_array_equal(kept[name], weights)


def test_the_evaluation_episodes_are_recorded(finished):
    folder, _ = finished
    episodes = load_rollouts(folder.rollouts)
    evaluation = json.loads(folder.report.read_text())["evaluation"]
    assert [round(len(episode.qpos) / 30, 2) for episode in episodes] == evaluation["seconds"]
    assert np.mean([episode.success for episode in episodes]) == evaluation["success_rate"]
    assert np.mean([episode.similarity for episode in episodes]) == pytest.approx(evaluation["similarity"])
    for episode in episodes:
        assert episode.observations.shape == (len(episode.qpos), 223)
        np.testing.assert_allclose(episode.observations[:, 0], episode.qpos[:, 2], atol=1e-5)  # pelvis height
    with pytest.raises(FileNotFoundError, match="not finished"):
        load_rollouts(folder.path / "nothing.npz")


def test_the_video_can_be_read_and_is_as_long_as_the_episode(finished):
    import imageio_ffmpeg

    folder, _ = finished
    meta = next(imageio_ffmpeg.read_frames(str(folder.video)))
    report = json.loads(folder.report.read_text())
    assert meta["size"] == (854, 480)
    assert meta["duration"] == pytest.approx(report["evaluation"]["seconds"][0], abs=0.1)


def test_the_exported_policy_acts_as_the_model(finished):
    folder, config = finished
    model = PPO.load(folder.policy)
    observations = np.random.default_rng(0).normal(0, 3, (50, 283)).astype(np.float32)
    assert parity_error(model, folder.onnx, observations) <= 1e-5
    for count in (1, 7):  # any batch size
        assert OnnxPolicy(folder.onnx)(observations[:count]).shape == (count, 64)
    contract = OnnxPolicy(folder.onnx).contract
    assert contract["text"] == TEXT
    assert contract["latent_size"] == "64"
    assert len(contract["controller_sha256"]) == 64


def test_an_exported_policy_that_differs_is_refused(finished):
    folder, config = finished
    other = make_model(dataclasses.replace(config, seed=5, batch_size=32), make_environment(config, 2))
    with pytest.raises(RuntimeError, match="differs"):
        parity_error(other, folder.onnx, np.ones((3, 283), np.float32))


def test_a_file_that_is_no_policy_is_refused(tmp_path, controller_file):
    with pytest.raises(ValueError, match="no text policy"):
        OnnxPolicy(controller_file)
    (tmp_path / "policy.onnx").write_bytes(b"not an ONNX file")
    with pytest.raises(ValueError, match="no readable ONNX"):
        OnnxPolicy(tmp_path / "policy.onnx")
    with pytest.raises(FileNotFoundError, match="anyskill train"):
        OnnxPolicy(tmp_path / "missing.onnx")


def test_a_policy_for_another_observation_is_refused(finished, tmp_path):
    folder, _ = finished
    proto = onnx.load(folder.onnx)
    metadata = OnnxPolicy(folder.onnx).contract | {"observation_size": "7"}
    onnx.helper.set_model_props(proto, metadata)
    onnx.save(proto, tmp_path / "policy.onnx")
    with pytest.raises(ValueError, match="train the policy again"):
        OnnxPolicy(tmp_path / "policy.onnx")


def test_an_existing_run_is_neither_touched_nor_resumed_unasked(finished):
    folder, config = finished
    before = folder.report.read_bytes()
    with pytest.raises(FileExistsError, match="--resume.*--overwrite"):
        train(config)
    assert folder.report.read_bytes() == before


def test_resuming_goes_on_where_the_checkpoint_stands(tmp_path, controller_file):
    config = small_config(tmp_path / "run", controller_file)
    train(config)
    folder = RunFolder(config.output)
    env = make_environment(config, config.num_envs)
    model, progress = load_checkpoint(folder.checkpoint, env)
    first = json.loads(folder.report.read_text())
    assert progress["history"] == first["history"]
    assert model.policy.optimizer.state_dict()["state"]  # Adam's moments came along

    # The options of the run count, not the defaults of the new command; only the time is new.
    train(TrainConfig(TEXT, output=config.output, resume=True, minutes=0.1, video=False, progress=False))
    second = json.loads(folder.report.read_text())
    assert second["history"][: len(first["history"])] == first["history"]
    assert second["training"]["decisions"] > first["training"]["decisions"]
    assert second["training"]["minutes"] == pytest.approx(0.1, abs=0.03)
    assert second["config"]["num_envs"] == config.num_envs


def test_resuming_needs_the_same_text_and_a_checkpoint(finished, tmp_path):
    folder, config = finished
    with pytest.raises(ValueError, match="choose another --output"):
        train(dataclasses.replace(config, text="squat down", resume=True))
    with pytest.raises(FileNotFoundError, match="no checkpoint"):
        train(dataclasses.replace(config, output=tmp_path / "empty", resume=True))


def test_a_broken_checkpoint_is_named(tmp_path, controller_file):
    config = small_config(tmp_path / "run", controller_file)
    folder = RunFolder(config.output)
    folder.prepare(resume=False, overwrite=False)
    folder.checkpoint.write_bytes(b"half a file")
    with pytest.raises(ValueError, match="--overwrite"):
        load_checkpoint(folder.checkpoint, make_environment(config, 2))


def test_overwriting_starts_anew(tmp_path, controller_file):
    config = small_config(tmp_path / "run", controller_file)
    folder = RunFolder(config.output)
    folder.prepare(resume=False, overwrite=False)
    folder.report.write_text("{}")
    (folder.path / "notes.txt").write_text("mine")
    folder.prepare(resume=False, overwrite=True)
    assert not folder.report.exists()
    assert (folder.path / "notes.txt").read_text() == "mine"


def test_an_interrupted_write_leaves_the_old_file(tmp_path):
    path = tmp_path / "file.txt"
    path.write_text("old")

    def fail(temporary):
        temporary.write_text("hal")
        raise OSError("disk full")

    with pytest.raises(OSError, match="disk full"):
        write_whole(path, fail)
    assert path.read_text() == "old"


def test_play_writes_a_video_without_torch(finished, tmp_path):
    folder, _ = finished
    target = tmp_path / "new" / "film.mp4"
    assert play(folder.path, video=target) == 0
    assert target.stat().st_size > 10_000


def test_play_refuses_what_it_cannot_do(finished, tmp_path, monkeypatch):
    folder, _ = finished
    with pytest.raises(FileNotFoundError, match="no finished run"):
        play(tmp_path)
    with pytest.raises(ValueError, match="mp4"):
        play(folder.path, video=tmp_path / "film.gif")
    with pytest.raises(ValueError, match="--video FILE.mp4 for --look mannequin"):
        play(folder.path, look="mannequin")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(RuntimeError, match="no screen"):
        play(folder.path)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"text": "  "}, "text is empty"),
        ({"minutes": 0.0}, "minutes"),
        ({"minutes": float("nan")}, "minutes"),
        ({"num_envs": 0}, "num_envs"),
        ({"seed": -1}, "seed"),
        ({"discount": 1.5}, "discount"),
        ({"alive_bonus": -1.0}, "alive_bonus"),
        ({"batch_size": 10_000}, "batch_size 10000 is more than"),
        ({"resume": True, "overwrite": True}, "exclude each other"),
    ],
)
def test_bad_options_are_refused_at_once(changes, message):
    with pytest.raises(ValueError, match=message):
        TrainConfig(**({"text": TEXT} | changes))


def test_a_reward_that_reads_no_text_reports_no_similarity(tmp_path, controller_file, capsys):
    config = small_config(tmp_path / "run", controller_file, reward="velocity")
    assert train(config) == 0
    folder = RunFolder(config.output)
    report = json.loads(folder.report.read_text())
    assert "similarity" not in report["history"][0]
    assert report["evaluation"]["similarity"] is None
    assert report["training"]["similarity"] == {"start": None, "end": None}
    assert [episode.similarity for episode in load_rollouts(folder.rollouts)] == [None, None]
    assert "similarity" not in capsys.readouterr().out


def test_ctrl_c_tells_how_to_go_on(tmp_path, controller_file, monkeypatch, capsys):
    def interrupt(self, infos):
        raise KeyboardInterrupt

    config = small_config(tmp_path / "run", controller_file)
    monkeypatch.setattr(TextMonitor, "sums_of", interrupt)
    assert train(config) == 130
    assert f"anyskill train {TEXT!r} --output {config.output} --resume" in capsys.readouterr().err


def test_unknown_rewards_and_missing_controllers_are_refused(tmp_path, controller_file):
    with pytest.raises(ValueError, match="Unknown reward 'beauty'"):
        train(small_config(tmp_path / "a", controller_file, reward="beauty"))
    with pytest.raises(FileNotFoundError, match="missing.onnx"):
        train(small_config(tmp_path / "b", tmp_path / "missing.onnx"))
    # nothing was written that would make the next attempt fail
    assert not RunFolder(tmp_path / "a").holds_run()


def test_options_survive_json(tmp_path):
    config = TrainConfig(TEXT, output=tmp_path, hidden=(8, 4), warm_start="none")
    assert TrainConfig.from_json(json.loads(json.dumps(config.to_json()))) == config


def test_folder_names():
    assert slug("Raise both arms, above the HEAD!") == "raise-both-arms-above-the-head"
    assert slug("???") == "run"


class TargetEnv(gym.vector.VectorEnv):
    """Rewards the cosine between the action and a wanted direction; the episode of an action against it ends at once.

    With two wanted directions these take turns at every decision, and the observation says whose turn it is.
    """

    def __init__(self, num_envs, *wanted):
        self.num_envs = num_envs
        self.wanted = wanted
        self.single_action_space = Box(-1, 1, wanted[0].shape, np.float32)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.single_observation_space = Box(-1, 1, (2,), np.float32)
        self.decision = 0

    def observation(self):
        turn = self.decision % len(self.wanted)
        return np.tile(np.float32([turn, 1 - turn]), (self.num_envs, 1))

    def reset(self, *, seed=None, options=None):
        self.decision = 0
        return self.observation(), {}

    def step(self, actions):
        length = np.linalg.norm(actions, axis=1)
        cosine = actions @ self.wanted[self.decision % len(self.wanted)] / length
        self.decision += 1
        return self.observation(), cosine, cosine < -0.5, np.zeros(self.num_envs, bool), {}


def directions(count):
    vectors = np.random.default_rng(3).normal(size=(count, 64))
    return (vectors / np.linalg.norm(vectors, axis=1, keepdims=True)).astype(np.float32)


def find(wanted, latents, names, seed=0):
    return search(TargetEnv(128, *wanted), latents, names, 0.5, np.random.default_rng(seed))


HELD_LATENTS = directions(40)
HELD_NAMES = [f"clip_{index}" for index in range(40)]
BETWEEN = (HELD_LATENTS[17] + 0.6 * HELD_LATENTS[30]) / np.linalg.norm(HELD_LATENTS[17] + 0.6 * HELD_LATENTS[30])


def test_the_search_improves_on_the_best_of_the_library():
    result = find([BETWEEN], HELD_LATENTS, HELD_NAMES)
    assert np.linalg.norm(result.held.latents) == pytest.approx(1, abs=1e-5)
    assert next(iter(result.library_rewards)) == "clip_17"
    assert "clip_17" in result.held.name
    assert result.held.reward == pytest.approx(float(result.held.latents[0] @ BETWEEN), abs=1e-5)
    assert result.held.reward > result.library_rewards["clip_17"] + 0.03
    assert all(later >= earlier for earlier, later in zip(result.curve, result.curve[1:], strict=False))


def test_the_search_finds_the_clip_whose_rhythm_earns_most():
    wanted = directions(42)[40:]
    latents = np.concatenate([HELD_LATENTS, wanted])
    result = find(wanted, latents, [*HELD_NAMES, "wave", "wave"])
    assert result.played.name == "wave"
    assert result.played.reward > 0.95 > result.held.reward + 0.2


def test_the_search_finds_a_rhythm_that_no_clip_has():
    result = find(HELD_LATENTS[[5, 9]], HELD_LATENTS, HELD_NAMES)
    assert {"clip_5", "clip_9"} <= set(result.played.name.split(" + "))
    assert result.played.reward > result.held.reward + 0.1


def test_the_search_repeats_itself_for_the_same_seed():
    first, again, other = (find([BETWEEN], HELD_LATENTS, HELD_NAMES, seed).held.latents for seed in (4, 4, 5))
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)


def test_a_fall_costs_the_bonus_from_then_on():
    earnings = Earnings(2, alive_bonus=0.5)
    no = np.zeros(2, bool)
    for _ in range(SETTLE_DECISIONS):
        earnings.add(np.array([9.0, 9.0]), no)
    earnings.add(np.array([-0.2, -0.2]), np.array([True, False]))
    earnings.add(np.array([-0.2, -0.2]), no)
    np.testing.assert_allclose(earnings.means(), [-0.35, -0.2])
    assert earnings.mean_while_up == pytest.approx(-0.2)


def test_the_bonus_is_for_decisions_without_a_fall(tmp_path, controller_file):
    env = make_environment(small_config(tmp_path, controller_file, alive_bonus=3.0, discount=0.8), 4)
    env.seed(0)
    env.reset()
    rng = np.random.default_rng(0)
    for _ in range(61):
        _, rewards, dones, infos = env.step(rng.uniform(-1, 1, (4, 64)).astype(np.float32))
        own = [sum(value for name, value in info.items() if name.startswith("reward_")) for info in infos]
        fell = [bool(done and not info["TimeLimit.truncated"]) for done, info in zip(dones, infos, strict=True)]
        np.testing.assert_allclose(rewards, 0.2 * (np.array(own) + np.where(fell, 0.0, 3.0)), atol=1e-5)


def test_the_clock_runs_with_each_episode(tmp_path, controller_file):
    env = make_environment(small_config(tmp_path, controller_file), 2)
    env.seed(0)
    times = [env.reset()[:, -CLOCK_SIZE:].argmax(1)]
    for _ in range(61):
        observation, _, dones, infos = env.step(np.zeros((2, 64), np.float32))
        times.append(observation[:, -CLOCK_SIZE:].argmax(1))
        for index in np.flatnonzero(dones):
            assert infos[index]["terminal_observation"].shape == (223 + CLOCK_SIZE,)
            assert times[-1][index] == 0
    assert [time[0] for time in times[:4]] == [0, 1, 2, 3]
    assert env.observation_space.contains(observation[0])


def test_a_clocked_policy_counts_its_decisions():
    seen = []
    policy = ClockedPolicy(lambda observation: seen.append(observation) or observation[:, :64])
    for _ in range(3):
        policy(np.zeros((2, 223), np.float32))
    assert [array[:, 223:].argmax(1).tolist() for array in seen] == [[0, 0], [1, 1], [2, 2]]


def test_the_search_stops_when_its_time_is_over():
    env = TargetEnv(32, BETWEEN)
    result = search(env, HELD_LATENTS, HELD_NAMES, 0.5, np.random.default_rng(0), seconds=0.0)
    assert len(result.curve) == 1
    assert result.held.name == "clip_17"


def test_a_run_too_short_for_one_update_still_has_a_curve(tmp_path):
    plot_curve(tmp_path / "curve.png", [], "nothing", PANELS)
    assert (tmp_path / "curve.png").stat().st_size > 0
    assert similarity_ends([]) == {"start": None, "end": None}


def test_the_search_needs_latents():
    with pytest.raises(ValueError, match="at least one latent"):
        find([BETWEEN], np.zeros((0, 64), np.float32), [])


def untrained(env):
    env.metadata = {"autoreset_mode": gym.vector.AutoresetMode.SAME_STEP}
    return PPO("MlpPolicy", EpisodeClock(VectorEnvAdapter(env)), n_steps=8, batch_size=64, seed=0, device="cpu",
               policy_kwargs={"log_std_init": -3.0})  # fmt: skip


def test_a_policy_starts_from_a_held_latent():
    env = TargetEnv(32, BETWEEN)
    model = untrained(env)
    report = warm_start(model, env, HELD_LATENTS, np.array(HELD_NAMES), 0.5, seed=0)
    action, _ = model.predict(with_clock(env.reset()[0], 0), deterministic=True)
    assert report["start"] == "held"
    assert action[0] @ BETWEEN / np.linalg.norm(action[0]) == pytest.approx(report["reward"], abs=0.02)


def test_a_policy_starts_from_a_played_clip_by_imitation():
    wanted = directions(42)[40:]
    env = TargetEnv(32, *wanted)
    model = untrained(env)
    latents = np.concatenate([HELD_LATENTS, wanted])
    report = warm_start(model, env, latents, np.array([*HELD_NAMES, "wave", "wave"]), 0.5, seed=0)
    assert report["start"] == "played"
    assert report["played"]["clip"] == "wave"
    assert policy_earnings(env, model, 0.5, np.random.default_rng(1)).means().mean() > 0.95
    # Adam has not moved yet: PPO starts fresh
    assert not model.policy.optimizer.state_dict()["state"]


def test_the_real_environment_can_be_searched(tmp_path, controller_file):
    config = small_config(tmp_path, controller_file, warm_start="search")
    env = make_environment(config, config.num_envs)
    report = search_start(config, make_model(config, env))
    assert set(report["best_of_library"]) == {"walk", "idle", "wave_right", "squat"}
    assert report["start"] in ("held", "played")


def test_episodes_are_recorded_at_controller_rate_and_repeat_themselves(controller_file):
    def still(observation):
        return np.zeros((len(observation), 64), np.float32)

    options = {"controller": str(controller_file), "encoder": "small", "terminate_when_fallen": False}
    first = run_episodes(still, TEXT, 2, seed=3, **options)
    second = run_episodes(still, TEXT, 2, seed=3, **options)
    assert [len(episode.qpos) for episode in first] == [300, 300]
    np.testing.assert_array_equal(first[0].qpos, second[0].qpos)
    assert not np.array_equal(first[0].qpos, first[1].qpos)  # different starts


def test_success_needs_the_check_and_no_fall():
    qpos = np.tile(rest_qpos(), (300, 1))
    assert judge(qpos, False, TEXT) == (False, False)
    assert judge(qpos, False, "sing a song") == (False, None)
    up = qpos.copy()
    up[:, [7 + joint_index("left_shoulder_y"), 7 + joint_index("right_shoulder_y")]] = np.radians(-170)
    assert judge(up, False, TEXT) == (False, True)
    assert judge(up, True, TEXT) == (True, False)
    up[5, 2] = 0.1 + checks.FALL_HEAD_HEIGHT - 1.5
    assert judge(up, False, TEXT) == (True, False)


def test_the_table_says_what_the_reports_say(finished, tmp_path, capsys):
    from agents.text import table

    folder, _ = finished
    report = json.loads(folder.report.read_text())
    report["evaluation"] |= {"success_rate": 0.85, "fall_rate": 0.1}
    unchecked = report | {"text": "sing", "evaluation": report["evaluation"] | {"success_rate": None}}
    rows = table.table([report, unchecked]).splitlines()
    assert rows[2].startswith(f"| {TEXT} | 85% | 10% |")
    assert rows[3].startswith("| sing | no check | 10% |")
    assert table.main([str(folder.path), str(tmp_path)]) == 0
    assert len(capsys.readouterr().out.splitlines()) == 3
    assert table.main([str(tmp_path)]) == 2


def test_who_goes_back_first_turns_until_the_object_is_behind():
    turn, stand = np.eye(4, dtype=np.float32)[:2]
    doing = Candidate(stand[None], "stand")
    going = {
        "latents": np.eye(4, dtype=np.float32)[2:3],
        "name": "walk_backward",
        "doing": doing,
        "turn": turn,
        "reach": 0.5,
    }
    back_first = SteeredCandidate(**going, back_first=True)
    left_behind, right_behind, ahead, there = back_first.act(
        0, np.float32([[-2, 0.5], [-2, -0.5], [2, -0.1], [0.2, 0]])
    )
    assert (
        right_behind @ turn > 0.1 > -0.1 > left_behind @ turn
    )  # to turn left brings what is right behind straight behind
    assert abs(ahead @ turn) > 0.5
    np.testing.assert_array_equal(there, stand)
    assert "back first" in back_first.description and "back first" not in SteeredCandidate(**going).description


def test_who_stays_goes_on_from_the_beginning_of_what_is_done_there():
    walk, first, second = np.eye(4, dtype=np.float32)[:3]
    candidate = SteeredCandidate(
        latents=walk[None],
        name="walk",
        doing=Candidate(np.stack([first, second]), "kick"),
        turn=np.zeros(4, np.float32),
        reach=0.5,
        stays=True,
    )
    courses = [np.float32([[0.4, 0], [2, 0]]), np.float32([[2, 0], [0.4, 0]]), np.float32([[2, 0], [2, 0]])]
    played = [candidate.act(decision, places) for decision, places in enumerate(courses)]
    np.testing.assert_array_equal(np.stack(played, 1), [[first, second, first], [walk, first, second]])
    np.testing.assert_array_equal(candidate.act(0, courses[2]), [walk, walk])  # another episode
    assert "once" in candidate.description


class PlaceEnv(gym.vector.VectorEnv):
    """A point that walks and turns by two directions of its action; reward for standing still at the ball it sees."""

    def __init__(self, num_envs, latents, sees=True):
        self.num_envs, self.object_observation, self.scene = num_envs, sees, Scene(["ball"])
        self.walk, self.left, self.right, self.stand = latents
        self.single_action_space = Box(-1, 1, self.walk.shape, np.float32)
        self.action_space = batch_space(self.single_action_space, num_envs)

    def observation(self):
        seen = np.zeros((self.num_envs, 238), np.float32)
        seen[:, 223:225] = self.places
        return seen if self.object_observation else seen[:, :223]

    def reset(self, *, seed=None, options=None):
        bearing = np.random.default_rng(seed).uniform(-1.5, 1.5, self.num_envs)
        self.places = 2 * np.stack([np.cos(bearing), np.sin(bearing)], axis=1)
        return self.observation(), {}

    def step(self, actions):
        moved = self.places - np.stack([0.2 * np.maximum(actions @ self.walk, 0), np.zeros(self.num_envs)], axis=1)
        angle = -0.3 * (actions @ (self.left - self.right))
        cosine, sine = np.cos(angle), np.sin(angle)
        self.places = np.stack(
            [cosine * moved[:, 0] - sine * moved[:, 1], sine * moved[:, 0] + cosine * moved[:, 1]], axis=1
        )
        there = np.exp(-2 * np.linalg.norm(self.places, axis=1)) * (0.5 + 0.5 * (actions @ self.stand))
        return self.observation(), there, np.zeros(self.num_envs, bool), np.zeros(self.num_envs, bool), {}


def test_a_policy_that_sees_an_object_begins_by_walking_to_it():
    latents = np.eye(64, dtype=np.float32)[:4]
    names = ["walk", "walk_in_a_curve_left", "walk_in_a_curve_right", "stand"]
    result = search(PlaceEnv(64, latents), latents, names, 0.5, np.random.default_rng(0))
    steered = result.steered
    assert steered.reward > 1.5 * max(result.held.reward, result.played.reward if result.played else 0)
    places = np.float32([[2, 1], [2, -1], [0.05, 0.05]])
    left, right, there = steered.act(0, places)
    assert left @ (latents[1] - latents[2]) > 0.2 > -0.2 > right @ (latents[1] - latents[2])
    assert there @ latents[3] > 0.5
    assert summary(result)["steered"]["reward"] == steered.reward
    blind = search(PlaceEnv(64, latents, sees=False), latents, names, 0.5, np.random.default_rng(0), rounds=1)
    assert blind.steered is None and summary(blind)["steered"] is None
