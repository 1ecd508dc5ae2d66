"""Every reward against a direct evaluation of its formula, sums of rewards, and rewards along episodes."""

import numpy as np
import pytest
from envs_common import arguments  # noqa: F401  (registers the encoder "small")
from small_models import SmallEncoder

from rewards import EpisodicReward, HistoryRewardFn, RewardBatch, RewardFn, make_reward, reward_names
from rewards.object_state import ObjectState

COUNT, SIZE = 6, SmallEncoder.feature_size
# Texts that the fake encoder puts anywhere; the clip-s texts are left to their default.
TEXT = "wave the right hand"


def unit(values):
    return (values / np.linalg.norm(values, axis=-1, keepdims=True)).astype(np.float32)


@pytest.fixture
def batch():
    rng = np.random.default_rng(0)
    return RewardBatch(
        text_feature=unit(rng.normal(size=(COUNT, SIZE))),
        image_feature=unit(rng.normal(size=(COUNT, SIZE))),
        latent=unit(rng.normal(size=(COUNT, 64))),
        style_latent=unit(rng.normal(size=(COUNT, 64))),
        library_latents=unit(rng.normal(size=(10, 64))),
        velocity=rng.normal(size=(COUNT, 2)).astype(np.float32),
        facing=unit(rng.normal(size=(COUNT, 2))),
        objects={
            "ball": ObjectState.from_vector(rng.normal(size=(COUNT, 15)).astype(np.float32)),
            "door": ObjectState.from_vector(rng.normal(size=(COUNT, 17)).astype(np.float32)),
        },
        past_features=unit(rng.normal(size=(COUNT, 9, SIZE))),
    )


def cosine(a, b):
    a, b = np.float64(a), np.float64(b)
    return a @ b / np.sqrt(a @ a) / np.sqrt(b @ b)


def clip_distance(row):
    return 0.5 * cosine(row.image, row.text) + 0.5 * np.exp(-4 * np.sqrt(np.sum((row.latent - row.style) ** 2)))


def clip_nearest(row):
    return 0.3 * cosine(row.image, row.text) + 0.2 * max((cosine(row.latent, e) + 1) / 2 for e in row.library)


def delta(row):
    return cosine(row.image, row.text) - cosine(row.past[-1], row.text)


def avgpool(row):
    return cosine(np.mean([*row.past[-4:], row.image], axis=0), row.text)


def vlm_rm(row, alpha=0.3, baseline="a person"):
    b = np.float64(SmallEncoder().encode_text([baseline])[0])
    s, g = np.float64(row.image), np.float64(row.text)
    line = (g - b) / np.sqrt((g - b) @ (g - b))
    projected = b + ((s - b) @ line) * line  # the paper's form: a point of the line through b and g
    return 1 - 0.5 * np.sum((alpha * projected + (1 - alpha) * s - g) ** 2)


def clip_s(row, deviation=False):
    texts = SmallEncoder().encode_text(["stand still", "walk forward", "lie on the floor", "turn around"])
    scores = [2.5 * max(cosine(row.image, text), 0) for text in [row.text, *texts]]
    return (scores[0] - np.mean(scores)) / (np.std(scores, ddof=1) if deviation else 1)


def velocity_ase(row, speed=1.55, direction=(0.6, 0.8)):
    d = np.array(direction)
    along = row.velocity @ d
    tangential = np.sum(row.velocity - along * d)
    moving = np.exp(-0.25 * ((speed - along) ** 2 + 0.1 * tangential**2)) if along > 0 else 0
    return 0.7 * moving + 0.3 * max(0, row.facing @ d)


def velocity_anyskill(row):
    return 0.1 * np.exp(-0.25 * (0.2 - row.velocity[0]) ** 2) if row.velocity[0] > 0 else 0


def nearing(row, state, reach):
    distance = np.hypot(*state["position"][:2])
    turn = np.array([[row.facing[0], -row.facing[1]], [row.facing[1], row.facing[0]]])  # heading frame to world
    towards = turn @ (state["position"][:2] / distance) @ row.velocity
    if distance <= reach:
        return 1.0
    return 0.7 * np.exp(-0.5 * (distance - reach) ** 2) + 0.3 * np.exp(-(max(0, 1.0 - towards) ** 2))


def strike(row):
    speed = np.sqrt(np.sum(row.ball["linear_velocity"] ** 2))
    return 0.3 * nearing(row, row.ball, 0.4) + 0.7 * min(speed / 3.0, 1)


def opens(row):
    return 0.3 * nearing(row, row.door, 0.4) + 0.7 * min(max(row.door["angle"][0], 0) / 1.5, 1)


def sit(row):
    near = np.exp(-10 * np.sum((row.ball["position"] + [0, 0, 0.12]) ** 2))
    return 0.7 * near + 0.3 * near * np.exp(-2 * np.sum(row.velocity**2))


