"""Read truth.csv, the known contacts: at instants, or as touches with a start and an end."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Float

from palpate.contact.ground_truth import TrueSamples, TrueTouches
from palpate.errors import InputError
from palpate.files.tables.table import TextTable, read_table
from palpate.files.units import near

__all__ = ["read_ground_truth", "read_touches"]

_POINT = ("px", "py", "pz")
_NORMAL = ("nx", "ny", "nz")
_FORCE = ("fx", "fy", "fz")


def read_ground_truth(path: Path) -> TrueSamples | TrueTouches:
    """Read a CSV file as `TrueSamples` or `TrueTouches`.

    The columns are `time,px,py,pz[,nx,ny,nz][,fx,fy,fz]` or, for touches, `start,end,px,py,pz[,label]`.

    Raises:
        InputError: the file is missing or has neither form, a touch ends before it starts, a row lacks its time or
            point, or a field is not a number.
    """
    table = read_table(path)
    if {"start", "end"} <= set(table.names):
        return _touches(table)
    if "time" not in table.names:
        what = "is not a ground truth: it needs a column 'time', or columns 'start' and 'end'."
        raise InputError(what, where=str(path), hint=near("time", table.names))
    columns = {name: table.numbers(names, strict=True)[0] for name, names in _wanted(table).items()}
    _require_finite(table, "an instant needs a point (px, py, pz): remove rows without one", columns["point"])
    time = table.numbers(["time"], strict=True)[0][:, 0].copy()
    _require_finite(table, "an instant needs a time", time[:, None])
    return TrueSamples(time, columns["point"], columns.get("normal"), columns.get("force"))


def read_touches(path: Path) -> TrueTouches:
    """Read known touches from a CSV file `start,end,px,py,pz[,label]` as `TrueTouches`.

    Raises:
        InputError: the file is missing or does not have this form, or a row lacks its start, end or point, or ends
            before it starts.
    """
    return _touches(read_table(path))


def _wanted(table: TextTable) -> dict[str, tuple[str, ...]]:
    known: dict[str, tuple[str, ...]] = {"point": _POINT, "normal": _NORMAL, "force": _FORCE}
    return {name: columns for name, columns in known.items() if name == "point" or set(columns) <= set(table.names)}


def _require_finite(table: TextTable, what: str, values: Float[np.ndarray, "n k"]) -> None:
    bad = np.flatnonzero(~np.isfinite(values).all(axis=1))
    if len(bad):
        table.refuse(int(bad[0]), what)


def _touches(table: TextTable) -> TrueTouches:
    bounds, _ = table.numbers(["start", "end"], strict=True)
    point, _ = table.numbers(_POINT, strict=True)
    wrong = np.flatnonzero(~(bounds[:, 0] <= bounds[:, 1]))  # NaN too
    if len(wrong):
        table.refuse(int(wrong[0]), "a touch must start before it ends")
    _require_finite(table, "a touch needs a point (px, py, pz)", point)
    labels = table.strings("label").to_list() if "label" in table.names else [None] * len(table)
    names = tuple(str(k + 1) if label is None else str(label) for k, label in enumerate(labels))
    return TrueTouches(bounds[:, 0].copy(), bounds[:, 1].copy(), point, names)
