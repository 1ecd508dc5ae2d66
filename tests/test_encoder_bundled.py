"""The bundled encoder as a user gets it, and what it says when something is missing."""

import json
import pickle
import shutil

import numpy as np
import onnx
import pytest

from motion_data.authored import authored_clips
from rewards import Encoder, RewardBatch, load_encoder, make_reward
from rewards.bundled import WEIGHTS_FOLDER, BundledEncoder, EncoderError, contract, shrink
from rewards.encoders import SceneEncoder
from rewards.minilm import MiniLM, TextModelError, load_minilm, model_folder, verify_weights


@pytest.fixture(scope="module")
def encoder():
    return BundledEncoder(cache="")


def best_frames(encoder, clip, text):
    from agents.encoder.sanity import best_half, clip_observations

    return best_half(encoder.encode_state(clip_observations(clip)) @ encoder.encode_text([text])[0])


def test_features_are_unit_vectors_of_one_space(encoder):
    assert isinstance(encoder, Encoder)
    observation = np.random.default_rng(0).normal(size=(5, 223)).astype(np.float32)
    texts = encoder.encode_text(["raise both arms", "squat down"])
    states = encoder.encode_state(observation)
    assert states.shape == (5, encoder.feature_size) and texts.shape == (2, encoder.feature_size)
    np.testing.assert_allclose(np.linalg.norm(np.concatenate([states, texts]), axis=1), 1.0, atol=1e-5)


def test_a_text_has_the_same_feature_alone_and_in_company(encoder):
    alone = encoder.encode_text(["kick with the left leg"])
    company = encoder.encode_text(["a much longer sentence about walking forward", "Kick with the  left leg."])
    np.testing.assert_array_equal(alone[0], company[1])


@pytest.mark.parametrize(
    ("text", "right", "wrong"),
    [
        ("raise both arms above the head", "raise_both_arms", "stand"),
        ("wave the right hand", "wave_right_hand", "wave_left_hand"),
        ("squat down", "squat", "raise_both_arms"),
        ("kick with the left leg", "kick_left", "kick_right"),
        ("walk forward", "slow_walk", "step_backward"),
        ("bow", "bow", "squat"),
        ("turn left", "turn_left", "turn_right"),
    ],
)
def test_state_projection_prefers_the_clip_that_does_it(encoder, text, right, wrong):
    clips = {clip.name: clip for clip in authored_clips()}
    assert best_frames(encoder, clips[right], text) > best_frames(encoder, clips[wrong], text) + 0.1


def test_text_features_are_cached_on_disk(tmp_path, monkeypatch):
    first = BundledEncoder(cache=tmp_path).encode_text(["wave the right hand"])

    def forbidden(self, texts):
        raise AssertionError("the sentence model was asked although the feature is cached")

    monkeypatch.setattr(MiniLM, "token_states", forbidden)
    np.testing.assert_array_equal(BundledEncoder(cache=tmp_path).encode_text(["wave the right hand"]), first)


def test_a_broken_cache_file_is_made_anew(tmp_path):
    encoder = BundledEncoder(cache=tmp_path)
    first = encoder.encode_text(["bow"])
    (file,) = tmp_path.rglob("*.npy")
    file.write_bytes(b"broken")
    np.testing.assert_array_equal(encoder.encode_text(["bow"]), first)


def test_the_encoder_survives_pickling(encoder):
    observation = np.ones((2, 223), np.float32)
    copied = pickle.loads(pickle.dumps(encoder))
    np.testing.assert_array_equal(copied.encode_state(observation), encoder.encode_state(observation))


def test_clip_reward_with_the_bundled_encoder():
    reward = make_reward("clip", style_weight=0.0, clip_weight=1.0)
    batch = RewardBatch(observation=np.zeros((3, 223), np.float32), text_feature=reward.encode_text(["squat down"])[0])
    output = reward(batch)
    assert output.total.shape == (3,)
    assert (np.abs(output.total) <= 1.0 + 1e-5).all()


def test_bad_input_is_named(encoder):
    with pytest.raises(ValueError, match="223"):
        encoder.encode_state(np.zeros((2, 222), np.float32))
    with pytest.raises(ValueError, match="empty"):
        encoder.encode_text(["stand", " "])
    with pytest.raises(ValueError, match="list"):
        encoder.encode_text("stand")
    with pytest.raises(ValueError, match="uint8"):
        encoder.encode_image(np.zeros((1, 8, 8, 3), np.float32))


def test_threads_change_nothing():
    observation = np.random.default_rng(0).normal(size=(64, 223)).astype(np.float32)
    one, two = (load_encoder("bundled", num_threads=threads).encode_state(observation) for threads in (1, 2))
    np.testing.assert_array_equal(one, two)


