"""The contacts of one wrench on one patch, in closed form.

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

from palpate.surfaces._jit import inner

__all__ = ["solve_flat", "solve_patch"]

_INSIDE = -1e-8  # how far outside its patch a solution may lie, in barycentric units: rounding at shared edges
_SOLVED = 1e-7  # how far off the shifted axis a contact may lie, in unit size


@inner
def _cubic(k0, k1, k2, k3, x):
    return k0 + x * (k1 + x * (k2 + x * k3))


@inner
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
        if abs(trial - x) <= 1e-15 + 1e-13 * abs(x) or not left < trial < right:
            return trial
        x = trial
    return x


@inner
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


@inner
def _weights(qj0, qj1, qk0, qk1, gj0, gj1, gk0, gk1, pitch, base):
    """One component of B(base + x) as coefficients of 1, x, x^2."""
    d0 = qj0 * qk1 - qk0 * qj1
    d1 = pitch * (qj0 * gk1 - qk0 * gj1 + gj0 * qk1 - gk0 * qj1)
    d2 = pitch * pitch * (gj0 * gk1 - gk0 * gj1)
    return d2 + base * (d1 + base * d0), d1 + 2.0 * base * d0, d0


@inner
def solve_patch(x0, y0, x1, y1, x2, y2, c0, c1, c2, g0, h0, g1, h1, g2, h2, pitch, out):
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
        if total == 0.0:
            continue
        u = (a0 + x * (a1 + x * a2)) / total
        v = (b0 + x * (b1 + x * b2)) / total
        w = (d0 + x * (d1 + x * d2)) / total
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


@inner
def solve_flat(x0, y0, x1, y1, x2, y2, sx, sy, out):
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
