"""Compiled loops over patches: build the tree, find every contact that a wrench can have, find the nearest point.

The problem. F and M are in the tree's unit size, f = F/|F|, h = F . M/|F|^2 the pitch, a = F x M/|F|^2 the point of
the wrench axis nearest to the origin. A soft finger at p with outward normal n makes M = p x F + tau n, hence
tau = F . M/(F . n), and p lies on the axis shifted sideways (the `probe` paper's (4), solved in closed form):

    p = a - h (f x n)/(f . n) + lambda f.

On a patch p = sum b_i p_i and n ~ sum b_i n_i. Seen along f, in a basis (e1, e2), with q_i = (e . (p_i - a)),
c_i = f . n_i and g_i = e . (f x n_i), the two equations sum b_i (q_i w + h g_i) = 0, w = sum b_i c_i, are linear in b for
a given w: b ~ B(w), the cross product of two rows that are linear in w. Then sum (c_i - w) B_i(w) = 0 is a cubic in w,
and *all* contacts on the patch are its roots between min c_i and max c_i with b >= 0. No iteration from a guess, nothing
missed. A flat patch has one normal, and the cubic is linear.

The tree. In a node whose normals lie in a cone (axis n, half-angle alpha; theta between n and -f) the shifts lie in a
disc with centre h (f x n) cos(theta)/(cos(theta)^2 - sin(alpha)^2) and radius |h| sin(alpha) cos(alpha)/(the same); the line
is moved by the centre and the box is widened by the radius, so that the search stays logarithmic for any pitch.
"""

# pyright: basic
from __future__ import annotations

import functools

import numpy as np
from numba import njit

__all__ = ["CAPACITY", "CANDIDATE", "build", "nearest_to_axis", "nearest_to_point", "search", "search_reference"]

CAPACITY = 16  # candidates kept a query; the ones nearest to the force stay
CANDIDATE = 14  # numbers a candidate, as `search` says
_LEAF = 4
_INSIDE = -1e-8  # how far outside its patch a solution may lie, in barycentric units: rounding at shared edges
_SLACK = 1e-9  # how far a box test may err, in unit size
_ROUNDING = 4e-7  # of the float32 in which the nodes are kept
_STACK = 128

# Division by zero gives inf as in NumPy, and a * b + c may be one instruction; NaN and inf keep their meaning.
_compiled = functools.partial(njit, cache=True, error_model="numpy", fastmath={"contract"})
_inlined = functools.partial(_compiled, inline="always")


# ---------------------------------------------------------------------------------------------------------------- build


@_compiled()
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


@_compiled()
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


@_compiled()
def build(corners, nodes):
    """Fill `nodes` (2 m + 2, 16), zeros, as `Tree` describes them; the order of the patches and how many nodes."""
    count = len(corners)
    order = np.arange(count)
    middles = np.empty((3, count))
    for k in range(3):
        for m in range(count):
            middles[k, m] = corners[m, 0, k] + corners[m, 1, k] + corners[m, 2, k]
    pending = np.empty((_STACK, 3), dtype=np.int64)  # low, high, node
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


# --------------------------------------------------------------------------------------------------------------- search


@_compiled()
def _cubic(k0, k1, k2, k3, x):
    return k0 + x * (k1 + x * (k2 + x * k3))


@_compiled()
def _root_between(k0, k1, k2, k3, left, right):
    """The root of a cubic in an interval on which it is monotone and changes sign: Newton, kept inside by bisection."""
    rising = _cubic(k0, k1, k2, k3, left) < 0.0
    x = 0.5 * (left + right)
    for _ in range(80):
        value = _cubic(k0, k1, k2, k3, x)
        if (value < 0.0) == rising:
            left = x
        else:
            right = x
        slope = k1 + x * (2.0 * k2 + 3.0 * x * k3)
        trial = x - value / slope if slope != 0.0 else left
        if not (left < trial < right):
            trial = 0.5 * (left + right)
        if abs(trial - x) <= 1e-15 + 1e-13 * abs(x) or trial == left or trial == right:
            return trial
        x = trial
    return x


