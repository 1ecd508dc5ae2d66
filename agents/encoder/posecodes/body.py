"""Posecodes of trunk, head and the whole body, and of what carries it."""

from __future__ import annotations

import numpy as np

from agents.encoder.concepts.base import degrees
from agents.encoder.measurements import SIDES, Array, Measurements, near, ramp
from agents.encoder.posecodes.base import add_sided, add_whole


def _pitch(m: Measurements) -> Array:
    up = m.axis("torso", 2)
    return np.arctan2(up[:, 0], up[:, 2])


def _roll(m: Measurements) -> Array:
    up = m.axis("torso", 2)
    return np.arctan2(up[:, 1], np.hypot(up[:, 0], up[:, 2]))


def _yaw(m: Measurements, body: str) -> Array:
    ahead = m.axis(body, 0)
    return np.arctan2(ahead[:, 1], ahead[:, 0])


def _sign(side: str) -> float:
    return 1.0 if side == "left" else -1.0


def _carried(m: Measurements) -> Array:
    return ramp(m.uprightness, -0.3, 0.0)


add_whole(
    "trunk_upright",
    "an upright trunk | the back straight up | the torso vertical | a vertical back | the upper body erect",
    "the trunk is upright | the torso is vertical | the back is straight up | "
    "the upper body leans nowhere | the spine is vertical",
    "keep the trunk upright | hold the back vertical | stand tall with the torso | straighten up",
    lambda m: ramp(m.uprightness, 0.9, 0.985),
    "trunk_forward | trunk_back",
)
add_whole(
    "trunk_forward",
    "the trunk leaning forward | a forward lean | the upper body tilted forward | the torso inclined to the front",
    "the trunk leans forward | the upper body is tilted forward | the torso is inclined to the front | "
    "the back slopes forward"
    " | the chest is ahead of the hips | the shoulders are in front of the hips",
    "lean forward | bend the trunk forward | tilt the torso forward | incline the upper body to the front",
    lambda m: ramp(_pitch(m), degrees(8), degrees(28)) * _carried(m),
    "trunk_back | trunk_upright",
)
add_whole(
    "trunk_level",
    "the trunk level | the back parallel to the floor | the upper body horizontal | the torso bent to a right angle",
    "the trunk is horizontal | the back is level | the torso is parallel to the ground | "
    "the upper body is bent right over",
    "bend over until the back is level | bring the trunk parallel to the floor | "
    "bend the upper body down to horizontal",
    lambda m: ramp(_pitch(m), degrees(45), degrees(75)) * ramp(np.abs(m.uprightness), 0.7, 0.3),
    "trunk_upright | trunk_back",
)
add_whole(
    "trunk_back",
    "the trunk leaning back | a backward lean | the upper body tilted backward | the back arched",
    "the trunk leans back | the upper body is tilted backward | the torso is inclined to the rear"
    " | the shoulders are behind the hips",
    "lean back | bend the trunk backward | tilt the torso back | arch backward",
    lambda m: ramp(_pitch(m), degrees(-6), degrees(-24)) * _carried(m),
    "trunk_forward | trunk_upright",
)
add_sided(
    "trunk_lean",
    "the trunk leaning to the {side} | a lean to the {side} | the upper body tilted to the {side} | "
    "a side bend to the {side}",
    "the trunk leans to the {side} | the upper body is tilted to the {side} | the torso is bent sideways to the {side}"
    " | the {side} shoulder is lower than the {other} one | the {other} shoulder is higher",
    "lean to the {side} | bend the trunk to the {side} | tilt the torso {side} | bend sideways, to the {side}",
    lambda m, side, other: ramp(_roll(m) * _sign(side), degrees(5), degrees(20)),
    "trunk_twist",
)
add_sided(
    "trunk_twist",
    "the trunk turned to the {side} | a twist to the {side} | the shoulders rotated to the {side} | "
    "the chest facing {side}",
    "the trunk is twisted to the {side} | the shoulders are turned to the {side} | "
    "the chest faces to the {side} of the hips"
    " | the {other} shoulder is ahead of the {side} one",
    "twist to the {side} | turn the shoulders to the {side} | rotate the trunk to the {side}",
    lambda m, side, other: (
        ramp(_yaw(m, "torso") * _sign(side), degrees(7), degrees(28)) * ramp(m.uprightness, 0.3, 0.6)
    ),
    "trunk_lean | head_turn",
)
add_sided(
    "head_turn",
    "the head turned to the {side} | the face towards the {side} | a look to the {side} | the nose pointing {side}",
    "the head is turned to the {side} | the face looks to the {side} | the gaze goes to the {side} | "
    "the nose points to the {side}",
    "turn the head to the {side} | look {side} | rotate the neck to the {side} | glance to the {side}",
    lambda m, side, other: ramp(_yaw(m, "head") * _sign(side), degrees(9), degrees(32)) * ramp(m.uprightness, 0.2, 0.5),
    "trunk_twist | head_tilt",
)


