"""Show load cells under a body: their loads on the page, their facts and faults in the report."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, cast

import numpy as np
from jaxtyping import Float

from palpate.contact.wrench_estimator import WrenchEstimator
from palpate.sensors.load_cells.array import LoadCellArray
from palpate.sensors.load_cells.model import LoadCells
from palpate.sensors.load_cells.section import LoadCellSection
from palpate.setup.setup import Setup
from palpate.setup.view import LayerData
from palpate.setup.wrench_view import WrenchView
from palpate.spatial.arguments import takes_arrays
from palpate.viewer.heat import colours
from palpate.viewer.legend import bar
from palpate.viewer.report import Section
from palpate.viewer.run_report import Run
from palpate.viewer.scene import Layer, Scene

if TYPE_CHECKING:
    from viser import BoxHandle, ClientHandle, GuiApi, ViserServer

PULLED = 0.22  # sizes of the body: cells are drawn that far below their places, else it would hide them
BOX = 0.35  # of the distance between neighbours
_STRONG = 0.95  # quantile of the loads that is drawn darkest


class LoadCellView(WrenchView):
    """The view of load cells on the page and in the report."""

    def layers(self, setup: Setup, kept: LayerData, live: tuple[int, ...] | None) -> tuple[Layer, ...]:
        """Return one `LoadCellLayer` in a tuple.

        Raises:
            InputError: the cells' model cannot be read.
        """
        return (LoadCellLayer(setup.of(LoadCellSection).cells),)

    def uncertain(self, setup: Setup, estimator: WrenchEstimator) -> tuple[str, ...]:
        """Return the names of the uncertainties in the ellipses, other than the noise, as a tuple."""
        return (*super().uncertain(setup, estimator), "the calibration's")

    def sections(self, run: Run, setup: Setup, estimator: WrenchEstimator) -> Run:
        """Return the `Run` with a section on the cells before its other sections."""
        sensor = cast("LoadCellArray", estimator.sensor)
        left_out = (1 + np.flatnonzero(~sensor.sound)).tolist()
        section = load_cells(sensor.cells, excluded=left_out, warnings=sensor.warnings())
        return replace(run, sections=(section, *run.sections))


def load_cells(cells: LoadCells, *, excluded: Sequence[int], warnings: Sequence[str]) -> Section:
    """Return a `Section` of the report on the cells, with warnings about the zero and faults.

    Args:
        cells: the model.
        excluded: numbers, from 1, of cells that are not used.
        warnings: a sentence each.
    """
    noise = np.sqrt(np.diag(cells.noise))
    unused = ", ".join(f"cell {number}" for number in excluded)
    facts = (
        ("cells", f"{cells.cells}, calibrated with {cells.samples:,} samples"),
        ("left out", unused or "none"),
        ("noise", f"{1e3 * noise.mean():.3g} mV of a reading (one standard deviation, mean of the channels)"),
        ("drift of the zero", f"{1e3 * cells.drift * noise.mean():.3g} mV (one standard deviation)"),
        ("not measured", "shear and torque" if len(cells.axes) == 1 else "nothing"),
        ("soft layer", "none" if cells.indentation is None else f"{1e3 * cells.indentation.depth:.3g} mm deep at 1 N"),
    )
    return Section("Load cells", settings=facts, points=(*warnings, *cells.notes))


@takes_arrays
def loads(
    cells: LoadCells,
    point: Float[np.ndarray, "*batch 3"],
    normal: Float[np.ndarray, "*batch 3"],
    force: Float[np.ndarray, "*batch 3"],
    torque: Float[np.ndarray, "*batch"],
) -> Float[np.ndarray, "*batch k"]:
    """Return the predicted load (*batch, k) [V] of each cell under a contact: the length of its unbiased readings.

    Args:
        cells: the model.
        point: (*batch, 3) [m] of the contact.
        normal: (*batch, 3) outward unit normal there.
        force: (*batch, 3) [N].
        torque: (*batch,) [N m] about the normal.

    Raises:
        InputError: arrays of other shapes.
    """
    wrench = np.concatenate([force, np.cross(point, force) + torque[..., None] * normal], axis=-1)
    readings = wrench @ cells.matrix.T
    return np.linalg.norm(readings.reshape(*readings.shape[:-1], cells.cells, len(cells.axes)), axis=-1)


class LoadCellLayer:
    """A layer with a box for each cell, below the body, darker for a larger load."""

    def __init__(self, cells: LoadCells) -> None:
        self.cells = cells
        self._drawn: list[BoxHandle] = []
        self._most: float | None = None  # V of a cell that is drawn darkest
        self._met = 1e-12

    @property
    def covers(self) -> bool:
        """False: boxes below the body do not cover it."""
        return False

    @property
    def places(self) -> Float[np.ndarray, "k 3"]:
        """Positions (k, 3) [m] of the cells whose places are known."""
        return self.cells.positions[np.isfinite(self.cells.positions).all(axis=1)]

    def draw(self, server: ViserServer | ClientHandle, scene: Scene) -> None:
        """Draw the boxes; none where the place of a cell is not known."""
        self._drawn = []  # anew: a copy of this layer may be drawn elsewhere
        if len(self.places) < self.cells.cells:
            return
        carried = self._carried(scene, np.flatnonzero(scene.touched))
        self._most = float(np.quantile(carried.max(axis=1), _STRONG)) if len(carried) else None
        places = scene.placed(self.places)
        down = places.mean(axis=0)
        length = float(np.linalg.norm(down))
        down = down / length if length > 0 else np.array([0.0, 0.0, -1.0])
        apart = np.linalg.norm(places[:, None] - places, axis=2) + 10.0 * np.eye(len(places))
        side = BOX * float(apart.min())
        for number, place in enumerate(places + PULLED * down, start=1):
            name = f"/load_cells/{number}"
            box = server.scene.add_box(name, dimensions=(side, side, 0.6 * side), position=place)
            server.scene.add_label(f"{name}/name", f"{number}", position=(0.0, 0.0, -side))
            self._drawn.append(box)

    def panel(self, gui: GuiApi) -> None:
        """Add no controls to the panel."""

    def show(self, scene: Scene, index: int) -> None:
        """Colour the boxes by the cells' loads in a sample."""
        if not self._drawn:
            return
        carried = self._now(scene, index)
        if self._most is None:  # nothing was touched when they were drawn: darkest is the most so far
            self._met = max(self._met, float(carried.max()))
        shades = colours(np.clip(carried / self._darkest, 0.0, 1.0))
        for box, (red, green, blue) in zip(self._drawn, shades.tolist(), strict=True):
            box.color = (red, green, blue)

    def rows(self, scene: Scene, index: int) -> list[tuple[str, str]]:
        """Return a list of pairs (name, text): the predicted load [mV] of every cell; 0 without a contact."""
        carried = self._now(scene, index)
        return [(f"cell {number + 1}", f"{1e3 * volts:.1f} mV") for number, volts in enumerate(carried)]

    def legend(self) -> list[str]:
        """Return a colour bar as HTML in a list; [] if no boxes are drawn."""
        return [bar("load cell", 1e3 * self._darkest, "mV")] if self._drawn else []

    @property
    def _darkest(self) -> float:
        """Reading [V] of a cell that is drawn darkest."""
        return self._met if self._most is None else max(self._most, 1e-12)

    def _now(self, scene: Scene, index: int) -> Float[np.ndarray, " k"]:
        """Return the predicted reading (k,) [V] of each cell at a sample; 0 where nothing is located."""
        row = scene.strongest[index : index + 1]
        return self._carried(scene, row)[0] if scene.contacts[row].located[0] else np.zeros(self.cells.cells)

    def _carried(self, scene: Scene, rows: np.ndarray) -> Float[np.ndarray, "n k"]:
        found = scene.contacts
        torque = np.nan_to_num(found.torque[rows])
        return loads(self.cells, found.point[rows], found.normal[rows], found.force[rows], torque)
