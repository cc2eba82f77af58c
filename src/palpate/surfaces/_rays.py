"""Compiled: intersect rays with facets in a tree, and find the facets from which there is a way out.

Lengths are in the tree's unit size: half the diagonal of the body is 1.
"""

# pyright: basic
from __future__ import annotations

from math import cos, pi, radians, sin

import numpy as np

from palpate.surfaces._bvh import STACK, WIDTH, push_children
from palpate.surfaces._jit import inlined, inner, released
from palpate.surfaces._vectors import tangents

FREE, BODY, SWEPT, PASSAGE = 0, 1, 2, 3  # what is in a cell of the grid

_LIFT = 1e-5  # where a ray starts, off its facet: beyond the rounding of float32 files
_SPACING, _MOST = 0.02, 8  # of samples on a facet (1 % of the body), and how many at most along its longest side
_LINES, _THROUGH = 16, 4  # over a sample in a passage, and how many of them lead out at both ends
_STEEP, _FLAT = sin(radians(10)), cos(radians(10))  # of their ends, along the normal and across
_LARGEST = 10.0  # cells: radius of a ball in a passage at most, for which the grid has room
_ABOVE = 1.75  # cells, longer than a cell's diagonal: out of those of a facet's own plane
_SEAM = 1e-9  # by which facets overlap for a ray, so that none slips through an edge


@inlined
def _boxes(node, ox, oy, oz, ix, iy, iz):
    """Return which children's boxes a ray meets, one bit each, by slabs."""
    mask, zero = np.int32(0), np.float32(0.0)
    for i in range(WIDTH):
        ax, bx = (node[0, i] - node[3, i] - ox) * ix, (node[0, i] + node[3, i] - ox) * ix
        ay, by = (node[1, i] - node[4, i] - oy) * iy, (node[1, i] + node[4, i] - oy) * iy
        az, bz = (node[2, i] - node[5, i] - oz) * iz, (node[2, i] + node[5, i] - oz) * iz
        near = max(max(min(ax, bx), min(ay, by)), min(az, bz))
        far = min(min(max(ax, bx), max(ay, by)), max(az, bz))
        mask |= np.int32(1 if (near <= far) & (far >= zero) else 0) << np.int32(i)
    return mask


@inner
def _met(row, ox, oy, oz, dx, dy, dz):
    """Return the distance along a ray to a facet, or inf [moller]."""
    ux, uy, uz = row[6] - row[0], row[7] - row[1], row[8] - row[2]
    vx, vy, vz = row[12] - row[0], row[13] - row[1], row[14] - row[2]
    px, py, pz = dy * vz - dz * vy, dz * vx - dx * vz, dx * vy - dy * vx
    det = ux * px + uy * py + uz * pz
    if det == 0.0:
        return np.inf
    tx, ty, tz = ox - row[0], oy - row[1], oz - row[2]
    u = (tx * px + ty * py + tz * pz) / det
    if u < -_SEAM or u > 1.0 + _SEAM:
        return np.inf
    qx, qy, qz = ty * uz - tz * uy, tz * ux - tx * uz, tx * uy - ty * ux
    v = (dx * qx + dy * qy + dz * qz) / det
    if v < -_SEAM or u + v > 1.0 + _SEAM:
        return np.inf
    far = (vx * qx + vy * qy + vz * qz) / det
    return far if far > 0.0 else np.inf


@inner
def _inverse(x):
    """Return 1/x of a ray's direction; a huge number where x is 0, so that 0 times it is not NaN."""
    return np.float32(1.0 / (x if abs(x) > 1e-9 else 1e-9))


@inner
def _first_hit(nodes, corners, o, d, pending):
    """Return the distance t along the ray o + t d to the first facet; inf where it leaves the body."""
    ox, oy, oz, dx, dy, dz = o[0], o[1], o[2], d[0], d[1], d[2]
    fx, fy, fz = np.float32(ox), np.float32(oy), np.float32(oz)
    ix, iy, iz = _inverse(dx), _inverse(dy), _inverse(dz)
    pending[0, 0], pending[0, 1] = 0, 0
    depth, best = 1, np.inf
    while depth > 0:
        depth -= 1
        first, size = pending[depth, 0], pending[depth, 1]
        if size == 0:
            mask = _boxes(nodes[first], fx, fy, fz, ix, iy, iz)
            depth = push_children(mask, nodes[first], pending, depth)
            continue
        for facet in range(first, first + size):
            best = min(best, _met(corners[facet], ox, oy, oz, dx, dy, dz))
    return best


@released("origins n 3, directions n 3, nodes float32 k 14 8, corners p 20, out out n")
def first_hits(origins, directions, nodes, corners, out):
    """Compute the distance along each ray (n, 3), (n, 3) to the first facet, into out (n,); inf where there is none."""
    pending = np.empty((STACK, 2), dtype=np.int64)
    for i in range(len(origins)):
        out[i] = _first_hit(nodes, corners, origins[i], directions[i], pending)


@inner
def _sides(row, least):
    """Return the number of parts into which each side of a facet is cut for samples at most `least` apart."""
    longest = 0.0
    for i in range(3):
        j, square = (i + 1) % 3, 0.0
        for k in range(3):
            square += (row[6 * i + k] - row[6 * j + k]) ** 2
        longest = max(longest, square)
    return int(np.sqrt(longest) / least) + 1


