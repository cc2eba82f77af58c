"""Compute the place of every cell of a sheet on a mesh."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from math import inf
from typing import Any, cast

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy.typing import ArrayLike

from palpate.calls import called_as
from palpate.errors import InputError, PalpateError
from palpate.sensors.taxels.skin_map.layout import LaidSheet, Sheet, lay
from palpate.sensors.taxels.skin_map.model import SkinMap
from palpate.sensors.taxels.skin_map.shell import Mode, Planes, Shell, Site, shell
from palpate.spatial.arguments import takes_arrays
from palpate.surfaces.mesh import Mesh

_HELD = 0.10  # strain beyond which no sheet lies by itself
_ASTRAY = 0.25  # of the cells may seem to lie beside the surface along geodesics: the layout may bring them back


@called_as("palpate.map_skin(mesh, palpate.Sheet(6, 22, (0.01, 0.01)), origin=corner, heading=[0, 1, 0])")
@takes_arrays
def map_skin(
    mesh: Mesh,
    sheet: Sheet,
    *,
    origin: ArrayLike,
    heading: ArrayLike,
    mode: Mode | None = None,
    planes: Planes | None = None,
    control: int = 200,
    provenance: Mapping[str, str] | None = None,
) -> SkinMap:
    """Return the `SkinMap` of a sheet on a link, with the place and the outward normal of every cell.

    The sheet is laid without stretching on a B-spline that is fitted to the outside of the mesh.

    Args:
        mesh: of the link [m]: it may be unconnected, open, with doubled facets and inner bodies.
        sheet: the sheet to lay.
        origin: (3,) outer corner of cell (0, 0) [m], on the mesh.
        heading: (3,) direction of increasing column there; its part along the surface counts.
        mode: "facets" follows the mesh as it is, "vertices" the smooth shape that its vertices sample; None: the mesh
            decides, and the notes state it.
        planes: that cut the mesh; None: found from its shape.
        control: largest number of the spline's control points, along facets.
        provenance: stored with the map.

    Raises:
        InputError: origin or heading is not three finite numbers, the origin is off the surface, the heading is along
            the normal, the planes' axis has no direction or passes through the origin, or a cell has no surface under
            it.
        GeometryError: the mesh cannot be cut by two families of planes about the origin.
    """
    site = placed(mesh, sheet, origin, heading)
    point = np.asarray(origin, dtype=np.float64)
    signed = (-sheet.size[0] if sheet.flip else sheet.size[0]), sheet.size[1]
    others = len(mesh.faces) - len(site.facets)
    notes = (f"{others} facets that are not of the origin's body were left out",) if others else ()

    def on(here: Site) -> SkinMap:
        return _mapped(shell(here, signed, mode=mode, planes=planes, control=control), sheet, point, site.heading)

    try:
        result = on(site)
    except PalpateError:
        result = None
        if others:  # patches without common vertices may be one link
            with suppress(PalpateError):
                result = on(replace(site, facets=np.arange(len(mesh.faces))))
        if result is None or not abs(result.strain[1]) < _HELD:
            raise
        notes = ("the outermost of all bodies is taken: the body at the origin alone does not carry the sheet",)
    return replace(result, notes=(*notes, *result.notes), provenance=dict(provenance or {}))


@takes_arrays
def placed(mesh: Mesh, sheet: Sheet, origin: ArrayLike, heading: ArrayLike) -> Site:
    """Return the sheet's `Site`: its corner on the mesh, heading, outward normal, and the facets of its body.

    Raises:
        InputError: origin or heading are not three finite numbers, the origin is off the surface, or the heading is
            along the normal.
    """
    point, direction = _vector(origin, "origin"), _vector(heading, "heading")
    feet, normals, facets = mesh.project(point[None])
    foot, facet = feet[0], int(facets[0])
    off = float(np.linalg.norm(foot - point))
    if off > 0.5 * min(sheet.pitch):
        raise InputError(
            f"is {1e3 * off:.1f} mm off the surface.",
            where="origin",
            hint=f"Check the unit, or use the nearest point of the mesh, {','.join(f'{x:.5f}' for x in foot)} m.",
        )
    normal = normals[0] * _side(mesh, foot, normals[0])
    along = direction - normal * (direction @ normal)
    if not np.linalg.norm(along) > 1e-2 * np.linalg.norm(direction):
        raise InputError(
            "points along the normal of the surface.", where="heading", hint="Give a direction along the surface."
        )
    return Site(mesh, _body(mesh, facet), foot, along / np.linalg.norm(along), normal)


def _mapped(found: Shell, sheet: Sheet, origin: Float[np.ndarray, "3"], heading: Float[np.ndarray, "3"]) -> SkinMap:
    begin = found.surface.nearest(origin[None], found.chart.coordinates(origin[None])[:, :2])[0]
    domain = found.surface.domain
    try:
        layout = lay(
            found.surface,
            begin,
            heading,
            sheet,
            bounds=(domain[0], (-inf, inf) if found.surface.periodic else domain[1]),
            look=lambda uv: _refuse_bare(found, uv, sheet, allowed=_ASTRAY * sheet.rows * sheet.columns),
        )
    except np.linalg.LinAlgError as problem:
        raise _too_large(sheet, "it would have to fold") from problem
    _refuse_bare(found, layout.uv, sheet)
    centres, normals = found.surface.at(layout.uv[1::2, 1::2])
    overlap = _overlap(layout.uv, 2 * np.pi) if found.surface.periodic else np.zeros(centres.shape[:2], dtype=bool)
    return SkinMap(
        centres=centres + sheet.thickness * normals,
        normals=normals,
        areas=_areas(found, layout, sheet),
        pitch=sheet.pitch,
        overlap=overlap,
        surface=found.surface,
        uv=layout.uv[1::2, 1::2],
        strain=(layout.rms, layout.worst),
        distance=found.distance,
        notes=(*found.notes, *_notes(found, layout, overlap)),
    )


@takes_arrays
def fit_stretch(
    mesh: Mesh,
    sheet: Sheet,
    known: Mapping[tuple[int, int], ArrayLike],
    *,
    origin: ArrayLike,
    heading: ArrayLike,
    mode: Mode | None = None,
    planes: Planes | None = None,
) -> Sheet:
    """Return the `Sheet` with the stretch that brings some cells nearest to their known places.

    Args:
        mesh: as for `map_skin`.
        sheet: before it is stretched.
        known: (row, column) -> the cell's centre (3,) [m].
        origin: as for `map_skin`.
        heading: as for `map_skin`.
        mode: as for `map_skin`.
        planes: as for `map_skin`.

    Raises:
        InputError: no cell is known, one is not on the sheet, or its place is not three finite numbers; or as for
            `map_skin`.
        GeometryError: as for `map_skin`.
    """
    from scipy.optimize import least_squares

    where = {cell: _vector(point, f"cell {cell}") for cell, point in known.items()}
    for row, column in where:
        if not (0 <= row < sheet.rows and 0 <= column < sheet.columns):
            raise InputError(
                f"cell ({row}, {column}) is not on the sheet of {sheet.rows} x {sheet.columns} cells, counted from 0."
            )
    if not where:
        hint = "Give the measured place of one: {(row, column): (x, y, z)}."
        raise InputError("at least one known cell is needed to fit the stretch.", where="known", hint=hint)
    cells = tuple(np.array(list(where)).T)
    points = np.stack(list(where.values()))

    def off(stretch: Float[np.ndarray, "2"]) -> Float[np.ndarray, " k"]:
        tried = replace(sheet, stretch=(float(stretch[0]), float(stretch[1])))
        found = map_skin(mesh, tried, origin=origin, heading=heading, mode=mode, planes=planes)
        return (found.centres[cells] - points).reshape(-1)

    best = least_squares(off, np.array(sheet.stretch), diff_step=[1e-3], xtol=1e-6, x_scale=0.05)
    return replace(sheet, stretch=(float(best.x[0]), float(best.x[1])))


def _vector(values: ArrayLike, name: str) -> Float[np.ndarray, "3"]:
    vector = np.asarray(values, dtype=np.float64)
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise InputError("must be three finite numbers.", where=name)
    return vector


def _side(mesh: Mesh, origin: Float[np.ndarray, "3"], normal: Float[np.ndarray, "3"]) -> float:
    """Return 1 where the normal leaves the body, else -1: by winding, unless a ray along it disagrees."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    ab, ac, ao = b - a, c - a, origin - a
    across = np.cross(normal, ac)
    size = np.einsum("fi,fi->f", ab, across)
    crossed = np.abs(size) > 1e-12 * mesh.areas
    size = np.where(crossed, size, 1.0)
    first = np.einsum("fi,fi->f", ao, across) / size
    turned = np.cross(ao, ab)
    second = turned @ normal / size
    far = np.einsum("fi,fi->f", ac, turned) / size
    crossed &= (first >= 0) & (second >= 0) & (first + second <= 1)
    near = 1e-6 * mesh.size
    ahead, behind = np.count_nonzero(crossed & (far > near)), np.count_nonzero(crossed & (far < -near))
    return -1.0 if behind < ahead else 1.0


