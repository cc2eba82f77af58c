"""List the records of a piece of an MCAP file, up to the first incomplete one; compiled."""

# pyright: basic
from __future__ import annotations

from palpate.surfaces._jit import inlined, released

_HEAD = 9  # bytes: a kind and the length of what follows
_FOOTER, _MESSAGE, _CHUNK = 2, 5, 6
_MESSAGE_HEAD = 22  # bytes: channel (2), sequence (4), log time (8), publish time (8)


@inlined
def _whole(data, at, count):
    """Return a little-endian integer of `count` bytes; negative if it needs a 64th bit."""
    value = 0
    for k in range(count - 1, -1, -1):
        value = (value << 8) | int(data[at + k])
    return value


@released("data uint8 n, at int, messages out int64 4 m, others out int64 k 3")
def walk(data, at, messages, others):
    """Fill `messages` (4, k) with channel, log time [ns], start and length; `others` (k, 3) with kind, start, length.

    Return the number of each, and the position where it stopped: at the end, after a chunk or the footer, before a
    record that is incomplete or invalid, or where a list was full. Start and length are those of the payload.
    """
    found, rest = 0, 0
    while at + _HEAD <= len(data) and found < messages.shape[1] and rest < len(others):
        kind, length = int(data[at]), _whole(data, at + 1, 8)
        start = at + _HEAD
        if kind == 0 or length < 0 or length > len(data) - start:
            break
        if kind == _MESSAGE:
            if length < _MESSAGE_HEAD:
                break
            messages[0, found] = _whole(data, start, 2)
            messages[1, found] = _whole(data, start + 6, 8)
            messages[2, found] = start + _MESSAGE_HEAD
            messages[3, found] = length - _MESSAGE_HEAD
            found += 1
        else:
            others[rest, 0], others[rest, 1], others[rest, 2] = kind, start, length
            rest += 1
        at = start + length
        if kind in (_CHUNK, _FOOTER):
            break
    return found, rest, at
