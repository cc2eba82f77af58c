"""Compiled: build the tree over patches, and find every contact that a wrench can have on it.

In a node whose normals lie in a cone (axis n, half-angle alpha; theta between n and -f) the sideways shifts of `_patch`
lie in a disc with centre h (f x n) cos(theta)/(cos(theta)^2 - sin(alpha)^2) and radius
|h| sin(alpha) cos(alpha)/(the same). The line is moved by the centre and the box is widened by the radius, so that the
search stays logarithmic for any pitch.
"""

# pyright: basic
from __future__ import annotations

import numpy as np

from palpate.surfaces._jit import entry, inlined, inner
from palpate.surfaces._patch import solve_flat, solve_patch

__all__ = ["CANDIDATE", "CAPACITY", "STACK", "axis_view", "build", "node_may_hit", "search", "search_reference"]

CAPACITY = 16  # candidates kept a query; the ones nearest to the force stay
CANDIDATE = 14  # numbers a candidate, as `search` says
STACK = 128  # of a walk down the tree: twice its depth, which is 23 at most
_LEAF = 4
_SLACK = 1e-9  # how far a box test may err, in unit size
_ROUNDING = 4e-7  # of the float32 in which the nodes are kept


@inner
def _select(keys, order, low, high, middle):
    """Partly sort order[low:high] so that position `middle` splits it by key (Hoare's quickselect)."""
    left, right = low, high - 1
    while left < right:
        pivot = keys[order[(left + right) // 2]]
        i, j = left, right
        while i <= j:
            while keys[order[i]] < pivot:
                i += 1
            while keys[order[j]] > pivot:
                j -= 1
            if i <= j:
                order[i], order[j] = order[j], order[i]
                i += 1
                j -= 1
        if middle <= j:
            right = j
        elif middle >= i:
            left = i
        else:
            return


@inner
def _fill_node(node, corners, order, low, high):
    """Box and cone of the patches order[low:high]."""
    box_low, box_high, axis = np.full(3, np.inf), np.full(3, -np.inf), np.zeros(3)
    for at in range(low, high):
        for i in range(3):
            for k in range(3):
                x = corners[order[at], i, k]
                box_low[k] = min(box_low[k], x)
                box_high[k] = max(box_high[k], x)
                axis[k] += corners[order[at], i, 3 + k]
    length = np.sqrt(axis[0] ** 2 + axis[1] ** 2 + axis[2] ** 2)
    cosine = -1.0
    if length > 1e-9:
        axis /= length
        cosine = 1.0
        for at in range(low, high):
            for i in range(3):
                n = corners[order[at], i]
                cosine = min(cosine, axis[0] * n[3] + axis[1] * n[4] + axis[2] * n[5])
    for k in range(3):  # float32 rounds by 6e-8 of the unit size: every bound is widened by more than that
        node[k] = 0.5 * (box_low[k] + box_high[k])
        node[3 + k] = 0.5 * (box_high[k] - box_low[k]) * (1.0 + 1e-6) + _ROUNDING
        node[6 + k] = axis[k]
    cosine = max(-1.0, cosine - _ROUNDING)
    node[9] = cosine
    node[12] = (1.0 - cosine * cosine) * (1.0 + 1e-6)
    node[13] = np.sqrt(1.0 - cosine * cosine) * max(0.0, cosine) * (1.0 + 1e-6)


@entry
def build(corners, nodes):
    """Fill `nodes` (2 m + 2, 16), zeros, as `Tree` describes them; the order of the patches and how many nodes."""
    count = len(corners)
    order = np.arange(count)
    middles = np.empty((3, count))
    for k in range(3):
        for m in range(count):
            middles[k, m] = corners[m, 0, k] + corners[m, 1, k] + corners[m, 2, k]
    pending = np.empty((STACK, 3), dtype=np.int64)  # low, high, node
    pending[0] = (0, count, 0)
    depth, used = 1, 2  # node 1 is left empty, so that a pair of children shares its two cache lines with nothing else
    while depth > 0:
        depth -= 1
        low, high, at = pending[depth]
        node = nodes[at]
        _fill_node(node, corners, order, low, high)
        if high - low <= _LEAF:
            node[10], node[11] = low, high - low
            continue
        widest = 0
        for k in range(1, 3):
            if node[3 + k] > node[3 + widest]:
                widest = k
        middle = (low + high) // 2
        _select(middles[widest], order, low, high, middle)
        node[10] = used
        pending[depth] = (middle, high, used + 1)
        pending[depth + 1] = (low, middle, used)
        depth += 2
        used += 2
    return order, used


@inlined
def node_may_hit(nodes, at, fx, fy, fz, gx, gy, gz, px, py, pz, pitch, cos_limit, reach, wider):
    """Can a node hold a contact whose friction angle has at least this cosine?

    (px, py, pz) is a point of the wrench axis and g = |f|; reach = |pitch| tan(theta_max) bounds any shift; the box
    grows by `wider`. First the box, widened by the reach; then the cone against the limit; then, where the reach
    matters, the box against the axis as the cone shifts it. The order is that of the cheapest way to say no.
    """
    dx, dy, dz = nodes[at, 0] - px, nodes[at, 1] - py, nodes[at, 2] - pz
    hx, hy, hz = nodes[at, 3] + wider, nodes[at, 4] + wider, nodes[at, 5] + wider
    # A line and a box are apart if and only if they are along f x (an axis of the box).
    if abs(dy * fz - dz * fy) > (hy + reach) * gz + (hz + reach) * gy:
        return False
    if abs(dz * fx - dx * fz) > (hz + reach) * gx + (hx + reach) * gz:
        return False
    if abs(dx * fy - dy * fx) > (hx + reach) * gy + (hy + reach) * gx:
        return False
    ax, ay, az, cos_a = nodes[at, 6], nodes[at, 7], nodes[at, 8], nodes[at, 9]
    if cos_a <= 0.0:
        return True
    sin_a2 = nodes[at, 12]
    cos_t = -(fx * ax + fy * ay + fz * az)
    short = cos_limit - cos_t * cos_a
    square = cos_t * cos_t
    if cos_t < cos_a and short > 0.0 and short * short > (1.0 - square) * sin_a2:
        return False  # the cone is turned from the force by more than the limit
    gap = square - sin_a2
    if 20.0 * reach < hx + hy + hz or cos_t <= 0.0 or gap <= 1e-9:
        return True
    factor = pitch / gap
    radius = abs(factor) * nodes[at, 13]
    if radius >= reach:
        return True
    factor *= cos_t  # the middle of the conic section in which -pitch (f x n)/(f . n) lies
    dx -= factor * (fy * az - fz * ay)
    dy -= factor * (fz * ax - fx * az)
    dz -= factor * (fx * ay - fy * ax)
    return (
        abs(dy * fz - dz * fy) <= (hy + radius) * gz + (hz + radius) * gy
        and abs(dz * fx - dx * fz) <= (hz + radius) * gx + (hx + radius) * gz
        and abs(dx * fy - dy * fx) <= (hx + radius) * gy + (hy + radius) * gx
    )


@inner
def axis_view(wrench):
    """f, e1, e2 with e1 x e2 = f, the point a of the axis nearest to the origin, and the pitch (Duff et al. 2017)."""
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
    """Write a contact into `found` unless it is there already or beyond the limit; the new count."""
    spare = found[capacity]
    row = corners[patch]
    for k in range(6):
        spare[8 + k] = b[0] * row[k] + b[1] * row[6 + k] + b[2] * row[12 + k]
    length = np.sqrt(spare[11] * spare[11] + spare[12] * spare[12] + spare[13] * spare[13])
    cosine = -(fx * spare[11] + fy * spare[12] + fz * spare[13]) / length
    if cosine <= 0.0:
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
        found[spot] = spare
    return min(max(count, spot + 1), capacity)


@entry
def search(wrench, soft, tan_limit, nodes, corners, tags, found):
    """Every contact that a wrench can have on the patches.

    Args:
        wrench: (6,) force first, finite, force not zero, in the tree's unit size.
        soft: 1.0 for the soft finger; 0.0 takes the wrench axis itself, without the shift.
        tan_limit: largest tan(theta) wanted; inf for all that press.
        nodes: of the tree.
        corners: of the tree.
        tags: of the tree.
        found: (CAPACITY + 1, CANDIDATE) to write into; its last row is scratch.

    Returns:
        how many rows of `found` are contacts, in no order: patch 0, barycentric 1-3, tan(theta) 4, height along f 5,
        kind 6, free 7, position 8-10, unit normal 11-13.
    """
    capacity = len(found) - 1
    (fx, fy, fz), (ux, uy, uz), (vx, vy, vz), (px, py, pz), pitch = axis_view(wrench)
    pitch *= soft
    gx, gy, gz = abs(fx), abs(fy), abs(fz)
    qu, qv = ux * px + uy * py + uz * pz, vx * px + vy * py + vz * pz
    cos_limit = -1e-12 if tan_limit == np.inf else 1.0 / np.sqrt(1.0 + tan_limit * tan_limit) - 1e-12
    reach = 0.0 if pitch == 0.0 else abs(pitch) * tan_limit
    out = np.empty((4, 3))
    pending = np.empty(STACK, dtype=np.int64)
    pending[0] = 0
    depth, count = 1, 0
    while depth > 0:
        depth -= 1
        at = pending[depth]
        if not node_may_hit(nodes, at, fx, fy, fz, gx, gy, gz, px, py, pz, pitch, cos_limit, reach, 0.0):
            continue
        first, size = int(nodes[at, 10]), int(nodes[at, 11])
        if size == 0:
            pending[depth], pending[depth + 1] = first + 1, first
            depth += 2
            continue
        for patch in range(first, first + size):
            n0x, n0y, n0z = corners[patch, 3], corners[patch, 4], corners[patch, 5]
            c0 = fx * n0x + fy * n0y + fz * n0z
            x0, y0, z0 = corners[patch, 0], corners[patch, 1], corners[patch, 2]
            x1, y1, z1 = corners[patch, 6], corners[patch, 7], corners[patch, 8]
            x2, y2, z2 = corners[patch, 12], corners[patch, 13], corners[patch, 14]
            kind = tags[patch, 0]
            q0, r0 = ux * x0 + uy * y0 + uz * z0 - qu, vx * x0 + vy * y0 + vz * z0 - qv
            q1, r1 = ux * x1 + uy * y1 + uz * z1 - qu, vx * x1 + vy * y1 + vz * z1 - qv
            q2, r2 = ux * x2 + uy * y2 + uz * z2 - qu, vx * x2 + vy * y2 + vz * z2 - qv
            g0, h0 = -(vx * n0x + vy * n0y + vz * n0z), ux * n0x + uy * n0y + uz * n0z  # e . (f x n)
            if kind == 0:
                if c0 >= 0.0:
                    continue
                solved = solve_flat(q0, r0, q1, r1, q2, r2, pitch * g0 / c0, pitch * h0 / c0, out)
            else:
                n1x, n1y, n1z = corners[patch, 9], corners[patch, 10], corners[patch, 11]
                n2x, n2y, n2z = corners[patch, 15], corners[patch, 16], corners[patch, 17]
                c1 = fx * n1x + fy * n1y + fz * n1z
                c2 = fx * n2x + fy * n2y + fz * n2z
                if c0 >= 0.0 and c1 >= 0.0 and c2 >= 0.0:
                    continue
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


def search_reference(wrench, pitch_used, tan_limit, corners):
    """NumPy twin of `search`, over all patches and with numpy's polynomial roots: the oracle of the tests.

    Returns:
        (k, 6) rows: patch, b0, b1, b2, tan(theta), height along f.
    """
    force, moment = wrench[:3], wrench[3:]
    size = np.linalg.norm(force)
    f, axis = force / size, np.cross(force, moment) / size**2
    pitch = pitch_used * (force @ moment) / size**2
    e1 = np.linalg.svd(f[None])[2][1]
    e2 = np.cross(f, e1)
    rows = []
    for patch, row in enumerate(corners):
        points, normals = row.reshape(3, 6)[:, :3], row.reshape(3, 6)[:, 3:]
        c = normals @ f
        if np.all(c >= 0):
            continue
        across = np.cross(f, normals)
        u, v = (points - axis) @ e1, (points - axis) @ e2
        x, y = pitch * across @ e1, pitch * across @ e2
        d0, d1, d2 = np.cross(u, v), np.cross(u, y) + np.cross(x, v), np.cross(x, y)
        cubic = [-d0.sum(), c @ d0 - d1.sum(), c @ d1 - d2.sum(), c @ d2]
        scale = np.abs(cubic).max()
        if scale == 0:
            continue
        for w in np.roots(np.where(np.abs(cubic) < 1e-15 * scale, 0.0, cubic)):
            if abs(w.imag) > 1e-9 or w.real > -1e-12:
                continue
            weights = d2 + w.real * (d1 + w.real * d0)
            if weights.sum() == 0:
                continue
            b = weights / weights.sum()
            normal = b @ normals
            cosine = -(f @ normal) / np.linalg.norm(normal)
            if b.min() < -1e-9 or cosine <= 0 or abs(b @ c - w.real) > 1e-6:
                continue
            tangent = np.sqrt(max(0.0, 1 - cosine**2)) / cosine
            if tangent <= tan_limit:
                rows.append([patch, *b, tangent, f @ (b @ points)])
    return np.array(rows).reshape(-1, 6)