def _body(mesh: Mesh, facet: int) -> Int[np.ndarray, " f"]:
    """Return the facets that are connected with a facet."""
    import trimesh

    edges = mesh.faces[:, [0, 1, 1, 2]].reshape(-1, 2)
    labels = cast("Any", trimesh.graph).connected_component_labels(edges, node_count=len(mesh.vertices))
    body: np.ndarray = labels[mesh.faces[:, 0]]
    return np.flatnonzero(body == body[facet])


def _cell_blocks(lattice: Float[np.ndarray, "a b ..."]) -> Float[np.ndarray, "r c 3 3 ..."]:
    """Return the nine lattice points of every cell, (r, c, 3, 3, ...)."""
    rows, columns = (lattice.shape[0] - 1) // 2, (lattice.shape[1] - 1) // 2
    i, j = (cast("Any", np.arange(3) + 2 * np.arange(count)[:, None]) for count in (rows, columns))
    return lattice[i[:, None, :, None], j[None, :, None, :]]


def _refuse_bare(found: Shell, uv: Float[np.ndarray, "a b 2"], sheet: Sheet, allowed: float = 0.0) -> None:
    """Raise an InputError if more than `allowed` cells have no surface under them."""
    if not np.isfinite(uv).all():
        raise _too_large(sheet, "it would have to fold")
    bare = ~found.there(_cell_blocks(uv)).any(axis=(2, 3))
    if np.count_nonzero(bare) <= allowed:
        return
    rows, columns = (np.unique(numbers) for numbers in np.nonzero(bare))
    place = f"rows {rows[0]} to {rows[-1]}, columns {columns[0]} to {columns[-1]}"
    raise _too_large(sheet, f"{np.count_nonzero(bare)} of {bare.size} cells have no surface under them ({place})")


