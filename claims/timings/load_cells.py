"""Load cells: the calibration, and from voltages to contacts, one by one from Python and in blocks."""

import time
from collections.abc import Iterator

import numpy as np

import palpate
from claims.clock import timed
from claims.evidence.load_cells import SURFACE, UNLOADED
from claims.row import Row
from palpate.sensors.load_cells.array import LoadCellArray
from palpate.sensors.load_cells.calibrate import LoadCellCalibration, identify_load_cells
from palpate.sensors.load_cells.model import VOLTAGE
from palpate_lab.simulation.load_cell_bench import BENCHES, BenchRun

ROUNDS = 9
CALIBRATION, LIVE, BLOCKS = 5.0, 8.0, 250_000  # s, us, contacts a second


def rows(small: bool) -> Iterator[Row]:
    for name in ("rigid", "soft layer"):
        run = BENCHES[name].run(0, thin=10 if small else 1)
        log = run.time, run.voltages, run.force, run.position, SURFACE
        begin = time.perf_counter()
        found = identify_load_cells(*log, indentation=name != "rigid")
        took = time.perf_counter() - begin
        if name == "rigid":
            what = f"calibration of eight trajectories, {len(run):,} samples"
            yield Row(what, f"{CALIBRATION:g} s", f"{took:.1f} s", took <= CALIBRATION)
        yield from _speed(name, run, found)


def _speed(name: str, run: BenchRun, found: LoadCellCalibration) -> Iterator[Row]:
    """Of loaded samples, whose contacts all have a covariance."""
    cells = found.cells
    tip = palpate.WrenchEstimator(palpate.Locator(SURFACE, indentation=cells.indentation), LoadCellArray(cells))
    first = run.trajectory == 0
    rest = first & (run.time < run.time[first][0] + UNLOADED)
    tip.tare(palpate.Recording(run.time[rest], {VOLTAGE: run.voltages[rest]}))
    loaded = np.linalg.norm(run.wrench[:, :3], axis=1) >= 1.0
    volts, stamps = np.ascontiguousarray(run.voltages[loaded][:8000]), run.time[loaded][:8000]
    block, row = palpate.Recording(stamps, {VOLTAGE: volts}), tip.empty()
    each, rates = list[np.ndarray](), list[float]()
    for _ in range(ROUNDS):
        each.append(timed(lambda k: tip.update_into(stamps[k], volts[k], row), len(volts)))
        rates.append(1e6 * len(volts) / float(timed(lambda _: tip.run(block), 1)[0]))
    middle, high = np.percentile(np.concatenate(each), [50, 99])
    got = f"p50 {middle:.2f} us, p99 {high:.2f} us"
    judged = name == "rigid"  # no figure was asked for of the other, which is iterated
    what = f"voltages to contact, one by one from Python, {name}"
    yield Row(what, f"<= {LIVE:g} us p50" * judged, got, middle <= LIVE if judged else None)
    what = f"voltages to contact with covariance, in blocks on one core, {name}"
    target, rate = f">= {BLOCKS:,}/s" * judged, float(np.median(rates))
    yield Row(what, target, f"{rate:,.0f}/s", rate >= BLOCKS if judged else None)
