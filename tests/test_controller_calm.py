"""CALM: losses against direct evaluation, what is drawn from the clips, episodes, and a few seconds of training."""
# ruff: noqa: E402 (torch is looked for before anything imports it)

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

torch = pytest.importorskip("torch")

from agents.controller import losses as shared_losses
from agents.controller.calm import losses
from agents.controller.calm.command import CalmTraining, calm
from agents.controller.calm.config import CalmConfig, EpisodeConfig
from agents.controller.calm.demonstrations import Demonstrations
from agents.controller.calm.discriminator import IMITATION_FEATURES, Discriminator, head_height, imitation_features
from agents.controller.calm.episodes import Episodes
from agents.controller.calm.replay import Replay
from agents.controller.calm.trainer import CalmTrainer
from agents.controller.calm.update import target_range
from agents.controller.export import export_student
from agents.controller.ppo import PPOSettings
from agents.controller.reference import ReferenceMotions
from anyskill_envs.controller import LowLevelController, MotionEncoder
from anyskill_envs.simulation import HumanoidSimulation
from motion_data.authored import authored_clips
from motion_data.skeleton import BODY_NAMES, JOINT_NAMES, kinematics

REAL, FAKE, MISMATCHED = torch.tensor([2.0, 0.5]), torch.tensor([-1.0, 0.3, 1.2]), torch.tensor([0.0])
HIP = ("pelvis", "right_thigh")


@pytest.fixture(scope="module")
def motions() -> ReferenceMotions:
    return ReferenceMotions([clip for clip in authored_clips() if clip.name in {"squat", "slow_walk"}])


def direct(term: str) -> float:
    """One term of eq. 1, by probabilities."""
    if term == "real":
        return float(-np.log(1 / (1 + np.exp(-REAL.numpy()))).mean())
    logits = (FAKE if term == "fake" else MISMATCHED).numpy()
    return float(-np.log(1 - 1 / (1 + np.exp(-logits))).mean())


@pytest.mark.parametrize(
    "terms",
    [("real",), ("fake",), ("mismatched",), ("real", "fake"), ("real", "mismatched"), ("real", "fake", "mismatched")],
)
def test_every_term_of_equation_1_can_be_switched(terms: tuple[losses.Term, ...]) -> None:
    loss = losses.discriminator_loss(REAL, FAKE, MISMATCHED, terms)
    assert float(loss) == pytest.approx(sum(map(direct, terms)), abs=1e-6)


def test_the_released_loss_is_half_the_sum_of_two_cross_entropies() -> None:
    entropy = torch.nn.functional.binary_cross_entropy_with_logits
    binary = 0.5 * (entropy(REAL, torch.ones(2)) + entropy(FAKE, torch.zeros(3)))
    assert torch.isclose(losses.discriminator_loss(REAL, FAKE, MISMATCHED, ("real", "fake"), "released"), binary)
    pooled = 0.5 * (entropy(REAL, torch.ones(2)) + entropy(torch.cat([FAKE, MISMATCHED]), torch.zeros(4)))
    assert torch.isclose(losses.discriminator_loss(REAL, FAKE, MISMATCHED, form="released"), pooled)


@pytest.mark.parametrize("terms", [(), ("real", "imagined")])
def test_a_wrong_term_is_refused(terms) -> None:
    with pytest.raises(ValueError, match="real, fake, mismatched"):
        losses.discriminator_loss(REAL, FAKE, MISMATCHED, terms)


def test_gradient_penalty_of_known_functions() -> None:
    rng = np.random.default_rng(0)
    x, z = (torch.from_numpy(rng.standard_normal((5, size))).requires_grad_() for size in (3, 2))
    weight = torch.tensor([1.0, -2.0, 0.5], dtype=torch.float64, requires_grad=True)
    penalty = losses.gradient_penalty(x @ weight, x)
    assert float(penalty.detach()) == pytest.approx(5.25)  # ||weight||^2
    penalty.backward()
    torch.testing.assert_close(weight.grad, 2 * weight.detach())  # it can be descended
    # f(x, z) = ||x||^2 + 3 z_0: gradients 2 x and (3, 0)
    both = losses.gradient_penalty(x.square().sum(1) + 3 * z[:, 0], x, z)
    assert torch.isclose(both, 4 * x.square().sum(1).mean() + 9)