def _head_roll(m: Measurements) -> Array:
    """How far the head is tilted to the left against the trunk."""
    up = m.axis("head", 2)
    left = m.axis("torso", 1)
    return np.arcsin(np.clip((up * left).sum(1), -1, 1))


add_sided(
    "head_tilt",
    "the head tilted to the {side} | the {side} ear towards the {side} shoulder | "
    "a sideways tilt of the head to the {side}",
    "the head is tilted to the {side} | the head leans to the {side} shoulder | the {side} ear is near the shoulder",
    "tilt the head to the {side} | bring the {side} ear to the shoulder | cock the head to the {side}",
    lambda m, side, other: ramp(_head_roll(m) * _sign(side), degrees(7), degrees(24)),
    "head_turn",
)


def _gaze(m: Measurements) -> Array:
    return np.arcsin(np.clip(m.axis("head", 0)[:, 2], -1, 1))


add_whole(
    "head_up",
    "the head tilted back | the face lifted | the chin up | the gaze upward",
    "the head looks up | the face is lifted to the ceiling | the gaze goes up | the chin is raised",
    "look up | lift the chin | tilt the head back | raise your face",
    lambda m: ramp(_gaze(m), degrees(8), degrees(28)),
    "head_down",
)
add_whole(
    "head_down",
    "the head lowered | the face down | the chin down | the gaze to the floor",
    "the head looks down | the face is turned to the floor | the gaze goes down | the head is bowed",
    "look down | lower the chin | bow the head | drop your gaze to the floor",
    lambda m: ramp(_gaze(m), degrees(-10), degrees(-32)),
    "head_up",
)
add_whole(
    "head_level",
    "the head straight | the face to the front | the gaze level",
    "the head is straight | the head looks straight ahead | the face points to the front",
    "look straight ahead | keep the head level | face the front",
    lambda m: ramp(np.abs(_gaze(m)), degrees(22), degrees(8)) * ramp(np.abs(_yaw(m, "head")), degrees(22), degrees(8)),
    "head_down | head_up",
)
add_whole(
    "head_below_hips",
    "the head below the hips | the head lower than the pelvis | the hips higher than the head",
    "the head is lower than the hips | the pelvis is above the head | the head hangs below the waist",
    "bring the head below the hips | put the head lower than the pelvis",
    lambda m: ramp(m.head_centre[:, 2], 0.12, -0.1),
    "head_up",
)
add_whole(
    "head_low",
    "the head close to the floor | the head near the ground | the head low",
    "the head is close to the ground | the head is not far from the floor",
    "bring the head close to the floor | lower the head to the ground",
    lambda m: ramp(m.head_height, 0.75, 0.4),
    "pelvis_high",
)
add_whole(
    "pelvis_high",
    "the hips high | straight legs under the hips | the pelvis at standing height | full standing height",
    "the pelvis is at standing height | the hips are as high as they can be | the body stands at its full height",
    "stand at full height | keep the hips high | stand up straight",
    lambda m: ramp(m.pelvis_height, 0.8, 0.88),
    "pelvis_low | pelvis_floor",
)
add_whole(
    "pelvis_lowered",
    "the hips a little lowered | slightly sunk hips | the pelvis a bit below standing height",
    "the pelvis is a little lower than in standing | the hips have sunk a bit | the body is slightly lowered",
    "lower the hips a little | sink a bit | go down slightly",
    lambda m: near(m.pelvis_height, 0.73, 0.11),
    "pelvis_low | pelvis_high",
)
add_whole(
    "pelvis_low",
    "the hips low | a lowered pelvis | the seat at knee height | the bottom down low | the pelvis as low as the knees",
    "the pelvis is low | the hips are at about knee height | the bottom is down near the knees | the seat is low",
    "lower the hips to the knees | bring the pelvis down low | drop the bottom to knee height",
    lambda m: near(m.pelvis_height, 0.45, 0.22),
    "pelvis_high | pelvis_floor",
)
add_whole(
    "pelvis_floor",
    "the bottom on the floor | the hips on the ground | the pelvis close to the floor",
    "the pelvis is on the floor | the hips rest on the ground | the bottom touches the floor",
    "put the bottom on the floor | bring the hips down to the ground",
    lambda m: ramp(m.pelvis_height, 0.28, 0.16),
    "pelvis_high | pelvis_low",
)
add_whole(
    "sitting_floor",
    "the seat on the floor and the trunk up | a sitting posture on the ground",
    "the person sits on the ground | the body sits on the floor with the trunk raised",
    "sit on the floor | sit down on the ground | be seated on the floor",
    lambda m: ramp(m.pelvis_height, 0.32, 0.18) * ramp(m.uprightness, 0.3, 0.75),
    "lying | pelvis_high",
)
add_whole(
    "lying",
    "the whole body on the floor | the trunk flat on the ground | the body stretched on the floor",
    "the body lies on the floor | the trunk is on the ground | the whole body is down on the floor",
    "lie on the floor | lie down | be flat on the ground",
    lambda m: ramp(m.height("torso"), 0.42, 0.22) * ramp(m.head_height, 0.5, 0.28),
    "pelvis_high | sitting_floor",
)
add_whole(
    "facing_up",
    "the belly up | the chest facing the ceiling | the back to the floor",
    "the chest faces the ceiling | the belly points up | the back is turned to the floor",
    "turn the belly up | lie on the back | face the ceiling with the chest",
    lambda m: ramp(m.axis("torso", 0)[:, 2], 0.4, 0.8),
    "facing_down",
)
add_whole(
    "facing_down",
    "the belly down | the chest facing the floor | the back to the ceiling",
    "the chest faces the floor | the belly points down | the back is turned to the ceiling",
    "turn the belly down | face the floor with the chest",
    lambda m: ramp(m.axis("torso", 0)[:, 2], -0.4, -0.8),
    "facing_up",
)
add_sided(
    "side_down",
    "the {side} side down | the {side} side on the floor | the weight on the {side} side of the trunk",
    "the {side} side is down | the body lies on its {side} side | the {other} side faces the ceiling",
    "lie on the {side} side | turn the {side} side to the floor",
    lambda m, side, other: ramp(m.axis("torso", 1)[:, 2] * -_sign(side), 0.4, 0.8),
)
add_whole(
    "upside_down",
    "the body upside down | the head down and the feet up | the feet above the head",
    "the body is upside down | the feet are higher than the head | the head points to the floor",
    "be upside down | turn the body upside down | put the feet over the head",
    lambda m: ramp(m.uprightness, 0.0, -0.6),
    "trunk_upright",
)
add_whole(
    "airborne",
    "both feet off the floor | nothing on the ground | both feet in the air | air under both feet",
    "both feet are in the air | neither foot touches the floor | the body is in flight | no foot is on the ground",
    "take both feet off the floor | be in the air | leave the ground",
    lambda m: (
        ramp(np.minimum(m.height("right_foot"), m.height("left_foot")), 0.13, 0.24) * ramp(m.pelvis_height, 0.5, 0.75)
    ),
    "feet_planted",
)
add_whole(
    "feet_planted",
    "both feet on the floor | both feet planted | the weight on both feet | the two soles on the ground",
    "both feet touch the floor | both feet are on the ground | the body stands on both legs | "
    "the weight is on both feet",
    "stand on both feet | keep both feet on the ground | plant both feet",
    lambda m: np.minimum(m.foot_down("right"), m.foot_down("left")) * ramp(m.pelvis_height, 0.4, 0.6),
    "airborne",
)
add_sided(
    "on_one_leg",
    "the weight on the {side} leg | only the {side} foot on the floor | the {side} leg supporting the body",
    "the body stands on the {side} leg | only the {side} foot touches the floor | the {side} leg carries the weight"
    " | the {other} foot is in the air and the {side} one is on the ground",
    "stand on the {side} leg | balance on the {side} foot | put all weight on the {side} leg | "
    "lift the {other} foot only",
    lambda m, side, other: (
        m.foot_down(side) * ramp(m.height(f"{other}_foot"), 0.13, 0.25) * ramp(m.pelvis_height, 0.5, 0.7)
    ),
    "on_one_leg_any",
)
add_whole(
    "on_one_leg_any",
    "one foot off the floor | the weight on one leg | a single supporting leg",
    "the body stands on one leg | just one foot touches the floor | one leg carries the weight",
    "stand on one leg | balance on one foot",
    lambda m: np.maximum(
        *(
            m.foot_down(side) * ramp(m.height(f"{other}_foot"), 0.13, 0.25) * ramp(m.pelvis_height, 0.5, 0.7)
            for side, other in (SIDES, SIDES[::-1])
        )
    ),
    "feet_planted | airborne",
)
add_whole(
    "kneeling",
    "both knees on the floor and the trunk up | a kneeling position | the weight on the knees",
    "the body kneels | both knees carry the body | the person is on their knees",
    "kneel | go down on both knees | kneel on the floor",
    lambda m: (
        np.minimum(*(ramp(m.height(f"{side}_shin"), 0.22, 0.11) for side in SIDES))
        * ramp(m.uprightness, 0.3, 0.7)
        * ramp(m.pelvis_height, 0.22, 0.35)
    ),
    "feet_planted | sitting_floor",
)
add_whole(
    "hands_and_knees",
    "hands and knees on the floor | the weight on hands and knees | all fours",
    "the hands and the knees touch the floor | the body is carried by hands and knees",
    "be on hands and knees | go down on all fours | support yourself on hands and knees",
    lambda m: (
        np.minimum(*(ramp(m.height(f"{side}_shin"), 0.3, 0.13) for side in SIDES))
        * np.minimum(*(ramp(m.height(f"{side}_hand"), 0.3, 0.12) for side in SIDES))
        * ramp(m.pelvis_height, 0.2, 0.32)
    ),
    "kneeling | lying",
)
add_whole(
    "curled",
    "the body curled up | a small compact posture | limbs drawn in | the body folded together",
    "the body is curled up | the body is folded | hands and feet are close to the trunk | the body takes little space",
    "curl up | make yourself small | fold the body together",
    lambda m: ramp(
        np.mean(
            [np.linalg.norm(m.point(f"{side}_{part}"), axis=1) for side in SIDES for part in ("hand", "foot")], axis=0
        ),
        0.62,
        0.45,
    ),
    "spread",
)
add_whole(
    "spread",
    "the limbs spread | arms and legs far out | a large open posture | the body stretched to its full size",
    "the limbs are spread far | hands and feet are far from the trunk | the body takes a lot of space | "
    "the body is wide open",
    "spread out | make yourself big | stretch arms and legs away from the body",
    lambda m: ramp(
        np.mean(
            [np.linalg.norm(m.point(f"{side}_{part}"), axis=1) for side in SIDES for part in ("hand", "foot")], axis=0
        ),
        0.78,
        0.9,
    ),
    "curled",
)
