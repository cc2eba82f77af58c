"""Closed bodies that are known exactly, for the truth of simulated touches.

Each body is star-shaped about its centre, so every direction from there meets it once, in closed form.
"""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
from jaxtyping import Float, Int

from palpate.spatial._arrays import frozen


class Body(ABC):
    """A closed body about the origin; a new one defines `value`, `gradient` and `on_ray` only."""

    radius: float
    """A characteristic size R [m], for tolerances that scale with the body."""

    @abstractmethod
    def value(self, points: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch"]:
        """Return the implicit function (*batch): negative inside, 0 on the surface, positive outside."""

    @abstractmethod
    def gradient(self, points: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3"]:
        """Return the derivative of `value` by the point, (*batch, 3), which points outward on the surface."""

    @abstractmethod
    def on_ray(self, directions: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3"]:
        """Return the points (*batch, 3) [m] at which rays from the centre, of any length but zero, meet the surface."""

    def normals(self, points: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3"]:
        """Return the outward unit normals (*batch, 3) at points of the surface."""
        return _unit(self.gradient(points))

    def sample(self, count: int, rng: np.random.Generator) -> Float[np.ndarray, "n 3"]:
        """Draw points (count, 3) of the analytic surface [m], uniform in *direction* from the centre, not in area."""
        return self.on_ray(rng.standard_normal((count, 3)))

    def mesh(self, facets: int) -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"]]:
        """Return vertices (v, 3) on the surface [m] and outward triangles (f, 3).

        There are about `facets` of them (20, 80, ... 20 nu^2).
        """
        directions, faces = icosphere(max(1, round((facets / 20) ** 0.5)))
        return self.on_ray(directions), faces


class Superquadric(Body):
    """A body (|x/a|^(2/e2) + |y/b|^(2/e2))^(e2/e1) + |z/c|^(2/e1) = 1 (Barr 1981); convex for exponents in (0, 2).

    Exponents below 1 square it off, and it is flat (no curvature) where it crosses its axes.

    Args:
        axes: half-lengths a, b, c [m].
        exponents: e1 (along z) and e2 (around z).
    """

    def __init__(self, axes: tuple[float, float, float], exponents: tuple[float, float] = (0.7, 0.7)) -> None:
        if min(axes) <= 0 or not all(0 < e < 2 for e in exponents):
            raise ValueError(f"axes must be positive and exponents between 0 and 2, not {axes} and {exponents}")
        self.axes, self.exponents = frozen(axes), exponents
        self.radius = float(max(axes))

    def _terms(self, points: Float[np.ndarray, "*batch 3"]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        e1, e2 = self.exponents
        scaled = np.abs(points) / self.axes
        around = np.sum(scaled[..., :2] ** (2 / e2), axis=-1, keepdims=True)
        return scaled, around, around ** (e2 / e1) + scaled[..., 2:] ** (2 / e1)

    def value(self, points: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch"]:
        """Return (|x/a|^(2/e2) + |y/b|^(2/e2))^(e2/e1) + |z/c|^(2/e1) - 1, (*batch), 0 on the surface."""
        return self._terms(points)[2][..., 0] - 1.0

    def gradient(self, points: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3"]:
        """Return the derivative of `value` by the point, (*batch, 3), term by term.

        It is finite everywhere but at the centre of a body with exponents above 1.
        """
        e1, e2 = self.exponents
        scaled, around, _ = self._terms(points)
        outer = np.maximum(around, np.finfo(float).tiny) ** (e2 / e1 - 1)
        slopes = np.empty_like(scaled)
        slopes[..., :2] = outer * scaled[..., :2] ** (2 / e2 - 1)
        slopes[..., 2] = scaled[..., 2] ** (2 / e1 - 1)
        return (2 / e1) * slopes * np.sign(points) / self.axes

    def on_ray(self, directions: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3"]:
        """Return the points (*batch, 3) [m] of the surface on rays from the centre.

        The left side of the equation is of degree 2/e1: the distance along a ray is its -e1/2 power.
        """
        unit = _unit(directions)
        return unit * self._terms(unit)[2] ** (-self.exponents[0] / 2)


class EllipsoidBody(Body):
    """An ellipsoid, (x/a)^2 + (y/b)^2 + (z/c)^2 = 1.

    Args:
        axes: half-lengths a, b, c [m].
    """

    def __init__(self, axes: tuple[float, float, float]) -> None:
        if min(axes) <= 0:
            raise ValueError(f"axes must be positive, not {axes}")
        self.axes = frozen(axes)
        self.radius = float(max(axes))

    def value(self, points: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch"]:
        """Return (x/a)^2 + (y/b)^2 + (z/c)^2 - 1, (*batch), 0 on the surface."""
        return np.sum((points / self.axes) ** 2, axis=-1) - 1.0

    def gradient(self, points: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3"]:
        """Return the derivative of `value` by the point, 2 (x/a^2, y/b^2, z/c^2), (*batch, 3)."""
        return 2.0 * points / self.axes**2

    def on_ray(self, directions: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3"]:
        """Return the points (*batch, 3) [m]: the directions divided by their length in the metric of the ellipsoid."""
        return directions / np.linalg.norm(directions / self.axes, axis=-1, keepdims=True)


class BumpySphere(Body):
    """A bumpy sphere, r(u) = R (1 + A sin(k ux) sin(k uy) sin(k uz)) on the unit direction u: smooth, and not convex.

    Args:
        radius: R [m].
        amplitude: A, a share of R.
        frequency: k.
    """

    def __init__(self, radius: float, amplitude: float = 0.05, frequency: float = 3.0) -> None:
        if radius <= 0 or not 0 <= amplitude < 1:
            raise ValueError(f"radius must be positive and amplitude in [0, 1), not {radius} and {amplitude}")
        self.radius, self.amplitude, self.frequency = radius, amplitude, frequency

    def _radii(self, unit: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 1"]:
        waves = np.prod(np.sin(self.frequency * unit), axis=-1, keepdims=True)
        return self.radius * (1.0 + self.amplitude * waves)

    def value(self, points: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch"]:
        """Return |p| - r(p/|p|), (*batch) [m], the height above the surface along the ray."""
        return (np.linalg.norm(points, axis=-1, keepdims=True) - self._radii(_unit(points)))[..., 0]

    def gradient(self, points: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3"]:
        """Return the derivative of `value`, u - (I - u u^T) r'(u) / |p|, (*batch, 3), with u the unit direction."""
        unit = _unit(points)
        sine, cosine = np.sin(self.frequency * unit), np.cos(self.frequency * unit)
        others = np.stack([sine[..., 1] * sine[..., 2], sine[..., 2] * sine[..., 0], sine[..., 0] * sine[..., 1]], -1)
        slope = self.radius * self.amplitude * self.frequency * cosine * others
        tangential = slope - unit * np.sum(unit * slope, axis=-1, keepdims=True)
        return unit - tangential / np.linalg.norm(points, axis=-1, keepdims=True)

    def on_ray(self, directions: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3"]:
        """Return the points u r(u), (*batch, 3) [m], for the unit directions u."""
        unit = _unit(directions)
        return unit * self._radii(unit)


def icosphere(frequency: int) -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"]]:
    """Triangulate the unit sphere nearly uniformly: 20 frequency^2 outward facets, 10 frequency^2 + 2 vertices.

    Returns the vertices (v, 3) and the facets (f, 3).

    Every side of an icosahedron is cut into `frequency` parts; a vertex shared by several of its faces is recognised
    by its whole-number weights on the twelve corners, so no tolerance is involved.
    """
    corners, faces = _icosahedron()
    weights = _lattice(frequency)  # (m, 3)
    index = faces[:, None, :]  # (20, 1, 3)
    labels = np.where(weights > 0, index * (frequency + 1) + weights, 0)
    labels = np.sort(labels, axis=-1).reshape(-1, 3)
    base = 12 * (frequency + 1)
    code = (labels[:, 0] * base + labels[:, 1]) * base + labels[:, 2]
    _, first, shared = np.unique(code, return_index=True, return_inverse=True)
    points = np.einsum("mk,fkd->fmd", weights.astype(np.float64), corners[faces]).reshape(-1, 3)
    triangles = _lattice_triangles(frequency)[None] + (np.arange(20) * len(weights))[:, None, None]
    return _unit(points[first]), shared.reshape(-1)[triangles.reshape(-1, 3)].astype(np.int64)


def _icosahedron() -> tuple[Float[np.ndarray, "12 3"], Int[np.ndarray, "20 3"]]:
    golden = (1 + 5**0.5) / 2
    plane = np.array([[s, t * golden] for s in (-1, 1) for t in (-1, 1)])
    corners = np.concatenate([np.roll(np.c_[np.zeros(4), plane], shift, axis=1) for shift in range(3)])
    near = np.isclose(np.linalg.norm(corners[:, None] - corners[None], axis=-1), 2.0)
    triples = [(i, j, k) for i in range(12) for j in range(12) for k in range(12) if near[i, j] and near[j, k]]
    triples = [t for t in triples if t[0] < min(t[1:]) and near[t[0], t[2]] and np.linalg.det(corners[list(t)]) > 0]
    return corners, np.array(triples)


def _lattice(frequency: int) -> Int[np.ndarray, "m 3"]:
    """Return whole-number barycentric weights of the points of one face, row by row."""
    row = np.repeat(np.arange(frequency + 1), np.arange(1, frequency + 2))
    column = np.arange(len(row)) - row * (row + 1) // 2
    return np.stack([frequency - row, row - column, column], axis=1)


def _lattice_triangles(frequency: int) -> Int[np.ndarray, "t 3"]:
    weights = _lattice(frequency)
    row, column = weights[:, 1] + weights[:, 2], weights[:, 2]
    here = np.flatnonzero(row < frequency)  # each of these carries the upright triangle below it ...
    below = here + row[here] + 1
    upright = np.stack([here, below, below + 1], axis=1)
    turned = np.flatnonzero((row < frequency) & (column < row))  # ... and, but for the last in a row, the turned one
    inverted = np.stack([turned, turned + row[turned] + 2, turned + 1], axis=1)
    return np.concatenate([upright, inverted])


def _unit(vectors: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3"]:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
