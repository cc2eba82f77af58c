"""Decode the status word of ATI's Ethernet sensors.

The bits are those of ATI's manuals 9620-05-NET FT (Net F/T) and 9610-05-Ethernet Axia (Axia).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from jaxtyping import Bool, Int

from palpate.spatial.arguments import frozen_value

_ERROR, _MONITOR = 1 << 31, 1 << 16
SATURATED = _ERROR | 1 << 17  # of a Net F/T

_BOX: Mapping[int, str] = {
    1: "HTTP failure",
    2: "internal temperature",
    3: "reference voltage or power supply",
    4: "no data from the transducer's board",
    5: "analog supply too low",
    6: "analog supply too high",
    7: "analog ground out of range",
    8: "too little excitation of the strain gages",
    9: "too much excitation of the strain gages",
    10: "watchdog of the analog board",
    11: "serial flash",
    12: "EEPROM",
    13: "stack",
    14: "watchdog",
    16: "a threshold of the device has tripped",
    17: "transducer saturated, or its A/D converter failed",
    18: "DeviceNet failure",
    19: "EtherNet/IP failure",
    20: "RDT failure",
    21: "CAN failure",
    22: "network failure",
    23: "the configuration does not fit the calibration",
    24: "settings",
    25: "halted by its configuration",
    26: "program memory",
    27: "serial link",
    28: "analog board",
    29: "digital board",
    30: "processor or memory",
}
_AXIA: Mapping[int, str] = {
    0: "temperature out of range",
    1: "supply voltage out of range",
    2: "broken strain gage",
    3: "busy: its settings are being changed",
    5: "another error",
    7: "calibration not accessible",
    16: "a threshold of the device has tripped",
    27: "strain gage out of range",
    28: "simulated error",
    29: "checksum of the calibration",
    30: "force or torque out of range",
}


@frozen_value(eq=True)
class StatusWord:
    """The meaning of a product's status word.

    Attributes:
        bits: number of a bit -> its meaning in words.
        harmless: mask of the bits that leave the values valid.
    """

    bits: Mapping[int, str]
    harmless: int

    def bad(self, status: Int[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
        """Return whether the values of each sample are invalid, (n,): a harmful bit is set, or bit 31 (error) alone.

        Raises:
            InputError: status has another shape.
        """
        return ((status & ~self.harmless) != 0) | (status == _ERROR)

    def read(self, status: int) -> str:
        """Return the meaning of a status, such as "watchdog, settings"; "no error" for 0."""
        said = [self.bits.get(bit, f"bit {bit}") for bit in range(31) if status >> bit & 1]
        return ", ".join(said) or ("an error without details" if status else "no error")


def status_word(product: str) -> StatusWord:
    """Return the `StatusWord` of a product by the name on its page: an Axia's, or else a Net F/T's."""
    if "axia" in product.lower():
        return StatusWord(_AXIA, _ERROR | _MONITOR)
    return StatusWord(_BOX, _ERROR | _MONITOR | 1 << 1 | 1 << 18 | 1 << 19 | 1 << 21)
