"""How loops are compiled here, once for all kernels."""

# pyright: basic
from __future__ import annotations

import hashlib
from pathlib import Path

from numba import njit

__all__ = ["STAMP", "compiled", "inlined"]


def _stamp() -> str:
    """A digest of every private module of the package, the kernels among them."""
    files = sorted(Path(__file__).parents[1].glob("*/_*.py"))
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()


STAMP = _stamp()


def compiled(**options):
    """The decorator of every compiled function.

    Division by zero gives inf as in NumPy, and a * b + c may be one instruction; NaN and inf keep their meaning.
    Machine code is kept on disk, so that only the first process ever waits for the compiler. numba forgets it when the
    function's own file changes but not when a file that it calls into does, so the stamp of all kernels takes the place
    of the file's.
    """

    def decorate(function):
        dispatcher = njit(cache=True, error_model="numpy", fastmath={"contract"}, **options)(function)
        dispatcher._cache._cache_file._source_stamp = STAMP
        return dispatcher

    return decorate


def inlined():
    """For the few functions that must not become a call."""
    return compiled(inline="always")
