"""A link of a robot with the surface that a rig states for it, read from its files or made from an equation."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property, lru_cache
from math import radians
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError
from palpate.files.urdf import LinkBody, Urdf
from palpate.setup.tables import EQUATIONS, RigSurface
from palpate.spatial.pose import Pose
from palpate.surfaces import Mesh, Surface, plane
from palpate.surfaces.mesh import plausible_size


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
        files = [path for path in self.files().values() if path.is_file()]
        stamps = tuple((path.stat().st_mtime_ns, path.stat().st_size) for path in files)
        return _read(self.stated, self.folder, stamps)

    def files(self) -> dict[str, Path]:
        """Return a dict, key -> path: "mesh", or "urdf" and, if it can be read, its meshes "mesh", "mesh_2", ..."""
        if self.stated is None or self.stated.urdf is None:
            return {} if self.stated is None or self.stated.mesh is None else {"mesh": self.folder / self.stated.mesh}
        found = {"urdf": self.folder / self.stated.urdf}
        with suppress(InputError):  # which `surface` raises
            for k, file in enumerate(_body(self.stated, self.folder).files):
                found["mesh" if k == 0 else f"mesh_{k + 1}"] = file
        return found


@lru_cache(maxsize=1)
def _read(stated: RigSurface, folder: Path, stamps: tuple[tuple[int, int], ...]) -> Surface:
    """Read a surface, anew if `stamps`, (mtime [ns], size) of its files, have changed."""
    if stated.kind == "plane":
        return plane(stated.point, stated.normal, stated.half_width)
    if stated.kind in EQUATIONS:
        return _equation(stated)
    region = stated.region.box if stated.region.box is not None else stated.region.facets
    options: dict[str, Any] = {"crease": radians(stated.crease), "region": region, "covered": stated.covered}
    if stated.urdf is not None:
        return _body(stated, folder).mesh(f"link {stated.link!r} of {stated.urdf}", **options)
    return Mesh.load(folder / str(stated.mesh), unit=stated.unit, **options)


def _equation(stated: RigSurface) -> Surface:
    make, names = EQUATIONS[stated.kind]
    lengths = {name: getattr(stated, name) for name in names}
    made = make(**lengths)
    doubt = f"the {stated.kind.replace('_', ' ')} is {made.size:.4g} m across: check that its lengths are in metres"
    return made if plausible_size(made.size) else make(**lengths, notes=(doubt,))


def _body(stated: RigSurface, folder: Path) -> LinkBody:
    packages = {name: folder / path for name, path in stated.packages.items()}
    return Urdf(folder / str(stated.urdf), packages).body(str(stated.link), stated.geometry)
