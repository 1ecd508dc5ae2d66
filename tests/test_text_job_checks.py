"""The checks judge hand-made poses as a person would."""

import numpy as np
import pytest

from agents.text import checks
from agents.text.checks import Trajectory
from motion_data.skeleton import forward_kinematics, joint_index, lowest_point, rest_qpos

FRAMES = 300  # 10 s


def trajectory(angles=None, path=None, on_floor=True):
    """Poses with hinge angles in degrees (numbers or (T,) arrays) and the root's path (T, 2) in metres."""
    qpos = np.tile(rest_qpos(), (FRAMES, 1))
    for name, degrees in (angles or {}).items():
        qpos[:, 7 + joint_index(name)] = np.radians(degrees)
    if path is not None:
        qpos[:, :2] = path
    if on_floor:
        qpos[:, 2] -= lowest_point(qpos)
    return Trajectory(*forward_kinematics(qpos))


def time():
    return np.arange(FRAMES) / 30.0


STAND = trajectory()
ARMS_UP = {"left_shoulder_y": -170, "right_shoulder_y": -170}
SQUAT = {f"{side}_{joint}": angle for side in ("left", "right") for joint, angle in
         (("hip_y", -115), ("knee", 125), ("ankle_y", -10))}  # fmt: skip


def wave(side="right", degrees=30.0, hertz=1.0, elbow=-90.0, abduction=90.0):
    sign = -1 if side == "right" else 1
    return {
        f"{side}_shoulder_x": sign * abduction,
        f"{side}_elbow": elbow,
        # the upper arm's twist swings the raised forearm
        f"{side}_shoulder_z": sign * 90 + degrees * np.sin(2 * np.pi * hertz * time()),
    }


def walk_angles(hertz=1.0):
    swing = 30 * np.sin(2 * np.pi * hertz * time())
    return {"left_hip_y": -swing, "right_hip_y": swing}


def straight(speed, yaw=0.0):
    return time()[:, None] * speed * np.array([np.cos(yaw), np.sin(yaw)])


def test_standing_passes_no_check():
    assert not checks.fell(STAND)
    assert {name: check(STAND) for name, check in checks.CHECKS.items()} == dict.fromkeys(checks.CHECKS, False)


def test_head_centre_of_the_rest_pose():
    assert STAND.head_height[0] == pytest.approx(0.905 + 0.236 + 0.226 + 0.165, abs=0.01)


def test_both_arms_up_passes_only_its_own_check():
    up = trajectory(ARMS_UP)
    assert [name for name, check in checks.CHECKS.items() if check(up)] == ["raise both arms above the head"]


def test_one_arm_up_is_not_both():
    assert not checks.raises_both_arms(trajectory({"left_shoulder_y": -170}))


@pytest.mark.parametrize(("share", "passes"), [(0.45, False), (0.55, True)])
def test_arms_must_be_up_for_half_of_the_last_five_seconds(share, passes):
    up = np.where(time() >= 10 - 5 * share, -170, 0)
    assert checks.raises_both_arms(trajectory({"left_shoulder_y": up, "right_shoulder_y": up})) is passes


def test_arms_raised_only_in_the_first_half_do_not_count():
    up = np.where(time() < 5, -170, 0)
    assert not checks.raises_both_arms(trajectory({"left_shoulder_y": up, "right_shoulder_y": up}))


def test_waving_the_right_hand_passes_its_own_check_and_that_of_the_raised_arm():
    waving = trajectory(wave())
    passed = [name for name, check in checks.CHECKS.items() if check(waving)]
    assert passed == ["wave the right hand", "raise the right arm"]


@pytest.mark.parametrize(
    "angles",
    [
        pytest.param(wave("left"), id="the other hand"),
        pytest.param(wave(degrees=2), id="a tremble"),
        pytest.param(wave(hertz=0.1), id="too slow to be a wave"),
        pytest.param({**wave(), "right_shoulder_x": 0, "right_shoulder_z": 0}, id="hanging arm"),
        pytest.param({**wave(), **wave("left")}, id="both hands"),
    ],
)
def test_what_is_not_waving_the_right_hand(angles):
    assert not checks.waves_right_hand(trajectory(angles))


