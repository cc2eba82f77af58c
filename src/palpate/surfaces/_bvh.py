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

from __future__ import annotations

import numpy as np
from numba import njit

__all__ = ["CAPACITY", "CANDIDATE", "build", "nearest_to_axis", "nearest_to_point", "search", "search_reference"]

CAPACITY = 16  # candidates kept a query; the ones nearest to the force stay
CANDIDATE = 8  # patch, b0, b1, b2, tan(theta), height along f, kind, spare
_LEAF = 4
_INSIDE = -1e-8  # how far outside its patch a solution may lie, in barycentric units: rounding at shared edges
_STACK = 128


# ---------------------------------------------------------------------------------------------------------------- build


@njit(cache=True)
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


@njit(cache=True)
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
    for k in range(3):
        node[k] = 0.5 * (box_low[k] + box_high[k])
        node[3 + k] = 0.5 * (box_high[k] - box_low[k]) + 1e-12
        node[6 + k] = axis[k]
    node[9] = cosine - 1e-12


@njit(cache=True)
def build(corners):
    """Order of the patches and nodes of the tree, as `Tree` describes them."""
    count = len(corners)
    order = np.arange(count)
    nodes = np.zeros((2 * count + 1, 16))
    middles = np.empty((3, count))
    for k in range(3):
        for m in range(count):
            middles[k, m] = corners[m, 0, k] + corners[m, 1, k] + corners[m, 2, k]
    pending = np.empty((_STACK, 3), dtype=np.int64)  # low, high, parent whose second child this is
    pending[0] = (0, count, -1)
    depth, used = 1, 0
    while depth > 0:
        depth -= 1
        low, high, parent = pending[depth]
        if parent >= 0:
            nodes[parent, 10] = used
        node = nodes[used]
        _fill_node(node, corners, order, low, high)
        if high - low <= _LEAF:
            node[10], node[11] = low, high - low
        else:
            widest = 0
            for k in range(1, 3):
                if node[3 + k] > node[3 + widest]:
                    widest = k
            middle = (low + high) // 2
            _select(middles[widest], order, low, high, middle)
            pending[depth] = (middle, high, used)
            pending[depth + 1] = (low, middle, -1)
            depth += 2
        used += 1
    return order, nodes[:used].copy()


# --------------------------------------------------------------------------------------------------------------- search


@njit(cache=True, inline="always")
def _cubic(k0, k1, k2, k3, x):
    return k0 + x * (k1 + x * (k2 + x * k3))


@njit(cache=True)
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


@njit(cache=True)
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


@njit(cache=True, inline="always")
def _project(corners, patch, view, q, c, g):
    """Corners of a patch seen along f: q (3, 2), c (3,), g (3, 2)."""
    for i in range(3):
        row = corners[patch]
        o = 6 * i
        x, y, z, nx, ny, nz = row[o], row[o + 1], row[o + 2], row[o + 3], row[o + 4], row[o + 5]
        q[i, 0] = view[3] * x + view[4] * y + view[5] * z - view[9]
        q[i, 1] = view[6] * x + view[7] * y + view[8] * z - view[10]
        c[i] = view[0] * nx + view[1] * ny + view[2] * nz
        g[i, 0] = -(view[6] * nx + view[7] * ny + view[8] * nz)  # e1 . (f x n) = -e2 . n
        g[i, 1] = view[3] * nx + view[4] * ny + view[5] * nz


