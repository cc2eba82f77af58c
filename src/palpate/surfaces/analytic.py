"""Base class of surfaces with an equation f(p) = 0."""

from __future__ import annotations

import functools
from abc import ABC, abstractmethod
from dataclasses import field, replace
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from numpy.typing import ArrayLike

from palpate.calls import by_name
from palpate.spatial._arrays import Value, frozen, shaped
from palpate.spatial.arguments import frozen_value
from palpate.spatial.pose import Pose
from palpate.surfaces.mesh import Mesh
from palpate.surfaces.prepared import CompiledSurface

SAMPLES = 24  # along each side of the chart, for a first guess at the nearest point


@frozen_value(kw_only=True)
class Analytic(Value, ABC):
    """A surface f(p) = 0, f < 0 inside, along its own axes.

    Attributes:
        pose: T_frame_surface, of the surface's axes in the frame in which it is used.
        notes: warnings about the surface, a sentence each.
    """

    pose: Pose = field(default_factory=Pose.identity)
    notes: tuple[str, ...] = ()

    @property
    @abstractmethod
    def box(self) -> Float[np.ndarray, "2 3"]:
        """Lowest and highest corner of the box around the surface, along its own axes, (2, 3) [m]."""

    @property
    def ends(self) -> Float[np.ndarray, "2 3"]:
        """Least and largest coordinates of the cut-off surface, along its own axes, (2, 3) [m]; infinite if uncut."""
        return frozen([[-np.inf] * 3, [np.inf] * 3])

    @abstractmethod
    def evaluate(
        self, points: Float[np.ndarray, "*batch 3"]
    ) -> tuple[Float[np.ndarray, "*batch"], Float[np.ndarray, "*batch 3"], Float[np.ndarray, "*batch 3 3"]]:
        """Return f (*batch,), gradient (*batch, 3), Hessian (*batch, 3, 3) at points (*batch, 3) [m] on its own axes.

        Their units are that of f, per m and per m^2.

        Raises:
            InputError: points has another shape.
        """

    @abstractmethod
    def equation(self) -> Any:
        """Return the equation for compiled loops: coefficients (10,) in unit size, or a compiled function."""

    @abstractmethod
    def chart(self, count: int) -> tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, "f 3"]]:
        """Return points (n, 3) [m] along its own axes, `count` steps each way, and outward triangles (f, 3).

        Raises:
            GeometryError: an implicit surface is not seen from the middle of its box in every direction.
        """

    def samples(self) -> Float[np.ndarray, "n 3"]:
        """Return points all over it within its ends, along its own axes, (n, 3) [m]: first guesses at the nearest."""
        return self.chart(SAMPLES)[0]

    @property
    def centre(self) -> Float[np.ndarray, "3"]:
        """Middle of the box in the frame in which the surface is used, (3,) [m]."""
        return self.pose.apply(self.box.mean(axis=0))

    @property
    def size(self) -> float:
        """Diagonal of the box [m]."""
        return float(np.linalg.norm(self.box[1] - self.box[0]))

    def value(self, points: ArrayLike) -> Float[np.ndarray, "*batch"]:
        """Return f (*batch,) at points (*batch, 3) [m]: negative inside, 0 on the surface.

        Raises:
            InputError: the points have another shape.
        """
        return self.evaluate(self._own(points))[0]

    def gradient(self, points: ArrayLike) -> Float[np.ndarray, "*batch 3"]:
        """Return the gradient of f at points (*batch, 3) [m], outward, (*batch, 3) [unit of f per m].

        Raises:
            InputError: the points have another shape.
        """
        return self.pose.rotate(self.evaluate(self._own(points))[1])

    def hessian(self, points: ArrayLike) -> Float[np.ndarray, "*batch 3 3"]:
        """Return the Hessian of f at points (*batch, 3) [m], (*batch, 3, 3) [unit of f per m^2].

        Raises:
            InputError: the points have another shape.
        """
        rotation = self.pose.rotation
        return rotation @ self.evaluate(self._own(points))[2] @ rotation.T

    def transformed(self, pose: Pose) -> Analytic:
        """Return the same surface, of the same class, in another frame; `pose` is T_target_frame."""
        return replace(self, pose=pose @ self.pose)

    def project(
        self, points: ArrayLike
    ) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"], Int[np.ndarray, " n"]]:
        """Return closest points (n, 3) [m] to points (n, 3), outward unit normals (n, 3) there, facets (n,), all -1.

        Points and normals are NaN for a point that is NaN or infinite.

        Raises:
            InputError: the points have another shape.
        """
        from palpate.surfaces import _equation

        points = shaped(points, (None, 3), "points")
        prepared, out = self.prepared(), np.empty((len(points), 6))
        unit = np.ascontiguousarray((self._own(points) - self.box.mean(axis=0)) / prepared.scale)
        _equation.nearest_points(unit, *prepared.arguments, out)
        out[~np.isfinite(unit).all(axis=1)] = np.nan
        closest = self.pose.apply(out[:, :3] * prepared.scale + self.box.mean(axis=0))
        return closest, self.pose.rotate(out[:, 3:]), np.full(len(points), -1)

    def mesh(self, facets: int = 5000) -> Mesh:
        """Return a `Mesh` of about `facets` triangles with their corners on the surface.

        Raises:
            GeometryError: an implicit surface is not seen from the middle of its box in every direction.
        """
        points, faces = self.chart(max(3, round((facets / 2) ** 0.5)))
        return Mesh.from_arrays(self.pose.apply(points), faces)

    def drawn(self) -> Mesh:
        """Return the `Mesh` of about 5000 triangles that a viewer shows.

        Raises:
            GeometryError: an implicit surface is not seen from the middle of its box in every direction.
        """
        return self.mesh()

    def plot(self) -> Any:
        """Return a `Drawing` that a notebook shows and a pointer turns.

        Raises:
            GeometryError: an implicit surface is not seen from the middle of its box in every direction.
        """
        return by_name("palpate.viewer.drawing.Drawing").of(self)

    def prepared(self) -> CompiledSurface:
        """Return the `CompiledSurface` for the compiled loops, built on the first call.

        Raises:
            InputError: an implicit surface: numba is not installed.
        """
        return self._prepared

    @functools.cached_property
    def _prepared(self) -> CompiledSurface:
        middle, scale = self.box.mean(axis=0), 0.5 * self.size
        head = np.zeros((5, 6))
        head[0, :3], head[0, 3:] = (self.ends - middle) / scale
        head[1, :3], head[1, 3] = middle, scale
        head[2:, :3] = self.pose.rotation
        points = self.samples()
        gradient = self.evaluate(points)[1]
        normals = gradient / np.linalg.norm(gradient, axis=1, keepdims=True)
        table = np.concatenate([head, np.concatenate([(points - middle) / scale, normals], axis=1)])
        return CompiledSurface((self.equation(), table), self.centre, scale)

    def _own(self, points: ArrayLike) -> Float[np.ndarray, "*batch 3"]:
        """Return points (*batch, 3) along the surface's own axes."""
        return self._inverse.apply(shaped(points, (..., 3), "points"))

    @functools.cached_property
    def _inverse(self) -> Pose:
        return self.pose.inverse()
