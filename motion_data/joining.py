"""Clips made of others: one motion, a short way over, and the next from where the first ends."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from motion_data.clip import MotionClip
from motion_data.skeleton import heading

_ROLLING_CUT = 10  # frames at the end of rolling over, and at the beginning of getting up, in which the body only lies


def join(first: MotionClip, second: MotionClip, name: str, labels: Sequence[str], blend: int = 10) -> MotionClip:
    """One clip of two: the second is moved and turned about the vertical to begin where the first ends.

    Args:
        first: What comes first.
        second: What follows, at the same frame rate.
        name: Name of the result.
        labels: Sentences that describe it.
        blend: Frames between the two, in which the last pose goes smoothly over into the first one of what follows.

    Returns:
        The clip; it has the sources and licences of both, and the categories of the second.

    Raises:
        ValueError: If the frame rates differ or blend is negative.
    """
    if first.fps != second.fps:
        raise ValueError(
            f"'{first.name}' has {first.fps:g} frames per second, '{second.name}' {second.fps:g}. Resample one of them."
        )
    if blend < 0:
        raise ValueError(f"blend must be 0 or more frames, got {blend}.")
    end, rest = first.qpos[-1], second.qpos.copy()
    turn = Rotation.from_euler("z", heading(end[None, 3:7])[0] - heading(rest[:1, 3:7])[0])
    rest[:, 3:7] = (turn * Rotation.from_quat(rest[:, 3:7], scalar_first=True)).as_quat(scalar_first=True)
    rest[:, :3] = turn.apply(rest[:, :3] - [*rest[0, :2], 0]) + [*end[:2], 0]
    share = np.arange(1, blend + 1) / (blend + 1)
    share = share**2 * (3 - 2 * share)
    between = end + share[:, None] * (rest[0] - end)
    ends = Rotation.from_quat(np.stack([end[3:7], rest[0, 3:7]]), scalar_first=True)
    between[:, 3:7] = Slerp([0, 1], ends)(share).as_quat(scalar_first=True)

    def both(one: str, other: str) -> str:
        return one if one == other else f"{one}; {other}"

    return MotionClip(
        name=name,
        qpos=np.concatenate([first.qpos, between, rest]),
        fps=first.fps,
        source=f"joined from {both(first.source, second.source)}",
        licence=both(first.licence, second.licence),
        labels=tuple(labels),
        categories=second.categories,
    )


def joined_clips(clips: Sequence[MotionClip]) -> list[MotionClip]:
    """What the library joins of its own clips: getting up from the back by rolling over to the front, to either side.

    Args:
        clips: The clips there are, at 30 frames per second; without ``roll_over_left`` and ``getup_facedown`` there is
            nothing to join.
    """
    by_name = {clip.name: clip for clip in clips}
    if not {"roll_over_left", "getup_facedown"} <= set(by_name):
        return []
    roll, rise = by_name["roll_over_left"].resampled(), by_name["getup_facedown"].resampled()
    labels = ("roll over to the left and get up", "get up from the back by rolling over to the left")
    roll, rise = replace(roll, qpos=roll.qpos[:-_ROLLING_CUT]), replace(rise, qpos=rise.qpos[_ROLLING_CUT:])
    left = join(roll, rise, "get_up_by_rolling_left", labels)
    return [left, replace(left.mirrored(), name="get_up_by_rolling_right")]
