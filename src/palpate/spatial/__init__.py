"""Poses of frames, wrenches, and their uncertainty."""

from palpate.spatial.pose import Pose, rotation_from_quaternion
from palpate.spatial.wrench import Wrench

__all__ = ["Pose", "Wrench", "rotation_from_quaternion"]
