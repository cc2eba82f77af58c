"""Define `palpate calibrate intensity` and `palpate calibrate response`."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from tyro.conf import arg

from palpate.console.calibration import Calibration, CalibrationResult
from palpate.console.options import CountOption, FileOption, Log, NameOption, Output, RigFile, Scalar
from palpate.contact.ground_truth import TrueSamples
from palpate.errors import InputError
from palpate.files.contacts import read_contacts
from palpate.files.ground_truth import read_ground_truth
from palpate.files.logs import open_log, read_recording
from palpate.files.logs.topics import NONE
from palpate.files.tables.table import read_table
from palpate.files.units import FORCE_UNITS, PRESSURE_UNITS, to_si
from palpate.sensors.taxels.calibrate import identify_intensity, identify_resistive, tells
from palpate.sensors.taxels.calibrate_response import identify_response
from palpate.sensors.taxels.files import of_response
from palpate.sensors.taxels.intensity import Curve, Intensity
from palpate.sensors.taxels.mat import identify_by_pressures, pressure_errors
from palpate.sensors.taxels.model import TaxelBody
from palpate.sensors.taxels.section import SKIN, SkinSection
from palpate.sensors.taxels.two_loggers import joined, loggers_offset
from palpate.setup import Rig
from palpate.setup.tables import RigAcceleration, RigOrientation

_PLATEAU = 5  # readings alike at the lower end: that is where they stop


@dataclass(frozen=True)
class CalibrateIntensity(Calibration):
    """Fit the curve from a taxel's reading to its force.

    Fit the curve from intensity to force, and each cell's gain where the log says which cell was pressed.

    Args:
        log: CSV with the columns intensity and force (of the load cell, zero without load), and, where several cells
            were pressed, row and column. With --force, time and intensity; with --pressures, a log of the skin.
        output: intensity.toml to write.
        force: CSV with time and force by another logger: the offset between both clocks is found.
        rig: TOML with the [skin] that --pressures are on.
        pressures: on all of the skin [kPa], one for each frame of the log; 0 first.
        kind: polynomial (the paper's), two_range (a sensitive and a strong range, joined), monotone, or auto: the one
            that predicts unseen presses best; resistive: a taxel in a voltage divider.
        degree: of the polynomial.
        bits: of the reading, whose largest value is saturated (default: found where readings stop rising).
        unit: of the force in the log: N, mN, gf, ...
        sheet: rows and columns of the sheet, as 6x22.
        scale: reading without load, of a resistive taxel.
        reference: resistor of its divider, in the unit in which its resistances come out.
    """

    log: Log
    output: Output
    force: FileOption = None
    rig: FileOption = None
    pressures: Annotated[tuple[float, ...], arg(metavar="KPA", help_behavior_hint="")] = ()
    kind: Annotated[Literal["auto", "polynomial", "two_range", "monotone", "resistive"], arg(metavar="NAME")] = "auto"
    degree: CountOption = None
    bits: CountOption = None
    unit: Annotated[str, arg(metavar="UNIT")] = "N"
    sheet: Annotated[NameOption, arg(metavar="RxC")] = None
    scale: Scalar = None
    reference: Scalar = None

    def identify(self) -> CalibrationResult:
        """Return the `CalibrationResult` of the presses of the log, with their `Intensity`.

        Raises:
            InputError: a log, unit or option that cannot be used, or a curve that does not rise with force.
            NotIdentifiable: the presses do not determine a curve.
            OSError: an input cannot be read for its digest.
        """
        if self.pressures or self.rig is not None:
            return self._by_pressures()
        unit = to_si(self.unit, FORCE_UNITS, where="--unit")
        force, intensity, cell, clocks = _presses(self.log, self.force, unit)
        record = self.record(kind=self.kind, degree=self.degree, bits=self.bits, unit=self.unit)
        if self.kind == "resistive":
            found = _divider(force, intensity, self.scale, self.reference, record)
        else:
            found = identify_intensity(
                force,
                intensity,
                cell,
                shape=_shape(self.sheet),
                kind=self.kind,
                degree=self.degree,
                top=None if self.bits is None else 2.0**self.bits - 1.0,
                provenance=record,
            )
        curve = found.curves[0]
        pressed = "" if cell is None else f", {len(np.unique(cell, axis=0))} cells"
        return CalibrationResult(
            [
                ("presses", f"{len(force):,} rows{pressed}"),
                *clocks,
                *_figures(curve),
                *([("left out", found.provenance["left_out"])] if "left_out" in found.provenance else []),
            ],
            found,
            notes=found.notes,
        )

    def _by_pressures(self) -> CalibrationResult:
        """Return the `CalibrationResult` of one frame at each of several pressures."""
        pressures, (frames, body) = PRESSURE_UNITS["kPa"] * np.array(self.pressures), _frames(self.log, self.stated)
        if len(pressures) != len(frames):
            raise InputError(
                f"the log has {len(frames)} frames, and {len(pressures)} pressures are stated.",
                where="--pressures",
                hint="Write one for each frame, such as --pressures 0 10 20 30 40, with --rig for its [skin].",
            )
        stated = " ".join(f"{each:g}" for each in self.pressures)
        record = self.record(kind=self.kind, degree=self.degree, pressures=stated)
        found = identify_by_pressures(pressures, frames, body, kind=self.kind, degree=self.degree, provenance=record)
        errors = pressure_errors(pressures, frames, body, kind=self.kind, degree=self.degree)
        left = float(np.sqrt(np.nanmean(errors**2))) / PRESSURE_UNITS["kPa"]
        return CalibrationResult(
            [
                ("frames", f"{len(frames)} of {body.named()}, up to {max(self.pressures):g} kPa"),
                *_figures(found.curves[0]),
                ("left out", f"{len(errors)} frames, each by the others: {left:.3g} kPa rms of a cell"),
            ],
            found,
            notes=found.notes,
        )


def _figures(curve: Curve) -> list[tuple[str, str]]:
    """Return (name, text) pairs on a curve."""
    return [
        ("curve", f"{curve.name}, {len(curve.parameters)} parameters, up to {curve.largest:.4g} N"),
        ("residual", f"{curve.residual:.3g} counts rms"),
        ("deviation", _deviation(curve)),
    ]


def _deviation(curve: Curve) -> str:
    """Describe the standard deviation of a force in the middle of the range."""
    half = np.array([curve.largest / 2])
    if not tells(curve, half)[0]:
        return f"not known at {half[0]:.3g} N: no reading tells the force there"
    fit, one = (1e3 * float(curve.deviation(half, noise)[0]) for noise in (0.0, curve.residual))
    return f"{fit:.3g} mN by the fit, {one:.3g} mN of one reading, at {half[0]:.3g} N"


def _divider(
    force: np.ndarray, reading: np.ndarray, scale: float | None, reference: float | None, record: dict[str, str]
) -> Intensity:
    if scale is None or reference is None or not (scale > 0 and reference > 0):
        raise InputError(
            "a divider needs its reading without load (scale) and its resistor (reference).",
            hint="Add --scale and --reference, such as --scale 1024 --reference 10.",
        )
    known = np.isfinite(force) & np.isfinite(reading)
    lowest = float(reading[known].min(initial=np.inf))
    floor = lowest if np.count_nonzero(reading[known] <= lowest) >= _PLATEAU else 0.0
    references, layer = np.full(len(force), reference), np.zeros(len(force), dtype=np.int64)
    curves = identify_resistive(force, reading, scale=scale, reference=references, layer=layer, floor=floor)
    half, series = curves[0].parameters.tolist()
    said = f"2 x {half:.4g} / F in the taxel, {series:.4g} in series, in the unit of the reference"
    return Intensity(curves, provenance=record, notes=(said,))


def _presses(
    log: Path, other: Path | None, unit: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray | None, list[tuple[str, str]]]:
    """Read forces [N], readings, cells (None where the log has no row and column), and a line on two clocks."""
    table, clocks = read_table(log), list[tuple[str, str]]()
    if other is None:
        force, intensity = table.numbers(["force", "intensity"])[0].T
    else:
        time, intensity = table.numbers(["time", "intensity"])[0].T
        there, force = read_table(other).numbers(["time", "force"])[0].T
        found = loggers_offset(time, intensity, there, force)
        force = joined(time - found.offset, there, force)
        added = f"{found.offset:+.4f} s (deviation {found.deviation:.4f}) added to the times of {other.name}"
        clocks.append(("clocks", added))
    if not {"row", "column"} <= set(table.names):
        return unit * force, intensity, None, clocks
    cells, _ = table.numbers(["row", "column"])
    known = np.isfinite(cells).all(axis=1) & np.isfinite(force) & np.isfinite(intensity)
    whole = cells[known].astype(np.int64)
    if (whole != cells[known]).any() or (whole < 0).any():
        raise InputError("row and column must be whole numbers from 0.", where=str(log))
    return unit * force[known], intensity[known], whole, clocks


def _frames(log: Path, rig: Rig) -> tuple[np.ndarray, TaxelBody]:
    """Return the frames of a log as they are, whatever its times are, and the body that a rig states."""
    setup = replace(rig, orientation=RigOrientation(topic=NONE), acceleration=RigAcceleration()).resolve()
    body, layout = setup.of(SkinSection).body, SKIN.layout(setup)
    channel = replace(layout.arrays[0], scale=1.0, unit=None)
    blocks = open_log(log, replace(layout, arrays=(channel,), time="", rate=1.0)).blocks()
    return np.concatenate([body.readings(block) for block in blocks]), body


def _shape(text: str | None) -> tuple[int, int] | None:
    if text is None:
        return None
    rows, _, columns = text.lower().partition("x")
    if not (rows.isdigit() and columns.isdigit() and int(rows) * int(columns)):
        raise InputError(f"--sheet must be rows and columns, not {text!r}.", hint="Write them as 6x22.")
    return int(rows), int(columns)


@dataclass(frozen=True)
class CalibrateResponse(Calibration):
    """Fit what taxels with three axes read under known forces.

    Press at 100 places or more, up to the outer taxels, with tips of different size, from light to hard, and move the
    tip sideways in all directions; nothing touches between two presses.

    Args:
        log: of the skin.
        output: response.toml to write.
        rig: TOML with the [skin], its places and axes.
        truth: CSV with time, px, py, pz, fx, fy, fz: point and force on the skin, in the surface's frame, while any
            force acts; or the contacts that a force/torque sensor below the skin gives (palpate estimate).
    """

    log: Log
    output: Output
    rig: RigFile
    truth: FileOption = None

    def identify(self) -> CalibrationResult:
        """Return the `CalibrationResult` of the presses of the log, with their `TaxelResponse`.

        Raises:
            InputError: a file cannot be read, or states no forces, or the skin has one axis.
            NotIdentifiable: the presses do not determine the response.
            OSError: an input cannot be read for its digest.
        """
        if self.truth is None:
            hint = "Give --truth CSV with time, px, py, pz, fx, fy, fz, or the contacts of a force/torque sensor below."
            raise InputError("the forces of the presses are not known.", where="--truth", hint=hint)
        setup = self.stated.resolve("skin")
        body = setup.of(SkinSection).body
        if body.response is None:
            hint = 'Write axes = ["x", "y", "z"] in [skin]; for one axis there is palpate calibrate intensity.'
            raise InputError("the rig's taxels have one axis.", where="skin.axes", hint=hint)
        recording = read_recording(self.log, SKIN.layout(setup))
        found = identify_response(replace(body, response=None), recording, _known(self.truth), provenance=self.record())
        hint = f'name it in the rig: response = "{self.output.name}" under [skin]'
        return CalibrationResult(of_response(found), found, notes=[*recording.notes, *found.notes], next=[hint])


def _known(path: Path) -> TrueSamples:
    """Read points and forces: of a truth, or of the contacts in a file that `palpate estimate` wrote."""
    if "status" in read_table(path).names:
        contacts = read_contacts(path)
        there = contacts.located
        return TrueSamples(contacts.time[there], contacts.point[there], None, contacts.force[there])
    truth = read_ground_truth(path)
    if not isinstance(truth, TrueSamples):
        hint = "Write a row for each instant: time, px, py, pz, fx, fy, fz."
        raise InputError("states touches, not instants.", where=str(path), hint=hint)
    return truth
