"""Define `palpate calibrate intensity`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from tyro.conf import arg

from palpate.console.calibration import Calibration, CalibrationResult
from palpate.console.options import Log, Output, Scalar
from palpate.errors import InputError
from palpate.files.tables.table import read_table
from palpate.files.units import FORCE_UNITS, to_si
from palpate.sensors.taxels.calibrate import identify_intensity, identify_resistive, tells
from palpate.sensors.taxels.intensity import Curve, Intensity

_PLATEAU = 5  # readings alike at the lower end: that is where they stop


@dataclass(frozen=True)
class CalibrateIntensity(Calibration):
    """Fit the curve from a taxel's reading to its force.

    Fit the curve from intensity to force, and each cell's gain where the log says which cell was pressed.

    Args:
        log: CSV with the columns intensity and force (of the load cell, zero without load), and, where several cells
            were pressed, row and column.
        output: intensity.toml to write.
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
    kind: Annotated[Literal["auto", "polynomial", "two_range", "monotone", "resistive"], arg(metavar="NAME")] = "auto"
    degree: Annotated[int | None, arg(metavar="N", help_behavior_hint="")] = None
    bits: Annotated[int | None, arg(metavar="N", help_behavior_hint="")] = None
    unit: Annotated[str, arg(metavar="UNIT")] = "N"
    sheet: Annotated[str | None, arg(metavar="RxC", help_behavior_hint="")] = None
    scale: Scalar = None
    reference: Scalar = None

    def identify(self) -> CalibrationResult:
        """Return the `CalibrationResult` of the presses of the log, with their `Intensity`.

        Raises:
            InputError: a log, unit or option that cannot be used, or a curve that does not rise with force.
            NotIdentifiable: the presses do not determine a curve.
            OSError: an input cannot be read for its digest.
        """
        force, intensity, cell = _presses(self.log, to_si(self.unit, FORCE_UNITS, where="--unit"))
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
                ("curve", f"{curve.name}, {len(curve.parameters)} parameters, up to {curve.largest:.4g} N"),
                ("residual", f"{curve.residual:.3g} counts rms"),
                ("deviation", _deviation(curve)),
                *([("left out", found.provenance["left_out"])] if "left_out" in found.provenance else []),
            ],
            found,
            notes=found.notes,
        )


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


def _presses(log: Path, unit: float) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """Read forces [N], readings and cells; None where the log has no row and column."""
    table = read_table(log)
    values, _ = table.numbers(["force", "intensity"])
    if not {"row", "column"} <= set(table.names):
        return unit * values[:, 0], values[:, 1], None
    cells, _ = table.numbers(["row", "column"])
    known = np.isfinite(cells).all(axis=1) & np.isfinite(values).all(axis=1)
    whole = cells[known].astype(np.int64)
    if (whole != cells[known]).any() or (whole < 0).any():
        raise InputError("row and column must be whole numbers from 0.", where=str(log))
    return unit * values[known, 0], values[known, 1], whole


def _shape(text: str | None) -> tuple[int, int] | None:
    if text is None:
        return None
    rows, _, columns = text.lower().partition("x")
    if not (rows.isdigit() and columns.isdigit() and int(rows) * int(columns)):
        raise InputError(f"--sheet must be rows and columns, not {text!r}.", hint="Write them as 6x22.")
    return int(rows), int(columns)
