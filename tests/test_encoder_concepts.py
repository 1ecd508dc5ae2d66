"""The rules behind the captions: what is true of poses that were put together by hand."""

import numpy as np
import pytest

from agents.encoder.captions import Caption, gerund, mirrored_caption, third_person, variants, write_captions
from agents.encoder.concepts import CONCEPTS
from agents.encoder.measurements import WINDOW, Measurements, ramp
from motion_data.authored import authored_clips
from motion_data.skeleton import forward_kinematics, joint_index, mirror_qpos, rest_qpos


def posed(**degrees):
    qpos = rest_qpos()
    for name, angle in degrees.items():
        qpos[7 + joint_index(name)] = np.radians(angle)
    return qpos


def measured(motions):
    """Measurements of motions (n, WINDOW, 35)."""
    positions, quaternions = forward_kinematics(np.concatenate(motions))
    count = len(motions)
    return Measurements(positions.reshape(count, WINDOW, 15, 3), quaternions.reshape(count, WINDOW, 15, 4))


def still(qpos):
    return np.repeat(qpos[None], WINDOW, 0)


def truth(concept, motion):
    return float(CONCEPTS[concept].rule(measured([motion]))[0])


ARMS_UP = still(posed(right_shoulder_y=-175, left_shoulder_y=-175))
RIGHT_UP = still(posed(right_shoulder_y=-175))
REST = still(rest_qpos())


def test_raised_arms_are_told_from_hanging_ones_and_from_one_raised_arm():
    assert truth("arms_up", ARMS_UP) > 0.95
    assert truth("arms_up", REST) < 0.05
    assert 0.05 < truth("arms_up", RIGHT_UP) < 0.5
    assert truth("arm_up.right", RIGHT_UP) > 0.95
    assert truth("arm_up.left", RIGHT_UP) < 0.1
    assert truth("arms_down", REST) > 0.95


def test_grades_rise_all_the_way():
    grades = [
        truth("arms_up", still(posed(right_shoulder_y=-angle, left_shoulder_y=-angle))) for angle in range(0, 181, 20)
    ]
    assert (np.diff(grades) > -1e-9).all()
    assert np.count_nonzero(np.diff(grades) > 0.01) >= 6


def test_a_fallen_body_raises_no_arms():
    fallen = ARMS_UP.copy()
    fallen[:, 2] = 0.1
    fallen[:, 3:7] = [np.sqrt(0.5), 0, -np.sqrt(0.5), 0]
    assert truth("arms_up", fallen) < 0.05
    assert truth("lie_back", fallen) > 0.9


def test_waving_needs_a_moving_hand():
    swinging = np.stack(
        [
            posed(right_shoulder_x=-112, right_shoulder_z=-90, right_elbow=-60 + 40 * np.sin(frame))
            for frame in range(WINDOW)
        ]
    )
    held = still(posed(right_shoulder_x=-112, right_shoulder_z=-90, right_elbow=-60))
    assert truth("wave.right", swinging) > 0.9
    assert truth("wave.right", held) < 0.4
    assert truth("wave.left", swinging) < 0.1


def test_walking_needs_travel_in_the_direction_faced():
    stride = np.stack(
        [posed(left_hip_y=-25 * np.sin(frame / 3), right_hip_y=25 * np.sin(frame / 3)) for frame in range(WINDOW)]
    )
    forward, backward = stride.copy(), stride.copy()
    forward[:, 0] = np.arange(WINDOW) / 30 * 1.2
    backward[:, 0] = -forward[:, 0]
    assert truth("walk", forward) > 0.8
    assert truth("walk", stride) < 0.1
    assert truth("walk", backward) < 0.05
    assert truth("walk_back", backward) > 0.8


@pytest.mark.parametrize(
    ("clip", "concept", "other"),
    [
        ("squat", "squat", "arms_up"),
        ("kick_left", "kick.left", "kick.right"),
        ("bow", "bow", "lean_back"),
        ("kneel_right", "kneel.right", "kneel.left"),
        ("t_pose", "arms_sideways", "arms_forward"),
        ("turn_left", "turn.left", "turn.right"),
        ("raise_right_knee", "knee_up.right", "knee_up.left"),
    ],
)
def test_authored_clips_fulfil_their_concepts(clip, concept, other):
    qpos = next(one for one in authored_clips() if one.name == clip).qpos
    m = measured([qpos[start : start + WINDOW] for start in range(0, len(qpos) - WINDOW, 3)])
    assert CONCEPTS[concept].rule(m).max() > 0.75
    assert CONCEPTS[other].rule(m).max() < 0.35


def test_all_rules_stay_between_0_and_1_and_mirror():
    rng = np.random.default_rng(0)
    clips = authored_clips()
    motions = []
    for _ in range(60):
        qpos = clips[rng.integers(len(clips))].qpos
        start = rng.integers(len(qpos) - WINDOW)
        motions.append(qpos[start : start + WINDOW])
    plain, mirrored = measured(motions), measured([mirror_qpos(motion) for motion in motions])
    swap = {"left": "right", "right": "left"}
    for name, concept in CONCEPTS.items():
        base, _, side = name.rpartition(".")
        partner = CONCEPTS[f"{base}.{swap[side]}"] if side in swap else concept
        value = concept.rule(plain)
        assert value.shape == (60,)
        assert (value >= 0).all() and (value <= 1).all(), name
        np.testing.assert_allclose(partner.rule(mirrored), value, atol=1e-6, err_msg=name)


def test_ramp_goes_both_ways():
    np.testing.assert_allclose(ramp(np.array([-1.0, 0.5, 2.0]), 0, 1), [0, 0.5, 1])
    np.testing.assert_allclose(ramp(np.array([-1.0, 0.25, 2.0]), 1, 0), [1, 0.75, 0])


def test_grammar():
    assert third_person("raise the arm") == "raises the arm"
    assert third_person("push forward") == "pushes forward"
    assert third_person("hands up") is None
    assert gerund("wave the hand") == "waving the hand"
    assert gerund("put up one hand") == "putting up one hand"
    assert gerund("lie down") == "lying down"
    assert "the humanoid kicks" in variants("kick")


def test_held_out_wordings_are_not_trained_on_and_firsts_are():
    captions = write_captions(np.random.default_rng(1), pairs=50)
    trained = {caption.text for caption in captions.training}
    assert captions.held_out
    assert not trained & {caption.text for caption in captions.held_out}
    assert all(concept.phrases[0] in trained for concept in captions.concepts)


def test_pairs_are_true_as_far_as_both_are():
    captions = write_captions(np.random.default_rng(2), pairs=0)
    truths = np.array([[1.0, 0.0, 0.5]])
    graded = captions.truth([Caption("", (0,)), Caption("", (0, 1)), Caption("", (0, 2))], truths)
    np.testing.assert_allclose(graded, [[1.0, 0.25, 0.625]])
    of_three = captions.truth([Caption("", (0, 1, 2)), Caption("", (2,))], truths)
    np.testing.assert_allclose(of_three, [[0.25, 0.5]])


def test_mirrored_caption_exchanges_words_and_meaning():
    concepts = list(CONCEPTS.values())
    names = list(CONCEPTS)
    caption = Caption("kick with the left leg and bow", (names.index("kick.left"), names.index("bow")))
    mirrored = mirrored_caption(caption, concepts)
    assert mirrored.text == "kick with the right leg and bow"
    assert mirrored.concepts == (names.index("kick.right"), names.index("bow"))
