"""ASF/AMC and AMASS files become the motion they hold; broken files are refused with one clear sentence."""

import numpy as np
import pytest
from mocap_writers import write_acclaim, write_amass

from motion_data.amass import is_amass, read_amass
from motion_data.asf_amc import read_amc
from motion_data.authored import authored_clips
from motion_data.clip import MotionClip
from motion_data.readers import read_motion
from motion_data.skeleton import body_index, heading, joint_index, joint_limits, kinematics, rest_qpos

CLIPS = {clip.name: clip for clip in authored_clips()}
FACING_X = np.array([1, 1, 1]) / np.sqrt(3) * 2 * np.pi / 3  # turns x, y, z into y, z, x: SMPL's axes into ours


def posed(angles=None, frames=6, speed=0.0):
    """The rest pose with some hinges set, moving along x."""
    qpos = np.tile(rest_qpos(), (frames, 1))
    for joint, angle in (angles or {}).items():
        qpos[:, 7 + joint_index(joint)] = angle
    qpos[:, 0] = speed / 30 * np.arange(frames)
    return MotionClip("posed", qpos)


def acclaim(folder, clip):
    return read_motion(write_acclaim(folder, clip), fps=clip.fps)


def amass(folder, clip):
    return read_motion(write_amass(folder / "posed_poses.npz", clip))


each_format = pytest.mark.parametrize("through", [acclaim, amass])
T_POSE = {"left_shoulder_x": np.pi / 2, "right_shoulder_x": -np.pi / 2}


@each_format
def test_the_t_pose(tmp_path, through):
    positions = kinematics(through(tmp_path, posed(T_POSE)).qpos).positions[2]
    shoulder = positions[body_index("left_upper_arm"), 2]
    for side, sign in (("left", 1), ("right", -1)):
        hand = positions[body_index(f"{side}_hand")]
        assert sign * hand[1] > 0.6 and abs(hand[2] - shoulder) < 0.08 and abs(hand[0]) < 0.12


@each_format
def test_one_raised_arm(tmp_path, through):
    clip = posed({"right_shoulder_y": -np.pi / 2, "left_knee": 0.5, "left_hip_y": -0.5})
    back = through(tmp_path, clip)
    angles = back.qpos[2, 7:]
    assert angles[joint_index("right_shoulder_y")] == pytest.approx(-np.pi / 2, abs=0.15)
    assert angles[joint_index("left_shoulder_y")] == pytest.approx(0, abs=0.2)  # SMPL's resting arms point back
    assert angles[joint_index("left_knee")] == pytest.approx(0.5, abs=0.12)
    positions = kinematics(back.qpos).positions[2]
    right, left = positions[body_index("right_hand")], positions[body_index("left_hand")]
    assert right[0] > 0.4 and right[2] > left[2] + 0.4 and right[1] < 0 < left[1]


@each_format
def test_a_walk_along_x_keeps_its_heading_speed_and_height(tmp_path, through):
    back = through(tmp_path, posed(speed=1.2, frames=16))
    assert back.fps == 30 and back.duration == pytest.approx(0.5)
    travelled = back.qpos[-1, :3] - back.qpos[0, :3]
    assert travelled[0] == pytest.approx(0.6, rel=0.1) and abs(travelled[1]) < 0.01 and abs(travelled[2]) < 0.01
    np.testing.assert_allclose(heading(back.qpos[:, 3:7]), 0, atol=0.02)
    assert back.qpos[0, 2] == pytest.approx(rest_qpos()[2], abs=0.04)


@each_format
@pytest.mark.parametrize("name", ["wave_right_hand", "slow_walk"])
def test_a_clip_comes_back(tmp_path, through, name):
    middle = CLIPS[name].qpos[40:70].copy()
    middle[:, :2] -= middle[0, :2]
    clip = MotionClip(name, middle)
    back = through(tmp_path, clip)
    assert np.linalg.norm(kinematics(back.qpos).positions - kinematics(clip.qpos).positions, axis=-1).mean() < 0.05
    limits = joint_limits()
    assert (back.qpos[:, 7:] >= limits[:, 0] - 1e-9).all() and (back.qpos[:, 7:] <= limits[:, 1] + 1e-9).all()


def test_smpl_without_rotations_is_a_t_pose(tmp_path):
    """Facts of the format, not of our writer: y up, facing z; the first rotation leads into a world with z up."""
    poses = np.zeros((4, 72))
    poses[:, :3] = FACING_X
    np.savez(tmp_path / "a.npz", poses=poses, trans=np.zeros((4, 3)), mocap_frame_rate=30.0)
    clip = read_amass(tmp_path / "a.npz", name="flat")
    positions = kinematics(clip.qpos).positions[1]
    assert clip.name == "flat" and abs(heading(clip.qpos[0, 3:7])) < 0.02
    assert positions[body_index("left_hand"), 1] > 0.6 and positions[body_index("right_hand"), 1] < -0.6
    poses[:, 3 * 16 : 3 * 17] = (0, 0, np.pi / 2)  # the left arm turns about SMPL's z: up
    np.savez(tmp_path / "b.npz", poses=poses, trans=np.zeros((4, 3)), mocap_framerate=30.0)
    positions = kinematics(read_amass(tmp_path / "b.npz").qpos).positions[1]
    assert positions[body_index("left_hand"), 2] > positions[body_index("head"), 2] + 0.3
    assert positions[body_index("right_hand"), 1] < -0.6


