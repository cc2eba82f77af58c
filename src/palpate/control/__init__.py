"""Contacts become motion: admittance, alignment with what is touched, the limits and the states of a loop."""

from palpate.control.admittance import Admittance
from palpate.control.align import AlignController
from palpate.control.servo import Servo
from palpate.control.stability import DelayedRobot, Tracker, observer_radius, require_stable, stiffest
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
