"""A smooth surface from a user's equation."""

from __future__ import annotations

import functools
import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from palpate.errors import GeometryError, InputError
from palpate.spatial._arrays import frozen
from palpate.spatial.arguments import frozen_value
from palpate.surfaces.analytic import Analytic
from palpate.surfaces.quadric import Ellipsoid

_LINES = 20  # along each side of the box, three ways and back: to look for a surface of which nothing is known


@frozen_value
class ImplicitSurface(Analytic):
    """A surface f(p) = 0 from functions of a point p (3,) [m] along its own axes, in arithmetic that numba compiles.

    f is negative inside and smooth where the surface is. Contacts are found from where the wrench axis enters the
    surface; on a body that is not convex, a pitch can make others elsewhere, which are not found.

    Attributes:
        value_at: f(p), a number.
        gradient_at: its gradient (3,), or a tuple of three.
        hessian_at: its Hessian (3, 3).
        low, high: corners of the box in which the surface lies, and at which it ends [m].

    Raises:
        GeometryError: the box is not finite or has no volume; nothing of the surface is in it; the derivatives are not
            those of the value.
        InputError: numba is not installed, or cannot compile a function.
    """

    value_at: Callable[[Any], Any]
    gradient_at: Callable[[Any], Any]
    hessian_at: Callable[[Any], Any]
    low: tuple[float, float, float]
    high: tuple[float, float, float]

    def __post_init__(self) -> None:
        if not np.all(np.subtract(self.high, self.low) > 0) or not np.all(np.isfinite([self.low, self.high])):
            raise GeometryError(
                f"the box of an implicit surface must be finite, with low below high, not {self.low} to {self.high}."
            )
        self._require_derivatives()

    @property
    def box(self) -> Float[np.ndarray, "2 3"]:
        """Corners `low` and `high` of the box, (2, 3) [m]."""
        return frozen([self.low, self.high])

    @property
    def ends(self) -> Float[np.ndarray, "2 3"]:
        """Corners of the box, at which the surface ends, (2, 3) [m]."""
        return self.box

    def evaluate(
        self, points: Float[np.ndarray, "*batch 3"]
    ) -> tuple[Float[np.ndarray, "*batch"], Float[np.ndarray, "*batch 3"], Float[np.ndarray, "*batch 3 3"]]:
        """Return f (*batch,), gradient (*batch, 3), Hessian (*batch, 3, 3) at points (*batch, 3) [m] on its own axes.

        The functions are called one point at a time.

        Raises:
            InputError: points has another shape.
        """
        batch = points.shape[:-1]
        flat = np.ascontiguousarray(points, dtype=np.float64).reshape(-1, 3)
        value = np.array([self.value_at(p) for p in flat], dtype=np.float64).reshape(batch)
        gradient = np.array([self.gradient_at(p) for p in flat], dtype=np.float64).reshape(*batch, 3)
        hessian = np.array([self.hessian_at(p) for p in flat], dtype=np.float64).reshape(*batch, 3, 3)
        return value, gradient, hessian

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle functions by value: a lambda has no name to be found by."""
        from numba import cloudpickle

        return _unpacked, (cloudpickle.dumps(super().__reduce__()),)

    def equation(self) -> Any:
        """Return the three functions compiled into one, which writes the results at a point (3,) into (10,).

        Raises:
            InputError: numba is not installed, or cannot compile a function.
        """
        return _compiled(self.value_at, self.gradient_at, self.hessian_at)

    def chart(self, count: int) -> tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, "f 3"]]:
        """Return points (n, 3) [m] at 2 `count` by `count` + 1 angles about the box's middle, and triangles (f, 3).

        Raises:
            GeometryError: a point of the surface cannot be seen from the middle of the box, or the middle is not
                inside.
        """
        directions, faces = Ellipsoid((1.0, 1.0, 1.0)).chart(count)
        middle, reach = self.box.mean(axis=0), 0.5 * self.size
        points = self._entered(middle + reach * directions, -directions)
        if np.isnan(points).any() or not self.value_at(middle) < 0:
            raise GeometryError(
                "this surface cannot be drawn: from the middle of its box it is not seen in every direction. Choose "
                "a box about a point inside it."
            )
        return points, faces

    def samples(self) -> Float[np.ndarray, "n 3"]:
        """Return the points where a lattice of lines enters the surface, from six sides, (n, 3) [m]."""
        return self._on_lattice

    @functools.cached_property
    def _on_lattice(self) -> Float[np.ndarray, "m 3"]:
        low, high = self.box
        origins, directions = list[Any](), list[Any]()
        between = low + ((np.arange(_LINES) + 0.5) / _LINES)[:, None] * (high - low)
        for axis in range(3):
            for end, sign in ((low, 1.0), (high, -1.0)):
                sides = [end[k : k + 1] if k == axis else between[:, k] for k in range(3)]
                origins.append(np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1).reshape(-1, 3))
                directions.append(np.broadcast_to(sign * np.eye(3)[axis], origins[-1].shape))
        points = self._entered(np.concatenate(origins), np.concatenate(directions))
        inside = np.all((points >= low) & (points <= high), axis=1)  # NaN is not
        if not inside.any():
            raise GeometryError(
                "the function is zero nowhere in its box: it must be negative inside, and its points are in metres."
            )
        return points[inside]

    def _entered(self, origins: Float[np.ndarray, "n 3"], directions: Float[np.ndarray, "n 3"]) -> np.ndarray:
        """Return the points where lines first enter the surface, (n, 3) [m], or NaN."""
        from palpate.surfaces import _equation

        middle, scale = self.box.mean(axis=0), 0.5 * self.size
        head = np.zeros((5, 6))
        head[1, :3], head[1, 3] = middle, scale
        out = np.empty((len(origins), 3))
        _equation.enter((origins - middle) / scale, np.ascontiguousarray(directions), self.equation(), head, out)
        return out * scale + middle

    def _require_derivatives(self) -> None:
        """Compare gradient and Hessian with central differences; raise a GeometryError if they differ."""
        points, step = self._on_lattice[::37], 1e-5 * self.size
        _, gradient, hessian = self.evaluate(points)
        views = [(self.evaluate(points + move), self.evaluate(points - move)) for move in step * np.eye(3)]
        slopes = np.stack([(after[0] - before[0]) / (2 * step) for after, before in views], axis=-1)
        bends = np.stack([(after[1] - before[1]) / (2 * step) for after, before in views], axis=-1)
        size = np.abs(gradient).max()
        if not np.abs(slopes - gradient).max() < 1e-4 * size:
            raise GeometryError("the gradient of an implicit surface is not the derivative of its value.")
        if not np.abs(bends - hessian).max() < 1e-3 * max(np.abs(hessian).max(), size / self.size):
            raise GeometryError("the Hessian of an implicit surface is not the derivative of its gradient.")


def _unpacked(packed: bytes) -> ImplicitSurface:
    built, given = pickle.loads(packed)
    return built(*given)


@functools.lru_cache(maxsize=64)
def _compiled(value: Callable[..., Any], gradient: Callable[..., Any], hessian: Callable[..., Any]) -> Any:
    from palpate.surfaces import _function

    try:
        return _function.compiled(value, gradient, hessian)
    except InputError:
        raise
    except Exception as error:  # numba raises many kinds
        line = str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
        raise InputError(
            f"the functions of an implicit surface cannot be compiled: {line}.",
            hint="Write them with plain arithmetic and numpy on p[0], p[1], p[2]; the Hessian as an array (3, 3).",
        ) from error


def superquadric(axes: tuple[float, float, float], exponents: tuple[float, float], **options: Any) -> ImplicitSurface:
    """Return the `ImplicitSurface` (|x/a|^(2/e2) + |y/b|^(2/e2))^(e2/e1) + |z/c|^(2/e1) = 1 [Barr 1981].

    Args:
        axes: half-lengths a, b, c [m].
        exponents: e1 (along z) and e2 (around z) in (0, 1]; below 1 they square it off.
        options: `pose` and `notes`.

    Raises:
        GeometryError: exponents outside (0, 1], or axes that are not positive and finite.
        InputError: numba is not installed.
    """
    from palpate.surfaces import _function

    if not all(0 < e <= 1 for e in exponents) or not all(0 < axis < np.inf for axis in axes):
        raise GeometryError(f"a superquadric needs positive axes and exponents in (0, 1], not {axes} and {exponents}.")
    functions = _function.superquadric(*axes, *exponents)
    x, y, z = (1.000001 * axis for axis in axes)  # a little room: it ends nowhere
    return ImplicitSurface(*functions, (-x, -y, -z), (x, y, z), **options)
