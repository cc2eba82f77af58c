"""A triangle mesh as a surface: checked, mended where that is safe, smooth within creases and split across them."""

from __future__ import annotations

import functools
from dataclasses import dataclass, field
from math import radians
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Int
from numpy.typing import ArrayLike

from palpate.errors import GeometryError, InputError
from palpate.spatial._arrays import frozen
from palpate.surfaces._mend import mend
from palpate.surfaces._normals import corner_normals, facet_normals
from palpate.surfaces._patches import build_patches
from palpate.surfaces._tree import Tree, build_tree
from palpate.surfaces.surface import Prepared

if TYPE_CHECKING:
    from palpate.spatial.pose import Pose

__all__ = ["UNITS", "Mesh", "plausible_size"]

UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": 0.0254}
CREASE = radians(30)


@dataclass(frozen=True, eq=False)
class Mesh:
    """A mesh in metres; build it with `from_arrays` or `load`.

    Attributes:
        vertices: (v, 3) [m]; faces: (f, 3), counter-clockwise seen from outside.
        corner_normals: (f, 3, 3) unit normals at the facets' corners, shared within a crease group.
        crease: [rad]; facets that meet by less are smooth across their edge; 0 is faceted.
        notes: what was mended and what to doubt, a sentence each.
    """

    vertices: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]
    corner_normals: Float[np.ndarray, "f 3 3"]
    crease: float
    notes: tuple[str, ...] = field(default=())

    @classmethod
    def from_arrays(
        cls,
        vertices: ArrayLike,
        faces: ArrayLike,
        smooth: bool = True,
        crease: float = CREASE,
        region: ArrayLike | None = None,
    ) -> Mesh:
        """A mesh from vertices [m] and faces.

        Args:
            vertices: (v, 3) [m].
            faces: (f, 3) vertex numbers.
            smooth: False is the same as crease = 0.
            crease: [rad].
            region: facets to keep: their numbers (k,), or a box ((x0, y0, z0), (x1, y1, z1)) [m] that must hold a
                facet's middle. The normals come from the whole mesh, so a region's rim is as smooth as it was.

        Raises:
            GeometryError: nothing usable is left, or the arrays are not a mesh.
        """
        points, triangles, notes = mend(vertices, faces)
        crease = float(crease) if smooth else 0.0
        normals, _ = corner_normals(points, triangles, crease)
        if region is not None:
            kept = _in_region(points, triangles, region)
            triangles, normals = triangles[kept], normals[kept]
            notes = (*notes, f"a region of {len(triangles)} of {len(kept)} facets is used")
        triangles.flags.writeable = False
        return cls(frozen(points), triangles, frozen(normals), crease, notes)

    @classmethod
    def load(
        cls,
        path: str | Path,
        unit: str = "m",
        smooth: bool = True,
        crease: float = CREASE,
        region: ArrayLike | None = None,
    ) -> Mesh:
        """Read STL, OBJ, PLY, DAE or whatever else trimesh reads. The one place below `io` that opens a file.

        Args:
            path: the file.
            unit: of the file's numbers: m, cm, mm, um or in.
            smooth: as in `from_arrays`.
            crease: as in `from_arrays`.
            region: as in `from_arrays`; facets are numbered as in the file, a box is in metres.

        Raises:
            InputError: no such file, an unknown unit or a file that is not a mesh.
            GeometryError: nothing usable in it.
        """
        from palpate.surfaces._load import load_arrays

        if unit not in UNITS:
            raise InputError(f"unknown unit {unit!r}.", where=str(path), mend=f"Use one of {', '.join(UNITS)}.")
        vertices, faces = load_arrays(Path(path))
        try:
            mesh = cls.from_arrays(vertices * UNITS[unit], faces, smooth, crease, region)
        except GeometryError as error:
            raise GeometryError(f"{path}: {error}") from error
        return cls(mesh.vertices, mesh.faces, mesh.corner_normals, mesh.crease, (*mesh.notes, *_doubts(mesh, unit)))

    @functools.cached_property
    def normals(self) -> Float[np.ndarray, "f 3"]:
        """Facet normals, unit, outward."""
        return facet_normals(self.vertices, self.faces)[0]

    @functools.cached_property
    def areas(self) -> Float[np.ndarray, " f"]:
        """Facet areas [m^2]."""
        return facet_normals(self.vertices, self.faces)[1]

    @functools.cached_property
    def bounds(self) -> Float[np.ndarray, "2 3"]:
        """Corners of the bounding box of the facets in use [m]."""
        used = self.vertices[self.faces.reshape(-1)]
        return np.stack([used.min(axis=0), used.max(axis=0)])

    @property
    def size(self) -> float:
        """Diagonal of the bounding box [m]."""
        return float(np.linalg.norm(self.bounds[1] - self.bounds[0]))

    @property
    def centre(self) -> Float[np.ndarray, "3"]:
        """Middle of the bounding box [m]."""
        return self.bounds.mean(axis=0)

    @functools.cached_property
    def edge(self) -> float:
        """Mean length of an edge [m]."""
        points = self.vertices[self.faces]
        return float(np.linalg.norm(points - np.roll(points, 1, axis=1), axis=2).mean())

    @functools.cached_property
    def _tree(self) -> Tree:
        return build_tree(build_patches(self.vertices, self.faces, self.corner_normals))

    def tree(self) -> Tree:
        """The prepared search tree; built (and its loops compiled) on the first call."""
        return self._tree

    def prepared(self) -> Prepared:
        """For the compiled loops: the tree."""
        tree = self._tree
        return Prepared((tree.nodes, tree.corners), tree.centre, tree.scale)

    def drawn(self) -> Mesh:
        """What a viewer shows of it: itself."""
        return self

    def project(
        self, points: Float[np.ndarray, "n 3"]
    ) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"], Int[np.ndarray, " n"]]:
        """Closest points [m], outward unit normals there (interpolated where smooth) and facets."""
        from palpate.surfaces import _bvh, _nearest

        tree = self.tree()
        found = np.empty((len(points), 4))
        _nearest.nearest_to_point((points - tree.centre) / tree.scale, tree.nodes, tree.corners, found)
        patch = found[:, 0].astype(np.int64)
        both = np.einsum("ni,nik->nk", found[:, 1:], tree.corners[patch, :18].reshape(-1, 3, 6))
        normals = both[:, 3:] / np.linalg.norm(both[:, 3:], axis=1, keepdims=True)
        return both[:, :3] * tree.scale + tree.centre, normals, tree.corners[patch, _bvh.FACET].astype(np.int64)

    def transformed(self, pose: Pose) -> Mesh:
        """The same mesh in another frame; pose is T_target_mesh."""
        return Mesh(
            frozen(pose.apply(self.vertices)),
            self.faces,
            frozen(pose.rotate(self.corner_normals)),
            self.crease,
            self.notes,
        )


