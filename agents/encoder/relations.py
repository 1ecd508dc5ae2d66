"""How far a humanoid is in a relation to an object: the rules behind captions such as "a person kicks the ball".

The relations are those of `anyskill_envs.objects.base.RELATIONS` and "approaching", whose captions are written here. Each
rule grades from 0 to 1 by the positions of the bodies and the surfaces of the object over half a second. Rules about a touch
give a little for every step towards the object too: a policy that climbs "kick the ball" must first get there.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import cached_property

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from agents.encoder.concepts import Concept
from agents.encoder.measurements import SIDES, Array, Measurements, near, partly, ramp
from anyskill_envs.objects import SceneObject
from anyskill_envs.objects.scene import Part, Scene
from motion_data.skeleton import FRAME_RATE, body_index
from rewards.object_state import ObjectState

_HANDS = tuple(f"{side}_hand" for side in SIDES)
_FEET = tuple(f"{side}_foot" for side in SIDES)
_STEP = 4
"""Frames over which speeds are taken."""
_SOLE = np.array([[0.13, 0.0, -0.05], [0.0, 0.0, -0.07], [-0.04, 0.0, -0.05]])
"""Toes, sole and heel, seen from the ankle along the axes of the foot, metres."""


class ObjectTrack:
    """One object beside n humanoids over half a second.

    Args:
        scene: the scene.
        part: the object's part of it.
        positions: world positions of everything in the model, `(n, WINDOW, bodies, 3)`.
        quaternions: world orientations of the same, w first, `(n, WINDOW, bodies, 4)`.
        state: states of the object in the last frame.

    Attributes:
        kind: kind of the object, such as "ball".
        state: states in the last frame, in the heading frame of the humanoid.
    """

    def __init__(self, scene: Scene, part: Part, positions: Array, quaternions: Array, state: ObjectState) -> None:
        self.kind = part.item.kind
        self.state = state
        self._positions, self._quaternions = positions, quaternions
        self._root = part.body
        model = scene.model
        # What touches nothing, such as the stripe of the pillar, is no surface.
        self._geoms = [
            index
            for index in range(model.ngeom)
            if model.body_rootid[model.geom_bodyid[index]] == part.body and model.geom_contype[index] & 1
        ]
        self._model = model

    def gap(self, points: Array, frame: int = -1) -> Array:
        """Distance of world points `(n, 3)` from the object's surface in a frame, metres, 0 inside."""
        gaps = [self._gap_to(geom, points, frame) for geom in self._geoms]
        closest: Array = np.min(gaps, axis=0)
        return closest

    def _gap_to(self, geom: int, points: Array, frame: int) -> Array:
        model, body = self._model, self._model.geom_bodyid[geom]
        turned = Rotation.from_quat(self._quaternions[:, frame, body], scalar_first=True)
        local = turned.inv().apply(points - self._positions[:, frame, body]) - model.geom_pos[geom]
        local = Rotation.from_quat(model.geom_quat[geom], scalar_first=True).inv().apply(local)
        size = model.geom_size[geom]
        if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_BOX.value:
            return np.linalg.norm(np.maximum(np.abs(local) - size, 0.0), axis=1)
        # A sphere is a capsule of length 0; other shapes are taken for the capsule that their sizes make.
        length = 0.0 if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_SPHERE.value else size[1]
        local[:, 2] -= np.clip(local[:, 2], -length, length)
        return np.maximum(np.linalg.norm(local, axis=1) - size[0], 0.0)

    @cached_property
    def distance(self) -> Array:
        """Horizontal distance of the object's origin from the pelvis, `(n,)`."""
        return np.linalg.norm(self.state.position[:, :2], axis=1).astype(np.float64)

    @cached_property
    def bearing(self) -> Array:
        """Direction of the object seen from the pelvis, radians, positive to the left, `(n,)`."""
        return np.arctan2(self.state.position[:, 1], self.state.position[:, 0]).astype(np.float64)

    @cached_property
    def speed(self) -> Array:
        """Speed of the object's origin over the last frames, m/s, `(n,)`."""
        path = self._positions[:, :, self._root]
        moved: Array = np.linalg.norm(path[:, -1] - path[:, -1 - _STEP], axis=1) * (FRAME_RATE / _STEP)
        return moved

    def contact(self, m: Measurements, bodies: tuple[str, ...], near_by: float) -> Array:
        """1 if one of the bodies touches it or nearly so: nearer than `near_by` metres now or 0.13 s ago, `(n,)`."""
        gaps = [
            self.gap(m.positions[:, frame, body_index(body)], frame) for body in bodies for frame in (-1, -1 - _STEP)
        ]
        return ramp(np.min(gaps, axis=0), near_by + 0.25, near_by)

    def foot_gap(self, m: Measurements) -> Array:
        """Distance of the nearest toes, sole or heel from its surface, now or 0.13 s ago, metres, `(n,)`."""
        gaps = []
        for foot in map(body_index, _FEET):
            for frame in (-1, -1 - _STEP):
                turned = Rotation.from_quat(m.quaternions[:, frame, foot], scalar_first=True)
                gaps += [self.gap(m.positions[:, frame, foot] + turned.apply(point), frame) for point in _SOLE]
        nearest: Array = np.min(gaps, axis=0)
        return nearest

    @cached_property
    def nearing(self) -> Array:
        """How fast the pelvis comes nearer to the object's origin, m/s, `(n,)`."""
        humanoid, item = self._positions[:, :, 1], self._positions[:, :, self._root]
        gaps = np.linalg.norm((humanoid - item)[:, (-1 - 2 * _STEP, -1), :2], axis=-1)
        closing: Array = (gaps[:, 0] - gaps[:, 1]) * (FRAME_RATE / (2 * _STEP))
        return closing

    @cached_property
    def set_in_motion(self) -> Array:
        """Whether it moves away or, with a joint, that joint opens, `(n,)`."""
        if not self.state.angle.shape[1]:
            return ramp(self.speed, 0.3, 1.5)
        return ramp(self.state.angle_velocity[:, 0].astype(np.float64), 0.2, 1.2)

    @cached_property
    def leaving(self) -> Array:
        """Speed at which the object itself moves away from the pelvis, m/s, `(n,)`."""
        away = self.state.position[:, :2] / np.maximum(self.distance, 1e-6)[:, None]
        return (self.state.linear_velocity[:, :2] * away).sum(1).astype(np.float64)

    @cached_property
    def aligned(self) -> Array:
        """Cosine of the directions that humanoid and object look in: 1 for who sits on a chair, `(n,)`."""
        return self.state.rotation[:, 0].astype(np.float64)


