"""A body in a caller's form: a surface, a mesh of trimesh, or the path of a mesh file."""

from __future__ import annotations

from os import PathLike
from typing import Any, Protocol, cast, runtime_checkable

from palpate.errors import InputError
from palpate.surfaces.mesh import Mesh
from palpate.surfaces.surface import Surface

__all__ = ["SurfaceLike", "Trimesh", "as_surface"]


@runtime_checkable
class Trimesh(Protocol):
    """The attributes that `trimesh.Trimesh` and `trimesh.Scene` have in common, and no surface of Palpate has."""

    units: Any

    def export(self, *args: Any, **kwargs: Any) -> Any:
        """Write the mesh to a file."""
        ...


SurfaceLike = Surface | Trimesh | str | PathLike[str]


def as_surface(given: SurfaceLike, unit: str | None = None) -> Surface:
    """Return the surface itself, or a `Mesh` of a mesh file or of trimesh's mesh.

    Args:
        given: the body. A path is read at each call.
        unit: of the numbers in the file, or of trimesh's where it states none: m, cm, mm, um or in.

    Raises:
        InputError: no unit, a unit for a surface that is in metres already, no surface, or no readable file.
        GeometryError: nothing usable in it.
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
