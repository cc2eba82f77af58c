"""A six-axis force/torque sensor that carries a payload."""

from typing import TYPE_CHECKING

from palpate.calls import later

if TYPE_CHECKING:
    from palpate.sensors.force_torque.compensation import Compensation
    from palpate.sensors.force_torque.model import ForceTorque
    from palpate.sensors.force_torque.poses import average_poses, average_rests

__all__ = ["Compensation", "ForceTorque", "average_poses", "average_rests"]

__getattr__ = later(
    __name__,
    {
        "compensation": "Compensation",
        "model": "ForceTorque",
        "poses": "average_poses average_rests",
    },
)
