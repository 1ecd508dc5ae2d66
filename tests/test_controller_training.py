"""The stages of controller training, each for a few seconds on one clip, and the files they write."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from safetensors.torch import load_file

from agents.controller.commands import ControllerTraining, train
from agents.controller.distill import DistillConfig, DistillTrainer
from agents.controller.evaluate import evaluate_controller
from agents.controller.export import export_student
from agents.controller.finetune import FinetuneConfig, FinetuneTrainer
from agents.controller.ppo import neighbouring_means
from agents.controller.reference import ReferenceMotions
from agents.controller.student import Student
from agents.controller.teacher import Teacher, TeacherConfig, TeacherTrainer
from agents.controller.tracking import Tracking, TrackingConfig, tracking_distance, tracking_reward
from anyskill_envs.controller import LowLevelController, MotionEncoder
from anyskill_envs.observation import OBSERVATION_LAYOUT
from motion_data.authored import authored_clips
from motion_data.floor import floor_clips
from motion_data.skeleton import BODY_NAMES, MIRROR_JOINT_SIGNS, MIRROR_JOINTS
from motion_data.window import WINDOW_MIRROR_INDEX, WINDOW_MIRROR_SIGN, window_features

SECONDS = 0.05  # minutes: three seconds of each stage


@pytest.fixture(scope="module")
def motions() -> ReferenceMotions:
    wanted = {"stand", "wave_right_hand", "squat"}
    return ReferenceMotions([clip for clip in authored_clips() if clip.name in wanted])


@pytest.fixture(scope="module")
def teacher(motions: ReferenceMotions, tmp_path_factory: pytest.TempPathFactory) -> Teacher:
    config = TeacherConfig(minutes=SECONDS, num_humanoids=32, horizon=8)
    return TeacherTrainer(motions, tmp_path_factory.mktemp("teacher"), config).train()


def test_reward_is_highest_at_the_reference(motions: ReferenceMotions) -> None:
    expected = motions.observations[10:20]
    np.testing.assert_allclose(tracking_reward(expected, expected), 1.0, atol=1e-6)
    np.testing.assert_allclose(tracking_distance(expected, expected), 0.0, atol=1e-6)
    assert (tracking_reward(expected + 0.05, expected) < 0.9).all()


def test_soles_on_the_floor_must_not_slide_more_than_those_of_the_reference(motions: ReferenceMotions) -> None:
    stand = motions.observations[motions.starts[motions.names.index("stand")] :][:1]

    def moving(body: str, speed: float, observation: np.ndarray) -> np.ndarray:
        moved = observation.copy()
        moved[:, OBSERVATION_LAYOUT["body_linear_velocities"].start + 3 * BODY_NAMES.index(body)] += speed
        return moved

    # Half of the soles' corners slide at 0.2 m/s: a mean square of 0.02.
    lost = 0.2 - 0.1 * np.exp(-200 * 0.02) - 0.1 * np.exp(-20 * 0.02)
    assert tracking_reward(moving("left_foot", 0.2, stand), stand) == pytest.approx(1 - lost, abs=0.01)
    assert tracking_reward(moving("left_hand", 0.2, stand), stand) > 0.99
    sliding = moving("left_foot", 0.2, stand)
    assert tracking_reward(sliding, sliding) > 0.99
    in_the_air = stand.copy()
    in_the_air[:, OBSERVATION_LAYOUT["root_height"]] += 0.1
    assert tracking_reward(moving("left_foot", 0.2, in_the_air), in_the_air) > 0.99


def test_what_a_window_does_not_tell_is_not_held() -> None:
    wanted = {"stand", "squat", "step_forward", "lie_on_back"}
    motions = ReferenceMotions([clip for clip in (*authored_clips(), *floor_clips()) if clip.name in wanted])
    held = {name for name, first in zip(motions.names, motions.starts, strict=True) if motions.holdable[first]}
    assert held == {"stand", "squat"}
    tracking = Tracking(motions, 64, np.random.default_rng(0), TrackingConfig(unsettled=0.0, mean_holds=(5, 1000)))
    long = tracking._mean_hold == 1000
    assert long.any() and motions.holdable[tracking.frame[long]].all()


def test_failure_rates_go_into_the_checkpoint(motions: ReferenceMotions, tmp_path: Path) -> None:
    config = TeacherConfig(minutes=0, num_humanoids=4)
    trainer = TeacherTrainer(motions, tmp_path, config)
    trainer.tracking.restore_failures({"squat": 0.9, "stand": 0.1, "wave_right_hand": 0.1, "gone": 0.3})
    trainer.save()
    again = TeacherTrainer(motions, tmp_path, config).tracking
    assert again.failures_by_name() == {"stand": 0.1, "wave_right_hand": 0.1, "squat": 0.9}
    assert again.clip_probabilities.argmax() == again.motions.names.index("squat")


def test_a_mirror_image_is_tracked_as_the_mirror_image_of_its_clip(motions: ReferenceMotions, teacher: Teacher) -> None:
    salute = next(clip for clip in authored_clips() if clip.name == "salute")
    both = ReferenceMotions([salute, salute.mirrored()])
    tracking = Tracking(both, 2, np.random.default_rng(0), TrackingConfig(joint_noise=0, velocity_noise=0))
    tracking.reset(np.arange(2), both.starts + 20)
    one, other = teacher.targets(tracking)
    np.testing.assert_allclose(other, one[MIRROR_JOINTS] * MIRROR_JOINT_SIGNS, atol=1e-5)


def test_smoothness_compares_with_both_neighbours_within_an_episode() -> None:
    """A steady change has no distance from the mean of its neighbours; beyond the end of an episode there is none."""
    time = torch.arange(6.0)[:, None, None]
    means = torch.cat([3 * time, time**2], 1).expand(6, 2, 28)
    ends = torch.zeros(6, 2)
    ends[2] = 1
    away = (neighbouring_means(means, ends) - means)[..., 0]
    assert away[:, 0].tolist() == [0] * 6
    assert away[:, 1].tolist() == [0, 1, 0, 0, 1, 0]


def test_distance_is_in_metres(motions: ReferenceMotions) -> None:
    raised = motions.observations[:1].copy()
    raised[:, 0] += 0.1  # the whole body 10 cm higher
    np.testing.assert_allclose(tracking_distance(raised, motions.observations[:1]), 0.1, atol=1e-6)


def test_the_reference_of_a_held_intent_follows_the_humanoid(motions: ReferenceMotions) -> None:
    """Who stops half-way through a squat is shown how to go on from there, not from where a clock has got to."""
    first = motions.starts[motions.names.index("squat")]
    for after, expected in ((1, first + 10), (None, first + 20)):
        config = TrackingConfig(
            mean_holds=(1000,), unsettled=0, joint_noise=0, velocity_noise=0, synchronise_after=after
        )
        tracking = Tracking(motions, 1, np.random.default_rng(0), config)
        tracking.reset(np.array([0]), np.array([first]))
        for _ in range(20):
            there = first + 9
            tracking.simulation.reset(np.array([0]), motions.qpos[[there]], motions.qvel[[there]])
            tracking.step(motions.feedforward[[there]])
        assert abs(tracking.frame[0] - expected) <= 2


def test_feedforward_alone_holds_a_stand(motions: ReferenceMotions) -> None:
    config = TrackingConfig(switch_probabilities=(0.0,), joint_noise=0.0, velocity_noise=0.0)
    tracking = Tracking(motions, 4, np.random.default_rng(0), config)
    stand = motions.starts[motions.names.index("stand")]
    tracking.reset(np.arange(4), np.full(4, stand))
    for _ in range(60):
        _, failed, _ = tracking.step(tracking.feedforward())
        assert not failed.any()


def test_a_twin_is_seen_and_done_as_the_mirror_image() -> None:
    twins = ReferenceMotions([clip for clip in authored_clips() if clip.name in ("kick_left", "kick_right")])
    config = TrackingConfig(switch_probabilities=(0.0,), joint_noise=0.0, velocity_noise=0.0)
    tracking = Tracking(twins, 2, np.random.default_rng(0), config)
    tracking.reset(np.arange(2), twins.starts[[twins.names.index("kick_left"), twins.names.index("kick_right")]] + 20)
    assert list(twins.reflected[tracking.frame]) == [False, True]
    left, right = tracking.policy_input()
    np.testing.assert_allclose(left, right, atol=2e-3)
    residual = np.random.default_rng(1).normal(0, 0.1, 28)
    left, right = tracking.targets(np.stack([residual, residual]))
    np.testing.assert_allclose(left, right[MIRROR_JOINTS] * MIRROR_JOINT_SIGNS, atol=1e-3)


def test_window_features_ignore_place_and_heading_and_mirror(motions: ReferenceMotions) -> None:
    from motion_data.skeleton import mirror_qpos

    index = motions.starts[1] + np.arange(60)[None]
    qpos = motions.qpos[index]
    moved = qpos.copy()
    moved[..., :2] += [5.0, -3.0]
    np.testing.assert_allclose(window_features(moved), window_features(qpos), atol=1e-5)
    mirrored = window_features(qpos)[..., WINDOW_MIRROR_INDEX] * WINDOW_MIRROR_SIGN
    np.testing.assert_allclose(window_features(mirror_qpos(qpos)), mirrored, atol=1e-5)


def test_teacher_resumes_from_its_checkpoint(motions: ReferenceMotions, tmp_path: Path) -> None:
    config = TeacherConfig(minutes=SECONDS / 3, num_humanoids=16, horizon=4)
    first = TeacherTrainer(motions, tmp_path, config)
    first.train()
    second = TeacherTrainer(motions, tmp_path, replace(config, minutes=first.seconds / 60 + SECONDS))
    assert second.samples == first.samples
    for name, value in first.teacher.state_dict().items():
        assert torch.equal(value, second.teacher.state_dict()[name])
    second.train()
    assert second.samples > first.samples
    assert torch.equal(Teacher.load(second.path).actor[0].weight, second.averaged.actor[0].weight)


def test_bundled_networks_are_those_of_the_bundled_controller(motions: ReferenceMotions, tmp_path: Path) -> None:
    """Training that goes on from them starts with what the package performs."""
    from agents.controller.commands import STUDENT, TRACKING_POLICY

    config = DistillConfig(num_humanoids=2, initial=STUDENT)
    first = TeacherTrainer(motions, tmp_path, TeacherConfig(num_humanoids=2, initial=TRACKING_POLICY))
    student = DistillTrainer(first.teacher, motions, tmp_path, config).student.eval()
    observation = motions.observations[:4]
    latents = MotionEncoder.load().encode(motions.windows(np.arange(4)))
    with torch.no_grad():
        targets = student.policy(torch.from_numpy(observation), torch.from_numpy(latents)).numpy()
    np.testing.assert_allclose(LowLevelController.load().act(observation, latents), targets, atol=1e-4)


def test_distil_finetune_export_evaluate(motions: ReferenceMotions, teacher: Teacher, tmp_path: Path) -> None:
    distillation = DistillConfig(minutes=2 * SECONDS, num_humanoids=32, horizon=8, batch=256)
    trainer = DistillTrainer(teacher, motions, tmp_path, distillation)
    student = trainer.train()
    # What training yields is a running mean of the weights, never of which frames the encoder looks at.
    assert student is not trainer.student
    assert torch.equal(student.encoder.offsets, trainer.student.encoder.offsets)
    resumed = DistillTrainer(teacher, motions, tmp_path, distillation)
    assert resumed.samples == trainer.samples
    assert torch.equal(resumed.train().policy.network[0].weight, student.policy.network[0].weight)
    finetuning = FinetuneConfig(minutes=SECONDS, num_humanoids=16, horizon=4, critic_seconds=0.5)
    tuner = FinetuneTrainer(student, teacher, motions, tmp_path, finetuning)
    distilled, student = student, tuner.train()
    first, last, between = (s.policy.network[0].weight for s in (distilled, tuner.averaged.module, student))
    torch.testing.assert_close(between, (first + last) / 2)
    assert not torch.equal(first, last)

    controller_path, encoder_path = export_student(student, motions, tmp_path, "test", "three authored clips")
    controller, encoder = LowLevelController.load(controller_path), MotionEncoder.load(encoder_path)
    assert controller.metadata["training_data"] == "three authored clips"
    windows = motions.windows(np.arange(0, 60, 7))
    latents = encoder.encode(windows)
    np.testing.assert_allclose(np.linalg.norm(latents, axis=1), 1.0, atol=1e-5)
    np.testing.assert_allclose(latents[:1], encoder.encode(windows[:1]), atol=1e-5)
    assert set(controller.anchors) == {"stand", "wave_right_hand", "squat"}
    observation = motions.observations[: len(latents)]
    together = controller.act(observation, latents)
    np.testing.assert_allclose(controller.act(observation[:1], latents[:1]), together[:1], atol=1e-5)

    result = evaluate_controller(controller, encoder, motions, episodes=2)
    assert set(result["clips"]) == set(motions.names)
    assert 0 <= result["random_falls"] <= 1
    assert all(0 <= row["survival"] <= 1 for row in result["clips"].values())


def test_latents_depend_on_the_reference_alone(motions: ReferenceMotions) -> None:
    """The encoder sees only the reference: the same window gives the same latent, whatever the humanoid does."""
    student = Student()
    windows = motions.windows(np.array([0, 5]))
    np.testing.assert_array_equal(student.encode(windows), student.encode(windows))
    np.testing.assert_allclose(np.linalg.norm(student.encode(windows), axis=1), 1.0, atol=1e-2)


def test_clips_need_distinct_names(motions: ReferenceMotions) -> None:
    with pytest.raises(ValueError, match="same name"):
        ReferenceMotions([motions.clips[0], motions.clips[0]])
    with pytest.raises(ValueError, match="No clips"):
        ReferenceMotions([])


def test_the_command_trains_in_rounds_and_goes_on_where_it_was(
    motions: ReferenceMotions, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for clip in motions.clips:
        clip.save(tmp_path / "clips" / f"{clip.name}.npz")
    config = ControllerTraining(
        output=tmp_path / "run",
        clips=tmp_path / "clips",
        teacher_minutes=0.01,
        distill_minutes=0.01,
        finetune_minutes=0.01,
        threads=1,
    )
    train(config)
    assert "3 clips" in capsys.readouterr().out
    rounds = [Student(), Student()]
    for number, student in enumerate(rounds, 1):
        student.load_state_dict(load_file(config.output / f"round_{number}" / "student.safetensors"))
    observation = motions.observations[:4]
    controller, encoder = (
        LowLevelController.load(config.output / "llc.onnx"),
        MotionEncoder.load(config.output / "motion_encoder.onnx"),
    )
    latents = encoder.encode(motions.windows(np.arange(4)))
    with torch.no_grad():
        first, last = (
            s.eval().policy(torch.from_numpy(observation), torch.from_numpy(latents)).numpy() for s in rounds
        )
    np.testing.assert_allclose(controller.act(observation, latents), last, atol=1e-4)
    assert np.abs(first - last).max() > 1e-4

    train(config)  # all stages have had their time: nothing is trained again
    np.testing.assert_array_equal(
        LowLevelController.load(config.output / "llc.onnx").act(observation, latents),
        controller.act(observation, latents),
    )
    with pytest.raises(ValueError, match="at least one round"):
        train(replace(config, rounds=0))
