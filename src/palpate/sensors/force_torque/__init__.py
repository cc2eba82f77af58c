"""A six-axis force/torque sensor that carries a payload."""

from palpate.sensors.force_torque.compensation import Compensation
from palpate.sensors.force_torque.model import ForceTorque
from palpate.sensors.force_torque.poses import average_poses, average_rests

__all__ = ["Compensation", "ForceTorque", "average_poses", "average_rests"]