def test_reward_is_equation_2() -> None:
    logits = torch.tensor([-3.0, 0.0, 2.0])
    probability = 1 / (1 + np.exp(-logits.numpy()))
    np.testing.assert_allclose(losses.style_reward(logits), -np.log(1 - probability), rtol=1e-5)
    np.testing.assert_allclose(losses.style_reward(logits, scale=2), -2 * np.log(1 - probability), rtol=1e-5)
    assert float(losses.style_reward(torch.tensor([50.0]))) == pytest.approx(-np.log(1e-4))


def test_alignment_and_uniformity() -> None:
    x, y = (torch.nn.functional.normalize(torch.randn(6, 4), dim=1) for _ in range(2))
    squared = [float((x[i] - y[i]).square().sum()) for i in range(6)]
    assert float(shared_losses.alignment_loss(x, y)) == pytest.approx(np.mean(squared), rel=1e-5)
    kernel = [np.exp(-2 * float((x[i] - x[j]).square().sum())) for i in range(6) for j in range(i)]
    assert float(shared_losses.uniformity_loss(x)) == pytest.approx(np.log(np.mean(kernel)), rel=1e-4)


def test_surrogate_is_ppos_for_a_gaussian() -> None:
    noise = torch.full((28,), 0.1)
    old, mean = 0.1 * torch.randn(2, 7, 28)
    action, advantage = old + noise * torch.randn(7, 28), torch.randn(7)
    new, before = (torch.distributions.Normal(m, noise).log_prob(action).sum(1) for m in (mean, old))
    ratio = (new - before).clamp(-10, 10).exp()
    expected = -torch.minimum(ratio * advantage, ratio.clamp(0.8, 1.2) * advantage)
    torch.testing.assert_close(
        shared_losses.clipped_surrogate(mean, old, action, advantage, noise, 0.2), expected, rtol=1e-3, atol=1e-4
    )


def test_targets_beyond_their_range_cost() -> None:
    centre, reach = target_range()
    assert reach[JOINT_NAMES.index("right_hip_x")] == reach[JOINT_NAMES.index("right_hip_y")]  # one joint, one scale
    assert centre[JOINT_NAMES.index("right_hip_y")] == 0 < centre[JOINT_NAMES.index("right_knee")]
    mean = torch.stack([centre, centre + reach, centre + 1.5 * reach])
    torch.testing.assert_close(
        losses.bound_loss(mean, centre, reach), torch.tensor([0.0, 0.0, 28 * 0.25]), atol=1e-4, rtol=0
    )


def test_defaults_are_table_a1() -> None:
    config = CalmConfig()
    assert config.num_humanoids * config.horizon == 131_072
    assert (config.ppo.minibatch, config.discriminator_batch, config.encoder_batch) == (16_384, 4_096, 4_096)
    ppo = config.ppo
    assert (ppo.learning_rate, ppo.discount, ppo.trace, ppo.clip, config.adaptive_rate) == (
        2e-5,
        0.99,
        0.95,
        0.2,
        False,
    )
    assert (config.penalty, config.alignment, config.uniformity, config.encoder_weight) == (5.0, 1.0, 0.5, 0.1)
    assert config.episodes.episode_steps == 300
    assert config.terms == losses.TERMS and config.reward_scale == 1.0


def test_what_the_discriminator_sees(motions: ReferenceMotions) -> None:
    frames = np.array([3, 40, 150])
    features = imitation_features(motions.observations[frames], motions.qvel[frames, 6:])
    assert features.shape == (3, IMITATION_FEATURES) == (3, 125)
    quaternions = kinematics(motions.qpos[frames]).quaternions
    pelvis, thigh = (Rotation.from_quat(quaternions[:, BODY_NAMES.index(name)], scalar_first=True) for name in HIP)
    hip = (pelvis.inv() * thigh).as_matrix()
    place = 13 + 6 * 6  # the 7th jointed body, after torso, head, two upper and two lower arms
    np.testing.assert_allclose(features[:, place : place + 3], hip[:, :, 0], atol=1e-5)
    np.testing.assert_allclose(features[:, place + 3 : place + 6], hip[:, :, 2], atol=1e-5)
    np.testing.assert_allclose(features[:, 85:113], motions.qvel[frames, 6:], atol=1e-5)
    simulation = HumanoidSimulation(3)
    simulation.reset(np.arange(3), motions.qpos[frames])
    np.testing.assert_allclose(head_height(motions.observations[frames]), simulation.head_height, atol=1e-5)


