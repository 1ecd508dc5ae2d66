"""Encoders from `transformers`: parity with plain calls on a small random CLIP, and errors that help."""

import pickle
import sys

import numpy as np
import pytest
from small_models import write_clip

from rewards import RewardBatch, load_encoder, make_reward
from rewards.encoders import Encoder

torch = pytest.importorskip("torch")
transformers = pytest.importorskip("transformers")

TEXTS = ["wave the right hand", "squat", "raise both arms above the head and hold them there"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return write_clip(tmp_path_factory.mktemp("clip"))


@pytest.fixture(scope="module")
def encoder(folder):
    return load_encoder(str(folder), batch_size=2)


def pictures(count=3):
    return np.random.default_rng(0).integers(0, 256, (count, 40, 60, 3), dtype=np.uint8)


def unit(values):
    return values / np.linalg.norm(values, axis=-1, keepdims=True)


def test_features_are_those_of_plain_transformers(folder, encoder):
    from PIL import Image

    model = transformers.CLIPModel.from_pretrained(folder).eval()
    tokenizer = transformers.AutoTokenizer.from_pretrained(folder)
    processor = transformers.CLIPImageProcessorPil.from_pretrained(folder)
    frames = pictures()
    with torch.no_grad():
        output = model(
            **tokenizer(TEXTS, padding=True, truncation=True, max_length=20, return_tensors="pt"),
            **processor([Image.fromarray(frame) for frame in frames], return_tensors="pt"),
        )
    np.testing.assert_allclose(encoder.encode_text(TEXTS), output.text_embeds.numpy(), atol=1e-6)
    np.testing.assert_allclose(encoder.encode_image(frames), output.image_embeds.numpy(), atol=1e-6)
    assert isinstance(encoder, Encoder) and encoder.feature_size == 12


def test_a_film_is_the_mean_of_its_frames(encoder):
    films = pictures(6).reshape(2, 3, 40, 60, 3)
    expected = unit(encoder.encode_image(pictures(6)).reshape(2, 3, 12).mean(1))
    np.testing.assert_allclose(encoder.encode_image(films), expected, atol=1e-6)


def test_an_exported_model_has_the_same_features(folder, encoder, tmp_path):
    pytest.importorskip("onnxscript")
    from rewards.onnx_encoder import OnnxEncoder, export_encoder

    target = tmp_path / "exported"
    assert export_encoder(encoder, target) < 1e-5
    exported = load_encoder(str(target), batch_size=2)
    assert isinstance(exported, OnnxEncoder) and isinstance(exported, Encoder) and exported.feature_size == 12
    films = pictures(6).reshape(2, 3, 40, 60, 3)
    for copy in (exported, pickle.loads(pickle.dumps(exported))):
        np.testing.assert_allclose(copy.encode_text(TEXTS), encoder.encode_text(TEXTS), atol=1e-5)
        np.testing.assert_allclose(copy.encode_text(TEXTS[1:2]), encoder.encode_text(TEXTS[1:2]), atol=1e-5)
        np.testing.assert_allclose(copy.encode_image(pictures(5)), encoder.encode_image(pictures(5)), atol=1e-5)
        np.testing.assert_allclose(copy.encode_image(films), encoder.encode_image(films), atol=1e-5)
    assert make_reward("vlm-rm", encoder=exported).needs == {"frames", "text"}
    assert exported.name == str(folder)
    with pytest.raises(FileExistsError, match="not empty"):
        export_encoder(encoder, target)
    (target / "text.onnx").write_bytes(b"half a file")
    with pytest.raises(ValueError, match="not a readable ONNX"):
        load_encoder(str(target))


def test_rewards_look_at_pictures_with_it(encoder):
    reward = make_reward("vlm-rm", encoder=encoder)
    assert reward.needs == {"frames", "text"}
    output = reward(RewardBatch(frames=pictures(), text_feature=reward.encode_text(["squat"])[0]))
    np.testing.assert_allclose(output.similarity, encoder.encode_image(pictures()) @ encoder.encode_text(["squat"])[0])
    with pytest.raises(ValueError, match="no state projection"):
        make_reward("clip", encoder=encoder, source="state")
    with pytest.raises(NotImplementedError, match="frames"):
        encoder.encode_state(np.zeros((1, 223), np.float32))


def test_without_network_the_error_says_how_to_go_on(monkeypatch):
    monkeypatch.setattr("huggingface_hub.constants.HF_HUB_OFFLINE", True)
    with pytest.raises(FileNotFoundError, match="hf download nobody/no-such-clip --local-dir FOLDER"):
        load_encoder("hf:nobody/no-such-clip")


@pytest.mark.parametrize("missing", ["model.safetensors", "preprocessor_config.json", "tokenizer.json"])
def test_a_folder_that_is_not_a_whole_model(folder, tmp_path, missing):
    for file in folder.iterdir():
        if file.name != missing:
            (tmp_path / file.name).write_bytes(file.read_bytes())
    with pytest.raises(
        FileNotFoundError, match=r"not hold a whole model of transformers \(.*It needs config.json, the weights"
    ):
        load_encoder(str(tmp_path))


def test_a_model_that_is_no_clip(folder, tmp_path):
    transformers.BertModel(
        transformers.BertConfig(
            hidden_size=8, intermediate_size=8, num_hidden_layers=1, num_attention_heads=1, vocab_size=9
        )
    ).save_pretrained(tmp_path)
    with pytest.raises(ValueError, match="BertModel.*no CLIP-like model"):
        load_encoder(str(tmp_path))


def test_missing_package_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "transformers", None)
    with pytest.raises(ImportError, match=r"pip install .*encoder"):
        load_encoder("hf:nobody/no-such-clip")
