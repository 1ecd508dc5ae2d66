"""The gaits go as fast as they say, on feet that do not slide, in balance, and go on for ever."""

import numpy as np
import pytest
import yaml

from motion_data.clip import swap_sides
from motion_data.gait import Gait
from motion_data.gait_plan import pose_gaits
from motion_data.gait_table import GAITS_YAML, gait_clips, read_gaits
from motion_data.inverse_kinematics import centre_of_mass
from motion_data.library import missing_mirrors
from motion_data.metrics import sole_corners
from motion_data.skeleton import heading, joint_index, joint_limits, kinematics, mirror_qpos

ENTRIES = yaml.safe_load(GAITS_YAML.read_text())["gaits"]
CLIPS = {clip.name: clip for clip in gait_clips()}
# Long enough for averages and seams; each clip is measured once.
LONG = {name: clip.repeated(4) for name, clip in CLIPS.items() if name in ENTRIES}
POSES = {name: kinematics(clip.qpos) for name, clip in LONG.items()}
CORNERS = {name: sole_corners(pose.positions, pose.quaternions) for name, pose in POSES.items()}
LOOPS = [name for name in ENTRIES if CLIPS[name].loop]

each_gait = pytest.mark.parametrize("name", ENTRIES)


def velocity(name):
    """Mean velocity in the frame of the body (m/s, forward and left) and turn rate (degrees/s)."""
    clip = LONG[name]
    yaw = np.unwrap(heading(clip.qpos[:, 3:7]))
    cosine, sine = np.cos(yaw), np.sin(yaw)
    x, y = np.gradient(clip.qpos[:, :2], 1 / clip.fps, axis=0).T
    turn = np.degrees(yaw[-1] - yaw[0]) / clip.duration
    cycle = slice(1, len(CLIPS[name]))
    return np.mean((cosine * x + sine * y)[cycle]), np.mean((cosine * y - sine * x)[cycle]), turn


def test_they_cover_the_speeds_and_directions_to_steer():
    measured = np.array([velocity(name) for name in LOOPS])
    straight = np.abs(measured[:, 1:] / [1, 60]).max(1) < 0.05
    for speed in (0.5, 1, 1.5, 2, 2.5, 3):
        assert np.abs(measured[straight, 0] - speed).min() < 0.05, speed
    assert measured[:, 0].min() < -0.5 and measured[:, 1].max() > 0.5 and measured[:, 2].max() > 60
    for name, (forward, left, turn) in zip(LOOPS, measured, strict=True):
        entry = ENTRIES[name]
        assert forward == pytest.approx(entry.get("forward", 0), abs=0.05), name
        assert left == pytest.approx(entry.get("left", 0), abs=0.06), name
        assert turn == pytest.approx(entry.get("turn", 0), abs=0.5), name


def test_a_start_begins_and_a_stop_ends_at_rest():
    for name, still, moving in (("start_walking", 0, slice(-35, None)), ("stop_walking", -1, slice(0, 35))):
        clip = CLIPS[name]
        assert np.abs(clip.qvel[still]).max() < 0.2
        assert clip.qvel[moving, 0].mean() == pytest.approx(1, abs=0.1)


@each_gait
def test_a_foot_on_the_floor_stands_still(name):
    """Whenever one edge of a sole bears the weight for two frames, it stays where it is."""
    corners = CORNERS[name]
    touches = (corners[1:, :, 2] < 0.002) & (corners[:-1, :, 2] < 0.002)
    speed = np.linalg.norm(np.diff(corners[..., :2], axis=0), axis=-1) * 30
    assert touches.any()
    assert np.median(speed[touches]) < 0.01
    # A frame may hold a part of a swing: the last moment before the landing or the first after leaving.
    assert (speed[touches] < 0.05).mean() > 0.9
    assert POSES[name].lowest.min() > -0.005


