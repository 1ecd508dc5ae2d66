"""Features of motion that need no model, and CLIP_S, against motions whose numbers are known."""

import numpy as np
import pytest

from motion_data.metrics import clip_similarity, diversity, frechet_distance, nearest_distance
from motion_data.motion_features import MOTION_FEATURE_SIZE, motion_features, windowed_features
from motion_data.skeleton import kinematics, rest_qpos


def sliding(speed, frames=60, lift=0.0):
    """The rest pose that slides along x at a speed and rises at another."""
    qpos = np.tile(rest_qpos(), (frames, 1))
    qpos[:, 0] += np.arange(frames) * speed / 30
    qpos[:, 2] += np.arange(frames) * lift / 30
    return qpos


def test_a_sliding_statue():
    features = motion_features(sliding(0.9, lift=0.3))
    assert features.shape == (MOTION_FEATURE_SIZE,) == (88,)
    posture, kinetic = features[:43], features[43:].reshape(3, 15)
    assert posture[0] == pytest.approx(rest_qpos()[2] + 0.3 * 29.5 / 30)
    relative = kinematics(rest_qpos()).positions[0]
    np.testing.assert_allclose(posture[1:].reshape(14, 3), relative[1:] - relative[0], atol=1e-9)
    np.testing.assert_allclose(kinetic, np.array([0.9, 0.3, 0.0])[:, None] + np.zeros(15), atol=1e-6)


def test_a_falling_statue_accelerates():
    qpos = sliding(0.0)
    qpos[:, 2] += 50 - 0.5 * 9.81 * (np.arange(60) / 30) ** 2
    np.testing.assert_allclose(motion_features(qpos)[43:].reshape(3, 15)[2], 9.81, rtol=1e-6)


def test_place_and_direction_do_not_matter():
    rng = np.random.default_rng(0)
    qpos = sliding(1.0)
    qpos[:, 7:] += np.cumsum(rng.normal(0, 0.01, (60, 28)), 0)
    turned = qpos.copy()
    turned[:, 0], turned[:, 1] = 5 - qpos[:, 1], qpos[:, 0] - 7  # a quarter turn and a step aside
    turned[:, 3:7] = [np.sqrt(0.5), 0, 0, np.sqrt(0.5)]
    np.testing.assert_allclose(motion_features(turned), motion_features(qpos), atol=1e-6)


def test_windows_cover_the_motion_and_short_ones_are_one_window():
    long = sliding(1.0, frames=120)
    windows = windowed_features(long)
    assert windows.shape == (5, 88)  # starts at 0, 0.5, 1, 1.5 and 2 s
    np.testing.assert_allclose(windows[2], motion_features(long[30:90]))
    assert windowed_features(long[:20]).shape == (1, 88)
    for function in (motion_features, windowed_features):
        with pytest.raises(ValueError, match="at least 3 frames"):
            function(long[:2])


def test_the_nearest_of_a_reference():
    reference = np.array([[0.0, 0.0], [10.0, 0.0], [0.0, 10.0]])
    assert nearest_distance(np.array([[3.0, 4.0], [10.0, 1.0]]), reference) == pytest.approx((5 + 1) / 2)
    assert nearest_distance(reference[:2], reference) == 0
    with pytest.raises(ValueError, match="different sizes"):
        nearest_distance(reference, np.ones((4, 3)))


def test_they_tell_motions_apart():
    """Still, slow and fast motions: the farther apart, the larger the distance; the more kinds, the larger the diversity."""
    speeds = np.random.default_rng(0).normal(0, 0.05, 8)
    still, slow, fast = (
        np.concatenate([windowed_features(sliding(speed + extra, 90)) for extra in speeds]) for speed in (0.5, 1.0, 3.0)
    )
    assert frechet_distance(still, still) < 1e-6 < frechet_distance(still, slow) < frechet_distance(still, fast)
    rng = np.random.default_rng
    assert diversity(np.concatenate([still, fast]), rng(0)) > 3 * diversity(still, rng(0))


def test_clip_similarity_is_a_mean_cosine_in_percent():
    frames = np.array([[3.0, 0.0], [0.0, 2.0]])
    assert clip_similarity(frames, np.array([5.0, 0.0])) == pytest.approx(50)
    np.testing.assert_allclose(
        clip_similarity(np.stack([frames, -frames]), np.array([1.0, 1.0])), [70.71, -70.71], atol=0.01
    )
