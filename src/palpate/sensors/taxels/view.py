"""Show a skin of taxels on the page and in the report."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from math import prod
from pathlib import Path
from typing import ClassVar, cast

import numpy as np

from palpate.contact.contacts import Contacts
from palpate.contact.estimate import ROW, Status
from palpate.contact.estimator import ContactEstimator
from palpate.errors import InputError
from palpate.files.logs.samples import SampleReader
from palpate.sensors.taxels.estimator import TaxelEstimator
from palpate.sensors.taxels.layer import TaxelLayer, cell_mesh
from palpate.sensors.taxels.section import SkinSection
from palpate.setup.setup import Setup
from palpate.setup.view import TRACKED, Facts, Feed, LayerData, SensorView, Words
from palpate.signals.recording import CELLS, Recording
from palpate.viewer.maps import sheet_map
from palpate.viewer.report import Section, picture
from palpate.viewer.run_report import Run
from palpate.viewer.samples import sheet_places
from palpate.viewer.scene import Layer

REST = 50  # frames from which the page takes the rest of cells


class TaxelView(SensorView):
    """A view of a skin: the forces of its taxels on the page, their baseline and faults in the report."""

    words: ClassVar[Mapping[str, Words]] = {
        **TRACKED,
        "sure": ("two peaks are two contacts from", 1.0, "deviations between them"),
        "share": ("and from", 1e2, "% of the lower peak"),
        "unequal": ("gains of cells differ by", 1e2, "%"),
        "drift": ("the rest is followed within", 1.0, "s"),
        "walk": ("drift of the rest", 1.0, "counts/√s"),
    }

    def skin(self, setup: Setup) -> Setup:
        """Return the `Setup` of the skin alone, here the setup itself."""
        return setup

    def layers(self, setup: Setup, kept: LayerData, live: tuple[int, ...] | None) -> tuple[Layer, ...]:
        """Return one `TaxelLayer` in a tuple, the cells with their forces [N].

        Raises:
            InputError: a file that the rig names cannot be read.
            GeometryError: the file of the surface has no usable surface.
        """
        return (TaxelLayer(setup.of(SkinSection).body, kept.joined(), live is not None),)

    def feed(self, setup: Setup, tares: Callable[[], int], layers: tuple[Layer, ...]) -> Feed:
        """Return a function that computes forces [N] from a stream's readings for the layer of taxels.

        Raises:
            InputError: a file that the rig names cannot be read.
            GeometryError: the file of the surface has no usable surface.
        """
        if layers and isinstance(layers[0], TaxelLayer):
            made = self.skin(setup).prepared().estimator
            if isinstance(made, TaxelEstimator):
                return _Cells(tares, setup, made, layers[0])
        return super().feed(setup, tares, layers)

    def report(self, run: Run, setup: Setup, estimator: ContactEstimator) -> Run:
        """Return the `Run` with the body to draw, its uncertainties and a `Section` on the cells' health.

        Raises:
            InputError: matplotlib is not installed, or the link's surface cannot be read.
            GeometryError: its file has no usable surface.
        """
        made = cast("TaxelEstimator", estimator)
        body, health = made.body, made.health
        shape = (body.rows, body.columns) if body.rows else None
        run = super().report(run, setup, estimator)
        drawn = cell_mesh(body) if setup.link.stated is None else run.body
        facts = [("cells", f"{len(body)}, of which {int(body.usable.sum())} are used")]
        if health is not None:
            rest = f"{np.median(health.baseline):.3g} counts, noise {np.median(health.noise):.2g} counts (medians)"
            facts += [("at rest", rest), ("dead, stuck", f"{health.dead.sum()}, {health.stuck.sum()}")]
        section = taxel_section(run.kept.contacts, tuple(facts), shape, () if health is None else health.notes)
        uncertainties = ("the cells' noise", "where in a cell a touch may be")
        return replace(run, body=drawn, uncertainties=uncertainties, sections=(section,))


class _Cells:
    """A feed of cell forces to the page by a separate estimator that takes its baseline from untouched frames."""

    def __init__(self, tares: Callable[[], int], setup: Setup, made: TaxelEstimator, layer: TaxelLayer) -> None:
        self._tares, self._layer = tares, layer
        self._estimator = TaxelEstimator(made.body, made.intensity, made.health, settings=made.settings)
        self._samples, self._one = SampleReader(setup.layout(), Path("the stream")), made.body.one
        self._rows = self._estimator.empty(self._estimator.most)
        self._done, self._free = tares(), list[np.ndarray]()
        self._rested = made.health is not None

    def __call__(self, slots: np.ndarray, watched: bool) -> None:
        if self._tares() != self._done:
            self._done, self._rested = self._tares(), False
            self._free.clear()
        readings = np.array(self._samples.readings(slots["values"].copy()))
        readings = readings.reshape(len(readings), -1)[:, : prod(self._one)]  # a wrench may stand behind them
        readings = readings.reshape(-1, *self._one)
        if not self._rested:
            self._rest(readings, slots)
        elif watched:
            self._estimator.update_into(1e-9 * float(slots["stamp"][-1]), readings[-1], self._rows)
            self._layer.feed(self._estimator.force.reshape(-1).copy())

    def _rest(self, readings: np.ndarray, slots: np.ndarray) -> None:
        free = (slots["ready"] > 0) & (slots["contacts"][:, 0, ROW.status] == Status.NO_CONTACT)
        self._free = [*self._free, *readings[free]][-REST:]
        if len(self._free) < REST:
            return
        frames, self._free = np.stack(self._free), list[np.ndarray]()
        try:
            self._estimator.tare(Recording(np.arange(float(REST)), {CELLS: frames}, source="the stream"))
        except InputError:  # not steady: the next ones are tried; the receiver says what is the matter
            return
        self._rested = True


def taxel_section(contacts: Contacts, facts: Facts, shape: tuple[int, int] | None, notes: tuple[str, ...]) -> Section:
    """Return the report's `Section` on taxels, with a map of the contacts on a sheet of `shape` rows and columns.

    Raises:
        InputError: there is a map to draw, and matplotlib is not installed.
    """
    places, pictures = sheet_places(contacts), ()
    if shape is not None and places is not None:
        force = np.linalg.norm(contacts.force, axis=1)
        rows = np.flatnonzero(contacts.located & np.isfinite(places[:, 0]))
        rows = rows[np.argsort(force[rows], kind="stable")]  # the strongest on top
        if len(rows):
            drawn = sheet_map(places[rows], force[rows], "force [N]", shape)
            pictures = (picture(drawn, "Where contacts were on the unrolled sheet, and how hard."),)
    return Section("Taxels", settings=facts, points=notes, pictures=pictures)
