"""How loops are compiled here, once for all kernels."""

# pyright: basic
from __future__ import annotations

import functools

from numba import njit

__all__ = ["compiled", "inlined"]

# Division by zero gives inf as in NumPy, and a * b + c may be one instruction; NaN and inf keep their meaning. Machine
# code is kept on disk, so that only the first process ever waits for the compiler.
compiled = functools.partial(njit, cache=True, error_model="numpy", fastmath={"contract"})
inlined = functools.partial(compiled, inline="always")
