"""A pillar that can be pushed over."""

from anyskill_envs.objects.base import Placement, SceneObject

# AnySkill's: a box of 0.4 x 0.4 x 1.8 m, light (density 50), on a free base. The stripe marks its front.
_MJCF = """
<body name="pillar" pos="0 0 0.9">
  <freejoint/>
  <geom name="pillar" type="box" size="0.2 0.2 0.9" mass="14.4" rgba="0.80 0.74 0.62 1"/>
  <geom name="stripe" type="box" size="0.005 0.06 0.8" pos="0.2 0 0" rgba="0.62 0.30 0.26 1" contype="0" conaffinity="0"
        mass="0"/>
</body>
"""

PILLAR = SceneObject(
    name="pillar",
    mjcf=_MJCF,
    placement=Placement(distance=(0.9, 1.5), bearing=(-0.3, 0.3), yaw=(-0.4, 0.4)),
    radius=0.3,
    texts=("strike the pillar", "walk to the pillar"),
    captions={
        "in front of": ("a person stands in front of a pillar", "stand in front of the pillar", "walk to the pillar"),
        "beside": ("a person stands beside a pillar", "stand next to the pillar"),
        "facing": ("a person faces the pillar", "look at the pillar", "face the pillar"),
        "touching": ("a person touches the pillar with a hand", "touch the pillar", "put a hand on the pillar"),
        "striking": (
            "strike the pillar",
            "a person strikes the pillar",
            "punch the pillar",
            "hit the pillar with the fist",
        ),
        "kicking": ("kick the pillar", "a person kicks the pillar", "kick against the pillar"),
        "leaning on": ("a person leans on the pillar", "lean against the pillar", "lean on the pillar"),
    },
)
