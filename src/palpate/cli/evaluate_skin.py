"""`palpate evaluate` for contacts of a taxel sheet: against a wrench, a wand or known points, with a report."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from palpate.cli.screen import lines, note, table, title
from palpate.errors import InputError
from palpate.evaluation.errors import Spread
from palpate.evaluation.evaluate import nearest_in_time
from palpate.evaluation.skin import Reference, SkinReport, equivalent_forces, judge, map_mesh, touches_of, wand_points
from palpate.io.atomic import keep_inputs, write_text
from palpate.io.contacts import Contacts
from palpate.io.rig.skin import SkinRig, load_skin_rig
from palpate.io.tables.table import Table, read_table
from palpate.sensors.skin_map import SkinMap
from palpate.spatial.pose import rotation_from_quaternion
from palpate.surfaces.mesh import Mesh
from palpate.viewer.maps import sheet_map
from palpate.viewer.report import Report, Section, Tile, picture, render, require_report
from palpate.viewer.report import Table as Cells

__all__ = ["WAND", "WRENCH", "evaluate_skin", "write_skin_report"]

WRENCH = ("fx", "fy", "fz", "tx", "ty", "tz")
WAND = ("x", "y", "z", "qx", "qy", "qz", "qw")


@dataclass(frozen=True)
class _Touch:
    """A touch that is compared: its rows, as medians."""

    name: str
    time: float
    point: np.ndarray
    normal: np.ndarray
    row: float
    column: float
    alone: bool


def evaluate_skin(
    contacts: Path,
    found: Contacts,
    truth: Path,
    rig_path: Path,
    *,
    wand: Path | None,
    unit: str,
    tolerance: float,
    report: Path | None,
) -> None:
    """Compare the touches of a sheet with what the columns of `truth` say: a wrench, or poses of a wand."""
    rig = load_skin_rig(rig_path)
    if report is not None:
        keep_inputs(report, (contacts, truth, rig_path, wand))
        require_report()
    place = rig.place()
    touches = _touches(found)
    if not touches:
        raise InputError("no touch lasts three samples or more.", where=str(contacts))
    known = read_table(truth)
    surface, of = _surface(rig, place)
    reference = _reference(known, touches, surface, rig, wand=wand, unit=unit, tolerance=tolerance)
    if all(reference.refused):
        raise InputError(
            f"none of {len(touches)} touches can be compared; the first: {reference.refused[0]}.", where=str(truth)
        )
    judged = judge(
        np.array([touch.point for touch in touches]),
        np.array([touch.normal for touch in touches]),
        reference,
        place.pitch,
    )
    title(f"{contacts} against {truth}, {reference.name}")
    lines(_summary(judged, touches))
    table(("", "mean", "median", "95 %", "worst", "count"), _spreads(judged))
    note([f"{of}", *_refusals(judged, touches)])
    if report is not None:
        write_skin_report(report, contacts.name, truth.name, judged, touches, of)


def _touches(found: Contacts) -> list[_Touch]:
    located = np.asarray(np.isfinite(found.estimate.point).all(axis=1))
    cell = np.full((len(found), 3), np.nan) if found.cell is None else found.cell
    made: list[_Touch] = []
    for identity, rows, alone in touches_of(found.contact, located, found.sample):
        normal = np.median(found.estimate.normal[rows], axis=0)
        row, column = (float(value) for value in np.median(cell[rows, :2], axis=0))
        made.append(
            _Touch(
                str(identity),
                float(np.median(found.time[rows])),
                np.median(found.estimate.point[rows], axis=0),
                normal / np.linalg.norm(normal),
                row,
                column,
                alone,
            )
        )
    return made


def _surface(rig: SkinRig, place: SkinMap) -> tuple[Mesh, str]:
    """Of the link: the rig's, or else the map itself."""
    if rig.surface is None:
        return map_mesh(place), "the rig has no [surface]: the sensing layer of the map stands for the link"
    return rig.surface.load(rig.folder).drawn(), "lines and wand are met with the mesh of the rig's [surface]"


def _reference(
    known: Table, touches: list[_Touch], surface: Mesh, rig: SkinRig, *, wand: Path | None, unit: str, tolerance: float
) -> Reference:
    """What the columns of the truth are."""
    times = np.array([touch.time for touch in touches])
    alone = np.array([touch.alone for touch in touches])
    if set(WRENCH) <= set(known.names):
        values = _at(known, WRENCH, times, tolerance)
        turn = rig.surface.pose.pose() if rig.surface is not None else None  # T_sensor_surface
        wrenches = values if turn is None else values @ turn.inverse().wrench_matrix().T
        return equivalent_forces(surface, wrenches, alone=alone)
    if set(WAND) <= set(known.names):
        if wand is None:
            raise InputError(
                "has poses of a wand, but its shape is not given.",
                where=str(known.path),
                mend="Add --wand wand.stl --wand-unit mm.",
            )
        poses = _at(known, WAND, times, tolerance)
        lost = np.asarray(np.isnan(poses).any(axis=1))
        rotation = rotation_from_quaternion(np.where(lost[:, None], [0, 0, 0, 1.0], poses[:, 3:]))
        vertices = Mesh.load(wand, unit=unit).vertices
        return wand_points(surface, vertices, rotation, np.where(lost[:, None], np.nan, poses[:, :3]))
    raise InputError(
        "says nothing that a skin can be compared with.",
        where=str(known.path),
        mend=f"It needs time and {','.join(WRENCH)} (about the origin of the link), or {','.join(WAND)} (a wand in the "
        "link's frame), or px,py,pz.",
    )