@njit(cache=True)
def _solve_patch(q, c, g, pitch, scratch):
    """All (b0, b1, b2, w) of one patch into scratch; how many. w = f . n before n is made unit."""
    # In a view along f, B(w) = D0 w^2 + D1 w + D2, each a cross product of rows (q0, q1, q2) and pitch (g0, g1, g2).
    least, most = min(c[0], c[1], c[2]), max(c[0], c[1], c[2])
    base = c[0]
    e0, e1, e2 = np.empty(3), np.empty(3), np.empty(3)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        d0 = q[j, 0] * q[k, 1] - q[k, 0] * q[j, 1]
        d1 = pitch * (q[j, 0] * g[k, 1] - q[k, 0] * g[j, 1] + g[j, 0] * q[k, 1] - g[k, 0] * q[j, 1])
        d2 = pitch * pitch * (g[j, 0] * g[k, 1] - g[k, 0] * g[j, 1])
        e0[i] = d2 + base * (d1 + base * d0)  # B about w = base: the roots lie close to it
        e1[i] = d1 + 2.0 * base * d0
        e2[i] = d0
    s0, s1, s2 = e0[0] + e0[1] + e0[2], e1[0] + e1[1] + e1[2], e2[0] + e2[1] + e2[2]
    r1, r2 = c[1] - base, c[2] - base
    k0 = r1 * e0[1] + r2 * e0[2]
    k1 = r1 * e1[1] + r2 * e1[2] - s0
    k2 = r1 * e2[1] + r2 * e2[2] - s1
    slack = 1e-7 * (most - least) + 1e-14
    roots = scratch[8]
    found = _roots(k0, k1, k2, -s2, least - base - slack, most - base + slack, roots)
    count = 0
    for r in range(found):
        x = roots[r]
        total = s0 + x * (s1 + x * s2)
        w = base + x
        if total == 0.0 or w >= 0.0:
            continue
        b0 = (e0[0] + x * (e1[0] + x * e2[0])) / total
        b1 = (e0[1] + x * (e1[1] + x * e2[1])) / total
        b2 = (e0[2] + x * (e1[2] + x * e2[2])) / total
        if b0 >= _INSIDE and b1 >= _INSIDE and b2 >= _INSIDE:
            scratch[count, 0], scratch[count, 1], scratch[count, 2], scratch[count, 3] = b0, b1, b2, w
            count += 1
    return count


@njit(cache=True)
def _solve_flat(q, c, g, pitch, scratch):
    """The one solution of a patch with one normal: the shifted line against the triangle."""
    s0, s1 = pitch * g[0, 0] / c[0], pitch * g[0, 1] / c[0]
    x0, y0, x1, y1, x2, y2 = q[0, 0] + s0, q[0, 1] + s1, q[1, 0] + s0, q[1, 1] + s1, q[2, 0] + s0, q[2, 1] + s1
    b0, b1, b2 = x1 * y2 - x2 * y1, x2 * y0 - x0 * y2, x0 * y1 - x1 * y0
    total = b0 + b1 + b2
    if total == 0.0:
        return 0
    b0, b1, b2 = b0 / total, b1 / total, b2 / total
    if b0 < _INSIDE or b1 < _INSIDE or b2 < _INSIDE:
        return 0
    scratch[0, 0], scratch[0, 1], scratch[0, 2], scratch[0, 3] = b0, b1, b2, c[0]
    return 1


@njit(cache=True, inline="always")
def _misses(q, c, g, pitch):
    """True when the patch, its corners shifted each by its own normal, cannot cover the line."""
    if c[0] >= 0.0 or c[1] >= 0.0 or c[2] >= 0.0:
        return c[0] >= 0.0 and c[1] >= 0.0 and c[2] >= 0.0
    for k in range(2):
        t0, t1, t2 = pitch * g[0, k] / c[0], pitch * g[1, k] / c[1], pitch * g[2, k] / c[2]
        slack = 1e-9
        if min(q[0, k], q[1, k], q[2, k]) + min(t0, t1, t2) > slack:
            return True
        if max(q[0, k], q[1, k], q[2, k]) + max(t0, t1, t2) < -slack:
            return True
    return False


@njit(cache=True, inline="always")
def _node_may_hit(node, view, pitch, cos_limit, tan_limit):
    """Can the node hold a contact whose friction angle has at least this cosine?"""
    fx, fy, fz = view[0], view[1], view[2]
    ax, ay, az = node[6], node[7], node[8]
    cos_a = node[9]
    cos_t = -(fx * ax + fy * ay + fz * az)
    sx = sy = sz = 0.0
    radius = 0.0 if pitch == 0.0 else abs(pitch) * tan_limit
    if cos_a > 0.0:
        sin_a2 = 1.0 - cos_a * cos_a
        sin_a = np.sqrt(sin_a2)
        if cos_t < cos_a:  # the force lies outside the cone
            sin_t = np.sqrt(max(0.0, 1.0 - cos_t * cos_t))
            if cos_t * cos_a + sin_t * sin_a < cos_limit:
                return False
        gap = cos_t * cos_t - sin_a2
        if cos_t > 0.0 and gap > 1e-9:
            disc = abs(pitch) * sin_a * cos_a / gap
            if disc < radius:
                radius = disc
                scale = pitch * cos_t / gap  # -pitch (f x n)/(f . n), the middle of the cone's conic section
                sx, sy, sz = scale * (fy * az - fz * ay), scale * (fz * ax - fx * az), scale * (fx * ay - fy * ax)
    if radius == np.inf:
        return True
    dx, dy, dz = node[0] - view[11] - sx, node[1] - view[12] - sy, node[2] - view[13] - sz
    hx, hy, hz = node[3] + radius, node[4] + radius, node[5] + radius
    gx, gy, gz = abs(fx), abs(fy), abs(fz)
    # A line and a box are apart if and only if they are along f x (an axis of the box).
    if abs(dy * fz - dz * fy) > hy * gz + hz * gy:
        return False
    if abs(dz * fx - dx * fz) > hz * gx + hx * gz:
        return False
    return abs(dx * fy - dy * fx) <= hx * gy + hy * gx


