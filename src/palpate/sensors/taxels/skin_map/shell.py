"""Fit one smooth surface to the outside of a triangle mesh, where the sheet will lie."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, cast

import numpy as np
from jaxtyping import Bool, Float, Int

from palpate.errors import GeometryError
from palpate.sensors.taxels.skin_map.chart import Chart, flat_chart, round_chart, wrapped
from palpate.sensors.taxels.skin_map.fit import Breaks, Fitted, Span, breaks_at, clusters, fit, refined
from palpate.sensors.taxels.skin_map.sections import Sections, cut
from palpate.spatial.arguments import frozen_value
from palpate.surfaces.bspline import BSplineSurface, solve_tangent
from palpate.surfaces.mesh import Mesh

Mode = Literal["facets", "vertices"]
Vector = Float[np.ndarray, "3"]
Points = Float[np.ndarray, "k 3"]
Places = Float[np.ndarray, " _"]
_ROWS, _SPOKES = 32, 96  # planes of either family that look at the mesh
_SEEN = np.cos(np.radians(65.0))  # facets that are steeper to a flat chart's lines are not seen from one side
_COARSE = 3e-5  # m between a chord and its arc: below it facets and vertices are the same, and arcs are taken
_RIPPLE = 0.5  # of that height, rms: what is left between facets and a smooth surface needs no more control points
_ENOUGH = 1e-6  # m rms
_SHARP = np.radians(40.0)  # facets that meet by more make an edge, and are no samples of a smooth shape
_MOST_SPANS = (16, 64)  # between vertices that stand in no rows
_UNEVEN = 2.5  # times the median width of facets: vertices that far apart do not carry the shape by themselves
_RIM = np.radians(8.0)  # that a row may turn from the next before it is taken for a rim
_FINE = (3, 5)  # degree through vertices, which are exact: round a link a cubic would show between 24 of them
_LEAST = 0.7  # of the rows that most spokes have, for a spoke to count


@frozen_value
class Planes:
    """The user's own two families of planes.

    Attributes:
        axis: a point [m] and the direction of the link's axis; None: found from the mesh.
        heights: of planes across the axis [m], from that point or, without one, from the sheet's origin; None: chosen.
        angles: of planes through the axis [rad], from the sheet's origin; None: chosen.
    """

    axis: tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]] | None = None
    heights: Float[np.ndarray, " n"] | None = None
    angles: Float[np.ndarray, " m"] | None = None

    @property
    def spaced(self) -> bool:
        """Return True if heights or angles are given."""
        return self.heights is not None or self.angles is not None


_ANY = Planes()


@frozen_value
class Site:
    """The start of a sheet on a mesh.

    Attributes:
        mesh: [m].
        facets: indices of the facets of the body under the sheet.
        corner: (3,) of the sheet, on the mesh [m].
        heading: (3,) in the tangent plane, unit.
        normal: (3,) outward, unit.
    """

    mesh: Mesh
    facets: Int[np.ndarray, " f"]
    corner: Vector
    heading: Vector
    normal: Vector

    @cached_property
    def triangles(self) -> Float[np.ndarray, "f 3 3"]:
        """Return the corners of the facets, (f, 3, 3) [m]."""
        return self.mesh.vertices[self.mesh.faces[self.facets]]

    @cached_property
    def normals(self) -> Float[np.ndarray, "f 3"]:
        """Return the unit normals of the facets (f, 3), as wound."""
        return self.mesh.normals[self.facets]


@frozen_value
class Shell:
    """A smooth surface, and the part of it that the mesh covers.

    Attributes:
        surface: the spline.
        chart: its lines.
        sections: cuts of the mesh, which show the covered part.
        distance: to the mesh's facets or vertices, mean and worst [m], along the normal.
        notes: for the user, a sentence each.
    """

    surface: BSplineSurface
    chart: Chart
    sections: Sections
    distance: tuple[float, float]
    notes: tuple[str, ...] = ()

    def there(self, uv: Float[np.ndarray, "*batch 2"]) -> Bool[np.ndarray, "*batch"]:
        """Return a bool for each pair of parameters (..., 2), True where the nearest line meets the mesh.

        Raises:
            InputError: uv has another shape.
        """
        u, v = self.sections.u, self.sections.v
        i = np.rint((uv[..., 0] - u[0]) / (u[1] - u[0])).astype(np.int64)
        j = np.rint((uv[..., 1] - v[0]) / (v[1] - v[0])).astype(np.int64)
        if self.surface.periodic:
            j %= len(v)
        inside = (i >= 0) & (i < len(u)) & (j >= 0) & (j < len(v))
        return inside & (self.sections.facet[np.clip(i, 0, len(u) - 1), np.clip(j, 0, len(v) - 1)] >= 0)


def shell(
    site: Site, size: Span, *, mode: Mode | None = None, planes: Planes | None = None, control: int = 200
) -> Shell:
    """Fit a surface to the outside of some facets near a sheet; return it as a `Shell`.

    Args:
        site: start of the sheet.
        size: of the sheet: signed height (negative where flipped) and length [m].
        mode: that the surface follows; None: the mesh decides.
        planes: of the user; None: found from the mesh.
        control: largest number of control points in mode "facets".

    Raises:
        InputError: the planes' axis has no direction, or passes through the origin.
        GeometryError: the mesh cannot be cut by two families of planes about the origin.
    """
    planes = planes or _ANY
    found, whole = None, False
    if planes.axis is None and not planes.spaced:
        found, whole = _one_sided(site, size)
    if found is None or not whole:
        try:
            return _fitted(site, *_round(site, planes), mode, control, planes)
        except GeometryError:
            if found is None:
                raise
    return _fitted(site, *found, mode, control, planes)


def full_sections(site: Site, planes: Planes | None = None) -> tuple[Chart, Span]:
    """Return the `Chart` about a link's axis, and (low, high) [m] between which sections across it are complete.

    Raises:
        InputError: as for `shell`.
        GeometryError: there are none, or no axis about which the link closes.
    """
    chart, sections = _round(site, planes or _ANY)
    rows, _, periodic = _block(site, sections, True)
    if not periodic:
        raise GeometryError(
            "the link does not close about an axis, as method 'paper' needs: use 'isometric', or give another axis."
        )
    return chart, (float(sections.u[rows.start]), float(sections.u[rows.stop - 1]))


def _one_sided(site: Site, size: Span) -> tuple[tuple[Chart, Sections] | None, bool]:
    """Cut along the mean normal if the sheet's place is seen from one side; return also if all of it is."""
    height, length = size
    margin = 0.15 * min(abs(height), length)
    low, high = min(0.0, -height) - margin, max(0.0, -height) + margin  # u falls where rows rise
    found, whole, normal = None, False, site.normal
    for count in (16, 16, 56):
        chart = flat_chart(site.corner, normal, site.heading)
        u, v = np.linspace(low, high, count), np.linspace(-margin, length + margin, count)
        sections = cut(chart, site.triangles, u, v)
        met = sections.facet[sections.facet >= 0]
        if len(met) < 0.5 * sections.facet.size:
            return None, False
        facing = site.normals[met] * np.sign(site.normals[met] @ normal)[:, None]
        found = (chart, sections) if np.count_nonzero(facing @ normal < _SEEN) < 0.01 * len(met) else None
        normal = facing.mean(axis=0)
        normal = normal / np.linalg.norm(normal)
        inner = sections.facet[2 * count // 10 : 8 * count // 10, count // 10 : 8 * count // 10]
        whole = bool(np.mean(inner >= 0) > 0.9)
    return found, whole


def _round(site: Site, planes: Planes) -> tuple[Chart, Sections]:
    triangles = site.triangles
    chart = round_chart(triangles.mean(axis=1), site.normals, site.mesh.areas[site.facets], site.corner, planes.axis)
    height = chart.local(triangles)[..., 0]
    low, high = float(height.min()), float(height.max())
    own, _ = _own(planes, chart)
    if own is not None:
        shift = _shift(planes, chart)
        said = f"between {1e3 * (low - shift):.1f} and {1e3 * (high - shift):.1f} mm along the axis"
        low, high = max(low, float(own[0])), min(high, float(own[-1]))
        if not low < high:
            raise GeometryError(f"no two of the planes across the axis meet the link: state their heights {said}.")
    spokes = np.linspace(-np.pi, np.pi, _SPOKES, endpoint=False)
    return chart, cut(chart, triangles, np.linspace(low, high, _ROWS), spokes)


def _shift(planes: Planes, chart: Chart) -> float:
    """Return the offset from the user's heights to those of the chart [m]."""
    return 0.0 if planes.axis is None else float(chart.axes[2] @ (np.asarray(planes.axis[0]) - chart.centre))


def _own(planes: Planes, chart: Chart) -> tuple[Places | None, Places | None]:
    """Return the user's planes as parameters of the chart, in order."""
    u = None if planes.heights is None else np.unique(_given(planes.heights)) + _shift(planes, chart)
    return u, None if planes.angles is None else np.unique(wrapped(_given(planes.angles)))


def _given(values: Places) -> Places:
    array = np.asarray(values, dtype=np.float64)
    if array.ndim != 1 or len(array) < 2 or not np.isfinite(array).all():
        raise GeometryError("the heights and the angles of planes must each be two finite numbers or more.")
    return array


def _block(site: Site, sections: Sections, round_about: bool) -> tuple[slice, slice, bool]:
    """Return the rows in which all counted spokes meet the mesh, those spokes, and whether they close."""
    met = sections.facet >= 0
    any_met = met.any(axis=0)
    if not round_about:  # what is missing is filled in
        rows, columns = np.flatnonzero(met.any(axis=1)), np.flatnonzero(any_met)
        return slice(int(rows[0]), int(rows[-1]) + 1), slice(int(columns[0]), int(columns[-1]) + 1), False
    first, last = np.argmax(met, axis=0), len(met) - 1 - np.argmax(met[::-1], axis=0)
    long = np.where(any_met, last - first + 1, 0)
    if not any_met.any():
        raise GeometryError("the planes miss the mesh: no two of them meet on it. Check the axis and the heights.")
    good = long >= _LEAST * np.median(long[any_met])
    if good.all():
        columns, periodic = slice(0, len(good)), True
    else:
        begin, end = _run(good, int(np.argmin(np.abs(sections.v))))
        columns, periodic = slice(begin, end), False
    low, high = int(first[columns].max()), int(last[columns].min())
    if high - low < 3 or columns.stop - columns.start < 4:
        raise GeometryError(
            "the link cannot be cut into a grid around the sheet's origin: "
            f"{max(0, high - low + 1)} sections across the axis are complete there, in {columns.stop - columns.start} "
            "directions, and 4 of both are needed. Give the axis of the link, or a mesh that is complete there."
        )
    rows = _without_rims(slice(low, high + 1), site.normals, sections.facet[:, columns])
    return rows, columns, periodic


def _without_rims(rows: slice, normals: Float[np.ndarray, "f 3"], met: Int[np.ndarray, "n m"]) -> slice:
    """Remove end rows that already run over a rim: they turn by far more than others do."""
    grid = normals[met[rows]]
    cosine = np.abs(np.einsum("nmi,nmi->nm", grid[1:], grid[:-1]))
    turn = np.quantile(np.arccos(np.clip(cosine, 0.0, 1.0)), 0.9, axis=1)
    usual = max(_RIM, 2.0 * float(turn[2:-2].max(initial=0.0)))
    first, last = (int(cast("Any", np.cumprod(end[:3] > usual)).sum()) for end in (turn, turn[::-1]))
    return slice(rows.start + first, rows.stop - last)


def _run(good: Bool[np.ndarray, " m"], through: int) -> tuple[int, int]:
    """Return begin and end of the unbroken run of spokes about one of them."""
    bad = np.flatnonzero(~good)
    begin = int(bad[bad < through].max()) + 1 if (bad < through).any() else 0
    end = int(bad[bad > through].min()) if (bad > through).any() else len(good)
    return (begin, end) if good[through] else (through, through)


@dataclass(frozen=True, eq=False)
class _Window:
    """The rows and columns of sections to which a surface is fitted.

    Attributes:
        chart: of the sections; periodic: the columns go all around.
        u: (n,) and v: (m,) planes.
    """

    chart: Chart
    periodic: bool
    u: Places
    v: Places

    @property
    def span(self) -> tuple[Span, Span]:
        end = float(self.v[0]) + 2 * np.pi if self.periodic else float(self.v[-1])
        return (float(self.u[0]), float(self.u[-1])), (float(self.v[0]), end)

    @property
    def steps(self) -> Span:
        return float(self.u[1] - self.u[0]), float(self.v[1] - self.v[0])


def _fitted(site: Site, chart: Chart, sections: Sections, mode: Mode | None, control: int, planes: Planes) -> Shell:
    rows, columns, periodic = _block(site, sections, chart.round)
    met = sections.facet[rows, columns]
    window = _Window(chart, periodic, sections.u[rows], sections.v[columns])
    place = np.nonzero(met >= 0)
    uv = np.stack([window.u[place[0]], window.v[place[1]]], axis=1)
    starts, spokes = chart.lines(uv[:, 0], uv[:, 1])
    points = starts + sections.offset[rows, columns][place][:, None] * spokes
    normals = _outward(site.normals[met[place]], spokes)
    chosen, why, sag = _judged(normals, points, met)
    vertices = (mode or chosen) == "vertices"
    used = np.unique(met[place])
    extents = _extents(chart, site.triangles[used])
    apart = float(np.median(extents[:, 0])), float(np.median(extents[:, 1]))
    corners = _corners(site.mesh, site.facets[used], window)
    even = extents[:, 1].max() < _UNEVEN * apart[1] and _wide(chart.coordinates(corners[0]), apart)
    if vertices and not planes.spaced and even:
        surface, distance = _through_vertices(window, *corners, apart)
    else:
        enough = _RIPPLE * sag
        if vertices or sag < _COARSE:
            points, normals = _lifted(site.mesh, site.facets[met[place]], points, spokes)
            enough = _ENOUGH if sag < _COARSE else enough
        surface, distance = _along_facets(window, (points, normals, uv), control, enough, _own(planes, chart))
    size = float(np.abs(distance).mean()), float(np.abs(distance).max())
    return Shell(surface, chart, sections, size, (why,) if mode is None else ())


def _wide(places: Points, apart: Span) -> bool:
    """Return whether vertices are in more than one row and column, as a shape needs."""
    return len(places) > 0 and bool((np.ptp(places[:, :2], axis=0) > 0.5 * np.array(apart)).all())


def _outward(normals: Points, spokes: Points) -> Points:
    return normals * np.where(np.einsum("ki,ki->k", normals, spokes) < 0, -1.0, 1.0)[:, None]


def _extents(chart: Chart, triangles: Float[np.ndarray, "f 3 3"]) -> Float[np.ndarray, "f 2"]:
    where = chart.coordinates(triangles)[..., :2]
    return np.ptp(chart.between(where[:, :1], where), axis=1)


def _lifted(mesh: Mesh, met: Int[np.ndarray, " k"], points: Points, spokes: Points) -> tuple[Points, Points]:
    """Move points of facets half way to the planes across their corners' normals [phong].

    On a circle they reach its arc. Return the points and their normals.
    """
    corners, slopes = mesh.vertices[mesh.faces[met]], mesh.corner_normals[met]
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    weights = solve_tangent(np.stack([a, b], axis=1), points - corners[:, 0])
    share = np.concatenate([1.0 - weights.sum(axis=1, keepdims=True), weights], axis=1)
    height = np.einsum("kci,kci->kc", corners - points[:, None], slopes)
    moved = points + 0.5 * np.einsum("kc,kc,kci->ki", share, height, slopes)
    normals = np.einsum("kc,kci->ki", share, slopes)
    return moved, _outward(normals / np.linalg.norm(normals, axis=1, keepdims=True), spokes)


def _corners(mesh: Mesh, met: Int[np.ndarray, " f"], window: _Window) -> tuple[Points, Points]:
    """Return the corners of facets that were cut, within the span, and their normals."""
    number, corner = np.unique(mesh.faces[met], return_inverse=True)
    points, chart, span = mesh.vertices[number], window.chart, np.array(window.span)
    where = chart.coordinates(points)
    _, spokes = chart.lines(where[:, 0], where[:, 1])
    sums = np.zeros((len(number), 3))
    weighed = mesh.normals[met] * mesh.areas[met][:, None]
    middle = chart.coordinates(mesh.vertices[mesh.faces[met]].mean(axis=1))
    weighed = _outward(weighed, chart.lines(middle[:, 0], middle[:, 1])[1])
    np.add.at(sums, corner.reshape(-1), np.repeat(weighed, 3, axis=0))
    inside = np.all((where[:, :2] >= span[:, 0] - window.steps) & (where[:, :2] <= span[:, 1] + window.steps), axis=1)
    normals = sums / np.maximum(np.linalg.norm(sums, axis=1), 1e-300)[:, None]
    return points[inside], _outward(normals, spokes)[inside]


def _judged(normals: Points, points: Points, met: Int[np.ndarray, "n m"]) -> tuple[Mode, str, float]:
    """Choose facets at edges and for fine meshes, else vertices; return why and sag, too.

    Compare the angles between facets along the sections, and their lengths.
    """
    grid_n, grid_p = np.full((*met.shape, 3), np.nan), np.full((*met.shape, 3), np.nan)
    grid_n[met >= 0], grid_p[met >= 0] = normals, points
    both = (met[:, 1:] >= 0) & (met[:, :-1] >= 0)
    turn = np.arccos(np.clip(np.einsum("nmi,nmi->nm", grid_n[:, 1:], grid_n[:, :-1])[both], -1.0, 1.0))
    length = float(np.linalg.norm(grid_p[:, 1:] - grid_p[:, :-1], axis=2)[both].sum())
    edges = turn > 1e-3
    if not edges.any():
        return "facets", "mode facets: the mesh is flat along its sections", 0.0
    sharp = float(np.quantile(turn[edges], 0.98))
    sag = length / np.count_nonzero(edges) * float(turn[edges].mean()) / 8.0
    said = f"facets are {1e3 * sag:.2g} mm below a smooth shape through their corners and meet by up to "
    said += f"{np.degrees(sharp):.0f} deg"
    if sharp > _SHARP:
        return "facets", f"mode facets: {said}, which is an edge", sag
    chosen: Mode = "facets" if sag < _COARSE else "vertices"
    return chosen, f"mode {chosen}: {said}", sag


def _along_facets(
    window: _Window,
    data: tuple[Points, Points, Float[np.ndarray, "k 2"]],
    control: int,
    enough: float,
    own: tuple[Places | None, Places | None],
) -> Fitted:
    """Fit along the mesh's outside, with knots where it bends, or in the user's own planes."""
    points, normals, uv = data
    periodic, span, steps = window.periodic, window.span, window.steps

    def fitted(breaks: Breaks) -> Fitted:
        surface = fit(window.chart, breaks, points, normals, uv, periodic=periodic)
        return surface, np.einsum("ki,ki->k", points - surface.derivatives(uv)[:, 0], normals)

    begin = (4, 21) if periodic else (5, 9)
    breaks = np.linspace(*span[0], begin[0]), np.linspace(*span[1], begin[1])
    if any(mine is not None for mine in own):
        u, v = (breaks[axis] if mine is None else _clipped(mine, span[axis]) for axis, mine in enumerate(own))
        return fitted((u, v))
    return refined(fitted, breaks, uv, (1.5 * steps[0], 1.5 * steps[1]), control, enough)


def _clipped(places: Places, span: Span) -> Float[np.ndarray, " k"]:
    least = 1e-6 * (span[1] - span[0])
    inner = places[(places > span[0] + least) & (places < span[1] - least)]
    return np.concatenate([span[:1], inner, span[1:]])


def _through_vertices(window: _Window, vertices: Points, normals: Points, apart: Span) -> Fitted:
    """Fit through the corners of facets as samples of a smooth shape."""
    chart, periodic = window.chart, window.periodic
    target = chart.coordinates(vertices)
    breaks, degree = _sampled(target, apart, window)
    uv = target[:, :2].copy()
    surface = fit(chart, breaks, vertices, normals, uv, periodic=periodic, degree=degree)
    for _ in range(2):
        found, normals = surface.at(uv)
        uv = uv + chart.between(chart.coordinates(found), target)  # its lines are nearly, not quite, the spline's
        surface = fit(chart, breaks, vertices, normals, uv, periodic=periodic, degree=degree)
    return surface, np.einsum("ki,ki->k", vertices - surface.at(uv)[0], normals)


def _sampled(target: Points, apart: Span, window: _Window) -> tuple[Breaks, tuple[int, int]]:
    """Return breaks at the rings and columns of vertices, or, where there are none, evenly spaced; and the degree."""
    low, high = float(target[:, 0].min()), float(target[:, 0].max())
    begin, end = window.span[1]
    rings, columns = clusters(target[:, 0], 0.3 * apart[0]), clusters(target[:, 1], 0.3 * apart[1])
    if len(rings) * 6 > len(target) or len(rings) < 2:  # none: as many pieces as vertices, evenly
        sides = (high - low) / apart[0], (end - begin) / apart[1]
        share = np.sqrt(len(target) / (sides[0] * sides[1]))
        counts = [max(1, min(most, round(side * share))) for side, most in zip(sides, _MOST_SPANS, strict=True)]
        return (np.linspace(low, high, counts[0] + 1), np.linspace(begin, end, counts[1] + 1)), _FINE
    each = len(target) / len(rings)
    degree = min(_FINE[0], len(rings) - 1), _FINE[1]
    along = breaks_at(rings, degree[0])
    if not 0.7 * each <= len(columns) <= 1.4 * each:  # staggered from ring to ring
        return (along, np.linspace(begin, end, min(_MOST_SPANS[1], round(each)) + 1)), degree
    return (
        along,
        np.append(columns, columns[0] + 2 * np.pi) if window.periodic else breaks_at(columns, degree[1]),
    ), degree