def _closeness(o: ObjectTrack) -> Array:
    """Rises all the way to 0.6 m, so that it can be climbed."""
    return ramp(o.distance, 2.6, 0.6)


def _approaching(m: Measurements, o: ObjectTrack) -> Array:
    """Grows with every step towards the object, more while the step is being made, and is full where it is reached."""
    near_by = ramp(o.distance, 3.0, 0.65)
    arrived = ramp(o.distance, 1.1, 0.65)
    moving = ramp(o.nearing, 0.1, 0.7)
    ahead = 0.75 + 0.25 * ramp(np.abs(o.bearing), 1.6, 0.6)
    return (0.65 * near_by**1.5 + 0.35 * np.maximum(moving, arrived)) * ahead * m.on_feet


def _on_the_way(m: Measurements, o: ObjectTrack) -> Array:
    """What rules about a touch give to one who has not touched yet, up to 0.3."""
    return 0.3 * _approaching(m, o)


def _in_front_of(m: Measurements, o: ObjectTrack) -> Array:
    if o.kind == "chair":  # who stands in front of a chair may have the back to it: what counts is the chair's front
        ahead = o.state.rotation[:, :2]
        towards = -o.state.position[:, :2] / np.maximum(o.distance, 1e-6)[:, None]
        return ramp((ahead * towards).sum(1).astype(np.float64), 0.3, 0.9) * _closeness(o) * m.on_feet
    return ramp(np.abs(o.bearing), 1.1, 0.5) * _closeness(o) * m.on_feet


def _beside(m: Measurements, o: ObjectTrack) -> Array:
    """Next to it on any side, best with it at the left or right."""
    aside = 0.6 + 0.4 * near(np.abs(o.bearing), np.pi / 2, 1.0)
    return aside * ramp(o.distance, 2.4, 0.8) ** 1.5 * m.on_feet


