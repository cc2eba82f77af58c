"""Which fault is on: a number in memory that Python and compiled code read alike, and that a forked process sets.

It lies at an address that is the same in every process, so that machine code kept on disk stays right.
"""

from __future__ import annotations

import ctypes
import mmap

from llvmlite import ir
from numba import types
from numba.extending import intrinsic, overload

__all__ = ["switch", "turn_on"]

ADDRESS = 0x5A5A_0000_0000
_FIXED = 0x100000  # MAP_FIXED_NOREPLACE


def _mapped() -> ctypes.c_int64:
    libc = ctypes.CDLL(None, use_errno=True)
    libc.mmap.restype = ctypes.c_void_p
    libc.mmap.argtypes = [ctypes.c_void_p, ctypes.c_size_t, *[ctypes.c_int] * 3, ctypes.c_long]
    flags = mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS | _FIXED
    found = libc.mmap(ADDRESS, mmap.PAGESIZE, mmap.PROT_READ | mmap.PROT_WRITE, flags, -1, 0)
    if found != ADDRESS:
        raise OSError(ctypes.get_errno(), "the switch's address is taken")
    return ctypes.c_int64.from_address(ADDRESS)


_CELL = _mapped()


def switch() -> int:
    """The number of the fault that is on; 0: none."""
    return _CELL.value


def turn_on(number: int) -> None:
    """In this process."""
    _CELL.value = number


@intrinsic
def _read(typingctx):
    def loaded(context, builder, signature, arguments):
        pointer = builder.inttoptr(ir.Constant(ir.IntType(64), ADDRESS), ir.IntType(64).as_pointer())
        return builder.load(pointer)

    return types.int64(), loaded


@overload(switch)
def _switch():
    return lambda: _read()
