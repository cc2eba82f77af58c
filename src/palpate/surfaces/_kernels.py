"""Compiled: queries on a surface of any kind, for the loops of `contact`.

A surface is two arguments of every kernel: `nodes` and `corners` of a mesh's tree (`_bvh`), or `equation` and `table`
(`_equation`). Their types decide which one it is when a loop is compiled, so neither pays for the other.
"""

# pyright: basic
from __future__ import annotations

from palpate.surfaces import _bvh, _equation, _nearest
from palpate.surfaces._jit import chosen_for, inner


def is_mesh(one):
    """Return whether an argument, or when compiling its type, is a mesh's nodes: the only array of three axes."""
    return getattr(one, "ndim", 0) == 3


def search(wrench, soft, tan_limit, one, two, found):
    """Find every contact of a wrench, like `_bvh.search_in`; from Python."""
    kernel = _bvh.search if is_mesh(one) else _equation.contacts
    return kernel(wrench, soft, tan_limit, one, two, found)


def search_in(wrench, soft, tan_limit, one, two, found, room):
    """Find every contact of a wrench, like `_bvh.search_in`."""
    raise NotImplementedError("compiled code only")


@chosen_for(search_in)
def _search_in(wrench, soft, tan_limit, one, two, found, room):
    return _in_tree if is_mesh(one) else _on_equation


def _in_tree(wrench, soft, tan_limit, one, two, found, room):
    return _bvh.search_in(wrench, soft, tan_limit, one, two, found, room)


def _on_equation(wrench, soft, tan_limit, one, two, found, room):
    return _equation.contacts(wrench, soft, tan_limit, one, two, found)


def nearest_to_axis(wrench, one, two, found):
    """Find the point nearest to the wrench axis, like `_nearest.nearest_to_axis`."""
    raise NotImplementedError("compiled code only")


@chosen_for(nearest_to_axis)
def _nearest_to_axis(wrench, one, two, found):
    if is_mesh(one):
        return lambda wrench, one, two, found: _nearest.nearest_to_axis(wrench, one, two, found)
    return lambda wrench, one, two, found: _equation.nearest_to_line(wrench, one, two, found)


def shape_operator(candidate, t, scale, one, two, out):
    """Compute a candidate's shape operator in tangents t (2, 3), dn = S dp, into out (2, 2) [1/m]; 0 on flat facets."""
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
    """Compute the shape operator of a patch with interpolated normals."""
    length = 0.0
    for k in range(3):
        length += (b[0] * row[3 + k] + b[1] * row[9 + k] + b[2] * row[15 + k]) * n[k]
    # tangential parts of the two edges, and of the change of the normal along them
    a00, d00 = _change(row, 6, t, 0, scale, length)
    a01, d01 = _change(row, 12, t, 0, scale, length)
    a10, d10 = _change(row, 6, t, 1, scale, length)
    a11, d11 = _change(row, 12, t, 1, scale, length)
    det = a00 * a11 - a01 * a10
    if det == 0.0:
        return
    out[0, 0] = (d00 * a11 - d01 * a10) / det
    out[0, 1] = (d01 * a00 - d00 * a01) / det
    out[1, 0] = (d10 * a11 - d11 * a10) / det
    out[1, 1] = (d11 * a00 - d10 * a01) / det


@inner
def _change(row, corner, t, i, scale, length):
    """Return the changes of position and normal from the first corner of a patch to another, along tangent i."""
    place = normal = 0.0
    for k in range(3):
        place += t[i, k] * (row[corner + k] - row[k]) * scale
        normal += t[i, k] * (row[corner + 3 + k] - row[3 + k]) / length
    return place, normal
