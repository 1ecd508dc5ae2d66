"""Posecodes of places: how high hands, elbows, knees and feet are, and where they are relative to others."""

from __future__ import annotations

import numpy as np

from agents.encoder.measurements import SIDES, Array, Measurements, near, ramp
from agents.encoder.posecodes.base import SidedRule, add_limb, add_sided, add_whole


def _left(side: str) -> float:
    return 1.0 if side == "left" else -1.0


def _shoulder(m: Measurements) -> Array:
    return 0.5 * (m.height("right_upper_arm") + m.height("left_upper_arm"))


def _higher(part: str, gap: float) -> SidedRule:
    return lambda m, side, other: ramp(m.height(f"{side}_{part}") - m.height(f"{other}_{part}"), 0.08, gap)


def _before(part: str, gap: float) -> SidedRule:
    return lambda m, side, other: ramp((m.point(f"{side}_{part}") - m.point(f"{other}_{part}"))[:, 0], 0.06, gap)


_HAND = "hand | wrist"

# Heights
add_limb(
    "hand_over_head",
    _HAND,
    "above the head | overhead | higher than the head | over the head | above head height | up over the head",
    lambda m, side, other: ramp(m.hand_above_head(side), 0.0, 0.16),
    "raise the {side} hand above the head | lift the {side} hand overhead | put the {side} hand up high",
    "the {side} hand is the highest point of the body | the {side} hand goes beyond the top of the head",
    "hand_under_hip | hand_at_waist | foot_high",
)
add_limb(
    "hand_at_face",
    _HAND,
    "at head height | level with the face | at the height of the head | at eye level | as high as the chin",
    lambda m, side, other: near(m.hand_above_head(side), -0.03, 0.17),
    "lift the {side} hand to the height of the head | raise the {side} hand to eye level | "
    "bring the {side} hand up to face level",
    "",
    "hand_under_hip | hand_at_waist",
)
add_limb(
    "hand_over_shoulder",
    _HAND,
    "above the shoulder | higher than the shoulder | above shoulder height | "
    "raised above shoulder level | above the shoulders",
    lambda m, side, other: ramp(m.height(f"{side}_hand") - m.height(f"{side}_upper_arm"), 0.0, 0.16),
    "raise the {side} hand above the shoulders | lift the {side} hand higher than the shoulders",
    "the {side} hand is above the {side} shoulder | the shoulder is lower than the {side} hand",
    "hand_under_shoulder | elbow_over_shoulder",
)
add_limb(
    "hand_at_shoulder",
    _HAND,
    "at shoulder height | level with the shoulders | as high as the shoulder | at the height of the shoulders",
    lambda m, side, other: near(m.height(f"{side}_hand") - m.height(f"{side}_upper_arm"), 0.0, 0.17),
    "hold the {side} hand at shoulder height | lift the {side} hand to shoulder level",
    "the {side} hand and the {side} shoulder are at the same height",
    "hand_under_hip | hand_over_head",
)
add_limb(
    "hand_under_shoulder",
    _HAND,
    "below the shoulder | lower than the shoulder | below shoulder height | under shoulder level",
    lambda m, side, other: ramp(m.height(f"{side}_hand") - m.height(f"{side}_upper_arm"), -0.03, -0.2),
    "keep the {side} hand below the shoulders | lower the {side} hand under shoulder level",
    "the {side} hand is under the {side} shoulder | the shoulder is higher than the {side} hand",
    "hand_over_shoulder",
)
add_limb(
    "hand_at_chest",
    _HAND,
    "at chest height | level with the chest | at the height of the breast | in front of the chest area | "
    "at breast level",
    lambda m, side, other: near(m.height(f"{side}_hand") - m.height(f"{side}_upper_arm"), -0.2, 0.16),
    "hold the {side} hand at chest height | bring the {side} hand to the level of the chest",
    "",
    "hand_over_head | hand_under_hip",
)
add_limb(
    "hand_at_waist",
    _HAND,
    "at waist height | level with the waist | at the height of the belly | as high as the waist | at hip height | "
    "level with the hips",
    lambda m, side, other: near(m.point(f"{side}_hand")[:, 2], 0.08, 0.17),
    "hold the {side} hand at waist height | bring the {side} hand to hip level | lower the {side} hand to the waist",
    "",
    "hand_over_head | hand_at_shoulder",
)
add_limb(
    "hand_under_hip",
    _HAND,
    "below the hips | lower than the waist | below the pelvis | down by the thigh | under hip height | below the waist",
    lambda m, side, other: ramp(m.point(f"{side}_hand")[:, 2], 0.02, -0.13),
    "lower the {side} hand below the hips | drop the {side} hand under the waist | "
    "let the {side} hand hang by the thigh",
    "the {side} hand is under the hips | the pelvis is higher than the {side} hand",
    "hand_over_head | hand_over_shoulder",
)
add_limb(
    "hand_over_hip",
    _HAND,
    "above the hips | higher than the waist | above the pelvis | over hip height | above the waist",
    lambda m, side, other: ramp(m.point(f"{side}_hand")[:, 2], 0.02, 0.18),
    "lift the {side} hand above the hips | keep the {side} hand higher than the waist",
    "the {side} hand is over the hips",
    "hand_under_hip",
)
add_limb(
    "hand_at_knee",
    _HAND,
    "at knee height | level with the knees | as low as the knee | at the height of the knees | down near knee level",
    lambda m, side, other: near(m.height(f"{side}_hand"), 0.47, 0.17) * ramp(m.pelvis_height, 0.3, 0.5),
    "lower the {side} hand to knee height | bring the {side} hand down to the knees",
    "",
    "hand_over_head | hand_at_shoulder",
)
add_limb(
    "hand_low",
    _HAND,
    "near the floor | close to the ground | just above the floor | down at the ground | by the floor | at ankle height",
    lambda m, side, other: ramp(m.height(f"{side}_hand"), 0.4, 0.18),
    "bring the {side} hand close to the floor | reach for the floor with the {side} hand | "
    "lower the {side} hand to the ground",
    "",
    "hand_over_head | foot_off",
)
add_limb(
    "hand_floor",
    _HAND,
    "on the floor | touching the ground | on the ground | resting on the floor | planted on the ground | "
    "in contact with the floor",
    lambda m, side, other: ramp(m.height(f"{side}_hand"), 0.17, 0.08),
    "put the {side} hand on the floor | touch the floor with the {side} hand | place the {side} hand on the ground"
    " | support yourself with the {side} hand on the floor",
    "the {side} hand touches the floor | the {side} hand supports the body on the ground",
    "hand_over_head | knee_floor",
)
add_limb(
    "elbow_over_shoulder",
    "elbow",
    "above the shoulder | higher than the shoulders | raised above shoulder level | up over the shoulder",
    lambda m, side, other: ramp(m.height(f"{side}_lower_arm") - m.height(f"{side}_upper_arm"), 0.02, 0.14),
    "raise the {side} elbow above the shoulder | lift the {side} elbow up high",
    "the {side} elbow is over the {side} shoulder",
    "elbow_under_shoulder | knee_over_hip",
)
add_limb(
    "elbow_at_shoulder",
    "elbow",
    "at shoulder height | level with the shoulder | as high as the shoulder | raised to the side at shoulder level",
    lambda m, side, other: near(m.height(f"{side}_lower_arm") - m.height(f"{side}_upper_arm"), 0.0, 0.12),
    "lift the {side} elbow to shoulder height | hold the {side} elbow level with the shoulder",
    "",
    "elbow_under_shoulder",
)
add_limb(
    "elbow_under_shoulder",
    "elbow",
    "below the shoulder | lower than the shoulder | hanging below the shoulder | down",
    lambda m, side, other: ramp(m.height(f"{side}_lower_arm") - m.height(f"{side}_upper_arm"), -0.06, -0.2),
    "keep the {side} elbow below the shoulder | lower the {side} elbow",
    "",
    "elbow_over_shoulder",
)
add_limb(
    "elbow_side",
    "elbow",
    "close to the body | at the side of the trunk | tucked in | against the ribs | beside the waist",
    lambda m, side, other: (
        ramp(np.abs(m.point(f"{side}_lower_arm")[:, 1]) + np.abs(m.point(f"{side}_lower_arm")[:, 0]), 0.42, 0.28)
        * ramp(m.height(f"{side}_lower_arm") - m.height(f"{side}_upper_arm"), -0.05, -0.2)
    ),
    "keep the {side} elbow close to the body | tuck in the {side} elbow | hold the {side} elbow at your side",
    "",
    "elbow_out",
)
add_limb(
    "elbow_out",
    "elbow",
    "away from the body | out to the side | flared out | sticking out | winged out | far from the trunk",
    lambda m, side, other: ramp(
        (m.point(f"{side}_lower_arm") - m.point(f"{side}_upper_arm"))[:, 1] * _left(side), 0.08, 0.2
    ),
    "lift the {side} elbow away from the body | flare the {side} elbow out | stick the {side} elbow out",
    "",
    "elbow_side | knee_out",
)
add_limb(
    "elbow_back",
    "elbow",
    "behind the back | behind the body | pulled back | drawn back | behind the trunk",
    lambda m, side, other: ramp(
        (m.point(f"{side}_lower_arm") - m.point(f"{side}_upper_arm"))[:, 0],
        -0.03,
        -0.16,
    ),
    "pull the {side} elbow back | draw the {side} elbow behind you",
    "the {side} elbow sticks out to the rear",
    "elbow_ahead",
)
add_limb(
    "elbow_ahead",
    "elbow",
    "in front of the body | ahead of the shoulder | brought forward | in front of the chest",
    lambda m, side, other: ramp((m.point(f"{side}_lower_arm") - m.point(f"{side}_upper_arm"))[:, 0], 0.05, 0.19),
    "bring the {side} elbow forward | move the {side} elbow to the front",
    "",
    "elbow_back | knee_ahead",
)
add_limb(
    "knee_over_hip",
    "knee",
    "above the hip | higher than the hips | above hip height | lifted over the waist | pulled up very high",
    lambda m, side, other: ramp(m.point(f"{side}_shin")[:, 2], -0.02, 0.1),
    "lift the {side} knee above the hip | pull the {side} knee up high | raise the {side} knee over the waist",
    "the {side} knee is higher than the pelvis",
    "knee_under_hip | elbow_over_shoulder",
)
add_limb(
    "knee_at_hip",
    "knee",
    "at hip height | level with the hip | as high as the hips | lifted to the waist | raised to hip level",
    lambda m, side, other: near(m.point(f"{side}_shin")[:, 2], -0.04, 0.16),
    "lift the {side} knee to hip height | raise the {side} knee to the waist | bring the {side} knee up to hip level",
    "",
    "knee_under_hip",
)
add_limb(
    "knee_under_hip",
    "knee",
    "below the hip | lower than the hips | under the pelvis | well below the waist",
    lambda m, side, other: ramp(m.point(f"{side}_shin")[:, 2], -0.12, -0.3),
    "keep the {side} knee below the hip | lower the {side} knee",
    "",
    "knee_over_hip",
)
add_limb(
    "knee_floor",
    "knee",
    "on the floor | on the ground | touching the ground | resting on the floor | down on the floor",
    lambda m, side, other: ramp(m.height(f"{side}_shin"), 0.2, 0.1),
    "put the {side} knee on the floor | kneel on the {side} knee | rest the {side} knee on the ground | "
    "drop the {side} knee to the ground",
    "the {side} knee touches the floor | the {side} knee supports the body | kneeling on the {side} knee",
    "foot_off | knee_over_hip | hand_floor",
)
add_limb(
    "knee_ahead",
    "knee",
    "in front of the body | ahead of the hip | pushed forward | out in front",
    lambda m, side, other: ramp((m.point(f"{side}_shin") - m.point(f"{side}_thigh"))[:, 0], 0.12, 0.3),
    "bring the {side} knee forward | push the {side} knee to the front",
    "",
    "knee_behind | elbow_ahead",
)
add_limb(
    "knee_behind",
    "knee",
    "behind the body | behind the hip | back behind the pelvis | to the rear",
    lambda m, side, other: ramp((m.point(f"{side}_shin") - m.point(f"{side}_thigh"))[:, 0], -0.04, -0.18),
    "take the {side} knee back | move the {side} knee behind the hip",
    "",
    "knee_ahead",
)
add_limb(
    "knee_out",
    "knee",
    "turned out | out to the side | pointing outward | opened to the side | away from the midline",
    lambda m, side, other: ramp((m.point(f"{side}_shin") - m.point(f"{side}_thigh"))[:, 1] * _left(side), 0.07, 0.2),
    "open the {side} knee to the side | turn the {side} knee out | push the {side} knee outward",
    "",
    "elbow_out",
)
add_limb(
    "foot_off",
    "foot",
    "off the floor | in the air | lifted | off the ground | raised from the floor | "
    "not touching the ground | up in the air",
    lambda m, side, other: ramp(m.height(f"{side}_foot"), 0.12, 0.22),
    "lift the {side} foot off the floor | raise the {side} foot from the ground | take the {side} foot off the ground"
    " | pick up the {side} foot",
    "the {side} foot does not touch the ground | the {side} foot has come off the floor | "
    "there is air under the {side} foot"
    " | no weight is on the {side} foot",
    "foot_down | hand_over_hip",
)
add_limb(
    "foot_down",
    "foot",
    "on the floor | on the ground | flat on the ground | planted | touching the floor | firmly on the ground",
    lambda m, side, other: ramp(m.height(f"{side}_foot"), 0.19, 0.12),
    "put the {side} foot on the floor | keep the {side} foot on the ground | plant the {side} foot | "
    "place the {side} foot down",
    "the {side} foot touches the ground | the {side} foot rests on the floor",
    "foot_off | hand_floor",
)
add_limb(
    "foot_knee_high",
    "foot",
    "at knee height | as high as the knee | level with the other knee | up at knee level",
    lambda m, side, other: near(m.height(f"{side}_foot"), 0.45, 0.2),
    "lift the {side} foot to knee height | raise the {side} foot as high as the knee",
    "",
    "foot_down | hand_at_knee",
)
add_limb(
    "foot_high",
    "foot",
    "at hip height or above | above the waist | higher than the hips | up very high | kicked up high | "
    "as high as the hip",
    lambda m, side, other: ramp(m.point(f"{side}_foot")[:, 2], -0.25, -0.02),
    "lift the {side} foot to hip height | raise the {side} foot up high | kick the {side} foot up above the waist",
    "the {side} foot is as high as the pelvis",
    "foot_down | hand_over_head",
)
add_limb(
    "foot_ahead",
    "foot",
    "in front of the body | ahead of the hips | out in front | forward | in front of the pelvis",
    lambda m, side, other: ramp(m.foot_from_pelvis(side)[:, 0], 0.14, 0.35),
    "put the {side} foot forward | place the {side} foot in front of you | bring the {side} foot to the front",
    "",
    "foot_behind | hand_ahead",
)
add_limb(
    "foot_behind",
    "foot",
    "behind the body | behind the hips | to the rear | back | at the back of the pelvis",
    lambda m, side, other: ramp(m.foot_from_pelvis(side)[:, 0], -0.12, -0.33),
    "put the {side} foot back | place the {side} foot behind you | take the {side} foot to the rear",
    "",
    "foot_ahead | hand_behind",
)
add_limb(
    "foot_aside",
    "foot",
    "out to the side | far to the {side} | stretched sideways | wide of the hip | away to the {side} side",
    lambda m, side, other: ramp(m.foot_from_pelvis(side)[:, 1], 0.2, 0.42),
    "put the {side} foot out to the side | step the {side} foot wide | move the {side} foot to the {side}",
    "",
    "foot_across | hand_aside",
)
add_limb(
    "foot_across",
    "foot",
    "across the midline | on the {other} side of the body | crossed over to the {other} | past the middle of the body",
    lambda m, side, other: ramp(m.foot_from_pelvis(side)[:, 1], 0.02, -0.1),
    "cross the {side} foot over to the {other} | bring the {side} foot across the middle",
    "",
    "foot_aside | hand_across",
)