def _facing(m: Measurements, o: ObjectTrack) -> Array:
    ahead = m.axis("head", 0)
    gaze = np.arctan2(ahead[:, 1], ahead[:, 0])
    off = (gaze - o.bearing + np.pi) % (2 * np.pi) - np.pi
    return ramp(np.abs(off), 1.0, 0.25) * ramp(o.distance, 5.0, 2.5) * m.on_feet


def _touching(m: Measurements, o: ObjectTrack) -> Array:
    # An ankle is 0.1 m from the sole and 0.2 m from the toes; a hand's origin is 0.05 m from its surface.
    touched = o.contact(m, _FEET, 0.16) if o.kind == "ball" else o.contact(m, _HANDS, 0.08)
    return np.maximum(touched, _on_the_way(m, o))


def _limb_speed(m: Measurements, bodies: tuple[str, ...]) -> Array:
    fastest: Array = np.max([np.linalg.norm(m.velocity(body, _STEP), axis=1) for body in bodies], axis=0)
    return fastest


def _foot_raised(m: Measurements) -> Array:
    return ramp(np.max([m.height(foot) for foot in _FEET], axis=0), 0.1, 0.35)


def _kicking(m: Measurements, o: ObjectTrack) -> Array:
    moves = np.maximum(ramp(_limb_speed(m, _FEET), 0.5, 2.0), o.set_in_motion)
    if o.kind == "ball":
        kicked = o.contact(m, _FEET, 0.2) * (0.35 + 0.65 * moves)
        # It is being kicked for as long as it flies away from whoever looks after it.
        flies = ramp(o.leaving, 0.1, 0.9) * ramp(o.distance, 5.0, 2.0) * ramp(np.abs(o.bearing), 2.0, 1.0)
        kicked = np.maximum(kicked, 0.9 * flies)
    else:
        # Squared: kicks that miss it by a hand's breadth, one after the other, must not be worth as much as one that hits.
        kicked = ramp(o.foot_gap(m), 0.25, 0.03) ** 2 * (0.35 + 0.65 * partly(moves, _foot_raised(m)))
        # It moves, and nothing else has touched it.
        by_others = o.contact(m, (*_HANDS, "right_lower_arm", "left_lower_arm", "torso", "pelvis"), 0.12)
        kicked = np.maximum(kicked, 0.9 * o.set_in_motion * (1 - by_others) * ramp(o.distance, 2.5, 1.5))
    return np.maximum(kicked * m.on_feet, _on_the_way(m, o))


def _striking(m: Measurements, o: ObjectTrack) -> Array:
    struck = o.contact(m, _HANDS, 0.1) * (0.35 + 0.65 * ramp(_limb_speed(m, _HANDS), 0.4, 2.0)) * m.on_feet
    return np.maximum(struck, _on_the_way(m, o))


def _leaning_on(m: Measurements, o: ObjectTrack) -> Array:
    touched = o.contact(m, (*_HANDS, "right_lower_arm", "left_lower_arm", "torso"), 0.12)
    up = m.axis("torso", 2)
    tilt = np.hypot(up[:, 0], up[:, 1])
    return touched * ramp(tilt, 0.05, 0.3) * ramp(_limb_speed(m, _HANDS), 1.5, 0.4) * m.on_feet


def _pushing_open(m: Measurements, o: ObjectTrack) -> Array:
    if not o.state.angle.shape[1]:
        return np.zeros(len(m))
    angle = o.state.angle[:, 0].astype(np.float64)
    opening = ramp(o.state.angle_velocity[:, 0].astype(np.float64), 0.05, 0.8)
    touched = o.contact(m, (*_HANDS, *_FEET, "torso"), 0.15)
    opened = ramp(angle, 0.03, 0.8) * (0.3 + 0.4 * touched + 0.3 * opening) * m.on_feet
    return np.maximum(opened, (0.2 + 0.15 * touched) * _approaching(m, o))


