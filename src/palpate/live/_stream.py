"""Compiled: what is done with every sample, each in one call, because each call of NumPy costs 1 us and more.

Slots (k, words) are int64, and their numbers seen as float64 are the same memory; which word holds what is `Form.slot`,
with the contacts in the middle and the values at the end. Nothing here says that a slot is whole: that is a store of
its own, after the call, since within one call the compiler may order stores as it likes.
"""

# pyright: basic
from __future__ import annotations

import numpy as np

from palpate.surfaces._jit import entry

__all__ = ["answer", "seconds", "stamped", "take_in"]

_NUMBER, _STAMP, _ARRIVED, _READY, _LOST, _ROWS = range(6)
_ORIENTATION, _POSITION, _ACCELERATION, _UNSTEADY, _CONTACTS = 6, 10, 13, 16, 17
_BILLION = 1_000_000_000
_EXACT = 1 << 53  # below it every integer is a double


@entry(
    """
    slots out int64 n m, first int, count int, stamp int64 k, arrived int64 a, lost int64 k, values v w,
    posed bool, orientation k 4, position k 3, acceleration k 3, unsteady u
    """
)
def take_in(slots, first, count, stamp, arrived, lost, values, posed, orientation, position, acceleration, unsteady):
    """So many samples from number `first` on, values (n, m); without `posed` the last four are not read."""
    reals = slots.view(np.float64)
    before, count = slots.shape[1] - values.shape[1], min(count, len(stamp))
    for k in range(count):
        slot, real = slots[(first + k) % len(slots)], reals[(first + k) % len(slots)]
        slot[_READY] = slot[_ROWS] = 0
        slot[_NUMBER], slot[_STAMP], slot[_ARRIVED], slot[_LOST] = first + 1 + k, stamp[k], arrived[k], lost[k]
        for j in range(values.shape[1]):
            real[before + j] = values[k, j]
        if posed:
            for j in range(4):
                real[_ORIENTATION + j] = orientation[k, j]
            for j in range(3):
                real[_POSITION + j], real[_ACCELERATION + j] = position[k, j], acceleration[k, j]
            real[_UNSTEADY] = unsteady[k]


@entry("slots out int64 n m, first int, rows k w, counts int64 s, now int")
def answer(slots, first, rows, counts, now):
    """Rows (m, width), counts[k] of them for sample `first` + k, known at `now` [ns]."""
    reals = slots.view(np.float64)
    row, width = 0, rows.shape[1]
    for k in range(len(counts)):
        slot, real = slots[(first + k) % len(slots)], reals[(first + k) % len(slots)]
        for i in range(counts[k]):
            for j in range(width):
                real[_CONTACTS + i * width + j] = rows[row + i, j]
        row += counts[k]
        slot[_ROWS], slot[_READY] = counts[k], now


@entry("stamp int64 n")
def seconds(stamp):
    """The bits of `palpate.files.logs.decoding.seconds`."""
    times = np.empty(len(stamp))
    for k in range(len(stamp)):
        whole = stamp[k] // _BILLION
        if -_EXACT < stamp[k] < _EXACT:
            times[k] = stamp[k] / 1e9
        else:
            times[k] = whole + (stamp[k] - whole * _BILLION) / 1e9
    return times


@entry(
    """
    count int, seconds strided int64 n, nanoseconds strided int64 n, least int, now int, stamp out int64 n,
    said out strided uint64 n, size int
    """
)
def stamped(count, seconds, nanoseconds, least, now, stamp, said, size):
    """Stamps [ns] of so many datagrams that were received, `now` where the kernel did not say them.

    `said` is how many bytes the kernel said beside each: from `least` on, a stamp. It is set to `size` again, which is
    how many it may say, and what it was of the last datagram is returned (0: there is none).
    """
    last = np.int64(0)
    for k in range(min(count, len(stamp))):
        last = np.int64(said[k])
        stamp[k] = seconds[k] * _BILLION + nanoseconds[k] if last >= least else now
        said[k] = size
    return last
