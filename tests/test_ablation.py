"""The comparison of rewards: what is planned, how it is run, and what the report says about runs whose truth is known."""

import dataclasses
import json
import os
import sys
from html.parser import HTMLParser

import envs_common  # noqa: F401  (registers the encoder "small")
import numpy as np
import pytest
from scipy.stats import spearmanr

from agents.ablation import evaluator as evaluator_module
from agents.ablation.command import Clock, ablate
from agents.ablation.config import AblationConfig, scaled
from agents.ablation.evaluator import choose_evaluator
from agents.ablation.jobs import Job, run_jobs
from agents.ablation.measure import MEASURES_FILE, LibraryFeatures, measure_run
from agents.ablation.plan import plan
from agents.ablation.report import write_report
from agents.ablation.statistics import interval, rank_correlation
from agents.text.evaluate import Episode, save_rollouts, scene_of
from anyskill_envs.rendering import RenderingError
from motion_data.clip import MotionClip
from motion_data.library import MotionLibrary
from motion_data.skeleton import rest_qpos
from rewards.bundled import WEIGHTS_FOLDER

TEXTS = ("squat down", "sing a song")


def small_config(folder, **changes):
    options = {
        "output": folder, "rewards": ("clip", "800*delta"), "texts": TEXTS, "seeds": (0, 1), "encoder": "small",
        "progress": False, "num_envs": 8, "minutes": 0.5,
    }  # fmt: skip
    return AblationConfig(**(options | changes))


def swaying(rng, size, frames=150):
    """A humanoid whose joints sway."""
    qpos = np.tile(rest_qpos(), (frames, 1))
    phase = np.arange(frames)[:, None] / 30 * 2 * np.pi * rng.uniform(0.3, 0.6, 28) + rng.uniform(0, 6, 28)
    qpos[:, 7:] += size * np.sin(phase)
    return qpos


def pretend(run, rng, size, success):
    """Writes the folder of a finished run: two episodes that sway by a size."""
    run.folder.path.mkdir(parents=True)
    checked = run.text == "squat down"
    episodes = [
        Episode(
            qpos=swaying(rng, size),
            observations=rng.normal(size=(150, 223)).astype(np.float32),
            similarity=0.3,
            reward=0.1,
            fell=not good,
            success=good if checked else None,
        )
        for good in success
    ]
    save_rollouts(run.folder.rollouts, episodes)
    run.folder.write_json(run.folder.config, run.config.to_json())
    history = [{"decisions": 128 * (i + 1), "similarity": 0.01 * i} for i in range(20)]
    report = {
        "evaluation": {"similarity": 0.3, "reward": 0.1},
        "training": {"decisions": 2560, "minutes": 0.5},
        "history": history,
    }
    run.folder.write_json(run.folder.report, report)


@pytest.fixture(scope="module")
def library():
    rng = np.random.default_rng(0)
    return LibraryFeatures(MotionLibrary([MotionClip(f"sway_{i}", swaying(rng, 0.05)) for i in range(4)]))


@pytest.fixture(scope="module")
def finished(tmp_path_factory, library):
    """All runs but one: those of the first reward sway as the library does and succeed, the others shake and fail."""
    config = small_config(tmp_path_factory.mktemp("ablation"), seeds=(0, 1, 2, 3))
    runs = plan(config)
    rng = np.random.default_rng(1)
    for run in runs[:-1]:
        good = run.reward == "clip"
        pretend(run, rng, 0.05 if good else 0.3, [good, good and run.seed > 0])
    page = write_report(config, runs, choose_evaluator("small", "small"), ["a run ended with code 1"], library)
    return config, runs, page, json.loads((config.output / "results.json").read_text())


# What is planned


