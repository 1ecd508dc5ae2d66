"""What the evaluation of a controller says, on cases whose answer is known: two stand-in controllers, and the bundled one."""

import json

import numpy as np
import pytest

from agents.cli import main
from agents.controller.bars import BARS, bars
from agents.controller.card import model_card
from agents.controller.evaluate import evaluate_controller
from agents.controller.fidelity import (
    MotionClassifier,
    evaluate_naming,
    evaluate_smoothness,
    evaluate_symmetry,
)
from agents.controller.reference import ReferenceMotions
from agents.controller.robustness import evaluate_get_up, evaluate_interpolation, evaluate_pushes, evaluate_random
from agents.controller.rollout import Performance, falls, held, perform, start
from agents.controller.selection import (
    get_up_clips,
    on_feet_clips,
    quiet_clips,
    standing_clips,
    steering_clips,
    unmirrored_clips,
    walking_clips,
    window_frames,
)
from agents.controller.steering import evaluate_steering, travel
from anyskill_envs.controller import LowLevelController, MotionEncoder, contract
from motion_data.authored import authored_clips
from motion_data.clip import MotionClip
from motion_data.skeleton import kinematics, rest_qpos

AUTHORED = {clip.name: clip for clip in authored_clips()}


def gliding(name="walk"):
    """The rest pose, moving along x at 1 m/s as a loop."""
    qpos = np.tile(rest_qpos(), (31, 1))
    qpos[:, 0] = np.arange(31) / 30
    return MotionClip(name, qpos, loop=True, categories=("move_around", "usual"))


def rising(name, down):
    """From lying to standing in 2 s; the body turns about y."""
    qpos = np.tile(rest_qpos(), (61, 1))
    angle = np.linspace(np.pi / 2 if down else -np.pi / 2, 0, 61)
    qpos[:, 3], qpos[:, 5] = np.cos(angle / 2), np.sin(angle / 2)
    qpos[:, 2] = np.linspace(0.15, qpos[0, 2], 61)
    return MotionClip(name, qpos)


@pytest.fixture(scope="module")
def motions():
    clips = [AUTHORED[name] for name in ("stand", "wave_right_hand", "squat", "step_left", "turn_left")]
    return ReferenceMotions([*clips, gliding(), rising("front_up", True), rising("back_up", False)])


@pytest.fixture(scope="module")
def bundled():
    return LowLevelController.load(num_threads=1), MotionEncoder.load(num_threads=1)


class Standing:
    """Holds the rest pose: it stands while nobody pushes it."""

    def act(self, observation, latent):
        return np.tile(rest_qpos()[7:].astype(np.float32), (len(observation), 1))


class FirstAxis:
    """An encoder whose latents all are the same."""

    def encode(self, windows):
        return np.tile(np.eye(64, dtype=np.float32)[:1], (len(windows), 1))


def names(motions, clips):
    return {motions.names[clip] for clip in clips}


def test_clips_are_selected_by_their_motion(motions):
    assert names(motions, standing_clips(motions)) == {"stand", "wave_right_hand", "squat"} - (
        set() if motions.upright[motions.clip_of_frame == 2].all() else {"squat"}
    )
    assert names(motions, quiet_clips(motions)) == {"stand"}
    assert names(motions, walking_clips(motions)) == {"walk"}
    assert (
        {"walk", "step_left", "turn_left"}
        <= names(motions, steering_clips(motions))
        <= names(motions, on_feet_clips(motions))
    )
    assert {side: names(motions, clips) for side, clips in get_up_clips(motions).items()} == {
        "front": {"front_up"},
        "back": {"back_up"},
    }
    mirrored = ReferenceMotions([AUTHORED["salute"], AUTHORED["salute"].mirrored()])
    assert names(mirrored, unmirrored_clips(mirrored)) == {"salute"}
    assert not len(window_frames(motions, np.zeros(0, int)))


def test_without_a_push_it_stands_and_a_violent_one_throws_it_over(bundled):
    alone = ReferenceMotions([AUTHORED["stand"]])
    for force, expected in ((0.0, 0.0), (3000.0, 1.0)):
        assert evaluate_pushes(*bundled, alone, force, episodes=2) == {"standing": expected, "walking": None}


def test_who_only_holds_a_pose_does_not_get_up(motions):
    result = evaluate_get_up(Standing(), FirstAxis(), motions, seconds=1, episodes=2)
    assert (result["front"], result["back"]) == (0.0, 0.0)
    assert set(result["clips"].values()) == {0.0}
    alone = ReferenceMotions([AUTHORED["stand"]])
    assert evaluate_get_up(Standing(), FirstAxis(), alone) == {"front": None, "back": None, "clips": {}}


def test_what_has_fallen_is_left_alone(motions):
    frames = np.repeat(motions.starts[motions.names.index("stand")], 3)
    simulation = start(motions, frames, None)
    simulation.qpos[1, 2:7] = [0.3, np.sqrt(0.5), 0, np.sqrt(0.5), 0]  # face down on the floor
    simulation.refresh()
    seen = []
    fell = falls(Standing(), simulation, held(np.zeros((3, 64))), 0.2, seen.append)
    assert fell.tolist() == [False, True, False] and seen == list(range(6))


def test_balance_of_the_bundled_controller(motions, bundled):
    """It stands under standing latents and between two of them; noise draws are those of the seed."""
    assert evaluate_interpolation(*bundled, motions, seconds=2, episodes=6) <= 0.2
    one, two = (evaluate_random(*bundled, motions, seconds=1, episodes=5, uniform=True) for _ in range(2))
    assert one == two
    only = ReferenceMotions([gliding()])
    with pytest.raises(ValueError, match="no clip stands"):
        evaluate_random(*bundled, only, seconds=1, episodes=2)
    assert evaluate_interpolation(*bundled, only) is None


