"""Calibrate what sensors share, and check every calibration on data that its fit did not use."""

from typing import TYPE_CHECKING

from palpate.calls import later

if TYPE_CHECKING:
    from palpate.calibration.clock import ClockOffset, identify_offset
    from palpate.calibration.mounting import Mounting, identify_mounting
    from palpate.calibration.validation import Validation

__all__ = ["ClockOffset", "Mounting", "Validation", "identify_mounting", "identify_offset"]

__getattr__ = later(
    __name__,
    {
        "clock": "ClockOffset identify_offset",
        "mounting": "Mounting identify_mounting",
        "validation": "Validation",
    },
)
