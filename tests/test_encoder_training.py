"""A tiny training of the encoder, from motions to files that load, and that goes on where it stopped."""

import numpy as np
import pytest

pytest.importorskip("torch")

import torch

from agents.encoder.concepts import CONCEPTS
from agents.encoder.config import EncoderConfig
from agents.encoder.dataset import MotionSet, smooth_path
from agents.encoder.free_sentences import read_sentences
from agents.encoder.material import motion_library
from agents.encoder.relations import relation_concepts
from agents.encoder.sampling import concept_weights
from agents.encoder.scenes import ObjectLayout
from agents.encoder.symmetry import symmetric_tower
from agents.encoder.towers import build_towers, grading_loss
from agents.encoder.train import train
from anyskill_envs.objects import load_object
from anyskill_envs.observation import MIRROR_INDEX, MIRROR_SIGN
from motion_data.skeleton import rest_qpos
from rewards.bundled import BundledEncoder

TINY = {
    "only": ("arms_up", "arms_down", "squat", "legs_straight", "arm_up.right", "arm_up.left", "stand_still"),
    "rounds": 1,
    "tracks": 8,
    "per_track": 8,
    "caption_pairs": 4,
    "caption_triples": 2,
    "feature_size": 32,
    "state_batch": 64,
    "caption_batch": 32,
    "lessons": 200,
    "lesson_batch": 16,
    "phrases": 3,
    "steps": 200,
    "symmetry_steps": 150,
    "symmetric_hidden": 128,
    "image_motions": 24,
    "image_epochs": 1,
    "image_batch": 8,
}


def test_a_tiny_training_writes_an_encoder_that_loads(tmp_path, monkeypatch):
    monkeypatch.setattr("agents.encoder.train.HELD_OUT_PICTURES", 120)
    monkeypatch.setattr("agents.encoder.train.HELD_OUT_TRACKS", 8)
    monkeypatch.setattr("agents.encoder.pose_figures.MOST_CAPTIONS", 20)
    config = EncoderConfig(run=tmp_path / "run", out=tmp_path / "weights", **TINY)
    assert train(config) == 0
    encoder = BundledEncoder(tmp_path / "weights", cache="")
    assert encoder.feature_size == 32
    motions = MotionSet.load(tmp_path / "run" / "motions.npz")
    assert np.isfinite(motions.observations).all()
    assert (motions.truths >= 0).all() and (motions.truths <= 1).all()
    assert set(motions.sources.tolist()) >= {0, 1, 2, 3}
    features = encoder.encode_state(motions.observations)
    mirrored = encoder.encode_state(motions.observations[:, MIRROR_INDEX] * MIRROR_SIGN)
    own, exchanged = encoder.encode_text(["raise the left arm", "raise the right arm"])
    np.testing.assert_allclose(features @ own, mirrored @ exchanged, atol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(features, axis=1), 1, atol=1e-5)
    similarity = features @ encoder.encode_text(["raise both arms above the head"])[0]
    stored = torch.load(tmp_path / "run" / "towers.pt", weights_only=True)
    weight = "state.layers.0.weight"
    assert not torch.equal(stored["averaged"][weight], stored["modules"][weight])
    tower = build_towers(config, motions, ObjectLayout(config.objects)).state.eval()
    tower.load_state_dict({name[6:]: value for name, value in stored["averaged"].items() if name.startswith("state.")})
    student = symmetric_tower(config, tower, motions, ObjectLayout(config.objects), tmp_path / "run" / "symmetric.pt")
    with torch.no_grad():
        nothing = torch.zeros(len(motions), motions.objects.shape[1])
        mean = tower(torch.from_numpy(motions.observations), nothing).numpy()
        symmetric = student(torch.from_numpy(motions.observations), nothing).numpy()
    np.testing.assert_allclose(features, symmetric, atol=1e-4)
    own_half = features[:, : mean.shape[1]] * 2**0.5
    assert (own_half * mean).sum(1).mean() > 0.95  # the exported tower has learned from the running mean
    grade = motions.truths[:, TINY["only"].index("arms_up")].astype(np.float32)
    assert np.corrcoef(similarity, grade)[0, 1] > 0.5
    card = (tmp_path / "weights" / "MODEL_CARD.md").read_text()
    assert "{{" not in card and "recall@1" in card
    # Every stage is done: a second call trains nothing and writes the same files.
    before = (tmp_path / "weights" / "state_projection.onnx").read_bytes()
    assert train(config) == 0
    assert (tmp_path / "weights" / "state_projection.onnx").read_bytes() == before


def test_unknown_concepts_are_named(tmp_path):
    with pytest.raises(ValueError, match="juggle"):
        train(EncoderConfig(run=tmp_path, only=("juggle",)))


def test_grading_loss_is_least_for_similarities_that_grade():
    generator = torch.Generator().manual_seed(0)
    truth = torch.rand(200, 7, generator=generator)
    good = sum(grading_loss((truth - 0.5) * 0.8, truth, torch.tensor(5.0), torch.tensor(0.0)))
    bad = sum(grading_loss((0.5 - truth) * 0.8, truth, torch.tensor(5.0), torch.tensor(0.0)))
    none = sum(grading_loss(torch.zeros(200, 7), truth, torch.tensor(5.0), torch.tensor(0.0)))
    assert good < none < bad


def test_a_caption_about_an_object_is_graded_among_scenes_with_it():
    """That nothing is true of a ball where there is none does not help: only the order beside a ball counts."""
    beside, away = torch.tensor([[0.1], [0.2], [0.3], [0.9]]), torch.zeros(4, 1)
    truth, there = torch.cat([beside, away]), torch.cat([torch.ones(4, 1), torch.zeros(4, 1)])
    knows_of_the_ball = torch.cat([torch.full((4, 1), 0.5) - beside / 10, away])
    scale, bias = torch.tensor(5.0), torch.tensor(0.0)
    assert grading_loss(knows_of_the_ball, truth, scale, bias)[1] < 0.5
    assert grading_loss(knows_of_the_ball, truth, scale, bias, there)[1] > 1.9
    assert grading_loss(truth, truth, scale, bias, there)[1] < 1e-3


def test_relations_have_a_share_of_their_own():
    concepts = [*list(CONCEPTS.values())[:6], *relation_concepts([load_object("ball")])]
    weights = concept_weights(concepts, 0.4)
    assert weights.sum() == pytest.approx(1) and weights[6:].sum() == pytest.approx(0.4)
    assert concept_weights(concepts[:6], 0.4) == pytest.approx(np.full(6, 1 / 6))


def test_random_paths_stay_between_their_poses():
    rng = np.random.default_rng(0)
    path = smooth_path(rng, 90, lambda count: rng.uniform(-1, 1, (count, 4)), (0.3, 0.6))
    assert path.shape == (90, 4)
    assert np.abs(path).max() <= 1.0
    assert np.abs(np.diff(path, axis=0)).max() < 0.6


def test_the_library_holds_every_clip_and_its_mirror_image_once():
    clips = motion_library()
    names = [clip.name for clip in clips]
    assert len(set(names)) == len(names)
    assert "walk_mirrored" in names and "kick_left" in names and "kick_left_mirrored" not in names
    assert all(clip.qpos.shape[1] == len(rest_qpos()) for clip in clips)
    sentences = read_sentences()
    assert len(sentences) == len({text for _, text in sentences}) == len({clip for clip, _ in sentences}) == 100
    assert {clip for clip, _ in sentences} <= set(names)