@inner
def _sample(row, parts, at, out):
    """Write the middle of small triangle number `at`, of the parts^2 into which a facet is cut, into out (3,)."""
    i = int(np.sqrt(at))  # strip from corner 0, of 2 i + 1 triangles
    j = at - i * i
    along, across = (j // 2 + (1.0 + j % 2) / 3.0) / parts, (i + (2.0 - j % 2) / 3.0) / parts
    for k in range(3):
        out[k] = row[k] + across * (row[6 + k] - row[k]) + along * (row[12 + k] - row[6 + k])


@released("corners n 20, low 3, step float, grid out int8 a b c")
def mark_facets(corners, low, step, grid):
    """Set the cells of `grid` (a, b, c), of size `step` from `low` (3,) on, that a facet passes through."""
    point = np.empty(3)
    for facet in range(len(corners)):
        parts = _sides(corners[facet], step)
        for at in range(parts * parts):
            _sample(corners[facet], parts, at, point)
            cell = ((point - low) / step).astype(np.int64)
            grid[cell[0], cell[1], cell[2]] = BODY


@inner
def _cell(o, d, far, low, step, cells):
    """Return what is in the grid's cell at o + far d."""
    x = int((o[0] + far * d[0] - low[0]) / step)
    y = int((o[1] + far * d[1] - low[1]) / step)
    z = int((o[2] + far * d[2] - low[2]) / step)
    return cells[x, y, z]


@inner
def _passes(o, n, far, low, step, cells):
    """Return whether the line from o along n enters a cell that a ball fills before `far`, the next facet."""
    if cells.size == 0:
        return False
    for at in range(1, int(far / step)):
        met = _cell(o, n, at * step, low, step, cells)
        if met >= SWEPT:
            return True
    return False


@inner
def _leads_out(o, d, low, step, cells):
    """Return whether a line from o along d enters a swept cell before one of the body."""
    at, met = 0, FREE
    while met in (FREE, PASSAGE):
        met = _cell(o, d, 0.5 * at * step, low, step, cells)
        at += 1
    return met == SWEPT


@inner
def _between(o, n, low, step, cells):
    """Return whether o, on a facet, is in a passage: `_THROUGH` of the lines over it lead out at both ends."""
    start, d, t, through = np.empty(3), np.empty(3), np.empty((2, 3)), 0
    tangents(n, t)
    for k in range(3):
        start[k] = o[k] + _ABOVE * step * n[k]
    for i in range(_LINES):
        c, s = _FLAT * np.cos(i * pi / _LINES), _FLAT * np.sin(i * pi / _LINES)
        ends = 0
        for sign in (1.0, -1.0):
            for k in range(3):
                d[k] = _STEEP * n[k] + sign * (c * t[0, k] + s * t[1, k])
            if not _leads_out(start, d, low, step, cells):
                break
            ends += 1
        through += ends // 2
        if through == _THROUGH:
            return True
        if through + _LINES - 1 - i < _THROUGH:
            return False
    return False


@inner
def _fill(o, n, far, low, step, cells):
    """Make the free cells PASSAGE that a ball between o and the next facet fills, if it meets no other."""
    middle, radius = np.empty(3), min(0.5 * far / step, _LARGEST) - _ABOVE
    for k in range(3):
        middle[k] = (o[k] + 0.5 * far * n[k] - low[k]) / step - 0.5
    for filled in (False, True):
        for x in range(int(middle[0] - radius) + 1, int(middle[0] + radius) + 1):
            for y in range(int(middle[1] - radius) + 1, int(middle[1] + radius) + 1):
                for z in range(int(middle[2] - radius) + 1, int(middle[2] + radius) + 1):
                    square = (x - middle[0]) ** 2 + (y - middle[1]) ** 2 + (z - middle[2]) ** 2
                    if square < radius * radius and cells[x, y, z] == BODY:
                        return
                    if filled and square < radius * radius and cells[x, y, z] == FREE:
                        cells[x, y, z] = PASSAGE


@released("corners n 20, nodes float32 k 14 8, low 3, step float, cells out int8 a b c, out out bool n")
def open_facets(corners, nodes, low, step, cells, out):
    """Set in out (f,) the facets that can be reached; those that are set already are not tested again.

    Two of the samples on it, or the only one, are in a passage, or the ray along the normal leaves the body there (one
    may look out through a gap); or from one that ray reaches a cell that a ball fills before a facet.

    Args:
        corners: (f, 20) as in a tree, the normals those of the facets.
        nodes: of the tree over them.
        low: (3,) where the grid begins.
        step: its cells' size.
        cells: (a, b, c) FREE, BODY, or SWEPT, that a touching ball can fill, some of which become PASSAGE; empty: only
            the rays that leave the body count, up to the first facet where none does.
        out: (f,) bool.
    """
    o, pending = np.empty(3), np.empty((STACK, 2), dtype=np.int64)
    for facet in range(len(corners)):
        if out[facet]:
            continue
        n = corners[facet, 3:6]
        parts = min(_MOST, _sides(corners[facet], _SPACING))
        ways = 0
        for at in range(parts * parts):
            _sample(corners[facet], parts, at, o)
            for k in range(3):
                o[k] += _LIFT * n[k]
            far = _first_hit(nodes, corners, o, n, pending)
            if far == np.inf:
                ways += 1
            elif _passes(o, n, far, low, step, cells):
                ways += 2
            elif cells.size > 0 and far > 2.0 * _ABOVE * step and _between(o, n, low, step, cells):
                _fill(o, n, far, low, step, cells)
                ways += 1
            if ways >= min(parts, 2):
                out[facet] = True
                break
        if cells.size == 0 and not out[facet]:
            return
