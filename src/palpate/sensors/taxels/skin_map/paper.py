"""Map a skin by the paper's method: even planes, uniform knots, uniform parameters [skin].

The text is read so: m planes through the axis give 2 m spokes, and curves are clamped cubics that begin and end at the
same point. `literal` gives every section's curve the parameters k/M and takes the curves' control points as the
surface's; `greville` gives points the parameters at which their control points have most weight.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from palpate.errors import GeometryError
from palpate.sensors.taxels.skin_map.chart import Chart
from palpate.sensors.taxels.skin_map.layout import Sheet
from palpate.sensors.taxels.skin_map.model import SkinMap
from palpate.sensors.taxels.skin_map.sections import cut
from palpate.sensors.taxels.skin_map.sheet import placed
from palpate.sensors.taxels.skin_map.shell import Planes, full_sections
from palpate.spatial.arguments import takes_arrays
from palpate.surfaces.bspline import BSplineSurface, basis_matrices, greville, open_knots
from palpate.surfaces.mesh import Mesh

Reading = Literal["literal", "greville"]
_PLANES = 10  # of either family, as in the paper


@takes_arrays
def paper_surface(
    chart: Chart,
    triangles: Float[np.ndarray, "f 3 3"],
    span: tuple[float, float],
    n: int = _PLANES,
    m: int = _PLANES,
    reading: Reading = "literal",
) -> BSplineSurface:
    """Return the `BSplineSurface` of [skin], Algorithm 1: n planes across the axis within `span` [m], m through it.

    Raises:
        InputError: n or m is too small for cubics; or arrays of other shapes.
        GeometryError: a section is not complete.
    """
    heights = np.linspace(*span, n)
    spokes = np.linspace(-np.pi, np.pi, 2 * m, endpoint=False)  # begins behind the sheet's origin
    offsets = cut(chart, triangles, heights, spokes).offset
    if not np.isfinite(offsets).all():
        raise GeometryError(
            "a section of the mesh is not a closed curve (a hole or an end): give a span of heights in which all are."
        )
    closed = np.append(spokes, spokes[0] + 2 * np.pi)
    offsets = np.concatenate([offsets, offsets[:, :1]], axis=1)
    knots_u, knots_v = (open_knots(np.linspace(0.0, 1.0, count - 2)) for count in (n, len(closed)))
    if reading == "literal":
        at_v = np.linspace(0.0, 1.0, len(closed))
    else:
        at_v = greville(knots_v, 3)
        offsets = np.linalg.solve(basis_matrices(knots_u, 3, greville(knots_u, 3))[0], offsets)
        heights = np.linalg.solve(basis_matrices(knots_u, 3, greville(knots_u, 3))[0], heights)
    table = basis_matrices(knots_v, 3, at_v)[0]
    held = np.stack([_held(table, closed, row) for row in offsets])
    starts, directions = chart.lines(heights[:, None], closed[None, :])
    return BSplineSurface(knots_u, knots_v, starts + held[..., None] * directions)


def _held(
    table: Float[np.ndarray, "k m"], spokes: Float[np.ndarray, " m"], offsets: Float[np.ndarray, " m"]
) -> Float[np.ndarray, " m"]:
    """Return offsets of control points on spokes by least squares (4), both ends where the curve begins."""
    ways = np.stack([np.cos(spokes), np.sin(spokes)])
    points = ways * offsets
    matrix = np.concatenate([table * way for way in ways])
    right = np.concatenate(points)
    ends, inner = [0, len(spokes) - 1], slice(1, -1)
    found = offsets.copy()
    found[inner], *_ = np.linalg.lstsq(matrix[:, inner], right - matrix[:, ends] @ offsets[ends], rcond=None)
    return found


@takes_arrays
def paper_map(
    mesh: Mesh,
    sheet: Sheet,
    *,
    origin: ArrayLike,
    heading: ArrayLike,
    planes: Planes | None = None,
    reading: Reading = "literal",
    provenance: Mapping[str, str] | None = None,
) -> SkinMap:
    """Return a `SkinMap` with cells at equal parameters over the complete surface of the paper [skin].

    Cell (k, l) is at ((k + 1/2)/rows, (l + 1/2)/columns); [skin] prints (k/6, l/22), half a cell off. The sheet's size
    and the origin's height have no effect. Arguments are as for `map_skin`.

    Raises:
        InputError: the origin is off the surface, the heading is along the normal, or the axis has no direction; or
            arrays of other shapes.
        GeometryError: there are no complete sections about an axis.
    """
    site = placed(mesh, sheet, origin, heading)
    chart, span = full_sections(site, planes)
    surface = paper_surface(chart, site.triangles, span, reading=reading)
    along_u, along_v = (np.arange(sheet.rows) + 0.5) / sheet.rows, (np.arange(sheet.columns) + 0.5) / sheet.columns
    forward, up = site.heading @ chart.axes[1] >= 0, np.cross(site.normal, site.heading) @ chart.axes[2] >= 0
    turned = np.mod(0.5 + (along_v if forward else -along_v), 1.0)  # spokes begin behind the origin
    uv = np.stack(np.meshgrid(along_u if up != sheet.flip else 1.0 - along_u, turned, indexing="ij"), axis=-1)
    tangents = surface.derivatives(uv)[..., 1:3, :]
    areas = np.linalg.norm(np.cross(tangents[..., 0, :], tangents[..., 1, :]), axis=-1) / (sheet.rows * sheet.columns)
    centres, normals = surface.at(uv)
    counts = f"n = {_PLANES}, m = {_PLANES}"
    return SkinMap(
        centres + sheet.thickness * normals,
        normals,
        areas,
        sheet.pitch,
        surface=surface,
        uv=uv,
        notes=(f"the paper's way, {reading}, {counts}: cells are spread over the complete link, not unrolled",),
        provenance=dict(provenance or {}),
    )
