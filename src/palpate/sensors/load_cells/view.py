"""Show load cells under a body on the page and in the report."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import cast

import numpy as np

from palpate.contact.wrench_estimator import WrenchEstimator
from palpate.sensors.load_cells.array import LoadCellArray
from palpate.sensors.load_cells.layer import LoadCellLayer
from palpate.sensors.load_cells.model import LoadCells
from palpate.sensors.load_cells.section import LoadCellSection
from palpate.setup.setup import Setup
from palpate.setup.view import LayerData
from palpate.setup.wrench_view import WrenchView
from palpate.viewer.report import Section
from palpate.viewer.run_report import Run
from palpate.viewer.scene import Layer

__all__ = ["LoadCellView", "load_cells"]


class LoadCellView(WrenchView):
    """The view of load cells: their places and loads on the page, their facts and faults in the report."""

    def layers(self, setup: Setup, kept: LayerData, live: tuple[int, ...] | None) -> tuple[Layer, ...]:
        """Return a tuple of one `LoadCellLayer`, which draws the cells under the body.

        Raises:
            InputError: the cells' model cannot be read.
        """
        return (LoadCellLayer(setup.of(LoadCellSection).cells),)

    def uncertain(self, setup: Setup, estimator: WrenchEstimator) -> tuple[str, ...]:
        """Return a tuple of the names of the uncertainties that the ellipses contain in addition to the noise."""
        return (*super().uncertain(setup, estimator), "the calibration's")

    def sections(self, run: Run, setup: Setup, estimator: WrenchEstimator) -> Run:
        """Return the `Run` with a section on the cells before its other sections."""
        sensor = cast("LoadCellArray", estimator.sensor)
        left_out = (1 + np.flatnonzero(~sensor.sound)).tolist()
        section = load_cells(sensor.cells, excluded=left_out, notes=sensor.notes(), faults=sensor.warnings())
        return replace(run, sections=(section, *run.sections))


def load_cells(cells: LoadCells, *, excluded: Sequence[int], notes: Sequence[str], faults: Sequence[str]) -> Section:
    """Return a `Section` on the cells: those not used, the zero, faults, and the smallest force that is located.

    Args:
        cells: the model.
        excluded: numbers, from 1, of cells that are not used.
        notes: notes on the zero and the smallest force, a sentence each.
        faults: faults that were found, a sentence each.
    """
    noise = np.sqrt(np.diag(cells.noise))
    unused = ", ".join(f"cell {number}" for number in excluded)
    facts = (
        ("cells", f"{cells.cells}, calibrated with {cells.samples:,} samples"),
        ("left out", unused or "none"),
        ("noise", f"{1e3 * noise.mean():.3g} mV of a reading (one standard deviation, mean of the channels)"),
        ("drift of the zero", f"{1e3 * cells.drift * noise.mean():.3g} mV (one standard deviation)"),
        ("soft layer", "none" if cells.indentation is None else f"{1e3 * cells.indentation.depth:.3g} mm deep at 1 N"),
    )
    return Section("Load cells", settings=facts, points=(*notes, *faults, *cells.notes))
