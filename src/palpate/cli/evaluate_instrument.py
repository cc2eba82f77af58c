"""Run `palpate evaluate` against a force/torque sensor that carries the body, or a tracked wand."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from palpate.console.console import lines, note, table, title
from palpate.contact.contacts import Contacts
from palpate.errors import InputError
from palpate.evaluation.errors import HEADER, ErrorSummary
from palpate.evaluation.instruments import (
    InstrumentReport,
    Reference,
    judge,
    perfect,
    touches_of,
    wand_points,
    wrench_points,
)
from palpate.evaluation.matching import nearest_in_time
from palpate.files.atomic import keep_inputs, write_text
from palpate.files.tables.table import TextTable, read_table
from palpate.sensors.taxels.section import SkinSection
from palpate.setup import load_rig
from palpate.setup.link import Link
from palpate.setup.setup import Setup
from palpate.spatial.pose import rotation_from_quaternion
from palpate.surfaces.mesh import Mesh
from palpate.viewer.maps import sheet_map
from palpate.viewer.report import Report, Section, Tile, picture, render, require_report
from palpate.viewer.report import ReportTable as Cells
from palpate.viewer.samples import sheet_places

WRENCH = ("fx", "fy", "fz", "tx", "ty", "tz")
WAND = ("x", "y", "z", "qx", "qy", "qz", "qw")


def evaluate_instrument(
    contacts: tuple[Path, Contacts],
    truth: Path,
    rig_path: Path,
    *,
    wand: tuple[Path, str] | None,
    tolerance: float,
    output: Path | None,
) -> None:
    """Compare the median of each touch with a table of wrenches or of a wand's poses, and print the result.

    Args:
        contacts: the file, and its contacts.
        truth: table of the instrument: columns time and `WRENCH` or `WAND`.
        rig_path: rig of the body.
        wand: its mesh and the mesh's unit.
        tolerance: rows of the truth so close to a touch's time count [s].
        output: page to write (.html).

    Raises:
        InputError: a file cannot be used or written, `wand` is missing, no touch lasts three samples, or none can be
            compared.
        GeometryError: the mesh has no usable surface.
    """
    path, found = contacts
    setup = load_rig(rig_path).resolve()
    if output is not None:
        keep_inputs(output, (path, truth, rig_path, None if wand is None else wand[0]))
        require_report()
    touches, alone = touches_of(found)
    if not len(touches):
        raise InputError("has no touch of at least three samples, which a comparison needs.", where=str(path))
    surface, of = _surface(setup)
    reference = _reference(read_table(truth), (touches, alone), (surface, setup.link), wand, tolerance)
    if all(reference.refused):
        why = f"none of {len(touches)} touches can be compared; reason for the first: {reference.refused[0]}."
        raise InputError(why, where=str(truth))
    judged = judge(touches, reference)
    sheet = SkinSection.name in setup.sensors and setup.of(SkinSection).table.sheet
    pitch = setup.of(SkinSection).map.pitch if sheet else None
    title(f"{path} against {truth}, {reference.name}")
    lines(_facts(judged, touches, pitch))
    table(("", *HEADER), ((f"{name} [{unit}]", *summary.row(scale)) for name, unit, summary, scale in _named(judged)))
    note([of, *_refusals(judged, touches)])
    if output is not None:
        names = f"{path.name} against {truth.name}"
        write_text(output, render(_page(names, judged, touches, pitch, of)))


def _surface(setup: Setup) -> tuple[Mesh, str]:
    """Return the body's mesh, from the rig or else its sheet's map, and a sentence on that."""
    if setup.link.stated is None:
        layer = setup.of(SkinSection).map.mesh()
        return layer, "the rig has no [surface], so the sensing layer of the map is used as the body"
    return setup.link.surface().drawn(), "lines and wand are intersected with the rig's [surface]"


def _reference(
    known: TextTable,
    touches: tuple[Contacts, np.ndarray],
    body: tuple[Mesh, Link],
    wand: tuple[Path, str] | None,
    tolerance: float,
) -> Reference:
    """Return the instrument's measurements."""
    (found, alone), (surface, link) = touches, body
    if set(WRENCH) <= set(known.names):
        values = _at(known, WRENCH, found.time, tolerance)
        turn = None if link.stated is None else link.mount  # T_sensor_surface
        wrenches = values if turn is None else values @ turn.inverse().wrench_matrix().T
        return wrench_points(surface, wrenches, alone=alone)
    if wand is None:
        hint = "Add --wand wand.stl --wand-unit mm."
        raise InputError("has poses of a wand, but its shape is not given.", where=str(known.path), hint=hint)
    poses = _at(known, WAND, found.time, tolerance)
    lost = np.asarray(np.isnan(poses).any(axis=1))
    rotation = rotation_from_quaternion(np.where(lost[:, None], [0, 0, 0, 1.0], poses[:, 3:]))
    vertices = Mesh.load(wand[0], unit=wand[1]).vertices
    return wand_points(surface, vertices, rotation, np.where(lost[:, None], np.nan, poses[:, :3]))