# Places of hands relative to the body
add_limb(
    "hand_ahead",
    _HAND,
    "in front of the body | ahead of the trunk | before the body | out in front | in front of the torso | "
    "forward of the chest",
    lambda m, side, other: ramp(m.point(f"{side}_hand")[:, 0], 0.16, 0.36),
    "hold the {side} hand in front of the body | bring the {side} hand to the front | put the {side} hand out in front",
    "the {side} hand is in front of the person | in front of the body is the {side} hand",
    "hand_behind | foot_ahead",
)
add_limb(
    "hand_behind",
    _HAND,
    "behind the body | behind the back | to the rear of the trunk | in back of the hips | hidden behind the back",
    lambda m, side, other: ramp(m.point(f"{side}_hand")[:, 0], -0.03, -0.2),
    "put the {side} hand behind the back | take the {side} hand behind the body | move the {side} hand to the rear",
    "the {side} hand is in back of the person",
    "hand_ahead | foot_behind",
)
add_limb(
    "hand_aside",
    _HAND,
    "out to the side | far to the {side} of the body | away from the body | out on the {side} | "
    "beyond the {side} shoulder",
    lambda m, side, other: ramp(m.hand_from_shoulder(side)[:, 1], 0.12, 0.38),
    "hold the {side} hand out to the side | move the {side} hand away to the {side} | "
    "put the {side} hand out on the {side}",
    "the {side} hand is to the {side} of the body | the {side} hand is far out on its own side",
    "hand_across | foot_aside",
)
add_limb(
    "hand_across",
    _HAND,
    "across the body | on the {other} side of the body | past the midline | "
    "in front of the {other} side | crossed over to the {other}",
    lambda m, side, other: ramp(m.point(f"{side}_hand")[:, 1] * _left(side), 0.05, -0.08),
    "bring the {side} hand across the body | move the {side} hand over to the {other} side | "
    "cross the {side} hand to the {other}",
    "the {side} hand is to the {other} of the body's middle | the {side} hand has crossed the midline",
    "hand_aside",
)