class Row:
    """One row of a batch, in double precision."""

    def __init__(self, batch, i):
        self.text, self.image = np.float64(batch.text_feature[i]), np.float64(batch.image_feature[i])
        self.latent, self.style = np.float64(batch.latent[i]), np.float64(batch.style_latent[i])
        self.library, self.past = np.float64(batch.library_latents), np.float64(batch.past_features[i])
        self.velocity, self.facing = np.float64(batch.velocity[i]), np.float64(batch.facing[i])
        self.ball, self.door = (
            {key: np.float64(value[i]) for key, value in vars(state).items()} for state in batch.objects.values()
        )


CASES = {
    "clip": ("clip", {}, clip_distance),
    "clip, nearest": ("clip", {"style": "nearest", "clip_weight": 0.3, "style_weight": 0.2}, clip_nearest),
    "style": ("style", {}, lambda row: np.exp(-4 * np.sqrt(np.sum((row.latent - row.style) ** 2)))),
    "delta": ("delta", {}, delta),
    "avgpool": ("avgpool", {"window": 5}, avgpool),
    "avgpool of one": ("avgpool", {"window": 1}, lambda row: cosine(row.image, row.text)),
    "vlm-rm": ("vlm-rm", {"alpha": 0.3, "baseline": "a person"}, vlm_rm),
    "vlm-rm, alpha 0": ("vlm-rm", {"alpha": 0.0}, lambda row: cosine(row.image, row.text)),
    "clip-s": ("clip-s", {}, clip_s),
    "clip-s / deviation": ("clip-s", {"divide_by_deviation": True}, lambda row: clip_s(row, True)),
    "clip-s alone": ("clip-s", {"other_texts": ()}, lambda row: 2.5 * max(cosine(row.image, row.text), 0)),
    "velocity": ("velocity", {"direction": (3.0, 4.0)}, velocity_ase),
    "approach": ("approach", {}, lambda row: nearing(row, row.ball, 0.5)),
    "approach the door": ("approach", {"object": "door", "reach": 0.8}, lambda row: nearing(row, row.door, 0.8)),
    "strike": ("strike", {}, strike),
    "open": ("open", {"object": "door"}, opens),
    "sit": ("sit", {}, sit),
    "velocity, anyskill": ("velocity", {"form": "anyskill"}, velocity_anyskill),
}


@pytest.mark.parametrize("case", CASES)
def test_formula(batch, case):
    name, kwargs, formula = CASES[case]
    reward = make_reward(name, encoder=SmallEncoder(), **kwargs)
    output = reward(batch)
    expected = [formula(Row(batch, i)) for i in range(COUNT)]
    np.testing.assert_allclose(output.total, expected, atol=1e-6)
    np.testing.assert_allclose(sum(output.terms.values()), output.total, atol=1e-7)
    if output.similarity is not None:
        np.testing.assert_allclose(
            output.similarity,
            [cosine(*pair) for pair in zip(batch.image_feature, batch.text_feature, strict=True)],
            atol=1e-6,
        )


def test_every_registered_reward_has_its_formula_tested_here():
    ours = {name for name in reward_names() if not name.endswith("for-test")}
    assert ours == {name for name, _, _ in CASES.values()}
    for name in ours:
        assert isinstance(make_reward(name, encoder="small"), RewardFn)


def test_without_its_baseline_direction_vlm_rm_only_counts_what_lies_in_it(batch):
    """Alpha 1: moving an image at right angles to the direction from baseline to goal changes nothing."""
    reward = make_reward("vlm-rm", encoder=SmallEncoder(), alpha=1.0)
    direction = unit(batch.text_feature - reward.baseline_feature)
    shift = np.ones(SIZE, np.float32) - direction.sum(1, keepdims=True) * direction
    moved = RewardBatch(text_feature=batch.text_feature, image_feature=batch.image_feature + shift)
    np.testing.assert_allclose(reward(moved).total, reward(batch).total, atol=1e-5)
    with pytest.raises(ValueError, match="another baseline"):
        reward.encode_text(["a humanoid robot"])


# Sums


def test_a_sum_weighs_every_term_and_encodes_what_is_seen_once(batch):
    calls = []

    class Counting(SmallEncoder):
        def encode_state(self, observation):
            calls.append(len(observation))
            return super().encode_state(observation)

    observation = np.random.default_rng(1).normal(size=(COUNT, 223)).astype(np.float32)
    unseen = RewardBatch(
        observation=observation,
        text_feature=batch.text_feature,
        velocity=batch.velocity,
        past_features=batch.past_features,
    )
    weights = {"vlm-rm": 0.6, "delta": 20.0, "avgpool": -0.5, "velocity": 0.1, "clip": 0.0}
    encoder = Counting()
    reward = make_reward(weights, encoder=encoder, velocity={"form": "anyskill"}, avgpool={"window": 4})
    assert isinstance(reward, HistoryRewardFn) and reward.history == 3
    assert reward.needs == {"state", "text", "velocity", "past_features"}
    output = reward(unseen)
    assert calls == [COUNT]
    parts = {
        "vlm_rm": make_reward("vlm-rm", encoder=encoder),
        "delta": make_reward("delta", encoder=encoder),
        "avgpool": make_reward("avgpool", encoder=encoder, window=4),
        "velocity": make_reward("velocity", form="anyskill"),
    }
    for (term, part), weight in zip(parts.items(), weights.values(), strict=False):
        np.testing.assert_allclose(output.terms[term], weight * part(unseen).total, atol=1e-6)
    assert output.terms.keys() == parts.keys()
    np.testing.assert_allclose(sum(output.terms.values()), output.total, atol=1e-6)


