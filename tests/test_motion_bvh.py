"""Clips written as BVH come back as the motion they were; broken files are refused with one clear sentence."""

import re

import numpy as np
import pytest
from bvh_writer import MIXAMO, UNREAL, write_bvh

from motion_data.authored import authored_clips
from motion_data.bvh import parse_bvh, read_bvh
from motion_data.joint_motion import detect_up_axis, map_joints
from motion_data.skeleton import joint_limits, kinematics

CLIPS = {clip.name: clip for clip in authored_clips()}


def body_error(clip, other):
    """Mean distance of the bodies, metres."""
    return np.linalg.norm(kinematics(clip.qpos).positions - kinematics(other.qpos).positions, axis=-1).mean()


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("wave_right_hand", {}),
        ("kick_left", {"order": "XYZ", "unit": 1.0}),
        ("deep_bow", {"names": UNREAL, "up": "z", "order": "YZX"}),
        ("slow_walk", {"names": UNREAL, "unit": 39.37, "skip": ("right_toe", "left_toe")}),
        ("side_lunge_left", {"twisted": True}),
        ("throw", {"twisted": True, "names": UNREAL, "skip": ("right_toe", "left_toe")}),
    ],
)
def test_a_clip_written_as_bvh_comes_back(tmp_path, name, options):
    clip = CLIPS[name]
    back = read_bvh(write_bvh(tmp_path / "Some Motion.bvh", clip, **options))
    assert back.name == "some_motion" and len(back) == len(clip)
    shifted = clip.qpos.copy()
    shifted[:, :2] -= clip.qpos[0, :2]
    reference = type(clip)(clip.name, shifted)
    assert body_error(back, reference) < 0.03
    limits = joint_limits()
    assert (back.qpos[:, 7:] >= limits[:, 0] - 1e-9).all() and (back.qpos[:, 7:] <= limits[:, 1] + 1e-9).all()
    assert np.abs(kinematics(back.qpos).lowest).max() < 0.03


def test_other_frame_rates_are_resampled(tmp_path):
    fast = CLIPS["squat"].resampled(120)
    back = read_bvh(write_bvh(tmp_path / "fast.bvh", fast))
    assert back.fps == 30 and back.duration == pytest.approx(CLIPS["squat"].duration, abs=0.05)


def test_the_up_axis_is_found_and_can_be_said(tmp_path):
    for up in ("y", "z"):
        motion = parse_bvh(write_bvh(tmp_path / f"{up}.bvh", CLIPS["bow"], up=up))
        assert detect_up_axis(motion, map_joints(motion.names)) == up
    said = read_bvh(tmp_path / "y.bvh", up="y", name="named", labels=("bow",), categories=("usual",))
    assert (said.name, said.labels, said.categories) == ("named", ("bow",), ("usual",))
    with pytest.raises(ValueError, match="up axis is y or z"):
        read_bvh(tmp_path / "y.bvh", up="x")


@pytest.mark.parametrize(
    "names",
    [
        "Hips LeftUpLeg LeftLeg LeftFoot LeftToe RightUpLeg RightLeg RightFoot RightToe Spine Spine1 Spine2 Neck Head "
        "LeftShoulder LeftArm LeftForeArm LeftHand RightShoulder RightArm RightForeArm RightHand",
        "hip lowerback spine neck neck1 head lhipjoint lthigh lknee lankle rhipjoint rthigh rknee rankle "
        "lcollar lshoulder lelbow lwrist rcollar rshoulder relbow rwrist",
        "Hips Chest Neck Head LeftCollar LeftShoulder LeftElbow LeftWrist RightCollar RightShoulder RightElbow RightWrist "
        "LeftHip LeftKnee LeftAnkle RightHip RightKnee RightAnkle",
        "pelvis neck head upper_arm.L forearm.L hand.L upper_arm.R forearm.R hand.R thigh.L shin.L foot.L toe.L thigh.R "
        "shin.R foot.R toe.R",
    ],
)
def test_common_names_are_mapped(names):
    names = names.split()
    found = map_joints(names)
    assert {"right_hip", "left_knee", "right_elbow", "left_wrist", "head"} <= found.keys()
    assert len(set(found.values())) == len(found)
    # The clavicle is not the shoulder joint where the file has an upper arm.
    if "LeftArm" in names:
        assert names[found["left_shoulder"]] == "LeftArm"


def test_joints_that_cannot_be_mapped_are_listed_and_can_be_given(tmp_path):
    strange = {**MIXAMO, "right_shin": "Wibble", "left_upper_arm": "Wobble"}
    path = write_bvh(tmp_path / "strange.bvh", CLIPS["bow"], names=strange)
    with pytest.raises(ValueError, match=r"left_shoulder, left_knee|left_knee|right_knee") as error:
        read_bvh(path)
    assert "left_shoulder" in str(error.value) and "right_knee" in str(error.value) and "Wobble" in str(error.value)
    clip = read_bvh(path, joints={"right_knee": "Wibble", "left_shoulder": "Wobble"})
    assert len(clip) == len(CLIPS["bow"])
    with pytest.raises(ValueError, match="Unknown in the joint mapping"):
        read_bvh(path, joints={"right_knee": "Wubble"})


def test_broken_files_are_refused(tmp_path):
    whole = write_bvh(tmp_path / "whole.bvh", CLIPS["bow"]).read_text()

    def refused(text, message):
        path = tmp_path / "broken.bvh"
        path.write_text(text)
        with pytest.raises(ValueError, match=message):
            read_bvh(path)

    refused("hello", "not a whole BVH file")
    refused(whole.split("MOTION")[0], "not a whole BVH file")
    refused(whole[: len(whole) // 2], "cut short")
    refused(re.sub(r"Frames: \d+", "Frames: 0", whole), "no frames")
    refused(re.sub(r"(?<=\n)-?\d+\.\d+ ", "nan ", whole, count=1), "NaN or infinite")
    refused(whole.replace("Zrotation", "Wrotation"), "unknown channels")
    refused(re.sub(r"Frame Time: \S+", "Frame Time: 0", whole), "frame time")
    with pytest.raises(FileNotFoundError, match="nowhere.bvh"):
        read_bvh(tmp_path / "nowhere.bvh")
