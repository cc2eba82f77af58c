"""The [surface] of a rig: a mesh from a file, a link of a URDF, or an equation; and the link with it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from math import inf, radians
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError
from palpate.files.schema import covariance_matrix
from palpate.files.urdf import GEOMETRIES, LinkBody, Urdf
from palpate.setup.tables import Four, Three, require_path, require_positive
from palpate.spatial.pose import Pose
from palpate.surfaces import (
    UNITS,
    Cylinder,
    Ellipsoid,
    EllipticCylinder,
    Mesh,
    Paraboloid,
    Sphere,
    Surface,
    plane,
    superquadric,
)
from palpate.surfaces.mesh import plausible_size

EQUATIONS: dict[str, tuple[Callable[..., Surface], tuple[str, ...]]] = {
    "sphere": (Sphere, ("radius",)),
    "ellipsoid": (Ellipsoid, ("axes",)),
    "cylinder": (Cylinder, ("radius", "half_length", "upper")),
    "elliptic_cylinder": (EllipticCylinder, ("a", "b", "half_length", "upper")),
    "paraboloid": (Paraboloid, ("radii", "height")),
    "superquadric": (superquadric, ("axes", "exponents")),
}
OF_ANY_MESH = ("crease", "region", "covered", "pose", "pose_covariance", "placement")  # keys that another mesh keeps
_KINDS = ("mesh", "plane", *EQUATIONS)
_LENGTHS = tuple(dict.fromkeys(name for _, names in EQUATIONS.values() for name in names))


@dataclass(frozen=True)
class RigPose:
    """Pose of the surface, or of a link, in the sensor's frame: position [m] and unit quaternion.

    Raises:
        ValueError: the quaternion's length is not 1 within 1 %.
    """

    xyz: Three = (0.0, 0.0, 0.0)
    quaternion_xyzw: Four = (0.0, 0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        if not abs(np.linalg.norm(self.quaternion_xyzw) - 1.0) <= 0.01:  # NaN too
            given = list(self.quaternion_xyzw)
            raise ValueError(f"quaternion_xyzw {given} must have length 1 (the order is x, y, z, w)")

    def pose(self) -> Pose:
        """Return the pose as a `Pose`."""
        return Pose.from_quaternion(self.quaternion_xyzw, self.xyz)


@dataclass(frozen=True)
class RigRegion:
    """The part of the mesh that can be touched: a box in the mesh's frame [m], or facets counted from 0."""

    box: tuple[Three, Three] | None = None
    facets: tuple[int, ...] | None = None


