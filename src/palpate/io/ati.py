"""Calibration files of ATI sensors (XML, .cal), and the load cases of their certificates."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError
from palpate.io.units import FORCE_UNITS, TORQUE_UNITS, to_si
from palpate.sensors.gauges import Gauges, certified_noise

__all__ = ["read_ati", "read_certificate"]

AXES = ("Fx", "Fy", "Fz", "Tx", "Ty", "Tz")
LARGEST = 1 << 20  # bytes: such a file has some thousand
CASES = ("eFx_pctFS", "eFy", "eFz", "eTx", "eTy", "eTz")


def read_ati(path: Path) -> Gauges:
    """A sensor by the `UserAxis` rows of its file, which are the ones for use; units into SI.

    Raises:
        InputError: not such a file, an axis or a number is missing, a unit is not known.
    """
    root = _root(path)
    calibration = root.find("Calibration")
    if root.tag != "FTSensor" or calibration is None:
        raise InputError("is no calibration of ATI (FTSensor with a Calibration).", where=str(path))
    units = {
        "F": to_si(calibration.get("ForceUnits", "N"), FORCE_UNITS, where=f"{path}: ForceUnits"),
        "T": to_si(calibration.get("TorqueUnits", "N m"), TORQUE_UNITS, where=f"{path}: TorqueUnits"),
    }
    found = {axis.get("Name"): axis for axis in calibration.findall("UserAxis")}
    missing = [name for name in AXES if name not in found]
    if missing:
        raise InputError(f"has no UserAxis {missing[0]}.", where=str(path))
    rows = [_numbers(found[name].get("values", ""), 6, path, f"UserAxis {name}") for name in AXES]
    limits = [_numbers(found[name].get("max", ""), 1, path, f"max of UserAxis {name}")[0] for name in AXES]
    scale = np.array([units[name[0]] for name in AXES])
    reach = calibration.get("OutputRange")
    volts = np.inf if reach is None else _numbers(reach, 1, path, "OutputRange")[0]
    if calibration.get("OutputBipolar", "True") == "True":
        volts /= 2.0  # the whole span is stated
    return Gauges(np.array(rows) * scale[:, None], np.array(limits) * scale, volts, root.get("Serial", ""))


def read_certificate(path: Path, sensor: Gauges) -> Float[np.ndarray, "6 6"]:
    """Noise model [N, N m] of a sensor, from CSV of load cases with errors in percent of full scale.

    Raises:
        InputError: a column is missing, or holds no numbers.
    """
    import polars as pl

    try:
        table = pl.read_csv(path)
        errors = table.select(CASES).cast(pl.Float64).to_numpy() / 100.0
    except (OSError, pl.exceptions.PolarsError) as problem:
        raise InputError(
            f"cannot be read as load cases ({str(problem).splitlines()[0]}).",
            where=str(path),
            mend=f"It needs columns {', '.join(CASES)}.",
        ) from problem
    return certified_noise(errors, sensor.limits)


def _root(path: Path) -> ElementTree.Element:
    try:
        if path.stat().st_size > LARGEST:
            raise InputError("is too long for a calibration file.", where=str(path))
        text = path.read_bytes()
        if b"<!ENTITY" in text:  # entities grow without end, and a calibration has none
            raise InputError("defines entities, which no calibration file needs.", where=str(path))
        return ElementTree.fromstring(text)
    except OSError as problem:
        raise InputError(f"cannot be read ({problem}).", where=str(path)) from problem
    except (ElementTree.ParseError, ValueError) as problem:
        raise InputError(f"is not XML ({problem}).", where=str(path)) from problem


def _numbers(text: str, count: int, path: Path, what: str) -> list[float]:
    try:
        values = [float(part) for part in text.split()]
    except ValueError:
        values = []
    if len(values) != count or not np.isfinite(values).all():
        raise InputError(f"{what} must hold {count} numbers, not {text.strip()!r}.", where=str(path))
    return values
