"""Compiled: a filter's recursion, sample by sample."""

# pyright: basic
from __future__ import annotations

from palpate.surfaces._jit import inlined, released

AGE, TIME = 0, 1  # of the clock: samples since the start (-1: none yet), and when the last one was [s]


@inlined
def _run(time, status, values, sections, start, gains, gap, clock, state, age, width):
    for i in range(len(values)):
        if status[i] >= 0:
            age[i] = -1
            continue
        step = time[i] - clock[TIME]
        if step < 0.0 or step > gap:
            clock[AGE] = -1.0
        clock[AGE] += 1.0
        age[i] = int(clock[AGE])
        if time[i] == time[i]:
            clock[TIME] = time[i]
        x = values[i]
        if clock[AGE] == 0.0:
            for s in range(len(sections)):
                for c in range(width):
                    state[2 * s, c] = start[s, 0] * x[c]
                    state[2 * s + 1, c] = start[s, 1] * x[c]
        if len(sections) == 0:
            gain = gains[min(age[i], len(gains) - 1)]
            for c in range(width):
                state[0, c] = x[c] if age[i] == 0 else state[0, c] + gain * (x[c] - state[0, c])
                x[c] = state[0, c]
        for s in range(len(sections)):  # transposed direct form II
            b0, b1, b2 = sections[s, 0], sections[s, 1], sections[s, 2]
            a1, a2 = sections[s, 4], sections[s, 5]
            for c in range(width):
                y = b0 * x[c] + state[2 * s, c]
                state[2 * s, c] = b1 * x[c] - a1 * y + state[2 * s + 1, c]
                state[2 * s + 1, c] = b2 * x[c] - a2 * y
                x[c] = y


@released(
    """
    time n, status int8 n, values out n m, sections k 6, start k 2, gains g, gap float, clock out 2, state out a
    m, age out int64 n
    """
)
def smooth(time, status, values, sections, start, gains, gap, clock, state, age):
    """Filter values (n, w) in place, every column by the same filter.

    Samples with a status >= 0 are not changed, get age -1, and leave the filter as it is. It starts afresh where time
    steps back, or forward by more than `gap`. sections, start and gains are those of a `Recursion`; clock (2,) holds
    AGE and TIME, state is (2 s, w), or (1, w) without sections. The ages (n,) are written into `age`.
    """
    if values.shape[1] == 6:  # a wrench: loops of a known length are faster
        _run(time, status, values, sections, start, gains, gap, clock, state, age, 6)
    else:
        _run(time, status, values, sections, start, gains, gap, clock, state, age, values.shape[1])
