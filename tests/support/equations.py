"""The table of surfaces with an equation that every law runs over: add a row and it is tested.

Points of each surface come from a parametrisation of its own, or from `simulation.shapes`, never from the surface.
"""

import functools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from palpate.spatial.pose import Pose
from palpate.surfaces import Cylinder, Ellipsoid, EllipticCylinder, ImplicitSurface, Paraboloid, Sphere, superquadric
from palpate.surfaces.analytic import Analytic
from palpate_lab.simulation.shapes import Superquadric

R = 0.01  # m
POSE = Pose.from_rotation_vector((0.7, -0.4, 1.1), (0.004, -0.003, 0.03))  # of a body in the sensor's frame


@dataclass(frozen=True)
class Equation:
    """One row: a surface, random points of it along its own axes, and what is known about it."""

    make: Callable[[], Analytic]
    sample: Callable[[int, np.random.Generator], np.ndarray]
    closed: bool = True
    convex: bool = True

    @functools.cached_property
    def surface(self) -> Analytic:
        """Made once."""
        return self.make()

    def points(self, count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
        """Points in the sensor's frame [m] and outward unit normals, from differences of the equation's value."""
        points = POSE.apply(self.sample(count, np.random.default_rng(seed)))
        step = 1e-6 * R
        value = self.surface.value
        slope = np.stack([(value(points + step * e) - value(points - step * e)) / (2 * step) for e in np.eye(3)], -1)
        return points, slope / np.linalg.norm(slope, axis=1, keepdims=True)


def torus(ring: float = R, tube: float = 0.4 * R) -> ImplicitSurface:
    """(sqrt(x^2 + y^2) - ring)^2 + z^2 = tube^2: not convex, not star-shaped."""

    def value(p):
        return (np.sqrt(p[0] ** 2 + p[1] ** 2) - ring) ** 2 + p[2] ** 2 - tube**2

    def gradient(p):
        rho = np.sqrt(p[0] ** 2 + p[1] ** 2)
        k = 2.0 * (1.0 - ring / rho)
        return k * p[0], k * p[1], 2.0 * p[2]

    def hessian(p):
        rho = np.sqrt(p[0] ** 2 + p[1] ** 2)
        k, m = 2.0 * (1.0 - ring / rho), 2.0 * ring / rho**3
        rows = [[k + m * p[0] ** 2, m * p[0] * p[1], 0.0], [m * p[0] * p[1], k + m * p[1] ** 2, 0.0], [0.0, 0.0, 2.0]]
        return np.array(rows)

    out = 1.01 * (ring + tube)
    return ImplicitSurface(value, gradient, hessian, (-out, -out, -1.01 * tube), (out, out, 1.01 * tube), pose=POSE)


def _unit(count: int, rng: np.random.Generator) -> np.ndarray:
    vectors = rng.normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def _round(a: float, b: float, half: float, most: float) -> Callable[[int, np.random.Generator], np.ndarray]:
    """Points of an elliptic cylinder along y, at angles from 0 to `most`."""

    def sample(count: int, rng: np.random.Generator) -> np.ndarray:
        angle, along = rng.uniform(0.0, most, count), rng.uniform(-half, half, count)
        return np.c_[a * np.cos(angle), along, b * np.sin(angle)]

    return sample


def _on_paraboloid(count: int, rng: np.random.Generator) -> np.ndarray:
    angle, out = rng.uniform(0, 2 * np.pi, count), np.sqrt(rng.uniform(0, 1, count))
    x, y = np.sqrt(2 * 0.8 * R * R) * out * np.cos(angle), np.sqrt(2 * 0.8 * R * 2 * R) * out * np.sin(angle)
    return np.c_[x, y, -(x**2 / R + y**2 / (2 * R)) / 2]


def _on_torus(count: int, rng: np.random.Generator) -> np.ndarray:
    u, v = rng.uniform(0, 2 * np.pi, (2, count))
    rho = R + 0.4 * R * np.cos(v)
    return np.c_[rho * np.cos(u), rho * np.sin(u), 0.4 * R * np.sin(v)]


AXES = (R, 0.7 * R, 0.5 * R)
SQUARE = Superquadric(AXES, (0.9, 0.8))
EQUATIONS: dict[str, Equation] = {
    "sphere": Equation(lambda: Sphere(R, pose=POSE), lambda n, rng: R * _unit(n, rng)),
    "ellipsoid": Equation(lambda: Ellipsoid(AXES, pose=POSE), lambda n, rng: _unit(n, rng) * AXES),
    "cylinder": Equation(lambda: Cylinder(0.7 * R, R, pose=POSE), _round(0.7 * R, 0.7 * R, R, 2 * np.pi), closed=False),
    "fingertip": Equation(
        lambda: EllipticCylinder(1.4 * R, 0.5 * R, 1.6 * R, upper=True, pose=POSE),
        _round(1.4 * R, 0.5 * R, 1.6 * R, np.pi),
        closed=False,
    ),
    "paraboloid": Equation(lambda: Paraboloid((R, 2 * R), 0.8 * R, pose=POSE), _on_paraboloid, closed=False),
    "superquadric": Equation(lambda: superquadric(AXES, (0.9, 0.8), pose=POSE), SQUARE.sample),
    "torus": Equation(torus, _on_torus, convex=False),
}
