"""A plate on cells of one axis: calibrated by weights, verified by touches of an independent run.

The plate (`palpate_lab.simulation.plate`) is 300 mm square and bends on springs; no estimator has a part in it. Its
cells, rated 10 N, differ by 1 % in gain and 5 % in stiffness, and err by up to 0.1 % of their rating. Twelve weights of
2, 5 and 10 N calibrate it, at places that are known to 0.5 mm along x and y, or not known. Each trial draws another.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from statistics import NormalDist

import numpy as np

import palpate
from claims.evidence.covariance import CHI2_95, squared_distance
from claims.row import Row
from palpate.sensors.load_cells.array import LoadCellArray
from palpate.sensors.load_cells.calibrate_plate import NAMED, PLACED, PlateCalibration, identify_plate, named_beyond
from palpate.sensors.load_cells.model import VOLTAGE, with_changes
from palpate.sensors.load_cells.plate import TOLERANCE
from palpate.sensors.load_cells.zero import Zero
from palpate.surfaces import plane
from palpate_lab.simulation.plate import RATE, RESTS, SIDE, STANDS, Plate, PlateRun, plate_run

FACE = plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), SIDE / 2)
WEIGHTS = np.repeat([2.0, 5.0, 10.0], 4)  # N
TOUCHES, OFF = 40, 1.05  # of a trial; gain of a cell that errs
TRIALS, PLATES = 50, 200  # of accuracy and of cells that err; of ellipses, as a plate's touches share its calibration


def rows(small: bool) -> Iterator[Row]:
    """Place and weight by weights at known and unknown places, ellipses, a cell that errs."""
    count, plates = (2, 2) if small else (TRIALS, PLATES)
    for known, most in ((True, 1e-3), (False, 1.5e-3)):
        yield from _accuracy([trial(4, known, number) for number in range(count)], known, most)
    for cells in (3, 4, 6):
        for known in (True, False):
            trials = [trial(cells, known, number, (1.0, 15.0)) for number in range(plates)]
            yield _inside(trials, f"{cells} cells, {_places(known)}, pressed along the normal", small)
    trials = [trial(4, True, number, (1.0, 15.0), shear=0.3) for number in range(plates)]
    yield _inside(trials, "4 cells, shear of 0.3 of the force (sd), which is not measured, 10 mm above them", small)
    yield from _named(count)


@dataclass(frozen=True, eq=False)
class Trial:
    """A plate's calibration, an independent run, and a reading of each of its touches, answered; and the sensor."""

    found: PlateCalibration
    run: PlateRun
    answer: palpate.ContactEstimate
    array: LoadCellArray


def trial(
    cells: int,
    known: bool,
    number: int,
    force: tuple[float, float] = (5.0, 5.0),
    shear: float = 0.0,
    spoiled: tuple[float, float] = (1.0, 1.0),
) -> Trial:
    """Draw a plate, calibrate and touch it; `spoiled`: gain of cell 2 before the calibration, and after it."""
    rng = np.random.default_rng([number, cells, known])
    plate = _changed(Plate.drawn(rng, cells), spoiled[0])
    weights = plate_run(plate, rng, WEIGHTS, 0.0)
    place = (
        weights.point[:, :2] + PLACED * rng.standard_normal((len(WEIGHTS), 2)) if known else np.full((12, 2), np.nan)
    )
    none = weights.touch < 0
    weight = np.where(none, 0.0, WEIGHTS[weights.touch])
    places = np.where(none[:, None], np.nan, place[weights.touch])
    found = identify_plate(weights.time, weights.voltages, weight, places, plate.position)
    run = plate_run(_changed(plate, spoiled[1]), rng, rng.uniform(*force, TOUCHES), 0.0, shear)
    rest = run.voltages[: round(RESTS * RATE)]
    array = LoadCellArray(with_changes(found.cells, shear=shear), zero=Zero(rest.mean(axis=0), 1.0 / len(rest)))
    middle = round((RESTS + STANDS / 2) * RATE) + round((RESTS + STANDS) * RATE) * np.arange(TOUCHES)
    estimator = palpate.WrenchEstimator(FACE, array, mounted=False)
    answer = estimator.run(palpate.Recording(run.time[middle], {VOLTAGE: run.voltages[middle]}))
    return Trial(found, run, answer.estimate, array)


def _changed(plate: Plate, gain: float) -> Plate:
    return replace(plate, gain=plate.gain * np.where(np.arange(len(plate.gain)) == 1, gain, 1.0))


def _places(known: bool) -> str:
    return f"weights at {'known' if known else 'unknown'} places"


def _accuracy(trials: list[Trial], known: bool, most: float) -> Iterator[Row]:
    off = np.concatenate([np.linalg.norm(each.answer.point - each.run.point, axis=1) for each in trials])
    share = np.concatenate([each.answer.force[:, 2] / each.run.force[:, 2] - 1.0 for each in trials])
    what = f"300 mm, 4 cells of 0.1 %, {_places(known)}, {len(trials)} plates, {len(off):,} touches of 5 N"
    place, force = _rms(off), _rms(share)
    yield Row(f"{what}: place (rms)", f"<= {1e3 * most:g} mm", f"{1e3 * place:.2f} mm", place <= most)
    yield Row(f"{what}: weight (rms)", "<= 0.5 %", f"{100 * force:.2f} %", force <= 0.005)


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))  # NaN where one is not answered


def _inside(trials: list[Trial], what: str, small: bool) -> Row:
    square = np.array([squared_distance(each.answer, each.run.point) for each in trials])
    shares = np.mean(square <= CHI2_95, axis=1)
    share, unsure = float(np.mean(shares)), float(np.std(shares) / np.sqrt(len(shares)))
    none = np.count_nonzero(np.isinf(square))
    got = f"{share:.1%} of {square.size:,} (+- {unsure:.1%} between {len(trials)} plates), {none} not answered"
    return Row(f"{what}: truth in the 95 % ellipse", "93 to 97 %", got, None if small else 0.93 <= share <= 0.97)


def _named(count: int) -> Iterator[Row]:
    """A cell that reads 5 % too much: named when the plate is calibrated, or by touches afterwards.

    When it is calibrated, a cell is compared with the others, whose gains differ: that bounds what can be named.
    """
    sound = [trial(4, True, number, (1.0, 15.0)) for number in range(count)]
    before = [trial(4, True, number, spoiled=(OFF, 1.0)) for number in range(count)]
    after = [trial(4, True, number, (1.0, 15.0), spoiled=(1.0, OFF)) for number in range(count)]
    cells = 4
    difference = (OFF - 1.0) / (TOLERANCE * np.sqrt(cells / (cells - 1)))  # from the mean of the others
    possible = NormalDist().cdf(difference - named_beyond(cells))
    limit = f"; {possible:.0%} can be, where one of {1 / NAMED:.0f} sound plates is named and cells differ by 1 %"
    shares = (
        ("when it is calibrated", [set(each.found.odd) == {1} for each in before], limit),
        ("by touches after the calibration", [_faulty(each) == (1,) for each in after], ""),
    )
    for when, right, possibly in shares:
        share = float(np.mean(right))
        got = f"{share:.0%} of {count}{possibly}"
        yield Row(f"one of 4 cells 5 % off, {when}: named", ">= 95 %", got, share >= 0.95)
    false = sum(bool(each.found.odd) + bool(_faulty(each)) for each in sound)
    yield Row("sound cells: one named", "0", f"{false} of {count}", false == 0)


def _faulty(each: Trial) -> tuple[int, ...]:
    return next((fault.cells for fault in each.array.faults()), ())