@dataclass(frozen=True)
class RigSurface:
    """The surface that is touched: a `mesh` with its `unit`, a `link` of a `urdf`, or another `kind` with lengths [m].

    `geometry` of a link is "visual" or "collision"; None: the first of these that it has. `packages`: name -> folder,
    for packages of the URDF that are not found otherwise. The `unit` of a DAE that states its own is not needed.

    Facets that meet at less than `crease` [degrees] are smooth across their edge. With `covered` = true, facets that
    cannot be reached from outside give contacts too.

    plane: a `point`, a `normal` and a `half_width`. sphere: `radius`. ellipsoid: `axes` (three half-lengths).
    cylinder, along y: `radius` and `half_length`. elliptic_cylinder: half-axes `a` along x and `b` along z, and
    `half_length`; `upper` = true for its half with z >= 0. paraboloid: `radii` of curvature at its apex along x and y,
    and `height`. superquadric: `axes` and `exponents`. See `palpate.surfaces`.

    `pose_covariance`: 6 x 6, of (rotation vector [rad], translation [m]). `placement` [m]: standard deviation of a
    touch's place beyond what its wrench explains.

    Raises:
        ValueError: a value is unknown or out of bounds, a key that the kind needs is missing, or one does not belong.
    """

    kind: str = "mesh"
    mesh: str | None = None
    unit: str | None = None
    urdf: str | None = None
    link: str | None = None
    geometry: str | None = None
    packages: Mapping[str, str] = field(default_factory=lambda: {}, hash=False)
    crease: float = 30.0
    region: RigRegion = field(default_factory=RigRegion)
    covered: bool = False
    point: Three = (0.0, 0.0, 0.0)
    normal: Three = (0.0, 0.0, 1.0)
    half_width: float = 1.0
    radius: float | None = None
    axes: Three | None = None
    a: float | None = None
    b: float | None = None
    half_length: float | None = None
    upper: bool = False
    radii: tuple[float, float] | None = None
    height: float | None = None
    exponents: tuple[float, float] | None = None
    pose: RigPose = field(default_factory=RigPose)
    pose_covariance: tuple[tuple[float, ...], ...] | None = None
    placement: float = 0.0

    def __post_init__(self) -> None:
        if self.kind not in _KINDS:
            raise ValueError(f"kind must be one of {', '.join(_KINDS)}, not {self.kind!r}")
        require_path("mesh", self.mesh)
        require_path("urdf", self.urdf)
        if self.urdf is not None:
            self._require_link()
        elif self.link is not None or self.geometry is not None or self.packages:
            raise ValueError("link, geometry and packages need a urdf, which is missing")
        elif self.kind == "mesh" and self.mesh is None:
            raise ValueError("mesh, the file of the surface, is missing")
        elif self.kind == "mesh" and self.unit not in UNITS and not (self.unit is None and _may_state(self.mesh)):
            raise ValueError(f"unit of the mesh must be one of {', '.join(UNITS)}, not {self.unit!r}")
        if not 0 <= self.crease <= 180:
            raise ValueError(f"crease must be between 0 and 180 degrees, not {self.crease:g}")
        require_positive(self, "half_width")
        if not 0 < np.linalg.norm(self.normal) < inf:
            raise ValueError("normal must not be zero")
        if not 0 <= self.placement <= 1:  # NaN too
            raise ValueError(f"placement must be a standard deviation [m] from 0 to 1, not {self.placement:g}")
        if self.pose_covariance is not None:
            covariance_matrix(self.pose_covariance, 6, "pose_covariance")
        self._require_lengths()

    def _require_link(self) -> None:
        if self.kind != "mesh" or self.mesh is not None or self.unit is not None:
            raise ValueError("a urdf states what is touched and its unit (m): leave mesh, unit and kind out")
        if self.link is None:
            raise ValueError("link, the link of the urdf that is touched, is missing")
        if self.geometry is not None and self.geometry not in GEOMETRIES:
            raise ValueError(f"geometry must be one of {', '.join(GEOMETRIES)}, not {self.geometry!r}")

    def _body(self, folder: Path) -> LinkBody:
        packages = {name: folder / path for name, path in self.packages.items()}
        return Urdf(folder / str(self.urdf), packages).body(str(self.link), self.geometry)

    def files(self, folder: Path) -> dict[str, Path]:
        """Return a dict, key -> path: "mesh", or "urdf" and, if it can be read, its meshes "mesh", "mesh_2", ..."""
        if self.urdf is None:
            return {} if self.mesh is None else {"mesh": folder / self.mesh}
        found = {"urdf": folder / self.urdf}
        with suppress(InputError):  # which `load` says
            for k, file in enumerate(self._body(folder).files):
                found["mesh" if k == 0 else f"mesh_{k + 1}"] = file
        return found

    def _require_lengths(self) -> None:
        needed = EQUATIONS[self.kind][1] if self.kind in EQUATIONS else ()
        for name in ("mesh", "covered", *_LENGTHS) if needed else _LENGTHS:
            if name not in needed and getattr(self, name) not in (None, False):
                raise ValueError(f"{name} does not belong to kind = {self.kind!r}")
        for name in needed:
            value: Any = getattr(self, name)
            if value is None:
                raise ValueError(f"{name} is missing: a {self.kind} needs {', '.join(needed)} (in metres)")
            if not np.all((np.asarray(value) > 0) & (np.asarray(value) < inf)) and name != "upper":
                raise ValueError(f"{name} must be positive and finite, not {value}")

    def load(self, folder: Path) -> Surface:
        """Return the `Surface` in metres; relative paths start at `folder`.

        Raises:
            InputError: the mesh or the URDF cannot be read, or the URDF has no such link or geometry.
            GeometryError: the file has no usable surface, or the lengths describe none.
        """
        if self.kind == "plane":
            return plane(self.point, self.normal, self.half_width)
        if self.kind in EQUATIONS:
            return self._equation()
        region = self.region.box if self.region.box is not None else self.region.facets
        options: dict[str, Any] = {"crease": radians(self.crease), "region": region, "covered": self.covered}
        if self.urdf is not None:
            return self._body(folder).mesh(f"link {self.link!r} of {self.urdf}", **options)
        return Mesh.load(folder / str(self.mesh), unit=self.unit, **options)

    def _equation(self) -> Surface:
        make, names = EQUATIONS[self.kind]
        lengths = {name: getattr(self, name) for name in names}
        made = make(**lengths)
        doubt = f"the {self.kind.replace('_', ' ')} is {made.size:.4g} m across: check that its lengths are in metres"
        return made if plausible_size(made.size) else make(**lengths, notes=(doubt,))


