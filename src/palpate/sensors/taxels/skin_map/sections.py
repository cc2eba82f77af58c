"""Cut a triangle mesh by two families of planes."""

from __future__ import annotations

from typing import Any, Literal, cast

import numpy as np
from jaxtyping import Float, Int

from palpate.sensors.taxels.skin_map.chart import Chart, wrapped
from palpate.spatial.arguments import frozen_value, takes_arrays

Ends = Float[np.ndarray, "s d"]
_SAME = 1e-12  # rad: a segment's end this close to a spoke meets it


@frozen_value
class Sections:
    """The outermost cut of the mesh on each line of a chart.

    Attributes:
        u: (n,) planes of the first family; v: (m,) of the second.
        offset: (n, m) along the line [m], -inf where the line misses the mesh.
        facet: (n, m) index of the facet that was cut, -1 where none.
    """

    u: Float[np.ndarray, " n"]
    v: Float[np.ndarray, " m"]
    offset: Float[np.ndarray, "n m"]
    facet: Int[np.ndarray, "n m"]


@takes_arrays
def cut(
    chart: Chart, triangles: Float[np.ndarray, "f 3 3"], u: Float[np.ndarray, " n"], v: Float[np.ndarray, " m"]
) -> Sections:
    """Find the outermost point of a triangle mesh on each line of a chart; return `Sections`.

    Triangles may be unconnected, doubled, or of inner bodies.

    Args:
        chart: the lines, in which a plane u and a plane v meet.
        triangles: (f, 3, 3) corners [m].
        u: (n,) planes of the first family, ascending [m].
        v: (m,) planes of the second family, ascending [m]; angles [rad] if the chart is round.

    Raises:
        InputError: arrays of other shapes.
    """
    ends, plane, facet = _segments(chart.local(triangles), u)
    line, segment, offset = _crossings(chart, ends, v)
    grid = np.full((len(u), len(v)), -np.inf)
    met = np.full((len(u), len(v)), -1, dtype=np.int64)
    order = np.argsort(offset, kind="stable")  # of several writes to one place the last stays
    place = plane[segment][order], line[order]
    grid[place], met[place] = offset[order], facet[segment][order]
    return Sections(u, v, grid, met)


def _segments(
    local: Float[np.ndarray, "f 3 3"], u: Float[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, "s 2 2"], Int[np.ndarray, " s"], Int[np.ndarray, " s"]]:
    """Return the cuts by planes u: their ends in the plane (s, 2, 2), and indices of plane and facet."""
    local = np.take_along_axis(local, np.argsort(local[..., 0], axis=1)[..., None], axis=1)
    height = local[..., 0]
    facet, plane = _runs(np.searchsorted(u, height[:, 0], "left"), np.searchsorted(u, height[:, 2], "right"))
    low, middle, high = np.moveaxis(local[facet], 1, 0)
    at = u[plane]
    below = (at < middle[:, 0])[:, None]
    short = np.where(below, _between(low, middle, at), _between(middle, high, at))
    return np.stack([_between(low, high, at), short], axis=1)[..., 1:], plane, facet


def _between(start: Ends, end: Ends, at: Float[np.ndarray, " s"]) -> Ends:
    """Return the points between start and end whose first coordinate is `at`; start if it does not rise."""
    low = start[:, 0]
    rise = end[:, 0] - low
    share = np.where(rise > 0, at - low, 0.0) / np.where(rise > 0, rise, 1.0)
    return start + share[:, None] * (end - start)


def _crossings(
    chart: Chart, ends: Float[np.ndarray, "s 2 2"], v: Float[np.ndarray, " m"]
) -> tuple[Int[np.ndarray, " k"], Int[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """Return the lines that cross segments, those segments, and the offsets [m] along the lines."""
    if not chart.round:
        begin, end = ends[..., 0].min(axis=1), ends[..., 0].max(axis=1)
        segment, line = _runs(_places(v, begin, "left"), _places(v, end, "right"))
        a, b = ends[segment, 0], ends[segment, 1]
        backward = b[:, 0] < a[:, 0]
        return line, segment, np.where(backward, _between(b, a, v[line])[:, 1], _between(a, b, v[line])[:, 1])
    angle = np.arctan2(ends[..., 1], ends[..., 0])
    turn = wrapped(angle[:, 1] - angle[:, 0])  # a segment is seen under less than half a turn
    begin = np.where(turn >= 0, angle[:, 0], angle[:, 0] + turn)
    begin = v[0] + np.mod(begin - v[0], 2 * np.pi)
    tiled = np.concatenate([v, v + 2 * np.pi])
    end = begin + np.abs(turn)
    segment, line = _runs(_places(tiled, begin - _SAME, "left"), _places(tiled, end + _SAME, "right"))
    line = line % len(v)
    a, side = ends[segment, 0], ends[segment, 1] - ends[segment, 0]
    x, y = np.cos(v[line]), np.sin(v[line])
    across = x * side[:, 1] - y * side[:, 0]
    usable = np.abs(across) > 1e-9 * np.abs(side).max(axis=1)
    met = (a[:, 0] * side[:, 1] - a[:, 1] * side[:, 0]) / np.where(usable, across, 1.0)
    return line, segment, cast("Any", np.where(usable, met, np.hypot(a[:, 0], a[:, 1])))


def _places(planes: np.ndarray, at: np.ndarray, side: Literal["left", "right"]) -> Int[np.ndarray, " n"]:
    return cast("Any", np.searchsorted(planes, at, side=side))


def _runs(first: Int[np.ndarray, " n"], last: Int[np.ndarray, " n"]) -> tuple[np.ndarray, np.ndarray]:
    """Return, for all integers from first to before last of each entry, the entry's index and the integer."""
    count = np.maximum(last - first, 0)
    owner = np.repeat(np.arange(len(count)), count)
    start = np.repeat(first - np.concatenate([[0], np.cumsum(count)[:-1]]), count)
    return owner, start + np.arange(len(owner))
