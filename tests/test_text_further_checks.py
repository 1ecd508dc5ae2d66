"""The further checks: the library's clip of what the text says passes, its mirror image and standing still do not."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from agents.text.checks import CHECKS
from agents.text.further_checks import FURTHER_CHECKS
from agents.text.trajectory import Trajectory
from motion_data.library import MotionLibrary
from motion_data.skeleton import forward_kinematics, heading, rest_qpos

POSES = {
    "raise the right arm": "raise_right_arm",
    "spread both arms to the sides": "t_pose",
    "stretch both arms forward": "arms_forward",
    "put both hands on the head": "hands_on_head",
    "put both hands on the hips": "hands_on_hips",
    "bend forward": "deep_bow",
    "lean to the left": "stretch_side_left",
    "stand on the left leg": "balance_left_leg",
    "kneel down": "kneel_left",
}
MOTIONS = {
    "punch with the right hand": "punch_right",
    "walk backward": "walk_backward",
    "walk sideways to the right": "sidestep_right",
    "turn to the left": "turn_left",
    "run forward": "run_steadily",
    "march on the spot": "march_in_place",
}
SIDED = [text for text in FURTHER_CHECKS if "right" in text or "left" in text]


LIBRARY = MotionLibrary.default(mirrored=False)


def held(qpos: np.ndarray) -> Trajectory:
    """The middle of a clip, for 5 s."""
    return Trajectory(*forward_kinematics(np.tile(qpos[len(qpos) // 2], (150, 1))))


def repeated(qpos: np.ndarray) -> Trajectory:
    """A clip again and again for 6 s, each beginning where the one before ended."""
    place, turn, parts = np.zeros(3), Rotation.identity(), []
    for _ in range(180 // len(qpos) + 1):
        ahead = turn * Rotation.from_euler("z", heading(qpos[0, None, 3:7])[0]).inv()
        part = qpos.copy()
        part[:, :3] = ahead.apply(qpos[:, :3] - qpos[0, :3] * (1, 1, 0)) + place
        part[:, 3:7] = (ahead * Rotation.from_quat(qpos[:, 3:7], scalar_first=True)).as_quat(scalar_first=True)
        parts.append(part[:-1])
        place, turn = part[-1, :3] * (1, 1, 0), Rotation.from_euler("z", heading(part[-1, None, 3:7])[0])
    return Trajectory(*forward_kinematics(np.concatenate(parts)))


def shown(text: str, mirrored: bool = False) -> Trajectory:
    clip = LIBRARY[(POSES | MOTIONS)[text]]
    qpos = (clip.mirrored() if mirrored else clip).qpos
    return held(qpos) if text in POSES else repeated(qpos)


def test_every_check_is_shown_by_a_clip():
    assert set(POSES | MOTIONS) == set(FURTHER_CHECKS)
    assert len(FURTHER_CHECKS) == 15


@pytest.mark.parametrize("text", FURTHER_CHECKS)
def test_the_clip_of_the_text_passes(text):
    assert CHECKS[text](shown(text))


@pytest.mark.parametrize("text", SIDED)
def test_its_mirror_image_does_not(text):
    assert not CHECKS[text](shown(text, mirrored=True))


@pytest.mark.parametrize("text", FURTHER_CHECKS)
def test_standing_still_does_not(text):
    assert not CHECKS[text](held(rest_qpos()[None]))


@pytest.mark.parametrize(("text", "other"), [("walk backward", "run forward"), ("march on the spot", "run forward")])
def test_another_gait_does_not(text, other):
    assert not CHECKS[text](shown(other))
    assert not CHECKS[other](shown(text))