@njit(cache=True)
def _set_view(wrench, view):
    """view: f 0-2, e1 3-5, e2 6-8, e1 . a and e2 . a 9-10, a 11-13; returns |F| and the pitch. e1 x e2 = f."""
    fx, fy, fz, mx, my, mz = wrench[0], wrench[1], wrench[2], wrench[3], wrench[4], wrench[5]
    force = np.sqrt(fx * fx + fy * fy + fz * fz)
    fx, fy, fz = fx / force, fy / force, fz / force
    mx, my, mz = mx / force, my / force, mz / force
    view[0], view[1], view[2] = fx, fy, fz
    sign = 1.0 if fz >= 0.0 else -1.0  # Duff et al. 2017: a basis without a branch that loses digits
    p = -1.0 / (sign + fz)
    r = fx * fy * p
    view[3], view[4], view[5] = 1.0 + sign * fx * fx * p, sign * r, -sign * fx
    view[6], view[7], view[8] = r, sign + fy * fy * p, -fy
    view[11], view[12], view[13] = fy * mz - fz * my, fz * mx - fx * mz, fx * my - fy * mx
    view[9] = view[3] * view[11] + view[4] * view[12] + view[5] * view[13]
    view[10] = view[6] * view[11] + view[7] * view[12] + view[8] * view[13]
    return force, fx * mx + fy * my + fz * mz


@njit(cache=True)
def _place(corners, patch, b0, b1, b2, out):
    """Position 0-2 and unit normal 3-5 at barycentric coordinates of a patch."""
    row = corners[patch]
    for k in range(6):
        out[k] = b0 * row[k] + b1 * row[6 + k] + b2 * row[12 + k]
    length = np.sqrt(out[3] * out[3] + out[4] * out[4] + out[5] * out[5])
    for k in range(3, 6):
        out[k] /= length


@njit(cache=True)
def _keep(found, count, capacity, places, place):
    """Where to put a candidate (its row at found[capacity]): a new place, that of a worse one, or -1 for a repeat."""
    tangent = found[capacity, 4]
    for i in range(count):
        apart = 0.0
        turned = 0.0
        for k in range(3):
            apart += (places[i, k] - place[k]) ** 2
            turned += (places[i, 3 + k] - place[3 + k]) ** 2
        if apart < 1e-14 and turned < 1e-12:  # the same contact, seen from the patch next door
            return -1
    if count < capacity:
        return count
    worst = 0
    for i in range(1, capacity):
        if found[i, 4] > found[worst, 4]:
            worst = i
    return worst if found[worst, 4] > tangent else -1


