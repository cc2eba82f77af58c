"""Compiled: frames of numbers out of a stretch of bytes, and into one. The format stands in `palpate.live.cobs`."""

# pyright: basic
from __future__ import annotations

import numpy as np

from palpate.surfaces._jit import inner, released

__all__ = ["DAMAGED", "FOREIGN", "JOINED", "LAST", "LOST", "NUMBERS", "RESTARTS", "STATE", "decode", "encode"]

_HEAD, _CHECK = 8, 4  # bytes before the numbers and behind them
_VERSION = 1
_WRAP = 1 << 32  # of the counter

STATE = 7  # numbers of int64 that `decode` keeps from one stretch to the next:
LAST = 0  # counter of the last frame, -1: there was none
JOINED = 1  # 1: a delimiter was seen, so that what follows is a frame from its beginning
DAMAGED = 2  # how many frames were not whole
FOREIGN = 3  # how many were whole, but of so many numbers:
NUMBERS = 4
RESTARTS = 5  # how often the counter went back
LOST = 6  # samples missing by the counter


def _crc_table():
    """Of CRC-32 as zlib and Ethernet have it: reflected, polynomial 0xEDB88320."""
    table = np.arange(256, dtype=np.int64)
    for _ in range(8):
        table = (table >> 1) ^ np.where(table & 1, 0xEDB88320, 0)
    return table


_TABLE = _crc_table()


@inner
def _crc(data, size):
    crc = 0xFFFFFFFF
    for k in range(size):
        crc = _TABLE[(crc ^ data[k]) & 0xFF] ^ (crc >> 8)
    return crc ^ 0xFFFFFFFF


@inner
def _number(data, at, count):
    """Little endian."""
    value = 0
    for k in range(count):
        value |= np.int64(data[at + k]) << (8 * k)
    return value


@inner
def _unstuff(data, at, stop, out):
    """The bytes that data[at:stop], in which no byte is 0, stands for; how many, or -1 where it stands for none."""
    size = 0
    while at < stop:
        code = np.int64(data[at])
        if at + code > stop or size + code > len(out):
            return -1
        for k in range(1, code):
            out[size] = data[at + k]
            size += 1
        at += code
        if code < 255 and at < stop:
            out[size] = 0
            size += 1
    return size


@inner
def _width(code):
    """Bytes of a number."""
    return (1, 1, 2, 2, 4, 4, 4, 8)[code]


@inner
def _value(frame, at, code, word, double, single):
    """One of the eight types of numbers; `double` and `single` look at the bits of `word`."""
    bits = _number(frame, at, _width(code))
    if code < 6:
        limit = np.int64(1) << (8 * _width(code) - 1)
        return np.float64(bits - 2 * limit if code % 2 == 1 and bits >= limit else bits)
    word[0] = bits
    return double[0] if code == 7 else np.float64(single[0])


@inner
def _whole(frame, size):
    """Whether it is a frame from end to end: version, type, length and check."""
    if size < _HEAD + _CHECK or frame[0] != _VERSION or frame[1] > 7:
        return False
    if size != _HEAD + _number(frame, 2, 2) * _width(np.int64(frame[1])) + _CHECK:
        return False
    return _crc(frame, size - _CHECK) == _number(frame, size - _CHECK, 4)


@inner
def _count(counter, state):
    """Samples missing before this one. A counter that stands still counts nothing; one that went back begins anew."""
    ahead = (counter - state[LAST]) % _WRAP
    known, state[LAST] = state[LAST] >= 0, counter
    if not known or ahead <= 1:
        return 0
    if ahead >= _WRAP // 2:
        state[RESTARTS] += 1
        return 0
    state[LOST] += ahead - 1
    return ahead - 1


@released("data uint8 n, scratch out uint8 s, values out k m, lost out int64 k, state out int64 7")
def decode(data, scratch, values, lost, state):
    """Numbers of whole frames into values (n, numbers), and what is missing before each into lost (n,).

    Args:
        data: (bytes,) uint8.
        scratch: (longest frame,) uint8, to work in.
        values: float64; as many frames are read as it has rows.
        lost: int64.
        state: (STATE,) int64, see above.

    Returns:
        how many frames, and how many bytes of `data` are done with: what is left is no whole frame yet, unless
        `values` is full.
    """
    word = np.zeros(1, np.int64)
    double, single = word.view(np.float64), word.view(np.float32)  # little endian: the lower half
    found, at = 0, 0
    while found < len(values):
        stop = at
        while stop < len(data) and data[stop] != 0:
            stop += 1
        if stop == len(data):
            break
        if stop > at:
            size = _unstuff(data, at, stop, scratch)
            if not _whole(scratch, size):
                state[DAMAGED] += state[JOINED]
            elif _number(scratch, 2, 2) != values.shape[1]:
                state[FOREIGN] += 1
                state[NUMBERS] = _number(scratch, 2, 2)
            else:
                for k in range(values.shape[1]):
                    at = _HEAD + k * _width(np.int64(scratch[1]))
                    values[found, k] = _value(scratch, at, np.int64(scratch[1]), word, double, single)
                lost[found] = _count(_number(scratch, 4, 4), state)
                found += 1
        state[JOINED] = 1
        at = stop + 1
    return found, at


@released("frames out uint8 n m, out out uint8 k, ends out int64 n")
def encode(frames, out, ends):
    """Frames (n, bytes), each with room for its check at the end, stuffed into `out`; `ends` (n,) says where each ends.

    Returns:
        how many bytes were written.
    """
    size = 0
    for k in range(len(frames)):
        frame, length = frames[k], frames.shape[1]
        check = _crc(frame, length - _CHECK)
        for i in range(_CHECK):
            frame[length - _CHECK + i] = (check >> (8 * i)) & 0xFF
        code, size = size, size + 1
        for i in range(length):
            if frame[i] != 0:
                out[size] = frame[i]
                size += 1
            full = size - code == 255
            if frame[i] == 0 or (full and i + 1 < length):
                out[code] = size - code
                code, size = size, size + 1
        out[code] = size - code
        out[size] = 0
        size += 1
        ends[k] = size
    return size
