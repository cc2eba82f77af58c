"""Compiled: functions of a point as the equation of a surface."""

# pyright: basic
from __future__ import annotations

import functools
from typing import Any, cast

import numpy as np

from palpate.errors import not_loaded


def compiled(value, gradient, hessian) -> Any:
    """Compile three functions into one function (point (3,), out (10,)), as `_equation.evaluate` reads it."""
    try:
        from numba import cfunc, njit, types
    except ImportError as problem:
        raise not_loaded(problem, "surfaces written as an equation need numba", "compile") from problem

    value, gradient, hessian = (
        cast(Any, njit(error_model="numpy")(function)) for function in (value, gradient, hessian)
    )

    @cfunc(types.void(types.float64[::1], types.float64[::1]), error_model="numpy")
    def write(p, out):
        slope, bend = gradient(p), hessian(p)
        out[0] = value(p)
        out[1], out[2], out[3] = slope[0], slope[1], slope[2]
        out[4], out[5], out[6] = bend[0, 0], bend[1, 1], bend[2, 2]
        out[7], out[8], out[9] = bend[0, 1], bend[0, 2], bend[1, 2]

    return write


@functools.lru_cache(maxsize=64)
def superquadric(a, b, c, e1, e2) -> tuple[Any, Any, Any]:
    """Return value, gradient and Hessian of a superquadric as functions of a point (3,).

    With u = |x/a|^(2/e2) + |y/b|^(2/e2), v = |z/c|^(2/e1): f = u^(e2/e1) + v - 1.
    """
    k, m, q = 2.0 / e2, 2.0 / e1, e2 / e1

    def value(p):
        u = abs(p[0] / a) ** k + abs(p[1] / b) ** k
        return u**q + abs(p[2] / c) ** m - 1.0

    def gradient(p):
        x, y, z = abs(p[0] / a), abs(p[1] / b), abs(p[2] / c)
        u = x**k + y**k
        outer = q * u ** (q - 1.0) if u > 0.0 else 0.0
        return np.array(
            [
                outer * k * x ** (k - 1.0) * np.sign(p[0]) / a,
                outer * k * y ** (k - 1.0) * np.sign(p[1]) / b,
                m * z ** (m - 1.0) * np.sign(p[2]) / c,
            ]
        )

    def hessian(p):
        x, y, z = abs(p[0] / a), abs(p[1] / b), abs(p[2] / c)
        u = x**k + y**k
        out = np.zeros((3, 3))
        if u > 0.0:
            ux, uy = k * x ** (k - 1.0) * np.sign(p[0]) / a, k * y ** (k - 1.0) * np.sign(p[1]) / b
            first, second = q * u ** (q - 1.0), q * (q - 1.0) * u ** (q - 2.0)
            out[0, 0] = second * ux * ux + first * k * (k - 1.0) * x ** (k - 2.0) / a**2
            out[1, 1] = second * uy * uy + first * k * (k - 1.0) * y ** (k - 2.0) / b**2
            out[0, 1] = second * ux * uy
            out[1, 0] = out[0, 1]
        out[2, 2] = m * (m - 1.0) * z ** (m - 2.0) / c**2
        return out

    return value, gradient, hessian
