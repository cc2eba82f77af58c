"""Lay a sheet that does not stretch on a surface: geodesics first, then the least squared Green strain.

The edge from the origin along the heading becomes a geodesic, and so does every line across it. In these coordinates
the metric is J^2 dx^2 + dy^2 with J_yy = -K J, J = 1 and J_y = 0 on the edge, so that where K = 0 the sheet is
unrolled. Elsewhere splines over the sheet are found by Gauss-Newton so that

    W = integral |E|^2 dx dy,   E = (F'F - I)/2,   F = [r_x r_y]

is least. The corner stays, and the first edge meets the geodesic again after two cells.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import inf, isfinite
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from palpate.calls import called_as
from palpate.errors import InputError
from palpate.spatial.arguments import takes_arrays
from palpate.spatial.gauss_newton import gauss_newton
from palpate.surfaces.bspline import basis_matrices, greville, open_knots, solve_tangent

__all__ = ["Bounds", "LaidSheet", "Parametric", "Sheet"]

_STEP = 2e-3  # m, of the geodesics' Runge-Kutta
_MOST_ELEMENTS = 64  # along either side of the sheet: a cell of a fine one is smaller than what it has to follow
_FLAT = 1e-7  # rms strain of a sheet that lies without any
_BENT = 2e-3  # rms strain of the geodesics from which the splines alone carry the sheet: geodesics echo every dent
_ROUNDS = 12
_PER = 2  # elements a cell, along either side
_HELD = 2  # cells from the corner to where the first edge meets its geodesic
_EVERYWHERE = ((-inf, inf), (-inf, inf))
_HANGING = 0.01  # weight of what hangs beyond the surface beside what lies on it


Bounds = tuple[tuple[float, float], tuple[float, float]]
Grid = Float[np.ndarray, "a b 2"]  # control points or parameters, on a lattice
_Anchor = tuple[Float[np.ndarray, " b"], Float[np.ndarray, "2"]]


@runtime_checkable
class Parametric(Protocol):
    """A surface on which a sheet can be laid."""

    def derivatives(self, uv: Float[np.ndarray, "*batch 2"]) -> Float[np.ndarray, "*batch 6 3"]:
        """Return position, r_u, r_v, r_uu, r_uv and r_vv, (..., 6, 3); r_u x r_v points out."""
        ...

    def geodesics(self, begin: Float[np.ndarray, "m 6"], step: float, steps: int) -> tuple[np.ndarray, np.ndarray]:
        """Return two arrays (steps + 1, m, 6) along m geodesics: states and their derivatives by arc length.

        A state is u, v, u', v', the spread J of neighbouring geodesics, and J'. `begin` holds the first states, (m, 6);
        `step` is a length [m].

        Raises:
            InputError: `begin` has another shape.
        """
        ...


@called_as("palpate.Sheet(6, 22, (0.01, 0.01))")
@dataclass(frozen=True)
class Sheet:
    """A flat sheet of cells before it is laid.

    Attributes:
        rows: number of rows of cells.
        columns: number of columns of cells.
        pitch: between rows, and between columns [m].
        thickness: of the material between the link and the sensing layer [m].
        flip: rows increase to the right of the heading, seen from outside; else to the left.
        stretch: factors across rows, and along them.

    Raises:
        InputError: no cells, a pitch or stretch that is not positive, or a thickness that is not finite.
    """

    rows: int
    columns: int
    pitch: tuple[float, float]
    thickness: float = 0.0
    flip: bool = False
    stretch: tuple[float, float] = (1.0, 1.0)

    def __post_init__(self) -> None:
        if min(self.rows, self.columns) < 1:
            raise InputError(
                f"rows and columns must each be at least 1, not {self.rows} x {self.columns}.", where="sheet"
            )
        for name, values in {"cell": self.pitch, "stretch": self.stretch}.items():
            if not all(isfinite(value) and value > 0 for value in values):
                raise InputError(f"must be two positive numbers, not {values}.", where=name)
        if not isfinite(self.thickness):
            raise InputError(f"must be a number, not {self.thickness}.", where="thickness")

    @property
    def size(self) -> tuple[float, float]:
        """Return the sheet's size, stretched, as (across rows, along rows) [m]."""
        return self.rows * self.pitch[0] * self.stretch[0], self.columns * self.pitch[1] * self.stretch[1]


@dataclass(frozen=True, eq=False)
class LaidSheet:
    """Places of a sheet's lattice on a surface, and its strain.

    Attributes:
        uv: (2 r + 1, 2 c + 1, 2) parameters of cells' corners (even indices), centres (odd) and the middles of sides.
        rms: root mean square of the principal strains.
        worst: the principal strain that is farthest from 0.
        rounds: number of Gauss-Newton steps.
    """

    uv: Grid
    rms: float
    worst: float
    rounds: int


