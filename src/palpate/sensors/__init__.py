"""Models and readings of the sensors themselves, without any I/O."""

from __future__ import annotations

from palpate.sensors.compensation import Compensation
from palpate.sensors.filters import Butterworth, Kalman
from palpate.sensors.force_torque import ForceTorque, Payload
from palpate.sensors.recording import Recording

__all__ = ["Butterworth", "Compensation", "ForceTorque", "Kalman", "Payload", "Recording"]
