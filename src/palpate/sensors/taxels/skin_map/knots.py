"""Where the pieces of a spline meet: more of them where the surface bends, or one for every vertex."""

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
    """Halve the spans, of u or of v, that leave most squared distance for the control points they cost.

    Args:
        fitted: breaks to a surface and its distances from the points.
        breaks: to begin with.
        uv: (k, 2) parameters of the points.
        narrowest: span in u and in v that is worth halving.
        control: points at most.
        enough: rms distance that needs no mending [m].
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
    """The middles of the spans of u and of v that are worth it."""
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
    """What is left in each span of one axis after the mean across it: what more breaks of the other cannot mend."""
    places, line = np.unique(uv[:, axis], return_inverse=True)
    group = spans[1 - axis] * len(places) + line
    total = np.bincount(group, distance)
    gained = total**2 / np.maximum(np.bincount(group), 1)
    span = np.zeros(len(places), dtype=np.int64)
    span[line] = spans[axis]
    return np.bincount(span[np.arange(len(gained)) % len(places)], gained, minlength=count)


@takes_arrays
def clusters(values: Float[np.ndarray, " n"], spacing: float) -> Float[np.ndarray, " c"]:
    """Means of the groups of values that lie closer together than `apart`."""
    ordered = np.sort(values)
    group = np.concatenate([[0], np.cumsum(np.diff(ordered) > spacing)])
    return np.bincount(group, ordered) / np.bincount(group)


@takes_arrays
def breaks_at(places: Float[np.ndarray, " n"], degree: int) -> Float[np.ndarray, " k"]:
    """Breaks of an open spline with as many control points as places: all of these, but for some beside the ends."""
    if len(places) <= degree + 1:
        return places[[0, -1]]
    if degree == 1:
        return places
    spare = (degree - 1) // 2
    return np.concatenate([places[:1], places[1 + spare : len(places) - 1 - spare], places[-1:]])