@takes_arrays
def lay(
    surface: Parametric,
    start: Float[np.ndarray, "2"],
    heading: Float[np.ndarray, "3"],
    sheet: Sheet,
    *,
    bounds: Bounds = _EVERYWHERE,
    elements: int = _MOST_ELEMENTS,
    look: Callable[[Grid], None] | None = None,
) -> LaidSheet:
    """Lay a sheet on a surface with its corner at `start`; return a `LaidSheet`.

    Args:
        surface: the surface.
        start: (2,) parameters of the outer corner of cell (0, 0).
        heading: (3,) the direction of increasing column there; its part along the surface counts.
        sheet: the sheet; its thickness does not matter.
        bounds: of u and of v, beyond which strain hardly counts.
        elements: largest number of elements of the spline along either side.
        look: called with the lattice along geodesics, before the strain is minimised.

    Raises:
        InputError: arrays of other shapes.
        LinAlgError: the strain does not determine the layout.
    """
    size, cells = sheet.size, (sheet.rows, sheet.columns)
    sign = -1.0 if sheet.flip else 1.0
    coarse, fine = (_Grid(size, [max(2, min(per * count, elements)) for count in cells]) for per in (1, _PER))
    lattice = [np.linspace(0.0, length, 2 * count + 1) for length, count in zip(size, cells, strict=True)]
    y, x = (np.unique(np.concatenate(places)) for places in zip(fine.gauss, coarse.nodes, lattice, strict=True))

    def at(places: list[Float[np.ndarray, " _"]]) -> Float[np.ndarray, "_ _ 6"]:
        return fan[np.ix_(np.searchsorted(y, places[0]), np.searchsorted(x, places[1]))]

    fan = _fan(surface, start, heading, x, y, sign)
    if look is not None:
        look(at(lattice)[..., :2])
    held = lattice[1][2 * min(_HELD, cells[1])]
    side = _across(surface, fan[0, np.searchsorted(x, held)])
    problem, laid = _Problem(surface, bounds, fine, at(fine.gauss)), at(lattice)[..., :2]
    control = np.zeros((*fine.shape, 2))
    strain, _, _, weights = problem.strain(control)
    if np.sqrt(_energy(strain, weights)) > _BENT:  # without geodesics, and first on elements as large as cells
        first = _Problem(surface, bounds, coarse, None)
        control, _ = first.solve(coarse.through(at(coarse.nodes)[..., :2]), (coarse.along(held), side), 0.2)
        control = fine.through(coarse.at(control, fine.nodes))
        problem, laid = _Problem(surface, bounds, fine, None), np.zeros_like(laid)
    control, rounds = problem.solve(control, (fine.along(held), side))
    strain, _, _, weights = problem.strain(control)
    return LaidSheet(laid + fine.at(control, lattice), *_principal(strain, weights), rounds)


class _Grid:
    """Cubic splines over the sheet: their knots, the Gauss points of their elements, and their nodes."""

    def __init__(self, size: tuple[float, float], spans: list[int]) -> None:
        sides = list(zip(size, spans, strict=True))
        self.knots = [open_knots(np.linspace(0.0, length, count + 1)) for length, count in sides]
        self.gauss = [_gauss(length, count) for length, count in sides]
        self.nodes = [greville(knots, 3) for knots in self.knots]
        self.bases = [basis_matrices(knots, 3, places) for knots, places in zip(self.knots, self.gauss, strict=True)]

    @property
    def shape(self) -> tuple[int, int]:
        return len(self.nodes[0]), len(self.nodes[1])

    def through(self, values: Grid) -> Grid:
        left, right = (np.linalg.inv(basis_matrices(k, 3, n)[0]) for k, n in zip(self.knots, self.nodes, strict=True))
        return _spread(left, values, right)

    def at(self, control: Grid, places: list[Float[np.ndarray, " _"]]) -> Float[np.ndarray, "n m 2"]:
        left, right = (basis_matrices(k, 3, p)[0] for k, p in zip(self.knots, places, strict=True))
        return _spread(left, control, right)

    def along(self, place: float) -> Float[np.ndarray, " b"]:
        """Return the weights of the first edge's control points at a place on it."""
        return basis_matrices(self.knots[1], 3, np.array([place]))[0][0]


