"""Motion clips, readers, retargeting and the skeleton of the humanoid."""

from motion_data.clip import MotionClip

__all__ = ["MotionClip"]
