"""Motion planned from a gait: steady loops in any direction, starts and stops.

From the numbers of a :class:`motion_data.gait.Gait` follow the footprints, where each foot stands still while it bears
weight, and where the weight rests. :func:`motion_data.balance.balanced_path` then gives the only path of the centre of
mass that neither falls nor drifts over these footprints: the periodic solution of the linear inverted pendulum (Kajita et
al. 2001, "The 3D linear inverted pendulum mode"), for a run with the stiffness of its varying load. So a simulated body can
follow the motion.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from motion_data.balance import CENTRE_HEIGHT, GRAVITY, UPPER_JOINTS, FootPath, balanced_path, pose_body
from motion_data.gait import Gait
from motion_data.inverse_kinematics import SIDES
from motion_data.skeleton import FRAME_RATE

_FINE = 8  # steps of the pendulum per frame
_MARGIN_SECONDS = 4.0  # the pendulum forgets its ends by a factor of 25 per second
_SOLVED_STRIDES = 1  # strides before and after the loop for which poses are solved
_EASE_FRAMES = 2
_EDGE = 0.085  # metres from the middle of the sole to where the weight rests on a heel or on toes
_HEEL_STRIKE_SHARE, _ROLL_OFF_SHARE = 0.2, 0.55  # of a stance: until the foot is flat, from when its heel rises
_HEEL_LOAD_SHARE, _TOE_LOAD_SHARE = 0.3, 0.8  # of a stance: until the weight has left the heel, has reached the toes
_STANDING = {"right": (-0.1, -6.0), "left": (0.1, 6.0)}  # metres to the left and degrees of the natural stand
_SWING_LIFT = 0.08  # metres of lift in the middle of a swing, as far as the reach of the leg is concerned


class _Footfall(NamedTuple):
    """One stance of a foot."""

    land: float
    leave: float
    place: np.ndarray
    """x, y in metres and turn in radians of the middle of the sole."""


class _Course:
    """Where the body goes: speed over time, and the footfalls that belong to it. Right lands at every whole stride."""

    def __init__(self, gait: Gait):
        self.gait = gait
        stride = gait.stride
        # A start begins when the first foot leaves the floor; a stop ends when the last one lands.
        self.first = gait.duty * stride if gait.start else -np.inf
        self.last = 0.5 * stride * np.floor(2 * gait.seconds / stride - 1.5) if gait.stop else np.inf
        self.ramp = 1.1 * stride
        self.footfalls = {side: self._footfalls(side) for side in SIDES}

    def speed(self, time: np.ndarray) -> np.ndarray:
        """Share of the full speed at times in seconds, 0 to 1."""
        up = np.ones_like(time)
        if self.gait.start:
            up = _smooth((time - self.first + 0.2 * self.ramp) / self.ramp)
        if self.gait.stop:
            up = up * (1 - _smooth((time - self.last + 0.8 * self.ramp) / self.ramp))
        return up

    def place(self, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Position of the body ``(n, 2)`` and its heading ``(n,)`` at times in seconds; 0 at 0."""
        time = np.asarray(time, float)
        gone = self._gone(time)
        turn = np.radians(self.gait.turn)
        heading = turn * gone
        # Integrals of the cosine and sine of the heading; sinc also holds without a turn.
        half = 0.5 * heading
        chord = gone * np.sinc(half / np.pi)
        cosine, sine = chord * np.cos(half), chord * np.sin(half)
        forward, left = self.gait.forward, self.gait.left
        return np.stack([forward * cosine - left * sine, forward * sine + left * cosine], -1), heading

    def _gone(self, time: np.ndarray) -> np.ndarray:
        """Seconds at full speed that lead as far as the course does until the given times."""
        if self.gait.loops:
            return time
        grid = np.linspace(min(time.min(), 0) - 0.01, max(time.max(), self.gait.seconds) + 0.01, 4000)
        speed = self.speed(grid)
        steps = 0.5 * (speed[1:] + speed[:-1]) * np.diff(grid)
        gone = np.concatenate([[0], np.cumsum(steps)])
        return np.interp(time, grid, gone) - np.interp(0, grid, gone)

    def _footfalls(self, side: str) -> list[_Footfall]:
        gait, stride = self.gait, self.gait.stride
        count = int(np.ceil((_MARGIN_SECONDS + gait.seconds) / stride)) + 2
        lands = (np.arange(-count, count + 1) + (0.0 if side == "right" else 0.5)) * stride
        leaves = lands + gait.duty * stride
        kept = (leaves >= self.first - 1e-6) & (lands <= self.last + 1e-6)
        lands, leaves = lands[kept], leaves[kept]
        falls = []
        for number, (land, leave) in enumerate(zip(lands, leaves, strict=True)):
            begins, ends = gait.start and number == 0, gait.stop and number == len(lands) - 1
            outward = np.array([0.5 * gait.width, gait.toe_out]) * (-1 if side == "right" else 1)
            if begins or ends:
                outward = np.array(_STANDING[side])
            middle = -_MARGIN_SECONDS if begins else gait.seconds + _MARGIN_SECONDS if ends else 0.5 * (land + leave)
            place, heading = self.place(np.array([middle]))
            ahead = np.array([np.cos(heading[0]), np.sin(heading[0])])
            leftward = np.array([-ahead[1], ahead[0]])
            # In a curve the feet tread outside the path of the body, which leans inward: c - (h / g) c''.
            outside = -(CENTRE_HEIGHT - gait.lower) / GRAVITY * np.radians(gait.turn)
            place = place + outside * (gait.forward * leftward - gait.left * ahead)
            falls.append(
                _Footfall(
                    -np.inf if begins else land,
                    np.inf if ends else leave,
                    np.append(place[0] + outward[0] * leftward, heading[0] + np.radians(outward[1])),
                )
            )
        return falls


