"""Facts about poses for measuring an encoder: rules and wordings of their own, none of which training uses.

Training grades motions by the concepts of `agents.encoder.concepts`. The facts here are about one pose, come from other
measurements with thresholds of their own, and are worded in other words (wrists and heels rather than hands and feet),
so that an encoder is not merely asked for what it was told.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from motion_data.skeleton import body_index, forward_kinematics, heading

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Fact:
    """Something that is true or false of a pose.

    Attributes:
        name: unique name; sided facts end in ".left" or ".right".
        wordings: two ways to say it.
        opposite: name of the fact that is this one the other way up, or "".
        other_limb: name of the same fact about an arm instead of a leg of this side or the other way round, or "".
    """

    name: str
    wordings: tuple[str, str]
    opposite: str = ""
    other_limb: str = ""


# name | first wording | second wording | the other way up | the other limb
_SIDED = """
wrist_high | the {s} wrist is higher than the head | {s} wrist well over head level | wrist_low | heel_off
wrist_level | the {s} wrist is as high as the shoulders | {s} wrist level with the shoulders | |
wrist_low | the {s} wrist dangles beside the thigh | {s} wrist low beside the leg | wrist_high |
wrist_ahead | the {s} wrist is far out in front of the chest | {s} forearm reaching ahead | | toes_ahead
wrist_behind | the {s} wrist is behind the hips | {s} forearm at the rear of the body | |
wrist_outside | the {s} wrist is far from the body on the {s} | {s} forearm spread away from the body | |
elbow_sharp | the {s} elbow makes a sharp angle | {s} elbow strongly flexed | | knee_sharp
elbow_open | the {s} arm is straight at the elbow | {s} elbow fully extended | | knee_open
knee_sharp | the {s} knee makes a sharp angle | {s} knee strongly flexed | | elbow_sharp
knee_open | the {s} leg is straight at the knee | {s} knee fully extended | | elbow_open
heel_off | the {s} ankle is well off the ground | {s} shoe in the air | heel_down | wrist_high
heel_down | the {s} heel rests on the ground | {s} shoe on the ground | heel_off |
toes_ahead | the {s} shoe is ahead of the {o} one | {s} shoe in front, {o} shoe at the rear | | wrist_ahead
"""
_PLAIN = """
chest_forward | the chest is tipped forward | spine inclined to the front | chest_back |
chest_back | the chest is tipped backward | spine inclined to the rear | chest_forward |
hips_low | the hips are close to the ground | seat far down | hips_high |
hips_high | the hips are at standing height | seat as high as in standing | hips_low |
wrists_meet | both wrists are close to each other | the wrists nearly meet | |
shoes_wide | the shoes are far apart from side to side | a very wide stance | |
belly_down | the whole body rests on the ground with the belly below | flat on the ground, chest below | belly_up |
belly_up | the whole body rests on the ground with the belly above | flat on the ground, chest above | belly_down |
"""


def _read() -> tuple[Fact, ...]:
    facts = []
    for line in _SIDED.strip().splitlines():
        name, first, second, opposite, limb = (part.strip() for part in line.split("|"))
        for side, other in (("right", "left"), ("left", "right")):
            words = (first.format(s=side, o=other), second.format(s=side, o=other))
            facts.append(Fact(f"{name}.{side}", words, opposite and f"{opposite}.{side}", limb and f"{limb}.{side}"))
    for line in _PLAIN.strip().splitlines():
        name, first, second, opposite, _ = (part.strip() for part in line.split("|"))
        facts.append(Fact(name, (first, second), opposite))
    return tuple(facts)


FACTS = _read()
"""All facts."""
FACT_NAMES = tuple(fact.name for fact in FACTS)


def _between(value: Array, no: float, yes: float) -> Array:
    """0 up to `no`, 1 from `yes` on; `no` may be the greater one."""
    return np.clip((value - no) / (yes - no), 0.0, 1.0)


def _bend(first: Array, middle: Array, last: Array) -> Array:
    """Degrees by which a limb through three points `(n, 3)` is off straight."""
    upper, lower = middle - first, last - middle
    cosine = (upper * lower).sum(1) / (np.linalg.norm(upper, axis=1) * np.linalg.norm(lower, axis=1))
    return np.degrees(np.arccos(np.clip(cosine, -1, 1)))


def measure_facts(qpos: Array) -> Array:
    """How far each fact holds of poses `(n, 35)`: 1 if it clearly does, 0 if it clearly does not, `(n, facts)`."""
    world, quaternions = forward_kinematics(qpos)
    yaw = heading(quaternions[:, 0])
    cosine, sine = np.cos(yaw)[:, None], np.sin(yaw)[:, None]
    x, y, height = np.moveaxis(world - world[:, :1], -1, 0)
    local = np.stack([cosine * x + sine * y, cosine * y - sine * x, height], -1)

    def at(body: str) -> Array:
        place: Array = local[:, body_index(body)]
        return place

    def above_floor(body: str) -> Array:
        z: Array = world[:, body_index(body), 2]
        return z

    spine = at("head") - at("pelvis")
    length = np.linalg.norm(spine, axis=1)
    tip = np.degrees(np.arctan2(spine[:, 0], np.maximum(spine[:, 2], 1e-3)))
    on_legs = _between(spine[:, 2] / length, 0.2, 0.6)
    flat = _between(above_floor("torso"), 0.5, 0.3) * _between(above_floor("head"), 0.6, 0.35)
    w, a, b, c = np.moveaxis(quaternions[:, body_index("torso")], -1, 0)
    chest_up = 2 * (a * c - w * b)  # vertical part of the torso's own x axis
    hips = above_floor("pelvis")
    values = {
        "chest_forward": _between(tip, 8, 28) * on_legs,
        "chest_back": _between(tip, -2, -15) * on_legs,
        "hips_low": _between(hips, 0.7, 0.5),
        "hips_high": _between(hips, 0.7, 0.84) * on_legs,
        "wrists_meet": _between(np.linalg.norm(at("right_hand") - at("left_hand"), axis=1), 0.4, 0.2),
        "shoes_wide": _between(at("left_foot")[:, 1] - at("right_foot")[:, 1], 0.4, 0.65),
        "belly_down": flat * _between(chest_up, -0.3, -0.7),
        "belly_up": flat * _between(chest_up, 0.3, 0.7),
    }
    for side, other, outward in (("right", "left", -1.0), ("left", "right", 1.0)):
        hand, shoulder, elbow = at(f"{side}_hand"), at(f"{side}_upper_arm"), at(f"{side}_lower_arm")
        arm = _bend(shoulder, elbow, hand)
        leg = _bend(at(f"{side}_thigh"), at(f"{side}_shin"), at(f"{side}_foot"))
        values |= {
            f"wrist_high.{side}": _between(hand[:, 2] - at("head")[:, 2], 0.1, 0.25) * on_legs,
            f"wrist_level.{side}": _between(np.abs(hand[:, 2] - shoulder[:, 2]), 0.25, 0.1) * on_legs,
            f"wrist_low.{side}": _between(hand[:, 2], 0.2, 0.02) * on_legs,
            f"wrist_ahead.{side}": _between(hand[:, 0] - shoulder[:, 0], 0.2, 0.4) * on_legs,
            f"wrist_behind.{side}": _between(hand[:, 0], -0.02, -0.2) * on_legs,
            f"wrist_outside.{side}": _between(outward * (hand[:, 1] - shoulder[:, 1]), 0.15, 0.4) * on_legs,
            f"elbow_sharp.{side}": _between(arm, 45, 85),
            f"elbow_open.{side}": _between(arm, 60, 25),
            f"knee_sharp.{side}": _between(leg, 40, 75),
            f"knee_open.{side}": _between(leg, 50, 20),
            f"heel_off.{side}": _between(above_floor(f"{side}_foot"), 0.15, 0.3),
            f"heel_down.{side}": _between(above_floor(f"{side}_foot"), 0.15, 0.1),
            f"toes_ahead.{side}": _between(at(f"{side}_foot")[:, 0] - at(f"{other}_foot")[:, 0], 0.12, 0.35),
        }
    return np.stack([values[name] for name in FACT_NAMES], 1)


@dataclass(frozen=True)
class PoseCaption:
    """What is said of a pose.

    Attributes:
        pose: index of the pose.
        facts: indices of the facts that are said.
        texts: the two wordings.
    """

    pose: int
    facts: tuple[int, ...]
    texts: tuple[str, str]


def pose_captions(values: Array, facts_per_caption: int = 3) -> list[PoseCaption]:
    """One caption for each pose that has something to be said: those of its facts that fewest other poses share.

    Args:
        values: how far facts hold, `(n, facts)`, see :func:`measure_facts`.
        facts_per_caption: most facts in a caption.
    """
    holds = values >= 0.999
    share = holds.mean(0)
    captions = []
    for pose, row in enumerate(holds):
        rarest = sorted(map(int, np.flatnonzero(row)), key=lambda fact: share[fact])[:facts_per_caption]
        # What half of all poses share, such as straight knees, tells none apart.
        said = [fact for fact in rarest if share[fact] < 0.5]
        if said:
            captions.append(PoseCaption(pose, tuple(said), (_sentence(said, 0), _sentence(said, 1))))
    return captions


def _sentence(facts: Sequence[int], wording: int) -> str:
    return ", ".join(FACTS[fact].wordings[wording] for fact in facts)
