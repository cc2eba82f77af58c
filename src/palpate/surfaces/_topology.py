"""Compiled: connectivity of a mesh: equal rows, close points, edges, bodies, shared normals, rings of corners.

Every loop is linear in the number of facets. Half-edge 3 f + i runs from corner i to corner i + 1 of facet f, and
corners have the same numbers.
"""

# pyright: basic
from __future__ import annotations

import numpy as np

from palpate.surfaces._jit import inner, released

_MIX = 0x1E3779B97F4A7C15  # an odd constant of 61 bits
_CELL = 16.0  # size of a cell of points, in radii


@inner
def _mixed(a, b, c):
    """Return a hash of three whole numbers."""
    mixed = a * _MIX
    mixed = ((mixed ^ (mixed >> 29)) + b) * _MIX
    mixed = ((mixed ^ (mixed >> 29)) + c) * _MIX
    return mixed ^ (mixed >> 32)


@inner
def _slots(count):
    """Return a power of two of at least twice the count."""
    slots = 2
    while slots < 2 * count:
        slots *= 2
    return slots


@released("rows int64 n 3, number out int64 n, first out int64 n")
def number_rows(rows, number, first):
    """Write the number of each different row (n, 3) of whole numbers, in order of appearance, into number (n,).

    Write the place of the first of each into first (n,); return the number of different rows.
    """
    mask = _slots(len(rows)) - 1
    table = np.full(mask + 1, -1, dtype=np.int32)
    count = 0
    for i in range(len(rows)):
        slot = _mixed(rows[i, 0], rows[i, 1], rows[i, 2]) & mask
        while table[slot] >= 0:
            other = first[table[slot]]
            if rows[other, 0] == rows[i, 0] and rows[other, 1] == rows[i, 1] and rows[other, 2] == rows[i, 2]:
                break
            slot = (slot + 1) & mask
        if table[slot] < 0:
            table[slot] = count
            first[count] = i
            count += 1
        number[i] = table[slot]
    return count


@inner
def _root(parent, at):
    while parent[at] != at:
        parent[at] = parent[parent[at]]
        at = parent[at]
    return at


@inner
def _join(parent, one, two):
    """Join two groups; the lowest number of a group is its root."""
    one, two = _root(parent, one), _root(parent, two)
    parent[max(one, two)] = min(one, two)


@inner
def _name_groups(parent):
    """Write the number of each group, in the order of their roots, in place; return how many groups there are."""
    count = 0
    for at in range(len(parent)):
        if parent[at] == at:
            parent[at] = count
            count += 1
        else:
            parent[at] = parent[parent[at]]  # named already: it is lower
    return count


@released("points n 3, radius float, groups out int64 n")
def join_near(points, radius, groups):
    """Join points (n, 3) at distances of at most `radius` into groups; return the number of groups.

    Write the group of each into groups (n,), in the order of their first points.
    """
    low, size = np.full(3, np.inf), _CELL * radius
    for i in range(len(points)):
        groups[i] = i
        for k in range(3):
            low[k] = min(low[k], points[i, k])
    mask = _slots(len(points)) - 1
    table, following = np.full(mask + 1, -1, dtype=np.int32), np.empty(len(points), dtype=np.int32)
    cell, least, most = np.empty(3, dtype=np.int64), np.empty(3, dtype=np.int64), np.empty(3, dtype=np.int64)
    for i in range(len(points)):
        for k in range(3):
            at = (points[i, k] - low[k]) / size
            cell[k] = int(at)
            least[k], most[k] = int(at - 1.01 / _CELL + 1.0) - 1, int(at + 1.01 / _CELL)
        for x in range(least[0], most[0] + 1):
            for y in range(least[1], most[1] + 1):
                for z in range(least[2], most[2] + 1):
                    other = table[_mixed(x, y, z) & mask]
                    while other >= 0:
                        square = 0.0
                        for k in range(3):
                            square += (points[i, k] - points[other, k]) ** 2
                        if square <= radius * radius:
                            _join(groups, i, other)
                        other = following[other]
        slot = _mixed(cell[0], cell[1], cell[2]) & mask
        following[i] = table[slot]
        table[slot] = i
    return _name_groups(groups)


