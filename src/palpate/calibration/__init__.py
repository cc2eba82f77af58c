"""Calibrate what sensors share, and check every calibration on data that its fit did not use."""

from palpate.calibration.clock import ClockOffset, identify_offset
from palpate.calibration.mounting import Mounting, identify_mounting
from palpate.calibration.validation import Validation

__all__ = ["ClockOffset", "Mounting", "Validation", "identify_mounting", "identify_offset"]