def _at(known: Table, columns: tuple[str, ...], times: np.ndarray, tolerance: float) -> np.ndarray:
    """Medians of what is within the tolerance of each time; NaN where there is nothing."""
    values, _ = known.numbers(("time", *columns))
    if not (nearest_in_time(times, values[:, 0], tolerance) >= 0).any():
        raise InputError(
            "no row lies at the time of a touch.",
            where=str(known.path),
            mend="Both must be on one clock; --tolerance widens the match.",
        )
    found = np.full((len(times), len(columns)), np.nan)
    for k, time in enumerate(times):
        near = values[np.abs(values[:, 0] - time) <= tolerance, 1:]
        near = near[np.isfinite(near).all(axis=1)]
        if len(near):
            found[k] = np.median(near, axis=0)
    return found


def _summary(judged: SkinReport, touches: list[_Touch]) -> list[tuple[str, str]]:
    along = ", ".join(f"{1e3 * error:.2f}" for error in judged.along)
    paper = judged.paper_position
    said = [
        ("touches", f"{len(touches)}, of which {len(touches) - sum(map(bool, judged.reference.refused))} are compared"),
        ("along x, y, z", f"{along} mm on average"),
        (
            "perfect map",
            f"errs {1e3 * judged.perfect[0]:.2f} mm, {1e3 * judged.perfect[1]:.2f} mm an axis, where touches are "
            "smaller than a cell",
        ),
    ]
    if paper is not None:
        share = judged.paper_direction
        directions = f"; directions {100 * share:.1f} %" if np.isfinite(share) else ""
        distance = f"{1e3 * paper.mean:.2f} mm, worst {1e3 * paper.worst:.2f} mm, z set to zero"
        said.append(("as the paper", distance + directions))
    return said


def _spreads(judged: SkinReport) -> list[tuple[str, ...]]:
    rows = (("position [mm]", judged.position, 1e3), ("direction [deg]", judged.direction, 180 / np.pi))
    return [
        (name, *(f"{scale * value:.3f}" for value in (s.mean, s.median, s.p95, s.worst)), f"{s.count}")
        for name, s, scale in rows
        if isinstance(s, Spread)
    ]


def _refusals(judged: SkinReport, touches: list[_Touch]) -> list[str]:
    named = zip(touches, judged.reference.refused, strict=True)
    return [f"touch {touch.name} at {touch.time:.2f} s is left out: {why}" for touch, why in named if why]


def write_skin_report(
    path: Path, contacts: str, truth: str, judged: SkinReport, touches: list[_Touch], of: str
) -> None:
    """One page: figures, every touch, and where on the unrolled sheet the errors are."""
    tiles = [Tile("touches", f"{len(touches)}", f"{judged.reference.name}"), *_tiles(judged)]
    judgements = zip(touches, judged.errors, judged.turned, judged.reference.refused, strict=True)
    rows = tuple(
        (*_told(touch), _shown(1e3 * error), _shown(float(np.degrees(turn))), why)
        for touch, error, turn, why in judgements
    )
    cells = np.array([[touch.row, touch.column] for touch in touches])
    drawn = picture(
        sheet_map(cells, 1e3 * judged.errors, "position error [mm]"),
        "Where the touches were on the unrolled sheet, and how far off.",
    )
    header = ("touch", "time [s]", "row", "column", "position [mm]", "direction [deg]", "left out because")
    sections = (Section("Errors", text=(of,), pictures=(drawn,), tables=(Cells(header, rows),)),)
    summary = f"{contacts} against {truth}: touches of a taxel sheet, each as the median of its samples."
    write_text(path, render(Report(f"{contacts} against {truth}", summary, tuple(tiles), sections=sections)))


def _tiles(judged: SkinReport) -> list[Tile]:
    tiles: list[Tile] = []
    for name, spread, scale, unit in (
        ("position", judged.position, 1e3, "mm"),
        ("direction", judged.direction, 180 / np.pi, "deg"),
    ):
        if spread is not None:
            worst = f"mean in space; worst {scale * spread.worst:.2f} {unit}"
            tiles.append(Tile(name, f"{scale * spread.mean:.2f} {unit}", worst))
    tiles.append(Tile("a perfect map", f"{1e3 * judged.perfect[0]:.2f} mm", "for touches smaller than a cell"))
    if judged.paper_position is not None:
        mean = f"{1e3 * judged.paper_position.mean:.2f} mm"
        tiles.append(Tile("as the paper measures", mean, "z set to zero; the paper 4.2 mm"))
    if np.isfinite(judged.paper_direction):
        share = f"{100 * judged.paper_direction:.1f} %"
        tiles.append(Tile("as the paper measures", share, "unit vectors, x and y; the paper 2.9 %"))
    return tiles


def _told(touch: _Touch) -> tuple[str, str, str, str]:
    return touch.name, f"{touch.time:.2f}", f"{touch.row:.2f}", f"{touch.column:.2f}"


def _shown(value: float | np.floating) -> str:
    return f"{value:.2f}" if np.isfinite(value) else "-"
