"""Read truth.csv, the known contacts: at instants, or as touches with a start and an end."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Float

from palpate.contact.ground_truth import TrueSamples, TrueTouches
from palpate.errors import InputError
from palpate.files.tables.table import TextTable, read_table
from palpate.files.units import near

_POINT = ("px", "py", "pz")
_BASE = "base_"
_OTHERS = {"normal": ("nx", "ny", "nz"), "force": ("fx", "fy", "fz")}


def read_ground_truth(path: Path, frame: str = "surface") -> TrueSamples | TrueTouches:
    """Return the known contacts of a CSV file.

    The columns are `time,px,py,pz[,nx,ny,nz][,fx,fy,fz]` or, for touches, `start,end,px,py,pz[,fx,fy,fz][,label]`; for
    a robot also `sensor`, the name of the sensor that is touched.

    Args:
        path: the file.
        frame: frame of the contacts. In "base", columns base_px, base_py, base_pz and so on are read if there are any.

    Raises:
        InputError: the file cannot be read or has neither form, a touch ends before it starts, a row lacks its time or
            point, or a field is not a number.
    """
    table = read_table(path)
    prefix = _BASE if frame == "base" and {_BASE + name for name in _POINT} <= set(table.names) else ""
    if {"start", "end"} <= set(table.names):
        return _touches(table, prefix)
    if "time" not in table.names:
        what = "is not a ground truth: it needs a column 'time', or columns 'start' and 'end'."
        raise InputError(what, where=str(path), hint=near("time", table.names))
    point, _ = table.numbers([prefix + name for name in _POINT], strict=True)
    others = {key: [prefix + name for name in names] for key, names in _OTHERS.items()}
    columns = {key: table.numbers(names, strict=True)[0] for key, names in others.items() if {*names} <= {*table.names}}
    _require_finite(table, "an instant needs a point (px, py, pz): remove rows without one", point)
    time = table.numbers(["time"], strict=True)[0][:, 0].copy()
    _require_finite(table, "an instant needs a time", time[:, None])
    return TrueSamples(time, point, **columns, sensor=_sensors(table))


def read_touches(path: Path) -> TrueTouches:
    """Return the known touches of a CSV file `start,end,px,py,pz[,label]`.

    Raises:
        InputError: the file cannot be read or does not have this form, a row lacks its start, end or point, a touch
            ends before it starts, or a field is not a number.
    """
    return _touches(read_table(path))


def _require_finite(table: TextTable, what: str, values: Float[np.ndarray, "n k"]) -> None:
    bad = np.flatnonzero(~np.isfinite(values).all(axis=1))
    if len(bad):
        table.refuse(int(bad[0]), what)


def _sensors(table: TextTable) -> tuple[str, ...]:
    """Return the name of the sensor of each row; () if there is no such column."""
    return tuple(map(str, table.strings("sensor").to_list())) if "sensor" in table.names else ()


def _touches(table: TextTable, prefix: str = "") -> TrueTouches:
    bounds, _ = table.numbers(["start", "end"], strict=True)
    point, _ = table.numbers([prefix + name for name in _POINT], strict=True)
    wrong = np.flatnonzero(~(bounds[:, 0] <= bounds[:, 1]))  # NaN too
    if len(wrong):
        table.refuse(int(wrong[0]), "a touch must start before it ends")
    _require_finite(table, "a touch needs a point (px, py, pz)", point)
    labels = table.strings("label").to_list() if "label" in table.names else [None] * len(table)
    names = tuple(str(k + 1) if label is None else str(label) for k, label in enumerate(labels))
    forces = [prefix + name for name in _OTHERS["force"]]
    force = table.numbers(forces, strict=True)[0] if {*forces} <= {*table.names} else None
    return TrueTouches(bounds[:, 0].copy(), bounds[:, 1].copy(), point, names, _sensors(table), force)