def perfect(motions, clips):
    """A record of exactly the reference."""
    lengths = motions.lengths[clips]
    frames = motions.starts[clips][:, None] + np.minimum(np.arange(lengths.max()), lengths[:, None] - 1)
    qpos = motions.qpos[frames]
    poses = [kinematics(one) for one in qpos]
    return Performance(
        clips, lengths, qpos, np.stack([p.positions for p in poses]), np.stack([p.quaternions for p in poses])
    )


def test_the_reference_itself_is_named_and_as_smooth_as_itself(motions):
    record = perfect(motions, unmirrored_clips(motions))
    result = evaluate_naming(record, motions)
    assert result["top1"] == 1 and not result["taken_for"] and set(result["named"]) == set(motions.names)
    smooth = evaluate_smoothness(record, motions)
    assert smooth["jerk"]["ratio"] == pytest.approx(1) and smooth["foot_skate"]["ratio"] == pytest.approx(1)


def test_a_collapsed_controller_is_found_out(motions):
    """It does the same whatever the clip, so at most one clip is named right."""
    clips = np.array([motions.names.index(name) for name in ("stand", "wave_right_hand", "squat", "turn_left")])
    record = perform(Standing(), FirstAxis(), motions, clips, limit=90)
    result = evaluate_naming(record, motions)
    assert result["top1"] <= 0.25 and len(result["taken_for"]) >= 3


def test_the_classifier_takes_the_clip_nearest_over_all_windows():
    windows = np.zeros((4, 60, 39), np.float32)
    windows[1] += 1
    windows[2:] += 3
    classifier = MotionClassifier(windows, np.array([5, 5, 9, 9]))
    motion = np.stack([windows[0], windows[1], windows[2] - 0.1])
    assert classifier.classify(motion, np.array([0, 0, 1])).tolist() == [5, 9]


def test_symmetry(motions, bundled):
    assert evaluate_symmetry(Standing(), FirstAxis(), motions, samples=20) == pytest.approx(0, abs=1e-4)
    assert 0 < evaluate_symmetry(*bundled, motions, samples=50) < 15


def test_travel_is_measured_in_the_heading_frame():
    time = np.arange(61) / 30
    north = np.stack([0 * time, time, 0 * time + np.pi / 2], 1)  # forward along y
    crab = np.stack([0 * time, -0.5 * time, 0 * time], 1)
    circle = np.stack([np.sin(2 * time), 1 - np.cos(2 * time), (2 * time + np.pi) % (2 * np.pi) - np.pi], 1)
    reached = travel(np.stack([north, crab, circle]))
    np.testing.assert_allclose(reached, [[1, 0, 0], [0, -0.5, 0], [2, 0, np.degrees(2)]], atol=2e-3)


def test_steering_reports_what_stands_still_as_not_moving(motions):
    result = evaluate_steering(Standing(), FirstAxis(), motions)
    row = result["clips"]["walk"]
    assert row["reference_forward"] == pytest.approx(1, abs=0.02)
    assert row["forward"] is None or row["forward"] < 0.5
    nothing = evaluate_steering(Standing(), FirstAxis(), ReferenceMotions([AUTHORED["stand"]]))
    assert nothing["fastest"] == {} and nothing["largest_gap"] is None


def test_bars_take_the_worst_of_their_measurements():
    result = {
        "push_falls": {"standing": 0.1, "walking": 0.2},
        "get_up": {"front": 0.9, "back": None, "clips": {"front_up": 0.9}},
        "uniform_falls": 0.25,
    }
    rows = {row["name"]: row for row in bars(result)}
    assert len(rows) == len(BARS)
    push, up, uniform = (
        next(row for name, row in rows.items() if word in name) for word in ("push", "lying", "uniform")
    )
    assert push["value"] == 0.2 and push["met"] is False
    assert up["value"] is None and up["met"] is None
    assert uniform["met"] is True


def test_the_whole_result_is_json_and_makes_a_card():
    motions = ReferenceMotions([AUTHORED["stand"], AUTHORED["nod"]])
    measured = evaluate_controller(Standing(), FirstAxis(), motions, episodes=1)
    result = json.loads(json.dumps(measured, allow_nan=False))
    assert set(result["clips"]) == {"stand", "nod"} == set(result["naming"]["named"])
    assert result["push_falls"]["walking"] is None and result["summary"]["in_place"]["clips"] == 2
    details = {"training_data": "two clips", "licence": "MIT", "version": "0.1"}
    card = model_card(result, contract("low_level_controller", **details), 1, "none")
    assert "| stand |" in card and "not measured" in card and "| uniform" not in card.split("## Bars")[0]


def test_strips_show_reference_and_simulation(tmp_path, capsys):
    image = pytest.importorskip("PIL.Image")
    AUTHORED["nod"].save(tmp_path / "clips" / "nod.npz")
    strips = tmp_path / "strips"
    words = ["controller", "show", "--clips", str(tmp_path / "clips"), "--output", str(strips), "--frames", "2"]
    assert main([*words, "--pages", str(tmp_path / "pages")]) == 0
    assert image.open(tmp_path / "pages" / "page_1.webp").width == 2 * (640 + 14)
    assert "nod.png" in capsys.readouterr().out
    pixels = np.asarray(image.open(strips / "nod.png"))
    assert pixels.shape == (400, 2 * 164 - 4, 3)
    # At first both rows show the same pose.
    first = pixels[:, :160].reshape(2, 200, 160, 3)[:, 20:]
    np.testing.assert_allclose(first[0].astype(int), first[1], atol=40)
    assert main([*words, "--clip", "nothing"]) == 2
    assert "Unknown clip 'nothing'" in capsys.readouterr().err
