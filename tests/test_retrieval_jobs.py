"""Training, evaluating and steering retrieval, from the user's side."""

import json
from pathlib import Path

import numpy as np
import pytest
from envs_common import arguments, walk_clip
from stable_baselines3 import PPO

from agents.retrieval.config import RetrievalConfig, named_databases
from agents.retrieval.evaluate import as_table, evaluate, evaluate_retrievers
from agents.retrieval.play import DOWN, ENTER, LEFT, UP, Steering, play
from agents.retrieval.retriever import load_retriever, unlearned
from agents.retrieval.sudden_change import sudden_change
from agents.retrieval.train import train
from anyskill_envs.controller import ENCODER_FILE
from anyskill_envs.retrieval import RetrievalLocomotionVectorEnv
from anyskill_envs.retrieval_observation import RETRIEVAL_OBSERVATION_SIZE
from motion_data.retrieval import MotionDatabase

ID = "RetrievalLocomotion-v0"


@pytest.fixture(scope="module")
def controller(controller_file) -> Path:
    """A controller that stands, with a motion encoder beside it, and a database."""
    options = arguments(ID, controller_file)
    file = Path(options["controller"])
    (file.parent / ENCODER_FILE.name).write_bytes(ENCODER_FILE.read_bytes())
    return file


@pytest.fixture(scope="module")
def database(controller) -> str:
    return str(controller.parent / "walk.npz")


@pytest.fixture(scope="module")
def run(controller, database, tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs") / "retrieval"
    options = {"databases": (f"walk={database}",), "output": folder, "controller": controller, "progress": False}
    small = {
        "num_envs": 4,
        "decisions_per_update": 4,
        "batch_size": 16,
        "epochs": 1,
        "hidden": (16,),
        "evaluation_episodes": 2,
    }
    config = RetrievalConfig(minutes=0.05, **options, **small)
    assert train(config) == 0
    return folder, config


def test_a_run_leaves_a_retriever_that_plays_without_torch(run):
    folder, _ = run
    report = json.loads((folder / "report.json").read_text())
    assert set(report["evaluation"]["rows"]) == {"un-learned", "trained"}
    assert (folder / "curve.png").stat().st_size > 1000
    assert {"velocity_error", "reward", "falls", "action_size"} <= set(report["history"][0])
    observations = np.random.default_rng(0).normal(size=(5, RETRIEVAL_OBSERVATION_SIZE)).astype(np.float32)
    expected, _ = PPO.load(folder / "policy.zip", device="cpu").predict(observations, deterministic=True)
    np.testing.assert_allclose(load_retriever(folder)(observations), expected, atol=1e-5)
    np.testing.assert_allclose(load_retriever(folder / "policy.zip")(observations), expected, atol=1e-6)


def test_the_retriever_that_earned_most_without_exploration_is_kept(run):
    folder, _ = run
    training = json.loads((folder / "report.json").read_text())["training"]
    assert training["kept"]["reward"] == max(play["reward"] for play in training["plays"])
    kept, best = (PPO.load(folder / name, device="cpu").policy.state_dict() for name in ("policy.zip", "best.zip"))
    for name, weights in best.items():
        np.testing.assert_array_equal(kept[name], weights)


def test_a_run_is_resumed_and_never_overwritten_by_accident(run):
    folder, config = run
    with pytest.raises(FileExistsError, match="--resume"):
        train(config)
    before = json.loads((folder / "report.json").read_text())["training"]["decisions"]
    assert train(RetrievalConfig(output=folder, minutes=0.1, resume=True, progress=False, evaluation_episodes=2)) == 0
    report = json.loads((folder / "report.json").read_text())
    assert report["training"]["decisions"] > before
    assert report["config"]["num_envs"] == 4


def test_evaluation_measures_what_it_says(controller, database):
    """A controller that stands misses each goal by its speed, and does not fall."""
    options = {"databases": {"walk": database}, "controller": controller, "goal_speed": (1.5, 1.5), "num_threads": 1}
    result = evaluate_retrievers({"un-learned": unlearned}, options, episodes=3, seconds=2)
    row = result["rows"]["un-learned"]
    assert row["velocity_error"] == pytest.approx(1.5, abs=0.1)
    assert row["terminated"] == 0 and row["length"] == 1
    assert row["frechet"] > result["real"]["frechet"] > 0
    assert row["most_used_clips"] == {"glide": 1.0}
    assert "| un-learned | 1.5" in as_table(result)
    sudden = sudden_change(unlearned, options, seed=0, humanoids=2)
    assert len(sudden["seconds"]) == len(sudden["speed"]) == 12 * 30
    assert np.ptp(sudden["goal"]) == pytest.approx(np.diff(sudden["slowest_and_fastest"])[0])


def test_an_evaluation_in_which_all_fall_at_once_says_so(controller, database):
    options = {"databases": {"walk": database}, "controller": controller, "minimum_head_height": 3.0, "num_threads": 1}
    result = evaluate_retrievers({"un-learned": unlearned}, options, episodes=3, seconds=2)
    row = result["rows"]["un-learned"]
    assert row["terminated"] == 1 and row["length"] == pytest.approx(1 / 60)
    assert row["frechet"] is None and row["multimodality"] is None
    json.dumps(result, allow_nan=False)
    assert "| - | - |\n\n-: too many episodes of un-learned ended within 0.5 s" in as_table(result)
    assert sudden_change(unlearned, options, seed=0, humanoids=2)["fell"] == 1


def test_the_command_prints_json_alone(controller, database, capsys, tmp_path):
    evaluate(databases=(database,), controller=controller, episodes=2, seconds=1, json=True)
    assert json.loads(capsys.readouterr().out)["rows"]["un-learned"]["terminated"] == 0
    with pytest.raises(FileNotFoundError, match="train-retrieval"):
        evaluate(retrievers=(tmp_path / "nothing",))


def test_keys_steer(controller, database):
    other = MotionDatabase.from_clips([walk_clip("other", 0.4)])
    env = RetrievalLocomotionVectorEnv(
        databases={"walk": database, "other": other}, controller=controller, goal_seconds=None
    )
    steering = Steering(env.databases, speed=1.0)
    env.reset(seed=0)
    assert all(steering.press(key) for key in (UP, UP, LEFT, LEFT, ord("2")))
    assert not steering.press(ord("9")) and not steering.press(ord("Q"))
    steering.apply(env)
    info = env.step(unlearned(np.zeros((1, 1))))[4]
    np.testing.assert_allclose(info["goal_velocity"][0], 1.5 * np.array([np.cos(np.pi / 6), 0.5]), atol=1e-9)
    assert info["database"][0] == "other" and info["clip"][0] == "other"
    for _ in range(100):
        steering.press(DOWN)
    assert steering.speed == 0
    assert steering.press(ENTER) and steering.take_start() and not steering.take_start()


def test_play_writes_a_video(controller, database, tmp_path):
    target = tmp_path / "film.mp4"
    assert play(databases=(database,), controller=controller, video=target, seconds=0.34) == 0
    assert target.stat().st_size > 1000
    with pytest.raises(ValueError, match="mp4"):
        play(video=tmp_path / "film.gif")


def test_options_are_checked():
    assert named_databases(["a=x*", "folder/zombie.npz"]) == {"a": "x*", "zombie": "folder/zombie.npz"}
    with pytest.raises(ValueError, match="Two databases are named 'a'"):
        RetrievalConfig(databases=("a=x", "a=y"))
    with pytest.raises(ValueError, match="minutes"):
        RetrievalConfig(minutes=0)
    with pytest.raises(ValueError, match="batch_size"):
        RetrievalConfig(num_envs=2)
