"""Maps of a taxel sheet: TOML with the spline, the same to the last bit when read back; and what others read.

What is written is told by the suffix: .toml, .csv (a row a cell), .txt (iCub's skin) or .urdf (a link with its cells).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from math import nan
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit
from jaxtyping import Float
from tomlkit.items import Table

from palpate.errors import GeometryError, InputError
from palpate.io.atomic import write_text
from palpate.io.models import load_model, toml_array
from palpate.io.strict import parse
from palpate.sensors.skin_map import SkinMap
from palpate.surfaces.bspline import BSplineSurface

__all__ = ["SUFFIXES", "read_skin_map", "write_skin_map"]

_KIND = "skin map"
Three = tuple[float, float, float]
Rows = tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class _Surface:
    """The spline as its table spells it; control points row by row, v fastest."""

    degree: tuple[int, int]
    periodic: bool
    shape: tuple[int, int]
    knots_u: tuple[float, ...]
    knots_v: tuple[float, ...]
    control: tuple[Three, ...]

    def surface(self) -> BSplineSurface:
        """As a value."""
        if len(self.control) != self.shape[0] * self.shape[1]:
            raise ValueError(f"control must have {self.shape[0]} x {self.shape[1]} points, not {len(self.control)}")
        control = np.array(self.control).reshape(*self.shape, 3)
        return BSplineSurface(np.array(self.knots_u), np.array(self.knots_v), control, self.degree, self.periodic)


@dataclass(frozen=True)
class _MapFile:
    """A map as its file spells it; cells row by row, columns fastest."""

    kind: str
    rows: int
    columns: int
    pitch: tuple[float, float]
    cells: Rows
    overlap: tuple[bool, ...] = ()
    strain: tuple[float, float] | None = None
    distance: tuple[float, float] | None = None
    surface: _Surface | None = None
    notes: tuple[str, ...] = ()
    provenance: Mapping[str, Any] = field(default_factory=lambda: {})

    def __post_init__(self) -> None:
        count = self.rows * self.columns
        if min(self.rows, self.columns) < 1 or len(self.cells) != count or {len(row) for row in self.cells} != {9}:
            raise ValueError(f"cells must be {self.rows} x {self.columns} rows of 9 numbers")
        if len(self.overlap) not in (0, count):
            raise ValueError(f"overlap must be {count} times true or false")

    def map(self) -> SkinMap:
        """As a value."""
        cells = np.array(self.cells).reshape(self.rows, self.columns, 9)
        lost = (nan, nan)
        return SkinMap(
            centres=cells[..., :3],
            normals=cells[..., 3:6],
            areas=cells[..., 6],
            pitch=self.pitch,
            overlap=np.array(self.overlap, dtype=bool).reshape(self.rows if self.overlap else 0, -1),
            surface=None if self.surface is None else self.surface.surface(),
            uv=np.zeros((0, 0, 2)) if self.surface is None else cells[..., 7:],
            strain=self.strain or lost,
            distance=self.distance or lost,
            provenance={name: str(said) for name, said in self.provenance.items()},
            notes=self.notes,
        )


def write_skin_map(path: Path, skin: SkinMap, *, name: str = "skin") -> None:
    """Write a map in the format of its suffix.

    Args:
        path: .toml, .csv, .txt or .urdf.
        skin: the map.
        name: of the skin's part, in iCub's file and in the URDF.

    Raises:
        InputError: another suffix, or it cannot be written.
    """
    writer = _WRITERS.get(path.suffix.lower())
    if writer is None:
        raise InputError(f"cannot write a map as {path.suffix!r}.", where=str(path), mend=f"Use {_known()}.")
    write_text(path, writer(skin, name))


def read_skin_map(path: Path) -> SkinMap:
    """Read a map from .toml, the same to the last bit, or from .csv.

    Raises:
        InputError: not a map, a key misspelt or missing, a value of the wrong kind.
    """
    if path.suffix.lower() == ".csv":
        from palpate.io.skin_csv import read_map_csv  # here: tables load polars

        return read_map_csv(path)
    table = load_model(path, _KIND, "a skin map", "palpate map skin")
    stated = parse(table, _MapFile, file=str(path))
    try:
        return stated.map()
    except (GeometryError, ValueError) as problem:
        raise InputError(f"{problem}.", where=f"{path}: surface") from problem


def _toml(skin: SkinMap, name: str) -> str:
    document = tomlkit.document()
    document.add(tomlkit.comment(f"Where the cells of {name} sit, in the mesh's frame. Written by `palpate map skin`."))
    document.add("kind", tomlkit.item(_KIND))
    document.add("rows", tomlkit.item(skin.rows))
    document.add("columns", tomlkit.item(skin.columns))
    document.add("pitch", tomlkit.item(list(skin.pitch)).comment("m, between rows and between columns"))
    if np.isfinite(skin.strain).all():
        document.add("strain", tomlkit.item(list(skin.strain)).comment("rms, and the one farthest from 0"))
    if np.isfinite(skin.distance).all():
        document.add("distance", tomlkit.item(list(skin.distance)).comment("m, of spline and mesh: mean, worst"))
    document.add("notes", tomlkit.item(list(skin.notes)))
    document.add(tomlkit.comment("row by row: x y z [m], nx ny nz outward, area [m^2], u v of the surface"))
    uv = skin.uv if skin.surface is not None else np.zeros((skin.rows, skin.columns, 2))
    table = np.concatenate([skin.centres, skin.normals, skin.areas[..., None], uv], axis=-1)
    document.add("cells", toml_array(table.reshape(-1, 9)))
    document.add("overlap", tomlkit.item(skin.overlap.reshape(-1).tolist()))
    if skin.surface is not None:
        document.add("surface", _surface_table(skin.surface))
    document.add("provenance", tomlkit.item(dict(skin.provenance)))
    return tomlkit.dumps(document)


def _surface_table(surface: BSplineSurface) -> Table:
    table = tomlkit.table()
    table.add("degree", list(surface.degree))
    table.add(
        "periodic", tomlkit.item(surface.periodic).comment("in v: the last control points of rows repeat the first")
    )
    table.add("shape", list(surface.control.shape[:2]))
    table.add("knots_u", surface.knots_u.tolist())
    table.add("knots_v", surface.knots_v.tolist())
    table.add("control", toml_array(surface.control.reshape(-1, 3)))
    return table


def _csv(skin: SkinMap, name: str) -> str:
    lines = ["row,column,x,y,z,nx,ny,nz,area"]
    for (row, column), point, normal in _cells(skin):
        numbers = (*point, *normal, skin.areas[row, column])
        lines.append(f"{row},{column}," + ",".join(repr(float(number)) for number in numbers))
    return "\n".join([*lines, ""])


def _icub(skin: SkinMap, name: str) -> str:
    """The positions file of iCub's skinManager: one taxel a row, position [m] and normal."""
    count = skin.rows * skin.columns
    head = [f"name {name}", "spatial_sampling taxel", f"taxel2Repr ({' '.join(map(str, range(count)))})"]
    rows = [" ".join(f"{number:.6f}" for number in (*point, *normal)) for _, point, normal in _cells(skin)]
    return "\n".join([*head, "", "[calibration]", *rows, ""])


