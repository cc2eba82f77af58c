"""Calibrations of skins from what people have: two loggers on their own clocks, and frames at known pressures.

The generators are this file's own. Velostat in a voltage divider falls under load, with noise of 3 of 1,023 counts, and
creeps by 5 % within seconds; its logger has 100 Hz, that of the load cell 80 Hz, both with jitter. A mat has a curve
that bends, and cells whose gains scatter by 15 %.
"""

from collections.abc import Iterator

import numpy as np

from claims.row import Row
from palpate.errors import NotIdentifiable
from palpate.sensors.taxels.mat import identify_by_pressures
from palpate.sensors.taxels.model import TaxelBody
from palpate.sensors.taxels.skin_map.model import flat_map
from palpate.sensors.taxels.two_loggers import loggers_offset

NEAR, PRESSES = 0.02, 15  # s; presses of a log
CREEPS, SLOW = 0.05, 2.0  # share of a force that comes late, and s
SHAPE, PITCH, GAINS, HALF = (12, 16), 0.01, 0.15, 60e3  # a mat's cells, m, scatter, Pa at half of the range
RELATIVE = 0.02


def rows(small: bool) -> Iterator[Row]:
    """Offsets of clocks from irregular and regular presses, and pressures of a mat."""
    yield _clocks(3 if small else 20, regular=False)
    yield _clocks(2 if small else 20, regular=True)
    yield _mat()


def _clocks(count: int, *, regular: bool) -> Row:
    errors, refused = list[float](), 0
    for k in range(count):
        rng = np.random.default_rng([49, k, regular])
        offset = float(rng.choice([-1.0, 1.0]) * rng.uniform(0.2, 3.0))
        try:
            errors.append(abs(loggers_offset(*two_logs(rng, offset, regular=regular)).offset - offset))
        except NotIdentifiable:
            refused += 1
    near = sum(error <= NEAR for error in errors)
    what = f"clocks of two loggers 0.2 to 3 s off, presses at {'regular' if regular else 'irregular'} times"
    worst = f", worst {1e3 * max(errors):.1f} ms" if errors else ""
    got = f"{near} of {count} found to 20 ms{worst}; {refused} refused"
    return Row(what, "each to 20 ms, or refused", got, near + refused == count)


def two_logs(rng: np.random.Generator, offset: float, *, regular: bool = False) -> tuple[np.ndarray, ...]:
    """Return times and readings of the taxel, and times, `offset` less, and forces of the load cell."""
    begin = 3.0 + np.cumsum(np.full(PRESSES, 3.0) if regular else rng.uniform(1.8, 4.0, PRESSES))
    lasts = np.full(PRESSES, 1.0) if regular else rng.uniform(0.4, 1.5, PRESSES)
    peak = np.full(PRESSES, 5.0) if regular else rng.uniform(1.0, 10.0, PRESSES)
    ramp = rng.uniform(0.05, 0.3, PRESSES)
    fine = np.arange(0.0, begin[-1] + 3.0, 0.001)
    ways = np.minimum(fine[:, None] - begin, begin + lasts - fine[:, None]) / ramp
    force = np.clip(ways, 0.0, 1.0) @ peak
    late = np.zeros(len(fine))
    for k in range(1, len(fine)):
        late[k] = late[k - 1] + 0.001 / SLOW * (force[k] - late[k - 1])
    time = np.cumsum(rng.uniform(0.008, 0.012, len(fine) // 10 - 50))
    felt = np.interp(time, fine, (1.0 - CREEPS) * force + CREEPS * late)
    reading = np.rint(900.0 - 700.0 * felt / (felt + 4.0) + rng.normal(0.0, 3.0, len(time)))
    there = np.sort(rng.uniform(0.0, fine[-1], len(fine) * 80 // 1000))
    return time, reading, there - offset, np.interp(there, fine, force) + rng.normal(0.0, 0.03, len(there))


def _mat() -> Row:
    """Judge pressures that no frame of the calibration has, against the truth."""
    rng, body = np.random.default_rng(50), TaxelBody.sheet(flat_map(*SHAPE, PITCH), bits=None)
    gain = rng.normal(1.0, GAINS, len(body))

    def frames(pressures: np.ndarray) -> np.ndarray:
        counts = 40.0 + gain * 900.0 * pressures[:, None] / (pressures[:, None] + HALF)
        return np.rint(counts + rng.normal(0.0, 1.0, counts.shape))

    known, others = 1e3 * np.arange(0.0, 80.0, 10.0), rng.uniform(15e3, 65e3, 20)
    found, rest = identify_by_pressures(known, frames(known), body), frames(np.zeros(50)).mean(axis=0)
    curves = [found.curves[int(k)] for k in found.numbers(body.shape).tolist()]
    above = (frames(others) - rest).T
    pressures = np.array([curve.force(each) for curve, each in zip(curves, above, strict=True)]).T / PITCH**2
    error = float(np.sqrt(np.mean((pressures / others[:, None] - 1.0) ** 2)))
    what = (
        f"a mat of {len(body)} cells with gains {GAINS:.0%} off, by a frame at each of {len(known)} pressures: others"
    )
    return Row(what, f"rms error of a cell <= {RELATIVE:.0%}", f"{error:.1%}", error <= RELATIVE)
