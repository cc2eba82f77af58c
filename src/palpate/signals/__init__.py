"""Recordings and signals of any sensor: filters, noise, spectra, motion, drift, payloads, and wrenches of a sensor."""

from palpate.signals.filters import Butterworth, Kalman
from palpate.signals.payload import Payload
from palpate.signals.recording import CELLS, FORCE, IMAGE, ORIENTATION, POSITION, TORQUE, VOLTAGE, Recording

__all__ = [
    "CELLS",
    "FORCE",
    "IMAGE",
    "ORIENTATION",
    "POSITION",
    "TORQUE",
    "VOLTAGE",
    "Butterworth",
    "Kalman",
    "Payload",
    "Recording",
]