def test_options_are_checked_at_once(tmp_path):
    config = small_config(tmp_path, rewards=("clip,delta", "clip+0.5*velocity"))
    assert config.rewards == ("clip", "delta", "clip+0.5*velocity")
    assert [scaled(reward) for reward in config.rewards] == ["clip", "50*delta", "clip+0.5*velocity"]
    for changes, message in [
        ({"rewards": ("beauty",)}, "Unknown reward 'beauty'"),
        ({"rewards": ("clip", "clip+strike")}, r"clip\+strike' does not fit --env HumanoidText-v0.*HumanoidSoccer-v0"),
        ({"rewards": ("open",), "env": "HumanoidSoccer-v0"}, "'open' does not fit --env HumanoidSoccer-v0.*hinge of"),
        ({"env": "HumanoidFootball-v0"}, "no environment 'HumanoidFootball-v0' that takes a text.*HumanoidSoccer-v0"),
        ({"rewards": ("clip", "clip")}, "occurs twice"),
        ({"seeds": ()}, "at least one of seeds"),
        ({"minutes": -1.0}, "minutes must be"),
        ({"texts": (" ",)}, "text is empty"),
        ({"jobs": -1}, "jobs"),
    ]:
        with pytest.raises(ValueError, match=message):
            small_config(tmp_path, **changes)


def test_every_cell_is_a_run_that_goes_on_where_it_stands(tmp_path):
    config = small_config(tmp_path)
    runs = plan(config)
    assert len({run.folder.path for run in runs}) == len(runs) == 8
    assert [run.seed for run in runs] == [0] * 4 + [1] * 4
    words = runs[1].command()
    assert words[1:5] == ["-m", "agents.cli", "train", "squat down"]
    assert words[words.index("--reward") + 1] == "800*delta"
    assert words[words.index("--env") + 1] == "HumanoidText-v0"
    assert not {"--resume", "--overwrite"} & set(words)
    folder = runs[1].folder
    folder.path.mkdir(parents=True)
    folder.write_json(folder.config, runs[1].config.to_json())
    assert "--overwrite" in plan(config)[1].command()
    folder.checkpoint.touch()
    assert "--resume" in plan(config)[1].command()
    with pytest.raises(ValueError, match=r"minutes is 0.5, not 2.0.*choose another --output"):
        plan(dataclasses.replace(config, minutes=2.0))
    with pytest.raises(ValueError, match="punctuation"):
        plan(small_config(tmp_path / "b", texts=("squat down", "Squat, down!")))


# How it is run


def test_commands_run_side_by_side_with_one_thread_each(tmp_path):
    show = "import os, time; time.sleep(0.3); print(os.environ['OMP_NUM_THREADS'], len(os.sched_getaffinity(0)))"
    words = [show if hasattr(os, "sched_getaffinity") else "print(1, 1)", "raise SystemExit(3)", "print(1, 1)"]
    jobs = [Job(f"job {i}", [sys.executable, "-S", "-c", code], tmp_path / f"{i}.log") for i, code in enumerate(words)]
    core = sorted(os.sched_getaffinity(0))[0] if hasattr(os, "sched_getaffinity") else 0
    most = []
    outcomes = run_jobs(jobs, [core, core], lambda ended, running: most.append(len(running)))
    assert max(most) == 2
    assert {each.job.name: each.code for each in outcomes} == {"job 0": 0, "job 1": 3, "job 2": 0}
    assert jobs[0].log.read_text().split() == jobs[2].log.read_text().split() == ["1", "1"]


def test_commands_do_not_outlive_an_interruption(tmp_path):
    begun = []

    def interrupt(ended, running):
        if "here" in jobs[0].log.read_text():
            begun.append(int(jobs[0].log.read_text().split()[0]))
            raise KeyboardInterrupt

    code = "import os, time; print(os.getpid(), 'here', flush=True); time.sleep(60)"
    jobs = [Job("long", [sys.executable, "-S", "-c", code], tmp_path / "log")]
    with pytest.raises(KeyboardInterrupt):
        run_jobs(jobs, [sorted(os.sched_getaffinity(0))[0] if hasattr(os, "sched_getaffinity") else 0], interrupt)
    assert jobs[0].log.read_text().split() == [str(begun[0]), "here"]
    with pytest.raises(ProcessLookupError):
        os.kill(begun[0], 0)