def test_missing_files_are_named(tmp_path):
    with pytest.raises(EncoderError, match="anyskill encoder train"):
        load_encoder("bundled", folder=tmp_path)


def test_a_corrupt_file_is_named(tmp_path):
    shutil.copytree(WEIGHTS_FOLDER, tmp_path / "weights")
    (tmp_path / "weights" / "text_head.onnx").write_bytes(b"not a model")
    with pytest.raises(EncoderError, match="text_head.onnx"):
        BundledEncoder(tmp_path / "weights")


def test_a_file_for_another_body_is_refused(tmp_path):
    shutil.copytree(WEIGHTS_FOLDER, tmp_path / "weights")
    path = tmp_path / "weights" / "state_projection.onnx"
    model = onnx.load(path)
    metadata = {entry.key: entry.value for entry in model.metadata_props} | {"model_xml_sha256": "0" * 64}
    onnx.helper.set_model_props(model, metadata)
    onnx.save(model, path)
    with pytest.raises(EncoderError, match="model_xml_sha256"):
        BundledEncoder(tmp_path / "weights")


def test_wrong_sentence_model_is_refused(tmp_path):
    file = tmp_path / "model.safetensors"
    with pytest.raises(TextModelError, match="missing"):
        verify_weights(file)
    file.write_bytes(b"other weights")
    with pytest.raises(TextModelError, match="sha256"):
        verify_weights(file)


def test_sentence_model_equals_transformers():
    torch = pytest.importorskip("torch")
    transformers = pytest.importorskip("transformers")
    texts = ["raise both arms above the head", "kick", "wave the right hand, please!"]
    states, mask = load_minilm().token_states(texts)
    folder = str(model_folder())
    model = transformers.BertModel.from_pretrained(folder).eval()
    tokenizer = transformers.AutoTokenizer.from_pretrained(folder)
    for row, text in enumerate(texts):
        with torch.no_grad():
            expected = model(**tokenizer([text], padding=False, return_tensors="pt")).last_hidden_state[0].numpy()
        assert mask[row].sum() == len(expected)
        np.testing.assert_allclose(states[row, : len(expected)], expected, atol=1e-4)


def test_shrinking_takes_means_of_areas():
    films = np.random.default_rng(0).integers(0, 256, (2, 1, 12, 8, 3)).astype(np.uint8)
    expected = films.reshape(2, 1, 4, 3, 4, 2, 3).astype(np.float64).mean((3, 5))
    np.testing.assert_allclose(shrink(films, 4), expected, atol=1e-3)
    uneven = shrink(np.full((1, 1, 7, 5, 3), 100, np.uint8), 3)
    np.testing.assert_allclose(uneven, 100.0, atol=1e-4)


def test_a_state_tower_that_was_trained_on_scenes_is_told_which_objects_are_there(tmp_path):
    """Its second input has, for each known object, whether it is there and its state; others are left out."""
    sizes = {"ball": 15, "door": 17}
    inputs = [("observation", 223), ("objects", sum(sizes.values()) + 2)]
    graph = onnx.helper.make_graph(
        [onnx.helper.make_node("Concat", [name for name, _ in inputs], ["feature"], axis=1)],
        "state",
        [onnx.helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, ["n", size]) for name, size in inputs],
        [onnx.helper.make_tensor_value_info("feature", onnx.TensorProto.FLOAT, ["n", None])],
    )
    model = onnx.helper.make_model(graph, opset_imports=[onnx.helper.make_opsetid("", 17)], ir_version=9)
    onnx.helper.set_model_props(model, contract("state") | {"feature_size": "257", "object_sizes": json.dumps(sizes)})
    onnx.save(model, tmp_path / "state_projection.onnx")
    shutil.copy(WEIGHTS_FOLDER / "text_head.onnx", tmp_path)
    encoder = BundledEncoder(tmp_path, cache="")
    assert isinstance(encoder, SceneEncoder) and encoder.object_sizes == sizes
    observation, door = np.ones((2, 223), np.float32), np.full((2, 17), 3.0, np.float32)
    feature = encoder.encode_state(observation, {"door": door, "chair": np.ones((2, 15), np.float32)})
    expected = np.concatenate([observation, np.zeros((2, 16)), np.ones((2, 1)), door], axis=1)
    np.testing.assert_array_equal(feature, expected)
    assert not encoder.encode_state(observation)[:, 223:].any()
    with pytest.raises(ValueError, match=r"'door' must be \(2, 17\), got \(2, 15\)"):
        encoder.encode_state(observation, {"door": door[:, :15]})
