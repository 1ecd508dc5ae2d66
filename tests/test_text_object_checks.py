"""The checks of what is done with objects judge hand-made poses as a person would."""

import dataclasses

import numpy as np
import pytest
from envs_common import arguments

from agents.text.config import TrainConfig
from agents.text.evaluate import judge, run_episodes, scene_of
from agents.text.object_checks import OBJECT_CHECKS, find_object_check
from agents.text.train import environment_id, make_environment, train
from anyskill_envs.objects import SceneObject, load_object
from anyskill_envs.objects.scene import Scene
from motion_data.skeleton import body_index, forward_kinematics, joint_index, lowest_point, rest_qpos

FRAMES = 120  # 4 s


def poses(scene, place, angles=None, path=None):
    """Poses of a scene whose first object stands at `place`, facing the humanoid."""
    out = np.tile(scene.rest_pose, (FRAMES, 1))
    for name, degrees in (angles or {}).items():
        out[:, 7 + joint_index(name)] = np.radians(degrees)
    if path is not None:
        out[:, :2] = path
    part = next(iter(scene.parts.values()))
    out[:, part.pose] = [*place, 0, 0, 0, 1]
    return out


def foot_at(angles):
    """Where the left foot is in a pose."""
    qpos = rest_qpos()
    for name, degrees in angles.items():
        qpos[7 + joint_index(name)] = np.radians(degrees)
    return forward_kinematics(qpos[None])[0][0, body_index("left_foot")]


BALL, DOOR, LATCHED, CHAIR, PILLAR = (Scene([name]) for name in ("ball", "door", "latched_door", "chair", "pillar"))
KICK = {"left_hip_y": -40}


def judged(text, scene, poses):
    return find_object_check(text, scene)(poses)


def rolling(touched, away):
    """A kick at frame 30: the ball lies at the foot (or aside) and is `away` metres further a second later."""
    x, y, _ = foot_at(KICK)
    scene_poses = poses(BALL, (x + 0.2 if touched else x + 0.6, y, foot_at(KICK)[2] - 0.05), KICK)
    scene_poses[30:, BALL.parts["ball"].pose][:, 0] += np.minimum(np.arange(FRAMES - 30) / 30, 1) * away
    return scene_poses


@pytest.mark.parametrize(("touched", "away", "kicked"), [(True, 1.2, True), (True, 0.5, False), (False, 1.2, False)])
def test_a_kick_is_a_foot_at_the_ball_and_a_ball_that_leaves(touched, away, kicked):
    assert judged("Kick the ball!", BALL, rolling(touched, away)) is kicked


def test_walking_to_the_ball_is_coming_near_it():
    ball = (2.0, 0.0, 0.11)
    for reached, near in ((1.3, False), (1.5, True)):
        path = np.stack([np.linspace(0, reached, FRAMES), np.zeros(FRAMES)], 1)
        assert judged("walk to the ball", BALL, poses(BALL, ball, path=path)) is near


@pytest.mark.parametrize("scene", [DOOR, LATCHED])
def test_a_door_opens_by_a_body_that_touches_it(scene):
    part = next(iter(scene.parts.values()))
    for distance, degrees, opened in ((0.1, 60, True), (0.1, 30, False), (1.5, 60, False)):
        swung = poses(scene, (distance, 0.0, 0.0))
        swung[60:, part.angles[0]] = np.radians(degrees)
        assert judged("open the door", scene, swung) is opened


def test_kicking_the_door_takes_a_foot():
    x, y, _ = foot_at(KICK)
    assert judged("kick the door", DOOR, poses(DOOR, (x + 0.13, y, 0.0), KICK))
    hands_only = {"left_shoulder_y": -90, "right_shoulder_y": -90}
    assert not judged("kick the door", DOOR, poses(DOOR, (0.62, 0.0, 0.0), hands_only))


