"""Shapes that are known exactly, to lay sheets on: with their unrolled sheet where they are developable.

Each has parameters (u, v) with r_u x r_v outward, and derivatives in closed form; none of it is made by the code that
it judges.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable

import numpy as np
from scipy.integrate import quad
from scipy.interpolate import CubicHermiteSpline

from palpate.surfaces import Mesh
from palpate.surfaces.bspline import solve_tangent


def _stack(*parts: np.ndarray) -> np.ndarray:
    return np.stack(np.broadcast_arrays(*parts), axis=-1)


class Exact(ABC):
    """Derivatives in closed form, and geodesics by a loop over them: the oracle of the compiled one."""

    @abstractmethod
    def derivatives(self, uv: np.ndarray) -> np.ndarray:
        """Position and its derivatives, as a surface gives them."""

    def geodesics(self, begin: np.ndarray, step: float, steps: int) -> tuple[np.ndarray, np.ndarray]:
        """As of `BSplineSurface`."""
        return march(self.derivatives, begin, step, steps)


def march(
    derivatives: Callable[[np.ndarray], np.ndarray], begin: np.ndarray, h: float, steps: int
) -> tuple[np.ndarray, np.ndarray]:
    """States (u, v, u', v', J, J') along geodesics and their slopes, by Runge and Kutta's fourth."""
    states, slopes = [begin], [_slope(derivatives, begin)]
    for _ in range(steps):
        y, k1 = states[-1], slopes[-1]
        k2 = _slope(derivatives, y + 0.5 * h * k1)
        k3 = _slope(derivatives, y + 0.5 * h * k2)
        k4 = _slope(derivatives, y + h * k3)
        states.append(y + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4))
        slopes.append(_slope(derivatives, states[-1]))
    return np.stack(states), np.stack(slopes)


def _slope(derivatives: Callable[[np.ndarray], np.ndarray], state: np.ndarray) -> np.ndarray:
    """A geodesic's acceleration has no part along the surface; J'' = -K J."""
    found = derivatives(state[:, :2])
    du, dv = state[:, 2:3], state[:, 3:4]
    bend = du * du * found[:, 3] + 2.0 * du * dv * found[:, 4] + dv * dv * found[:, 5]
    turn = -solve_tangent(found[:, 1:3], bend)
    n = np.cross(found[:, 1], found[:, 2])
    square = np.einsum("ni,ni->n", n, n)
    uu, uv, vv = (np.einsum("ni,ni->n", found[:, i], n) for i in (3, 4, 5))
    curvature = (uu * vv - uv * uv) / (square * square)
    rest = np.stack([state[:, 5], -curvature * state[:, 4]], axis=1)
    return np.concatenate([state[:, 2:4], turn, rest], axis=1)


class Cone(Exact):
    """A cone (a cylinder where the angle is 0) about z: u along a side from a circle of radius R, v clockwise."""

    def __init__(self, radius: float, degrees: float) -> None:
        self.radius, self.angle = radius, np.radians(degrees)

    def derivatives(self, uv: np.ndarray) -> np.ndarray:
        """Position and its derivatives, as a surface gives them."""
        u, v = uv[..., 0], uv[..., 1]
        s, c = np.sin(self.angle), np.cos(self.angle)
        r, cv, sv, o = self.radius + u * s, np.cos(v), np.sin(v), 0.0 * v
        place = [_stack(r * cv, -r * sv, u * c), _stack(s * cv, -s * sv, c + o), _stack(-r * sv, -r * cv, o)]
        return np.stack([*place, _stack(o, o, o), _stack(-s * sv, -s * cv, o), _stack(-r * cv, r * sv, o)], axis=-2)

    def unroll(self, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        if self.angle == 0.0:
            return _stack(-self.radius * v, u)
        far, turn = self.radius / np.sin(self.angle) + u, v * np.sin(self.angle)
        return _stack(-far * np.sin(turn), far * np.cos(turn))

    def roll(self, flat: np.ndarray) -> np.ndarray:
        """Parameters (u, v) of points of the plane."""
        if self.angle == 0.0:
            return _stack(flat[..., 1], -flat[..., 0] / self.radius)
        far = np.hypot(flat[..., 0], flat[..., 1])
        turn = np.arctan2(-flat[..., 0], flat[..., 1])
        return _stack(far - self.radius / np.sin(self.angle), turn / np.sin(self.angle))

    def point(self, z: np.ndarray, angle: np.ndarray) -> np.ndarray:
        r = self.radius + z * np.tan(self.angle)
        return _stack(r * np.cos(angle), r * np.sin(angle), z)


class Elliptic(Exact):
    """A cylinder over an ellipse about z: u the height, v the ellipse's own angle, clockwise."""

    def __init__(self, a: float, b: float) -> None:
        self.a, self.b = a, b
        self.angle = np.linspace(-4 * np.pi, 4 * np.pi, 4001)
        steps = [quad(self._speed, p, q)[0] for p, q in zip(self.angle[2000:2500], self.angle[2001:2501], strict=True)]
        turn = np.cumsum(np.r_[0.0, steps])  # a full turn is 1000 steps: a half is symmetric to the other
        self.turn = 2.0 * turn[-1]
        half = np.r_[turn[:-1], turn[-1] + turn[:-1]]
        length = np.concatenate([half + k * self.turn for k in range(-2, 2)] + [[2 * self.turn]])
        self.by_length = CubicHermiteSpline(length, self.angle, 1.0 / self._speed(self.angle))
        self.by_angle = CubicHermiteSpline(self.angle, length, self._speed(self.angle))

    def _speed(self, angle):
        return np.hypot(self.a * np.sin(angle), self.b * np.cos(angle))

    def derivatives(self, uv: np.ndarray) -> np.ndarray:
        u, v = uv[..., 0], uv[..., 1]
        a, b, c, s, o = self.a, self.b, np.cos(v), np.sin(v), 0.0 * v
        place = [_stack(a * c, -b * s, u), _stack(o, o, o + 1.0), _stack(-a * s, -b * c, o)]
        return np.stack([*place, _stack(o, o, o), _stack(o, o, o), _stack(-a * c, b * s, o)], axis=-2)

    def unroll(self, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        return _stack(-self.by_angle(v), u)

    def roll(self, flat: np.ndarray) -> np.ndarray:
        """Parameters (u, v) of points of the plane."""
        return _stack(flat[..., 1], self.by_length(-flat[..., 0]))

    def point(self, z: np.ndarray, angle: np.ndarray) -> np.ndarray:
        return _stack(self.a * np.cos(angle), self.b * np.sin(angle), z)


class Torus(Exact):
    """A bent tube: u round the tube as a length from the outermost circle, v westward about z."""

    def __init__(self, radius: float, tube: float) -> None:
        self.radius, self.tube = radius, tube

    def derivatives(self, uv: np.ndarray) -> np.ndarray:
        t, w = self.tube, uv[..., 0] / self.tube
        c, s = np.cos(w), np.sin(w)
        return _turned(self.radius + t * c, -s, -c / t, t * s, c, -s / t, uv[..., 1])


class Sphere(Torus):
    """About the origin: u northward as a length from the equator, v westward."""

    def __init__(self, radius: float) -> None:
        super().__init__(0.0, radius)


def _turned(r, dr, ddr, z, dz, ddz, v) -> np.ndarray:
    """A curve (r, z) and its first two derivatives, turned about z, clockwise."""
    c, s, o = np.cos(v), np.sin(v), 0.0 * v
    place = [_stack(r * c, -r * s, z), _stack(dr * c, -dr * s, dz), _stack(-r * s, -r * c, o)]
    return np.stack([*place, _stack(ddr * c, -ddr * s, ddz), _stack(-dr * s, -dr * c, o), _stack(-r * c, r * s, o)], -2)


def wristlike(z: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """A smooth tapered, bulging and bent link of about 74 x 60 mm, by height and angle."""
    r = 0.0335 * (1 + 0.10 * np.cos(2 * angle) + 0.02 * np.cos(3 * angle + 0.4)) * (1 + 0.35 * z - 2.0 * z * z)
    return _stack(r * np.cos(angle) + 0.02 * z, r * np.sin(angle) - 0.05 * z, z)


def round_mesh(point: Callable[[np.ndarray, np.ndarray], np.ndarray], around: int, heights: np.ndarray) -> Mesh:
    """Triangles with their corners on a shape, in `around` columns."""
    z, angle = np.meshgrid(heights, np.arange(around) * (2 * np.pi / around), indexing="ij")
    vertices = point(z, angle).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(len(heights) - 1), np.arange(around), indexing="ij")
    a, b = (i * around + j).reshape(-1), (i * around + (j + 1) % around).reshape(-1)
    c, d = a + around, b + around
    return Mesh.from_arrays(vertices, np.concatenate([np.stack([a, b, d], 1), np.stack([a, d, c], 1)]))