def _to_head(m: Measurements, side: str) -> Array:
    gap: Array = np.linalg.norm(m.point(f"{side}_hand") - m.head_centre, axis=1)
    return gap


add_limb(
    "hand_to_head",
    _HAND,
    "close to the head | at the head | touching the head | beside the face | near the ear | "
    "at the side of the head | on the head",
    lambda m, side, other: ramp(_to_head(m, side), 0.36, 0.22),
    "touch the head with the {side} hand | put the {side} hand to the head | bring the {side} hand to the face",
    "the {side} hand touches the head | the {side} hand is near the ear",
    "hand_to_hip | hand_at_knee",
)

_NEAR = "close to the {0} | near the {0} | touching the {0} | at the {0} | next to the {0} | on the {0}"
for stem, target, body in (
    ("hand_to_hip", "{side} hip", "{side}_thigh"),
    ("hand_to_knee", "{side} knee", "{side}_shin"),
    ("hand_to_other_knee", "{other} knee", "{other}_shin"),
    ("hand_to_foot", "{side} foot", "{side}_foot"),
    ("hand_to_other_foot", "{other} foot", "{other}_foot"),
    ("hand_to_shoulder", "{side} shoulder", "{side}_upper_arm"),
    ("hand_to_other_shoulder", "{other} shoulder", "{other}_upper_arm"),
    ("hand_to_other_elbow", "{other} elbow", "{other}_lower_arm"),
    ("elbow_to_knee", "{side} knee", "{side}_shin"),
    ("elbow_to_other_knee", "{other} knee", "{other}_shin"),
    ("foot_to_other_knee", "{other} knee", "{other}_shin"),
):
    limb = stem.split("_")[0]
    part = {"hand": "hand", "elbow": "lower_arm", "foot": "foot"}[limb]

    def _closeness(m: Measurements, side: str, other: str, part: str = part, body: str = body) -> Array:
        return ramp(m.apart(f"{side}_{part}", body.format(side=side, other=other)), 0.34, 0.17)

    add_limb(
        stem,
        {"hand": _HAND, "elbow": "elbow", "foot": "foot"}[limb],
        _NEAR.format(target),
        _closeness,
        f"bring the {{side}} {limb} to the {target} | touch the {target} with the {{side}} {limb}"
        f" | put the {{side}} {limb} near the {target}",
        f"the {{side}} {limb} touches the {target} | the {{side}} {limb} and the {target} are close together"
        f" | there is little space between the {{side}} {limb} and the {target}",
    )


