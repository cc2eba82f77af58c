"""Compiled loops for each sample of a stream; one call replaces many of NumPy, each of which costs 1 us or more.

Slots (k, words) are int64, and a view of the same memory as float64 holds their real numbers; `SlotForm.slot` gives the
meaning of each word, with the contacts in the middle and the values at the end. No function here marks a slot as
complete: the caller does that with a separate store after the call, because the compiler may reorder stores within one
call.
"""

# pyright: basic
from __future__ import annotations

import numpy as np

from palpate.surfaces._jit import entry

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
    """Store `count` samples from number `first` on in their slots, values (n, m); poses are read only if `posed`."""
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
    """Store contacts in slots: rows (m, width), counts[k] of them for sample `first` + k, known at `now` [ns]."""
    reals = slots.view(np.float64)
    row, width = 0, rows.shape[1]
    for k in range(len(counts)):
        slot, real = slots[(first + k) % len(slots)], reals[(first + k) % len(slots)]
        for i in range(counts[k]):
            for j in range(width):
                real[_CONTACTS + i * width + j] = rows[row + i, j]
        row += counts[k]
        slot[_ROWS], slot[_READY] = counts[k], now


@entry("stamp int64 n, times out n")
def seconds(stamp, times):
    """Write stamps [ns] as times [s], bit for bit as `palpate.files.logs.decoding.seconds` returns them."""
    for k in range(len(stamp)):
        whole = stamp[k] // _BILLION
        if -_EXACT < stamp[k] < _EXACT:
            times[k] = stamp[k] / 1e9
        else:
            times[k] = whole + (stamp[k] - whole * _BILLION) / 1e9


@entry(
    """
    count int, seconds strided int64 n, nanoseconds strided int64 n, least int, now int, stamp out int64 n,
    said out strided uint64 n, size int
    """
)
def stamped(count, seconds, nanoseconds, least, now, stamp, said, size):
    """Fill the stamps [ns] of `count` received datagrams: the kernel's, or `now` if the kernel gave none.

    `said` is the number of bytes of control data that came with each datagram; with `least` or more they hold a stamp.
    Each is reset to `size`, the room for control data; the last datagram's number is returned (0: no datagram).
    """
    last = np.int64(0)
    for k in range(min(count, len(stamp))):
        last = np.int64(said[k])
        stamp[k] = seconds[k] * _BILLION + nanoseconds[k] if last >= least else now
        said[k] = size
    return last