@inner
def _ends(faces, half):
    """Return the lower and the higher vertex of a half-edge."""
    a, b = faces[half // 3, half % 3], faces[half // 3, (half + 1) % 3]
    return min(a, b), max(a, b)


@released("faces int64 f 3, count int, order out int64 3f, twins out int64 3f")
def pair_edges(faces, count, order, twins):
    """Sort half-edges by the edge that they run along, into order (3 f,), and pair them, into twins (3 f,).

    Args:
        faces: (f, 3) vertex numbers below `count`.
        count: of vertices.
        order: by the lower, then by the higher vertex, then in the given order.
        twins: the half-edge that runs the other way; -1 where that is none or several, or where several run this way.
    """
    half_edges = 3 * len(faces)
    begin = np.zeros(count + 1, dtype=np.int64)
    for half in range(half_edges):
        begin[_ends(faces, half)[1] + 1] += 1
    for vertex in range(count):
        begin[vertex + 1] += begin[vertex]
    for half in range(half_edges):
        high = _ends(faces, half)[1]
        twins[begin[high]] = half  # for the time being: by the higher vertex
        begin[high] += 1
    begin[:] = 0
    for half in range(half_edges):
        begin[_ends(faces, half)[0] + 1] += 1
    for vertex in range(count):
        begin[vertex + 1] += begin[vertex]
    for i in range(half_edges):
        low = _ends(faces, twins[i])[0]
        order[begin[low]] = twins[i]
        begin[low] += 1
    twins[:] = -1
    i = 0
    while i < half_edges:
        low, high = _ends(faces, order[i])
        up = down = -1
        ups = downs = 0
        while i < half_edges and _ends(faces, order[i]) == (low, high):
            half = order[i]
            if faces[half // 3, half % 3] == low:
                ups, up = ups + 1, half
            if faces[half // 3, half % 3] == high:
                downs, down = downs + 1, half
            i += 1
        if ups == 1 and downs == 1:
            twins[up], twins[down] = down, up


@released("faces int64 f 3, order int64 3f, flipped out bool f, body out int64 f")
def walk_facets(faces, order, flipped, body):
    """Walk over edges with exactly two facets: find the facets to flip so that all agree, and the connected bodies.

    The walk goes in breadth from the first facet of each body; where no choice is right (a Moebius strip), it decides.

    Args:
        faces: (f, 3).
        order: of `pair_edges`.
        flipped: (f,) bool to write into, all False.
        body: (f,) to write into: bodies are numbered in the order of their first facets.

    Returns:
        the number of bodies.
    """
    across = np.full(len(order), -1, dtype=np.int64)
    i = 0
    while i < len(order):
        begin, edge = i, _ends(faces, order[i])
        while i < len(order) and _ends(faces, order[i]) == edge:
            i += 1
        if i == begin + 2:
            across[order[begin]], across[order[begin + 1]] = order[begin + 1], order[begin]
    body[:] = -1
    queue, count = np.empty(len(faces), dtype=np.int64), 0
    beside, against = np.empty(3, dtype=np.int64), np.empty(3, dtype=np.bool_)
    for first in range(len(faces)):
        if body[first] >= 0:
            continue
        queue[0], body[first] = first, count
        done, found = 0, 1
        while done < found:
            facet = queue[done]
            done += 1
            for i in range(3):
                other = across[3 * facet + i]
                beside[i] = -1 if other < 0 else other // 3
                against[i] = other >= 0 and faces[facet, i] == faces[other // 3, other % 3]
            for i in range(3):  # facets that share two edges
                for j in range(3):
                    if beside[i] >= 0 and beside[i] == beside[j]:
                        against[i] = against[i] or against[j]
            for later in (True, False):  # those that come later in the list first; each half by number
                for _ in range(3):
                    best = -1
                    for i in range(3):
                        other = beside[i]
                        open_one = other >= 0 and body[other] < 0 and (other > facet) == later
                        if open_one and (best < 0 or other < beside[best]):
                            best = i
                    if best >= 0:
                        other = beside[best]
                        body[other] = count
                        flipped[other] = flipped[facet] != against[best]
                        queue[found] = other
                        found += 1
        count += 1
    return count


@inner
def _next(half):
    """Return the corner at which a half-edge ends."""
    return half - half % 3 + (half + 1) % 3


@released("normals f 3, twins int64 3f, least float, groups out int64 3f")
def group_corners(normals, twins, least, groups):
    """Join the corners at both ends of edges over which unit normals (f, 3) have a cosine of at least `least`.

    Write the group of each into groups (3 f,), in the order of their first corners; return the number of groups.
    """
    for half in range(len(twins)):
        groups[half] = half
    for half in range(len(twins)):
        other = twins[half]
        if other > half:
            a, b = normals[half // 3], normals[other // 3]
            if a[0] * b[0] + a[2] * b[2] + a[1] * b[1] >= least:
                _join(groups, half, _next(other))
                _join(groups, _next(half), other)
    return _name_groups(groups)


@released("groups int64 n, values n k, sums out g k")
def add_by_group(groups, values, sums):
    """Add values (n, k), in order, to the rows of `sums` (g, k) that groups (n,) names."""
    for i in range(len(groups)):
        for k in range(values.shape[1]):
            sums[groups[i], k] += values[i, k]


@released("normals n 3, twins int64 n, same float, changes out int64 n")
def compare_normals(normals, twins, same, changes):
    """Classify the change of the normal from each corner to the one across its half-edge, into changes (3 f,).

    Args:
        normals: (3 f, 3) at the corners.
        twins: (3 f,) of `pair_edges`.
        same: 1 - cos of normals that count as one.
        changes: 0: none, or there is no facet across; 1: less than `same`; 2: more.
    """
    for corner in range(len(twins)):
        changes[corner] = 0
        if twins[corner] >= 0:
            a, b = normals[corner], normals[_next(twins[corner])]
            if a[0] != b[0] or a[1] != b[1] or a[2] != b[2]:
                changes[corner] = 1
            if a[0] * b[0] + a[2] * b[2] + a[1] * b[1] < 1.0 - same:
                changes[corner] = 2


@released("twins int64 n, changes int64 n, members out int64 n, sizes out int64 n")
def walk_rings(twins, changes, members, sizes):
    """Walk around vertices: one corner for each normal that differs from the one before, ring after ring.

    Args:
        twins: (3 f,) of `pair_edges`.
        changes: (3 f,) of `compare_normals`.
        members: (3 f,) to write corners into.
        sizes: (3 f,) to write the length of each ring into.

    Returns:
        the number of rings.
    """
    seen, count, rings = np.zeros(len(twins), dtype=np.bool_), 0, 0
    for start in range(len(twins)):
        if changes[start] < 2 or seen[start]:
            continue
        begin, at = count, start
        while at >= 0 and not seen[at]:
            seen[at] = True
            onward = -1 if twins[at] < 0 else _next(twins[at])
            if changes[at] == 2:
                members[count] = onward
                count += 1
            at = onward
        sizes[rings] = count - begin
        rings += 1
    return rings
