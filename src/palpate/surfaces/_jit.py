"""How loops are compiled here, once for all kernels."""

# pyright: basic
from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any, cast

from numba import njit
from numba.extending import overload

__all__ = ["STAMP", "chosen_for", "entry", "inlined", "inner"]


def _stamp() -> str:
    """A digest of every private module of the package, the kernels among them."""
    files = sorted(Path(__file__).parents[1].rglob("_*.py"))
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()


STAMP = _stamp()


_OPTIONS: dict[str, Any] = {"error_model": "numpy", "fastmath": {"contract"}}


def entry(function):
    """Decorates a compiled function that Python calls.

    Division by zero gives inf as in NumPy, and a * b + c may be one instruction; NaN and inf keep their meaning.
    Machine code is kept on disk, so that only the first process ever waits for the compiler. numba forgets it when the
    function's own file changes but not when a file that it calls into does, so the stamp of all kernels takes the place
    of the file's.
    """
    dispatcher = cast(Any, njit(cache=True, **_OPTIONS)(function))
    dispatcher._cache._cache_file._source_stamp = STAMP
    return dispatcher


def inner(function):
    """Decorates a function that only compiled code calls: no wrapper for Python, which halves the compiler's work."""
    return cast(Any, njit)(no_cpython_wrapper=True, no_cfunc_wrapper=True, **_OPTIONS)(function)


def inlined(function):
    """Decorates one of the few inner functions that must not become a call."""
    return njit(inline="always", **_OPTIONS)(function)


def chosen_for(function):
    """Decorates what returns the function that compiled code calls, given the types of the arguments."""
    return cast(Any, overload)(function, jit_options=_OPTIONS)
