"""`palpate evaluate` against an instrument: a force/torque sensor that carries the body, or a tracked wand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Float

from palpate.cli.console import lines, note, table, title
from palpate.cli.error_table import HEADER, error_rows
from palpate.contact.contacts import Contacts
from palpate.errors import InputError
from palpate.evaluation.instruments import (
    InstrumentReport,
    Reference,
    alone,
    judge,
    map_mesh,
    medians,
    perfect,
    touch_rows,
    wand_points,
    wrench_points,
)
from palpate.evaluation.matching import nearest_in_time
from palpate.io.atomic import keep_inputs, write_text
from palpate.io.rig import Rig, load_rig
from palpate.io.rig.skin import rig_map
from palpate.io.tables.table import Table, read_table
from palpate.sensors.skin_map import SkinMap
from palpate.spatial.pose import rotation_from_quaternion
from palpate.surfaces.mesh import Mesh
from palpate.viewer.maps import sheet_map
from palpate.viewer.report import Report, Section, Tile, picture, render, require_report
from palpate.viewer.report import Table as Cells

__all__ = ["WAND", "WRENCH", "evaluate_instrument"]

WRENCH = ("fx", "fy", "fz", "tx", "ty", "tz")
WAND = ("x", "y", "z", "qx", "qy", "qz", "qw")


def evaluate_instrument(
    contacts: tuple[Path, Contacts],
    truth: Path,
    rig_path: Path,
    *,
    wand: tuple[Path, str] | None,
    tolerance: float,
    report: Path | None,
) -> None:
    """Compare touches with what the columns of `truth` say: a wrench, or poses of a wand.

    Args:
        contacts: the file, and what is in it, in the surface's frame.
        truth: time and `WRENCH` about the origin of the body, or time and `WAND` in the body's frame.
        rig_path: of the rig, which knows the body.
        wand: mesh of the wand and its unit.
        tolerance: [s]
        report: page to write as well.
    """
    path, found = contacts
    if report is not None:
        keep_inputs(report, (path, truth, rig_path, wand and wand[0]))
        require_report()
    rig = load_rig(rig_path)
    rows = touch_rows(found)
    if not rows:
        raise InputError("no touch lasts three samples or more.", where=str(path))
    touches, known = medians(found, rows), read_table(truth)
    place = rig_map(rig) if "skin" in rig.sensors else None
    surface, of = _surface(rig, place)
    if set(WRENCH) <= set(known.names):
        reference = wrench_points(surface, _wrenches(known, touches, rig, tolerance), alone=alone(found, rows))
    else:
        reference = _wand(known, touches, surface, wand, tolerance)
    if all(reference.refused):
        first = f"none of {len(touches)} touches can be compared; the first: {reference.refused[0]}."
        raise InputError(first, where=str(truth))
    judged = judge(touches, reference)
    title(f"{path} against {truth}, {reference.name}")
    lines([("touches", f"{len(touches)}, of which {judged.report.matched} are compared"), *_figures(judged, place)])
    table(HEADER, error_rows(judged.report))
    named = zip(touches.identity.tolist(), touches.time.tolist(), reference.refused, strict=True)
    note([of, *(f"touch {name} at {time:.2f} s is left out: {why}" for name, time, why in named if why)])
    if report is not None:
        write_text(report, render(_page(f"{path.name} against {truth.name}", judged, touches, place, of)))


def _surface(rig: Rig, place: SkinMap | None) -> tuple[Mesh, str]:
    """Of the body: the rig's, or else the map itself."""
    if rig.surface is not None:
        return rig.surface.load(rig.folder).drawn(), "lines and wand are met with the rig's [surface]"
    if place is None:
        raise InputError("the rig has no [surface] to meet the line of a force, or the wand.", where="rig")
    return map_mesh(place), "the rig has no [surface]: the sensing layer of the map stands for the body"


def _wrenches(known: Table, touches: Contacts, rig: Rig, tolerance: float) -> Float[np.ndarray, "n 6"]:
    """In the surface's frame."""
    values = _at(known, WRENCH, touches.time, tolerance)
    return values if rig.surface is None else values @ rig.surface.pose.pose().inverse().wrench_matrix().T


