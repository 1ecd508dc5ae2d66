"""What an encoder is measured by: facts about poses, figures of a perfect and of a blind encoder, cards."""

import numpy as np
import pytest

pytest.importorskip("torch")

from agents.encoder.captions import Caption, CaptionSet
from agents.encoder.card import BEGIN, END, update_figures
from agents.encoder.evaluation import EncoderReport, unseen
from agents.encoder.free_sentences import Moments
from agents.encoder.pose_facts import FACT_NAMES, FACTS, measure_facts, pose_captions
from agents.encoder.pose_figures import rule_figures, sentence_figures
from motion_data.skeleton import joint_index, joint_limits, rest_qpos


def posed(**degrees):
    qpos = rest_qpos()
    for name, angle in degrees.items():
        qpos[7 + joint_index(name)] = np.radians(angle)
    return qpos


def random_poses(count=400):
    rng = np.random.default_rng(0)
    low, high = joint_limits().T
    poses = np.repeat(rest_qpos()[None], count, 0)
    poses[:, 7:] = 0.7 * rng.uniform(low, high, (count, len(low)))
    return poses


def holds(qpos, fact):
    return measure_facts(qpos[None])[0, FACT_NAMES.index(fact)]


class PerfectEncoder:
    """Reads the facts of a caption off its words; its features of poses are the facts themselves."""

    def encode_text(self, texts):
        said = np.array([[any(words in text for words in fact.wordings) for fact in FACTS] for text in texts], float)
        return (said / np.linalg.norm(said, axis=1, keepdims=True)).astype(np.float32)

    def features(self, values):
        return np.where(values >= 0.999, 1.0, np.where(values <= 0.001, -1.0, 0.0)).astype(np.float32)


class DeafEncoder(PerfectEncoder):
    """Its features of states hold all facts, but all texts are the same to it."""

    def encode_text(self, texts):
        return np.ones((len(texts), len(FACTS)), np.float32) / np.sqrt(len(FACTS))


def test_facts_of_poses_that_were_put_together_by_hand():
    assert holds(posed(right_shoulder_y=-175), "wrist_high.right") == 1.0
    assert holds(posed(right_shoulder_y=-175), "wrist_high.left") == 0.0
    assert holds(rest_qpos(), "wrist_low.left") == 1.0
    assert holds(rest_qpos(), "hips_high") == 1.0
    assert holds(posed(left_shoulder_y=-90), "wrist_ahead.left") == 1.0
    assert holds(posed(left_elbow=-100), "elbow_sharp.left") == 1.0


def test_a_perfect_encoder_has_perfect_figures_and_a_blind_one_is_at_chance():
    values = measure_facts(random_poses())
    assert (values >= 0).all() and (values <= 1).all()
    encoder, rng = PerfectEncoder(), np.random.default_rng(1)
    figures = rule_figures(encoder, encoder.features(values), values, rng, trials=2)
    assert figures["captions"] >= 300
    for name in ("recall@1", "recall@5", "left or right", "up or down", "which limb"):
        assert figures[name] == 1.0, name
    assert figures["paraphrases"] == pytest.approx(1.0, abs=1e-6)
    noise = rng.normal(size=values.shape).astype(np.float32)
    figures = rule_figures(encoder, noise, values, rng, trials=2)
    assert figures["recall@1"] < 0.05
    assert 0.35 < figures["left or right"] < 0.65
    assert figures["recall@1 without words"] < 0.1


def test_without_words_it_is_the_features_that_count():
    values = measure_facts(random_poses())
    figures = rule_figures(DeafEncoder(), DeafEncoder().features(values), values, np.random.default_rng(1), trials=2)
    assert figures["recall@1"] < 0.2 < 0.5 < figures["recall@1 without words"]


def test_captions_say_what_few_poses_share():
    values = np.zeros((10, len(FACTS)))
    values[:, 0] = 1.0  # of all poses: tells none apart
    values[3, 5] = 1.0
    (caption,) = pose_captions(values)
    assert caption.pose == 3 and caption.facts == (5,) and caption.texts == FACTS[5].wordings


def test_a_sentence_is_looked_for_among_the_moments_of_all():
    class Echo:
        def encode_text(self, texts):
            return np.eye(len(texts), dtype=np.float32)

    right, swapped = np.eye(10, dtype=np.float32), np.eye(10, dtype=np.float32)[[1, 0, *range(2, 10)]]
    assert sentence_figures(Echo(), right, [str(index) for index in range(10)])["recall@1"] == 1.0
    figures = sentence_figures(Echo(), swapped, [str(index) for index in range(10)])
    assert figures["recall@1"] == pytest.approx(0.8)


def test_a_free_sentence_that_training_knows_is_left_out():
    films, observations = np.arange(3)[:, None, None] * np.ones((3, 4, 35)), np.arange(3)[:, None] * np.ones((3, 223))
    moments = Moments(("Bow", "like a scarecrow", "hail a taxi"), ("a", "b", "c"), observations, films)
    left = unseen(moments, CaptionSet((), (Caption("like a scarecrow", (0,)), Caption("bow", (1,))), ()))
    assert left.sentences == ("hail a taxi",) and left.clips == ("c",)
    assert left.observations.min() == 2 and left.films.shape == (1, 4, 35) and left.films.min() == 2


def test_figures_of_a_card_are_replaced_and_the_rest_stays(tmp_path):
    report = EncoderReport({"image": {"rules": {"recall@1": 0.5}}}, {}, [], (7, 3))
    card = tmp_path / "CARD.md"
    card.write_text(f"# Mine\n\n{BEGIN}\nold\n{END}\n\n## Limits\n")
    update_figures(card, report, "mine")
    text = card.read_text()
    assert text.startswith("# Mine\n") and text.endswith("## Limits\n") and "old" not in text
    assert "| rules | recall@1 | - | 0.500 |" in text
    update_figures(card, report, "mine")
    assert card.read_text() == text
    card.write_text("# no marks")
    with pytest.raises(ValueError, match="has no lines"):
        update_figures(card, report, "mine")
