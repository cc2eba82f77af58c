"""Run `palpate evaluate`: compare contacts with the ground truth."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import numpy as np
from tyro.conf import arg

from palpate.cli.evaluate_instrument import WAND, WRENCH, evaluate_instrument
from palpate.console.console import Quantity, lines, note, shares, span, table, title
from palpate.console.options import ContactsFile, FileOption, TruthFile
from palpate.contact.contacts import Contacts
from palpate.contact.ground_truth import TrueSamples, TrueTouches
from palpate.errors import InputError
from palpate.evaluation.errors import HEADER
from palpate.evaluation.evaluate import EvaluationReport, evaluate_robot
from palpate.evaluation.evaluate import evaluate as compare
from palpate.evaluation.other_truth import other_truth
from palpate.files.contacts import read_contacts
from palpate.files.ground_truth import read_ground_truth
from palpate.files.models import read_provenance
from palpate.files.tables.table import read_table
from palpate.sensors.marker_ring.evaluate_command import TRUTH, evaluate_ring
from palpate.sensors.taxels.poking.evaluate_command import evaluate_taxels, is_taxel_file
from palpate.viewer.report import percent

_OF_SENSOR = ("sensor", "with a truth", "answered", "location [mm]", *HEADER[1:-1], "force [N]", "in ellipse")
_COUNTS = ("samples", "matched", "answered", "unmatched", "missed", "outside")


def evaluate(
    contacts: ContactsFile,
    truth: TruthFile,
    /,
    tolerance: Annotated[float, arg(metavar="X")] = 0.02,
    rig: FileOption = None,
    wand: FileOption = None,
    wand_unit: Annotated[str, arg(metavar="UNIT")] = "mm",
    output: Annotated[FileOption, arg(aliases=["-o"])] = None,
) -> None:
    """Compare contacts with the ground truth.

    Errors of location, direction and force, coverage of the ellipses, share of each status.

    Contacts may also be compared with a force/torque sensor that carries the body, time,fx,fy,fz,tx,ty,tz, or with a
    wand that cameras track, time,x,y,z,qx,qy,qz,qw in the body's frame; both need the rig. Positions of taxels are
    compared with other positions of the same taxels.

    Args:
        contacts: written by `palpate estimate`, of any sensor; or places of taxels (`palpate calibrate taxels`, iCub's
            positions, CSV).
        truth: time,px,py,pz[,nx,ny,nz][,fx,fy,fz] in the contacts' frame, or touches:
            start,end,px,py,pz[,fx,fy,fz][,label]; of a robot also sensor, and base_px,... in its base;
            for a marker ring also [time,]angle_deg,force_n[,depth_mm][,shear_n]; for taxels: any file of their
            positions.
        tolerance: seconds by which the nearest true time may differ.
        rig: rig of the body, for a wrench or a wand.
        wand: mesh of the tracked wand.
        wand_unit: unit of that mesh.
        output: page to write as well (.html), of contacts against a wrench or a wand, or of taxels.

    Raises:
        InputError: a file or an option cannot be used or is missing, or nothing can be compared.
        GeometryError: the file of the surface has no usable surface.
    """
    if is_taxel_file(contacts):
        for option, given in (("rig", rig), ("wand", wand)):
            if given is not None:
                raise InputError("has no effect on places of taxels: leave it out.", where=f"--{option}")
        evaluate_taxels(contacts, truth, output)
        return
    found = read_contacts(contacts)
    rows = read_table(truth)
    names = set(rows.names)
    if set(WRENCH) <= names or set(WAND) <= names:
        if rig is None:
            raise InputError("comparing with a wrench or a wand needs the body of a rig.", hint="Add --rig FILE.")
        tool = None if wand is None else (wand, wand_unit)
        evaluate_instrument((contacts, found), truth, rig, wand=tool, tolerance=tolerance, output=output)
        return
    for option, given in (("rig", rig), ("wand", wand), ("output", output)):
        if given is not None:
            hint = "For other truths, palpate estimate LOG --report FILE --truth FILE writes a page of the errors."
            raise InputError("works only where the truth is a wrench or a wand.", where=f"--{option}", hint=hint)
    if set(TRUTH) <= names and "px" not in names:
        evaluate_ring(contacts, found, rows, tolerance)
        return
    stated = read_provenance(contacts).get("frame")
    frame = str(stated or "surface")
    known = read_ground_truth(truth, frame)
    report, each = _compared(found, known, tolerance, truth)
    if not report.matched:
        times = f"times of the contacts [s]: {span(found.time)}, of the truth: {span(truth_times(known))}"
        hint = "Use one clock for both, or widen the match with --tolerance."
        raise InputError(f"no sample matches the truth; {times}.", where=str(truth), hint=hint)
    title(f"{contacts} against {truth}")
    _say(report)
    if each:
        table(_OF_SENSOR, _rows(each))
    if not each and (warning := other_truth(found, known, report, tolerance=tolerance)):
        note([warning], kind="warning")
    note([*_unanswered(report), *_unpaired(report), *_unknown(found, each), *found.notes])
    if each and stated is None:
        note([f"{contacts}.toml is missing: the contacts are taken as in each sensor's own frame"], kind="warning")
    if each and frame == "base" and tolerance > 0.001 and isinstance(known, TrueSamples):
        note(["in the base, points move between true instants; --tolerance 0.001 compares at these instants alone"])
    if frame != "surface" and "base_px" not in names:
        note([f"the contacts are in the {frame}'s frame: the truth must be, too"], kind="warning")


def _compared(
    found: Contacts, known: TrueSamples | TrueTouches, tolerance: float, where: Path
) -> tuple[EvaluationReport, dict[str, EvaluationReport]]:
    """Return the comparison of all contacts, and that of each sensor of a robot."""
    if found.origins is not None and known.sensor:
        return evaluate_robot(found, known, tolerance=tolerance)
    if found.origins is not None and len(found.origins.among) > 1:
        what = "does not name the sensor of each row, and the contacts are of several."
        raise InputError(what, where=str(where), hint="Add a column sensor.")
    if len(set(known.sensor)) > 1:
        what = "is of several sensors, and the contacts do not name theirs."
        raise InputError(what, where=str(where), hint="Estimate the log with the robot's rig.")
    return compare(found, known, tolerance=tolerance), {}


def _rows(each: Mapping[str, EvaluationReport]) -> list[tuple[str, ...]]:
    """Return a row of texts per sensor: counts, errors of location and force, and coverage."""
    rows = list[tuple[str, ...]]()
    for name, one in each.items():
        place = ("-",) * 4 if one.location is None else one.location.row(1e3)[:-1]
        force = "-" if one.force is None else f"{one.force.median:.3f}"
        inside = percent(one.coverage.inside) if one.coverage.count else "-"
        rows.append((name, f"{one.matched:,}", f"{one.answered:,}", *place, force, inside))
    return rows


def _unknown(found: Contacts, each: Mapping[str, EvaluationReport]) -> list[str]:
    """Return a sentence on the sensors of a robot that have contacts and no truth, if there are any."""
    if found.origins is None or not each:
        return []
    names = [origin.sensor for origin in found.origins.among if origin.sensor not in each]
    return [f"there is no truth of {', '.join(names)}"] if names else []


def _say(report: EvaluationReport) -> None:
    matched = f"{report.samples:,}, {report.matched:,} of them with a truth, {report.answered:,} of those answered"
    lines([("contacts", Quantity(matched, {name: getattr(report, name) for name in _COUNTS}))])
    lines(shares(report.statuses))
    if report.touches:
        table(
            ("touch", "error [mm]", "scatter [mm]", "answered", "samples"),
            [
                (
                    touch.label,
                    *(f"{1e3 * value:.3f}" if touch.answered else "-" for value in (touch.error, touch.scatter)),
                    f"{touch.answered}",
                    f"{touch.samples}",
                )
                for touch in report.touches
            ],
        )
    if rows := summaries(report):
        table(("", *HEADER), rows)
    else:
        note(["no contact with a truth was answered, so there are no errors to average"])
    seen = report.coverage
    if seen.count:
        inside = Quantity(f"hold the truth in {percent(seen.inside)} of {seen.count:,} (should be 95)", seen.inside)
        square = Quantity(f"{seen.mean_square:.2f} (should be 2)", seen.mean_square)
        lines([("95 % ellipses", inside), ("mean square", square)])


def _unpaired(report: EvaluationReport) -> list[str]:
    """Return sentences on unmatched contacts and truths."""
    counted = (
        (report.unmatched, "contacts have no truth of their own, because other contacts are nearer"),
        (report.missed, "truths have no contact, although others at the same time have one"),
        (
            report.outside,
            "contacts are before or after a stretch of truths, and are compared with none",
        ),
    )
    return [f"{count:,} {what}" for count, what in counted if count]


def truth_times(truth: TrueSamples | TrueTouches) -> np.ndarray:
    """Return times [s]: of k instants (k,), or of k touches all starts, then all ends (2 k,)."""
    return np.concatenate([truth.start, truth.end]) if isinstance(truth, TrueTouches) else truth.time


def summaries(report: EvaluationReport) -> list[tuple[str, ...]]:
    """Return a row of texts per compared quantity: name with unit, mean, median, 95 %, worst, count."""
    rows = (
        ("location of touches [mm]" if report.touches else "location [mm]", report.location, 1e3),
        ("normal [deg]", report.normal, 180 / np.pi),
        ("force [N]", report.force, 1.0),
        ("force direction [deg]", report.force_angle, 180 / np.pi),
    )
    return [(name, *summary.row(scale)) for name, summary, scale in rows if summary is not None]


def _unanswered(report: EvaluationReport) -> list[str]:
    """Return sentences on touches that the averages omit."""
    omitted = (
        ("have no sample", [touch.label for touch in report.touches if not touch.samples]),
        ("have samples, but no answer,", [t.label for t in report.touches if t.samples and not t.answered]),
    )
    return [
        f"{len(labels)} of {len(report.touches)} touches {why} and are left out of the averages: "
        f"{', '.join(labels[:5])}{', ...' if len(labels) > 5 else ''}"
        for why, labels in omitted
        if labels
    ]
