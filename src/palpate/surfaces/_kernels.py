"""Compiled: what the loops of `contact` ask of a surface, whichever it is.

A surface is two arguments of every kernel: `nodes` and `corners` of a mesh's tree (`_bvh`), or `equation` and `table`
(`_equation`). Which one it is their types say when a loop is compiled, so neither pays for the other.
"""

# pyright: basic
from __future__ import annotations

import numpy as np
from numba import types

from palpate.surfaces import _bvh, _equation, _nearest
from palpate.surfaces._bvh import CANDIDATE, CAPACITY
from palpate.surfaces._jit import chosen_for, inner

__all__ = ["CANDIDATE", "CAPACITY", "is_mesh", "nearest_to_axis", "search", "shape_operator"]


def is_mesh(one):
    """Nodes are the only array of three axes; of types when compiling, of values in Python."""
    return getattr(one, "ndim", 0) == 3 and not isinstance(one, types.FunctionType)


def search(wrench, soft, tan_limit, one, two, found):
    """Every contact of a wrench, as `_bvh.search` says; callable from Python too."""
    kernel = _bvh.search if is_mesh(one) else _equation.contacts
    return kernel(wrench, soft, tan_limit, one, two, found)


@chosen_for(search)
def _search(wrench, soft, tan_limit, one, two, found):
    if is_mesh(one):
        return lambda wrench, soft, tan_limit, one, two, found: _bvh.search(wrench, soft, tan_limit, one, two, found)
    return lambda wrench, soft, tan_limit, one, two, found: _equation.contacts(wrench, soft, tan_limit, one, two, found)


def nearest_to_axis(wrench, one, two, found):
    """The point nearest to the wrench axis, as `_nearest.nearest_to_axis` says."""
    raise NotImplementedError("compiled code only")


@chosen_for(nearest_to_axis)
def _nearest_to_axis(wrench, one, two, found):
    if is_mesh(one):
        return lambda wrench, one, two, found: _nearest.nearest_to_axis(wrench, one, two, found)
    return lambda wrench, one, two, found: _equation.nearest_to_line(wrench, one, two, found)


def shape_operator(candidate, t, scale, one, two, out):
    """Of the surface at a candidate, in the tangents t (2, 3): dn = S dp, into out (2, 2) [1/m]; 0 on flat facets."""
    raise NotImplementedError("compiled code only")


@chosen_for(shape_operator)
def _shape_operator(candidate, t, scale, one, two, out):
    return _of_patch if is_mesh(one) else _of_equation


def _of_equation(candidate, t, scale, one, two, out):
    _equation.curvature(one, two, candidate[8:11], t, out)


def _of_patch(candidate, t, scale, one, two, out):
    out[:] = 0.0
    if candidate[6] == 1.0:
        _interpolated(two[int(candidate[0])], candidate[1:4], candidate[11:14], t, scale, out)


@inner
def _interpolated(row, b, n, t, scale, out):
    """Of a patch with interpolated normals."""
    a, d = np.empty((2, 2)), np.empty((2, 2))  # tangential parts of the edges and of the change of the normal
    length = 0.0
    for k in range(3):
        length += (b[0] * row[3 + k] + b[1] * row[9 + k] + b[2] * row[15 + k]) * n[k]
    for i in range(2):
        for j in range(2):
            o = 6 * (j + 1)
            a[i, j] = d[i, j] = 0.0
            for k in range(3):
                a[i, j] += t[i, k] * (row[o + k] - row[k]) * scale
                d[i, j] += t[i, k] * (row[o + 3 + k] - row[3 + k]) / length
    det = a[0, 0] * a[1, 1] - a[0, 1] * a[1, 0]
    if det == 0.0:
        return
    out[0, 0] = (d[0, 0] * a[1, 1] - d[0, 1] * a[1, 0]) / det
    out[0, 1] = (d[0, 1] * a[0, 0] - d[0, 0] * a[0, 1]) / det
    out[1, 0] = (d[1, 0] * a[1, 1] - d[1, 1] * a[1, 0]) / det
    out[1, 1] = (d[1, 1] * a[0, 0] - d[1, 0] * a[0, 1]) / det