def test_the_time_left_learns_from_what_has_ended():
    clock = Clock(100.0, 5, 2)
    assert clock.left([], []) == 250
    assert clock.left([], [40, 10]) == pytest.approx((60 + 90 + 300) / 2)
    assert clock.left([200.0], [50, 0]) == pytest.approx((150 + 200 + 2 * 200) / 2)
    assert clock.left([100.0] * 4, [20.0]) == 80


# What the report says


def test_intervals_hold_the_mean_and_shrink_with_more_runs():
    rng = np.random.default_rng(0)
    few, many = interval(rng.normal(3, 1, 6)), interval(rng.normal(3, 1, 200))
    for found in (few, many):
        assert found["low"] < found["mean"] < found["high"]
    assert many["high"] - many["low"] == pytest.approx(2 * 1.96 / np.sqrt(200), rel=0.15)
    assert few["high"] - few["low"] > 2 * (many["high"] - many["low"])
    assert interval([0.5] * 6 + [None])["low"] == interval([0.5] * 6)["high"] == 0.5
    assert interval([1.0])["low"] is None and interval([None, np.nan]) is None


def test_few_runs_do_not_look_surer_than_they_are():
    """Two or three seeds have no interval, and six a wider one than the plain bootstrap, which is too narrow for them."""
    assert interval([0.2, None, 0.5]) == {
        "mean": 0.35, "low": None, "high": None, "least": 0.2, "most": 0.5, "count": 2
    }  # fmt: skip
    assert interval([1.0] * 5)["low"] is None
    values = np.array([1.0, 2.0, 3.0, 5.0, 6.0, 7.0])
    found = interval(values)
    student = 2 * 2.571 * values.std(ddof=1) / np.sqrt(6)
    assert found["high"] - found["low"] == pytest.approx(student, rel=0.15)
    assert values.min() <= found["low"] < found["high"] <= values.max()
    assert rank_correlation([(float(i), float(i)) for i in range(5)]) is None


def test_rank_correlation_needs_no_straight_line():
    x = np.linspace(0, 1, 12)
    assert rank_correlation(list(zip(x, np.exp(9 * x), strict=True)))["mean"] == pytest.approx(1)
    random = np.random.default_rng(1).normal(size=(12, 2))
    random[3] = random[7]
    expected = spearmanr(random[:, 0], random[:, 1]).statistic
    assert rank_correlation(list(map(tuple, random)))["mean"] == pytest.approx(expected)
    loose = rank_correlation(list(zip(x, np.random.default_rng(0).normal(size=12), strict=True)))
    assert loose["low"] < loose["mean"] < loose["high"]
    assert rank_correlation([(1.0, 1.0), (2.0, None), (3.0, 2.0)]) is None


def test_the_numbers_are_those_of_the_episodes(finished):
    config, runs, _, results = finished
    clip, delta = (results["summary"]["rewards"][reward] for reward in config.rewards)
    assert clip["runs"] == 8 and delta["runs"] == 7
    assert clip["success"]["mean"] == pytest.approx((0.5 + 1 + 1 + 1) / 4)
    assert clip["success"]["count"] == 4  # the other text has no check
    assert delta["success"] == {"mean": 0.0, "low": None, "high": None, "least": 0.0, "most": 0.0, "count": 4}
    assert delta["fall"]["mean"] == 1 and clip["fall"]["mean"] == pytest.approx(1 / 8)
    assert delta["jerk"]["mean"] > 3 * clip["jerk"]["mean"]
    assert delta["naturalness"]["mean"] > 5 * clip["naturalness"]["mean"] > 0
    assert delta["library_distance"]["mean"] > 3 * clip["library_distance"]["mean"] > 0
    assert delta["multimodality"]["mean"] > clip["multimodality"]["mean"]
    assert clip["diversity"]["count"] == 4 and delta["diversity"]["count"] == 3  # a seed without all texts is left out
    difference = results["summary"]["differences"]["800*delta"]["jerk"]
    assert difference["count"] == 7 and difference["low"] > 0
    assert results["summary"]["differences"]["800*delta"]["success"]["low"] is None  # four pairs decide nothing
    assert results["trained_as"]["800*delta"] == "800*delta"
    assert {row["reward"] for row in results["runs"]} == set(config.rewards)


