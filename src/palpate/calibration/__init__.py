"""Recordings in, models of the sensors out: what a sensor carries, where it sits, how it reads."""

from __future__ import annotations

from palpate.calibration.clock import ClockOffset, identify_offset
from palpate.calibration.payload import Hypothesis, diagnose_payload, identify_payload

__all__ = [
    "ClockOffset",
    "Hypothesis",
    "diagnose_payload",
    "identify_offset",
    "identify_payload",
]
