"""Bytes of a mesh file to arrays, by trimesh."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from palpate.errors import InputError

__all__ = ["arrays_of", "load_trimesh"]

_UNHEARD = logging.NullHandler()  # without any, Python prints trimesh's tracebacks, whose reason our error gives


def load_trimesh(path: Path) -> Any:
    """All bodies in a file as one `trimesh.Trimesh`, as they stand there.

    Raises:
        InputError: no such file, an unknown format, or nothing in it that is a mesh.
    """
    if not path.is_file():
        raise InputError("is no regular file." if path.exists() else "no such mesh file.", where=str(path))
    import trimesh  # here: it takes a while to import

    kind = path.suffix.lower().lstrip(".")
    if kind not in trimesh.available_formats():
        raise InputError(
            f"cannot read meshes of type {path.suffix!r}.", where=str(path), hint="Use STL, OBJ, PLY or DAE."
        )
    logging.getLogger("trimesh").addHandler(_UNHEARD)
    try:
        with np.errstate(all="ignore"):  # it multiplies whatever numbers are in the file, which are looked at later
            scene: Any = trimesh.load_scene(path, process=False, file_type=kind)
            return scene.to_mesh()
    except Exception as error:  # trimesh raises whatever its parsers run into
        reason = " ".join(str(error).split())[:120] or type(error).__name__
        raise InputError(f"not a readable {kind.upper()} mesh ({reason}).", where=str(path)) from error


def arrays_of(mesh: Any, source: str) -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"]]:
    """Vertices (in the mesh's unit) and faces of a `trimesh.Trimesh`, or of all bodies of a `trimesh.Scene`.

    Raises:
        InputError: it is neither, or there is nothing in it that is a triangle.
    """
    mesh = mesh.to_mesh() if hasattr(mesh, "to_mesh") else mesh
    if not (hasattr(mesh, "vertices") and hasattr(mesh, "faces")):
        raise InputError("a trimesh.Trimesh or trimesh.Scene is wanted.", where=source)
    vertices, faces = np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces, dtype=np.int64)
    if faces.ndim != 2 or len(faces) == 0:
        raise InputError("there is no triangle in this mesh.", where=source)
    return vertices, faces
