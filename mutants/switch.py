"""Which fault is on, and which faults' places were reached: memory that Python and compiled code use alike.

It lies at an address that is the same in every process, so that machine code kept on disk stays right. A process sets
the number of its fault; the page of reached places is shared with the processes that it starts once it has a file.
"""

from __future__ import annotations

import ctypes
import mmap
import os
from pathlib import Path

__all__ = ["ADDRESS", "REACHED", "reached", "reached_into", "switch", "turn_on"]

ADDRESS = 0x5A5A_0000_0000
REACHED = ADDRESS + mmap.PAGESIZE  # a byte a fault
_FIXED, _NO_REPLACE = 0x10, 0x100000
_VARIABLE = "PALPATE_REACHED"  # names the file of reached places


def _map(address: int, flags: int, file: int = -1) -> None:
    libc = ctypes.CDLL(None, use_errno=True)
    libc.mmap.restype = ctypes.c_void_p
    libc.mmap.argtypes = [ctypes.c_void_p, ctypes.c_size_t, *[ctypes.c_int] * 3, ctypes.c_long]
    if libc.mmap(address, mmap.PAGESIZE, mmap.PROT_READ | mmap.PROT_WRITE, flags, file, 0) != address:
        raise OSError(ctypes.get_errno(), "the switch's address is taken")


for _address in (ADDRESS, REACHED):
    _map(_address, mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS | _NO_REPLACE)
_number = ctypes.c_int64.from_address(ADDRESS)
_places = (ctypes.c_uint8 * mmap.PAGESIZE).from_address(REACHED)


def switch(number: int) -> bool:
    """Whether this fault is on; its place counts as reached."""
    _places[number] = 1
    return _number.value == number


def turn_on(number: int) -> None:
    """In this process; 0: none."""
    _number.value = number


def reached_into(path: Path) -> None:
    """Share the page of reached places with the processes that this one starts."""
    path.write_bytes(bytes(mmap.PAGESIZE))
    os.environ[_VARIABLE] = str(path)
    _map_file()


def _map_file() -> None:
    file = os.open(os.environ[_VARIABLE], os.O_RDWR)
    _map(REACHED, mmap.MAP_SHARED | _FIXED, file)
    os.close(file)


def reached() -> list[int]:
    """Return the faults whose places were reached since the last call."""
    found = [number for number, place in enumerate(bytes(_places)) if place]
    ctypes.memset(REACHED, 0, mmap.PAGESIZE)
    return found


if _VARIABLE in os.environ:
    _map_file()