def _too_large(sheet: Sheet, what: str) -> InputError:
    height, length = sheet.size
    hint = "Move the origin, turn the heading, flip the rows, or check the sheet's size and the mesh's unit."
    size = f"{1e3 * height:.0f} x {1e3 * length:.0f} mm"
    return InputError(f"a sheet of {size} does not fit here: {what}.", where="sheet", hint=hint)


def _areas(found: Shell, layout: LaidSheet, sheet: Sheet) -> Float[np.ndarray, "r c"]:
    height, length = sheet.size
    steps = height / (2 * sheet.rows), length / (2 * sheet.columns)
    by_y, by_x = (np.gradient(layout.uv, step, axis=axis, edge_order=2) for axis, step in enumerate(steps))
    tangents = found.surface.derivatives(layout.uv)[..., 1:3, :]
    across = np.linalg.norm(np.cross(tangents[..., 0, :], tangents[..., 1, :]), axis=-1)
    density = across * np.abs(by_y[..., 0] * by_x[..., 1] - by_y[..., 1] * by_x[..., 0])
    weights = np.outer([1.0, 4.0, 1.0], [1.0, 4.0, 1.0]) / 36.0
    cell = height * length / (sheet.rows * sheet.columns)
    return cell * np.einsum("rcij,ij->rc", _cell_blocks(density), weights)


def _overlap(uv: Float[np.ndarray, "a b 2"], period: float) -> Bool[np.ndarray, "r c"]:
    blocks = _cell_blocks(uv)
    middle = blocks[:, :, 1:2, 1:2]
    points = (middle + 0.9 * (blocks - middle)).reshape(-1, 2)  # neighbours that touch do not overlap
    edge = np.concatenate([uv[0, :-1], uv[:-1, -1], uv[-1, :0:-1], uv[:0:-1, 0]])
    turns = int(np.ceil(np.ptp(edge[:, 1]) / period))
    covered = np.zeros(len(points), dtype=bool)
    for turn in range(1, turns + 1):
        for shift in (turn * period, -turn * period):
            covered |= _inside(points + np.array([0.0, shift]), edge)
    return np.any(covered.reshape(*blocks.shape[:2], 9), axis=2)


def _inside(points: Float[np.ndarray, "n 2"], edge: Float[np.ndarray, "k 2"]) -> Bool[np.ndarray, " n"]:
    """Return which points are inside a polygon: rays from them meet it an odd number of times."""
    (au, av), (bu, bv) = edge.T[:, None, :], np.roll(edge, -1, axis=0).T[:, None, :]
    u, v = points[:, 0, None], points[:, 1, None]
    straddles = (av > v) != (bv > v)
    rise = np.where(straddles, bv - av, 1.0)
    return np.count_nonzero(straddles & (u < au + (v - av) / rise * (bu - au)), axis=1) % 2 == 1


def _notes(found: Shell, layout: LaidSheet, overlap: Bool[np.ndarray, "r c"]) -> tuple[str, ...]:
    notes: list[str] = []
    partly = int(np.count_nonzero(~found.there(_cell_blocks(layout.uv)).all(axis=(2, 3))))
    if partly:
        notes.append(f"{partly} cells reach beyond the surface, which is continued there")
    if overlap.any():
        notes.append(
            f"{np.count_nonzero(overlap)} cells are over or under another: the sheet goes round and overlaps itself"
        )
    if abs(layout.worst) > _HELD:
        notes.append(f"the sheet would have to stretch by {100 * layout.worst:.0f} %: check that it fits on this shape")
    return tuple(notes)