def _smooth(share: np.ndarray) -> np.ndarray:
    """0 to 1 with no speed at either end."""
    share = np.clip(share, 0, 1)
    return share**2 * (3 - 2 * share)


def _stance(gait: Gait, fall: _Footfall, time: np.ndarray) -> np.ndarray:
    """x, y, turn of the sole's middle, and pitch of a foot that stands, ``(n, 4)``."""
    pitch = np.full_like(time, np.radians(gait.standing))
    duration = gait.duty * gait.stride
    if np.isfinite(fall.land):
        left = np.clip(1 - (time - fall.land) / (_HEEL_STRIKE_SHARE * duration), 0, 1.5)
        pitch += np.radians(gait.landing - gait.standing) * left**2
    if np.isfinite(fall.leave):
        gone = np.clip(1 - (fall.leave - time) / ((1 - _ROLL_OFF_SHARE) * duration), 0, 1.5)
        pitch += np.radians(gait.leaving) * gone**2
    return np.column_stack([np.tile(fall.place, (len(time), 1)), pitch])


def _posed(side: str, stance: np.ndarray) -> np.ndarray:
    """Ankle position, turn and pitch, ``(n, 5)``, of a foot on the floor."""
    zero = np.zeros(len(stance))
    foot = FootPath.place(side, np.column_stack([stance[:, :3], zero, stance[:, 3], zero]))
    return np.column_stack([foot.ankle, stance[:, 2:]])


def _foot_path(side: str, gait: Gait, falls: Sequence[_Footfall], time: np.ndarray) -> FootPath:
    """A foot over time: still where it stands, on a cubic curve where it swings."""
    rows, lift = np.zeros((len(time), 5)), np.zeros(len(time))
    for number, fall in enumerate(falls):
        stands = (time >= fall.land) & (time <= fall.leave)
        if stands.any():
            rows[stands] = _posed(side, _stance(gait, fall, time[stands]))
        if number + 1 == len(falls):
            break
        then = falls[number + 1]
        swings = (time > fall.leave) & (time < then.land)
        if not swings.any():
            continue
        duration, moment = then.land - fall.leave, 1e-4
        before = _posed(side, _stance(gait, fall, fall.leave - np.array([moment, 0])))
        after = _posed(side, _stance(gait, then, then.land + np.array([0, moment])))
        share = ((time[swings] - fall.leave) / duration)[:, None]
        rows[swings] = (
            before[1] * (1 + 2 * share) * (1 - share) ** 2
            + after[0] * (3 - 2 * share) * share**2
            + (before[1] - before[0]) / moment * duration * share * (1 - share) ** 2
            - (after[1] - after[0]) / moment * duration * share**2 * (1 - share)
        )
        share = share[:, 0]
        # The foot is highest and hangs most before the middle of the swing, as the shank still follows the thigh.
        early = (share * (1 - share) ** 2 * 6.75) if gait.runs else 16 * (share * (1 - share)) ** 2
        rows[swings, 2] += gait.lift * early
        rows[swings, 4] += np.radians(gait.swing) * share * (1 - share) ** 2 * 6.75
        lift[swings] = _SWING_LIFT * 4 * share * (1 - share)
    turn, pitch = rows[:, 3], rows[:, 4]
    rotation = Rotation.from_euler("ZY", np.stack([turn, pitch], 1)).as_matrix()
    leftward = np.stack([-np.sin(turn), np.cos(turn), np.zeros_like(turn)], 1)
    return FootPath(side, rows[:, :3], rotation, leftward, lift)