def test_transitions_lie_within_their_window_and_clip(motions: ReferenceMotions) -> None:
    demonstrations = Demonstrations(motions, overhang=20, other_clip=True)
    rng = np.random.default_rng(0)
    windows = demonstrations.windows(rng, 200)
    clips = motions.clip_of_frame[windows]
    assert (windows + 59 <= motions.last[windows] + 20).all()
    transitions = demonstrations.transitions(rng, windows).numpy()
    assert transitions.shape == (200, 10, 125)
    for row in range(0, 200, 20):
        own = demonstrations.features[windows[row] : motions.last[windows[row]] + 1][:60]
        assert all((own == frame).all(1).any() for frame in transitions[row])
    assert (motions.clip_of_frame[demonstrations.other_windows(rng, windows)] == 1 - clips).all()
    later = demonstrations.later_windows(rng, windows) - windows
    assert later.min() >= 0 and later.max() == 15
    # before a clip's first frame there is that frame again
    start = demonstrations.past(np.array([1]), motions.starts[1:2] + 1, np.arange(4))[0]
    np.testing.assert_array_equal(start[1:], np.tile(demonstrations.features[motions.starts[1]], (3, 1)))


def test_matched_episodes_start_in_the_motion_that_is_asked_for(motions: ReferenceMotions) -> None:
    demonstrations = Demonstrations(motions)
    config = EpisodeConfig(reference_starts=1, matched_starts=1, fallen_starts=0, recovery=0, hold_steps=(2, 3))
    episodes = Episodes(demonstrations, 6, np.random.default_rng(0), config)
    features = imitation_features(episodes.observation, episodes.simulation.qvel[:, 6:])
    for window, seen in zip(episodes.window, features, strict=True):
        own = demonstrations.features[window : motions.last[window] + 1][:60]
        assert np.abs(own - seen).max(1).min() < 1e-3
    transitions, fell, truncated = episodes.step(episodes.simulation.qpos[:, 7:])
    assert transitions.shape == (6, 10, 125) and not fell.any() and not truncated.any()
    np.testing.assert_allclose(transitions[:, 1], features, atol=1e-5)  # one step ago
    assert not episodes.renewed.any()
    episodes.step(episodes.simulation.qpos[:, 7:])
    assert episodes.renewed.all()


def test_a_fall_ends_the_episode_unless_it_may_recover(motions: ReferenceMotions) -> None:
    demonstrations = Demonstrations(motions)
    for recovery in (0.0, 1.0):
        config = EpisodeConfig(reference_starts=1, fallen_starts=0, recovery=recovery, recovery_steps=2)
        episodes = Episodes(demonstrations, 2, np.random.default_rng(0), config)
        episodes.simulation.qpos[0, 2] = 0.2
        episodes.simulation.qpos[0, 3:7] = [0.5**0.5, 0, 0.5**0.5, 0]  # lies on its face
        episodes.simulation.refresh()
        _, fell, _ = episodes.step(episodes.simulation.qpos[:, 7:])
        np.testing.assert_array_equal(fell, [True, False])
        assert (head_height(episodes.observation)[0] < 0.3) == (recovery == 1.0)
        _, fell, _ = episodes.step(episodes.simulation.qpos[:, 7:])
        assert not fell.any()


def test_episodes_can_start_on_the_floor_and_end_early(motions: ReferenceMotions) -> None:
    demonstrations = Demonstrations(motions)
    config = EpisodeConfig(fallen_starts=1.0)
    lying = Episodes(demonstrations, 4, np.random.default_rng(0), config)
    assert np.median(head_height(lying.observation)) < 0.5
    config = EpisodeConfig(reference_starts=1, fallen_starts=0, fall_margin=0.25)
    strict = Episodes(demonstrations, 2, np.random.default_rng(0), config)
    assert strict.fall_height == pytest.approx(float(head_height(motions.observations).min()) - 0.25, abs=1e-5)


def test_replay_keeps_the_newest_and_pairs_them() -> None:
    rng = np.random.default_rng(0)
    replay = Replay(8, (2,), share=0.5)
    for first in (0, 4, 8):  # the third batch finds it full: half of it enters
        windows = torch.arange(first, first + 4)
        replay.add(torch.stack([windows, -windows], 1).float(), windows, rng)
    transitions, windows = replay.sample(rng, 400)
    np.testing.assert_array_equal(transitions[:, 0], windows)
    np.testing.assert_array_equal(transitions[:, 1], -windows)
    assert len(replay) == 8 and len(windows.unique()) == 8 and (windows >= 8).any()