@each_gait
def test_joints_are_inside_their_limits_and_smooth(name):
    angles, limits = LONG[name].qpos[:, 7:], joint_limits()
    assert (angles >= limits[:, 0]).all() and (angles <= limits[:, 1]).all()
    assert np.abs(LONG[name].qvel[:, 6:]).max() < 15
    knees = angles[:, [joint_index("right_knee"), joint_index("left_knee")]]
    assert knees.min() > np.radians(4)  # never locked


@pytest.mark.parametrize("name", [name for name, entry in ENTRIES.items() if entry.get("duty", 0.6) > 0.5])
def test_a_walk_is_in_balance(name):
    """The zero-moment point of the centre of mass lies in the support, or at most 6 cm outside while a foot rolls."""
    clip, corners = LONG[name], CORNERS[name]
    centre = centre_of_mass(clip.qpos)
    acceleration = np.gradient(np.gradient(centre, 1 / clip.fps, axis=0), 1 / clip.fps, axis=0)
    pressure = centre[:, :2] - centre[:, 2:] / (9.81 + acceleration[:, 2:]) * acceleration[:, :2]
    angles = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    directions = np.stack([np.cos(angles), np.sin(angles)])
    reach = np.where(corners[..., 2:] < 0.015, corners[..., :2] @ directions, -np.inf).max(1)
    assert (reach - pressure @ directions)[2:-2].min() > -0.06


@pytest.mark.parametrize("name", LOOPS)
def test_a_loop_continues_itself(name):
    clip = CLIPS[name]
    assert np.abs(clip.qpos[-1, 7:] - clip.qpos[0, 7:]).max() < 1e-3
    assert clip.qpos[-1, 2] == pytest.approx(clip.qpos[0, 2], abs=1e-3)
    twice = LONG[name].qvel
    seam = len(clip) - 1
    # Velocities at the seam are those of one period later.
    if len(twice) > 2 * seam + 1:
        np.testing.assert_allclose(twice[seam, 6:], twice[2 * seam, 6:], atol=0.02)


def test_twins_are_reflections_and_even_gaits_need_none():
    twins = {name: entry["mirror"] for name, entry in ENTRIES.items() if "mirror" in entry}
    assert len(twins) >= 6
    for name, twin in twins.items():
        np.testing.assert_allclose(mirror_qpos(CLIPS[name].qpos), CLIPS[twin].qpos, atol=1e-9)
        assert CLIPS[twin].labels == tuple(map(swap_sides, CLIPS[name].labels))
    assert {clip.name for clip in missing_mirrors(list(CLIPS.values()))} == {
        "start_walking_mirrored",
        "stop_walking_mirrored",
    }
    for clip in CLIPS.values():
        assert len(set(clip.labels)) >= 3
        assert clip.categories[0] in ("move_around", "act_in_place")


def test_a_user_plans_a_gait_in_one_line():
    (qpos,) = pose_gaits([Gait(forward=0.8, turn=-20, cadence=100)])
    assert len(qpos) == 37
    assert np.degrees(heading(qpos[-1, 3:7]) - heading(qpos[0, 3:7])) == pytest.approx(-24, abs=0.1)


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ("{speed: 1}", "unknown fields.*forward"),
        ("{duty: 0.5}", "duty must be"),
        ("{cadence: 0}", "cadence must be"),
        ("{duty: 0.4, start: true}", "can neither start nor stop"),
        ("{stop: true, strides: 1}", "2 to 100 strides"),
        ("{cadence: fast}", "cadence must be a number"),
        ("{forward: 1}", "`labels` must be a list"),
    ],
)
def test_mistakes_in_the_table_are_named(tmp_path, entry, message):
    path = tmp_path / "gaits.yaml"
    path.write_text(f"gaits:\n  broken: {entry}\n")
    with pytest.raises(ValueError, match=f"broken.*{message}"):
        read_gaits(path)
    with pytest.raises(FileNotFoundError, match="nowhere"):
        read_gaits(tmp_path / "nowhere.yaml")
