"""Recordings and signals of any sensor: filters, noise, spectra, motion, drift, payloads, and wrenches of a sensor."""

from palpate.signals.filters import Butterworth, Kalman
from palpate.signals.imu import Imu
from palpate.signals.payload import Payload
from palpate.signals.recording import FORCE, ORIENTATION, TORQUE, Recording

__all__ = ["FORCE", "ORIENTATION", "TORQUE", "Butterworth", "Imu", "Kalman", "Payload", "Recording"]