@njit(cache=True)
def search(wrench, pitch_used, tan_limit, nodes, corners, tags, found):
    """Every contact that a wrench can have on the patches.

    Args:
        wrench: (6,) force first, finite, force not zero, in the tree's unit size.
        pitch_used: 1 for the soft finger; 0 takes the wrench axis itself, without the shift.
        tan_limit: largest tan(theta) wanted; inf for all that press.
        nodes, corners, tags: the tree.
        found: (CAPACITY + 1, CANDIDATE) to write into; its last row is scratch.

    Returns:
        how many; `found` holds patch, b0, b1, b2, tan(theta), height along f, kind, sorted by nothing.
    """
    capacity = len(found) - 1
    view = np.empty(14)
    _, pitch = _set_view(wrench, view)
    pitch *= pitch_used
    cos_limit = 0.0 if tan_limit == np.inf else 1.0 / np.sqrt(1.0 + tan_limit * tan_limit)
    q, c, g = np.empty((3, 2)), np.empty(3), np.empty((3, 2))
    scratch, places, place = np.empty((9, 4)), np.empty((capacity, 6)), np.empty(6)
    pending = np.empty(_STACK, dtype=np.int64)
    pending[0] = 0
    depth, count = 1, 0
    while depth > 0:
        depth -= 1
        at = pending[depth]
        node = nodes[at]
        if not _node_may_hit(node, view, pitch, cos_limit - 1e-12, tan_limit):
            continue
        if node[11] == 0.0:
            pending[depth] = int(node[10])
            pending[depth + 1] = at + 1
            depth += 2
            continue
        first = int(node[10])
        for patch in range(first, first + int(node[11])):
            _project(corners, patch, view, q, c, g)
            if _misses(q, c, g, pitch):
                continue
            kind = tags[patch, 0]
            if kind == 0:
                solved = _solve_flat(q, c, g, pitch, scratch)
            else:
                solved = _solve_patch(q, c, g, pitch, scratch)
            for s in range(solved):
                b0, b1, b2 = scratch[s, 0], scratch[s, 1], scratch[s, 2]
                _place(corners, patch, b0, b1, b2, place)
                cosine = -(view[0] * place[3] + view[1] * place[4] + view[2] * place[5])
                if cosine <= 0.0:
                    continue
                tangent = np.sqrt(max(0.0, 1.0 - cosine * cosine)) / cosine
                if tangent > tan_limit:
                    continue
                found[capacity, 4] = tangent
                spot = _keep(found, count, capacity, places, place)
                if spot < 0:
                    continue
                found[spot, 0], found[spot, 1], found[spot, 2], found[spot, 3] = patch, b0, b1, b2
                found[spot, 4] = tangent
                found[spot, 5] = view[0] * place[0] + view[1] * place[1] + view[2] * place[2]
                found[spot, 6] = kind
                for k in range(6):
                    places[spot, k] = place[k]
                if spot == count:
                    count += 1
    return count


def search_reference(wrench, pitch_used, tan_limit, corners):
    """NumPy twin of `search`, over all patches and with numpy's polynomial roots: the oracle of the tests.

    Returns:
        (k, 8) rows: patch, b0, b1, b2, tan(theta), height along f, and two zeros.
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
            b = weights / weights.sum()
            normal = b @ normals
            cosine = -(f @ normal) / np.linalg.norm(normal)
            if b.min() < -1e-9 or cosine <= 0 or abs(b @ c - w.real) > 1e-6:
                continue
            tangent = np.sqrt(max(0.0, 1 - cosine**2)) / cosine
            if tangent <= tan_limit:
                rows.append([patch, *b, tangent, f @ (b @ points), 0.0, 0.0])
    return np.array(rows).reshape(-1, CANDIDATE)


# -------------------------------------------------------------------------------------------------------------- nearest


@njit(cache=True)
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


@njit(cache=True)
def nearest_to_axis(wrench, nodes, corners, tags, found):
    """The point nearest to the wrench axis, on a patch that faces the force if there is one.

    Writes patch, b0, b1, b2 into found; returns the distance, or inf when no patch faces the force. Nearest to the
    axis is nearest in the metric of a wrench whose torque noise is the same in all directions.
    """
    view, bary = np.empty(14), np.empty(3)
    _set_view(wrench, view)
    q, c, g = np.empty((3, 2)), np.empty(3), np.empty((3, 2))
    pending = np.empty(_STACK, dtype=np.int64)
    pending[0] = 0
    depth, best = 1, np.inf
    while depth > 0:
        depth -= 1
        at = pending[depth]
        node = nodes[at]
        if best < np.inf and not _node_may_hit(_widened(node, np.sqrt(best)), view, 0.0, 0.0, np.inf):
            continue
        if node[11] == 0.0:
            pending[depth] = int(node[10])
            pending[depth + 1] = at + 1
            depth += 2
            continue
        first = int(node[10])
        for patch in range(first, first + int(node[11])):
            if tags[patch, 0] > 1:
                continue
            _project(corners, patch, view, q, c, g)
            if c[0] + c[1] + c[2] >= 0.0:
                continue
            square = _origin_to_triangle(q, bary)
            if square < best:
                best = square
                found[0], found[1], found[2], found[3] = patch, bary[0], bary[1], bary[2]
    return np.sqrt(best)


@njit(cache=True)
def _widened(node, radius):
    wide = node.copy()
    for k in range(3, 6):
        wide[k] += radius
    return wide


@njit(cache=True)
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


@njit(cache=True)
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
                left, right = at + 1, int(node[10])
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


@njit(cache=True, inline="always")
def _gap(node, point):
    """Squared distance from a point to a node's box."""
    total = 0.0
    for k in range(3):
        beyond = abs(point[k] - node[k]) - node[3 + k]
        if beyond > 0.0:
            total += beyond * beyond
    return total