def _wand(known: Table, touches: Contacts, surface: Mesh, wand: tuple[Path, str] | None, tolerance: float) -> Reference:
    if wand is None:
        raise InputError(
            "has poses of a wand, but its shape is not given.",
            where=str(known.path),
            mend="Add --wand wand.stl --wand-unit mm.",
        )
    poses = _at(known, WAND, touches.time, tolerance)
    lost = np.asarray(np.isnan(poses).any(axis=1))
    rotation = rotation_from_quaternion(np.where(lost[:, None], [0, 0, 0, 1.0], poses[:, 3:]))
    vertices = Mesh.load(wand[0], unit=wand[1]).vertices
    return wand_points(surface, vertices, rotation, np.where(lost[:, None], np.nan, poses[:, :3]))


def _at(known: Table, columns: tuple[str, ...], times: np.ndarray, tolerance: float) -> Float[np.ndarray, "n k"]:
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


def _figures(judged: InstrumentReport, place: SkinMap | None) -> list[tuple[str, str]]:
    """What the table does not hold: along each axis, what a perfect map errs by, and the paper's measures."""
    along = ", ".join(f"{1e3 * error:.2f}" for error in judged.along)
    said, paper = [("along x, y, z", f"{along} mm on average")], judged.paper_position
    if place is not None:
        distance, axis = (1e3 * error for error in perfect(place.pitch))
        said.append(
            ("perfect map", f"errs {distance:.2f} mm, {axis:.2f} mm an axis, where touches are smaller than a cell")
        )
    if paper is not None:
        share = 100 * judged.paper_direction
        directions = f"; directions {share:.1f} %" if np.isfinite(share) else ""
        said.append(
            ("as the paper", f"{1e3 * paper.mean:.2f} mm, worst {1e3 * paper.worst:.2f} mm, z set to zero{directions}")
        )
    return said


def _page(name: str, judged: InstrumentReport, touches: Contacts, place: SkinMap | None, of: str) -> Report:
    """Figures, every touch, and where on the unrolled sheet the errors are."""
    report, cells = judged.report, {key: touches.features[key] for key in ("row", "column") if key in touches.features}
    tiles = [
        Tile(what, f"{scale * errors.mean:.2f} {unit}", f"mean; worst {scale * errors.worst:.2f} {unit}")
        for what, errors, scale, unit in (
            ("position", report.location, 1e3, "mm"),
            ("direction", report.normal, 180 / np.pi, "deg"),
        )
        if errors is not None
    ]
    if place is not None:
        tiles.append(
            Tile("a perfect map", f"{1e3 * perfect(place.pitch)[0]:.2f} mm", "for touches smaller than a cell")
        )
    if judged.paper_position is not None:
        mean = f"{1e3 * judged.paper_position.mean:.2f} mm"
        tiles.append(Tile("as the paper measures", mean, "z set to zero; the paper 4.2 mm"))
    if np.isfinite(judged.paper_direction):
        share = f"{100 * judged.paper_direction:.1f} %"
        tiles.append(Tile("as the paper measures", share, "unit vectors, x and y; the paper 2.9 %"))
    numbers = np.column_stack([touches.time, *cells.values(), 1e3 * judged.errors, np.degrees(judged.turned)])
    rows = tuple(
        (str(identity), *(f"{value:.2f}" if np.isfinite(value) else "-" for value in row), why)
        for identity, row, why in zip(touches.identity.tolist(), numbers, judged.reference.refused, strict=True)
    )
    header = ("touch", "time [s]", *cells, "position [mm]", "direction [deg]", "left out because")
    drawn = ()
    if len(cells) == 2 and place is not None:
        errors = sheet_map(np.column_stack(list(cells.values())), 1e3 * judged.errors, "position error [mm]")
        drawn = (picture(errors, "Where the touches were on the unrolled sheet, and how far off."),)
    sections = (Section("Errors", text=(of,), pictures=drawn, tables=(Cells(header, rows),)),)
    tiles = (Tile("touches", f"{len(touches)}", judged.reference.name), *tiles)
    return Report(name, f"{name}: each touch is the median of its samples.", tiles, sections=sections)
