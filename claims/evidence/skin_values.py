"""Number of touches on a skin whose readings come in steps, fall under load, or whose zero moves, against the truth.

The generator is this file's own: a flat sheet of 8 x 8 cells at 50 Hz, three to five touches with round Gaussian
pressure and peaks of 60 to 300 times the noise or the step, whichever is larger. A log is right if it has as many
touches as were made, as `palpate events` counts them.
"""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from claims.row import Row
from palpate.contact.touch_finder import TouchFinder
from palpate.sensors.taxels.estimator import TaxelEstimator
from palpate.sensors.taxels.health import examine
from palpate.sensors.taxels.model import TaxelBody
from palpate.signals.recording import CELLS, Recording
from palpate_lab.simulation.skin_bench import Rolled

SHEET = Rolled(8, 8, 0.005, np.inf)
RATE, TARE = 50.0, 3.0  # Hz, s
RATIOS = (0.05, 0.1, 0.25, 0.5, 1.0, 2.0)
LEAST = 0.99
_Course = Callable[[np.random.Generator, np.ndarray, np.ndarray], np.ndarray]


def rows(small: bool) -> Iterator[Row]:
    """Steps, direction, remainders and common steps."""
    count = 5 if small else 200
    body = TaxelBody.sheet(SHEET.layout(), bits=None)
    for ratio in RATIOS:
        yield _row(f"steps, noise/step {ratio:g}", body, count, ratio=ratio)
    yield _row("readings that fall under load, direction found", body, count, falling=True)
    yield _row("2 to 9 % of each touch remains", body, count, remains=True)
    yield _row("all cells step up and down at once", body, count, common=turned)
    yield _row("all cells step by the same", body, count, common=shifted)


def _row(what: str, body: TaxelBody, count: int, **changes: Any) -> Row:
    right = sum(counted(*made(np.random.default_rng([81, k]), **changes), body) for k in range(count))
    got = f"{right} of {count} logs"
    return Row(f"right number of touches, {what}", f">= {LEAST:.0%}", got, right >= LEAST * count)


def made(
    rng: np.random.Generator,
    *,
    ratio: float = 1.0,
    falling: bool = False,
    remains: bool = False,
    common: _Course | None = None,
) -> tuple[Recording, int]:
    """Return a log and its number of touches; `ratio` is noise/step."""
    touches, step = int(rng.integers(3, 6)), float(rng.choice([1.0, 4.0, 0.1]))
    time = np.arange(0.0, 6.0 + 4.0 * touches, 1.0 / RATE)
    noise = ratio * step
    cells = rng.uniform(20.0, 40.0, 64) * step + rng.normal(0.0, noise, (len(time), 64))
    row, column = (each.ravel() for each in np.mgrid[:8, :8])
    for k in range(touches):
        begun, lasts = 5.0 + 4.0 * k, rng.uniform(0.5, 1.5)
        away = (row - rng.uniform(1, 6)) ** 2 + (column - rng.uniform(1, 6)) ** 2
        peak = rng.uniform(60.0, 300.0) * max(noise, step) * np.exp(-away / 2.0 / rng.uniform(0.8, 1.5) ** 2)
        course = np.clip(np.minimum(time - begun, begun + lasts - time) / 0.08, 0.0, 1.0)
        course += rng.uniform(0.02, 0.09) * (time > begun + lasts) * (course == 0.0) * remains
        cells += course[:, None] * peak
    if common is not None:
        cells += (time > 4.0 + 4.0 * int(rng.integers(0, touches)))[:, None] * common(rng, row, column) * noise
    cells = step * np.rint((200.0 * step - cells if falling else cells) / step)
    return Recording(time, {CELLS: cells}), touches


def turned(rng: np.random.Generator, row: np.ndarray, column: np.ndarray) -> np.ndarray:
    """Return steps of both signs, in deviations of the noise."""
    return rng.uniform(-1.0, 2.0, len(row)) * rng.uniform(20.0, 300.0)


def shifted(rng: np.random.Generator, row: np.ndarray, column: np.ndarray) -> np.ndarray:
    """Return equal steps, in deviations of the noise."""
    return np.full(len(row), rng.choice([-1.0, 1.0]) * rng.uniform(20.0, 300.0))


def counted(log: Recording, touches: int, body: TaxelBody) -> bool:
    """Return whether a log has so many touches as it is estimated."""
    estimator = TaxelEstimator(body, health=examine(log, body, seconds=TARE))
    finder = TouchFinder()
    finder.add(estimator.run(log))
    return len(finder.touches()) == touches
