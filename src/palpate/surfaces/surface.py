"""The protocol of a surface, and the forms in which a caller may give one."""

from __future__ import annotations

from os import PathLike
from typing import Any, Protocol, cast, runtime_checkable

import numpy as np
from jaxtyping import Float, Int
from numpy.typing import ArrayLike

from palpate.errors import InputError
from palpate.spatial.pose import Pose
from palpate.surfaces.mesh import Mesh
from palpate.surfaces.prepared import CompiledSurface

__all__ = ["Surface", "SurfaceLike", "as_surface"]


@runtime_checkable
class Surface(Protocol):
    """A body's outside: normals point out of it. Lengths in metres, in the surface's own frame."""

    @property
    def size(self) -> float:
        """Diagonal of the bounding box [m]."""
        ...

    @property
    def centre(self) -> Float[np.ndarray, "3"]:
        """Middle of the bounding box, (3,) [m]."""
        ...

    @property
    def notes(self) -> tuple[str, ...]:
        """Repairs and warnings about the surface, a tuple of sentences."""
        ...

    def project(
        self, points: ArrayLike
    ) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"], Int[np.ndarray, " n"]]:
        """Return closest points (n, 3) [m] to points (n, 3), outward unit normals there (n, 3), and facet numbers (n,).

        Facets are -1 where the surface has none; points and normals are NaN for a point that is NaN.

        Raises:
            InputError: the points have another shape.
        """
        ...

    def transformed(self, pose: Pose) -> Surface:
        """Return the same surface in another frame; `pose` is T_target_frame."""
        ...

    def prepared(self) -> CompiledSurface:
        """Return the `CompiledSurface` for the compiled loops, built once."""
        ...

    def drawn(self) -> Mesh:
        """Return the `Mesh` that a viewer shows.

        Raises:
            GeometryError: an implicit surface cannot be drawn.
        """
        ...


@runtime_checkable
class Trimesh(Protocol):
    """The attributes that `trimesh.Trimesh` and `trimesh.Scene` have in common, and no surface of Palpate has."""

    units: Any

    def export(self, *args: Any, **kwargs: Any) -> Any:
        """Write the mesh to a file."""
        ...


SurfaceLike = Surface | Trimesh | str | PathLike[str]


def as_surface(given: SurfaceLike, unit: str | None = None) -> Surface:
    """Return the surface itself, or the `Mesh` of a mesh file, read at each call, or of trimesh's mesh.

    Args:
        given: the body.
        unit: of the numbers of a file, or of trimesh's mesh that states none: m, cm, mm, um or in.

    Raises:
        InputError: no surface, or no readable file; an unknown unit, none for a mesh that needs one, or one for a
            surface that is in metres.
        GeometryError: the mesh has no usable facet.
    """
    if unit is None and hasattr(given, "prepared"):  # first, and by its name alone: `locate` asks at each call
        return cast("Surface", given)
    if isinstance(given, str | PathLike):
        return Mesh.load(given, unit)
    if isinstance(given, Trimesh):
        return Mesh.from_trimesh(given, unit)
    if not hasattr(given, "prepared"):
        line = 'palpate.Mesh.load("probe.stl", unit="mm")'
        raise InputError(f"a {type(given).__name__} is not a surface.", hint=f"Write {line}.")
    raise InputError(f"unit={unit!r} is only for a mesh file: this surface is in metres.", hint="Leave unit out.")