def _across(surface: Parametric, state: Float[np.ndarray, "6"]) -> Float[np.ndarray, "2"]:
    """Return the distances by which unit steps in u and in v go across the edge."""
    at = surface.derivatives(state[:2])
    side = np.cross(np.cross(at[1], at[2]), state[2:4] @ at[1:3])
    return at[1:3] @ (side / np.linalg.norm(side))


def _gauss(length: float, spans: int) -> Float[np.ndarray, " n"]:
    step = length / spans
    return ((np.arange(spans)[:, None] + 0.5 + np.array([-0.5, 0.5]) / np.sqrt(3.0)) * step).reshape(-1)


def _fan(
    surface: Parametric,
    start: Float[np.ndarray, "2"],
    heading: Float[np.ndarray, "3"],
    x: Float[np.ndarray, " m"],
    y: Float[np.ndarray, " n"],
    sign: float,
) -> Float[np.ndarray, "n m 6"]:
    """Return parameters, and their derivatives along x and y, where geodesics from a geodesic edge reach y."""
    at = surface.derivatives(start)
    along = solve_tangent(at[1:3], heading)
    along /= np.linalg.norm(along @ at[1:3])
    edge = _geodesic(surface, np.concatenate([start, along, [1.0, 0.0]])[None], x)[:, 0]
    found = surface.derivatives(edge[:, :2])
    across = solve_tangent(found[:, 1:3], sign * np.cross(_normals(found), _pushed(edge[:, 2:4], found)))
    begin = np.concatenate([edge[:, :2], across, np.ones((len(x), 1)), np.zeros((len(x), 1))], axis=1)
    fan = _geodesic(surface, begin, y)
    found = surface.derivatives(fan[..., :2])
    turned = np.cross(_pushed(fan[..., 2:4], found), _normals(found))
    sideways = solve_tangent(found[..., 1:3, :], sign * fan[..., 4:5] * turned)
    return np.concatenate([fan[..., :2], sideways, fan[..., 2:4]], axis=-1)


def _normals(found: Float[np.ndarray, "*batch 6 3"]) -> Float[np.ndarray, "*batch 3"]:
    normal = np.cross(found[..., 1, :], found[..., 2, :])
    return normal / np.linalg.norm(normal, axis=-1, keepdims=True)


def _pushed(
    steps: Float[np.ndarray, "*batch 2"], found: Float[np.ndarray, "*batch 6 3"]
) -> Float[np.ndarray, "*batch 3"]:
    return np.einsum("...k,...kd->...d", steps, found[..., 1:3, :])


def _geodesic(
    surface: Parametric, begin: Float[np.ndarray, "m 6"], places: Float[np.ndarray, " n"]
) -> Float[np.ndarray, "n m 6"]:
    """Return states (u, v, u', v', J, J') along unit-speed geodesics at lengths from 0, by Runge-Kutta (4)."""
    steps = max(1, int(np.ceil(places[-1] / _STEP)))
    h = places[-1] / steps
    y, k = surface.geodesics(begin, h, steps)
    number = np.clip((places / h).astype(np.int64), 0, steps - 1)
    t = (places / h - number)[:, None, None]
    k = k * h
    a, b, p, q = y[number], y[number + 1], k[number], k[number + 1]
    return a + t * (p + t * (3 * (b - a) - 2 * p - q + t * (2 * (a - b) + p + q)))


