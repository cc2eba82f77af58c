"""Times of calls, and how far many runs have come."""

import sys
from collections.abc import Callable, Iterable, Iterator
from time import monotonic, perf_counter_ns
from typing import TypeVar

import numpy as np

Run = TypeVar("Run")


def timed(call: Callable[[int], object], count: int) -> np.ndarray:
    """Return the times (count,) [us] of calls with 0, 1, ...; the first of all, which may compile, is not timed."""
    call(0)
    took = np.empty(count)
    for k in range(count):
        begin = perf_counter_ns()
        call(k)
        took[k] = 1e-3 * (perf_counter_ns() - begin)
    return took


def counted(runs: Iterable[Run], total: int) -> Iterator[Run]:
    """Yield runs as they end, and say on stderr how many of them have."""
    begin = monotonic()
    for count, run in enumerate(runs, 1):
        print(f"\r{count} of {total} runs, {monotonic() - begin:.0f} s  ", end="", file=sys.stderr, flush=True)
        yield run
    print(file=sys.stderr)
