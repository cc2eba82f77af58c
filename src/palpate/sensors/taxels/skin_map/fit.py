"""Choose the breaks of a spline, and fit its control points on the lines of a chart by linear least squares."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Float, Int

from palpate.errors import GeometryError
from palpate.sensors.taxels.skin_map.chart import Chart
from palpate.spatial.arguments import takes_arrays
from palpate.surfaces.bspline import BSplineSurface, greville, open_knots, periodic_knots

Breaks = tuple[Float[np.ndarray, " _"], Float[np.ndarray, " _"]]
Distance = Float[np.ndarray, " k"]
Fitted = tuple[BSplineSurface, Distance]  # and how far each point lies off it
Span = tuple[float, float]
UV = Float[np.ndarray, "k 2"]
_ROUNDS = 2  # of refinement
_STIFFNESS = 1e-6  # of second differences of s beside the data's mean: it decides where there are no data


@takes_arrays
def fit(
    chart: Chart,
    breaks: Breaks,
    points: Float[np.ndarray, "k 3"],
    directions: Float[np.ndarray, "k 3"],
    uv: Float[np.ndarray, "k 2"],
    *,
    periodic: bool,
    degree: tuple[int, int] = (3, 3),
) -> BSplineSurface:
    """Return the `BSplineSurface` of control points A_ij + s_ij D_ij with the least sum (d . (Q - r(u, v)))^2 over Q.

    This is [skin, (4)], which is linear in s. Parameters need not be exact, as only the distance along d counts.

    Args:
        chart: the lines A + s D.
        breaks: of the spline's pieces, in u and v.
        points: (k, 3) Q, of the mesh [m].
        directions: (k, 3) d, unit normals there.
        uv: (k, 2) their parameters.
        periodic: in v.
        degree: in u and v.

    Raises:
        InputError: breaks that do not ascend, or fewer than two; or arrays of other shapes.
        GeometryError: the points do not determine the surface.
    """
    from palpate.surfaces import _band, _bspline  # compiled: loaded when first needed

    knots = open_knots(breaks[0], degree[0]), (periodic_knots if periodic else open_knots)(breaks[1], degree[1])
    places = greville(knots[0], degree[0]), greville(knots[1], degree[1])
    if periodic:
        places = places[0], places[1][: -degree[1]]
    starts, spokes = (np.ascontiguousarray(part) for part in chart.lines(places[0][:, None], places[1][None, :]))
    band = _stiffness(places, periodic, degree[0]) * (_STIFFNESS * len(points) / starts[..., 0].size)
    vector = np.zeros(len(band))
    inside = np.clip(uv, [knots[0][degree[0]], -np.inf], [knots[0][-degree[0] - 1], np.inf])
    _bspline.normal_equations(inside, points, directions, *knots, *degree, starts, spokes, band, vector)
    if not _band.solve_band(band, vector):
        raise GeometryError(
            "the mesh has too few points to fit the surface: use fewer control points, or other heights and angles."
        )
    control = starts + vector.reshape(*starts.shape[:2], 1) * spokes
    if periodic:
        control = np.concatenate([control, control[:, : degree[1]]], axis=1)
    return BSplineSurface(knots[0], knots[1], control, degree, periodic)


def _stiffness(places: tuple[np.ndarray, np.ndarray], periodic: bool, degree: int) -> Float[np.ndarray, "n w"]:
    """Return the sum of squared second differences of the offsets along u and v, as a band matrix."""
    bends = _second_differences(places[0], False), _second_differences(places[1], periodic)
    along, across = (bend.T @ bend for bend in bends)
    n, m = len(along), len(across)
    out = np.zeros((n, m, min(n, max(degree, 2) + 1) * m))
    for step in range(min(n, 3)):
        out[: n - step, :, step * m] += np.diagonal(along, -step)[:, None]
    for j in range(m):
        out[:, j, : m - j] += across[j:, j]
    return out.reshape(n * m, -1)


def _second_differences(places: Float[np.ndarray, " n"], periodic: bool) -> Float[np.ndarray, "k n"]:
    """Return the matrix (k, n) of second differences, 0 for offsets that are linear in the places."""
    n = len(places)
    middle = np.arange(n) if periodic else np.arange(1, n - 1)
    gaps = np.diff(places, append=places[0] + 2 * np.pi)  # the last one counts only round an axis
    before, after = gaps[middle - 1], gaps[middle]
    out = np.zeros((n, n))
    out[middle, middle] = -2.0
    np.add.at(out, (middle, middle - 1), 2 * after / (before + after))
    np.add.at(out, (middle, (middle + 1) % n), 2 * before / (before + after))
    return out


def refined(
    fitted: Callable[[Breaks], Fitted], breaks: Breaks, uv: UV, narrowest: Span, control: int, enough: float
) -> Fitted:
    """Halve the spans, of u or of v, with most squared distance for each control point they cost, and fit again.

    Args:
        fitted: maps breaks to a surface and its distances from the points.
        breaks: at the start.
        uv: (k, 2) parameters of the points.
        narrowest: smallest span after halving, in u and in v.
        control: largest number of control points.
        enough: rms distance [m] that needs no refinement.

    Returns:
        The `BSplineSurface`, and the distance (k,) [m] of each point from it.
    """
    surface, distance = fitted(breaks)
    for rounds in range(_ROUNDS, 0, -1):
        spare = control - surface.points
        if float(np.sqrt(np.mean(distance**2))) < enough:
            break
        n = surface.control.shape[0]
        cost = surface.points // n, n  # a break in u is a row of control points
        fresh = _halved(breaks, uv, distance, narrowest, cost, -(-spare // rounds))
        if not any(fresh):
            break
        breaks = np.sort(np.concatenate([breaks[0], fresh[0]])), np.sort(np.concatenate([breaks[1], fresh[1]]))
        surface, distance = fitted(breaks)
    return surface, distance


def _halved(
    breaks: Breaks, uv: UV, distance: Distance, narrowest: Span, cost: tuple[int, int], spare: int
) -> tuple[list[float], list[float]]:
    """Return the middles of the spans of u and of v that are worth halving."""
    wanted: list[tuple[float, int, float]] = []
    spans = [
        np.clip(np.searchsorted(at, uv[:, axis], side="right") - 1, 0, len(at) - 2) for axis, at in enumerate(breaks)
    ]
    for axis, at in enumerate(breaks):
        left = _along(spans, uv, distance, axis, len(at) - 1) / cost[axis]
        wide = np.flatnonzero(np.diff(at) > 2.0 * narrowest[axis])
        wanted += [(float(left[k]), axis, float(0.5 * (at[k] + at[k + 1]))) for k in wide]
    chosen: tuple[list[float], list[float]] = ([], [])
    for _, axis, place in sorted(wanted, reverse=True):
        if cost[axis] <= spare:
            chosen[axis].append(place)
            spare -= cost[axis]
    return chosen


def _along(
    spans: list[Int[np.ndarray, " k"]], uv: UV, distance: Distance, axis: int, count: int
) -> Float[np.ndarray, " a"]:
    """Return the squared distance in each span of one axis that breaks of the other axis cannot remove."""
    places, line = np.unique(uv[:, axis], return_inverse=True)
    group = spans[1 - axis] * len(places) + line
    total = np.bincount(group, distance)
    gained = total**2 / np.maximum(np.bincount(group), 1)
    span = np.zeros(len(places), dtype=np.int64)
    span[line] = spans[axis]
    return np.bincount(span[np.arange(len(gained)) % len(places)], gained, minlength=count)


@takes_arrays
def clusters(values: Float[np.ndarray, " n"], spacing: float) -> Float[np.ndarray, " c"]:
    """Return the ascending means (c,) of groups of values (n,), in which neighbours differ by at most `spacing`.

    Raises:
        InputError: values has another shape.
    """
    ordered = np.sort(values)
    group = np.concatenate([[0], np.cumsum(np.diff(ordered) > spacing)])
    return np.bincount(group, ordered) / np.bincount(group)


@takes_arrays
def breaks_at(places: Float[np.ndarray, " n"], degree: int) -> Float[np.ndarray, " k"]:
    """Return breaks (k,) of an open spline with a control point for each place (n,): all but some next to the ends.

    Raises:
        InputError: places has another shape.
    """
    if len(places) <= degree + 1:
        return places[[0, -1]]
    if degree == 1:
        return places
    spare = (degree - 1) // 2
    return np.concatenate([places[:1], places[1 + spare : len(places) - 1 - spare], places[-1:]])
