"""A football."""

from anyskill_envs.objects.base import Placement, SceneObject

# Size and mass of a football of size 5. At 120 Hz a leather ball's contact (10 ms) cannot be resolved: this one is softer
# (contact 40 ms), and tuned to what FIFA asks of a ball on turf (Quality Programme for Football Turf): dropped from 2 m it
# bounces to 0.6-1 m, and rolled at about 3 m/s it comes to rest after 4-10 m.
_MJCF = """
<mujoco>
  <asset>
    <texture name="patches" type="cube" builtin="checker" rgb1="0.97 0.97 0.97" rgb2="0.15 0.16 0.2" width="96" height="96"/>
    <material name="patches" texture="patches" texrepeat="2 2"/>
  </asset>
  <worldbody>
    <body name="ball" pos="0 0 0.11">
      <freejoint/>
      <geom name="ball" type="sphere" size="0.11" mass="0.43" material="patches" priority="1" condim="6"
            friction="0.7 0.005 0.007" solref="-6000 -25" solimp="0.95 0.99 0.001"/>
    </body>
  </worldbody>
</mujoco>
"""

BALL = SceneObject(
    name="ball",
    mjcf=_MJCF,
    placement=Placement(distance=(1.0, 2.0), bearing=(-0.8, 0.8), yaw=(-3.14, 3.14)),
    radius=0.15,
    texts=("kick the ball", "walk to the ball"),
    captions={
        "in front of": (
            "a person stands in front of a ball",
            "the ball lies before the feet",
            "stand in front of the ball",
            "walk to the ball",
            "go to the ball",
        ),
        "beside": ("a person stands beside a ball", "the ball lies next to the foot", "stand next to the ball"),
        "facing": ("a person looks at the ball", "facing the ball", "look at the ball", "face the ball"),
        "touching": ("a foot rests at the ball", "a person touches the ball", "touch the ball with a foot"),
        "kicking": (
            "kick the ball",
            "a person kicks the ball",
            "the foot strikes the ball",
            "shoot the ball",
            "kick the ball away",
            "hit the ball with the foot",
        ),
    },
)