def _pressure(gait: Gait, falls: Sequence[_Footfall], time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Load on one foot, 0 to 1, and where in its sole the weight rests, ``(T,)`` and ``(T, 2)`` metres."""
    load, point = np.zeros(len(time)), np.zeros((len(time), 2))
    shift = abs(gait.duty - 0.5) * gait.stride  # seconds for which both feet stand
    middle = 1.0 if gait.standing > 10 else 0.0
    begin, end = (_edge(angle, middle) for angle in (gait.landing, gait.standing + gait.leaving))
    for fall in falls:
        stands = (time >= fall.land) & (time <= fall.leave)
        now = time[stands]
        if gait.runs:
            load[stands] = np.sin(np.pi * (now - fall.land) / (fall.leave - fall.land))
        else:
            load[stands] = np.clip(np.minimum(now - fall.land, fall.leave - now) / shift, 0, 1)
        # From heel to toe; a foot that stands for good is loaded in its middle.
        duration = gait.duty * gait.stride
        along = np.full(len(now), middle)
        if np.isfinite(fall.land):
            along += (begin - middle) * (1 - _smooth((now - fall.land) / (_HEEL_LOAD_SHARE * duration)))
        if np.isfinite(fall.leave):
            begun = 1 - (fall.leave - now) / duration - _HEEL_LOAD_SHARE
            along += (end - middle) * _smooth(begun / (_TOE_LOAD_SHARE - _HEEL_LOAD_SHARE))
        x, y, turn = fall.place
        ahead = np.stack([np.cos(turn) + 0 * now, np.sin(turn) + 0 * now], 1)
        point[stands] = [x, y] + _EDGE * along[:, None] * ahead
    return load, point


def _edge(degrees: float, otherwise: float) -> float:
    """Which edge a tilted foot stands on: -1 heel, 1 toes."""
    return float(np.sign(degrees)) if abs(degrees) > 3 else otherwise


def _height(gait: Gait, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Height of the body about its mean (metres) and vertical acceleration, each ``(T,)``.

    In a run the load of each stance is half a sine, about that of a mass that bounces on a spring (McMahon and Cheng
    1990), whose mean over a step is the weight; in flight there is none.
    """
    step, stance = 0.5 * gait.stride, gait.duty * gait.stride
    if not gait.runs:
        rate = 2 * np.pi / step
        height = gait.bob * np.cos(rate * (time - 0.5 * stance))
        return height, -(rate**2) * height
    count = 2000
    phase = (np.arange(count) + 0.5) / count * step
    load = np.where(phase < stance, np.sin(np.pi * np.minimum(phase, stance) / stance), 0)
    acceleration = GRAVITY * (load / load.mean() - 1)
    speed = np.cumsum(acceleration) * step / count
    height = np.cumsum(speed - speed.mean()) * step / count
    height -= height.mean()
    now = time % step
    period = {"period": step}
    return np.interp(now, phase, height, **period), np.interp(now, phase, acceleration, **period)


def _centre(gait: Gait, course: _Course, frames: np.ndarray) -> np.ndarray:
    """Path of the centre of mass on the floor plane at frames (whole numbers, also negative), ``(T, 2)`` metres."""
    margin = round(_MARGIN_SECONDS * FRAME_RATE)
    fine = np.arange((frames[0] - margin) * _FINE, (frames[-1] + margin) * _FINE + 1) / _FINE / FRAME_RATE
    loads, points = zip(*(_pressure(gait, course.footfalls[side], fine) for side in SIDES), strict=True)
    total = loads[0] + loads[1]
    share = np.divide(loads[1], total, out=np.full_like(total, 0.5), where=total > 1e-9)[:, None]
    pressure = (1 - share) * points[0] + share * points[1]
    height, acceleration = _height(gait, fine)
    if gait.loops:
        stiffness = (acceleration + GRAVITY) / (CENTRE_HEIGHT - gait.lower + height)
    else:
        stiffness = np.full_like(height, GRAVITY / (CENTRE_HEIGHT - gait.lower))
    path = balanced_path(pressure, fps=FRAME_RATE * _FINE, stiffness=stiffness)
    return path[margin * _FINE : len(path) - margin * _FINE : _FINE]


def _upper_body(gait: Gait, phase: np.ndarray, amount: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Angles of :data:`UPPER_JOINTS`, and yaw, pitch and roll of the pelvis, in radians, ``(T, joints)``, ``(T, 3)``."""
    foremost = amount * np.cos(2 * np.pi * phase) * (-1 if gait.forward < 0 else 1)  # 1: right leg in front
    stands = amount * np.cos(2 * np.pi * phase - np.pi * gait.duty)  # 1: middle of the right foot's stance
    yaw, tilt = gait.pelvis_turn * foremost, -gait.pelvis_list * stands
    inward = -np.degrees(np.arctan(gait.forward * np.radians(gait.turn) / GRAVITY)) * amount
    lean = gait.lean * amount
    looks = 0.2 * gait.turn * amount  # the head turns ahead into a curve
    angles = dict.fromkeys(UPPER_JOINTS, np.zeros_like(phase))
    angles["abdomen_x"], angles["abdomen_y"] = -0.8 * tilt, gait.bend * amount
    angles["abdomen_z"] = -1.6 * yaw + 0.3 * looks
    angles["neck_z"], angles["neck_y"] = 0.6 * yaw + 0.7 * looks, -0.5 * (lean + gait.bend * amount)
    for side, sign in zip(SIDES, (1, -1), strict=True):
        back = sign * foremost
        angles[f"{side}_shoulder_y"] = gait.arm_swing * back - gait.arm_raise * amount
        angles[f"{side}_shoulder_x"] = -sign * (8 + (gait.arm_out - 8) * amount)
        angles[f"{side}_elbow"] = -(15 + (gait.elbow - 15 + 0.5 * gait.elbow_swing) * amount)
        angles[f"{side}_elbow"] = angles[f"{side}_elbow"] + 0.5 * gait.elbow_swing * back
    columns = np.stack([np.broadcast_to(angles[name], phase.shape) for name in UPPER_JOINTS], 1)
    return np.radians(columns), np.radians(np.stack([yaw, lean, tilt + inward], 1))


class _Plan(NamedTuple):
    """What :func:`motion_data.balance.pose_body` needs for one clip, and which of its frames are the clip."""

    upper: np.ndarray
    rotation: np.ndarray
    target: np.ndarray
    feet: dict[str, FootPath]
    lower: np.ndarray
    clip: slice


def _plan(gait: Gait) -> _Plan:
    course = _Course(gait)
    around = _SOLVED_STRIDES * gait.stride_frames if gait.loops else 0
    count = round(gait.seconds * FRAME_RATE)
    frames = np.arange(-around, count + around + 1)
    time = frames / FRAME_RATE
    amount = course.speed(time)
    upper, turned = _upper_body(gait, time / gait.stride, amount)
    turned[:, 0] += course.place(time)[1]
    height, _ = _height(gait, time)
    return _Plan(
        upper,
        Rotation.from_euler("ZYX", turned).as_quat(),
        _centre(gait, course, frames),
        {side: _foot_path(side, gait, course.footfalls[side], time) for side in SIDES},
        (gait.lower - height) * amount,
        slice(around, around + count + 1),
    )


def pose_gaits(gaits: Sequence[Gait]) -> list[np.ndarray]:
    """Poses of gaits at 30 frames per second; a loop is one stride whose last frame continues its first.

    Args:
        gaits: The gaits; solved together, for the solver works on arrays of frames.

    Returns:
        Poses of each, ``(T, 35)``, that begin near the origin and head along x.
    """
    plans = [_plan(gait) for gait in gaits]
    lengths = [len(plan.upper) for plan in plans]
    feet = {}
    for side in SIDES:
        parts = [plan.feet[side] for plan in plans]
        feet[side] = FootPath(
            side,
            *(
                np.concatenate([getattr(part, name) for part in parts])
                for name in ("ankle", "rotation", "leftward", "lift")
            ),
        )
    rotation = Rotation.from_quat(np.concatenate([plan.rotation for plan in plans]))
    upper, target, lower = (
        np.concatenate([getattr(plan, name) for plan in plans]) for name in ("upper", "target", "lower")
    )
    poses = np.split(pose_body(upper, rotation, target, feet, lower, lengths, _EASE_FRAMES), np.cumsum(lengths)[:-1])
    results = []
    for plan, pose in zip(plans, poses, strict=True):
        part = pose[plan.clip].copy()
        part[:, :2] -= part[0, :2]
        results.append(part)
    return results
