"""The reward registry and AnySkill's clip reward, against a direct evaluation of its formula."""

import numpy as np
import pytest

from rewards import RewardBatch, RewardFn, RewardOutput, load_encoder, make_reward, register_reward, reward_names
from rewards.clip import ClipReward


class LinearEncoder:
    """A tiny encoder with known answers: the state feature is the normalised start of the observation."""

    feature_size = 8

    def encode_text(self, texts):
        rng = np.random.default_rng([len(text) for text in texts])
        return unit(rng.normal(size=(len(texts), 8)))

    def encode_image(self, frames):
        return unit(frames.reshape(len(frames), -1)[:, :8].astype(np.float32) + 1.0)

    def encode_state(self, observation):
        return unit(observation[:, :8])


def unit(vectors):
    return (vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)).astype(np.float32)


def random_batch(rng, count=7, **changes):
    values = {
        "observation": rng.normal(size=(count, 223)).astype(np.float32),
        "text_feature": unit(rng.normal(size=(count, 8))),
        "latent": unit(rng.normal(size=(count, 64))),
        "style_latent": unit(rng.normal(size=(count, 64))),
    }
    return RewardBatch(**(values | changes))


def test_clip_reward_is_equation_3():
    rng = np.random.default_rng(0)
    batch = random_batch(rng)
    reward = ClipReward(LinearEncoder(), clip_weight=0.7, style_weight=0.2)
    output = reward(batch)
    for i in range(7):
        image = batch.observation[i, :8] / np.linalg.norm(batch.observation[i, :8])
        expected = 0.7 * image @ batch.text_feature[i]
        expected += 0.2 * np.exp(-4.0 * np.sqrt(np.sum((batch.latent[i] - batch.style_latent[i]) ** 2)))
        assert output.total[i] == pytest.approx(expected, abs=1e-6)


def test_terms_add_up_and_rows_are_independent():
    rng = np.random.default_rng(1)
    batch = random_batch(rng, text_feature=unit(rng.normal(size=8)))
    reward = ClipReward(LinearEncoder())
    output = reward(batch)
    np.testing.assert_allclose(sum(output.terms.values()), output.total, atol=1e-7)
    alone = reward(
        RewardBatch(batch.observation[2:3], None, batch.text_feature, None, batch.latent[2:3], batch.style_latent[2:3])
    )
    np.testing.assert_allclose(alone.total, output.total[2:3], atol=1e-7)


def test_stored_features_recompute_the_reward():
    rng = np.random.default_rng(2)
    batch = random_batch(rng)
    reward = ClipReward(LinearEncoder())
    stored = RewardBatch(
        text_feature=batch.text_feature,
        image_feature=reward.image_feature(batch),
        latent=batch.latent,
        style_latent=batch.style_latent,
    )
    np.testing.assert_allclose(reward(stored).total, reward(batch).total, atol=1e-7)


def test_frames_are_asked_for_only_when_needed():
    assert "frames" not in ClipReward(LinearEncoder()).needs
    reward = ClipReward(LinearEncoder(), source="frames", style_weight=0.0)
    assert reward.needs == {"frames", "text"}
    frames = np.zeros((3, 4, 4, 3), dtype=np.uint8)
    output = reward(RewardBatch(frames=frames, text_feature=unit(np.ones(8))))
    np.testing.assert_allclose(output.similarity, 1.0, atol=1e-6)


def test_missing_field_is_named():
    batch = random_batch(np.random.default_rng(3), style_latent=None)
    with pytest.raises(ValueError, match="style_latent"):
        ClipReward(LinearEncoder())(batch)


def test_row_counts_must_agree():
    batch = random_batch(np.random.default_rng(4), latent=np.ones((2, 64), dtype=np.float32))
    with pytest.raises(ValueError, match="latent has 2 rows"):
        ClipReward(LinearEncoder())(batch)


def test_unknown_names_list_what_exists():
    with pytest.raises(ValueError, match=r"'clop'.*clip"):
        make_reward("clop")
    with pytest.raises(ValueError, match=r"'vit'.*bundled"):
        load_encoder("vit")
    with pytest.raises(ValueError, match="source"):
        ClipReward(LinearEncoder(), source="video")


def test_a_new_reward_is_found_by_name_once():
    class Constant:
        needs = frozenset({"state"})

        def encode_text(self, texts):
            return np.zeros((len(texts), 1), dtype=np.float32)

        def __call__(self, batch):
            return RewardOutput.from_terms({"constant": np.ones(len(batch))})

    if "constant-for-test" not in reward_names():
        register_reward("constant-for-test", Constant)
    reward = make_reward("constant-for-test")
    assert isinstance(reward, RewardFn)
    assert reward(random_batch(np.random.default_rng(5))).total.tolist() == [1.0] * 7
    with pytest.raises(ValueError, match="exists already"):
        register_reward("constant-for-test", Constant)
