"""`python -m experiments.drift [size]`: the figures of the followed zero, one a line."""

from __future__ import annotations

import sys
from collections.abc import Iterator

import numpy as np

from evidence.row import shared
from experiments.drift.real import aged, pad
from experiments.drift.study import MINUTE, Line, jumps, long_contacts, payload, smoothing, touches
from experiments.drift.world import Touch

__all__ = ["figures"]


def figures(size: int) -> Iterator[Line]:
    """All of them; `size` 1 takes some minutes, 10 is the full study."""
    for walk, warm_up in ((1e-3, MINUTE), (3.5e-3, MINUTE), (3.5e-3, 0.0), (6e-3, MINUTE)):
        yield long_contacts(walk, warm_up, size)
    yield smoothing(3.5e-3, 0.0, size)
    yield smoothing(3.5e-3, MINUTE, size)
    for onset in (0.0, 0.1, 1.0, 3.0, 10.0):
        yield touches("one touch of 0.2 N", onset, 3 * size, lambda rng, a, b, o=onset: [Touch(a, b, 0.2, o)])
        yield touches("two touches of 0.2-2 N at once", onset, 3 * size, lambda rng, a, b, o=onset: _two(rng, a, b, o))
    for over in (0.0, 30.0, 60.0, 120.0):
        yield jumps(0.5, over, size)
    yield jumps(0.5, 0.0, size, alone=True)
    for amount in (0.5, 0.1):
        yield jumps(amount, 0.0, size, skin=True)
    yield jumps(0.1, 0.0, size)
    yield from payload(0.05, size)
    folder = shared()
    if folder is not None:
        for log in ("trajectory_panda_ft_opti.csv", "data_two_payloads_ft.csv"):
            yield from pad(folder / "data" / "pad", log, 3e-3)
            yield from aged(folder / "data" / "pad" / log, 3e-3)


def _two(rng: np.random.Generator, begin: float, end: float, onset: float) -> list[Touch]:
    return [Touch(begin, end, float(rng.uniform(0.2, 2.0)), onset) for _ in range(2)]


if __name__ == "__main__":
    for line in figures(int(sys.argv[1]) if len(sys.argv) > 1 else 1):
        print(line, flush=True)
