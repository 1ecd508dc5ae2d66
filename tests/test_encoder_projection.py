"""A state projection for a small random CLIP: fitted, cached, found again by name, refused for another model."""

import pickle

import numpy as np
import pytest

pytest.importorskip("torch")
pytest.importorskip("transformers")

from small_models import write_clip

from agents.encoder.project_command import project
from rewards import make_reward
from rewards.encoders import Encoder, SceneEncoder, load_encoder
from rewards.projection import ProjectedEncoder, ProjectionError, projection_path


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return write_clip(tmp_path_factory.mktemp("clip"))


def test_a_projection_makes_pictures_unnecessary(folder, tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("ANYSKILL_CACHE", str(tmp_path))
    plain = load_encoder(str(folder))
    assert make_reward("vlm-rm", encoder=plain).needs == {"frames", "text"}
    with pytest.raises(NotImplementedError, match="anyskill encoder project"):
        plain.encode_state(np.zeros((1, 223), np.float32))
    assert project(str(folder), states=150, steps=150) == 0
    assert "unseen rollouts" in capsys.readouterr().out
    encoder = load_encoder(str(folder))
    assert isinstance(encoder, ProjectedEncoder) and isinstance(encoder, Encoder)
    assert make_reward("vlm-rm", encoder=str(folder)).needs == {"state", "text"}
    states = np.random.default_rng(0).normal(size=(3, 223)).astype(np.float32)
    features = encoder.encode_state(states)
    assert features.shape == (3, encoder.feature_size)
    np.testing.assert_allclose(np.linalg.norm(features, axis=1), 1.0, atol=1e-5)
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(encoder.projection))(states), features)
    assert float(encoder.projection.metadata["held_out_cosine"]) > 0.9
    # It is kept apart by camera, and not taken for another model of the same name.
    assert projection_path(str(folder), "aside") != projection_path(str(folder))
    other = write_clip(tmp_path / "other", seed=1)
    with pytest.raises(ProjectionError, match="another encoder"):
        load_encoder(str(other), projection=projection_path(str(folder)))
    assert not isinstance(load_encoder(str(folder), projection=False), ProjectedEncoder)


def test_a_projection_is_told_about_objects(folder, tmp_path):
    file = tmp_path / "soccer.onnx"
    assert project(str(folder), states=100, steps=20, objects=("ball",), out=file) == 0
    encoder = load_encoder(str(folder), projection=file)
    assert isinstance(encoder, SceneEncoder) and encoder.object_sizes == {"ball": 15}
    states = np.zeros((2, 223), np.float32)
    near, far = np.zeros((2, 15), np.float32), np.full((2, 15), 2.0, np.float32)
    assert not np.allclose(encoder.encode_state(states, {"ball": near}), encoder.encode_state(states, {"ball": far}))
