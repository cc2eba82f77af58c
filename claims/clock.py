"""Times of calls, and how far many runs have come."""

import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from time import monotonic, perf_counter, perf_counter_ns
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


def in_turns(
    calls: Mapping[str, Callable[[], object]], rounds: int, clock: Callable[[], float] = perf_counter
) -> dict[str, np.ndarray]:
    """Return the seconds of calls, all of them in every round; a first round, which may compile, is not kept."""
    took = {name: np.empty(rounds + 1) for name in calls}
    for k in range(rounds + 1):
        for name, call in calls.items():
            begin = clock()
            call()
            took[name][k] = clock() - begin
    return {name: each[1:] for name, each in took.items()}


def by_blocks(calls: Mapping[str, Callable[[int], object]], count: int, size: int) -> dict[str, np.ndarray]:
    """Return the times (count,) [us] of calls with 0, 1, ...: a block of each in turn, so that all meet the same."""
    took = {name: np.empty(count) for name in calls}
    for start in range(0, count, size):
        for name, call in calls.items():
            block = took[name][start : start + size]
            block[:] = timed(lambda k, call=call, start=start: call(start + k), len(block))
    return took


def counted(runs: Iterable[Run], total: int) -> Iterator[Run]:
    """Yield runs as they end, and say on stderr how many of them have."""
    begin = monotonic()
    for count, run in enumerate(runs, 1):
        print(f"\r{count} of {total} runs, {monotonic() - begin:.0f} s  ", end="", file=sys.stderr, flush=True)
        yield run
    print(file=sys.stderr)
