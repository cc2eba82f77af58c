"""Triangle meshes as surfaces: checked, repaired where that is safe, smooth within creases and split across them."""

from __future__ import annotations

import functools
from contextlib import AbstractContextManager, nullcontext
from dataclasses import field, replace
from math import isclose, pi, radians
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy.typing import ArrayLike

from palpate.calls import by_name, called_as
from palpate.errors import GeometryError, InputError
from palpate.spatial._arrays import FLOAT, INT64, Value, frozen, shaped
from palpate.spatial.arguments import frozen_value, takes_arrays
from palpate.surfaces._edges import sharp_edges
from palpate.surfaces._exposure import exposed
from palpate.surfaces._normals import corner_normals, facet_normals, half_edge_twins
from palpate.surfaces._patches import FACET, Split, build_patches
from palpate.surfaces._repair import bodies, repair
from palpate.surfaces._tree import Tree, build_tree
from palpate.surfaces.prepared import CompiledSurface
from palpate.waiting import waiting

if TYPE_CHECKING:
    from palpate.spatial.pose import Pose

UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": 0.0254}
_OF_TRIMESH = {"meters": "m", "centimeters": "cm", "millimeters": "mm", "microns": "um", "inches": "in"}
CREASE = radians(30)
_LARGE = 100_000  # facets


