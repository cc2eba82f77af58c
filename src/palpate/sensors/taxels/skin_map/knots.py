"""Choose the breaks between a spline's pieces: more of them where the surface bends, or one for every vertex."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Float, Int

from palpate.spatial.arguments import takes_arrays
from palpate.surfaces.bspline import BSplineSurface

__all__ = ["Breaks", "Fitted", "Span", "breaks_at", "clusters", "refined"]

Breaks = tuple[Float[np.ndarray, " _"], Float[np.ndarray, " _"]]
Distance = Float[np.ndarray, " k"]
Fitted = tuple[BSplineSurface, Distance]  # and how far each point lies off it
Span = tuple[float, float]
UV = Float[np.ndarray, "k 2"]
_ROUNDS = 2


def refined(
    fitted: Callable[[Breaks], Fitted], breaks: Breaks, uv: UV, narrowest: Span, control: int, enough: float
) -> Fitted:
    """Halve the spans, of u or of v, that have most squared distance for each control point they cost, and fit again.

    Args:
        fitted: maps breaks to a surface and its distances from the points.
        breaks: at the start.
        uv: (k, 2) parameters of the points.
        narrowest: smallest span, in u and in v, after halving.
        control: largest number of control points.
        enough: rms distance that needs no refinement [m].

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
    """Return the squared distance in each span of one axis that more breaks of the other axis cannot remove."""
    places, line = np.unique(uv[:, axis], return_inverse=True)
    group = spans[1 - axis] * len(places) + line
    total = np.bincount(group, distance)
    gained = total**2 / np.maximum(np.bincount(group), 1)
    span = np.zeros(len(places), dtype=np.int64)
    span[line] = spans[axis]
    return np.bincount(span[np.arange(len(gained)) % len(places)], gained, minlength=count)


@takes_arrays
def clusters(values: Float[np.ndarray, " n"], spacing: float) -> Float[np.ndarray, " c"]:
    """Return the means (c,) of groups of values; neighbours in a group differ by at most `spacing`."""
    ordered = np.sort(values)
    group = np.concatenate([[0], np.cumsum(np.diff(ordered) > spacing)])
    return np.bincount(group, ordered) / np.bincount(group)


@takes_arrays
def breaks_at(places: Float[np.ndarray, " n"], degree: int) -> Float[np.ndarray, " k"]:
    """Return breaks of an open spline with a control point for each place: all places but some next to the ends."""
    if len(places) <= degree + 1:
        return places[[0, -1]]
    if degree == 1:
        return places
    spare = (degree - 1) // 2
    return np.concatenate([places[:1], places[1 + spare : len(places) - 1 - spare], places[-1:]])
