"""The older papers' method, as a baseline: Levenberg-Marquardt from a first guess, on a surface with an equation.

Unknown are the point p and a number k; the equations are [bicchi; probe (4); liu]

    M - p x F + k grad S(p) = 0,    S(p) = 0,

so that the torque about the outward normal is -k |grad S|. Nothing keeps the point on the touched part of the surface,
as the `probe` paper remarks: the result has the end point, and its `status` must be checked. A mesh has no S; as in
that paper a paraboloid is then fitted to the touched region.
"""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from palpate.contact.estimate import Status
from palpate.errors import GeometryError, InputError
from palpate.spatial._arrays import frozen, shaped
from palpate.spatial.arguments import frozen_value, takes_arrays
from palpate.spatial.pose import skew
from palpate.surfaces.mesh import Mesh

RINGS, SPOKES = 5, 12  # where a mesh is asked for its surface about a point
POOR_FIT = 0.05  # of the region's radius: the largest rms distance between paraboloid and mesh
CONVERGED = 1e-6  # of |F| times the surface's size, and of that size
STEPS = 200  # the most evaluations of the equations
ALONG = 65  # samples of the wrench axis in search of a start


@runtime_checkable
class Equation(Protocol):
    """A surface S(p) = 0 with S < 0 inside, each method for points (n, 3) [m]."""

    @property
    def size(self) -> float:
        """Diameter of the complete surface [m]."""
        ...

    @property
    def centre(self) -> Float[np.ndarray, "3"]:
        """Middle of the surface (3,) [m]."""
        ...

    def value(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """Return S at points (n, 3) [m] as (n,), negative inside."""
        ...

    def gradient(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Return the gradient of S at points (n, 3) [m] as (n, 3) [unit of S per m]."""
        ...

    def hessian(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3 3"]:
        """Return the second derivatives of S at points (n, 3) [m] as (n, 3, 3) [unit of S per m^2]."""
        ...


@frozen_value
class IterativeResult:
    """Result of the iteration: its end point, and its status.

    Attributes:
        point: (3,) [m]; normal: (3,) outward; force: (3,) [N] on the body.
        torque: [N m] about the normal.
        residual: largest error of the equations: moments over |F| times the surface's size, S over its slope and size.
        evaluations: number of evaluations of the equations.
        within: whether the point lies where the equation is valid (a fitted paraboloid is valid in its region only).
        status: CONTACT; IMPLAUSIBLE beyond the friction or torsion bound; OFF_SURFACE if it did not converge, the force
            pulls instead of pressing, or the point is outside the region; NO_CONTACT and INVALID as everywhere.
    """

    point: Float[np.ndarray, "3"]
    normal: Float[np.ndarray, "3"]
    force: Float[np.ndarray, "3"]
    torque: float
    residual: float
    evaluations: int
    within: bool
    status: Status

    @property
    def converged(self) -> bool:
        """True if `residual`, the largest error of the equations, is at most 1e-6."""
        return self.residual <= CONVERGED


@frozen_value
class PatchParaboloid:
    """A paraboloid z = a + b x + c y + d x^2 + e x y + f y^2 in a local frame, fitted to a region of a mesh.

    Attributes:
        origin: (3,) [m] the region's middle; axes: (3, 3) rows x, y, z of the frame, z outward.
        coefficients: (6,) a [m], b, c, and d, e, f [1/m].
        radius: [m] of the region; beyond it the equation is not valid.
        misfit: [m] rms distance along z between the paraboloid and the mesh in the region.
    """

    origin: Float[np.ndarray, "3"]
    axes: Float[np.ndarray, "3 3"]
    coefficients: Float[np.ndarray, "6"]
    radius: float
    misfit: float

    @property
    def size(self) -> float:
        """Diameter of the region [m]."""
        return 2.0 * self.radius

    @property
    def centre(self) -> Float[np.ndarray, "3"]:
        """Middle of the region (3,) [m]."""
        return self.origin

    def value(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """Return the height of points (n, 3) [m] over the paraboloid, (n,) [m].

        Raises:
            InputError: points has another shape.
        """
        local = (points - self.origin) @ self.axes.T
        return local[:, 2] - _monomials(local) @ self.coefficients

    def gradient(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Return the gradient of `value` at points (n, 3) [m] as (n, 3), without unit.

        Raises:
            InputError: points has another shape.
        """
        x, y, _ = ((points - self.origin) @ self.axes.T).T
        _, b, c, d, e, f = self.coefficients
        return np.stack([-b - 2 * d * x - e * y, -c - e * x - 2 * f * y, np.ones(len(points))], axis=1) @ self.axes

    def hessian(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3 3"]:
        """Return the second derivatives of `value`, the same at all points, (n, 3, 3) [1/m].

        Raises:
            InputError: points has another shape.
        """
        d, e, f = self.coefficients[3:]
        local = np.array([[-2 * d, -e, 0.0], [-e, -2 * f, 0.0], [0.0, 0.0, 0.0]])
        return np.broadcast_to(self.axes.T @ local @ self.axes, (len(points), 3, 3))


@takes_arrays
def locate_iteratively(
    wrench: Float[np.ndarray, "6"],
    surface: Equation,
    start: ArrayLike | None = None,
    *,
    jacobian: str = "analytic",
    friction: float = 1.0,
    torsion: float = 5e-3,
) -> IterativeResult:
    """Return the contact of one wrench as an `IterativeResult`, from Levenberg-Marquardt of scipy on four equations.

    Args:
        wrench: (6,) [N, N m] in the surface's frame, force first.
        surface: one with an equation; for a mesh, the result of `fit_paraboloid`.
        start: (3,) [m] the first guess; None: the point at which the wrench axis enters, or passes nearest.
        jacobian: "analytic"; "numeric" takes differences, and needs no Hessian.
        friction: bound on tan(theta), theta between -force and normal.
        torsion: bound on |torque|/|F . n| [m].

    Raises:
        InputError: another `jacobian`; or a wrench or start of another shape.
    """
    if jacobian not in ("analytic", "numeric"):
        raise InputError(f"unknown Jacobian {jacobian!r}.", hint="Use analytic or numeric.")
    force, moment = np.array(wrench[:3], dtype=np.float64), np.array(wrench[3:], dtype=np.float64)
    if not np.all(np.isfinite(wrench)):
        return _nothing(force, Status.INVALID)
    if not np.any(force):
        return _nothing(force, Status.NO_CONTACT)
    first = _entry(surface, force, moment) if start is None else shaped(start, (3,), "start")
    point, k, residual, evaluations = _solve(surface, force, moment, first, jacobian == "analytic")
    slope = surface.gradient(point[None])[0]
    steepness = float(np.linalg.norm(slope))
    normal, torque = slope / steepness, -k * steepness
    within = bool(np.linalg.norm(point - surface.centre) <= surface.size / 2 * (1 + 1e-9))
    pressing = -float(force @ normal)
    status = Status.CONTACT
    if not (residual <= CONVERGED and within and pressing > 0):
        status = Status.OFF_SURFACE
    elif np.linalg.norm(np.cross(force, normal)) > friction * pressing or abs(torque) > torsion * pressing:
        status = Status.IMPLAUSIBLE
    return IterativeResult(frozen(point), frozen(normal), frozen(force), torque, residual, evaluations, within, status)


@takes_arrays
def fit_paraboloid(mesh: Mesh, about: ArrayLike, radius: float | None = None) -> PatchParaboloid:
    """Fit a `PatchParaboloid` to a mesh about a point, by least squares along the normal there.

    The surface is sampled at 60 places on rings about the point in the tangent plane, so the mesh may be coarse.

    Args:
        mesh: the surface.
        about: (3,) [m] near the surface.
        radius: [m] of the region; None: a tenth of the mesh's size.

    Raises:
        InputError: `about` is not three numbers.
        GeometryError: the radius is not positive, the mesh turns by more than 90 degrees within the region, or the
            misfit is more than 5 % of the radius (rms).
    """
    reach = 0.1 * mesh.size if radius is None else float(radius)
    if not reach > 0:
        raise GeometryError(f"the radius of the region to fit must be positive, not {reach:g} m.")
    origin, normals, _ = mesh.project(shaped(about, (3,), "about")[None])
    axes = _frame(normals[0])
    steps = np.arange(1, RINGS + 1) / RINGS * reach
    turns = np.arange(SPOKES) * (2 * np.pi / SPOKES)
    flat = np.stack([np.outer(steps, np.cos(turns)).ravel(), np.outer(steps, np.sin(turns)).ravel()], axis=1)
    found, outward, _ = mesh.project(origin + flat @ axes[:2])
    local = (found - origin) @ axes.T
    terms = _monomials(local)
    coefficients = np.linalg.lstsq(terms, local[:, 2], rcond=None)[0]
    misfit = float(np.sqrt(np.mean((local[:, 2] - terms @ coefficients) ** 2)))
    turned = float(np.min(outward @ axes[2]))
    if misfit > POOR_FIT * reach or turned <= 0:
        why = f"is {1e3 * misfit:.2g} mm off (rms)" if turned > 0 else "turns by more than 90 degrees"
        where = np.array2string(origin[0] * 1e3, precision=1)
        raise GeometryError(
            f"no paraboloid fits the mesh within {1e3 * reach:.3g} mm of {where} mm: it {why}. "
            "Give a smaller radius, or use the method soft_finger, which needs no equation."
        )
    return PatchParaboloid(frozen(origin[0]), frozen(axes), frozen(coefficients), reach, misfit)


def _solve(
    equation: Equation, force: np.ndarray, moment: np.ndarray, start: np.ndarray, analytic: bool
) -> tuple[Float[np.ndarray, "3"], float, float, int]:
    """Return point [m], k, largest residual and number of evaluations; inside, lengths are in the surface's size."""
    from scipy.optimize import least_squares

    size = equation.size
    along, about = force / np.linalg.norm(force), moment - np.cross(start, force)
    turning = about / (size * np.linalg.norm(force))
    steepness = max(float(np.linalg.norm(equation.gradient(start[None])[0])), np.finfo(float).tiny)
    cross = skew(along)

    def residuals(x: np.ndarray) -> np.ndarray:
        off, k = x[:3] - 1.0, x[3] - 1.0
        at = (start + size * off)[None]
        slope = equation.gradient(at)[0] / steepness
        return np.append(turning + cross @ off + k * slope, equation.value(at)[0] / (steepness * size))

    def derivative(x: np.ndarray) -> np.ndarray:
        at = (start + size * (x[:3] - 1.0))[None]
        slope = equation.gradient(at)[0] / steepness
        matrix = np.zeros((4, 4))
        matrix[:3, :3] = cross + (x[3] - 1.0) * size / steepness * equation.hessian(at)[0]
        matrix[:3, 3] = matrix[3, :3] = slope
        return matrix

    guess = np.ones(4)  # ones stand for the start: MINPACK's first step is bounded by |x|, and at 0 it would not move
    jac, most = (derivative, STEPS) if analytic else ("2-point", 5 * STEPS)  # MINPACK counts the differences
    found = least_squares(residuals, guess, jac, method="lm", xtol=1e-14, ftol=1e-14, gtol=1e-14, max_nfev=most)
    k = float(found.x[3] - 1.0) * size * float(np.linalg.norm(force)) / steepness
    return start + size * (found.x[:3] - 1.0), k, float(np.max(np.abs(found.fun))), int(found.nfev)


def _entry(surface: Equation, force: np.ndarray, moment: np.ndarray) -> Float[np.ndarray, "3"]:
    """Return the point [m] at which the wrench axis first enters, to 1/64 of the surface's size, else the nearest."""
    along, middle = force / np.linalg.norm(force), surface.centre
    foot = np.cross(force, moment - np.cross(middle, force)) / (force @ force)
    points = middle + foot + np.linspace(-0.5, 0.5, ALONG)[:, None] * surface.size * along
    heights = surface.value(points)
    inward = np.flatnonzero((heights[:-1] > 0) & (heights[1:] <= 0))
    if len(inward) == 0:
        return points[int(np.argmin(np.abs(heights)))]
    before, after = int(inward[0]), int(inward[0]) + 1
    share = heights[before] / (heights[before] - heights[after])
    return points[before] + share * (points[after] - points[before])


def _monomials(local: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 6"]:
    x, y, _ = local.T
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)


def _frame(normal: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """Return the rows x, y, z of a right-handed frame whose z is the normal, (3, 3)."""
    x = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(normal, x), normal])


def _nothing(force: np.ndarray, status: Status) -> IterativeResult:
    nowhere = frozen(np.full(3, np.nan))
    return IterativeResult(nowhere, nowhere, frozen(force), np.nan, np.nan, 0, False, status)
