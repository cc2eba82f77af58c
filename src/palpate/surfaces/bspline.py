"""A tensor-product B-spline surface, open or periodic in its second parameter."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from palpate.errors import GeometryError, InputError
from palpate.spatial._arrays import Value, frozen, shaped
from palpate.spatial.arguments import frozen_value, takes_arrays
from palpate.surfaces.mesh import Mesh

_MOST = 5  # the highest degree: `_bspline.MOST` holds its basis functions


@frozen_value
class BSplineSurface(Value):
    """A B-spline surface r(u, v) = sum_ij N_i(u) M_j(v) P_ij [m], with r_u x r_v pointing out of the body.

    Attributes:
        knots_u: of N, n + degree + 1 of them; not falling.
        knots_v: of M, m + degree + 1 of them; not falling.
        control: (n, m, 3) points P_ij [m]; where v is periodic the last `degree` columns repeat the first.
        degree: in u and in v.
        periodic: v closes on itself.

    Raises:
        InputError: arrays of other shapes.
        GeometryError: a degree is not one of 1 to 5; knots decrease, span nothing or do not fit control points and
            degrees; a control point is not finite.
    """

    knots_u: Float[np.ndarray, " a"]
    knots_v: Float[np.ndarray, " b"]
    control: Float[np.ndarray, "n m 3"]
    degree: tuple[int, int] = (3, 3)
    periodic: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "control", frozen(self.control, tail=(3,), name="control"))
        for axis, name in enumerate(("knots_u", "knots_v")):
            knots, degree, count = frozen(getattr(self, name)), self.degree[axis], self.control.shape[axis]
            if not 1 <= degree <= _MOST or knots.shape != (count + degree + 1,) or count <= degree:
                raise GeometryError(
                    f"{len(knots)} {name} do not fit {count} control points of degree {degree}: {count + degree + 1} "
                    f"are needed, with a degree from 1 to {_MOST} and more control points than it."
                )
            if not np.all(np.diff(knots) >= 0) or not knots[degree] < knots[count]:
                raise GeometryError(f"{name} must not decrease, and must span a range.")
            object.__setattr__(self, name, knots)
        if not np.isfinite(self.control).all():
            raise GeometryError("control points must be finite.")

    @property
    def domain(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """First and last parameter of u, then of v: two pairs."""
        (p, q), (n, m) = self.degree, self.control.shape[:2]
        return (float(self.knots_u[p]), float(self.knots_u[n])), (float(self.knots_v[q]), float(self.knots_v[m]))

    @property
    def points(self) -> int:
        """Number of control points, without the repeated ones of a periodic surface."""
        n, m = self.control.shape[:2]
        return n * (m - self.degree[1] * self.periodic)

    def derivatives(self, uv: ArrayLike) -> Float[np.ndarray, "*batch 6 3"]:
        """Return position, r_u, r_v, r_uu, r_uv and r_vv at parameters (*batch, 2), (*batch, 6, 3) [m].

        Beyond an open end the surface goes on straight.

        Raises:
            InputError: the parameters have another shape.
        """
        from palpate.surfaces import _bspline  # compiled: loaded when first needed

        uv = shaped(uv, (..., 2), "uv")
        out = np.empty((*uv.shape[:-1], 6, 3))
        _bspline.evaluate(uv.reshape(-1, 2), *self._numbers, out.reshape(-1, 6, 3))
        return out

    def geodesics(
        self, begin: ArrayLike, step: float, steps: int
    ) -> tuple[Float[np.ndarray, "s m 6"], Float[np.ndarray, "s m 6"]]:
        """Return states (u, v, u', v', J, J') along geodesics from `begin` (m, 6), and their derivatives by length.

        Both are (steps + 1, m, 6), a state every `step` [m]. J is the distance between neighbours that start side by
        side: J'' = -K J, K the Gaussian curvature.

        Raises:
            InputError: `begin` has another shape.
        """
        from palpate.surfaces import _bspline  # compiled: loaded when first needed

        begin = shaped(begin, (None, 6), "begin")
        states, slopes = np.empty((2, steps + 1, *begin.shape))
        states[0] = begin
        _bspline.geodesics(float(step), *self._numbers, states, slopes)
        return states, slopes

    @property
    def _numbers(self) -> tuple[np.ndarray, np.ndarray, int, int, bool, np.ndarray]:
        """Arguments of the compiled loops."""
        return self.knots_u, self.knots_v, *self.degree, self.periodic, self.control

    def at(self, uv: ArrayLike) -> tuple[Float[np.ndarray, "*batch 3"], Float[np.ndarray, "*batch 3"]]:
        """Return points [m] and outward unit normals, (*batch, 3) each, at (*batch, 2): n = r_u x r_v / |r_u x r_v|.

        [skin] (5) prints r_u x r_u, which is zero.

        Raises:
            InputError: the parameters have another shape.
        """
        found = self.derivatives(uv)
        normals = np.cross(found[..., 1, :], found[..., 2, :])
        return found[..., 0, :], normals / np.linalg.norm(normals, axis=-1, keepdims=True)

    def nearest(self, points: ArrayLike, start: ArrayLike, steps: int = 6) -> Float[np.ndarray, "n 2"]:
        """Return parameters (n, 2) of the closest points to points (n, 3) [m], by Gauss-Newton from `start` (n, 2).

        Raises:
            InputError: points or start have another shape.
        """
        points = shaped(points, (None, 3), "points")
        uv = shaped(start, (len(points), 2), "start").copy()
        for _ in range(steps):
            found = self.derivatives(uv)
            uv += solve_tangent(found[:, 1:3], points - found[:, 0])
        return uv

    def mesh(self, rows: int, columns: int) -> Mesh:
        """Return a `Mesh` of 2 rows x columns triangles with corners on the surface.

        Raises:
            GeometryError: no triangle has an area.
        """
        (low_u, high_u), (low_v, high_v) = self.domain
        u, v = np.linspace(low_u, high_u, rows + 1), np.linspace(low_v, high_v, columns + 1)
        points, _ = self.at(np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1))
        first = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).reshape(-1)
        across, up = first + 1, first + columns + 1
        faces = np.concatenate([np.stack([first, up, across], 1), np.stack([across, up, up + 1], 1)])
        return Mesh.from_arrays(points.reshape(-1, 3), faces)


@takes_arrays
def solve_tangent(
    tangents: Float[np.ndarray, "*batch 2 3"], vectors: Float[np.ndarray, "*batch 3"]
) -> Float[np.ndarray, "*batch 2"]:
    """Return steps in u and v, (*batch, 2), for which r_u du + r_v dv is nearest to each vector.

    Raises:
        InputError: other shapes.
    """
    u, v = tangents[..., 0, :], tangents[..., 1, :]
    e, f, g = (np.einsum("...i,...i->...", *pair) for pair in ((u, u), (u, v), (v, v)))
    a, b = (np.einsum("...i,...i->...", side, vectors) for side in (u, v))
    return np.stack([g * a - f * b, e * b - f * a], axis=-1) / (e * g - f * f)[..., None]


def _breaks(breaks: ArrayLike, degree: int) -> Float[np.ndarray, " k"]:
    """Return the checked ends of spans."""
    found = shaped(breaks, (None,), "breaks")
    if not (len(found) > 1 and np.isfinite(found).all() and (np.diff(found) > 0).all()):
        raise InputError("breaks must be two or more finite numbers that increase.")
    if not 1 <= degree <= _MOST:
        raise InputError(f"degree must be from 1 to {_MOST}, not {degree}.")
    return found


@takes_arrays
def open_knots(breaks: ArrayLike, degree: int = 3) -> Float[np.ndarray, " k"]:
    """Return knots (k + 2 degree,) of `breaks` (k,), which repeat the first and the last `degree` + 1 times.

    Raises:
        InputError: breaks are not two or more finite numbers that increase, or the degree is not one of 1 to 5.
    """
    breaks = _breaks(breaks, degree)
    return np.concatenate([np.full(degree, breaks[0]), breaks, np.full(degree, breaks[-1])])


@takes_arrays
def periodic_knots(breaks: ArrayLike, degree: int = 3) -> Float[np.ndarray, " k"]:
    """Return knots (k + 2 degree,) of a closed curve; the last of `breaks` (k,) is the first again, a period later.

    Raises:
        InputError: breaks do not increase, or the degree is not one of 1 to 5; or arrays of other shapes.
    """
    breaks = _breaks(breaks, degree)
    period = breaks[-1] - breaks[0]
    around = np.concatenate([breaks[:-1] - period, breaks[:-1], breaks[:-1] + period])
    while len(around) < 3 * len(breaks) + 2 * degree:  # few spans: the period comes round more often
        around = np.concatenate([around[: len(breaks) - 1] - period, around, around[1 - len(breaks) :] + period])
    start = int(cast("Any", np.searchsorted(around, breaks[0])))
    return around[start - degree : start + len(breaks) + degree]


@takes_arrays
def greville(knots: Float[np.ndarray, " k"], degree: int) -> Float[np.ndarray, " n"]:
    """Return the parameters x_i (n,) of the n control points, means of `degree` knots: x = sum N_i(x) x_i.

    Raises:
        InputError: the degree is not one of 1 to 5, or there are too few knots for it; or arrays of other shapes.
    """
    if not 1 <= degree <= min(_MOST, len(knots) - 2):
        raise InputError(
            f"degree must be from 1 to {_MOST}, and at least 2 less than the {len(knots)} knots, not {degree}."
        )
    return np.lib.stride_tricks.sliding_window_view(knots[1:-1], degree).mean(axis=1)


@takes_arrays
def basis_matrices(
    knots: Float[np.ndarray, " k"], degree: int, places: Float[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, "n a"], Float[np.ndarray, "n a"]]:
    """Return values and slopes of all a basis functions at n parameters, (n, a) each; a = len(knots) - degree - 1.

    Raises:
        InputError: knots decrease, or are too few for the degree; or arrays of other shapes.
    """
    from scipy.interpolate import BSpline  # here: scipy is slow to import

    if not 0 <= degree < len(knots) - 1 or not (np.diff(knots) >= 0.0).all() or not knots[degree] < knots[-degree - 1]:
        raise InputError(f"knots must not decrease, and more than degree + 1 of them are needed (degree is {degree}).")
    spline = BSpline(knots, np.eye(len(knots) - degree - 1), degree)
    return np.asarray(spline(places)), np.asarray(spline(places, nu=1))