def _urdf(skin: SkinMap, name: str) -> str:
    """A fixed frame for every cell, z along its normal and x along increasing columns, below a link to be named."""
    lines = [f"<!-- Cells of {name}: put these into the robot and name the link that carries them. -->"]
    along = (
        np.gradient(skin.centres, axis=1)
        if skin.columns > 1
        else np.broadcast_to([1.0, 0.0, 0.0], (*skin.areas.shape, 3))
    )
    for (row, column), point, normal in _cells(skin):
        cell = f"{name}_{row}_{column}"
        place = " ".join(f"{number:.9g}" for number in point)
        angles = " ".join(f"{number:.9g}" for number in _roll_pitch_yaw(normal, along[row, column]))
        lines += [
            f'<link name="{cell}"/>',
            f'<joint name="{cell}_joint" type="fixed">',
            f'  <parent link="LINK"/><child link="{cell}"/>',
            f'  <origin xyz="{place}" rpy="{angles}"/>',
            "</joint>",
        ]
    return "\n".join([*lines, ""])


def _roll_pitch_yaw(normal: Float[np.ndarray, "3"], along: Float[np.ndarray, "3"]) -> tuple[float, float, float]:
    """URDF's angles of the frame with z along a normal and x as near as can be to a direction."""
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


def _known() -> str:
    return ", ".join(SUFFIXES)


_WRITERS: Mapping[str, Callable[[SkinMap, str], str]] = {".toml": _toml, ".csv": _csv, ".txt": _icub, ".urdf": _urdf}
SUFFIXES = tuple(_WRITERS)