def test_striking_the_pillar_takes_a_hand_or_a_foot():
    arm = {"left_shoulder_y": -90}
    hand = rest_qpos()[None].copy()
    hand[0, 7 + joint_index("left_shoulder_y")] = np.radians(-90)
    x, y, _ = forward_kinematics(hand)[0][0, body_index("left_hand")]
    assert judged("strike the pillar", PILLAR, poses(PILLAR, (x + 0.24, y, 0.9), arm))
    assert not judged("strike the pillar", PILLAR, poses(PILLAR, (x + 0.5, y, 0.9), arm))
    # leaning with the head is no strike
    assert not judged("strike the pillar", PILLAR, poses(PILLAR, (0.3, 0.0, 1.5 + 0.9)))


SITTING = {f"{side}_{joint}": angle for side in ("left", "right") for joint, angle in (("hip_y", -90), ("knee", 90))}


@pytest.mark.parametrize(("seconds", "sits"), [(1.2, True), (0.6, False)])
def test_sitting_takes_a_second_on_the_seat(seconds, sits):
    seated = poses(CHAIR, (0.0, 0.0, 0.45), SITTING)
    seated[:, 3:7] = [1, 0, 0, 0]
    seated[:, CHAIR.parts["chair"].pose][:, 3:] = [1, 0, 0, 0]
    seated[:, 2] = 0.45 + 0.09  # hips on the seat
    seated[round(30 * seconds) :, 2] = 0.9
    assert judged("sit on the chair", CHAIR, seated) is sits
    fallen = seated.copy()
    fallen[:, CHAIR.parts["chair"].pose][:, 3:] = [np.sqrt(0.5), np.sqrt(0.5), 0, 0]  # the chair lies on its side
    assert not judged("sit on the chair", CHAIR, fallen)


def test_standing_passes_no_check():
    for text, (kind, _) in OBJECT_CHECKS.items():
        scene = Scene([kind])
        standing = np.tile(scene.rest_pose, (30, 1))
        assert lowest_point(standing[:1, :35])[0] == pytest.approx(0, abs=0.01)
        assert judge(standing, False, text, scene) == (False, False)


def test_an_object_is_found_by_its_kind_whatever_its_name():
    ball = load_object("ball")
    for named, found in (
        (dataclasses.replace(ball, name="red_one"), True),
        (SceneObject("cannon_ball", ball.mjcf), False),
        (SceneObject("melon", ball.mjcf, kind="ball"), True),
    ):
        assert (find_object_check("kick the ball", Scene([named])) is not None) is found
    with pytest.raises(ValueError, match="kind of an object must be a lower-case word"):
        SceneObject("melon", ball.mjcf, kind="a ball")


def test_a_text_about_an_object_that_is_not_there_has_no_check():
    assert find_object_check("kick the ball", DOOR) is None
    assert judge(np.tile(rest_qpos(), (5, 1)), False, "kick the ball") == (False, None)
    assert judge(np.tile(DOOR.rest_pose, (5, 1)), False, "wave the right hand", DOOR) == (False, False)


def test_episodes_in_a_scene_are_judged(controller_file):
    kwargs = arguments("HumanoidSoccer-v0", controller_file)
    episodes = run_episodes(
        lambda seen: np.zeros((len(seen), 64), np.float32), "kick the ball", 1, 0, "HumanoidSoccer-v0", **kwargs
    )
    assert episodes[0].qpos.shape == (300, scene_of("HumanoidSoccer-v0").pose_size)
    assert episodes[0].success is False


def test_a_wrong_environment_is_told_with_those_that_exist(tmp_path):
    for wrong in ("HumanoidFootball-v0", "HumanoidLatent-v0"):
        config = TrainConfig("kick the ball", env=wrong, output=tmp_path / "run")
        with pytest.raises(ValueError, match=f"no environment '{wrong}' that takes a text.*HumanoidSoccer-v0"):
            train(config)
    assert not (tmp_path / "run").exists()
    assert list(scene_of(environment_id(TrainConfig("kick the ball", env="HumanoidSoccer-v0"))).parts) == ["ball"]


@pytest.mark.parametrize(("blind", "size"), [(False, 223 + 15 + 60), (True, 223 + 60)])
def test_a_run_can_be_blind_to_the_objects(blind, size, controller_file):
    config = TrainConfig(
        "kick the ball", env="HumanoidSoccer-v0", blind=blind, encoder="small", controller=controller_file
    )
    assert make_environment(config, 2).observation_space.shape == (size,)
