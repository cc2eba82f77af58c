"""Turn contacts into motion: admittance, alignment with a touched surface, limits and states of a control loop."""

from palpate.control.align import AlignController
from palpate.control.servo import Servo
from palpate.control.stability import Admittance, DelayedRobot, Tracker, observer_radius, require_stable, stiffest
from palpate.control.supervisor import Limits

__all__ = [
    "Admittance",
    "AlignController",
    "DelayedRobot",
    "Limits",
    "Servo",
    "Tracker",
    "observer_radius",
    "require_stable",
    "stiffest",
]
