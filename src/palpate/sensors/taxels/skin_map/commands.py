"""Define `palpate map skin`."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from tyro.conf import FlagCreatePairsOff, arg

from palpate.console.console import lines, note, title, wait
from palpate.console.options import MeshFile, Output
from palpate.errors import InputError
from palpate.files.atomic import keep_inputs
from palpate.files.models import provenance
from palpate.sensors.taxels.skin_map import Planes, Sheet, fit_stretch
from palpate.sensors.taxels.skin_map import map_skin as isometric
from palpate.sensors.taxels.skin_map.files import require_suffix, write_skin_map
from palpate.sensors.taxels.skin_map.model_file import of_skin_map
from palpate.sensors.taxels.skin_map.paper import paper_map
from palpate.surfaces import UNITS, Mesh

__all__ = ["map_skin"]

Vector = Annotated[str, arg(metavar="X,Y,Z")]


@dataclass(frozen=True)
class Options:
    """The sheet, where it lies, and how the surface is fitted.

    Args:
        unit: of the mesh's numbers, and of --origin, --axis, --heights and --known: m, cm, mm, um or in.
        sheet: rows x columns of cells, such as 6x22.
        cell: size of a cell [mm], or its height along a column and width along a row, such as 10x8.
        origin: outer corner of cell (0, 0), on the mesh.
        heading: direction of increasing column there; its part along the surface counts.
        flip: rows increase to the right of the heading, seen from outside; else to the left.
        thickness: of the material between the link and the sensing layer [mm].
        stretch: factor by which the sheet is stretched, or one across its rows and one along them.
        known: centres of some cells, to which the stretch is fitted.
        mode: facets follows the mesh as it is; vertices the smooth shape that its vertices sample; auto lets the mesh
            decide and prints why.
        axis: a point and the direction of the link's axis, instead of the axis found from the mesh.
        heights: breaks of the spline's pieces along the axis, from that point.
        angles: their breaks about the axis [deg], from the origin's side.
        control: largest number of the spline's control points.
        method: isometric, or the paper's: even planes, and cells at equal parameters over the complete link.
    """

    unit: Annotated[str, arg(metavar="UNIT")]
    sheet: Annotated[str, arg(metavar="RxC")]
    cell: Annotated[str, arg(metavar="MM")]
    origin: Vector
    heading: Vector
    flip: Annotated[bool, FlagCreatePairsOff] = False
    thickness: Annotated[float, arg(metavar="MM")] = 0.0
    stretch: Annotated[str, arg(metavar="S[,S]")] = "1"
    known: Annotated[tuple[str, ...], arg(metavar="R,C,X,Y,Z")] = ()
    mode: Literal["auto", "facets", "vertices"] = "auto"
    axis: Annotated[str, arg(metavar="X,Y,Z,DX,DY,DZ")] = ""
    heights: Annotated[str, arg(metavar="H,H,...")] = ""
    angles: Annotated[str, arg(metavar="A,A,...")] = ""
    control: Annotated[int, arg(metavar="N")] = 200
    method: Literal["isometric", "paper"] = "isometric"

    def laid(self, link: Mesh) -> tuple[Sheet, Planes, np.ndarray, np.ndarray]:
        """Return the `Sheet`, stretched to the known cells, `Planes`, the sheet's corner (3,) [m] and heading (3,).

        Raises:
            InputError: an option that cannot be read, or known cells or a sheet that do not fit the link.
            GeometryError: with known cells, a link that cannot be cut by planes about the origin.
        """
        scale = UNITS[self.unit]
        rows, columns = (int(side) for side in _numbers(self.sheet, "--sheet", 2, "x", whole=True))
        pitch, pulled = _pair(self.cell.replace("x", ","), "--cell"), _pair(self.stretch, "--stretch")
        flat = Sheet(rows, columns, (1e-3 * pitch[0], 1e-3 * pitch[1]), 1e-3 * self.thickness, self.flip, pulled)
        origin = scale * np.array(_numbers(self.origin, "--origin", 3))
        heading = np.array(_numbers(self.heading, "--heading", 3))
        spine = np.array(_numbers(self.axis, "--axis", 6)) if self.axis else None
        planes = Planes(
            axis=None if spine is None else (scale * spine[:3], spine[3:]),
            heights=scale * np.array(_numbers(self.heights, "--heights", None)) if self.heights else None,
            angles=np.radians(_numbers(self.angles, "--angles", None)) if self.angles else None,
        )
        if self.known:
            points = [_numbers(text, "--known", 5) for text in self.known]
            where = {(int(point[0]), int(point[1])): scale * np.array(point[2:]) for point in points}
            flat = fit_stretch(link, flat, where, origin=origin, heading=heading, mode=self.chosen, planes=planes)
        return flat, planes, origin, heading

    @property
    def chosen(self) -> Literal["facets", "vertices"] | None:
        """Return the mode, "facets" or "vertices"; None: the mesh decides."""
        return None if self.mode == "auto" else self.mode


def map_skin(mesh: MeshFile, /, output: Output, options: Annotated[Options, arg(name="")]) -> None:
    """Lay a flexible taxel sheet on a link's mesh.

    Fit a smooth surface to a link's mesh, lay the sheet on it without stretching, and write where its cells are.

    Args:
        mesh: of the link: STL, OBJ, PLY or DAE, as its maker ships it.
        output: map to write: .toml, .csv, .txt (iCub) or .urdf.
        options: the sheet, its place and the fit.

    Raises:
        InputError: an option or a sheet that does not fit the link, or a file that cannot be read or written.
        GeometryError: a mesh without a usable facet, or a link that cannot be cut by planes about the origin.
        OSError: an input cannot be read for its digest.
    """
    keep_inputs(output, (mesh,))
    require_suffix(output)
    link = Mesh.load(mesh, options.unit)
    wait("loading the compiled loops (the first time they are compiled, which takes a while) ...")
    flat, planes, origin, heading = options.laid(link)
    said = {name: None if value == "" else value for name, value in vars(options).items() if name != "known"}
    record = provenance({"mesh": mesh}, said | {"stretch": ",".join(repr(side) for side in flat.stretch)})
    place: dict[str, Any] = {"origin": origin, "heading": heading, "planes": planes, "provenance": record}
    if options.method == "paper":
        skin = paper_map(link, flat, **place)
    else:
        skin = isometric(link, flat, mode=options.chosen, control=options.control, **place)
    write_skin_map(output, skin, name=re.sub("[^0-9A-Za-z]", "_", output.stem))
    title(f"{mesh} -> {output}")
    lines(of_skin_map(skin))
    if flat.stretch != (1.0, 1.0):
        lines([("stretch", f"{flat.stretch[0]:.4f} across rows, {flat.stretch[1]:.4f} along them")])
    note([*link.notes, *skin.notes])


def _pair(text: str, name: str) -> tuple[float, float]:
    values = _numbers(text, name, None)
    if len(values) not in (1, 2):
        raise InputError(f"must be one number, or two with a comma between, not {text!r}.", where=name)
    return values[0], values[-1]


def _numbers(text: str, name: str, count: int | None, by: str = ",", *, whole: bool = False) -> list[float]:
    """Return the numbers in an argument; raise an InputError that states the expected form."""
    try:
        values = [float(int(part)) if whole else float(part) for part in text.lower().split(by)]
    except ValueError:
        values = []
    if not values or (count is not None and len(values) != count) or not np.isfinite(values).all():
        expected = f"{count} {'whole ' if whole else ''}numbers" if count else "numbers"
        raise InputError(f"must be {expected} with {by!r} between, not {text!r}.", where=name)
    return values
