"""Describe the place of every cell of a taxel sheet on its link."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import field
from math import nan
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy.typing import ArrayLike

from palpate.errors import InputError
from palpate.spatial._arrays import frozen
from palpate.spatial.arguments import frozen_value
from palpate.surfaces.bspline import BSplineSurface
from palpate.surfaces.mesh import Mesh

if TYPE_CHECKING:
    from scipy.interpolate import NdBSpline

_FINE = 4  # facets of the mesh in a cell


@frozen_value
class SkinMap:
    """Positions, outward normals and areas of rows x columns cells, in the link's own frame.

    Attributes:
        centres: (r, c, 3) of the cells [m], on the sensing layer.
        normals: (r, c, 3) outward, unit.
        areas: (r, c) that the cells cover on the link [m^2].
        pitch: between rows, and between columns, of the flat sheet [m].
        overlap: (r, c) true for cells over or under another one.
        surface: the smooth outside of the link under the sheet; None for a map from a table.
        uv: (r, c, 2) the surface's parameters under the centres; empty without a surface.
        strain: root mean square of the sheet's principal strains, and the one farthest from 0; NaN where not known.
        distance: of the surface from the mesh, mean and worst [m]; NaN where not known.
        provenance: origin of the map.
        notes: for the user, a sentence each.

    Raises:
        InputError: arrays that are not for the same rows and columns.
    """

    centres: Float[np.ndarray, "r c 3"]
    normals: Float[np.ndarray, "r c 3"]
    areas: Float[np.ndarray, "r c"]
    pitch: tuple[float, float]
    overlap: Bool[np.ndarray, "r c"] = field(default_factory=lambda: np.zeros((0, 0), dtype=bool))
    surface: BSplineSurface | None = None
    uv: Float[np.ndarray, "r c 2"] = field(default_factory=lambda: np.zeros((0, 0, 2)))
    strain: tuple[float, float] = (nan, nan)
    distance: tuple[float, float] = (nan, nan)
    provenance: Mapping[str, str] = field(default_factory=lambda: {})
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        centres = frozen(self.centres, tail=(3,), name="centres")
        shape = centres.shape[:2]
        overlap = np.array(self.overlap, dtype=bool) if self.overlap.size else np.zeros(shape, dtype=bool)
        overlap.flags.writeable = False
        named = {"centres": centres, "normals": frozen(self.normals), "areas": frozen(self.areas), "overlap": overlap}
        for name, array in named.items():
            if array.shape[:2] != shape or array.ndim != (2 if name in ("areas", "overlap") else 3):
                raise InputError(
                    f"{name} must be given for each of {shape[0]} x {shape[1]} cells, not in shape {array.shape}."
                )
            object.__setattr__(self, name, array)
        object.__setattr__(self, "uv", frozen(self.uv, tail=(2,), name="uv"))

    @property
    def rows(self) -> int:
        """Return the number of rows of cells."""
        return self.centres.shape[0]

    @property
    def columns(self) -> int:
        """Return the number of columns of cells."""
        return self.centres.shape[1]

    def at(
        self, row: ArrayLike, column: ArrayLike
    ) -> tuple[Float[np.ndarray, "*batch 3"], Float[np.ndarray, "*batch 3"]]:
        """Return positions [m] and outward unit normals, (..., 3), at row and column, which are integers at centres.

        The sheet runs from -1/2 to rows - 1/2 and to columns - 1/2; between centres it is cubic.

        Raises:
            InputError: row and column cannot be broadcast.
        """
        both = self._spline(np.stack(np.broadcast_arrays(row, column), axis=-1).astype(np.float64))
        normals = both[..., 3:]
        return both[..., :3], normals / np.linalg.norm(normals, axis=-1, keepdims=True)

    def mesh(self) -> Mesh:
        """Return the sensing layer as a `Mesh` [m]."""
        rows, columns = self.rows * _FINE, self.columns * _FINE
        row, column = np.meshgrid(
            np.linspace(-0.5, self.rows - 0.5, rows + 1),
            np.linspace(-0.5, self.columns - 0.5, columns + 1),
            indexing="ij",
        )
        points, normals = self.at(row, column)
        corner: Int[np.ndarray, "r c"] = np.arange(rows * (columns + 1)).reshape(rows, columns + 1)[:, :-1]
        a, b, c, d = corner, corner + 1, corner + columns + 1, corner + columns + 2
        faces = np.concatenate([np.stack(three, axis=-1).reshape(-1, 3) for three in ((a, c, b), (b, c, d))])
        vertices = points.reshape(-1, 3)
        first = faces[0]
        outward = np.cross(vertices[first[1]] - vertices[first[0]], vertices[first[2]] - vertices[first[0]])
        if outward @ normals.reshape(-1, 3)[first[0]] < 0:
            faces = faces[:, ::-1]
        return Mesh.from_arrays(vertices, faces)

    @functools.cached_property
    def _spline(self) -> NdBSpline:
        from scipy.interpolate import NdBSpline, make_interp_spline  # here: scipy is slow to import

        values = np.concatenate([self.centres, self.normals], axis=2)
        for axis in range(2):
            if values.shape[axis] == 1:  # a single row says nothing of what is beside it
                values = np.repeat(values, 2, axis=axis)
        degrees = min(3, values.shape[0] - 1), min(3, values.shape[1] - 1)
        count = values.shape
        along = make_interp_spline(np.arange(float(count[0])), values, k=degrees[0])
        across = make_interp_spline(np.arange(float(count[1])), np.moveaxis(along.c, 1, 0), k=degrees[1])
        return NdBSpline((along.t, across.t), np.moveaxis(across.c, 1, 0), degrees, extrapolate=True)


def flat_map(rows: int, columns: int, pitch: float | tuple[float, float]) -> SkinMap:
    """Return the `SkinMap` of a flat sheet about the origin: columns run along x, rows along y, z is outward.

    Args:
        rows: number of rows.
        columns: number of columns.
        pitch: [m] between cells; or between rows, and between columns.
    """
    along = pitch if isinstance(pitch, tuple) else (pitch, pitch)
    y, x = (side * (np.arange(count) - (count - 1) / 2) for side, count in zip(along, (rows, columns), strict=True))
    centres = np.zeros((rows, columns, 3))
    centres[..., 0], centres[..., 1] = x, y[:, None]
    normals = np.broadcast_to([0.0, 0.0, 1.0], centres.shape)
    return SkinMap(centres, normals, np.full((rows, columns), along[0] * along[1]), along)
