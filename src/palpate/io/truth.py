"""truth.csv, in its two forms: instants, or touches with a start and an end."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from palpate.contact.truth import Samples, Touches
from palpate.errors import InputError
from palpate.io.table import Table, read_table
from palpate.io.units import near

__all__ = ["read_touches", "read_truth"]

_POINT = ("px", "py", "pz")
_NORMAL = ("nx", "ny", "nz")
_FORCE = ("fx", "fy", "fz")


def read_truth(path: Path) -> Samples | Touches:
    """Read `time,px,py,pz[,nx,ny,nz][,fx,fy,fz]` or `start,end,px,py,pz[,label]`.

    Raises:
        InputError: neither of the two forms.
    """
    table = read_table(path)
    if {"start", "end"} <= set(table.names):
        return _touches(table)
    if "time" not in table.names:
        raise InputError(
            "is no truth: there is no column 'time', nor 'start' and 'end'.",
            where=str(path),
            mend=near("time", table.names),
        )
    columns = {name: table.numbers(names)[0] for name, names in _wanted(table).items()}
    time = table.numbers(["time"])[0][:, 0].copy()
    return Samples(time, columns["point"], columns.get("normal"), columns.get("force"))


def read_touches(path: Path) -> Touches:
    """Read the second form only, `start,end,px,py,pz[,label]`.

    Raises:
        InputError: it is not of that form.
    """
    return _touches(read_table(path))


def _wanted(table: Table) -> dict[str, tuple[str, ...]]:
    known: dict[str, tuple[str, ...]] = {"point": _POINT, "normal": _NORMAL, "force": _FORCE}
    return {name: columns for name, columns in known.items() if name == "point" or set(columns) <= set(table.names)}


def _touches(table: Table) -> Touches:
    bounds, _ = table.numbers(["start", "end"])
    point, _ = table.numbers(_POINT)
    wrong = ~(bounds[:, 0] <= bounds[:, 1])  # NaN too
    if wrong.any():
        line = table.lines[int(np.flatnonzero(wrong)[0])]
        raise InputError("a touch must start before it ends.", where=f"{table.path}, line {line}")
    labels = table.strings("label").to_list() if "label" in table.names else [None] * len(table)
    names = tuple(str(k + 1) if label is None else str(label) for k, label in enumerate(labels))
    return Touches(bounds[:, 0].copy(), bounds[:, 1].copy(), point, names)