def _in_region(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], region: ArrayLike) -> np.ndarray:
    """Which facets a box or a list of facets keeps."""
    array = np.asarray(region)
    if array.shape == (2, 3):
        middle = vertices[faces].mean(axis=1)
        low, high = np.minimum(*array), np.maximum(*array)
        kept = np.all((middle >= low) & (middle <= high), axis=1)
    elif array.ndim == 1 and np.issubdtype(array.dtype, np.integer):
        if array.size and (array.min() < 0 or array.max() >= len(faces)):
            raise GeometryError(f"region names facet {array.max()}; there are {len(faces)}, counted from 0")
        kept = np.zeros(len(faces), dtype=bool)
        kept[array] = True
    else:
        raise GeometryError("region must be two corners of a box [m] or a list of facet numbers")
    if not kept.any():
        raise GeometryError("no facet lies in the region (is it in metres?)")
    return kept


def plausible_size(size: float) -> bool:
    """Of something that is touched [m]: from a fingertip to a robot."""
    return 2e-3 <= size <= 5.0


def _doubts(mesh: Mesh, unit: str) -> tuple[str, ...]:
    """A size that no probe, finger or link has is most often a wrong unit."""
    if plausible_size(mesh.size):
        return ()
    likely = [name for name, scale in UNITS.items() if plausible_size(mesh.size / UNITS[unit] * scale)]
    hint = f"; in {' or '.join(likely)} it would be plausible" if likely else ""
    return (f"the mesh is {mesh.size:.4g} m across as {unit}: is the unit right{hint}?",)
