"""`palpate calibrate load-cells`: identify the model of a fingertip's force cells from a bench log."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.console.calibration import Calibration, CalibrationResult
from palpate.console.options import Log, Output, RigFile
from palpate.files.logs import read_recording
from palpate.sensors.load_cells.calibrate import CalibrationOptions, LoadCellCalibration, identify_load_cells
from palpate.sensors.load_cells.section import LoadCellSection, load_cells_layout
from palpate.signals.recording import REFERENCE, VOLTAGE

__all__ = ["CalibrateLoadCells"]


@dataclass(frozen=True)
class CalibrateLoadCells(Calibration):
    """Calibrate 3-axis load cells under a fingertip on a test bench.

    Let a ball slide over the whole surface, in directions that cross, starting unloaded. The model holds the
    sensitivity of all cells together, the noise, and the covariance of both.

    Args:
        log: CSV or Parquet with time,u1x,u1y,u1z,u2x,... [V], ref_fx,ref_fy,ref_fz [N] on the fingertip, and
            ref_x,ref_y,ref_z [m] of the ball's centre, both in the surface's frame.
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
            InputError: rig or log cannot be read, the rig lacks [surface] or [load_cells], or `identify_load_cells`
                refuses the log: it does not begin unloaded, a channel never moves, the ball does not press.
            NotIdentifiable: log or cells do not determine every direction of the wrench.
        """
        setup = self.stated.resolve()
        table = setup.of(LoadCellSection).table
        recording = read_recording(self.log, load_cells_layout(setup, bench=True))
        reference, voltages = recording.channels[REFERENCE], recording.channels[VOLTAGE]
        cells = table.count()
        found = identify_load_cells(
            recording.time,
            voltages,
            reference[:, :3],
            reference[:, 3:],
            setup.link.surface(),
            indentation=table.indentation,
            options=CalibrationOptions(
                ball=table.ball / 2.0,
                positions=table.positions,
                limits=table.limits(cells),
                noise=None if table.noise is None else np.full(3 * cells, table.noise),
                names=table.names(cells),
                provenance=self.record(indentation=table.indentation),
            ),
        )
        return CalibrationResult(
            _figures(found),
            found.cells,
            notes=recording.notes,
            warnings=found.cells.notes,
            next=[f'name it in the rig: model = "{self.output.name}" under [load_cells]'],
        )


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