def test_frame_rates(tmp_path):
    clip = posed(speed=1.0, frames=12)
    assert read_amc(write_acclaim(tmp_path, clip)).duration == pytest.approx(0.08, abs=0.04)  # 120 per second
    write_amass(tmp_path / "fast.npz", MotionClip("fast", clip.qpos, fps=59.94))
    assert read_motion(tmp_path / "fast.npz").fps == 30


def test_the_skeleton_is_found_or_asked_for(tmp_path):
    amc = write_acclaim(tmp_path, posed(), subject="other")
    assert len(read_amc(amc, fps=30)) == 6  # the only one in the folder
    (tmp_path / "third.asf").write_text((tmp_path / "other.asf").read_text())
    with pytest.raises(ValueError, match=r"several: other.asf, third.asf.*--skeleton"):
        read_motion(amc)
    assert len(read_motion(amc, skeleton=tmp_path / "third.asf", fps=30)) == 6
    for path in tmp_path.glob("*.asf"):
        path.unlink()
    with pytest.raises(ValueError, match=r"no .asf file.*--skeleton"):
        read_motion(amc)
    with pytest.raises(FileNotFoundError, match="nowhere.asf"):
        read_motion(amc, skeleton=tmp_path / "nowhere.asf")


def test_broken_acclaim_files_are_refused(tmp_path):
    amc = write_acclaim(tmp_path, posed())
    asf = tmp_path / "02.asf"
    motion, skeleton = amc.read_text(), asf.read_text()

    def refused(message, motion=motion, skeleton=skeleton):
        amc.write_text(motion)
        asf.write_text(skeleton)
        with pytest.raises(ValueError, match=message):
            read_amc(amc)

    refused("no frames", ":FULLY-SPECIFIED\n")
    refused("moves the bone 'tail'", motion.replace("thorax", "tail"))
    refused("NaN or infinite numbers, first in frame 0", motion.replace("thorax 0.000000", "thorax nan", 1))
    refused("2 numbers for the bone 'root' in frame 6", motion[: motion.rindex("root")] + "root 1 2")
    refused("not all of its 6 frames", motion[: motion.rindex("rtibia")])
    refused("not an AMC file", motion.replace("thorax 0", "thorax x", 1))
    refused("no section :hierarchy", skeleton=skeleton.split(":hierarchy")[0])
    refused("bones without data: lfemur", skeleton=skeleton.replace("name lfemur", "name thigh"))
    refused(
        "lfemur has no direction", skeleton=skeleton.replace("name lfemur\n     direction", "name lfemur\n     way")
    )
    refused("degrees of freedom l ", skeleton=skeleton.replace("dof rx ry rz", "dof rx ry rz l"))
    refused(
        "No joint found for left_hip",
        motion.replace("lfemur", "wobble"),
        skeleton.replace("lfemur", "wobble").replace("lhipjoint", "wibble"),
    )
    with pytest.raises(ValueError, match="skeleton without motion"):
        read_motion(asf)


def test_broken_amass_files_are_refused(tmp_path):
    path = tmp_path / "broken.npz"
    good = {"poses": np.zeros((4, 156)), "trans": np.zeros((4, 3)), "mocap_framerate": np.array(30.0)}

    def refused(message, **changes):
        np.savez(path, **{name: array for name, array in {**good, **changes}.items() if array is not None})
        with pytest.raises(ValueError, match=message):
            read_amass(path)

    refused("no trans", trans=None)
    refused("no mocap_framerate", mocap_framerate=None)
    refused("poses of shape", poses=np.zeros((4, 63)))
    refused("no frames", poses=np.zeros((0, 156)), trans=np.zeros((0, 3)))
    refused("trans of shape", trans=np.zeros((3, 3)))
    refused("frame rate 0", mocap_framerate=np.array(0.0))
    poses = np.zeros((4, 156))
    poses[2, 5] = np.nan
    refused("first in frame 2", poses=poses)
    refused("shorter than two frames", poses=np.zeros((1, 156)), trans=np.zeros((1, 3)))
    path.write_text("hello")
    assert not is_amass(path)
    with pytest.raises(ValueError, match="not an AMASS motion"):
        read_amass(path)


def test_options_that_mean_nothing_are_refused(tmp_path):
    CLIPS["bow"].save(tmp_path / "bow.npz")
    assert read_motion(tmp_path / "bow.npz").name == "bow"
    with pytest.raises(ValueError, match="fps means nothing for this .npz"):
        read_motion(tmp_path / "bow.npz", fps=30)
