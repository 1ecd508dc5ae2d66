"""Clips refuse broken motion, keep everything in a file, and mirror and resample faithfully."""

import json
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from motion_data.authored import authored_clips
from motion_data.clip import MotionClip, swap_sides
from motion_data.skeleton import JOINT_NAMES, body_index, kinematics, load_model, mirror_qpos, rest_qpos

CLIPS = {clip.name: clip for clip in authored_clips()}


def poses(frames=10):
    return np.tile(rest_qpos(), (frames, 1))


def test_broken_motion_is_refused_with_the_reason():
    broken = poses()
    broken[3, 20] = np.nan
    with pytest.raises(ValueError, match="'x' has NaN or infinite numbers in 1 frames, first in frame 3"):
        MotionClip("x", broken)
    for frames in (0, 1):
        with pytest.raises(ValueError, match=f"{frames} frames; a motion needs at least 2"):
            MotionClip("x", poses(frames))
    with pytest.raises(ValueError, match=r"expected \(frames, 35\)"):
        MotionClip("x", poses()[:, :30])
    broken = poses()
    broken[:, 3:7] = 0
    with pytest.raises(ValueError, match="unit length"):
        MotionClip("x", broken)
    with pytest.raises(ValueError, match="fps must be positive"):
        MotionClip("x", poses(), fps=0)
    with pytest.raises(ValueError, match="speed factor"):
        CLIPS["walk" if "walk" in CLIPS else "slow_walk"].at_speed(0)


def test_a_file_keeps_everything(tmp_path):
    clip = CLIPS["wave_right_hand"]
    back = MotionClip.load(clip.save(tmp_path / "folder" / "wave.npz"))
    np.testing.assert_array_equal(back.qpos, clip.qpos)
    for name in ("name", "fps", "source", "licence", "labels", "categories", "loop"):
        assert getattr(back, name) == getattr(clip, name)


def test_files_that_are_no_clips_are_refused(tmp_path):
    with pytest.raises(FileNotFoundError, match="motions list"):
        MotionClip.load(tmp_path / "nothing.npz")
    text = tmp_path / "text.npz"
    text.write_text("hello")
    with pytest.raises(ValueError, match="not a motion clip"):
        MotionClip.load(text)
    np.savez(tmp_path / "other.npz", data=np.zeros(3))
    with pytest.raises(ValueError, match="not a motion clip"):
        MotionClip.load(tmp_path / "other.npz")
    np.savez(tmp_path / "pickle.npz", header=np.array([{"a": 1}], dtype=object), qpos=poses())
    with pytest.raises(ValueError, match="not a motion clip"):
        MotionClip.load(tmp_path / "pickle.npz")
    path = CLIPS["bow"].save(tmp_path / "joints.npz")
    with np.load(path) as archive:
        header, qpos = json.loads(str(archive["header"])), archive["qpos"]
    header["joints"] = ["tail", *JOINT_NAMES[1:]]
    np.savez(path, header=np.array(json.dumps(header)), qpos=qpos)
    with pytest.raises(ValueError, match="tail.*Import the"):
        MotionClip.load(path)


def test_mirroring_swaps_the_sides_and_twice_is_the_identity():
    clip = CLIPS["kick_left"]
    mirrored = clip.mirrored()
    np.testing.assert_allclose(mirrored.mirrored().qpos, clip.qpos, atol=1e-12)
    assert mirrored.mirrored().name == clip.name and mirrored.mirrored().labels == clip.labels
    assert "kick with the right leg" in mirrored.labels
    reflect = np.array([1, -1, 1])
    feet = [kinematics(one.qpos).positions for one in (clip, mirrored)]
    np.testing.assert_allclose(
        feet[1][:, body_index("right_foot")], feet[0][:, body_index("left_foot")] * reflect, atol=1e-9
    )
    np.testing.assert_allclose(mirror_qpos(mirror_qpos(poses())), poses())
    assert swap_sides("Left hand over the right") == "Right hand over the left"


def test_velocities_are_those_of_mujoco():
    """One step of the clip's velocity, integrated by MuJoCo, leads to the next pose."""
    clip = CLIPS["turn_left"].resampled(120)
    for frame in (30, 200):
        pose = clip.qpos[frame - 1].copy()
        mujoco.mj_integratePos(load_model(), pose, clip.qvel[frame], 2 / 120)
        np.testing.assert_allclose(pose, clip.qpos[frame + 1], atol=2e-4)
    still = MotionClip("still", poses())
    np.testing.assert_array_equal(still.qvel, 0)


def test_resampling_and_speed_keep_the_path():
    clip = CLIPS["step_left"]
    for other, duration in ((clip.resampled(60), clip.duration), (clip.at_speed(2.0), clip.duration / 2)):
        assert other.duration == pytest.approx(duration, abs=0.05)
        np.testing.assert_allclose(other.qpos[0], clip.qpos[0], atol=1e-9)
        np.testing.assert_allclose(other.qpos[-1], clip.qpos[-1], atol=5e-3)
        np.testing.assert_allclose(np.linalg.norm(other.qpos[:, 3:7], axis=1), 1)
    assert clip.at_speed(2.0).fps == clip.fps


def test_a_clip_cannot_be_changed_by_accident():
    with pytest.raises(ValueError, match="read-only"):
        CLIPS["bow"].qpos[0, 0] = 1
    assert replace(CLIPS["bow"], name="other").name == "other"
