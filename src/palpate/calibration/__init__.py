"""Calibrate what sensors share, and judge every calibration on data that its fit left out."""

from palpate.calibration.clock import ClockOffset, identify_offset
from palpate.calibration.left_out import LeftOut
from palpate.calibration.mounting import Mounting, identify_mounting

__all__ = ["ClockOffset", "LeftOut", "Mounting", "identify_mounting", "identify_offset"]
