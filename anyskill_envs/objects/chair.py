"""A chair for the humanoid's size."""

from anyskill_envs.objects.base import Placement, SceneObject

# The seat is a little lower than the humanoid's knee (0.485 m). AnySkill's chair is 0.46 x 0.71 x 1.05 m and weighs 9.2 kg.
# The origin is the middle of the seat's surface. Legs are capsules: each stands on one contact.
_MJCF = """
<mujoco>
  <default>
    <geom rgba="0.93 0.93 0.90 1"/>
    <default class="leg"><geom type="capsule" size="0.02" mass="0.6" rgba="0.55 0.42 0.30 1"/></default>
  </default>
  <worldbody>
    <body name="chair" pos="0 0 0.45">
      <freejoint/>
      <geom name="seat" type="box" size="0.22 0.22 0.02" pos="0 0 -0.02" mass="4"/>
      <geom name="back" type="box" size="0.015 0.2 0.19" pos="-0.215 0 0.36" mass="2"/>
      <geom name="left_post" class="leg" fromto="-0.215 0.17 0 -0.215 0.17 0.2" mass="0.2"/>
      <geom name="right_post" class="leg" fromto="-0.215 -0.17 0 -0.215 -0.17 0.2" mass="0.2"/>
      <geom name="front_left_leg" class="leg" fromto="0.2 0.2 -0.05 0.2 0.2 -0.43"/>
      <geom name="front_right_leg" class="leg" fromto="0.2 -0.2 -0.05 0.2 -0.2 -0.43"/>
      <geom name="back_left_leg" class="leg" fromto="-0.2 0.2 -0.05 -0.2 0.2 -0.43"/>
      <geom name="back_right_leg" class="leg" fromto="-0.2 -0.2 -0.05 -0.2 -0.2 -0.43"/>
    </body>
  </worldbody>
</mujoco>
"""

CHAIR = SceneObject(
    name="chair",
    mjcf=_MJCF,
    # Behind the humanoid, who has its back to it, as when one sits down. In AnySkill it stands ahead, to the left:
    # placement={"chair": {"distance": 0.63, "bearing": 0.785}}.
    placement=Placement(distance=(0.45, 0.6), bearing=(3.0, 3.28), yaw=(-0.15, 0.15)),
    radius=0.35,
    texts=("sit on the chair", "kick the chair", "walk around the chair"),
    captions={
        "in front of": ("a person stands in front of a chair", "a chair stands behind a person"),
        "beside": ("a person stands beside a chair", "stand next to the chair"),
        "facing": ("a person faces the chair", "look at the chair", "face the chair"),
        "touching": ("a person touches the chair with a hand", "touch the chair", "put a hand on the chair"),
        "kicking": ("kick the chair", "a person kicks the chair", "kick over the chair"),
        "leaning on": ("a person leans on the back of the chair", "lean on the chair"),
        "sitting on": (
            "sit on the chair",
            "a person sits on a chair",
            "sitting down on a chair",
            "sit down on the chair",
            "be seated on a chair",
            "take a seat on the chair",
        ),
    },
)
