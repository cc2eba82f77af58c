"""Find the face of a body that lies on a surface, and relate the contact point to the surface's angle."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from palpate.errors import GeometryError
from palpate.spatial._arrays import Value, frozen
from palpate.spatial.arguments import frozen_value
from palpate.surfaces.mesh import Mesh

FACING = 0.2  # cosine: facets that lean further away from the axis cannot press
DEPTH = 0.02  # m behind the foremost point: what lies deeper is not pressed
FRONT = 0.9  # cosine of facets that say where the middle is
LEAN = float(np.radians(5.0))  # at which R is taken: as large as what is to be followed
LIGHT = 1e-3  # m of a light touch
NEAR = 1e-3  # m to the side of a line, of cells that it passes
CELLS = 24  # along the face
EPSILON = 1e-9


@frozen_value
class ProbeFace(Value):
    """The face with which a probe presses.

    A surface that leans by a small angle a relative to it presses more on one side. On an elastic foundation of
    k [N/m^3] the place of the contact, the centre of pressure, then moves by

        R a,   R = k I/force = (K/force) <x^2>,

    with I the second moment of the pressed patch, K = k A its stiffness [N/m] and <x^2> = I/A. For a convex face R is
    its radius until the patch reaches the face's end; for a flat one of half width b it is b^2/(3 depth). An offset
    along x is a lean about y.

    Args:
        place: (3,) [m] middle of the face in the surface's frame: the wanted contact point.
        axes: (3, 3) columns x (along the face), y (across) and z (outward normal), in the surface's frame.
        cells: (n, 7) cells of the face and the sides behind it, in its axes about its middle: place [m], normal, area
            [m^2].

    Raises:
        InputError: an array of another shape.
        GeometryError: there are no cells.
    """

    place: Float[np.ndarray, "3"]
    axes: Float[np.ndarray, "3 3"]
    cells: Float[np.ndarray, "n 7"]

    def __post_init__(self) -> None:
        for name, tail in (("place", (3,)), ("axes", (3, 3)), ("cells", (7,))):
            object.__setattr__(self, name, frozen(getattr(self, name), tail=tail, name=name))
        if not len(self.cells):
            raise GeometryError("a probe's face must have at least one cell.")

    @classmethod
    def of(cls, mesh: Mesh, axis: ArrayLike = (0.0, 0.0, 1.0), along: ArrayLike = (1.0, 0.0, 0.0)) -> ProbeFace:
        """Return the face of a mesh that looks along an axis, as a `ProbeFace`.

        Args:
            mesh: of the probe.
            axis: (3,) out of the probe, in the mesh's frame.
            along: (3,) direction in which the face is long; only its part across the axis counts.

        Raises:
            GeometryError: no facet of the mesh looks that way, the axis is 0, or `along` has no part across it.
            ValueError: axis or along is not three numbers.
        """
        z = np.asarray(axis, dtype=np.float64) / float(np.linalg.norm(axis))
        x = np.asarray(along, dtype=np.float64) - z * float(np.dot(along, z))
        if not float(np.linalg.norm(x)) > EPSILON:
            raise GeometryError("the direction in which a face is long (along) must not be parallel to its axis.")
        x = x / float(np.linalg.norm(x))
        axes = np.column_stack([x, np.cross(z, x), z])
        facing = mesh.faces[mesh.normals @ z > -FACING]
        top = float((mesh.vertices @ z).max())
        cut: Any = import_module("trimesh.intersections").slice_faces_plane  # here: it takes 0.2 s to import
        near: Any = cut(mesh.vertices, facing, z, (top - DEPTH) * z)
        vertices, facing = np.asarray(near[0]), np.asarray(near[1])
        if not len(facing):
            raise GeometryError(
                f"no facet of the mesh faces along {np.round(z, 3).tolist()}: state the axis of the probe (`axis`)."
            )
        size = float(np.ptp(vertices @ axes[:, :2], axis=0).max()) / CELLS
        divide: Any = import_module("trimesh.remesh").subdivide_to_size
        fine: Any = divide(vertices, facing, max_edge=size, max_iter=12)
        corners: Float[np.ndarray, "f 3 3"] = np.asarray(fine[0])[np.asarray(fine[1])] @ axes
        across = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        areas = np.linalg.norm(across, axis=1)
        centres, normals = corners.mean(axis=1), across / np.maximum(areas, EPSILON**2)[:, None]
        front = (normals[:, 2] > FRONT) & (centres[:, 2] > top - DEPTH)
        weights = across[front, 2] if front.any() else np.ones(len(front))
        middle = weights @ centres[front if front.any() else slice(None), :2] / weights.sum()
        origin = np.array([*middle, top])
        return cls(axes @ origin, axes, np.column_stack([centres - origin, normals, areas]))

    def radii(self, force: float, stiffness: float | None = None) -> Float[np.ndarray, " 2"]:
        """Compute R along x and y, (2,) [m/rad], the contact's shift per angle of lean, on an elastic foundation.

        The depth is that at which the force, k times the displaced volume, and K, k times the area, have their ratio.

        Args:
            force: [N] contact force.
            stiffness: K [N/m] at that force; None: for a light touch, in which only the curvature counts.

        Raises:
            InputError: the force is zero, and a stiffness is given.
        """
        straight = self._leaning(0, 0.0)
        light = stiffness is None
        ratio = 0.0 if stiffness is None else stiffness / force
        rigid = LIGHT if light else _depth(*straight, lambda volume, patch: volume * ratio > patch)
        volume = float(straight[1] @ np.maximum(rigid - straight[0], 0.0))
        lean = float(np.radians(1.0)) if light else LEAN
        found = [0.0, 0.0]
        for k in (0, 1):
            behind, area = self._leaning(k, lean)
            depth = _depth(behind, area, lambda pressed, _: pressed > volume)
            pressure = area * np.maximum(depth - behind, 0.0)
            found[k] = self._met(k, lean, pressure @ self.cells[:, :3] / float(pressure.sum())) / np.sin(lean)
        return np.array(found)

    def _met(self, k: int, lean: float, centre: Float[np.ndarray, " 3"]) -> float:
        """Return where along x or y [m] the force through an inner centre of pressure leaves the face."""
        towards = np.array([0.0, 0.0, np.cos(lean)])
        towards[k] = np.sin(lean)
        ahead = (self.cells[:, :3] - centre) @ towards
        aside = np.linalg.norm(self.cells[:, :3] - centre - ahead[:, None] * towards, axis=1)
        near = aside < max(NEAR, 1.5 * float(aside.min()))
        return float(centre[k]) + float(ahead[near].max()) * np.sin(lean)

    def _leaning(self, k: int, lean: float) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
        """Return depths of the cells and projected areas along an axis that leans towards x or y."""
        towards = np.array([0.0, 0.0, np.cos(lean)])
        towards[k] = np.sin(lean)
        return -self.cells[:, :3] @ towards, self.cells[:, 6] * np.maximum(self.cells[:, 3:6] @ towards, 0.0)


def _depth(
    behind: Float[np.ndarray, " n"], area: Float[np.ndarray, " n"], enough: Callable[[float, float], bool]
) -> float:
    """Return the depth [m] at which the displaced volume [m^3] and the area of the patch [m^2] satisfy `enough`."""
    low, high = float(behind.min()), float(behind.min()) + 10.0 * DEPTH
    for _ in range(60):
        depth = 0.5 * (low + high)
        pressed = np.maximum(depth - behind, 0.0)
        low, high = (low, depth) if enough(float(area @ pressed), float(area @ (pressed > 0))) else (depth, high)
    return high
