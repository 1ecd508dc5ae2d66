"""A door in its frame, with and without a latch."""

from anyskill_envs.objects.base import Placement, SceneObject

# AnySkill's frame: posts of 0.1 m at 0.9 m from each other, lintel at 2 m. Its leaf weighs 1 kg, swings without limits and
# has no handle; this one weighs 12 kg as a light room door does, and opens away from the humanoid, up to 110 degrees. Its
# hinge is on the humanoid's left. The origin is on the floor in the middle of the doorway, the front (x) looks at the
# humanoid, so that the leaf turns about +z towards -x.
_FRAME = """
<mujoco>
  <default>
    <geom rgba="0.55 0.42 0.30 1"/>
    <default class="handle"><geom type="capsule" rgba="0.25 0.27 0.30 1"/></default>
  </default>
  <worldbody>
    <body name="frame">
      <geom name="left_post" type="box" size="0.05 0.05 1" pos="0 -0.45 1"/>
      <geom name="right_post" type="box" size="0.05 0.05 1" pos="0 0.45 1"/>
      <geom name="lintel" type="box" size="0.05 0.4 0.05" pos="0 0 1.95"/>
      {catch}
      <body name="leaf" pos="0 -0.4 0">
        <joint name="hinge" axis="0 0 1" range="0 110" damping="1" frictionloss="0.2" armature="0.05"/>
        <geom name="leaf" type="box" size="0.02 0.39 0.935" pos="0 0.395 0.95" mass="12" rgba="0.86 0.80 0.70 1"/>
        {handle}
      </body>
    </body>
  </worldbody>
</mujoco>
"""

_KNOB = '<geom name="handle" class="handle" size="0.012" fromto="0.06 0.6 1 0.06 0.72 1" mass="0.3"/>'

# The tail of the lever reaches into the post, before a catch. Who presses the lever down by some 25 degrees lifts the tail
# over the catch, and the leaf is free. The two touch nothing else (bit 2), the lever's handle is for hands. A leaf that falls
# shut stays ajar at the catch.
_LEVER = """
<body name="lever" pos="0 0.7 1">
  <joint name="latch" axis="1 0 0" range="0 45" damping="0.05" stiffness="2" springref="-10" armature="0.002"/>
  <geom name="handle" class="handle" size="0.012" fromto="0.06 0 0 0.06 -0.14 0" mass="0.2"/>
  <geom name="tail" class="handle" type="box" size="0.012 0.06 0.012" pos="0 0.06 0" mass="0.1" contype="2" conaffinity="2"
        friction="0.1 0.005 0.0001"/>
</body>
"""
_CATCH = """
<geom name="catch" type="box" size="0.02 0.02 0.03" pos="-0.035 0.42 1" contype="2" conaffinity="2"
      friction="0.1 0.005 0.0001"/>
"""

_CAPTIONS = {
    "in front of": ("a person stands in front of a door", "standing before a closed door", "walk to the door"),
    "beside": ("a person stands beside a door", "stand next to the door"),
    "facing": ("a person faces the door", "look at the door", "face the door"),
    "touching": ("a person touches the door with a hand", "touch the door", "put a hand on the door"),
    "kicking": ("kick the door", "a person kicks the door", "kick against the door"),
    "leaning on": ("a person leans on the door", "lean against the door", "lean on the door"),
    "pushing open": (
        "open the door",
        "a person pushes the door open",
        "opening a door",
        "push the door open",
        "push against the door until it opens",
        "go through the door",
    ),
}
_PLACEMENT = Placement(distance=(0.8, 1.2), bearing=(-0.15, 0.15), yaw=(-0.25, 0.25))
_TEXTS = ("open the door", "kick the door")

DOOR = SceneObject(
    name="door",
    mjcf=_FRAME.format(catch="", handle=_KNOB),
    placement=_PLACEMENT,
    radius=0.55,
    texts=_TEXTS,
    captions=_CAPTIONS,
)

LATCHED_DOOR = SceneObject(
    name="latched_door",
    kind="door",
    mjcf=_FRAME.format(catch=_CATCH, handle=_LEVER),
    placement=_PLACEMENT,
    radius=0.55,
    texts=_TEXTS,
    captions=_CAPTIONS,
)
