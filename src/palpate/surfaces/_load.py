"""Read a mesh file into arrays: binary STL here, everything else by trimesh."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from palpate.errors import InputError
from palpate.interrupts import import_mesh_reader

_STL = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_STL_HEADER = 84  # text, then how many facets: four bytes

_UNHEARD = logging.NullHandler()  # without any, Python prints trimesh's tracebacks, whose reason our error gives


def load_arrays(path: Path) -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"]]:
    """Return vertices (in the file's unit) and faces of all bodies in a file, unchanged.

    Raises:
        InputError: no such file, it cannot be read, an unknown format, or no triangle in it.
    """
    if not path.is_file():
        raise InputError(
            "is not a regular file." if path.exists() else "the mesh file does not exist.", where=str(path)
        )
    try:
        found = _binary_stl(path) if path.suffix.lower() == ".stl" else None
    except OSError as problem:
        raise InputError(f"cannot be read ({problem.strerror}).", where=str(path)) from problem
    return found or arrays_of(_load_trimesh(path), str(path))


def _binary_stl(path: Path) -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"]] | None:
    """Return vertices and faces; None if the length of the file contradicts its header: text, or incomplete."""
    with path.open("rb") as file:
        count = int.from_bytes(file.read(_STL_HEADER)[-4:], "little")
        if count == 0 or path.stat().st_size != _STL_HEADER + count * _STL.itemsize:
            return None
        corners = np.fromfile(file, _STL, count)["corners"]
    with np.errstate(invalid="ignore"):  # whatever numbers are in the file: they are looked at later
        return corners.reshape(-1, 3).astype(np.float64), np.arange(3 * count).reshape(-1, 3)


def _load_trimesh(path: Path) -> Any:
    import_mesh_reader()
    import trimesh  # here: it takes a while to import

    kind = path.suffix.lower().lstrip(".")
    if kind not in trimesh.available_formats():
        raise InputError(
            f"is of type {path.suffix!r}, which cannot be read as a mesh.",
            where=str(path),
            hint="Use STL, OBJ, PLY or DAE.",
        )
    logging.getLogger("trimesh").addHandler(_UNHEARD)
    try:
        with np.errstate(all="ignore"):  # it multiplies whatever numbers are in the file, which are looked at later
            scene: Any = trimesh.load_scene(path, process=False, file_type=kind)
            return scene.to_mesh()
    except Exception as error:  # trimesh raises whatever its parsers run into
        reason = " ".join(str(error).split())[:120] or type(error).__name__
        raise InputError(f"is not a readable {kind.upper()} mesh ({reason}).", where=str(path)) from error


def arrays_of(mesh: Any, source: str) -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"]]:
    """Return vertices (in the mesh's unit) and faces of a `trimesh.Trimesh`, or of all bodies of a `trimesh.Scene`.

    Raises:
        InputError: it is neither, or has no triangle.
    """
    mesh = mesh.to_mesh() if hasattr(mesh, "to_mesh") else mesh
    if not (hasattr(mesh, "vertices") and hasattr(mesh, "faces")):
        line = 'palpate.Mesh.from_trimesh(trimesh.load("probe.stl"), unit="mm")'
        raise InputError("mesh must be a trimesh.Trimesh or a trimesh.Scene.", hint=f"Write {line}.")
    vertices, faces = np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces, dtype=np.int64)
    if faces.ndim != 2 or len(faces) == 0:
        raise InputError("the mesh has no triangles.", where=source)
    return vertices, faces
