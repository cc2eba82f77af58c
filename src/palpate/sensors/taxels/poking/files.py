"""Read pokes from a table that has one row for each poke."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError
from palpate.files.logs.layout import ORIENTATION_COLUMNS, POSITION_COLUMNS, WRENCH_COLUMNS
from palpate.files.tables.stated import Stated
from palpate.files.tables.table import TextTable, read_table
from palpate.files.units import FORCE_UNITS, TORQUE_UNITS, split_unit, to_si
from palpate.sensors.taxels.poking.pokes import Pokes
from palpate.spatial.arguments import takes_arrays
from palpate.spatial.pose import rotation_from_quaternion
from palpate.surfaces.mesh import UNITS

__all__ = ["holds_pokes", "read_pokes"]

_NOISE = np.diag([1e-2, 1e-2, 1e-2, 1e-3, 1e-3, 1e-3]) ** 2  # N, N m: of a mean, where nothing says it
_TAXEL = re.compile(r"(?:t|taxel_?)(\d+)", re.IGNORECASE)


def holds_pokes(names: Sequence[str]) -> bool:
    """Return whether a table with these columns contains pokes: it numbers them, and has a wrench and answers."""
    bare = {split_unit(name)[0].strip().lower() for name in names}
    return bool(bare & {"configuration", "poke"}) and bare >= {*WRENCH_COLUMNS} and any(map(_TAXEL.fullmatch, names))


@takes_arrays
def read_pokes(path: str | Path, *, threshold: float = 0.0, noise: Float[np.ndarray, "6 6"] | None = None) -> Pokes:
    """Read `Pokes` from `configuration,fx,fy,fz,tx,ty,tz,qx,qy,qz,qw,x,y,z,t0,t1,...[,weight][,time]`.

    Wrenches [N, N m] are on the body in the sensor's frame, minus its untouched reading; poses [m] are the link's in
    that frame; answers are above the baseline, in any unit. Columns may state other units, as `fx [mN]`, `x [mm]`.

    Args:
        path: of the table.
        threshold: responses up to it are no answers.
        noise: (6, 6) covariance of a wrench; None: 10 mN and 1 mN m (standard deviations).

    Raises:
        InputError: the file cannot be read, a column is missing, a unit is unknown, a cell is not a number, or a
            quaternion is not of length 1.
    """
    path = Path(path)
    table = read_table(path)
    names = {split_unit(name)[0].strip().lower(): name for name in reversed(table.names)}
    numbered = {int(match[1]): name for name in table.names if (match := _TAXEL.fullmatch(name))}
    if sorted(numbered) != list(range(len(numbered))) or not numbered:
        raise InputError("answers must be columns t0, t1, ... without a gap.", where=str(path))
    scales = _scales(table, names)
    wanted = (*WRENCH_COLUMNS, *ORIENTATION_COLUMNS, *POSITION_COLUMNS)
    for name in wanted:
        if name not in names:
            raise InputError(f"column {name!r} is missing.", where=str(path), hint=f"Give {', '.join(wanted)}.")
    values = table.numbers([names[name] for name in wanted], strict=True)[0] * scales
    unknown = ~np.isfinite(values).all(axis=1)
    if unknown.any():
        table.refuse(int(np.argmax(unknown)), "every poke needs a wrench and a pose")
    long = np.abs(np.linalg.norm(values[:, 6:10], axis=1) - 1.0) > 0.01
    if long.any():
        table.refuse(int(np.argmax(long)), "qx, qy, qz, qw must have length 1")
    configuration = np.zeros(len(values), dtype=np.int64)
    if "configuration" in names:
        stated = table.numbers([names["configuration"]], strict=True)[0][:, 0]
        configuration = np.unique(stated, return_inverse=True)[1]
    responses = np.nan_to_num(table.numbers([numbered[k] for k in range(len(numbered))])[0])
    weight, time = (table.numbers([names[name]])[0][:, 0] if name in names else None for name in ("weight", "time"))
    return Pokes.from_table(
        values[:, :6],
        rotation_from_quaternion(values[:, 6:10] / np.linalg.norm(values[:, 6:10], axis=1, keepdims=True)),
        values[:, 10:],
        configuration,
        responses,
        noise=_NOISE if noise is None else noise,
        threshold=threshold,
        weight=None if weight is None else np.nan_to_num(weight),
        time=time,
    )


def _scales(table: TextTable, names: dict[str, str]) -> Float[np.ndarray, "13"]:
    """Return the factors (13,) from the units of wrench, quaternion and position to SI."""
    stated, where = Stated.of_dialect(table.dialect).units, str(table.path)

    def scale(name: str, units: dict[str, float], usual: str) -> float:
        return to_si(stated.get(names.get(name, ""), "") or usual, units, where=where)

    force = [scale(name, dict(FORCE_UNITS), "N") for name in WRENCH_COLUMNS[:3]]
    torque = [scale(name, dict(TORQUE_UNITS), "N m") for name in WRENCH_COLUMNS[3:]]
    return np.array([*force, *torque, 1, 1, 1, 1, *(scale(name, dict(UNITS), "m") for name in POSITION_COLUMNS)])