@pytest.mark.parametrize(
    ("values", "swings"),
    [
        pytest.param([0, 0, 0], 0, id="still"),
        pytest.param([0, 1], 1, id="there"),
        pytest.param([0, 1, 0, 1], 3, id="there and back and there"),
        pytest.param([0, 0.5, 0.4, 1.0, 0.9, 0.95, 0], 2, id="wiggles on the way"),
        pytest.param([0, 0.4, 0, 0.4, 0], 0, id="all too small"),
    ],
)
def test_count_swings(values, swings):
    assert checks.count_swings(np.array(values), 0.5) == swings


def test_squatting_passes_only_its_own_check():
    squatting = trajectory(SQUAT)
    assert squatting.height("pelvis")[0] < checks.SQUAT_HEIGHT
    assert not checks.fell(squatting)
    assert [name for name, check in checks.CHECKS.items() if check(squatting)] == ["squat down"]


def test_half_a_squat_is_not_enough():
    assert not checks.squats(trajectory({name: angle * 0.5 for name, angle in SQUAT.items()}))


def test_sinking_below_without_bent_knees_is_no_squat():
    lying = {"left_hip_y": 0.0}
    flat = trajectory(lying, on_floor=False)
    sunk = Trajectory(flat.positions - [0, 0, 0.5], flat.quaternions)
    assert not checks.squats(sunk)


def kick(side):
    lift = np.where((time() % 2.5) < 0.5, -80, 0)
    return trajectory({f"{side}_hip_y": lift}, on_floor=False)


def test_kicking_with_the_left_leg_passes_only_its_own_check():
    assert [name for name, check in checks.CHECKS.items() if check(kick("left"))] == ["kick with the left leg"]


def test_kicking_with_the_right_leg_does_not_count():
    assert not checks.kicks_with_left_leg(kick("right"))


def test_a_jump_is_no_kick():
    jump = Trajectory(STAND.positions + [0, 0, 0.5], STAND.quaternions)
    assert not checks.kicks_with_left_leg(jump)


def test_walking_passes_only_its_own_check():
    walking = trajectory(walk_angles(), straight(1.0))
    assert [name for name, check in checks.CHECKS.items() if check(walking)] == ["walk forward"]


@pytest.mark.parametrize(
    ("angles", "path"),
    [
        pytest.param(walk_angles(), straight(0.2), id="too slow"),
        pytest.param(walk_angles(), straight(-1.0), id="backward"),
        pytest.param(walk_angles(), straight(1.0, np.pi / 2), id="sideways"),
        pytest.param({}, straight(1.0), id="gliding"),
        pytest.param({**walk_angles(), **SQUAT, "abdomen_y": 60}, straight(1.0), id="crouching"),
    ],
)
def test_what_is_not_walking_forward(angles, path):
    assert not checks.walks_forward(trajectory(angles, path))


def test_lying_at_any_time_is_a_fall():
    positions = STAND.positions.copy()
    positions[10:12, :, 2] *= 0.2
    assert checks.fell(Trajectory(positions, STAND.quaternions))


def test_texts_are_found_whatever_their_punctuation():
    assert checks.find_check("  Squat   DOWN! ") is checks.squats
    assert checks.find_check("sing a song") is None


def test_a_trajectory_with_nan_or_wrong_shape_is_refused():
    with pytest.raises(ValueError, match="NaN"):
        Trajectory(STAND.positions * np.nan, STAND.quaternions)
    with pytest.raises(ValueError, match="at least one frame"):
        Trajectory(STAND.positions[:0], STAND.quaternions[:0])
    with pytest.raises(ValueError, match="positions"):
        Trajectory(STAND.positions[:, :14], STAND.quaternions)
