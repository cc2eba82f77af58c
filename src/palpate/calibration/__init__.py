"""Recordings in, models of the sensors out: what a sensor carries, where it sits, how it reads."""

from __future__ import annotations

from palpate.calibration.clock import ClockOffset, identify_offset
from palpate.calibration.payload import Hypothesis, diagnose_payload, identify_payload
from palpate.calibration.payload_mounting import MountedPayload, identify_payload_and_mounting

__all__ = [
    "ClockOffset",
    "Hypothesis",
    "MountedPayload",
    "diagnose_payload",
    "identify_offset",
    "identify_payload",
    "identify_payload_and_mounting",
]
