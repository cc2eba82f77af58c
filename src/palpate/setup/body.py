"""Describe the body given to `palpate rig new`: a mesh file, whose unit is guessed if need be, or a link of a URDF."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from palpate.errors import InputError
from palpate.files.urdf import Urdf
from palpate.setup.guess import mesh_size, quoted
from palpate.spatial.pose import Pose
from palpate.surfaces.collada import ColladaAsset
from palpate.surfaces.mesh import plausible_size

_MESH = """\
[surface]
mesh = {mesh}
unit = "{unit}"                        # of the mesh file: m, cm, mm, um, in; it makes the surface {size:.4g} mm across
"""
_STATED = """\
[surface]
mesh = {mesh}   # it states its own unit, {unit}, which makes the surface {size:.4g} mm across
"""
_LINK = """\
[surface]
urdf = {urdf}
link = {link}{packages}
geometry = "{geometry}"              # or "{other}"; as it stands the surface is {size:.4g} mm across
"""
_BOTH = """\
crease = 30                          # degrees: normals are smooth within it, split across it; 0 is faceted
{how}
pose = {{ xyz = {xyz}, quaternion_xyzw = {turn} }}
# region = {{ box = [[-0.01, -0.01, 0], [0.01, 0.01, 0.02]] }}   # m: if only a part of the mesh can be touched

"""
_DRAWN = (
    "# Where the surface sits in the sensor's frame, from a drawing; `palpate calibrate mounting` makes it right.",
    "[0, 0, 0]",
    "[0, 0, 0, 1]",
)


@dataclass(frozen=True)
class GivenBody:
    """The body that is touched: a mesh, or a link of a URDF.

    Attributes:
        path: the mesh file or the URDF.
        unit: unit of the numbers in the file.
        size: [m] across.
        urdf, link: the URDF and its link; None and "" for a mesh.
        geometry: "visual" or "collision"; "" for a mesh.
        folder: folder of the rig, where relative paths start.
        asset: the unit and the up axis that the mesh file states.
        notes: on the meshes of a link, a sentence each.
    """

    path: Path
    unit: str
    size: float
    urdf: Urdf | None = None
    link: str = ""
    geometry: str = ""
    folder: Path = Path()
    asset: ColladaAsset = field(default_factory=ColladaAsset)
    notes: tuple[str, ...] = ()

    @classmethod
    def of(cls, path: Path, link: str | None = None, packages: Mapping[str, Path] | None = None) -> GivenBody:
        """Return the `GivenBody` of a file; a mesh's unit is guessed from its size unless the file states it.

        Args:
            path: a mesh, or a URDF.
            link: the URDF's link.
            packages: name -> folder, for packages of the URDF that are not found otherwise.

        Raises:
            InputError: the file or a mesh of the URDF cannot be read, a URDF's link is not named or has no geometry, or
                a mesh's is named.
            GeometryError: the mesh file has no usable surface.
        """
        if path.suffix.lower() not in (".urdf", ".xacro", ".xml"):
            if link is not None or packages:
                raise InputError("is a mesh, which has no links and no packages.", where=str(path), hint="Name a URDF.")
            return cls(path, *mesh_size(path), asset=ColladaAsset.of(path))
        urdf = Urdf(path, packages)
        if link is None:
            shaped = ", ".join(urdf.shaped()[:12]) or "none with a geometry"
            raise InputError("has several links.", where=str(path), hint=f"Name one with --link: {shaped}.")
        made = urdf.body(link)
        across = float(np.linalg.norm(np.ptp(made.vertices, axis=0)))
        return cls(path, "m", across, urdf, link, made.geometry, notes=made.notes)

    def text(self, frame: str) -> str:
        """Return the [surface] of a rig as TOML text; `frame` is the log's name of the sensor's frame, or ""."""
        (how, xyz, turn), pose = _DRAWN, self.mounting(frame)
        if pose is not None:
            named = _comment(frame)
            how = f"# Of the link in the sensor's frame ({named}), by the URDF (`palpate calibrate mounting`)."
            xyz, turn = pose.translation.tolist(), pose.quaternion().tolist()
        return self._source() + _BOTH.format(how=how, xyz=xyz, turn=turn)

    def _source(self) -> str:
        path, size = self.relative(self.path), 1e3 * self.size
        if self.urdf is None:
            return (_MESH if self.asset.metres is None else _STATED).format(mesh=path, unit=self.unit, size=size)
        pairs = [f"{quoted(name)} = {self.relative(where)}" for name, where in self.urdf.packages.items()]
        return _LINK.format(
            urdf=path,
            link=quoted(self.link),
            packages=f"\npackages = {{ {', '.join(pairs)} }}" if pairs else "",
            geometry=self.geometry,
            other="collision" if self.geometry == "visual" else "visual",
            size=size,
        )

    def relative(self, path: Path) -> str:
        """Return a path relative to the rig's folder, quoted for TOML."""
        return quoted(Path(os.path.relpath(path.resolve(), self.folder.resolve())).as_posix())

    def mounting(self, frame: str) -> Pose | None:
        """Return T_sensor_surface if fixed joints join link `frame` (the sensor) and the body, else None."""
        if self.urdf is None or frame not in self.urdf.links:
            return None
        try:
            quaternion, position = self.urdf.fixed().path(frame, self.link).at(np.zeros(1))
        except InputError:
            return None
        return Pose.from_quaternion(quaternion[0], position[0])

    def remarks(self, frame: str) -> list[str]:
        """Return what to check about the surface, one sentence each; `frame` as in `text`."""
        if self.urdf is None:
            stated = self.asset.metres is not None
            how = f"states its unit, {self.unit!r}" if stated else f"is taken to be in {self.unit}"
            taken = f"the mesh {how}, which makes it {self.size * 1e3:.4g} mm across"
            return [*([taken] if stated or self.unit != "m" else []), *filter(None, [self.asset.note])]
        said = [f"the surface is the {self.geometry} geometry of link {self.link!r}, {self.size * 1e3:.4g} mm across"]
        said += self.notes
        if not plausible_size(self.size):
            why = "that is an unusual size of a robot's link"
            said.append(f"{why}: check the scale of its mesh in the URDF (0.001 for mm)")
        if self.mounting(frame) is not None:
            return [*said, f"its place in the sensor ({frame!r}) is read from the URDF's fixed joints"]
        if not frame:
            why = "the log does not name the sensor's frame"
        elif frame not in self.urdf.links:
            why = f"the sensor's frame {frame!r} is not a link of the URDF"
        else:
            why = f"no fixed joints join the sensor's frame {frame!r} and link {self.link!r}"
        return [*said, f"{why}: write the link's pose in the sensor's frame as pose in [surface]"]


def _comment(name: str) -> str:
    """Return a name that is safe in a comment, with "?" for letters that cannot be printed."""
    return "".join(letter if letter.isprintable() else "?" for letter in name)
