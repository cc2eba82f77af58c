"""Fit control points on the lines of a chart by linear least squares in their offsets, without iteration."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from palpate.errors import GeometryError
from palpate.sensors.taxels.skin_map.chart import Chart
from palpate.sensors.taxels.skin_map.knots import Breaks
from palpate.spatial.arguments import takes_arrays
from palpate.surfaces.bspline import BSplineSurface, greville, open_knots, periodic_knots

__all__ = ["fit"]

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

    The paper solves it by iteration [skin, (4)]; it is linear in s. Only the distance along d counts, the normal at
    point Q: along the surface a point's parameters need not be exact.

    Args:
        chart: the lines A + s D.
        breaks: of the spline's pieces, in u and v.
        points: (k, 3) of the mesh [m].
        directions: (k, 3) unit normals there.
        uv: (k, 2) their parameters.
        periodic: in v.
        degree: in u and v.

    Raises:
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
            "the mesh does not determine the surface there: use fewer control points, or another region."
        )
    control = starts + vector.reshape(*starts.shape[:2], 1) * spokes
    if periodic:
        control = np.concatenate([control, control[:, : degree[1]]], axis=1)
    return BSplineSurface(knots[0], knots[1], control, degree, periodic)


def _stiffness(places: tuple[np.ndarray, np.ndarray], periodic: bool, degree: int) -> Float[np.ndarray, "n w"]:
    """Return the sum of the squared second differences of the offsets along u and along v, as a band matrix."""
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
    """Return the matrix (k, n) of second differences of offsets, 0 where these are linear in their lines' places."""
    n = len(places)
    middle = np.arange(n) if periodic else np.arange(1, n - 1)
    gaps = np.diff(places, append=places[0] + 2 * np.pi)  # the last one counts only round an axis
    before, after = gaps[middle - 1], gaps[middle]
    out = np.zeros((n, n))
    out[middle, middle] = -2.0
    np.add.at(out, (middle, middle - 1), 2 * after / (before + after))
    np.add.at(out, (middle, (middle + 1) % n), 2 * before / (before + after))
    return out
