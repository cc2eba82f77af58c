"""Compiled: build the tree over patches, and find every contact that a wrench can have on it.

In a node whose normals lie in a cone (axis n, half-angle alpha; theta between n and -f) the sideways shifts of `_patch`
lie in a disc with centre h (f x n) cos(theta)/(cos(theta)^2 - sin(alpha)^2) and radius
|h| sin(alpha) cos(alpha)/(the same). The line is moved by the centre and the box is widened by the radius, so that the
search stays logarithmic for any pitch.
"""

# pyright: basic
from __future__ import annotations

import numpy as np

from palpate.surfaces._jit import entry, inlined, inner, released
from palpate.surfaces._patch import solve_flat, solve_patch, solve_vertex
from palpate.surfaces._patches import FLAT, KIND, VERTEX
from palpate.surfaces._vectors import copy_into

CAPACITY = 16  # candidates kept a query; the ones nearest to the force stay
CANDIDATE = 14  # numbers a candidate, as `search` says
STACK = 128  # of a walk down the tree: seven a level, of which there are 8 at most
LEAF = 4
WIDTH = 8  # children of a node
_SLACK = 1e-9  # how far a box test may err, in unit size
ROUNDING = 1e-6  # of the float32 in which nodes are kept and tested


@inner
def _select(middles, k, order, low, high, middle):
    """Partly sort order[low:high], and the middles (m, 3) with it, so that `middle` splits it by their column k.

    Hoare's quickselect. The compared values are moved along, because they are then read in order.
    """
    left, right = low, high - 1
    while left < right:
        pivot = middles[(left + right) // 2, k]
        i, j = left, right
        while i <= j:
            while middles[i, k] < pivot:
                i += 1
            while middles[j, k] > pivot:
                j -= 1
            if i <= j:
                order[i], order[j] = order[j], order[i]
                for axis in range(3):
                    middles[i, axis], middles[j, axis] = middles[j, axis], middles[i, axis]
                i += 1
                j -= 1
        if middle <= j:
            right = j
        elif middle >= i:
            left = i
        else:
            return


@inner
def _fill_child(node, child, corners, order, low, high):
    """Write box and cone of the patches order[low:high] into one column of a node."""
    box_low, box_high, axis = np.full(3, np.inf), np.full(3, -np.inf), np.zeros(3)
    for at in range(low, high):
        for i in range(3):
            for k in range(3):
                x = corners[order[at], 6 * i + k]
                box_low[k] = min(box_low[k], x)
                box_high[k] = max(box_high[k], x)
                axis[k] += corners[order[at], 6 * i + 3 + k]
    length = np.sqrt(axis[0] ** 2 + axis[1] ** 2 + axis[2] ** 2)
    cosine = -1.0
    if length > 1e-9:
        axis /= length
        cosine = 1.0
        for at in range(low, high):
            for i in range(3):
                n = corners[order[at], 6 * i + 3 : 6 * i + 6]
                cosine = min(cosine, axis[0] * n[0] + axis[1] * n[1] + axis[2] * n[2])
    for k in range(3):
        node[k, child] = 0.5 * (box_low[k] + box_high[k])
        node[3 + k, child] = 0.5 * (box_high[k] - box_low[k]) + ROUNDING
        node[6 + k, child] = axis[k]
    cosine = max(-1.0, cosine - ROUNDING)
    node[9, child] = cosine
    node[12, child] = 1.0 - cosine * cosine
    node[13, child] = np.sqrt(1.0 - cosine * cosine) * max(0.0, cosine)


@inner
def _split(middles, order, ends):
    """Halve each range of order between `ends` at the median of its longest side; ends (WIDTH + 1,) grows in place."""
    parts = 1
    while parts < WIDTH:
        for part in range(parts - 1, -1, -1):
            low, high = ends[part], ends[part + 1]
            ends[2 * part + 2] = high
            ends[2 * part] = low
            ends[2 * part + 1] = high
            if high - low <= LEAF:
                continue
            widest, longest = 0, -1.0
            for k in range(3):
                least, most = np.inf, -np.inf
                for at in range(low, high):
                    least, most = min(least, middles[at, k]), max(most, middles[at, k])
                if most - least > longest:
                    widest, longest = k, most - least
            ends[2 * part + 1] = (low + high) // 2
            _select(middles, widest, order, low, high, (low + high) // 2)
        parts *= 2


@released("corners out n 20, nodes out float32 m 14 8")
def build(corners, nodes):
    """Fill `nodes`, as `Tree` describes them, and sort the patches (n, 20) likewise; return the number of nodes."""
    count = len(corners)
    order = np.arange(count)
    middles = np.empty((count, 3))
    for m in range(count):
        for k in range(3):
            middles[m, k] = corners[m, k] + corners[m, 6 + k] + corners[m, 12 + k]
    pending = np.empty((STACK, 3), dtype=np.int64)  # low, high, node
    pending[0, 0], pending[0, 1], pending[0, 2] = 0, count, 0
    ends = np.empty(WIDTH + 1, dtype=np.int64)
    depth, used = 1, 1
    while depth > 0:
        depth -= 1
        low, high, node = pending[depth, 0], pending[depth, 1], nodes[pending[depth, 2]]
        ends[0], ends[1] = low, high
        _split(middles, order, ends)
        for child in range(WIDTH):
            low, high = ends[child], ends[child + 1]
            node[:, child] = 0.0
            node[11, child] = -1.0
            if high == low:
                continue
            _fill_child(node, child, corners, order, low, high)
            if high - low <= LEAF:
                node[10, child], node[11, child] = low, high - low
                continue
            node[10, child], node[11, child] = used, 0.0
            pending[depth, 0], pending[depth, 1], pending[depth, 2] = low, high, used
            depth += 1
            used += 1
    _reorder(corners, order)
    return used


@inner
def _reorder(rows, order):
    """Move row number order[i] to i, in place; `order` is overwritten."""
    spare = np.empty(rows.shape[1])
    for start in range(len(rows)):
        if order[start] < 0:
            continue
        copy_into(rows[start], spare)
        at = start
        while order[at] != start:
            copy_into(rows[order[at]], rows[at])
            following = order[at]
            order[at], at = -1, following
        copy_into(spare, rows[at])
        order[at] = -1


@inner
def start_view(f, point, pitch, tan_limit, view):
    """Fill `view`: f 0-2, |f| 3-5, a point of the axis 6-8, pitch 9, limit 10, reach 11, wider 12, slip 13."""
    for k in range(3):
        view[k], view[3 + k], view[6 + k] = f[k], abs(f[k]), point[k]
    view[9], view[12] = pitch, 0.0
    view[13] = 2e-6 * (1.0 + view[6] * view[6] + view[7] * view[7] + view[8] * view[8])  # of float32, far from the body
    view[10] = 0.0 if tan_limit == np.inf else 1.0 / np.sqrt(1.0 + tan_limit * tan_limit)
    view[11] = 0.0 if pitch == 0.0 else abs(pitch) * tan_limit


@inlined
def test_children(node, view):
    """Return which children of a node can contain a contact, one bit each.

    view (float32) is that of `start_view`. There are no branches and nothing is stored, so that the compiler tests
    several children at once. The cone is compared with the limit, and the box with the axis: moved to the middle of
    the conic section in which the shifts -pitch (f x n)/(f . n) of a cone of normals lie, and widened by its radius, or
    by the reach |pitch| tan(theta_max) where that is less.
    """
    fx, fy, fz, gx, gy, gz = view[0], view[1], view[2], view[3], view[4], view[5]
    px, py, pz, pitch, cos_limit, reach, wider = view[6], view[7], view[8], view[9], view[10], view[11], view[12]
    slip, zero, one, tiny, rounding = view[13], np.float32(0.0), np.float32(1.0), np.float32(3e-3), np.float32(2e-6)
    mask = np.int32(0)
    for i in range(WIDTH):
        ax, ay, az = node[6, i], node[7, i], node[8, i]
        cos_a, sin_a2 = node[9, i], node[12, i]
        cos_t = -(fx * ax + fy * ay + fz * az)
        square = cos_t * cos_t
        short = cos_limit - cos_t * cos_a - rounding
        away = (cos_a > zero) & (cos_t < cos_a) & (short > zero) & (short * short > (one - square) * sin_a2 + rounding)
        gap = square - sin_a2
        fair = (cos_a > zero) & (cos_t > zero) & (gap > tiny)
        over = one / (gap if fair else one)
        factor = pitch * over
        disc = abs(factor) * node[13, i]
        moved = fair & (disc < reach)
        factor = factor * cos_t if moved else zero
        radius = disc + abs(pitch) * over * over * rounding if moved else reach  # what rounding does to the gap
        radius = radius + slip * (one + radius + abs(factor)) + wider
        dx = node[0, i] - px - factor * (fy * az - fz * ay)
        dy = node[1, i] - py - factor * (fz * ax - fx * az)
        dz = node[2, i] - pz - factor * (fx * ay - fy * ax)
        hx, hy, hz = node[3, i] + radius, node[4, i] + radius, node[5, i] + radius
        # A line and a box are apart if and only if they are along f x (an axis of the box).
        apart = (
            (abs(dy * fz - dz * fy) > hy * gz + hz * gy)
            | (abs(dz * fx - dx * fz) > hz * gx + hx * gz)
            | (abs(dx * fy - dy * fx) > hx * gy + hy * gx)
        )
        mask |= np.int32(0 if (away | apart) else 1) << np.int32(i)
    return mask


@inlined
def push_children(mask, node, pending, depth):
    """Put the children of a node that have a bit in `mask` on the stack `pending` (n, 2); return its new depth."""
    for i in range(WIDTH):
        if (mask >> i) & 1 and node[11, i] >= 0.0:
            pending[depth, 0], pending[depth, 1] = int(node[10, i]), int(node[11, i])
            depth += 1
    return depth


@inner
def axis_view(wrench):
    """Return f, e1, e2 with e1 x e2 = f, the axis' point nearest to the origin, and the pitch [Duff et al. 2017]."""
    fx, fy, fz, mx, my, mz = wrench[0], wrench[1], wrench[2], wrench[3], wrench[4], wrench[5]
    force = np.sqrt(fx * fx + fy * fy + fz * fz)
    fx, fy, fz = fx / force, fy / force, fz / force
    mx, my, mz = mx / force, my / force, mz / force
    sign = 1.0 if fz >= 0.0 else -1.0
    p = -1.0 / (sign + fz)
    r = fx * fy * p
    one = (1.0 + sign * fx * fx * p, sign * r, -sign * fx)
    two = (r, sign + fy * fy * p, -fy)
    axis = (fy * mz - fz * my, fz * mx - fx * mz, fx * my - fy * mx)
    return (fx, fy, fz), one, two, axis, fx * mx + fy * my + fz * mz


@inner
def _keep(found, count, capacity, patch, b, kind, corners, fx, fy, fz, tan_limit):
    """Write a contact into `found` unless it is in it already or beyond the limit; return the new count."""
    spare = found[capacity]
    row = corners[patch]
    for k in range(6):
        spare[8 + k] = b[0] * row[k] + b[1] * row[6 + k] + b[2] * row[12 + k]
    length = np.sqrt(spare[11] * spare[11] + spare[12] * spare[12] + spare[13] * spare[13])
    cosine = -(fx * spare[11] + fy * spare[12] + fz * spare[13]) / length
    if cosine <= 1e-12:
        return count
    tangent = np.sqrt(max(0.0, 1.0 - cosine * cosine)) / cosine
    if tangent > tan_limit:
        return count
    for k in range(11, 14):
        spare[k] /= length
    spare[0], spare[1], spare[2], spare[3], spare[4] = patch, b[0], b[1], b[2], tangent
    spare[5] = fx * spare[8] + fy * spare[9] + fz * spare[10]
    spare[6], spare[7] = kind, 0.0
    spot = count
    for i in range(count):
        apart = turned = 0.0
        for k in range(3):
            apart += (found[i, 8 + k] - spare[8 + k]) ** 2
            turned += (found[i, 11 + k] - spare[11 + k]) ** 2
        if apart < 1e-14 and turned < 1e-12:  # the same contact, seen from the patch next door
            return count
        if count == capacity and found[i, 4] > tangent and (spot == count or found[i, 4] > found[spot, 4]):
            spot = i
    if spot < capacity:
        copy_into(spare, found[spot])
    return min(max(count, spot + 1), capacity)


@inner
def room():
    """Return the scratch arrays of `search_in`: allocating memory takes as long as a search."""
    return np.empty(14, dtype=np.float32), np.empty((4, 3)), np.empty((STACK, 2), dtype=np.int64)


@entry("wrench 6, soft float, tan_limit float, nodes float32 k 14 8, corners p 20, found out 17 14")
def search(wrench, soft, tan_limit, nodes, corners, found):
    """Find every contact like `search_in`, with newly allocated scratch arrays."""
    return search_in(wrench, soft, tan_limit, nodes, corners, found, room())


@inner
def search_in(wrench, soft, tan_limit, nodes, corners, found, room):
    """Find every contact that a wrench can have on the patches.

    Args:
        wrench: (6,) force first, finite, force not zero, in the tree's unit size.
        soft: 1.0 for the soft finger; 0.0 takes the wrench axis itself, without the shift.
        tan_limit: largest tan(theta) wanted; inf for all contacts that press.
        nodes: of the tree.
        corners: of the tree.
        found: (CAPACITY + 1, CANDIDATE) to write into; its last row is scratch.
        room: from `room`.

    Returns:
        the number of rows of `found` that are contacts, in no order: patch 0, barycentric 1-3, tan(theta) 4, height
        along f 5, kind 6, free 7, position 8-10, unit normal 11-13.
    """
    capacity = len(found) - 1
    (fx, fy, fz), (ux, uy, uz), (vx, vy, vz), (px, py, pz), pitch = axis_view(wrench)
    pitch *= soft
    # M/|F|, without its part along f where the shift is not wanted
    mx = py * fz - pz * fy + pitch * fx
    my = pz * fx - px * fz + pitch * fy
    mz = px * fy - py * fx + pitch * fz
    qu, qv = ux * px + uy * py + uz * pz, vx * px + vy * py + vz * pz
    view, out, pending = room  # the last: first and size, as in a node
    start_view((fx, fy, fz), (px, py, pz), pitch, tan_limit, view)
    pending[0, 0], pending[0, 1] = 0, 0
    depth, count = 1, 0
    while depth > 0:
        depth -= 1
        first, size = pending[depth, 0], pending[depth, 1]
        if size == 0:
            mask = test_children(nodes[first], view)
            depth = push_children(mask, nodes[first], pending, depth)
            continue
        for patch in range(first, first + size):
            kind = corners[patch, KIND]
            n0x, n0y, n0z = corners[patch, 3], corners[patch, 4], corners[patch, 5]
            c0 = fx * n0x + fy * n0y + fz * n0z
            if kind == FLAT:
                solved = 0 if c0 >= 0.0 else solve_flat(corners[patch], fx, fy, fz, mx, my, mz, out)
            elif kind == VERTEX:
                solved = 0 if pitch == 0.0 else solve_vertex(corners[patch], fx, fy, fz, mx, my, mz, out)
            else:
                n1x, n1y, n1z = corners[patch, 9], corners[patch, 10], corners[patch, 11]
                n2x, n2y, n2z = corners[patch, 15], corners[patch, 16], corners[patch, 17]
                c1 = fx * n1x + fy * n1y + fz * n1z
                c2 = fx * n2x + fy * n2y + fz * n2z
                if c0 >= 0.0 and c1 >= 0.0 and c2 >= 0.0:
                    continue
                x0, y0, z0 = corners[patch, 0], corners[patch, 1], corners[patch, 2]
                x1, y1, z1 = corners[patch, 6], corners[patch, 7], corners[patch, 8]
                x2, y2, z2 = corners[patch, 12], corners[patch, 13], corners[patch, 14]
                q0, r0 = ux * x0 + uy * y0 + uz * z0 - qu, vx * x0 + vy * y0 + vz * z0 - qv
                q1, r1 = ux * x1 + uy * y1 + uz * z1 - qu, vx * x1 + vy * y1 + vz * z1 - qv
                q2, r2 = ux * x2 + uy * y2 + uz * z2 - qu, vx * x2 + vy * y2 + vz * z2 - qv
                g0, h0 = -(vx * n0x + vy * n0y + vz * n0z), ux * n0x + uy * n0y + uz * n0z  # e . (f x n)
                g1, h1 = -(vx * n1x + vy * n1y + vz * n1z), ux * n1x + uy * n1y + uz * n1z
                g2, h2 = -(vx * n2x + vy * n2y + vz * n2z), ux * n2x + uy * n2y + uz * n2z
                if c0 < 0.0 and c1 < 0.0 and c2 < 0.0:  # each corner shifted by its own normal: a box around the patch
                    i0, i1, i2 = pitch / c0, pitch / c1, pitch / c2
                    s0, s1, s2, t0, t1, t2 = i0 * g0, i1 * g1, i2 * g2, i0 * h0, i1 * h1, i2 * h2
                    if (
                        min(q0, q1, q2) + min(s0, s1, s2) > _SLACK
                        or max(q0, q1, q2) + max(s0, s1, s2) < -_SLACK
                        or min(r0, r1, r2) + min(t0, t1, t2) > _SLACK
                        or max(r0, r1, r2) + max(t0, t1, t2) < -_SLACK
                    ):
                        continue
                solved = solve_patch(q0, r0, q1, r1, q2, r2, c0, c1, c2, g0, h0, g1, h1, g2, h2, pitch, out)
            for s in range(solved):
                count = _keep(found, count, capacity, patch, out[s], kind, corners, fx, fy, fz, tan_limit)
    return count