class Page(HTMLParser):
    """Tags that are open, and what the page loads from elsewhere."""

    def __init__(self):
        super().__init__()
        self.open, self.loads = [], []

    def handle_starttag(self, tag, attributes):
        if tag in ("table", "tr", "figure", "svg", "ul", "div", "body", "html"):
            self.open.append(tag)
        if tag in ("link", "script", "img", "iframe"):
            self.loads.append(attributes)

    def handle_endtag(self, tag):
        if tag in ("table", "tr", "figure", "svg", "ul", "div", "body", "html"):
            assert self.open.pop() == tag


def test_the_page_stands_alone_and_says_what_is_missing(finished):
    config, runs, page, _ = finished
    text = page.read_text()
    parser = Page()
    parser.feed(text)
    assert not parser.open and not parser.loads
    assert text.count("<svg") == 3
    assert "15 of 16 runs" in text and "Not finished: 1;" in text and "a run ended with code 1" in text
    assert "for want of an independent evaluator" in text
    assert "seen: 50 % to 100 %" in text and "800*delta (7 runs)" in text
    assert text.count('class="worse"') >= 3
    for run in runs[:-1]:
        assert f'href="{run.folder.path.relative_to(config.output).as_posix()}/"' in text


def test_a_run_is_measured_once(finished, library):
    _, runs, _, _ = finished
    file = runs[0].folder.path / MEASURES_FILE
    before = file.stat().st_mtime_ns
    judge = choose_evaluator("small", "small")
    values = measure_run(runs[0], judge, library)
    assert file.stat().st_mtime_ns == before
    other = LibraryFeatures(MotionLibrary([MotionClip("still", swaying(np.random.default_rng(5), 0.1))]))
    assert measure_run(runs[0], judge, other)["naturalness"] != values["naturalness"]
    assert file.stat().st_mtime_ns > before


def test_only_the_report(tmp_path, capsys):
    assert ablate(small_config(tmp_path, report_only=True)) == 1
    assert "nothing to report" in capsys.readouterr().err


# Who judges


def test_the_evaluator_is_taken_if_it_is_there(monkeypatch, tmp_path):
    monkeypatch.setattr(evaluator_module, "EVALUATOR_FOLDER", tmp_path / "none")
    own = choose_evaluator(None, "small")
    assert not own.independent and "encoder of the rewards, “small”" in own.note
    assert not choose_evaluator("small", "small").independent
    assert not choose_evaluator(str(WEIGHTS_FOLDER), "bundled").independent  # another name for the same
    monkeypatch.setattr(evaluator_module, "EVALUATOR_FOLDER", WEIGHTS_FOLDER)
    other = choose_evaluator(None, "small")
    assert other.independent and "no run was rewarded by" in other.note
    assert other.digest != own.digest
    with pytest.raises(ValueError, match="Unknown encoder 'nobody'"):
        choose_evaluator("nobody", "small")


def test_pictures_and_states_are_scored():
    rng = np.random.default_rng(0)
    motion = swaying(rng, 0.2, frames=30)
    seen = rng.normal(size=(30, 223)).astype(np.float32)
    judge = choose_evaluator("small", "small")
    wanted = judge.encoder.encode_text(["squat down"])[0]
    expected = 100 * (judge.encoder.encode_state(seen[::4]) @ wanted).mean()
    assert judge.scores([(motion, seen)], "squat down") == pytest.approx([expected])
    looking = choose_evaluator("small", "small", pictures=True)
    assert looking.digest != judge.digest
    try:
        (score,) = looking.scores([(motion, seen)], "squat down")
    except RenderingError as error:
        pytest.skip(str(error))
    assert -100 <= score <= 100
    scene = scene_of("HumanoidPillar-v0")
    with_pillar = np.tile(scene.rest_pose, (30, 1))
    with_pillar[:, :35] = motion
    assert looking.scores([(with_pillar, seen)], "squat down", scene) != [score]