def _hands_apart(m: Measurements) -> Array:
    return m.apart("right_hand", "left_hand")


def _feet_apart(m: Measurements) -> Array:
    gap: Array = np.linalg.norm((m.point("right_foot") - m.point("left_foot"))[:, :2], axis=1)
    return gap


add_whole(
    "hands_together",
    "hands together | both hands close together | hands touching each other | hands next to each other | palms meeting",
    "the hands are close to each other | the hands touch | the two hands meet | one hand is next to the other"
    " | there is hardly any distance between the hands",
    "bring the hands together | join the hands | keep both hands close together | put the palms together",
    lambda m: ramp(_hands_apart(m), 0.34, 0.16),
    "hands_wide | feet_together",
)
add_whole(
    "hands_wide",
    "hands far apart | hands wide apart | a wide distance between the hands | hands spread wide",
    "the hands are far apart | the hands are far from each other | there is a lot of room between the hands",
    "spread the hands wide | move the hands far apart | keep the hands far from each other",
    lambda m: ramp(_hands_apart(m), 0.75, 1.15),
    "hands_together | feet_wide",
)
add_whole(
    "hands_shoulder_width",
    "hands shoulder width apart | hands as far apart as the shoulders",
    "the hands are about shoulder width apart | the distance of the hands is that of the shoulders",
    "hold the hands shoulder width apart | keep the hands at shoulder width",
    lambda m: near(_hands_apart(m), 0.42, 0.2),
    "hands_wide | hands_together",
)
add_whole(
    "hands_crossed",
    "hands crossed | arms crossed over each other | wrists crossed in front",
    "the hands cross each other | the arms are crossed | each hand is on the other side | the wrists cross",
    "cross the hands | cross your arms | cross the wrists",
    lambda m: ramp((m.point("left_hand") - m.point("right_hand"))[:, 1], 0.02, -0.1),
    "hands_wide | feet_crossed",
)
add_whole(
    "feet_together",
    "feet together | feet close together | heels side by side | legs closed | a narrow stance",
    "the feet are close to each other | the feet are together | the feet touch | the legs are closed",
    "put the feet together | close the legs | keep both feet close together | stand with a narrow base",
    lambda m: ramp(_feet_apart(m), 0.3, 0.17),
    "feet_wide | hands_together",
)
add_whole(
    "feet_wide",
    "feet wide apart | legs spread | a wide stance | legs far apart | a broad base | feet far apart",
    "the feet are far apart | the legs are spread | the feet are far from each other | the stance is wide",
    "spread the legs | stand wide | put the feet far apart | take a wide stance | widen the stance",
    lambda m: ramp(_feet_apart(m), 0.42, 0.72),
    "feet_together | hands_wide",
)
add_whole(
    "feet_shoulder_width",
    "feet shoulder width apart | feet under the hips | a normal stance",
    "the feet are about shoulder width apart | the feet are as wide as the shoulders",
    "put the feet shoulder width apart | stand at shoulder width",
    lambda m: near(np.abs((m.point("left_foot") - m.point("right_foot"))[:, 1]), 0.33, 0.15),
    "feet_wide | feet_together",
)
add_whole(
    "feet_crossed",
    "legs crossed | feet crossed | ankles crossed | one leg crossed over the other",
    "the legs are crossed | the feet cross each other | the ankles cross",
    "cross the legs | cross the feet | cross your ankles",
    lambda m: ramp((m.point("left_foot") - m.point("right_foot"))[:, 1], 0.05, -0.06),
    "feet_wide | hands_crossed",
)
add_whole(
    "knees_together",
    "knees together | knees close together | knees touching",
    "the knees are close to each other | the knees touch | the knees are pressed together",
    "keep the knees together | press the knees together | close the knees",
    lambda m: ramp(m.apart("right_shin", "left_shin"), 0.26, 0.15),
    "knees_wide | feet_together",
)
add_whole(
    "knees_wide",
    "knees wide apart | knees far apart | knees spread | knees opened outward",
    "the knees are far from each other | the knees are spread | the knees are wide apart",
    "spread the knees | open the knees wide | move the knees apart",
    lambda m: ramp(m.apart("right_shin", "left_shin"), 0.38, 0.62),
    "knees_together | feet_wide | hands_wide",
)
for limb, part, gap in (
    ("hand", "hand", 0.3),
    ("foot", "foot", 0.28),
    ("knee", "shin", 0.22),
    ("elbow", "lower_arm", 0.22),
):
    few = {"hand": "foot", "foot": "hand", "knee": "elbow", "elbow": "knee"}[limb]
    many = {"foot": "feet"}.get(limb, limb + "s")
    add_sided(
        f"{limb}_higher",
        f"the {{side}} {limb} higher than the {{other}} one | the {{side}} {limb} above the {{other}} {limb}"
        f" | the {{other}} {limb} lower than the {{side}} one | the {{side}} {limb} up and the {{other}} {limb} lower",
        f"the {{side}} {limb} is higher than the {{other}} {limb} | the {{other}} {limb} is below the {{side}} {limb}"
        f" | of the {many}, the {{side}} one is higher | the {{other}} {limb} is lower than the {{side}} one",
        f"hold the {{side}} {limb} higher than the {{other}} {limb} | lift the {{side}} {limb} above the {{other}} one"
        f" | keep the {{other}} {limb} lower than the {{side}} {limb}",
        _higher(part, gap),
        f"{few}_higher | {limb}_before",
    )
    add_sided(
        f"{limb}_before",
        f"the {{side}} {limb} in front of the {{other}} one | the {{side}} {limb} ahead of the {{other}} {limb}"
        f" | the {{other}} {limb} behind the {{side}} {limb} | "
        f"the {{side}} {limb} forward and the {{other}} {limb} back",
        f"the {{side}} {limb} is in front of the {{other}} {limb} | the {{other}} {limb} is behind the {{side}} {limb}"
        f" | of the {many}, the {{side}} one is further forward | "
        f"the {{other}} {limb} is further back than the {{side}} one"
        f" | the {{side}} {limb} leads",
        f"put the {{side}} {limb} in front of the {{other}} {limb} | "
        f"bring the {{side}} {limb} ahead of the {{other}} one"
        f" | keep the {{other}} {limb} behind the {{side}} {limb}",
        _before(part, gap),
        f"{few}_before | {limb}_higher",
    )
add_whole(
    "hands_level",
    "hands at the same height | both hands level with each other",
    "the hands are at the same height | neither hand is higher than the other",
    "hold both hands at one height | keep the hands level",
    lambda m: ramp(np.abs(m.height("left_hand") - m.height("right_hand")), 0.2, 0.05),
)
add_whole(
    "feet_level",
    "feet side by side | feet parallel next to each other | feet in one line",
    "the feet are side by side | neither foot is in front of the other",
    "put the feet side by side | line the feet up",
    lambda m: (
        ramp(np.abs((m.point("left_foot") - m.point("right_foot"))[:, 0]), 0.2, 0.06)
        * np.minimum(*(m.foot_down(side) for side in SIDES))
    ),
)