def test_the_discriminator_depends_on_the_latent() -> None:
    discriminator = Discriminator(2, (16, 8), (16,))
    normal, latents = torch.randn(3, 250), torch.nn.functional.normalize(torch.randn(3, 64))
    assert discriminator(normal, latents).shape == (3,)
    assert not torch.allclose(discriminator(normal, latents), discriminator(normal, -latents))


def small() -> CalmConfig:
    return replace(
        CalmConfig.laptop(),
        minutes=0.02,
        num_humanoids=12,
        horizon=4,
        ppo=PPOSettings(epochs=1, minibatch=24),
        encoder_batch=8,
        discriminator_batch=16,
        discriminator_steps=1,
        replay=60,
        hidden=(48, 32),
        discriminator_hidden=(16,),
        style_hidden=(8,),
        measure_seconds=1e9,
    )


def test_training_resumes_and_exports(motions: ReferenceMotions, tmp_path: Path) -> None:
    first = CalmTrainer(motions, tmp_path, small())
    first.train()
    assert (tmp_path / "curve.png").stat().st_size > 1000
    second = CalmTrainer(motions, tmp_path, replace(small(), minutes=first.seconds / 60 + 0.02))
    assert second.samples == first.samples > 0
    for name in ("student", "critic", "discriminator"):
        kept, restored = getattr(first, name).state_dict(), getattr(second, name).state_dict()
        assert all(torch.equal(value, restored[key]) for key, value in kept.items())
    encoder_before = second.student.encoder.network[0].weight.detach().clone()
    second.train()
    assert not torch.equal(encoder_before, second.student.encoder.network[0].weight)  # trained end to end
    history = json.loads((tmp_path / "history.json").read_text())
    assert [entry["samples"] for entry in history] == [first.samples, second.samples]
    assert {"real", "fake", "mismatched", "reward", "error_mm", "nearest_mm"} <= set(history[0])

    controller_path, encoder_path = export_student(second.student, motions, tmp_path, "test", "two authored clips")
    controller, encoder = LowLevelController.load(controller_path), MotionEncoder.load(encoder_path)
    latents = encoder.encode(motions.windows(np.arange(4)))
    assert controller.act(motions.observations[:4], latents).shape == (4, 28)
    assert set(controller.anchors) == {"squat", "slow_walk"}


@pytest.mark.parametrize(
    "change",
    [
        {"terms": ("real", "fake"), "form": "released"},
        {"mismatched_source": "policy", "penalise_latent": True, "other_clip": False},
        {"greedy_humanoids": True, "action_log_std": -2.9, "adaptive_rate": False, "max_gradient": None},
    ],
)
def test_every_variant_updates(motions: ReferenceMotions, tmp_path: Path, change: dict) -> None:
    trainer = CalmTrainer(motions, tmp_path, replace(small(), **change))
    figures = trainer.update()
    assert all(np.isfinite(value) for value in figures.values())
    assert 0 < figures["reward"] < 9.3


def test_the_discriminator_can_rest(motions: ReferenceMotions, tmp_path: Path) -> None:
    trainer = CalmTrainer(motions, tmp_path, replace(small(), discriminator_rest=1.0))
    before = [weight.detach().clone() for weight in trainer.discriminator.parameters()]
    trainer.update()
    assert all(map(torch.equal, before, trainer.discriminator.parameters()))


def test_mistakes_are_answered(motions: ReferenceMotions, tmp_path: Path) -> None:
    from agents.controller.commands import STUDENT

    with pytest.raises(ValueError, match="laptop, paper"):
        calm(CalmTraining(clips="squat", preset="mainframe"))
    with pytest.raises(ValueError, match="laptop preset"):
        CalmTrainer(motions, tmp_path, replace(small(), initial=STUDENT))


def test_bundled_weights_can_be_the_start(motions: ReferenceMotions, tmp_path: Path) -> None:
    from agents.controller.commands import STUDENT

    trainer = CalmTrainer(motions, tmp_path, replace(small(), hidden=CalmConfig.laptop().hidden, initial=STUDENT))
    latents = trainer.student.encode(motions.windows(np.arange(3)))
    np.testing.assert_allclose(latents, MotionEncoder.load().encode(motions.windows(np.arange(3))), atol=0.02)
    trainer.update()  # the critic and the discriminator learn first
    np.testing.assert_array_equal(latents, trainer.student.encode(motions.windows(np.arange(3))))
