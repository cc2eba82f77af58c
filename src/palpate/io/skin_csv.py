"""map.csv: one row a cell, as `palpate map skin -o map.csv` writes it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from palpate.errors import InputError
from palpate.io.tables.table import read_table
from palpate.sensors.skin_map import SkinMap

__all__ = ["read_map_csv"]

_COLUMNS = ("row", "column", "x", "y", "z", "nx", "ny", "nz", "area")


def read_map_csv(path: Path) -> SkinMap:
    """Read `row,column,x,y,z,nx,ny,nz,area`, SI, in the mesh's frame.

    Raises:
        InputError: a column or a cell is missing, there twice or without a number, or a normal is not of length 1.
    """
    table = read_table(path)
    values, _ = table.numbers(_COLUMNS, strict=True)
    if not np.isfinite(values).all():
        table.refuse(int(np.argmin(np.isfinite(values).all(axis=1))), "every cell needs all of its numbers")
    place = values[:, :2].astype(np.int64)
    if (place != values[:, :2]).any() or (place < 0).any():
        raise InputError("row and column must be whole numbers from 0.", where=str(path))
    rows, columns = (int(last) + 1 for last in place.max(axis=0))
    number = place[:, 0] * columns + place[:, 1]
    if rows * columns != len(number) or len(np.unique(number)) != len(number):
        raise InputError(f"has {len(number)} rows, not one for each of {rows} x {columns} cells.", where=str(path))
    long = np.abs(np.linalg.norm(values[:, 5:8], axis=1) - 1.0) > 0.01
    if long.any():
        table.refuse(int(np.argmax(long)), "a normal must be of length 1")
    cells = values[np.argsort(number)].reshape(rows, columns, -1)
    return SkinMap(cells[..., 2:5], cells[..., 5:8], cells[..., 8], _pitch(cells[..., 2:5]))


def _pitch(centres: np.ndarray) -> tuple[float, float]:
    """Between rows and between columns [m], as the middle of their distances."""
    steps = [np.linalg.norm(np.diff(centres, axis=axis), axis=-1) for axis in (0, 1)]
    known = [float(np.median(step)) for step in steps if step.size]
    along, across = (float(np.median(step)) if step.size else known[0] for step in steps)
    return along, across
