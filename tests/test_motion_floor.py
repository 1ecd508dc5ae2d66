"""The clips on the floor rest on it, in balance, and are what their texts say."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from motion_data.floor import floor_clips, read_floor
from motion_data.inverse_kinematics import centre_of_mass
from motion_data.skeleton import body_index, joint_limits, kinematics, load_model, mirror_qpos

CLIPS = {clip.name: clip for clip in floor_clips()}
POSES = {name: kinematics(clip.qpos) for name, clip in CLIPS.items()}
each_clip = pytest.mark.parametrize("name", CLIPS)


def facing(clip, frame):
    """Height of the direction in which the belly points: 1 up, -1 down."""
    return Rotation.from_quat(clip.qpos[frame, 3:7], scalar_first=True).apply([1, 0, 0])[2]


@each_clip
def test_the_body_is_on_the_floor_inside_its_limits_and_slow(name):
    clip, pose = CLIPS[name], POSES[name]
    assert pose.lowest.min() > -0.005 and pose.lowest.max() < 0.01
    angles, limits = clip.qpos[:, 7:], joint_limits()
    assert (angles >= limits[:, 0]).all() and (angles <= limits[:, 1]).all()
    assert np.abs(clip.qvel[:, 6:]).max() < 10 and np.abs(clip.qvel[:, :3]).max() < 1.2
    assert np.abs(np.diff(clip.qvel[:, 2])).max() < 0.25


@each_clip
def test_the_weight_rests_on_what_touches_the_floor(name):
    """The centre of mass is over the bodies that touch the floor (3 cm), or at most 5 cm outside while it moves on."""
    clip, pose, model = CLIPS[name], POSES[name], load_model()
    ends = []  # of each geom: points in the frame of its body
    for geom in np.flatnonzero((model.geom_bodyid > 0) & (model.geom_conaffinity > 0)):
        size, turn = model.geom_size[geom], Rotation.from_quat(model.geom_quat[geom], scalar_first=True)
        kind = model.geom_type[geom]
        box = [[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)] * size
        points = {2: np.zeros((1, 3)), 3: np.array([[0, 0, -size[1]], [0, 0, size[1]]])}.get(int(kind), box)
        ends.append(
            (model.geom_bodyid[geom] - 1, model.geom_pos[geom] + turn.apply(points), 0 if kind == 6 else size[0])
        )
    angles = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    directions = np.stack([np.cos(angles), np.sin(angles)])
    centre = centre_of_mass(clip.qpos)
    reach = np.full((len(clip), 16), -np.inf)
    for body, points, radius in ends:
        turn = Rotation.from_quat(pose.quaternions[:, body], scalar_first=True)
        for point in points:
            world = pose.positions[:, body] + turn.apply(point)
            touches = world[:, 2] - radius < 0.03
            reach = np.maximum(reach, np.where(touches[:, None], world[:, :2] @ directions, -np.inf))
    assert (reach - centre[:, :2] @ directions).min() > -0.05


def test_they_are_what_they_say():
    for name, up in (("lie_on_back", 1), ("lie_on_front", -1)):
        assert facing(CLIPS[name], 0) * up > 0.95
        # The trunk, both legs and more lie on the floor.
        assert (POSES[name].clearance[0] < 0.02).sum() >= 8
    sitting, fours = POSES["sit_on_floor"], POSES["all_fours"]
    assert sitting.clearance[:, body_index("pelvis")].max() < 0.01
    assert sitting.positions[:, body_index("head"), 2].min() > 0.45
    for part in ("right_hand", "left_hand", "right_shin", "left_shin"):
        assert fours.clearance[:, body_index(part)].max() < 0.015
    clip = CLIPS["get_up_from_back"]
    assert clip.qpos[0, 2] < 0.12 and clip.qpos[-1, 2] > 0.85
    assert POSES["get_up_from_back"].positions[-1, body_index("head"), 2] > 1.25
    assert POSES["sit_up"].positions[-1, body_index("head"), 2] > 0.45


def test_rolling_over_turns_the_belly_down_over_the_named_side():
    for name, side in (("roll_over_left", 1), ("roll_over_right", -1)):
        clip = CLIPS[name]
        assert facing(clip, 0) > 0.9 and facing(clip, -1) < -0.9
        assert clip.qpos[-1, 1] * side > 0.15
    np.testing.assert_allclose(mirror_qpos(CLIPS["roll_over_left"].qpos), CLIPS["roll_over_right"].qpos, atol=1e-9)
    assert "roll over to the right" in CLIPS["roll_over_right"].labels


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ("[{hold: 1, right_elbo: 3}]", "unknown fields"),
        ("[{hold: 1, pose: flying}]", "unknown pose 'flying'"),
        ("[{}, {seconds: 0}]", "`seconds` must be positive"),
        ("[{}]", "at least two"),
        ("[{hold: 1, balanced: true}]", "planted feet"),
    ],
)
def test_mistakes_in_the_file_are_named(tmp_path, keys, message):
    path = tmp_path / "floor.yaml"
    path.write_text(f"clips:\n  broken:\n    labels: [a]\n    categories: [usual]\n    keys: {keys}\n")
    with pytest.raises(ValueError, match=f"broken.*{message}"):
        read_floor(path)
    with pytest.raises(FileNotFoundError, match="nowhere"):
        read_floor(tmp_path / "nowhere.yaml")