def test_a_sum_can_be_spelled_in_one_line(batch):
    spelled = make_reward("vlm-rm + 20*delta+-0.5 * avgpool", encoder="small")
    weights = {"vlm-rm": 1.0, "delta": 20.0, "avgpool": -0.5}
    assert spelled.weights == weights
    np.testing.assert_array_equal(spelled(batch).total, make_reward(weights, encoder="small")(batch).total)
    assert make_reward("2*clip+0.5*clip", encoder="small").weights == {"clip": 2.5}


@pytest.mark.parametrize(
    ("weights", "kwargs", "error", "message"),
    [
        ({"clop": 1.0}, {}, ValueError, "'clop'.*avgpool, clip"),
        ({"clip": 0.0}, {}, ValueError, "at least one"),
        ({"clip": np.nan}, {}, ValueError, "finite"),
        ({"clip": 1.0}, {"velocity": {"speed": 1.0}}, TypeError, "'velocity', which is no part"),
        ({"clip": 1.0}, {"clip": {"weigth": 1.0}}, TypeError, "weigth"),
        ({"clip": 1.0, "delta": 1.0}, {"clip": {"source": "frames"}}, ValueError, "one source"),
        ("clip+", {}, ValueError, 'the reward .*write sums like "clip'),
        ("clip+half*velocity", {}, ValueError, "'half.velocity'"),
        ("clip+nan*velocity", {}, ValueError, "write sums like"),
        ("clip+0.5*beauty", {}, ValueError, "'beauty'.*avgpool, clip"),
        ("strike", {"speed": 0.0}, ValueError, "speed that earns most must be a positive"),
        ("open", {"angle": np.nan}, ValueError, "angle that earns most must be a positive"),
        ("avgpool", {"window": 0}, ValueError, "at least 1 frame"),
        ("vlm-rm", {"alpha": 1.5}, ValueError, "between 0 and 1"),
        ("clip-s", {"other_texts": "walk"}, ValueError, "list of texts"),
        ("clip-s", {"other_texts": [], "divide_by_deviation": True}, ValueError, "needs other_texts"),
        ("style", {"form": "far"}, ValueError, "distance"),
        ("velocity", {"form": "calm"}, ValueError, "anyskill"),
        ("velocity", {"direction": (0.0, 0.0)}, ValueError, "direction"),
        ("velocity", {"speed": np.inf}, ValueError, "finite"),
    ],
)
def test_bad_arguments(weights, kwargs, error, message):
    with pytest.raises(error, match=message):
        make_reward(weights, encoder="small", **kwargs)


# Along episodes


def test_an_episode_is_given_its_text_and_its_past():
    rng = np.random.default_rng(2)
    states = rng.normal(size=(5, 2, 223)).astype(np.float32)  # start and four steps of two environments
    encoder = SmallEncoder()
    features = np.stack([encoder.encode_state(state) for state in states])
    texts = ["squat down", "wave"]
    episode = EpisodicReward(make_reward({"delta": 1.0, "avgpool": 1.0}, encoder=encoder, avgpool={"window": 3}), texts)
    with pytest.raises(ValueError, match="start"):
        episode(RewardBatch(observation=states[0]))
    episode.start(np.arange(2), RewardBatch(observation=states[0]))
    for step in range(1, 5):
        if step == 3:  # the second one starts anew, from the state of step 2, with another text
            episode.set_texts(np.array([1]), ["kick"])
            episode.start(np.array([1]), RewardBatch(observation=states[2, 1:]))
        output = episode(RewardBatch(observation=states[step]))
        for i in range(2):
            text = encoder.encode_text(["kick" if (i, step) >= (1, 3) else texts[i]])[0]
            first = 2 if (i, step) >= (1, 3) else 0
            window = [features[max(k, first), i] for k in range(step - 2, step + 1)]
            change = (features[step, i] - features[step - 1, i]) @ text
            assert output.terms["delta"][i] == pytest.approx(change, abs=1e-6)
            assert output.terms["avgpool"][i] == pytest.approx(cosine(np.mean(window, axis=0), text), abs=1e-6)


def test_too_short_a_past_is_refused(batch):
    short = RewardBatch(
        text_feature=batch.text_feature, image_feature=batch.image_feature, past_features=batch.past_features[:, :2]
    )
    with pytest.raises(ValueError, match="7 earlier steps"):
        make_reward("avgpool", encoder="small")(short)
