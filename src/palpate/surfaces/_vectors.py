"""Compiled: products of three-vectors, without a call into BLAS."""

# pyright: basic
from __future__ import annotations

from palpate.surfaces._jit import inner

__all__ = ["cross_into", "dot"]


@inner
def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inner
def cross_into(a, b, out):
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]
