"""Read and write maps of a taxel sheet: the model with its spline, and formats of other programs.

The suffix decides the format: .toml, .csv (a row for each cell), .txt (iCub's skin) or .urdf (a link with its cells).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError
from palpate.files.atomic import write_text
from palpate.files.models import read_model, write_model
from palpate.sensors.taxels.skin_map.model import SkinMap
from palpate.spatial.arguments import takes_arrays

__all__ = ["SUFFIXES", "fixed_frame", "read_skin_map", "write_skin_map"]

_COLUMNS = ("row", "column", "x", "y", "z", "nx", "ny", "nz", "area")


def write_skin_map(path: str | Path, skin: SkinMap, *, name: str = "skin") -> None:
    """Write a map in the format of its suffix.

    Args:
        path: .toml, .csv, .txt or .urdf.
        skin: the map.
        name: of the skin's part, in iCub's file and in the URDF.

    Raises:
        InputError: another suffix, or the file cannot be written.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(f"cannot write a map as {path.suffix!r}.", where=str(path), hint=f"Use {', '.join(SUFFIXES)}.")
    if suffix == ".toml":
        write_model(path, skin)
    else:
        write_text(path, _WRITERS[suffix](skin, name))


def read_skin_map(path: str | Path) -> SkinMap:
    """Read a `SkinMap` from .toml, the same to the last bit, or from .csv.

    Raises:
        InputError: the file is missing or not a map, a key misspelt or missing, a value of the wrong kind.
    """
    path = Path(path)
    if path.suffix.lower() == ".csv":
        return _read_csv(path)
    return read_model(path, SkinMap)


def _read_csv(path: Path) -> SkinMap:
    """Read `row,column,x,y,z,nx,ny,nz,area`, SI, in the mesh's frame.

    Raises:
        InputError: a column or a cell is missing, there twice or without a number, or a normal is not of length 1.
    """
    from palpate.files.tables.table import read_table  # here: it loads polars

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
        raise InputError(
            f"has {len(number)} rows, but needs one for each of {rows} x {columns} cells.", where=str(path)
        )
    long = np.abs(np.linalg.norm(values[:, 5:8], axis=1) - 1.0) > 0.01
    if long.any():
        table.refuse(int(np.argmax(long)), "a normal must be of length 1")
    cells = values[np.argsort(number)].reshape(rows, columns, -1)
    return SkinMap(cells[..., 2:5], cells[..., 5:8], cells[..., 8], _pitch(cells[..., 2:5]))


def _pitch(centres: np.ndarray) -> tuple[float, float]:
    """Return the pitch between rows and between columns [m], as the medians of the distances."""
    steps = [np.linalg.norm(np.diff(centres, axis=axis), axis=-1) for axis in (0, 1)]
    known = [float(np.median(step)) for step in steps if step.size]
    along, across = (float(np.median(step)) if step.size else known[0] for step in steps)
    return along, across


def _csv(skin: SkinMap, name: str) -> str:
    lines = [",".join(_COLUMNS)]
    for (row, column), point, normal in _cells(skin):
        numbers = (*point, *normal, skin.areas[row, column])
        lines.append(f"{row},{column}," + ",".join(repr(float(number)) for number in numbers))
    return "\n".join([*lines, ""])


def _icub(skin: SkinMap, name: str) -> str:
    """Return the positions file of iCub's skinManager: one taxel a row, position [m] and normal."""
    count = skin.rows * skin.columns
    head = [f"name {name}", "spatial_sampling taxel", f"taxel2Repr ({' '.join(map(str, range(count)))})"]
    rows = [" ".join(f"{number:.6f}" for number in (*point, *normal)) for _, point, normal in _cells(skin)]
    return "\n".join([*head, "", "[calibration]", *rows, ""])


def _urdf(skin: SkinMap, name: str) -> str:
    """Return a fixed frame for every cell, z along its normal and x along columns, below a link to name."""
    lines = [f"<!-- Cells of {name}: put these into the robot and name the link that carries them. -->"]
    along = (
        np.gradient(skin.centres, axis=1)
        if skin.columns > 1
        else np.broadcast_to([1.0, 0.0, 0.0], (*skin.areas.shape, 3))
    )
    for (row, column), point, normal in _cells(skin):
        lines += fixed_frame(f"{name}_{row}_{column}", point, normal, along[row, column])
    return "\n".join([*lines, ""])


@takes_arrays
def fixed_frame(
    name: str, point: Float[np.ndarray, "3"], normal: Float[np.ndarray, "3"], along: Float[np.ndarray, "3"]
) -> list[str]:
    """Return a list of URDF lines: a bodiless link fixed to LINK at a point [m], z along a normal, x near `along`."""
    place = " ".join(f"{number:.9g}" for number in point)
    angles = " ".join(f"{number:.9g}" for number in _roll_pitch_yaw(normal, along))
    return [
        f'<link name="{name}"/>',
        f'<joint name="{name}_joint" type="fixed">',
        f'  <parent link="LINK"/><child link="{name}"/>',
        f'  <origin xyz="{place}" rpy="{angles}"/>',
        "</joint>",
    ]


def _roll_pitch_yaw(normal: Float[np.ndarray, "3"], along: Float[np.ndarray, "3"]) -> tuple[float, float, float]:
    """Return URDF's angles [rad] of the frame with z along a normal and x as close as possible to a direction."""
    x = along - normal * (along @ normal)
    if not np.linalg.norm(x) > 0:
        x = np.eye(3)[np.argmin(np.abs(normal))] - normal * normal[np.argmin(np.abs(normal))]
    x = x / np.linalg.norm(x)
    y = np.cross(normal, x)
    pitch = float(np.arctan2(-x[2], np.hypot(x[0], x[1])))
    return float(np.arctan2(y[2], normal[2])), pitch, float(np.arctan2(x[1], x[0]))


def _cells(skin: SkinMap) -> Iterator[tuple[tuple[int, int], np.ndarray, np.ndarray]]:
    for row in range(skin.rows):
        for column in range(skin.columns):
            yield (row, column), skin.centres[row, column], skin.normals[row, column]


_WRITERS: Mapping[str, Callable[[SkinMap, str], str]] = {".csv": _csv, ".txt": _icub, ".urdf": _urdf}
SUFFIXES = (".toml", *_WRITERS)
