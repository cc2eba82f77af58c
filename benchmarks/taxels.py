"""Normal equations of taxels: compiled, beside NumPy's bincount."""

from __future__ import annotations

from collections.abc import Iterator
from time import perf_counter

import numpy as np

from evidence.row import Row
from palpate.calibration.taxels._accumulate import accumulate

__all__ = ["by_bincount", "drawn", "empty", "rows"]

COMMAND = "python -m benchmarks --only taxels"
NAME = "taxels"
ASKED, ROUNDS = 5.0, 15


def by_bincount(
    force: np.ndarray,
    torque: np.ndarray,
    starts: np.ndarray,
    taxel: np.ndarray,
    weights: np.ndarray,
    matrix: np.ndarray,
    vector: np.ndarray,
    pressing: np.ndarray,
) -> None:
    """What `accumulate` does, in NumPy: twelve sums over the answers, by taxel."""
    square = np.einsum("ni,ni->n", force, force)
    known = square > 0
    size = np.sqrt(np.where(known, square, 1.0))
    unit = force / size[:, None]
    x, y, z = unit.T
    flat = np.stack([1 - x * x, -x * y, -x * z, 1 - y * y, -y * z, 1 - z * z])
    lines = np.concatenate([flat, np.cross(unit, torque / size[:, None]).T, unit.T]) * known
    poke = np.repeat(np.arange(len(force)), np.diff(starts))
    for column, sums in zip(lines, (*matrix.T, *vector.T, *pressing.T), strict=True):
        sums += np.bincount(taxel, weights * column[poke], len(matrix))


def drawn(pokes: int, taxels: int, rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    """Forces, torques, starts, taxels and weights of pokes with three answers each on average."""
    starts = np.concatenate([[0], np.cumsum(rng.poisson(3.0, pokes))])
    answers = int(starts[-1])
    taxel, weights = rng.integers(taxels, size=answers), rng.random(answers)
    return rng.normal(0.0, 5.0, (pokes, 3)), rng.normal(0.0, 1.0, (pokes, 3)), starts, taxel, weights


def empty(taxels: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Matrix, vector and pressing, to be added to."""
    return np.zeros((taxels, 6)), np.zeros((taxels, 3)), np.zeros((taxels, 3))


def rows(small: bool) -> Iterator[Row]:
    """Both in turns; of the rounds the median."""
    pokes, taxels = (2_000 if small else 100_000), 4_000
    given = drawn(pokes, taxels, np.random.default_rng(0))
    took: dict[str, list[float]] = {"compiled": [], "bincount": []}
    for _ in range(2 if small else ROUNDS):  # the first compiles
        for name, call in (("compiled", accumulate), ("bincount", by_bincount)):
            out = empty(taxels)
            begin = perf_counter()
            call(*given, *out)
            took[name].append(perf_counter() - begin)
    ours, theirs = (float(np.median(each[1:])) for each in took.values())
    what = f"normal equations of {taxels:,} taxels from {pokes:,} pokes, three answers each, over NumPy's bincount"
    got = f"{theirs / ours:.1f} x ({1e3 * ours:.2f} ms against {1e3 * theirs:.2f})"
    yield Row(NAME, what, f">= {ASKED:g} x", got, None if small else theirs / ours >= ASKED, COMMAND)
