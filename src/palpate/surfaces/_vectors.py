"""Compiled: products of three-vectors, without a call into BLAS, and copies that need no check of shapes."""

# pyright: basic
from __future__ import annotations

from palpate.surfaces._jit import inner

__all__ = ["copy_into", "cross_into", "dot"]


@inner
def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inner
def cross_into(a, b, out):
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@inner
def copy_into(values, out):
    """`out[:] = values` of one length: the compiler takes seconds over the message that shapes differ."""
    for k in range(len(out)):
        out[k] = values[k]