def _at(known: TextTable, columns: tuple[str, ...], times: np.ndarray, tolerance: float) -> np.ndarray:
    """Return medians (n, columns) of the rows around each time; NaN without any."""
    values, _ = known.numbers(("time", *columns))
    if not (nearest_in_time(times, values[:, 0], tolerance) >= 0).any():
        hint = "Use one clock for both, or widen the match with --tolerance."
        raise InputError("no row matches the time of a touch.", where=str(known.path), hint=hint)
    found = np.full((len(times), len(columns)), np.nan)
    for k, time in enumerate(times):
        near = values[np.abs(values[:, 0] - time) <= tolerance, 1:]
        near = near[np.isfinite(near).all(axis=1)]
        if len(near):
            found[k] = np.median(near, axis=0)
    return found


def _facts(judged: InstrumentReport, touches: Contacts, pitch: tuple[float, float] | None) -> list[tuple[str, str]]:
    along = ", ".join(f"{1e3 * error:.2f}" for error in judged.along)
    compared = len(touches) - sum(map(bool, judged.reference.refused))
    facts = [("touches", f"{len(touches)}, {compared} of them compared"), ("along x, y, z", f"{along} mm on average")]
    if pitch is not None:
        distance, axis = (f"{1e3 * error:.2f} mm" for error in perfect(pitch))
        facts.append(
            ("a perfect map", f"has an error of {distance}, {axis} per axis, if touches are smaller than a cell")
        )
    if (paper := judged.paper_position) is not None:
        share = judged.paper_direction
        directions = f"; directions {100 * share:.1f} %, x and y of unit vectors (the paper: 2.9 %)"
        distance = f"{1e3 * paper.mean:.2f} mm, worst {1e3 * paper.worst:.2f} mm, z set to zero (the paper: 4.2 mm)"
        facts.append(("as the paper measures", distance + (directions if np.isfinite(share) else "")))
    return facts


def _named(judged: InstrumentReport) -> list[tuple[str, str, ErrorSummary, float]]:
    """Return name, unit, figures and scale of each compared quantity."""
    rows = (("position", "mm", judged.report.location, 1e3), ("direction", "deg", judged.report.normal, 180 / np.pi))
    return [(name, unit, summary, scale) for name, unit, summary, scale in rows if summary is not None]


def _refusals(judged: InstrumentReport, touches: Contacts) -> list[str]:
    named = zip(touches.identity.tolist(), touches.time.tolist(), judged.reference.refused, strict=True)
    return [f"touch {identity} at {time:.2f} s is left out: {why}" for identity, time, why in named if why]


def _page(
    names: str, judged: InstrumentReport, touches: Contacts, pitch: tuple[float, float] | None, of: str
) -> Report:
    """Return the page of figures, touches and pictures."""
    tiles = tuple(
        Tile(name, f"{scale * s.mean:.2f} {unit}", f"mean in space; worst {scale * s.worst:.2f} {unit}")
        for name, unit, s, scale in _named(judged)
    )
    places = sheet_places(touches)
    rows = tuple(
        (
            str(touches.identity[k]),
            f"{touches.time[k]:.2f}",
            *(() if places is None else (f"{value:.2f}" for value in places[k])),
            _shown(1e3 * judged.report.errors[k]),
            _shown(float(np.degrees(judged.report.turned[k]))),
            judged.reference.refused[k],
        )
        for k in range(len(touches))
    )
    cells, pictures = (), ()
    if places is not None:
        drawn = sheet_map(places, 1e3 * judged.report.errors, "error [mm]")
        cells = ("row", "column")
        pictures = (picture(drawn, "Where the touches were on the unrolled sheet, and their errors."),)
    header = ("touch", "time [s]", *cells, "position [mm]", "direction [deg]", "left out because")
    facts = (("against", judged.reference.name), *_facts(judged, touches, pitch))
    sections = (Section("Errors", text=(of,), pictures=pictures, settings=facts, tables=(Cells(header, rows),)),)
    return Report(names, f"{names}: each touch as the median of its samples.", tiles, sections=sections)


def _shown(value: float | np.floating) -> str:
    return f"{value:.2f}" if np.isfinite(value) else "-"