@_compiled()
def _roots(k0, k1, k2, k3, left, right, out):
    """Every real root of a cubic in [left, right] into out; how many."""
    cut0, cut1 = right, right  # where the slope vanishes, in order
    a, b, c = 3.0 * k3, k2, k1  # slope = a x^2 + 2 b x + c
    if a == 0.0:
        if b != 0.0:
            cut0 = -0.5 * c / b
    else:
        square = b * b - a * c
        if square > 0.0:
            big = -(b + np.sqrt(square)) if b > 0.0 else -(b - np.sqrt(square))
            cut0 = big / a
            cut1 = c / big if big != 0.0 else cut0
            if cut0 > cut1:
                cut0, cut1 = cut1, cut0
    count, begin = 0, left
    for piece in range(3):
        end = cut0 if piece == 0 else (cut1 if piece == 1 else right)
        end = min(max(end, begin), right)
        if end > begin or piece == 2:
            low, high = _cubic(k0, k1, k2, k3, begin), _cubic(k0, k1, k2, k3, end)
            if low == 0.0:
                out[count] = begin
                count += 1
            elif (low < 0.0) != (high < 0.0) and high != 0.0:
                out[count] = _root_between(k0, k1, k2, k3, begin, end)
                count += 1
            elif high == 0.0 and piece == 2:
                out[count] = end
                count += 1
        begin = end
        if count == 3:
            break
    return count


@_compiled()
def _weights(qj0, qj1, qk0, qk1, gj0, gj1, gk0, gk1, pitch, base):
    """One component of B(base + x) as coefficients of 1, x, x^2."""
    d0 = qj0 * qk1 - qk0 * qj1
    d1 = pitch * (qj0 * gk1 - qk0 * gj1 + gj0 * qk1 - gk0 * qj1)
    d2 = pitch * pitch * (gj0 * gk1 - gk0 * gj1)
    return d2 + base * (d1 + base * d0), d1 + 2.0 * base * d0, d0


@_compiled()
def _solve_patch(x0, y0, x1, y1, x2, y2, c0, c1, c2, g0, h0, g1, h1, g2, h2, pitch, out):
    """All contacts of a patch, b0, b1, b2 a row, into out (4, 3); how many.

    Corners are seen along f: (x, y) their places, c = f . n, (g, h) = f x n. Solved about w = c0: the roots lie close.
    """
    a0, a1, a2 = _weights(x1, y1, x2, y2, g1, h1, g2, h2, pitch, c0)
    b0, b1, b2 = _weights(x2, y2, x0, y0, g2, h2, g0, h0, pitch, c0)
    d0, d1, d2 = _weights(x0, y0, x1, y1, g0, h0, g1, h1, pitch, c0)
    s0, s1, s2 = a0 + b0 + d0, a1 + b1 + d1, a2 + b2 + d2
    r1, r2 = c1 - c0, c2 - c0
    least, most = min(0.0, r1, r2), max(0.0, r1, r2)
    slack = 1e-7 * (most - least) + 1e-14
    roots = out[3]
    found = _roots(
        r1 * b0 + r2 * d0,
        r1 * b1 + r2 * d1 - s0,
        r1 * b2 + r2 * d2 - s1,
        -s2,
        least - slack,
        most + slack,
        roots,
    )
    count = 0
    for r in range(found):
        x = roots[r]
        total = s0 + x * (s1 + x * s2)
        if total == 0.0 or c0 + x >= 0.0:
            continue
        u = (a0 + x * (a1 + x * a2)) / total
        v = (b0 + x * (b1 + x * b2)) / total
        w = (d0 + x * (d1 + x * d2)) / total
        if u >= _INSIDE and v >= _INSIDE and w >= _INSIDE:
            out[count, 0], out[count, 1], out[count, 2] = u, v, w
            count += 1
    return count


@_compiled()
def _solve_flat(x0, y0, x1, y1, x2, y2, sx, sy, out):
    """The one contact of a patch with one normal: the shifted line against the triangle."""
    x0, y0, x1, y1, x2, y2 = x0 + sx, y0 + sy, x1 + sx, y1 + sy, x2 + sx, y2 + sy
    b0, b1, b2 = x1 * y2 - x2 * y1, x2 * y0 - x0 * y2, x0 * y1 - x1 * y0
    total = b0 + b1 + b2
    if total == 0.0:
        return 0
    b0, b1, b2 = b0 / total, b1 / total, b2 / total
    if b0 < _INSIDE or b1 < _INSIDE or b2 < _INSIDE:
        return 0
    out[0, 0], out[0, 1], out[0, 2] = b0, b1, b2
    return 1