class _Problem:
    """The strain at Gauss points as a function of control points, and its least-squares solution."""

    def __init__(
        self,
        surface: Parametric,
        bounds: Bounds,
        grid: _Grid,
        fan: Float[np.ndarray, "n m 6"] | None,
    ) -> None:
        self.surface, self.bounds = surface, np.array(bounds)
        (self.by, self.dy), (self.bx, self.dx) = grid.bases
        self.fan = np.zeros((len(self.by), len(self.bx), 6)) if fan is None else fan

    def strain(self, control: Grid) -> tuple[np.ndarray, ...]:
        """Return E_xx, E_yy and E_xy (n, m, 3), the surface, the parameters' slopes by x and y, and weights there."""
        uv = self.fan[..., :2] + _spread(self.by, control, self.bx)
        ux = self.fan[..., 2:4] + _spread(self.by, control, self.dx)
        uy = self.fan[..., 4:6] + _spread(self.dy, control, self.bx)
        found = self.surface.derivatives(uv)
        rx, ry = _pushed(ux, found), _pushed(uy, found)
        xx, yy, xy = (0.5 * np.einsum("...d,...d->...", *pair) for pair in ((rx, rx), (ry, ry), (rx, ry)))
        there = np.all((uv >= self.bounds[:, 0]) & (uv <= self.bounds[:, 1]), axis=-1)
        weights = np.where(there, 1.0, _HANGING)
        return np.stack([xx - 0.5, yy - 0.5, xy], axis=-1), found, np.stack([ux, uy], axis=2), weights

    def solve(
        self,
        control: Grid,
        anchor: _Anchor,
        enough: float = 1e-3,
    ) -> tuple[Grid, int]:
        """Minimise by Gauss-Newton until a step gains less than a share `enough`."""

        def look(control: Grid) -> tuple[float, Callable[[], tuple[np.ndarray, np.ndarray]]]:
            state = self.strain(control)
            return max(_energy(state[0], state[3]), _FLAT**2), lambda: self._equations(state, anchor)

        found = gauss_newton(control, look, solve=self._step, rounds=_ROUNDS, enough=enough)
        return found.place, found.rounds

    def _equations(self, state: tuple[np.ndarray, ...], anchor: _Anchor) -> tuple[np.ndarray, np.ndarray]:
        """Return the banded matrix and the right side of the least linearised strain."""
        from palpate.sensors.taxels.skin_map import _strain  # compiled: loaded when first needed

        rows, columns = self.by.shape[1], self.bx.shape[1]
        strides = (1, rows) if rows <= columns else (columns, 1)
        band = np.zeros((2 * rows * columns, 2 * (3 * min(rows, columns) + 3) + 2))
        step = np.zeros(len(band))
        local = [part for base in ((self.by, self.dy), (self.bx, self.dx)) for part in _narrow(*base)]
        _strain.normal_equations(*state, *local, *strides, band, step)
        _hold(band, anchor, strides[1])
        return band, step

    def _step(self, band: Float[np.ndarray, "k n"], step: Float[np.ndarray, " k"], damping: float) -> Grid:
        """Return the solution of the banded equations."""
        from palpate.surfaces import _band  # compiled: loaded when first needed

        rows, columns = self.by.shape[1], self.bx.shape[1]
        band, step = band.copy(), step.copy()
        band[:, 0] *= 1.0 + damping
        if not _band.solve_band(band, step):
            raise np.linalg.LinAlgError("the strain does not determine the layout")
        return step.reshape(rows, columns, 2) if rows > columns else np.swapaxes(step.reshape(columns, rows, 2), 0, 1)


def _hold(band: Float[np.ndarray, "k n"], anchor: _Anchor, stride: int) -> None:
    """Add stiff springs at the corner, and across the heading at a point of the first edge."""
    share, side = anchor
    stiff = 1e6 * float(band[:, 0].max())
    band[:2, 0] += stiff
    near = np.flatnonzero(np.abs(share) > 1e-9)
    near = near[near > 0]  # the first control point is held already
    number = (2 * stride * near[:, None] + np.arange(2)).reshape(-1)
    row = (share[near, None] * side).reshape(-1) / np.abs(side).max()
    for i, a in zip(number, row, strict=True):
        for j, b in zip(number, row, strict=True):
            if i >= j:
                band[j, i - j] += stiff * a * b


def _spread(
    left: Float[np.ndarray, "n a"], control: Grid, right: Float[np.ndarray, "m b"]
) -> Float[np.ndarray, "n m 2"]:
    return np.moveaxis(left @ np.moveaxis(control, -1, 0) @ right.T, 0, -1)


def _narrow(values: Float[np.ndarray, "n a"], slopes: Float[np.ndarray, "n a"]) -> tuple[np.ndarray, ...]:
    """Return the four cubics that are not zero at each place: index of the first, values and slopes."""
    first = np.argmax(values != 0.0, axis=1)
    first = np.minimum(first, values.shape[1] - 4)
    near = first[:, None] + np.arange(4)
    return first, np.take_along_axis(values, near, axis=1), np.take_along_axis(slopes, near, axis=1)


def _energy(strain: Float[np.ndarray, "n m 3"], weights: Float[np.ndarray, "n m"]) -> float:
    """Return the mean |E|^2, the mean of the sum of both squared principal strains."""
    return float(np.sum(weights * (np.square(strain) @ np.array([1.0, 1.0, 2.0]))) / np.sum(weights))


def _principal(strain: Float[np.ndarray, "n m 3"], weights: Float[np.ndarray, "n m"]) -> tuple[float, float]:
    """Return the root mean square of the principal strains, and the one farthest from 0."""
    xx, yy, xy = np.moveaxis(strain, -1, 0)
    middle, radius = 0.5 * (xx + yy), np.hypot(0.5 * (xx - yy), xy)
    both = np.stack([middle - radius, middle + radius]) * (weights == 1.0)
    return float(np.sqrt(0.5 * _energy(strain, weights))), float(both.reshape(-1)[np.argmax(np.abs(both))])
