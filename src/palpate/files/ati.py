"""Read the calibration file (.cal) that ATI ships with a force/torque sensor: an XML of units, ranges and a matrix."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError
from palpate.files.inputs import read_xml
from palpate.files.units import FORCE_UNITS, TORQUE_UNITS, positive, to_si
from palpate.spatial.arguments import frozen_value

_AXES = ("Fx", "Fy", "Fz", "Tx", "Ty", "Tz")
_ROOT = "FTSensor"


@frozen_value(eq=True)
class AtiCalibration:
    """The calibration of a sensor by its maker.

    Attributes:
        serial, model, part: such as FT44297, Nano17 and SI-25-0.25; "" if not stated.
        date: day of the calibration as it is written, month first; "" if not stated.
        units: units of force and torque that the matrix makes of gauge voltages, as they are written.
        ranges: (6,) [N, N m] rated range of each axis, force first.
    """

    serial: str
    model: str
    part: str
    date: str
    units: tuple[str, str]
    ranges: Float[np.ndarray, "6"]

    @classmethod
    def of(cls, path: Path) -> AtiCalibration:
        """Read a file as an `AtiCalibration`.

        Raises:
            InputError: the file cannot be read, is not a calibration of ATI, or its units or ranges are not valid.
        """
        root = read_xml(path, "a calibration of ATI")
        found = root.find("Calibration")
        if root.tag != _ROOT or found is None:
            raise InputError(f"is not a calibration of ATI: it has no {_ROOT}/Calibration.", where=str(path))
        units = found.get("ForceUnits", ""), found.get("TorqueUnits", "")
        force, torque = (
            to_si(unit, table, where=str(path)) for unit, table in zip(units, (FORCE_UNITS, TORQUE_UNITS), strict=True)
        )
        rated = {axis.get("Name"): axis.get("max", "") for axis in found.iterfind("UserAxis")}
        ranges = np.array([_positive(rated.get(name, ""), name, path) for name in _AXES])
        names = root.get("Serial", ""), root.get("BodyStyle", ""), found.get("PartNumber", ""), found.get("CalDate", "")
        return cls(*names, units, ranges * np.repeat([force, torque], 3))


def _positive(text: str, name: str, path: Path) -> float:
    value = positive(text)
    if not value:
        raise InputError(f"the range (max) of UserAxis {name} is {text!r}, not a positive number.", where=str(path))
    return value
