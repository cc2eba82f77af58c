"""Compiled: the contacts of one wrench on one patch, in closed form.

F and M are in the tree's unit size, f = F/|F|, h = F . M/|F|^2 the pitch, a = F x M/|F|^2 the point of the wrench axis
nearest to the origin. A soft finger at p with outward normal n makes M = p x F + tau n, hence tau = F . M/(F . n),
and p lies on the axis shifted sideways (the `probe` paper's (4), solved in closed form):

    p = a - h (f x n)/(f . n) + lambda f.

On a patch p = sum b_i p_i and n ~ sum b_i n_i. Seen along f, in a basis (e1, e2), with q_i = e . (p_i - a),
c_i = f . n_i and g_i = e . (f x n_i), the two equations sum b_i (q_i w + h g_i) = 0, w = sum b_i c_i, are linear in b
for a given w: b ~ B(w), the cross product of two rows that are linear in w. Then sum (c_i - w) B_i(w) = 0 is a cubic in
w, and *all* contacts on the patch are its roots between min c_i and max c_i with b >= 0. No iteration from a guess,
nothing missed. A flat patch has one normal, and the cubic is linear.
"""

# pyright: basic
from __future__ import annotations

import numpy as np

from palpate.surfaces._jit import inlined, inner

_INSIDE = -1e-8  # how far outside its patch a solution may lie, in barycentric units: rounding at shared edges
_EDGE = 1e-9  # rounding of a moment about an edge, in unit size
_SOLVED = 1e-7  # how far off the shifted axis a contact may lie, in unit size


@inner
def _cubic(k0, k1, k2, k3, x):
    return k0 + x * (k1 + x * (k2 + x * k3))


@inner
def _root_between(k0, k1, k2, k3, left, right):
    """Return the root in an interval where a cubic is monotone and changes sign: Newton, kept in by bisection."""
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
        if abs(trial - x) <= 1e-15 + 1e-13 * abs(x) or not left < trial < right:
            return trial
        x = trial
    return x


@inner
def _roots(k0, k1, k2, k3, left, right, out):
    """Write every real root of a cubic in [left, right] into out; return their number."""
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


@inner
def _weights(qj0, qj1, qk0, qk1, gj0, gj1, gk0, gk1, pitch, base):
    """Return a component of B(base + x) as coefficients of 1, x, x^2."""
    d0 = qj0 * qk1 - qk0 * qj1
    d1 = pitch * (qj0 * gk1 - qk0 * gj1 + gj0 * qk1 - gk0 * qj1)
    d2 = pitch * pitch * (gj0 * gk1 - gk0 * gj1)
    return d2 + base * (d1 + base * d0), d1 + 2.0 * base * d0, d0


@inner
def solve_patch(x0, y0, x1, y1, x2, y2, c0, c1, c2, g0, h0, g1, h1, g2, h2, pitch, out):
    """Find all contacts of a patch, b0, b1, b2 in each row, into out (4, 3); return their number.

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
        u, v, w = a0 + x * (a1 + x * a2), b0 + x * (b1 + x * b2), d0 + x * (d1 + x * d2)
        total = u + v + w  # not s0 + x (s1 + x s2), which is another number where they cancel
        if total == 0.0:
            continue
        u, v, w = u / total, v / total, w / total
        # A root can be spurious (without pitch, w = 0 is a double one) or lost in rounding (a patch seen edge-on): the
        # contact has to solve the equations themselves.
        facing = u * c0 + v * c1 + w * c2
        if not facing < -1e-12:
            continue
        ratio = pitch / facing
        off = abs(u * x0 + v * x1 + w * x2 + ratio * (u * g0 + v * g1 + w * g2))
        off += abs(u * y0 + v * y1 + w * y2 + ratio * (u * h0 + v * h1 + w * h2))
        if off <= _SOLVED * (1.0 + abs(ratio)) and u >= _INSIDE and v >= _INSIDE and w >= _INSIDE:
            out[count, 0], out[count, 1], out[count, 2] = u, v, w
            count += 1
    return count


@inlined
def _within(s0, s1, s2, out):
    """Write three weights of one sign, up to rounding, as barycentric coordinates into out[0]; return 1, else 0."""
    total = s0 + s1 + s2
    if total == 0.0:
        return 0
    s0, s1, s2 = s0 / total, s1 / total, s2 / total
    if not (s0 >= _INSIDE and s1 >= _INSIDE and s2 >= _INSIDE):
        return 0
    out[0, 0], out[0, 1], out[0, 2] = s0, s1, s2
    return 1


@inlined
def _side(ax, ay, az, bx, by, bz, fx, fy, fz, mx, my, mz):
    """Return the moment of a wrench about the edge from a to b, times its length: F . (a x b) + M . (b - a)."""
    cross = fx * (ay * bz - az * by) + fy * (az * bx - ax * bz) + fz * (ax * by - ay * bx)
    return cross + mx * (bx - ax) + my * (by - ay) + mz * (bz - az)


@inlined
def solve_flat(row, fx, fy, fz, mx, my, mz, out):
    """Find the one contact of a patch with one normal, into out[0]; return 1, or 0 where there is none.

    The torsion drops out of the moment about an edge, since the edge lies across the normal: the rest is the area
    of the triangle between edge and contact, seen along the force. So the wrench meets the facet, at any pitch, if
    its moments about the three edges have one sign.
    """
    x0, y0, z0, x1, y1, z1, x2, y2, z2 = row[0], row[1], row[2], row[6], row[7], row[8], row[12], row[13], row[14]
    s2 = _side(x0, y0, z0, x1, y1, z1, fx, fy, fz, mx, my, mz)
    if s2 > _EDGE:
        return 0
    s0 = _side(x1, y1, z1, x2, y2, z2, fx, fy, fz, mx, my, mz)
    if s0 > _EDGE:
        return 0
    s1 = _side(x2, y2, z2, x0, y0, z0, fx, fy, fz, mx, my, mz)
    if s1 > _EDGE:
        return 0
    return _within(s0, s1, s2, out)


@inlined
def solve_vertex(row, fx, fy, fz, mx, my, mz, out):
    """Find the one contact of a patch at a point v: its normal is along M - v x F, if that is in its cone."""
    x, y, z = row[0], row[1], row[2]
    wx, wy, wz = mx - (y * fz - z * fy), my - (z * fx - x * fz), mz - (x * fy - y * fx)
    ax, ay, az, bx, by, bz, cx, cy, cz = row[3], row[4], row[5], row[9], row[10], row[11], row[15], row[16], row[17]
    s2 = wx * (ay * bz - az * by) + wy * (az * bx - ax * bz) + wz * (ax * by - ay * bx)
    s0 = wx * (by * cz - bz * cy) + wy * (bz * cx - bx * cz) + wz * (bx * cy - by * cx)
    if s0 * s2 < 0.0 and min(abs(s0), abs(s2)) > _EDGE:
        return 0
    s1 = wx * (cy * az - cz * ay) + wy * (cz * ax - cx * az) + wz * (cx * ay - cy * ax)
    return _within(s0, s1, s2, out)
