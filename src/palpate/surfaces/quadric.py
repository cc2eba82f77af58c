"""Surfaces of the second degree: sphere, ellipsoid, cylinder, elliptic cylinder and paraboloid."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from palpate.calls import called_as
from palpate.errors import GeometryError
from palpate.spatial._arrays import frozen
from palpate.spatial.arguments import frozen_value
from palpate.surfaces.analytic import Analytic


@frozen_value(kw_only=True)
class Quadric(Analytic):
    """A surface p'A p + 2 b'p + c = 0 along its own axes."""

    @abstractmethod
    def form(self) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3"], float]:
        """Return A (3, 3), b (3,) and c of p'A p + 2 b'p + c = 0, p [m] along its own axes."""

    def evaluate(
        self, points: Float[np.ndarray, "*batch 3"]
    ) -> tuple[Float[np.ndarray, "*batch"], Float[np.ndarray, "*batch 3"], Float[np.ndarray, "*batch 3 3"]]:
        """Return p'A p + 2 b'p + c (*batch,), gradient 2 (A p + b) (*batch, 3) and Hessian 2 A (*batch, 3, 3).

        Points (*batch, 3) [m] are along its own axes.

        Raises:
            InputError: points has another shape.
        """
        square, linear, constant = self.form()
        half = points @ square
        value = np.sum(points * (half + 2.0 * linear), axis=-1) + constant
        return np.asarray(value), 2.0 * (half + linear), np.broadcast_to(2.0 * square, (*points.shape, 3))

    def equation(self) -> Float[np.ndarray, "10"]:
        """Return (10,), without a unit: xx, yy, zz, xy, xz, yz of A, x, y, z of b, and c, of q'A q + 2 b'q + c = 0.

        The largest is 1 or -1. A point is p = scale q + middle of the box, where scale is half its diagonal [m].
        """
        square, linear, constant = self.form()
        middle, scale = self.box.mean(axis=0), 0.5 * self.size
        flat = square[(0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)]
        at = middle @ square @ middle + 2.0 * linear @ middle + constant
        unit = np.array([*(scale**2 * flat), *(scale * (square @ middle + linear)), at])
        return unit / np.abs(unit).max()


class _Oval(Quadric):
    """An ellipsoid (x/a)^2 + (y/b)^2 + (z/c)^2 = 1."""

    @abstractmethod
    def halves(self) -> tuple[float, float, float]:
        """Return half-lengths a, b, c [m]."""

    def __post_init__(self) -> None:
        _require_positive(self, *self.halves())

    def form(self) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3"], float]:
        """Return A = diag(1/a^2, 1/b^2, 1/c^2), b = 0 and c = -1."""
        return np.diag(np.array(self.halves()) ** -2.0), np.zeros(3), -1.0

    @property
    def box(self) -> Float[np.ndarray, "2 3"]:
        """Corners at minus and plus the half-lengths, (2, 3) [m]."""
        return frozen(np.multiply.outer([-1.0, 1.0], self.halves()))

    def chart(self, count: int) -> tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, "f 3"]]:
        """Return points (n, 3) [m] at 2 `count` by `count` + 1 angles, and triangles (f, 3) between them."""
        turn, height = np.meshgrid(_around(2 * count), np.linspace(-np.pi / 2, np.pi / 2, count + 1), indexing="ij")
        unit = np.stack([np.cos(height) * np.cos(turn), np.cos(height) * np.sin(turn), np.sin(height)], axis=-1)
        return (unit * self.halves()).reshape(-1, 3), _grid(2 * count, count + 1, closed=True)


@called_as("palpate.surfaces.Ellipsoid((0.02, 0.015, 0.03))")
@dataclass(frozen=True, eq=False)
class Ellipsoid(_Oval):
    """An ellipsoid (x/a)^2 + (y/b)^2 + (z/c)^2 = 1.

    Attributes:
        axes: half-lengths a, b, c [m].

    Raises:
        GeometryError: a length is not positive and finite.
    """

    axes: tuple[float, float, float]

    def halves(self) -> tuple[float, float, float]:
        """Return a, b, c [m]."""
        return self.axes


@called_as("palpate.surfaces.Sphere(0.01)")
@dataclass(frozen=True, eq=False)
class Sphere(_Oval):
    """A sphere |p| = radius.

    Attributes:
        radius: [m].

    Raises:
        GeometryError: the radius is not positive and finite.
    """

    radius: float

    def halves(self) -> tuple[float, float, float]:
        """Return the radius three times [m]."""
        return self.radius, self.radius, self.radius


class _Tube(Quadric):
    """A tube (x/a)^2 + (z/b)^2 = 1 with |y| <= half_length and without lids."""

    half_length: float
    upper: bool

    @abstractmethod
    def halves(self) -> tuple[float, float]:
        """Return half-axes a along x and b along z [m]."""

    def __post_init__(self) -> None:
        _require_positive(self, *self.halves(), self.half_length)

    def form(self) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3"], float]:
        """Return A = diag(1/a^2, 0, 1/b^2), b = 0 and c = -1."""
        a, b = self.halves()
        return np.diag([a**-2.0, 0.0, b**-2.0]), np.zeros(3), -1.0

    @property
    def box(self) -> Float[np.ndarray, "2 3"]:
        """Lowest and highest corner of the box around the tube, along its own axes, (2, 3) [m]."""
        a, b = self.halves()
        return frozen([[-a, -self.half_length, 0.0 if self.upper else -b], [a, self.half_length, b]])

    @property
    def ends(self) -> Float[np.ndarray, "2 3"]:
        """Least and largest coordinates, (2, 3) [m]: -+half_length along y, z >= 0 of an upper half, else infinite."""
        least = 0.0 if self.upper else -np.inf
        return frozen([[-np.inf, -self.half_length, least], [np.inf, self.half_length, np.inf]])

    def chart(self, count: int) -> tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, "f 3"]]:
        """Return points (n, 3) [m] by angle (2 `count`, or `count` + 1 of a half) and length, and triangles (f, 3)."""
        a, b = self.halves()
        turn = np.linspace(np.pi, 0.0, count + 1) if self.upper else _around(2 * count)[::-1]
        angle, along = np.meshgrid(turn, np.linspace(-self.half_length, self.half_length, count + 1), indexing="ij")
        points = np.stack([a * np.cos(angle), along, b * np.sin(angle)], axis=-1)
        return points.reshape(-1, 3), _grid(len(turn), count + 1, closed=not self.upper)


@called_as("palpate.surfaces.EllipticCylinder(a=0.02, b=0.01, half_length=0.03)")
@dataclass(frozen=True, eq=False)
class EllipticCylinder(_Tube):
    """A tube (x/a)^2 + (z/b)^2 = 1 with |y| <= half_length and without lids: the `load cells` paper's (9) to (12).

    Attributes:
        a: half-axis along x [m].
        b: half-axis along z [m].
        half_length: [m] along y.
        upper: only its half with z >= 0, such as a fingertip's.

    Raises:
        GeometryError: a length is not positive and finite.
    """

    a: float
    b: float
    half_length: float
    upper: bool = False

    def halves(self) -> tuple[float, float]:
        """Return a along x and b along z [m]."""
        return self.a, self.b


@called_as("palpate.surfaces.Cylinder(radius=0.01, half_length=0.03)")
@dataclass(frozen=True, eq=False)
class Cylinder(_Tube):
    """A tube x^2 + z^2 = radius^2 with |y| <= half_length and without lids.

    Attributes:
        radius: [m].
        half_length: [m] along y.
        upper: only its half with z >= 0.

    Raises:
        GeometryError: a length is not positive and finite.
    """

    radius: float
    half_length: float
    upper: bool = False

    def halves(self) -> tuple[float, float]:
        """Return the radius twice [m]."""
        return self.radius, self.radius


@called_as("palpate.surfaces.Paraboloid(radii=(0.02, 0.01), height=0.01)")
@dataclass(frozen=True, eq=False)
class Paraboloid(Quadric):
    """A paraboloid z = -(x^2/r_x + y^2/r_y)/2 from its apex at z = 0 down to -height; the body is below.

    Attributes:
        radii: of curvature at the apex, r_x and r_y [m].
        height: [m].

    Raises:
        GeometryError: a length is not positive and finite.
    """

    radii: tuple[float, float]
    height: float

    def __post_init__(self) -> None:
        _require_positive(self, *self.radii, self.height)

    def form(self) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3"], float]:
        """Return A = diag(1/r_x, 1/r_y, 0)/2, b = (0, 0, 1/2) and c = 0."""
        return np.diag([0.5 / self.radii[0], 0.5 / self.radii[1], 0.0]), np.array([0.0, 0.0, 0.5]), 0.0

    @property
    def box(self) -> Float[np.ndarray, "2 3"]:
        """Lowest and highest corner of the box from the rim to the apex, (2, 3) [m]."""
        x, y = np.sqrt(2.0 * self.height * np.array(self.radii))
        return frozen([[-x, -y, -self.height], [x, y, 0.0]])

    @property
    def ends(self) -> Float[np.ndarray, "2 3"]:
        """Least and largest coordinates along its own axes, (2, 3) [m]: z >= -height, else infinite."""
        return frozen([[-np.inf, -np.inf, -self.height], [np.inf, np.inf, np.inf]])

    def chart(self, count: int) -> tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, "f 3"]]:
        """Return points (n, 3) [m] at 2 `count` angles and `count` + 1 levels, and triangles (f, 3) between them."""
        turn, out = np.meshgrid(_around(2 * count), np.linspace(1.0, 0.0, count + 1), indexing="ij")
        x, y = (np.sqrt(2.0 * self.height * radius) * out for radius in self.radii)
        points = np.stack([x * np.cos(turn), y * np.sin(turn), -self.height * out**2], axis=-1)
        return points.reshape(-1, 3), _grid(2 * count, count + 1, closed=True)


def _around(count: int) -> Float[np.ndarray, " n"]:
    """Return angles once round [rad], without the last."""
    return np.arange(count) * (2.0 * np.pi / count)


def _grid(rows: int, columns: int, *, closed: bool) -> Int[np.ndarray, "f 3"]:
    """Return two triangles for each cell of a grid of points; if closed, its last row meets the first."""
    at = np.arange(rows * columns).reshape(rows, columns)
    after = np.roll(at, -1, axis=0)
    if not closed:
        at, after = at[:-1], after[:-1]
    a, b, c, d = at[:, :-1].ravel(), after[:, :-1].ravel(), after[:, 1:].ravel(), at[:, 1:].ravel()
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


def _require_positive(surface: Quadric, *lengths: float) -> None:
    if not all(0 < length < np.inf for length in lengths):  # NaN too
        kind, got = type(surface).__name__, ", ".join(f"{length:g}" for length in lengths)
        raise GeometryError(f"the lengths of {kind} must be positive and finite [m], not {got}.")