def _sitting_on(m: Measurements, o: ObjectTrack) -> Array:
    """First the way to the chair, then the back to it, then above its seat, then down."""
    # The origin of the object is the middle of its seat. The origin of a pelvis that rests on it is 0.1 m above it.
    over = ramp(o.distance, 0.55, 0.15)
    low = ramp(-o.state.position[:, 2].astype(np.float64), 0.45, 0.1)
    knees = partly(*(ramp(m.knee(side), 0.2, 1.2) for side in SIDES))
    seated = partly(over, low) * over**0.5 * (0.5 + 0.5 * knees)
    turned = ramp(o.aligned, -0.2, 0.8)
    ready = _closeness(o) * (0.12 + 0.1 * turned + 0.13 * turned * over)
    # Sitting down begins before the seat: bent knees close to it count.
    lowering = 0.2 * turned * ramp(o.distance, 0.75, 0.4) * low
    return np.maximum(seated, ready + lowering) * m.on_feet


_RULES: dict[str, Callable[[Measurements, ObjectTrack], Array]] = {
    "approaching": _approaching,
    "in front of": _in_front_of,
    "beside": _beside,
    "facing": _facing,
    "touching": _touching,
    "kicking": _kicking,
    "striking": _striking,
    "leaning on": _leaning_on,
    "pushing open": _pushing_open,
    "sitting on": _sitting_on,
}


DOINGS = ("kicking", "striking", "pushing open", "sitting on")
"""What is done to an object; most of it is true for moments only."""


def attempts(m: Measurements, o: ObjectTrack) -> Array:
    """How much of a kick or a blow there is near an object, whether it hits or not, `(n,)`."""
    kick = partly(ramp(_limb_speed(m, _FEET), 0.5, 2.0), _foot_raised(m))
    blow = ramp(_limb_speed(m, _HANDS), 0.4, 2.0)
    return np.maximum(kick, blow) * ramp(o.distance, 2.2, 1.2) * m.on_feet


def _nowhere(m: Measurements) -> Array:
    """Nothing is true of an object that is not there."""
    return np.zeros(len(m))


_WAYS_TO_APPROACH = (
    "walk to the {0}",
    "go to the {0}",
    "approach the {0}",
    "walk towards the {0}",
    "walk up to the {0}",
    "move towards the {0}",
    "get close to the {0}",
    "come nearer to the {0}",
    "walk over to the {0}",
    "head for the {0}",
    "step up to the {0}",
    "reach the {0}",
    "arrive at the {0}",
    "run to the {0}",
    "a person walks to the {0}",
    "a person walks towards the {0}",
    "a person approaches the {0}",
    "the figure has arrived at the {0}",
    "someone makes their way to the {0}",
    "somebody comes up to the {0}",
    "the humanoid moves closer to the {0}",
    "on the way to the {0}",
    "go near the {0}",
    "go and stand by the {0}",
)
_OTHER_NOUNS = {"ball": ("football",), "chair": ("seat",), "pillar": ("column", "post")}
# Captions of "in front of" that tell of the way there belong to "approaching".
_OF_THE_WAY = re.compile(r"^(walk|go|run|approach|get|move)\b")


def relation_concepts(items: list[SceneObject]) -> list[Concept]:
    """One concept for each relation of each object that has captions, named "ball:kicking", and "ball:approaching"."""
    concepts = []
    for item in items:
        nouns = (item.name, *_OTHER_NOUNS.get(item.name, ()))
        # The first wordings of all ways name the object as its captions do.
        ways = [way.format(noun) for noun in nouns for way in _WAYS_TO_APPROACH]
        concepts.append(Concept(f"{item.name}:approaching", "object", tuple(ways), _nowhere))
        for relation, captions in item.captions.items():
            kept = [text for text in captions if relation != "in front of" or not _OF_THE_WAY.match(text)]
            concepts.append(Concept(f"{item.name}:{relation}", "object", tuple(dict.fromkeys(kept)), _nowhere))
    return concepts


def relation_truth(name: str, m: Measurements, tracks: dict[str, ObjectTrack]) -> Array | None:
    """How far a relation concept is true of n humanoids; None if it is about no object of this scene."""
    kind, _, relation = name.partition(":")
    if relation not in _RULES or kind not in tracks:
        return None
    return _RULES[relation](m, tracks[kind])
