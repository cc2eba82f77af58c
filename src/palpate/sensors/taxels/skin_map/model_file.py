"""Define the file format of a sheet's map."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from palpate.files.models.model import Lines, Model
from palpate.files.schema import Key, TableForm
from palpate.sensors.taxels.skin_map.model import SkinMap
from palpate.surfaces.bspline import BSplineSurface


def _spline(shape: tuple[int, int], control: Float[np.ndarray, "n 3"], **rest: Any) -> BSplineSurface:
    if min(shape) < 0 or len(control) != shape[0] * shape[1]:
        raise ValueError(f"control must have {shape[0]} x {shape[1]} points, not {len(control)}")
    return BSplineSurface(control=control.reshape(*shape, 3), **rest)


def _spline_keys(surface: BSplineSurface) -> dict[str, Any]:
    return {"shape": surface.control.shape[:2], "control": surface.control.reshape(-1, 3)}


def _skin_map(
    rows: int,
    columns: int,
    cells: Float[np.ndarray, "n 9"],
    overlap: Bool[np.ndarray, " o"] | None = None,
    surface: BSplineSurface | None = None,
    **rest: Any,
) -> SkinMap:
    shape = (rows, columns)
    if min(shape) < 1 or len(cells) != rows * columns:
        raise ValueError(f"cells must be {rows} x {columns} rows of 9 numbers")
    if overlap is not None and len(overlap) not in (0, len(cells)):
        raise ValueError(f"overlap must be {len(cells)} values true or false")
    table = cells.reshape(*shape, 9)
    if surface is not None:
        rest |= {"surface": surface, "uv": table[..., 7:]}
    if overlap is not None and len(overlap):
        rest["overlap"] = overlap.reshape(shape)
    return SkinMap(table[..., :3], table[..., 3:6], table[..., 6], **rest)


def _skin_map_keys(skin: SkinMap) -> dict[str, Any]:
    uv = np.zeros((*skin.areas.shape, 2)) if skin.surface is None else skin.uv
    table = np.concatenate([skin.centres, skin.normals, skin.areas[..., None], uv], axis=-1)
    cells, overlap = table.reshape(-1, 9), skin.overlap.reshape(-1)
    return {"rows": skin.rows, "columns": skin.columns, "cells": cells, "overlap": overlap}


def of_skin_map(skin: SkinMap) -> Lines:
    """Return (name, text) pairs on a map, a list: cells, pitch, spline, distance, strain and overlap."""
    surface = skin.surface
    area = f"{1e4 * float(skin.areas.sum()):.1f} cm^2"
    said = [
        ("cells", f"{skin.rows} x {skin.columns}, {area}"),
        ("pitch", f"{1e3 * skin.pitch[0]:.3g} mm between rows, {1e3 * skin.pitch[1]:.3g} mm between columns"),
    ]
    if surface is not None:
        said.append(("spline", f"{surface.points} control points, {'closed' if surface.periodic else 'open'}"))
    if np.isfinite(skin.distance).all():
        said.append(("distance", f"{1e3 * skin.distance[0]:.3f} mm mean, {1e3 * skin.distance[1]:.3f} mm worst"))
    if np.isfinite(skin.strain).all():
        said.append(("strain", f"{100 * skin.strain[0]:.2f} % rms, {100 * skin.strain[1]:.2f} % worst"))
    if skin.overlap.any():
        said.append(("overlap", f"{np.count_nonzero(skin.overlap)} cells lie over or under another one"))
    return said


SKIN_MAP = Model(
    SkinMap,
    "a skin map",
    "Where the cells of a sheet sit, in the mesh's frame.",
    "palpate map skin",
    of_skin_map,
    {
        SkinMap: TableForm(
            {
                "rows": Key(),
                "columns": Key(),
                "pitch": Key("m, between rows and between columns"),
                "strain": Key("rms, and the one farthest from 0"),
                "distance": Key("m, of spline and mesh: mean, worst"),
                "notes": Key(),
                "cells": Key("row by row: x y z [m], nx ny nz outward, area [m^2], u v of the surface"),
                "overlap": Key(),
                "surface": Key(),
                "provenance": Key(),
            },
            _skin_map,
            _skin_map_keys,
        ),
        BSplineSurface: TableForm(
            {
                "degree": Key("in u and in v", required=True),
                "periodic": Key("in v: the last control points of rows repeat the first", required=True),
                "shape": Key("of the control points, v fastest"),
                "knots_u": Key(),
                "knots_v": Key(),
                "control": Key("m"),
            },
            _spline,
            _spline_keys,
        ),
    },
)