@_inlined()
def _node_may_hit(nodes, at, fx, fy, fz, gx, gy, gz, px, py, pz, pitch, cos_limit, reach, wider):
    """Can a node hold a contact whose friction angle has at least this cosine?

    (px, py, pz) is a point of the wrench axis and g = |f|; reach = |pitch| tan(theta_max) bounds any shift; the box grows
    by `wider`. First the box, widened by the reach; then the cone against the limit; then, where the reach matters, the
    box against the axis as the cone shifts it. The order is that of the cheapest way to say no.
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


@_compiled()
def _view(wrench):
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


@_compiled()
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


@_compiled()
def search(wrench, soft, tan_limit, nodes, corners, tags, found):
    """Every contact that a wrench can have on the patches.

    Args:
        wrench: (6,) force first, finite, force not zero, in the tree's unit size.
        soft: 1.0 for the soft finger; 0.0 takes the wrench axis itself, without the shift.
        tan_limit: largest tan(theta) wanted; inf for all that press.
        nodes, corners, tags: the tree.
        found: (CAPACITY + 1, CANDIDATE) to write into; its last row is scratch.

    Returns:
        how many rows of `found` are contacts, in no order: patch 0, barycentric 1-3, tan(theta) 4, height along f 5,
        kind 6, free 7, position 8-10, unit normal 11-13.
    """
    capacity = len(found) - 1
    (fx, fy, fz), (ux, uy, uz), (vx, vy, vz), (px, py, pz), pitch = _view(wrench)
    pitch *= soft
    gx, gy, gz = abs(fx), abs(fy), abs(fz)
    qu, qv = ux * px + uy * py + uz * pz, vx * px + vy * py + vz * pz
    cos_limit = -1e-12 if tan_limit == np.inf else 1.0 / np.sqrt(1.0 + tan_limit * tan_limit) - 1e-12
    reach = 0.0 if pitch == 0.0 else abs(pitch) * tan_limit
    out = np.empty((4, 3))
    pending = np.empty(_STACK, dtype=np.int64)
    pending[0] = 0
    depth, count = 1, 0
    while depth > 0:
        depth -= 1
        at = pending[depth]
        if not _node_may_hit(nodes, at, fx, fy, fz, gx, gy, gz, px, py, pz, pitch, cos_limit, reach, 0.0):
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
                solved = _solve_flat(q0, r0, q1, r1, q2, r2, pitch * g0 / c0, pitch * h0 / c0, out)
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
                solved = _solve_patch(q0, r0, q1, r1, q2, r2, c0, c1, c2, g0, h0, g1, h1, g2, h2, pitch, out)
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


# -------------------------------------------------------------------------------------------------------------- nearest


@_compiled()
def _origin_to_triangle(q, out):
    """Squared distance from the origin to a triangle in the plane; barycentric coordinates of the nearest point."""
    det = (q[1, 0] - q[0, 0]) * (q[2, 1] - q[0, 1]) - (q[2, 0] - q[0, 0]) * (q[1, 1] - q[0, 1])
    if det != 0.0:
        b0 = (q[1, 0] * q[2, 1] - q[2, 0] * q[1, 1]) / det
        b1 = (q[2, 0] * q[0, 1] - q[0, 0] * q[2, 1]) / det
        if b0 >= 0.0 and b1 >= 0.0 and b0 + b1 <= 1.0:
            out[0], out[1], out[2] = b0, b1, 1.0 - b0 - b1
            return 0.0
    best = np.inf
    for i in range(3):
        j = (i + 1) % 3
        dx, dy = q[j, 0] - q[i, 0], q[j, 1] - q[i, 1]
        square = dx * dx + dy * dy
        t = 0.0 if square == 0.0 else min(1.0, max(0.0, -(q[i, 0] * dx + q[i, 1] * dy) / square))
        x, y = q[i, 0] + t * dx, q[i, 1] + t * dy
        if x * x + y * y < best:
            best = x * x + y * y
            out[i], out[j], out[(j + 1) % 3] = 1.0 - t, t, 0.0
    return best


@_compiled()
def nearest_to_axis(wrench, nodes, corners, tags, found):
    """The point nearest to the wrench axis, on a facet that faces the force.

    Writes it as a row of `search` into found (CANDIDATE,); returns the distance, or inf when no facet faces the force. Nearest
    to the axis is nearest in the metric of a wrench whose torque noise is the same in all directions.
    """
    (fx, fy, fz), (ux, uy, uz), (vx, vy, vz), (px, py, pz), _ = _view(wrench)
    gx, gy, gz = abs(fx), abs(fy), abs(fz)
    q, b = np.empty((3, 2)), np.empty(3)
    pending = np.empty(_STACK, dtype=np.int64)
    pending[0] = 0
    depth, best = 1, np.inf
    while depth > 0:
        depth -= 1
        at = pending[depth]
        reach = np.sqrt(best)
        if reach < np.inf and not _node_may_hit(
            nodes, at, fx, fy, fz, gx, gy, gz, px, py, pz, 0.0, -1e-12, 0.0, reach
        ):
            continue
        first, size = int(nodes[at, 10]), int(nodes[at, 11])
        if size == 0:
            pending[depth], pending[depth + 1] = first + 1, first
            depth += 2
            continue
        for patch in range(first, first + size):
            row = corners[patch]
            if tags[patch, 0] > 1 or fx * _sum(row, 3) + fy * _sum(row, 4) + fz * _sum(row, 5) >= 0.0:
                continue
            for i in range(3):
                x, y, z = row[6 * i] - px, row[6 * i + 1] - py, row[6 * i + 2] - pz
                q[i, 0], q[i, 1] = ux * x + uy * y + uz * z, vx * x + vy * y + vz * z
            square = _origin_to_triangle(q, b)
            if square < best:
                best = square
                found[0], found[1], found[2], found[3] = patch, b[0], b[1], b[2]
    if best < np.inf:
        _place(corners, int(found[0]), found[1], found[2], found[3], found[8:14])
    return np.sqrt(best)


@_compiled()
def _sum(row, k):
    return row[k] + row[6 + k] + row[12 + k]


@_compiled()
def _place(corners, patch, b0, b1, b2, out):
    """Position 0-2 and unit normal 3-5 at barycentric coordinates of a patch."""
    row = corners[patch]
    for k in range(6):
        out[k] = b0 * row[k] + b1 * row[6 + k] + b2 * row[12 + k]
    length = np.sqrt(out[3] * out[3] + out[4] * out[4] + out[5] * out[5])
    for k in range(3, 6):
        out[k] /= length


@_compiled()
def _point_to_triangle(row, point, out):
    """Squared distance from a point to a triangle in space; barycentric coordinates of the nearest point."""
    ax, ay, az = row[0] - point[0], row[1] - point[1], row[2] - point[2]
    ux, uy, uz = row[6] - row[0], row[7] - row[1], row[8] - row[2]
    vx, vy, vz = row[12] - row[0], row[13] - row[1], row[14] - row[2]
    # In the triangle's plane this is the planar problem: an orthonormal pair (s, t) of that plane.
    lu = np.sqrt(ux * ux + uy * uy + uz * uz)
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    ln = np.sqrt(nx * nx + ny * ny + nz * nz)
    if ln == 0.0:
        return np.inf
    sx, sy, sz = ux / lu, uy / lu, uz / lu
    nx, ny, nz = nx / ln, ny / ln, nz / ln
    tx, ty, tz = ny * sz - nz * sy, nz * sx - nx * sz, nx * sy - ny * sx
    q = np.empty((3, 2))
    q[0, 0], q[0, 1] = ax * sx + ay * sy + az * sz, ax * tx + ay * ty + az * tz
    q[1, 0], q[1, 1] = q[0, 0] + lu, q[0, 1]
    q[2, 0] = q[0, 0] + vx * sx + vy * sy + vz * sz
    q[2, 1] = q[0, 1] + vx * tx + vy * ty + vz * tz
    height = ax * nx + ay * ny + az * nz
    return _origin_to_triangle(q, out) + height * height


@_compiled()
def nearest_to_point(points, nodes, corners, tags, found):
    """For each point (n, 3), in unit size, the nearest point of the facets: patch, b0, b1, b2 into found (n, 4)."""
    bary = np.empty(3)
    pending = np.empty(_STACK, dtype=np.int64)
    gaps = np.empty(_STACK)
    for n in range(len(points)):
        point = points[n]
        pending[0], gaps[0] = 0, 0.0
        depth, best = 1, np.inf
        while depth > 0:
            depth -= 1
            if gaps[depth] >= best:
                continue
            at = pending[depth]
            node = nodes[at]
            if node[11] == 0.0:
                left, right = int(node[10]), int(node[10]) + 1
                gap_left, gap_right = _gap(nodes[left], point), _gap(nodes[right], point)
                if gap_left < gap_right:
                    left, right, gap_left, gap_right = right, left, gap_right, gap_left
                pending[depth], gaps[depth] = left, gap_left
                pending[depth + 1], gaps[depth + 1] = right, gap_right
                depth += 2
                continue
            first = int(node[10])
            for patch in range(first, first + int(node[11])):
                if tags[patch, 0] > 1:
                    continue
                square = _point_to_triangle(corners[patch], point, bary)
                if square < best:
                    best = square
                    found[n, 0], found[n, 1], found[n, 2], found[n, 3] = patch, bary[0], bary[1], bary[2]


@_compiled()
def _gap(node, point):
    """Squared distance from a point to a node's box."""
    total = 0.0
    for k in range(3):
        beyond = abs(point[k] - node[k]) - node[3 + k]
        if beyond > 0.0:
            total += beyond * beyond
    return total
