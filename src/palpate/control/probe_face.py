"""Which part of a body is to lie on a surface, and what the place of a contact there says about the surface's angle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from palpate.errors import GeometryError
from palpate.spatial._arrays import Value, frozen
from palpate.surfaces.mesh import Mesh

__all__ = ["ProbeFace"]

SPAN = np.radians(12.0)  # of normals about the face's own that tell how it is curved
EPSILON = 1e-9


@dataclass(frozen=True, eq=False)
class ProbeFace(Value):
    """The face that a probe is to press with.

    A convex face that rolls on a soft plane is touched where its normal is the plane's. With R its radius in the plane
    of an axis, an offset u of the contact from the middle means that the plane leans by asin(u/R) about the other: the
    axes pair crosswise, which (8) of `probe` leaves open. That holds whatever the stiffness, until the patch meets the
    end of the face. A flat face is touched off its middle too, by a gain that depends on the stiffness: there R is what
    its edges would give at 12 degrees, and the angle found is too small rather than too large, which converges.

    Args:
        place: (3,) [m] the middle of the face, in the surface's frame: the wanted place of the contact.
        axes: (3, 3) columns x (along the face), y (across) and z (outward normal), in the surface's frame.
        radii: (2,) [m] along x and y; the place of the contact moves by R sin(angle).
    """

    place: Float[np.ndarray, "3"]
    axes: Float[np.ndarray, "3 3"]
    radii: Float[np.ndarray, "2"]

    def __post_init__(self) -> None:
        object.__setattr__(self, "place", frozen(self.place, tail=(3,), name="place"))
        object.__setattr__(self, "axes", frozen(self.axes, tail=(3, 3), name="axes"))
        object.__setattr__(self, "radii", frozen(self.radii, tail=(2,), name="radii"))
        if not (np.isfinite(self.radii) & (self.radii > 0)).all():
            raise GeometryError(f"radii of a probe's face must be positive, not {self.radii.tolist()} m.")

    @classmethod
    def of(cls, mesh: Mesh, axis: ArrayLike = (0.0, 0.0, 1.0), along: ArrayLike = (1.0, 0.0, 0.0)) -> ProbeFace:
        """The face of a mesh that looks along an axis.

        R is the ratio of the spread of places to that of normals over the facets within 12 degrees of the axis, and at
        most what the ends of the face allow.

        Args:
            mesh: of the probe.
            axis: (3,) out of the probe, to what it is pressed on; of the mesh's frame.
            along: (3,) the direction in which the face is long; its part across the axis counts.

        Raises:
            GeometryError: nothing of the mesh looks that way, or `along` has no part across the axis.
        """
        z = np.asarray(axis, dtype=np.float64) / float(np.linalg.norm(axis))
        x = np.asarray(along, dtype=np.float64) - z * float(np.dot(along, z))
        if not float(np.linalg.norm(x)) > EPSILON:
            raise GeometryError("the direction in which a face is long must not be its normal.")
        x = x / float(np.linalg.norm(x))
        axes = np.column_stack([x, np.cross(z, x), z])
        facing = np.flatnonzero(mesh.normals @ z > np.cos(SPAN))
        if not len(facing):
            raise GeometryError(f"nothing of the mesh looks along {np.round(z, 3).tolist()}: name its axis.")
        corners = mesh.vertices[mesh.faces[facing]]
        weights = mesh.areas[facing] / mesh.areas[facing].sum()
        centres, normals = corners.mean(axis=1) @ axes, mesh.normals[facing] @ axes
        middle = weights @ centres
        spread, turned = (np.sqrt(weights @ (each - weights @ each) ** 2) for each in (centres, normals))
        ends = 0.5 * np.ptp(corners.reshape(-1, 3) @ axes, axis=0) / np.sin(SPAN)
        radii = np.minimum(spread[:2] / np.maximum(turned[:2], EPSILON), ends[:2])
        top = float((corners.reshape(-1, 3) @ z).max())
        return cls(axes @ np.array([middle[0], middle[1], top]), axes, radii)
