"""One bench: a run that calibrates and a run that verifies, for our estimator and for the paper's own."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float

from claims.evidence.load_cells import LEAST, SURFACE, Runs, answered, loaded, rest
from claims.papers.load_cells.literal import Literal
from palpate.sensors.load_cells.calibrate import LoadCellCalibration
from palpate_lab.simulation.cell_array import LAYOUTS
from palpate_lab.simulation.load_cell_bench import Bench, BenchRun

PAPER = 0.6  # N: from which on the paper gives positions
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
        return Runs(self.thin).first(self.bench)

    @property
    def second(self) -> BenchRun:
        return Runs(self.thin).second(self.verified or self.bench)

    @property
    def calibration(self) -> LoadCellCalibration:
        """From the first run; the cells' places are not told."""
        return Runs(self.thin).calibrated(self.bench, self.indentation)

    def loaded(self, least: float = LEAST) -> Bool[np.ndarray, " n"]:
        """Samples of the second run from that force on [N]."""
        return loaded(self.second, least)

    @cached_property
    def ours(self) -> Answer:
        return self.estimate("soft_finger")

    def estimate(self, method: str) -> Answer:
        found = answered(self.calibration.cells, self.second, method).found
        return Answer(found.force, found.point, found.torque)

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


def _zeroed(run: BenchRun) -> Float[np.ndarray, "n k 3"]:
    volts = run.voltages.copy()
    for number in np.unique(run.trajectory):
        part = run.trajectory == number
        volts[part] -= run.voltages[rest(run, part)].mean(axis=0)
    return volts.reshape(len(volts), -1, 3)
