"""One bench: a run that calibrates and a run that verifies, for our estimator and for the paper's own."""

from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
from jaxtyping import Bool, Float

from claims.papers.load_cells.literal import Literal
from palpate.contact.estimate import ContactEstimate
from palpate.contact.locate import Locator
from palpate.contact.wrench_estimator import WrenchEstimator
from palpate.sensors.load_cells.array import LoadCellArray
from palpate.sensors.load_cells.calibrate import LoadCellCalibration, identify_load_cells
from palpate.sensors.load_cells.model import VOLTAGE
from palpate.signals.recording import Recording
from palpate.surfaces import EllipticCylinder
from palpate_lab.simulation.cell_array import LAYOUTS
from palpate_lab.simulation.load_cell_bench import REST, Bench, BenchRun

SURFACE = EllipticCylinder(a=14e-3, b=5e-3, half_length=16e-3, upper=True)
UNLOADED = REST - 0.1  # s at the start of each trajectory that the zero is taken from
PAPER = 0.6  # N: from which on the paper gives positions
LEAST = 1.0  # N: from which on these tables are
FEW = 5000  # samples that are enough for 48 numbers, for the paper's estimator


@dataclass(frozen=True, eq=False)
class Answer:
    """What an estimator says of each sample [N, m, N m]; NaN where it does not answer."""

    force: Float[np.ndarray, "n 3"]
    point: Float[np.ndarray, "n 3"]
    torque: Float[np.ndarray, " n"]


@dataclass(frozen=True, eq=False)
class Study:
    """A bench, and how its log is calibrated.

    Attributes:
        bench: the apparatus; run 0 calibrates, and run 1 verifies.
        verified: the apparatus of run 1, where it is another.
        indentation: whether the layer's law is fitted.
        thin: every how manieth sample is taken.
    """

    bench: Bench
    verified: Bench | None = None
    indentation: bool = False
    thin: int = 1

    @property
    def first(self) -> BenchRun:
        return _run(self.bench, 0, self.thin)

    @property
    def second(self) -> BenchRun:
        return _run(self.verified or self.bench, 1, self.thin)

    @cached_property
    def calibration(self) -> LoadCellCalibration:
        """From the first run; the cells' places are not told."""
        run = self.first
        return identify_load_cells(
            run.time, run.voltages, run.force, run.position, SURFACE, indentation=self.indentation
        )

    def loaded(self, least: float = LEAST) -> Bool[np.ndarray, " n"]:
        """Samples of the second run from that force on [N]."""
        return np.linalg.norm(self.second.wrench[:, :3], axis=1) >= least

    @cached_property
    def ours(self) -> Answer:
        return self.estimate("soft_finger")

    def estimate(self, method: str) -> Answer:
        run = self.second
        cells = self.calibration.cells
        locator = Locator(SURFACE, method, indentation=cells.indentation)
        fingertip, found = WrenchEstimator(locator, LoadCellArray(cells)), list[ContactEstimate]()
        for part, rest in _starts(run):
            fingertip.tare(Recording(run.time[rest], {VOLTAGE: run.voltages[rest]}))
            found.append(fingertip.run(Recording(run.time[part], {VOLTAGE: run.voltages[part]})).estimate)
        whole = ContactEstimate.joined(found)
        return Answer(whole.force, whole.point, whole.torque)

    @cached_property
    def theirs(self) -> Answer:
        """The paper's (17) and (18), from the places as drawn; it knows no torque."""
        run, layout = self.first, LAYOUTS[4] if self.bench.layout is None else self.bench.layout
        point, _, _ = SURFACE.project(run.position)
        some = np.flatnonzero(np.linalg.norm(run.force, axis=1) > PAPER)
        some = some[:: max(1, len(some) // FEW)]
        made = Literal.fit(_zeroed(run)[some], run.force[some], point[some], layout)
        force, point = made.estimate(_zeroed(self.second))
        return Answer(force, point, np.full(len(force), np.nan))


@cache
def _run(bench: Bench, number: int, thin: int) -> BenchRun:
    """One that several studies share."""
    return bench.run(number, thin=thin)


def _starts(run: BenchRun) -> list[tuple[Bool[np.ndarray, " n"], Bool[np.ndarray, " n"]]]:
    """Samples of each trajectory, and those of its unloaded start."""
    parts = [run.trajectory == number for number in np.unique(run.trajectory)]
    return [(part, part & (run.time < run.time[part][0] + UNLOADED)) for part in parts]


def _zeroed(run: BenchRun) -> Float[np.ndarray, "n k 3"]:
    volts = run.voltages.copy()
    for part, rest in _starts(run):
        volts[part] -= run.voltages[rest].mean(axis=0)
    return volts.reshape(len(volts), -1, 3)
