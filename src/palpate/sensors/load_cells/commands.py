"""`palpate calibrate load-cells` and `palpate design load-cells`: identify and predict a model of force cells."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import inf
from pathlib import Path
from typing import Annotated

import numpy as np
from tyro.conf import Positional, arg

from palpate.console.calibration import Calibration, CalibrationResult
from palpate.console.console import lines, note, title
from palpate.console.options import Log, Output, RigFile
from palpate.errors import InputError
from palpate.files.atomic import keep_inputs, write_text
from palpate.files.logs import read_recording
from palpate.sensors.load_cells.calibrate import CalibrationOptions, LoadCellCalibration, identify_load_cells
from palpate.sensors.load_cells.calibrate_plate import PlateCalibration, identify_plate
from palpate.sensors.load_cells.design_report import Design, compose, tiles, warnings
from palpate.sensors.load_cells.model import LoadCells
from palpate.sensors.load_cells.resolution import nominal_cells
from palpate.sensors.load_cells.section import LoadCellSection, RigLoadCells, load_cells_layout
from palpate.setup import load_rig
from palpate.signals.recording import REFERENCE, VOLTAGE, Recording
from palpate.viewer.report import render, require_report

STEP = 0.25  # relative change of the cells' distances in the variants


@dataclass(frozen=True)
class CalibrateLoadCells(Calibration):
    """Calibrate load cells: three-axis ones under a fingertip on a bench, or single-axis ones under a plate.

    Let a ball slide over the whole surface, in directions that cross, starting unloaded. The model holds the
    sensitivity of all cells together, the noise, and the covariance of both.

    Of a plate (axes = ["z"] in [load_cells]), put known weights on it in turn, each for some seconds, and at known
    places if you can: weights at unknown places show all gains of three cells, and three combinations of more.

    Args:
        log: CSV or Parquet with time,u1x,u1y,u1z,u2x,... [V], ref_fx,ref_fy,ref_fz [N] on the fingertip, and
            ref_x,ref_y,ref_z [m] of the ball's centre, both in the surface's frame; of a plate, time,u1,u2,u3,...,
            ref_f [N] of the weight, 0 without one, and ref_x,ref_y [m] of where it stands, empty if not known.
        rig: TOML with [surface] and [load_cells].
        output: model to write, such as fingertip.toml.
    """

    replaces = "load_cells.model"
    log: Log
    rig: RigFile
    output: Output

    def identify(self) -> CalibrationResult:
        """Return a `CalibrationResult` with the `LoadCells` of a bench log.

        Raises:
            InputError: rig or log cannot be read, the rig lacks [surface] or [load_cells], or the log does not begin
                unloaded, a channel never moves, or the ball does not press.
            NotIdentifiable: log or cells do not determine every direction of the wrench.
            OSError: an input cannot be read for its digest.
            GeometryError: the file of the surface has no usable surface.
        """
        setup = self.stated.resolve()
        table = setup.of(LoadCellSection).table
        recording = read_recording(self.log, load_cells_layout(setup, bench=True))
        if len(table.axes) == 1:
            found = self._plate(table, recording)
            figures = _plate_figures(found, "" if table.newtons else " N/V")
        else:
            reference, cells = recording.channels[REFERENCE], table.count()
            options = CalibrationOptions(
                ball=table.ball / 2.0,
                positions=table.positions,
                limits=table.limits(cells),
                noise=None if table.noise is None else np.full(3 * cells, table.noise),
                names=table.names(cells),
                provenance=self.record(indentation=table.indentation),
            )
            given = recording.time, recording.channels[VOLTAGE], reference[:, :3], reference[:, 3:]
            surface = setup.link.surface()
            found = identify_load_cells(*given, surface, indentation=table.indentation, options=options)
            figures = _figures(found)
        hint = f'name it in the rig: model = "{self.output.name}" under [load_cells]'
        return CalibrationResult(figures, found.cells, notes=recording.notes, warnings=found.cells.notes, next=[hint])

    def _plate(self, table: RigLoadCells, recording: Recording) -> PlateCalibration:
        if not table.positions:
            raise InputError("is missing: [x, y, z] in m of each cell.", where="load_cells.positions")
        reference = recording.channels[REFERENCE]
        places = reference[:, 1:] if reference.shape[1] > 1 else np.full((len(reference), 2), np.nan)
        given = recording.time, recording.channels[VOLTAGE], reference[:, 0], places, np.array(table.positions)
        limits, record = table.limits(table.count()), self.record(axes=table.axes[0])
        return identify_plate(*given, axis=table.axes[0], limits=limits, provenance=record)


def _plate_figures(found: PlateCalibration, unit: str) -> list[tuple[str, str]]:
    (weight, place), gains, weights = found.rms, found.found, found.weights.weight
    deviation = 100.0 * np.sqrt(np.diag(gains.covariance)) / np.abs(gains.gains)
    each = ", ".join(f"{value:.5g}" for value in gains.gains)
    placed = "no place was known" if np.isnan(place) else f"{1e3 * place:.2g} mm of the place"
    return [
        (
            "cells",
            f"{found.cells.cells}, gains {each}{unit}, known to {deviation.min():.2g} to {deviation.max():.2g} %",
        ),
        ("weights", f"{len(weights)}, {weights.min():.3g} to {weights.max():.3g} N"),
        ("residual", f"{100 * weight:.2g} % of the weight, {placed} (rms)"),
        ("left out", str(found.validation)),
        ("a cell's error", f"{100 * gains.error:.2g} % of its load"),
        ("uneven", f"{100 * found.cells.misfit:.2g} % of a reading that no load explains"),
    ]


def _figures(found: LoadCellCalibration) -> list[tuple[str, str]]:
    (force, position, moment), cells = found.rms, found.cells
    noise, law = 1e3 * np.sqrt(np.diag(cells.inverse()[1])[:3]), cells.indentation
    visited = int(np.count_nonzero(found.coverage.visits))
    said = [
        ("cells", f"{cells.cells}, noise of the force ({', '.join(f'{value:.2g}' for value in noise)}) mN"),
        ("samples", f"{cells.samples:,}; {len(found.touches.time):,} blocks of 10 ms loaded"),
        ("reference", f"noise {1e3 * found.reference_noise:.2g} mN"),
        ("residual", f"{1e3 * force:.3g} mN, {1e6 * position:.3g} um, {1e3 * moment:.2g} N mm along the force (rms)"),
        ("left out", str(found.validation)),
        ("predicted error", f"{1e6 * found.coverage.error.max():.2g} um at most from the calibration alone, at 1 N"),
        ("visited", f"{visited} of {len(found.coverage.visits)} parts of the surface"),
        ("zero", f"drifts by {cells.drift:.2g} times the noise of a reading at most"),
    ]
    if law is not None:
        said.append(("indentation", f"{1e3 * law.depth:.3f} mm at 1 N, growing as F^{law.exponent:.2f}"))
    return said


def design_load_cells(
    rig: Annotated[Positional[Path], arg(metavar="RIG")],
    /,
    output: Output,
    accuracy: Annotated[float, arg(metavar="X")] = 2e-3,
    force: Annotated[float, arg(metavar="X")] = 1.0,
    friction: Annotated[float, arg(metavar="X")] = 0.5,
    tared: Annotated[float, arg(metavar="N")] = 100.0,
) -> None:
    """Draw what a layout of load cells can resolve.

    Draw how well place, force and torque can be known over the surface, and the smallest force that will do.

    Args:
        rig: TOML with a [surface] and [load_cells]: positions, noise and sensitivity, or a calibrated model.
        output: page to write, HTML.
        accuracy: wanted accuracy of the place [m], root mean square in three dimensions.
        force: force that the maps are drawn for [N].
        friction: tangent of the angle between force and normal; the worst direction counts.
        tared: number of independent readings that the bias is taken from.

    Raises:
        InputError: a number is not allowed, rig or model cannot be read or lack a key, the page cannot be written or
            would replace an input, or the package for reports is not installed.
        NotIdentifiable: the cells do not determine a wrench.
        GeometryError: the file of the surface has no usable surface.
    """
    require_report()
    for name, value in (("accuracy", accuracy), ("force", force), ("tared", tared)):
        if not 0 < value < inf:
            raise InputError(f"--{name} must be positive, not {value:g}.")
    if not 0 <= friction < inf:
        raise InputError(f"--friction must not be negative, not {friction:g}.")
    stated = load_rig(rig)
    keep_inputs(output, (rig, *stated.files().values()))
    setup = stated.resolve()
    surface, frame = setup.link.surface(), setup.of(LoadCellSection)
    cells = frame.nominal()
    design = Design(rig.name, cells, surface, accuracy, force, friction, tared, tuple(_variants(frame.table, cells)))
    write_text(output, render(compose(design)))
    title(f"{rig} -> {output}")
    lines([(tile.name, f"{tile.value} {tile.word}".rstrip()) for tile in tiles(design)])
    note(warnings(design), "warning")


def _variants(table: RigLoadCells, cells: LoadCells) -> Iterator[tuple[str, LoadCells]]:
    """Yield names and cells of changed layouts, to compare; none for a calibrated model."""
    places = cells.positions
    sensitivity = 1.0 if table.newtons else table.sensitivity
    if table.model is not None or sensitivity is None or table.noise is None:
        return
    middle, drift = places.mean(axis=0), cells.drift * table.noise
    for name, spread, noise in (
        ("half the noise", 1.0, 0.5),
        (f"cells {100 * STEP:g} % nearer together", 1.0 - STEP, 1.0),
        (f"cells {100 * STEP:g} % further apart", 1.0 + STEP, 1.0),
    ):
        moved = middle + spread * (places - middle)
        limit = table.range or inf
        yield name, nominal_cells(moved, sensitivity, noise * table.noise, limit, drift=drift, axes=table.axes)
