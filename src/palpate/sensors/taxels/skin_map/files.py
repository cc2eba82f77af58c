"""Read and write maps of a taxel sheet: .toml (the model), .csv (a row for each cell), .txt (iCub) or .urdf."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError
from palpate.files.atomic import write_text
from palpate.files.models import read_model, write_model
from palpate.sensors.taxels.skin_map.model import SkinMap
from palpate.spatial.arguments import takes_arrays

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
    require_suffix(path)
    if path.suffix.lower() == ".toml":
        write_model(path, skin)
    else:
        write_text(path, _WRITERS[path.suffix.lower()](skin, name))


def require_suffix(path: Path) -> None:
    """Check that a path has a suffix with which a map can be written: .toml, .csv, .txt or .urdf.

    Raises:
        InputError: it is none of those.
    """
    if path.suffix.lower() not in (".toml", *_WRITERS):
        hint = f"Use .toml, {', '.join(_WRITERS)}."
        raise InputError(f"cannot write a map as {path.suffix!r}.", where=str(path), hint=hint)


def read_skin_map(path: str | Path) -> SkinMap:
    """Read a `SkinMap` from .toml, the same to the last bit, or from .csv, without a surface.

    Raises:
        InputError: the file cannot be read or is not a map; a key, column or cell is missing, unknown or there twice; a
            value is of the wrong kind; or a normal is not of length 1.
    """
    path = Path(path)
    if path.suffix.lower() == ".csv":
        return _read_csv(path)
    return read_model(path, SkinMap)


def _read_csv(path: Path) -> SkinMap:
    from palpate.files.tables.table import read_table  # here: it loads polars

    table = read_table(path)
    values, _ = table.numbers(_COLUMNS, strict=True)
    known = (np.abs(values) < 1e9).all(axis=1)
    if not known.all():
        table.refuse(int(np.argmin(known)), "every cell needs all of its numbers, below 1e9")
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
    return SkinMap(cells[..., 2:5], cells[..., 5:8], cells[..., 8], _pitch(cells))


def _pitch(cells: Float[np.ndarray, "r c 9"]) -> tuple[float, float]:
    """Return the pitch between rows and between columns [m], by median distances."""
    steps = [np.linalg.norm(np.diff(cells[..., 2:5], axis=axis), axis=-1) for axis in (0, 1)]
    known = [float(np.median(step)) for step in steps if step.size]
    alone = known[0] if known else float(np.sqrt(cells[0, 0, 8]))
    along, across = (float(np.median(step)) if step.size else alone for step in steps)
    return along, across


def _csv(skin: SkinMap, name: str) -> str:
    lines = [",".join(_COLUMNS)]
    for row, column in np.ndindex(skin.rows, skin.columns):
        numbers = (*skin.centres[row, column], *skin.normals[row, column], skin.areas[row, column])
        lines.append(f"{row},{column}," + ",".join(repr(float(number)) for number in numbers))
    return "\n".join([*lines, ""])


def _icub(skin: SkinMap, name: str) -> str:
    """Return the positions file of iCub's skinManager: a taxel a row, position [m] and normal."""
    table = np.concatenate([skin.centres, skin.normals], axis=-1).reshape(-1, 6)
    head = [f"name {name}", "spatial_sampling taxel", f"taxel2Repr ({' '.join(map(str, range(len(table))))})"]
    rows = [" ".join(f"{number:.6f}" for number in row) for row in table]
    return "\n".join([*head, "", "[calibration]", *rows, ""])


def _urdf(skin: SkinMap, name: str) -> str:
    """Return a fixed frame for every cell, z along its normal and x along columns."""
    lines = [f"<!-- Cells of {name}: put these into the robot and name the link that carries them. -->"]
    right = np.broadcast_to([1.0, 0.0, 0.0], skin.centres.shape)
    along = np.gradient(skin.centres, axis=1) if skin.columns > 1 else right
    for cell in np.ndindex(skin.rows, skin.columns):
        row, column = cell
        lines += fixed_frame(f"{name}_{row}_{column}", skin.centres[cell], skin.normals[cell], along[cell])
    return "\n".join([*lines, ""])


@takes_arrays
def fixed_frame(
    name: str, point: Float[np.ndarray, "3"], normal: Float[np.ndarray, "3"], along: Float[np.ndarray, "3"]
) -> list[str]:
    """Return a list of URDF lines: a bodiless link fixed to LINK at a point [m], z along a normal, x near `along`.

    Raises:
        InputError: arrays of other shapes.
    """
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
    """Return URDF's angles [rad] of the frame with z along a normal and x near `along`."""
    x = along - normal * (along @ normal)
    if not np.linalg.norm(x) > 0:
        x = np.eye(3)[np.argmin(np.abs(normal))] - normal * normal[np.argmin(np.abs(normal))]
    x = x / np.linalg.norm(x)
    y = np.cross(normal, x)
    pitch = float(np.arctan2(-x[2], np.hypot(x[0], x[1])))
    return float(np.arctan2(y[2], normal[2])), pitch, float(np.arctan2(x[1], x[0]))


_WRITERS: Mapping[str, Callable[[SkinMap, str], str]] = {".csv": _csv, ".txt": _icub, ".urdf": _urdf}
