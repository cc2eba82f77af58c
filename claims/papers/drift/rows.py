"""A zero that wanders: what is followed, what is not eaten, and what nobody can tell."""

from collections.abc import Iterator

import numpy as np

from claims.papers.drift.identify import identified
from claims.papers.drift.real import aged, pad
from claims.papers.drift.study import MINUTE, Line, jumps, long_contacts, payload, smoothing, touches
from claims.papers.drift.world import Touch
from claims.row import Row, shared


def rows(small: bool) -> Iterator[Row]:
    """Yield the full study; small, it takes some minutes."""
    yield from (Row(line.what, "", line.got) for line in lines(1 if small else 10))


def lines(size: int) -> Iterator[Line]:
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
    yield from identified(range(1000, 1000 + 6 * size))
    folder = shared()
    if folder is not None:
        for log in ("trajectory_panda_ft_opti.csv", "data_two_payloads_ft.csv"):
            yield from pad(folder / "data" / "pad", log, 3e-3)
            yield from aged(folder / "data" / "pad" / log, 3e-3)


def _two(rng: np.random.Generator, begin: float, end: float, onset: float) -> list[Touch]:
    return [Touch(begin, end, float(rng.uniform(0.2, 2.0)), onset) for _ in range(2)]
