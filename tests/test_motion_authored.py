"""The authored clips are what they say: in balance, feet on the floor, limbs where the text puts them."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from motion_data.authored import authored_clips, read_authored
from motion_data.clip import swap_sides
from motion_data.inverse_kinematics import centre_of_mass, floor_reach
from motion_data.skeleton import body_index, joint_limits, kinematics

CLIPS = {clip.name: clip for clip in authored_clips()}
# On its toes the humanoid stands on the front edges of two boxes: for a moment, not in balance.
TIPTOE = {"toe_raise"}

each_clip = pytest.mark.parametrize("name", CLIPS)


def body(name, part):
    """Path of a body, (T, 3)."""
    return kinematics(CLIPS[name].qpos).positions[:, body_index(part)]


def test_there_are_enough_and_they_are_labelled():
    assert len(CLIPS) >= 44
    for clip in CLIPS.values():
        assert len(set(clip.labels)) >= 3
        assert clip.categories[0] in ("move_around", "act_in_place", "combined")
        assert clip.categories[1] in ("attack", "crawl", "jump", "dance", "usual")
        assert 1.9 <= clip.duration <= 8


@each_clip
def test_joints_stay_inside_their_limits(name):
    angles, limits = CLIPS[name].qpos[:, 7:], joint_limits()
    assert (angles >= limits[:, 0]).all() and (angles <= limits[:, 1]).all()


@each_clip
def test_motion_is_smooth(name):
    clip = CLIPS[name]
    assert np.abs(np.diff(clip.qpos[:, 7:], axis=0)).max() < 0.4
    assert np.abs(clip.qvel[:, 6:]).max() < 12.5


@each_clip
def test_the_lowest_point_is_on_the_floor(name):
    assert np.abs(kinematics(CLIPS[name].qpos).lowest).max() < 0.015


def support(pose, frame):
    """Points of feet and knees that touch the floor, (k, 2)."""
    points = []
    for side in ("right", "left"):
        foot = body_index(f"{side}_foot")
        rotation = Rotation.from_quat(pose.quaternions[frame, foot], scalar_first=True)
        corners = rotation.apply(floor_reach(side)) + pose.positions[frame, foot]
        points += [corner[:2] for corner in corners if corner[2] < 0.015]
        knee = pose.positions[frame, body_index(f"{side}_shin")]
        if knee[2] < 0.07:
            points.append(knee[:2])
    return np.array(points)


@pytest.mark.parametrize("name", sorted(CLIPS.keys() - TIPTOE))
def test_the_weight_rests_on_what_touches_the_floor(name):
    """The zero-moment point lies inside the support, or at most 5 cm outside while a foot rolls off."""
    clip = CLIPS[name]
    pose, centre = kinematics(clip.qpos), centre_of_mass(clip.qpos)
    acceleration = np.gradient(np.gradient(centre, 1 / clip.fps, axis=0), 1 / clip.fps, axis=0)
    pressure = centre[:, :2] - centre[:, 2:] / 9.81 * acceleration[:, :2]
    angles = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    directions = np.stack([np.cos(angles), np.sin(angles)])
    for frame in range(len(clip)):
        margin = (support(pose, frame) @ directions).max(0) - pressure[frame] @ directions
        assert margin.min() > -0.05, f"frame {frame}"


@pytest.mark.parametrize("name", [name for name, clip in CLIPS.items() if clip.loop])
def test_loops_end_where_they_begin(name):
    qpos = CLIPS[name].qpos
    assert np.abs(qpos[-1] - qpos[0]).max() < 1e-3


def test_standing_feet_do_not_slide():
    for name in ("raise_both_arms", "deep_bow", "squat", "sit_low", "kick_right"):
        foot = body(name, "left_foot")
        assert np.ptp(foot, axis=0).max() < 1e-3, name


def test_limbs_are_where_the_text_puts_them():
    head = body_index("head")
    for part in ("right_hand", "left_hand"):
        up = body("raise_both_arms", part)[:, 2] > body("raise_both_arms", "head")[:, 2] + 0.3
        assert up.mean() > 0.5
    positions = kinematics(CLIPS["wave_right_hand"].qpos).positions
    hand = positions[:, body_index("right_hand")]
    assert (hand[15:-20, 2] > positions[15:-20, head, 2]).all()
    assert np.ptp(hand[20:-20, 1]) > 0.25
    assert (positions[:, body_index("left_hand"), 2] < 1.0).all()
    assert body("kick_left", "left_foot")[:, 2].max() > 0.45
    assert body("kick_left", "right_foot")[:, 2].max() < 0.1
    assert body("squat", "pelvis")[:, 2].min() < 0.6
    assert body("sit_low", "pelvis")[:, 2].min() < 0.4
    assert body("kneel_right", "right_shin")[:, 2].min() < 0.065
    assert body("kneel_right", "left_shin")[:, 2].min() > 0.2
    assert (CLIPS["slow_walk"].qpos[-1, 0] - CLIPS["slow_walk"].qpos[0, 0]) > 0.9
    assert (CLIPS["step_backward"].qpos[-1, 0] - CLIPS["step_backward"].qpos[0, 0]) < -0.5
    assert (CLIPS["step_left"].qpos[-1, 1] - CLIPS["step_left"].qpos[0, 1]) > 0.4
    assert np.abs(body("point_right", "right_hand")[60, 2] - 1.38) < 0.1
    assert body("point_right", "right_hand")[60, 1] < -0.6


def test_mirrored_twins_swap_their_sides_in_motion_and_words():
    pairs = [(name, swap_sides(name.replace("_", " ")).replace(" ", "_")) for name in CLIPS]
    pairs = [(name, twin) for name, twin in pairs if twin != name]
    assert len(pairs) >= 30
    for name, twin in pairs:
        assert CLIPS[twin].labels == tuple(map(swap_sides, CLIPS[name].labels))
        np.testing.assert_allclose(CLIPS[name].mirrored().qpos, CLIPS[twin].qpos, atol=1e-9)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ("[{}, {seconds: 1, right_elbo: 3}]", "unknown fields"),
        ("[{}, {seconds: 1, pose: flying}]", "unknown pose 'flying'"),
        ("[{}, {seconds: 1, weight: middle}]", "weight is"),
        ("[{}, {seconds: 1, right_hand: [2, 0, 0]}]", "arm reaches"),
        ("[{}, {seconds: 0}]", "`seconds` must be positive"),
        ("[{}, {step: {foot: left}}]", "either `to`"),
        ("[{}]", "at least two"),
    ],
)
def test_mistakes_in_the_file_are_named(tmp_path, keys, message):
    path = tmp_path / "clips.yaml"
    path.write_text(f"clips:\n  broken:\n    labels: [a]\n    categories: [usual]\n    keys: {keys}\n")
    with pytest.raises(ValueError, match=message) as error:
        read_authored(path)
    assert "broken" in str(error.value) or "hand" in str(error.value)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match="nowhere.yaml"):
        read_authored(tmp_path / "nowhere.yaml")