def _may_state(mesh: str | None) -> bool:
    """Check whether a mesh file has a format that may state its own unit."""
    return mesh is not None and Path(mesh).suffix.lower() == ".dae"


@dataclass(frozen=True)
class Link:
    """A link of a robot, with its surface in the sensors' frame.

    Attributes:
        stated: the [surface] of the rig; None if a skin alone is the body.
        folder: where relative paths start.
    """

    stated: RigSurface | None
    folder: Path

    @property
    def mount(self) -> Pose:
        """T_sensor_surface; the identity without a surface."""
        return Pose.identity() if self.stated is None else self.stated.pose.pose()

    @property
    def mount_covariance(self) -> Float[np.ndarray, "6 6"] | None:
        """Covariance (6, 6) of `mount`, of (rotation vector [rad], translation [m]); None: not known."""
        stated = None if self.stated is None else self.stated.pose_covariance
        return None if stated is None else np.asarray(stated, dtype=np.float64)

    @property
    def placement(self) -> float:
        """Standard deviation [m] of a touch's place beyond what its wrench explains; 0.0 without a surface."""
        return 0.0 if self.stated is None else self.stated.placement

    @property
    def settings(self) -> dict[str, object]:
        """Settings of the surface for a result's record: {"crease": [degrees]}; {} without a surface."""
        return {} if self.stated is None else {"crease": self.stated.crease}

    @property
    def name(self) -> str:
        """Name of the surface for a sentence: its file, its link, or its kind with an article ("a sphere")."""
        if self.stated is None:
            return "the body"
        if self.stated.urdf is not None:
            return f"{self.stated.link} of {Path(self.stated.urdf).name}"
        kind = self.stated.kind.replace("_", " ")
        return Path(str(self.stated.mesh)).name if kind == "mesh" else f"{'an' if kind[0] in 'aeiou' else 'a'} {kind}"

    def surface(self) -> Surface:
        """Return the `Surface` that is touched; its files are read once.

        Raises:
            InputError: the rig has no [surface], or one of its files cannot be read.
            GeometryError: the file has no usable surface.
        """
        return self._surface

    @cached_property
    def _surface(self) -> Surface:
        if self.stated is None:
            raise InputError("the rig has no [surface].", where="rig", hint='Add it, with mesh = "FILE".')
        files = [path for path in self.stated.files(self.folder).values() if path.is_file()]
        stamps = tuple((path.stat().st_mtime_ns, path.stat().st_size) for path in files)
        return _read(self.stated, self.folder, stamps)


@lru_cache(maxsize=1)
def _read(stated: RigSurface, folder: Path, stamps: tuple[tuple[int, int], ...]) -> Surface:
    """Read a surface, anew if `stamps`, (mtime [ns], size) of its files, have changed."""
    return stated.load(folder)
