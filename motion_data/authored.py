"""Clips authored by hand: readable key poses in, physically plausible motion out.

``assets/authored.yaml`` says what the upper body does, where the feet stand and which foot carries the weight. This
module reads it and interpolates; :mod:`motion_data.balance` adds the legs by inverse kinematics, and the pelvis where it
keeps the centre of mass over the supporting foot. So every clip has its feet on the floor and can be held in balance.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import BPoly, PchipInterpolator
from scipy.spatial.transform import Rotation

from motion_data.balance import FOOT_FIELDS, UPPER_JOINTS, FootPath, balanced_path, pose_body
from motion_data.clip import MotionClip
from motion_data.clip_table import clip_and_twin, read_table
from motion_data.inverse_kinematics import ARM_COLUMNS, SIDES, solve_arm
from motion_data.skeleton import FRAME_RATE, JOINT_NAMES

AUTHORED_YAML = Path(__file__).parent / "assets" / "authored.yaml"
"""The file of key poses."""

BODY_FIELDS = ("lower", "pitch", "roll", "turn", "lean_x", "lean_y", "weight")
_FOOT_DEFAULT = {"right": (0.03, -0.1, -6.0), "left": (0.03, 0.1, 6.0)}
_WEIGHTS = {"right": 0.0, "both": 0.5, "left": 1.0}


@dataclass(frozen=True)
class Key:
    """Everything that one key pose fixes.

    Attributes:
        time: Seconds since the start of the clip.
        upper: Angles of :data:`UPPER_JOINTS` in radians.
        body: Values of :data:`BODY_FIELDS`: metres and radians; ``weight`` is the left foot's share of the load.
        feet: Values of :data:`FOOT_FIELDS` by side: metres and radians; x and y are those of the middle of the sole.
    """

    time: float
    upper: np.ndarray
    body: Mapping[str, float]
    feet: Mapping[str, np.ndarray]

    def channels(self) -> np.ndarray:
        """All numbers of the key in one row."""
        body = [self.body[name] for name in BODY_FIELDS]
        return np.concatenate([self.upper, body, self.feet["right"], self.feet["left"]])


@dataclass
class _KeyReader:
    """Turns the entries of one clip of the file into keys; remembers time and footprints on the way."""

    clip: str
    poses: Mapping[str, Mapping[str, Any]]
    time: float = 0.0
    footprints: dict[str, tuple[float, float, float]] = field(default_factory=lambda: dict(_FOOT_DEFAULT))
    keys: list[Key] = field(default_factory=list)

    def read(self, entry: Mapping[str, Any]) -> None:
        """Appends the keys of one entry."""
        entry = self._with_poses(entry)
        if "step" in entry:
            self._step(entry)
        else:
            self._append(entry, float(entry.pop("seconds", 0.0 if not self.keys else 0.6)), float(entry.pop("hold", 0)))

    def _with_poses(self, entry: Mapping[str, Any]) -> dict[str, Any]:
        entry = dict(entry)
        names = entry.pop("pose", [])
        merged: dict[str, Any] = {}
        for name in [names] if isinstance(names, str) else names:
            if name not in self.poses:
                raise ValueError(f"Clip '{self.clip}': unknown pose '{name}'. The poses are: {', '.join(self.poses)}.")
            merged |= self._with_poses(self.poses[name])
        return merged | entry

    def _append(self, entry: dict[str, Any], seconds: float, hold: float) -> None:
        if self.keys and seconds <= 0:
            raise ValueError(f"Clip '{self.clip}': `seconds` must be positive in every entry but the first.")
        self.time += seconds
        upper, body, feet = self._upper(entry), self._body(entry), self._feet(entry)
        if entry:
            raise ValueError(
                f"Clip '{self.clip}': unknown fields {sorted(entry)}. A key knows seconds, hold, pose, step, weight, "
                "lower, lean, pitch, roll, turn, right_foot, left_foot, right_hand, left_hand, both_hand, right_elbow_out, "
                f"left_elbow_out, both_elbow_out, the joints {', '.join(UPPER_JOINTS)}, and both_ in place of right_."
            )
        self.keys.append(Key(self.time, upper, body, feet))
        if hold:
            self.time += hold
            self.keys.append(replace(self.keys[-1], time=self.time))

    def _step(self, entry: dict[str, Any]) -> None:
        """A step is three keys: the weight moves to the other foot, the foot is in the air, the foot has landed."""
        step = dict(entry.pop("step"))
        side = step.pop("foot")
        if ("to" in step) == ("stance" in step):
            raise ValueError(
                f"Clip '{self.clip}': a step has either `to` (place of the sole) or `stance` (of the body)."
            )
        target = list(step.pop("to")) if "to" in step else _stance(side, *step.pop("stance"))
        shift, swing = float(step.pop("shift", 0.5)), float(step.pop("swing", 0.5))
        lift, pitch = float(step.pop("lift", 0.08)), float(step.pop("pitch", 0.0))
        hold = float(entry.pop("hold", 0))
        if step:
            raise ValueError(f"Clip '{self.clip}': unknown fields of step {sorted(step)}.")
        other = "left" if side == "right" else "right"
        start = self.footprints[side]
        middle = [0.5 * (a + b) for a, b in zip(start, target, strict=True)]
        self._append({**entry, "weight": other}, shift, 0)
        self._append(
            {**entry, "weight": other, f"{side}_foot": {"at": middle, "lift": lift, "pitch": 12}}, swing / 2, 0
        )
        self._append({**entry, "weight": other, f"{side}_foot": {"at": target, "pitch": pitch}}, swing / 2, hold)

    def _upper(self, entry: dict[str, Any]) -> np.ndarray:
        degrees = dict.fromkeys(UPPER_JOINTS, 0.0)
        degrees |= {"right_shoulder_x": -8.0, "left_shoulder_x": 8.0, "right_elbow": -15.0, "left_elbow": -15.0}
        for name in UPPER_JOINTS:
            joint = name.removeprefix("right_")
            if name.startswith("right_") and f"both_{joint}" in entry:
                angle = float(entry.pop(f"both_{joint}"))
                degrees[name] = angle
                degrees[f"left_{joint}"] = -angle if joint.endswith(("_x", "_z")) else angle
        for name in UPPER_JOINTS:
            if name in entry:
                degrees[name] = float(entry.pop(name))
        upper = np.radians([degrees[name] for name in UPPER_JOINTS])
        both, both_out = entry.pop("both_hand", None), entry.pop("both_elbow_out", 20.0)
        for side, sign in zip(SIDES, (1, -1), strict=True):
            hand = entry.pop(f"{side}_hand", None)
            if hand is None and both is not None:
                hand = [both[0], sign * both[1], both[2]]
            out = np.radians(float(entry.pop(f"{side}_elbow_out", both_out)))
            if hand is not None:
                columns = [UPPER_JOINTS.index(JOINT_NAMES[column]) for column in ARM_COLUMNS[side]]
                upper[columns] = solve_arm(side, np.array(hand, float), out)
        return upper

    def _body(self, entry: dict[str, Any]) -> dict[str, float]:
        weight = entry.pop("weight", "both")
        if isinstance(weight, str):
            if weight not in _WEIGHTS:
                raise ValueError(f"Clip '{self.clip}': weight is right, left, both or a number, not '{weight}'.")
            weight = _WEIGHTS[weight]
        lean = entry.pop("lean", (0.0, 0.0))
        angles = {name: float(np.radians(entry.pop(name, 0.0))) for name in ("pitch", "roll", "turn")}
        lengths = {"lower": float(entry.pop("lower", 0.0)), "lean_x": float(lean[0]), "lean_y": float(lean[1])}
        return {**angles, **lengths, "weight": float(weight)}

    def _feet(self, entry: dict[str, Any]) -> dict[str, np.ndarray]:
        feet = {}
        for side in SIDES:
            foot = dict(entry.pop(f"{side}_foot", {}))
            x, y, *turn = (float(number) for number in foot.pop("at", self.footprints[side]))
            place = (x, y, turn[0] if turn else self.footprints[side][2])
            lift, pitch, roll = (float(foot.pop(name, 0.0)) for name in ("lift", "pitch", "roll"))
            if foot:
                raise ValueError(
                    f"Clip '{self.clip}': unknown fields of a foot {sorted(foot)}; known: at, {FOOT_FIELDS[3:]}."
                )
            if not lift:
                self.footprints[side] = place  # a foot put down stays there until it is moved
            feet[side] = np.array([place[0], place[1], *np.radians(place[2:]), lift, *np.radians([pitch, roll])])
        return feet


def _stance(side: str, x: float, y: float, heading: float) -> list[float]:
    """Place and turn in degrees of a foot when the body stands naturally at x, y and faces a heading in degrees."""
    forward, left, turn = _FOOT_DEFAULT[side]
    cosine, sine = np.cos(np.radians(heading)), np.sin(np.radians(heading))
    return [x + cosine * forward - sine * left, y + sine * forward + cosine * left, turn + heading]


def interpolate(times: np.ndarray, rows: np.ndarray, fps: float = FRAME_RATE) -> np.ndarray:
    """Smooth paths through the keys, at rest at the ends and wherever a channel turns round.

    Between keys each channel is a quintic with zero acceleration at the keys, so from rest to rest it has minimum jerk.

    Args:
        times: Seconds of at least two keys, ``(keys,)``.
        rows: Their numbers, ``(keys, channels)``.
        fps: Frames per second.

    Returns:
        Channels of each frame, ``(T, channels)``.
    """
    slopes = PchipInterpolator(times, rows).derivative()(times) if len(times) > 2 else np.zeros_like(rows)
    slopes[0] = slopes[-1] = 0
    values = np.stack([rows, slopes, np.zeros_like(rows)], 1)
    frames = np.arange(round(times[-1] * fps) + 1) / fps
    return BPoly.from_derivatives(times, values)(np.minimum(frames, times[-1]))


def _pose_channels(channels: np.ndarray, lengths: Sequence[int], loops: Sequence[bool]) -> np.ndarray:
    """Poses that follow the channels with the feet in place and the weight on the support.

    Args:
        channels: Rows of :func:`interpolate` of several clips, ``(T, channels)``.
        lengths: Frames of each clip.
        loops: Whether each clip is a loop.

    Returns:
        Poses, ``(T, 35)``.
    """
    upper, body, right, left = np.split(
        channels, np.cumsum([len(UPPER_JOINTS), len(BODY_FIELDS), len(FOOT_FIELDS)]), axis=1
    )
    lower, pitch, roll, turn, lean_x, lean_y, weight = body.T
    feet = {"right": FootPath.place("right", right), "left": FootPath.place("left", left)}
    heading = 0.5 * (right[:, 2] + left[:, 2])
    rotation = Rotation.from_euler("ZYX", np.stack([heading + turn, pitch, roll], 1))

    target = (1 - weight[:, None]) * right[:, :2] + weight[:, None] * left[:, :2]
    cosine, sine = np.cos(heading), np.sin(heading)
    target = target + np.stack([cosine * lean_x - sine * lean_y, sine * lean_x + cosine * lean_y], 1)
    parts = np.split(target, np.cumsum(lengths)[:-1])
    target = np.concatenate([balanced_path(part, loop) for part, loop in zip(parts, loops, strict=True)])
    return pose_body(upper, rotation, target, feet, lower, lengths)


def read_authored(path: str | Path = AUTHORED_YAML) -> list[MotionClip]:
    """Builds the clips of a file of key poses.

    Args:
        path: YAML file with ``poses`` and ``clips``; the header of the bundled one explains the fields.

    Returns:
        The clips, in the order of the file; a mirrored twin follows its original.

    Raises:
        FileNotFoundError: If there is no such file.
        ValueError: If an entry cannot be understood; the message names the clip.
    """
    content = read_table(path, "clips")
    poses, entries = content.get("poses", {}), content["clips"]
    channels = []
    for name, entry in entries.items():
        reader = _KeyReader(name, poses)
        for key in entry["keys"]:
            reader.read(key)
        if len(reader.keys) < 2:
            raise ValueError(f"Clip '{name}' needs at least two key poses, found {len(reader.keys)}.")
        times = np.array([key.time for key in reader.keys])
        channels.append(interpolate(times, np.stack([key.channels() for key in reader.keys])))
    # One call for all clips: the solver works on arrays of frames.
    lengths = [len(rows) for rows in channels]
    loops = [bool(entry.get("loop", False)) for entry in entries.values()]
    solved = np.split(_pose_channels(np.concatenate(channels), lengths, loops), np.cumsum(lengths)[:-1])
    clips = []
    for (name, entry), qpos, loop in zip(entries.items(), solved, loops, strict=True):
        clips += clip_and_twin(name, entry, qpos, "authored by this project", loop)
    return clips


@cache
def _bundled() -> tuple[MotionClip, ...]:
    return tuple(read_authored())


def authored_clips() -> list[MotionClip]:
    """The bundled authored clips at 30 frames per second."""
    return list(_bundled())