@called_as(
    'palpate.Mesh.load("probe.stl", unit="mm")',
    load='palpate.Mesh.load("probe.stl", unit="mm")',
    from_trimesh='palpate.Mesh.from_trimesh(trimesh.load("probe.stl"), unit="mm")',
    from_arrays="palpate.Mesh.from_arrays(vertices, faces)",
    transformed="mesh.transformed(palpate.Pose.identity())",
)
@frozen_value
class Mesh(Value):
    """A mesh in metres; build it with `from_arrays`, `from_trimesh` or `load`.

    Attributes:
        vertices: (v, 3) [m].
        faces: (f, 3), counter-clockwise seen from outside.
        corner_normals: (f, 3, 3) unit normals at the facets' corners, shared within a crease group.
        crease: [rad]; facets that meet by less are smooth across their edge; 0 is faceted.
        notes: repairs and warnings, a sentence each.
        touchable: (f,) which facets give contacts; None: those that can be reached from outside (`covered`).

    Raises:
        InputError: arrays of other shapes or types.
        GeometryError: faces name vertices that do not exist.
    """

    vertices: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]
    corner_normals: Float[np.ndarray, "f 3 3"]
    crease: float
    notes: tuple[str, ...] = field(default=())
    touchable: Bool[np.ndarray, " f"] | None = None

    def __post_init__(self) -> None:
        kinds = {"vertices": FLOAT, "corner_normals": FLOAT, "faces": INT64, "touchable": np.dtype(np.bool_)}
        for name, dtype in kinds.items():
            if getattr(self, name) is not None:
                object.__setattr__(self, name, frozen(getattr(self, name), name=name, dtype=dtype))
        if self.faces.size and not 0 <= self.faces.min() <= self.faces.max() < len(self.vertices):
            raise GeometryError(f"faces must name vertices, from 0 to {len(self.vertices) - 1}.")

    def __repr__(self) -> str:
        size = np.ptp(self.vertices, axis=0) if len(self.vertices) else np.zeros(3)
        measures = " x ".join(f"{1e3 * side:.4g}" for side in size)
        return f"Mesh({len(self.vertices):,} vertices, {len(self.faces):,} facets, {measures} mm)"

    @classmethod
    def from_arrays(
        cls,
        vertices: ArrayLike,
        faces: ArrayLike,
        smooth: bool = True,
        crease: float = CREASE,
        region: ArrayLike | None = None,
        covered: bool = False,
    ) -> Mesh:
        """Make a `Mesh` from vertices and faces, repaired where that is safe.

        Args:
            vertices: (v, 3) [m].
            faces: (f, 3) vertex numbers, from 0.
            smooth: False is the same as crease = 0.
            crease: [rad], 0 to pi.
            region: facets to keep: their numbers (k,), or corners (2, 3) [m] of a box that must contain their middles.
                Normals are those of the complete mesh.
            covered: facets that cannot be reached from outside give contacts too; those of a list always do.

        Raises:
            InputError: vertices are not (v, 3) numbers; the crease is not from 0 to pi.
            GeometryError: faces are not (f, 3) whole numbers of these vertices; no facet with an area; a region of
                another form, without facets, or with none that can be reached.
        """
        if not 0 <= crease <= pi:  # NaN too
            raise InputError(f"crease must be between 0 and pi [rad], not {crease:g}.", hint="Use math.radians(30).")
        crease = float(crease) if smooth else 0.0
        with _announced(np.size(faces) // 3):
            points, triangles, twins, notes = repair(vertices, faces)
            normals = corner_normals(points, triangles, twins, crease)
        listed = region is not None and np.ndim(region) == 1
        touchable = np.ones(len(triangles), dtype=np.bool_) if covered or listed else None
        if region is not None:
            kept = _in_region(points, triangles, region)
            touchable = (exposed(points, triangles) if touchable is None else touchable)[kept]
            if not touchable.any():
                raise GeometryError(
                    "no facet of the region can be reached from outside: set covered = true to use them."
                )
            triangles, normals = triangles[kept], normals[kept]
            notes = (*notes, f"a region of {len(triangles)} of {len(kept)} facets is used")
        return cls(points, triangles, normals, crease, notes, touchable)

    @classmethod
    def from_trimesh(cls, mesh: Any, unit: str | None = None, **options: Any) -> Mesh:
        """Make a `Mesh` from a `trimesh.Trimesh`, or from all bodies of a `trimesh.Scene`.

        Args:
            mesh: of trimesh.
            unit: of its numbers: m, cm, mm, um or in; None: the one that `mesh.units` names.
            options: `smooth`, `crease`, `region`, `covered` as in `from_arrays`; facets are numbered as trimesh does.

        Raises:
            InputError: no unit or an unknown one; nothing that has vertices and faces; a crease not from 0 to pi.
            GeometryError: no facet with an area, or an unusable region.
        """
        from palpate.surfaces._load import arrays_of

        source, named = type(mesh).__name__, str(getattr(mesh, "units", None) or "")
        unit = unit or _OF_TRIMESH.get(named, named) or None
        return cls._from_numbers(*arrays_of(mesh, source), _metres(unit, source), source, options)

    @classmethod
    def load(cls, path: str | PathLike[str], unit: str | None = None, **options: Any) -> Mesh:
        """Read a mesh file as a `Mesh`: STL, OBJ, PLY, DAE or any other format that trimesh reads.

        Args:
            path: the file.
            unit: of the file's numbers: m, cm, mm, um or in; required unless the file states its own (<unit> of DAE).
            options: `smooth`, `crease`, `region`, `covered` as in `from_arrays`; facets are numbered as in the file.

        Returns:
            The `Mesh`; of a DAE with another <up_axis> it is turned so that z points up, with a note.

        Raises:
            InputError: no such file, or one that cannot be read or is not a mesh; no unit, an unknown one, or another
                than the file's own; an unknown option; a crease not from 0 to pi.
            GeometryError: no facet with an area, or an unusable region.
        """
        from palpate.surfaces._load import load_arrays
        from palpate.surfaces.collada import ColladaAsset

        asset, (vertices, faces) = ColladaAsset.of(Path(path)), load_arrays(Path(path))
        metres = _metres(unit, str(path), asset.metres)
        made = cls._from_numbers(asset.upright(vertices), faces, metres, str(path), options)
        return replace(made, notes=(*made.notes, asset.note)) if asset.turned else made

    @classmethod
    def _from_numbers(
        cls,
        vertices: Float[np.ndarray, "v 3"],
        faces: Int[np.ndarray, "f 3"],
        metres: float,
        source: str,
        options: dict[str, Any],
    ) -> Mesh:
        """Make a mesh from vertices in a unit of that many metres; errors name the source."""
        try:
            made = cls.from_arrays(vertices * metres, faces, **options)
        except GeometryError as error:
            raise GeometryError(f"{source}: {error}") from error
        return replace(made, notes=(*made.notes, *_doubts(made, metres)))

    @functools.cached_property
    def normals(self) -> Float[np.ndarray, "f 3"]:
        """Outward unit normals of the facets, (f, 3)."""
        return frozen(facet_normals(self.vertices, self.faces)[0])

    @functools.cached_property
    def areas(self) -> Float[np.ndarray, " f"]:
        """Areas of the facets, (f,) [m^2]."""
        return frozen(facet_normals(self.vertices, self.faces)[1])

    @functools.cached_property
    def bounds(self) -> Float[np.ndarray, "2 3"]:
        """Corners of the bounding box of the facets in use, (2, 3) [m]."""
        used = self.vertices[self.faces.reshape(-1)]
        return frozen([used.min(axis=0), used.max(axis=0)])

    @property
    def size(self) -> float:
        """Diagonal of the bounding box [m]."""
        return float(np.linalg.norm(self.bounds[1] - self.bounds[0]))

    @property
    def centre(self) -> Float[np.ndarray, "3"]:
        """Middle of the bounding box, (3,) [m]."""
        return self.bounds.mean(axis=0)

    @functools.cached_property
    def edge(self) -> float:
        """Mean length of an edge [m]."""
        points = self.vertices[self.faces]
        return float(np.linalg.norm(points - np.roll(points, 1, axis=1), axis=2).mean())

    @functools.cached_property
    def bodies(self) -> int:
        """Number of bodies: groups of facets that are connected over their edges."""
        return bodies(self.faces)

    @functools.cached_property
    def open_edges(self) -> int:
        """Number of sides of facets that do not have exactly one neighbour; 0: the mesh is watertight."""
        return int(np.count_nonzero(half_edge_twins(self.faces) < 0))

    @functools.cached_property
    def covered(self) -> Bool[np.ndarray, " f"]:
        """Mask of the facets that give no contacts, (f,); without `touchable`, those that nothing outside can reach.

        They are found on first use, by rays, a ball of a fifth of the body's size, and passages between two sides.
        """
        found = ~(exposed(self.vertices, self.faces) if self.touchable is None else self.touchable)
        found.flags.writeable = False
        return found

    @property
    def coverage(self) -> str:
        """Number of covered facets and their share of the area, in words; "" if there is none."""
        count = np.count_nonzero(self.covered)
        share = self.areas[self.covered].sum() / self.areas.sum()
        return f"{count:,} of {len(self.faces):,} facets ({share:.0%} of the area)" if count else ""

    @functools.cached_property
    def _tree(self) -> Tree:
        with _announced(len(self.faces)):
            split = Split.of(self.vertices, self.faces, self.corner_normals, self.covered)
            sharp = sharp_edges(split)
            count = len(sharp)
            rows = build_patches(self.faces, split, count)
            rows[len(rows) - count :] = sharp
            del split, sharp  # memory that the tree needs
            return build_tree(rows, count)

    def tree(self) -> Tree:
        """Return the search tree of the patches as a `Tree`, built on the first call.

        Raises:
            GeometryError: more than 8,388,608 patches.
        """
        return self._tree

    def prepared(self) -> CompiledSurface:
        """Return the `CompiledSurface` for the compiled loops, built on the first call.

        Raises:
            GeometryError: more than 8,388,608 patches.
        """
        tree = self._tree
        return CompiledSurface((tree.nodes, tree.corners), tree.centre, tree.scale, bool(tree.nodes[-1, 10, 0] >= 0))

    def drawn(self) -> Mesh:
        """Return the `Mesh` that a viewer shows: itself."""
        return self

    def plot(self) -> Any:
        """Return a `Drawing` that a notebook shows and a pointer turns."""
        return by_name("palpate.viewer.drawing.Drawing").of(self)

    def project(
        self, points: ArrayLike
    ) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"], Int[np.ndarray, " n"]]:
        """Return closest points (n, 3) [m] to points (n, 3), outward unit normals there (n, 3) and facet numbers (n,).

        Normals are interpolated where smooth. NaN, NaN and -1 for a point that is NaN or infinite.

        Raises:
            InputError: the points have another shape.
            GeometryError: more than 8,388,608 patches.
        """
        from palpate.surfaces import _nearest

        tree, points = self.tree(), shaped(points, (None, 3), "points")
        found = np.full((len(points), 4), np.nan)
        found[:, 0] = 0.0
        _nearest.nearest_to_point((points - tree.centre) / tree.scale, tree.nodes, tree.corners, found)
        patch = found[:, 0].astype(np.int64)
        both = np.einsum("ni,nik->nk", found[:, 1:], tree.corners[patch, :18].reshape(-1, 3, 6))
        normals = both[:, 3:] / np.linalg.norm(both[:, 3:], axis=1, keepdims=True)
        facets = np.where(np.isnan(found[:, 1]), -1, tree.corners[patch, FACET])
        return both[:, :3] * tree.scale + tree.centre, normals, facets.astype(np.int64)

    def transformed(self, pose: Pose) -> Mesh:
        """Return the same `Mesh` in another frame; `pose` is T_target_mesh."""
        vertices, normals = pose.apply(self.vertices), pose.rotate(self.corner_normals)
        return replace(self, vertices=vertices, corner_normals=normals, touchable=~self.covered)


@called_as("palpate.plane([0, 0, 0], [0, 0, 1])")
@takes_arrays
def plane(point: ArrayLike, normal: ArrayLike, half_width: float = 1.0) -> Mesh:
    """Make a square `Mesh` of two facets through `point`, pressed on its `normal` side.

    Args:
        point: (3,) its middle [m].
        normal: (3,) outward, of any length but zero.
        half_width: [m]; beyond it a wrench is OFF_SURFACE.

    Raises:
        InputError: point or normal is not three numbers.
        GeometryError: the normal is zero, the half-width is not positive, or a number is not finite.
    """
    middle, out = shaped(point, (3,), "point"), shaped(normal, (3,), "normal")
    length = np.linalg.norm(out)
    if not length > 0:
        raise GeometryError("the normal of a plane must not be zero.")
    if not half_width > 0:
        raise GeometryError(f"the half-width of a plane must be positive, not {half_width:g}.")
    out = out / length
    along = np.cross(out, np.eye(3)[np.argmin(np.abs(out))])
    along /= np.linalg.norm(along)
    across = np.cross(out, along)
    corners = [middle + half_width * (i * along + j * across) for i, j in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    return Mesh.from_arrays(corners, [[0, 1, 2], [0, 2, 3]])


def _announced(facets: int) -> AbstractContextManager[None]:
    """Return a context that announces the preparation of a large mesh."""
    return waiting(f"preparing a mesh of {facets:,} facets") if facets >= _LARGE else nullcontext()


def _in_region(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], region: ArrayLike) -> np.ndarray:
    """Return which facets a box or a list keeps, (f,)."""
    array = np.asarray(region)
    if array.shape == (2, 3):
        middle = vertices[faces].mean(axis=1)
        low, high = np.minimum(*array), np.maximum(*array)
        kept = np.all((middle >= low) & (middle <= high), axis=1)
    elif array.ndim == 1 and np.issubdtype(array.dtype, np.integer):
        if len(beyond := array[(array < 0) | (array >= len(faces))]):
            raise GeometryError(f"region names facet {beyond[0]}, but there are {len(faces)} facets, counted from 0.")
        kept = np.zeros(len(faces), dtype=bool)
        kept[array] = True
    else:
        raise GeometryError("region must be two corners of a box [m] or a list of facet numbers.")
    if not kept.any():
        raise GeometryError("no facet is in the region: check that it is in metres.")
    return kept


def plausible_size(size: float) -> bool:
    """Return whether a size is that of a touched body: from 2 mm (a fingertip) to 5 m (a robot)."""
    return 2e-3 <= size <= 5.0


def unit_named(metres: float) -> str:
    """Return the name of a unit of that many metres, such as "mm", or its length in words if it has none."""
    return next((name for name, scale in UNITS.items() if isclose(scale, metres, rel_tol=1e-6)), f"{metres:g} m")


def _metres(unit: str | None, source: str, own: float | None = None) -> float:
    """Return the length [m] of a unit; `own` [m] is that of the unit that the source states, which it must equal."""
    if unit is None and own is not None:
        return own
    if unit is None or unit not in UNITS:
        missing = "the unit of the mesh's numbers is not given (unit=...)."
        what = missing if unit is None else f"unknown unit {unit!r}."
        raise InputError(what, where=source, hint=f'Write unit="mm", or another of {", ".join(UNITS)}.')
    if own is not None and not isclose(own, UNITS[unit], rel_tol=1e-6):
        what = f"the unit is given as {unit!r}, but the file states its own, {unit_named(own)!r}."
        raise InputError(what, where=source, hint="Leave the unit out, or correct <unit> in the file.")
    return UNITS[unit] if own is None else own


def _doubts(mesh: Mesh, metres: float) -> tuple[str, ...]:
    """Return a warning about an implausible size, most often of a wrong unit."""
    if plausible_size(mesh.size):
        return ()
    likely = [name for name, scale in UNITS.items() if plausible_size(mesh.size / metres * scale)]
    hint = f": its size would be plausible in {' or '.join(likely)}" if likely else ""
    return (f"the mesh is {mesh.size:.4g} m across if its unit is {unit_named(metres)}; check the unit{hint}",)
