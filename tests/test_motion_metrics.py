"""Metrics of motion against cases whose value is known."""

import numpy as np
import pytest
from scipy.linalg import sqrtm

from motion_data.clip import MotionClip
from motion_data.metrics import (
    diversity,
    foot_skate,
    frechet_distance,
    frechet_floor,
    jerk,
    multimodality,
    sole_corners,
)
from motion_data.skeleton import kinematics, rest_qpos


def path(speed, height, frames=31, fps=30.0):
    """One point that moves along x at a height, (T, 1, 3)."""
    time = np.arange(frames) / fps
    return np.stack([speed * time, 0 * time, height + 0 * time], -1)[:, None]


def test_foot_skate_is_the_speed_in_contact():
    assert foot_skate(path(0.5, 0.0)) == pytest.approx(0.5)
    assert foot_skate(path(0.0, 0.0)) == 0
    assert np.isnan(foot_skate(path(0.5, 0.03)))  # in the air
    # Half of the points planted, half of them sliding: the mean of the speeds.
    both = np.concatenate([path(0.0, 0.0), path(1.0, -0.001)], 1)
    assert foot_skate(both) == pytest.approx(0.5)
    # At half the contact height the weight is 2 - sqrt(2).
    weight = 2 - np.sqrt(2)
    mixed = np.concatenate([path(0.0, 0.0), path(1.0, 0.0125)], 1)
    assert foot_skate(mixed) == pytest.approx(weight / (1 + weight))
    np.testing.assert_allclose(foot_skate(np.stack([path(0.2, 0), path(0.4, 0)])), [0.2, 0.4])


def test_soles_of_the_rest_pose_are_on_the_floor_and_slide_with_the_root():
    qpos = np.tile(rest_qpos(), (10, 1))
    qpos[:, 0] = np.arange(10) * 0.3 / 30
    pose = kinematics(MotionClip("slide", qpos).qpos)
    corners = sole_corners(pose.positions, pose.quaternions)
    assert corners.shape == (10, 8, 3) and np.abs(corners[..., 2]).max() < 0.002
    assert foot_skate(corners) == pytest.approx(0.3, rel=0.01)
    turned = qpos.copy()
    turned[:, 3:7] = [np.cos(np.pi / 4), 0, 0, np.sin(np.pi / 4)]
    pose = kinematics(turned)
    sideways = sole_corners(pose.positions, pose.quaternions) - pose.positions[:, :1]
    expected = (corners - kinematics(qpos).positions[:, :1]) @ np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    np.testing.assert_allclose(sideways, expected, atol=1e-9)


def test_jerk_of_polynomials():
    time = np.arange(20) / 30
    quadratic, cubic = 3 * time**2 + time, 2 * time**3
    paths = np.stack([quadratic, cubic])[..., None, None] * np.array([0, 0.6, 0.8])
    np.testing.assert_allclose(jerk(paths), [0, 12], atol=1e-6)
    np.testing.assert_allclose(jerk(paths, fps=60), [0, 96], atol=1e-5)
    with pytest.raises(ValueError, match="at least 4 frames"):
        jerk(paths[:, :3])


def test_frechet_distance_of_known_normals():
    rng = np.random.default_rng(0)
    samples = rng.standard_normal((200, 3))
    samples = (samples - samples.mean(0)) @ np.linalg.inv(np.linalg.cholesky(np.cov(samples, rowvar=False))).T
    assert frechet_distance(samples, samples) == pytest.approx(0, abs=1e-9)
    assert frechet_distance(samples, samples + [3, 4, 0]) == pytest.approx(25)
    # Standard deviations 1 and 2 along one axis: (2 - 1)^2.
    assert frechet_distance(samples, samples * [1, 2, 1]) == pytest.approx(1)
    other = samples @ rng.standard_normal((3, 3))
    one, two = (np.cov(values, rowvar=False) for values in (samples, other))
    direct = np.trace(one + two - 2 * sqrtm(one @ two).real)
    assert frechet_distance(samples, other) == pytest.approx(direct)
    assert frechet_distance(samples[:, :1], samples[:, :1] * 3) == pytest.approx(4)
    with pytest.raises(ValueError, match="different sizes"):
        frechet_distance(samples, samples[:, :2])
    with pytest.raises(ValueError, match="NaN"):
        frechet_distance(samples, samples * np.nan)


def test_the_floor_is_above_zero_and_falls_with_the_number_of_samples():
    few, many = (np.random.default_rng(0).standard_normal((count, 4)) for count in (40, 4000))
    floors = [frechet_floor(features, np.random.default_rng(1)) for features in (few, many)]
    assert floors[0] > 5 * floors[1] > 0
    with pytest.raises(ValueError, match="at least 4"):
        frechet_floor(few[:3], np.random.default_rng(0))


def test_diversity_and_multimodality():
    rng = np.random.default_rng
    # Two motions at a distance of 5, always paired with each other.
    assert diversity(np.array([[0.0, 0.0], [3.0, 4.0]]), rng(0)) == 5
    assert diversity(np.ones((7, 2)), rng(0)) == 0
    # Two actions far apart, whose motions differ by 1 and 3: diverse, but each action is narrow.
    actions = np.array([[[0.0], [1.0]], [[100.0], [103.0]]])
    assert multimodality(actions, rng(0)) == pytest.approx(2)
    assert diversity(actions.reshape(4, 1), rng(0)) > 50
    normal = rng(0).standard_normal((2000, 1))
    assert diversity(normal, rng(1), pairs=20000) == pytest.approx(2 / np.sqrt(np.pi), rel=0.03)
    with pytest.raises(ValueError, match="at least 2"):
        diversity(np.ones((1, 2)), rng(0))
    with pytest.raises(ValueError, match="actions"):
        multimodality(np.ones((2, 3)), rng(0))
