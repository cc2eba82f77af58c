"""Compiled: contacts, closest points and curvature of surfaces that are an equation f(p) = 0, f < 0 inside.

It is two arguments of every kernel, where a mesh has `nodes` and `corners`:

- equation: the ten coefficients of a quadric in unit size, q'A q + 2 b'q + c as A (xx, yy, zz, xy, xz, yz), b, c; or a
  compiled function that writes value, gradient and Hessian at a point [m];
- table (5 + m, 6): the corners of the box that ends it, in unit size; its centre [m] and scale; in three rows the
  rotation from its own axes, along which the box lies, to the frame in which it is used; then samples of it, positions
  in unit size and unit normals. Everything but input and output is along its own axes.

A soft finger at p with unit normal n makes M = p x F + tau n. Along the force f = F/|F| that is satisfied by
tau = F . M/(F . n), and two equations across it remain: with f = 0, three for p, which Newton solves. On a convex body
their determinant is (f . n)^2 + k^2 K > 0 (K >= 0 the Gaussian curvature), so that the contact moves smoothly with the
wrench, and following it from the axis without pitch, where it is known, always arrives.
"""

# pyright: basic
from __future__ import annotations

import numpy as np

from palpate.surfaces._jit import chosen_for, entry, inlined, inner, released
from palpate.surfaces._vectors import copy_into

__all__ = ["contacts", "curvature", "enter", "evaluate", "nearest", "nearest_points", "nearest_to_line"]

_SCAN = 64  # steps along the axis in search of where it enters a surface of which nothing is known
_ARRIVED = 1e-8  # a Newton step this short, in unit size, is followed by one of its square
_INSIDE = 1e-9  # rounding at the ends of a surface, in unit size
_SAMPLES = 5  # first row of the samples in a table
_SLOPE = 1e-6  # so that of many equally near points one is taken: about an axis of symmetry
_SMOOTH = 2.0  # kind of a candidate, where a patch of a mesh has 0 or 1


def evaluate(equation, table, p, out):
    """Write value 0, gradient 1-3 and Hessian 4-9 (xx, yy, zz, xy, xz, yz) at p (3,), in unit size, into out (10,)."""
    raise NotImplementedError("compiled code only")


@chosen_for(evaluate)
def _evaluate(equation, table, p, out):
    """Choose the quadric's coefficients, or the user's function, by the type of `equation`."""
    return _quadric_evaluate if getattr(equation, "ndim", 0) == 1 else _function_evaluate


def _quadric_evaluate(equation, table, p, out):
    e, x, y, z = equation, p[0], p[1], p[2]
    gx = e[0] * x + e[3] * y + e[4] * z
    gy = e[3] * x + e[1] * y + e[5] * z
    gz = e[4] * x + e[5] * y + e[2] * z
    out[0] = x * (gx + 2.0 * e[6]) + y * (gy + 2.0 * e[7]) + z * (gz + 2.0 * e[8]) + e[9]
    out[1], out[2], out[3] = 2.0 * (gx + e[6]), 2.0 * (gy + e[7]), 2.0 * (gz + e[8])
    for k in range(6):
        out[4 + k] = 2.0 * e[k]


def _function_evaluate(equation, table, p, out):
    scale, metres = table[1, 3], np.empty(3)
    for k in range(3):
        metres[k] = p[k] * scale + table[1, k]
    equation(metres, out)
    for k in range(3):
        out[1 + k] *= scale
    for k in range(6):
        out[4 + k] *= scale * scale


def entries(equation, table, p, f, out):
    """Find where the line p + s f enters the surface: write values of s into out, return their number."""
    raise NotImplementedError("compiled code only")


@chosen_for(entries)
def _entries(equation, table, p, f, out):
    """Choose a quadratic equation, or a search along the line."""
    return _quadric_entries if getattr(equation, "ndim", 0) == 1 else _function_entries


def _quadric_entries(equation, table, p, f, out):
    e = equation
    px, py, pz, fx, fy, fz = p[0], p[1], p[2], f[0], f[1], f[2]
    gx, gy, gz = e[0] * fx + e[3] * fy + e[4] * fz, e[3] * fx + e[1] * fy + e[5] * fz, e[4] * fx + e[5] * fy + e[2] * fz
    bend = fx * gx + fy * gy + fz * gz  # f(p + s f) = bend s^2 + 2 slope s + value
    slope = px * gx + py * gy + pz * gz + e[6] * fx + e[7] * fy + e[8] * fz
    gx, gy, gz = e[0] * px + e[3] * py + e[4] * pz, e[3] * px + e[1] * py + e[5] * pz, e[4] * px + e[5] * py + e[2] * pz
    value = px * (gx + 2.0 * e[6]) + py * (gy + 2.0 * e[7]) + pz * (gz + 2.0 * e[8]) + e[9]
    square = slope * slope - bend * value
    if not square > 0.0:
        return 0
    root = np.sqrt(square)  # entering, f falls: of the two roots the one with bend s + slope = -root
    s = -(slope + root) / bend if slope > 0.0 else value / (root - slope)
    if not np.isfinite(s):
        return 0
    out[0] = s
    return 1


def _function_entries(equation, table, p, f, out):
    off, along = 0.0, 0.0
    for k in range(3):
        off += p[k] * p[k]
        along += p[k] * f[k]
    reach = 1.0001 - (off - along * along)  # the box lies in the unit ball
    if reach <= 0.0:
        return 0
    half = np.sqrt(reach)
    begin, step = -along - half, 2.0 * half / _SCAN
    work, spot = np.empty(10), np.empty(3)
    before = np.inf
    count = 0
    for i in range(_SCAN + 1):
        s = begin + i * step
        for k in range(3):
            spot[k] = p[k] + s * f[k]
        evaluate(equation, table, spot, work)
        if before >= 0.0 and work[0] < 0.0 and i > 0 and count < len(out):
            out[count] = _entry_between(equation, table, p, f, s - step, s)
            count += 1
        before = work[0]
    return count


@inner
def _entry_between(equation, table, p, f, left, right):
    """Return the root between a point outside and one inside: Newton, kept in the interval by bisection."""
    work, spot = np.empty(10), np.empty(3)
    s = 0.5 * (left + right)
    for _ in range(60):
        for k in range(3):
            spot[k] = p[k] + s * f[k]
        evaluate(equation, table, spot, work)
        if work[0] >= 0.0:
            left = s
        else:
            right = s
        slope = work[1] * f[0] + work[2] * f[1] + work[3] * f[2]
        trial = s - work[0] / slope if slope < 0.0 else left
        if not (left < trial < right):
            trial = 0.5 * (left + right)
        if abs(trial - s) < 1e-14:
            return trial
        s = trial
    return s


@inner
def _inward(table, v, out):
    """Turn a direction of the frame into the surface's own axes."""
    for k in range(3):
        out[k] = table[2, k] * v[0] + table[3, k] * v[1] + table[4, k] * v[2]


@inner
def _outward(table, v, out):
    """Turn a direction along the surface's own axes into the frame."""
    for k in range(3):
        out[k] = table[2 + k, 0] * v[0] + table[2 + k, 1] * v[1] + table[2 + k, 2] * v[2]


@inner
def _times(h, v, out):
    """Multiply a symmetric matrix, as `evaluate` writes it from 4 on, by v (3,)."""
    out[0] = h[4] * v[0] + h[7] * v[1] + h[8] * v[2]
    out[1] = h[7] * v[0] + h[5] * v[1] + h[9] * v[2]
    out[2] = h[8] * v[0] + h[9] * v[1] + h[6] * v[2]


@inlined
def _row(sx, sy, sz, fx, fy, fz, nx, ny, nz, h, size, tau, c):
    """Return the derivative by p of the residual moment along a side (sx, sy, sz) across f, c = f . n."""
    tilt = (nx * sx + ny * sy + nz * sz) / c
    vx, vy, vz = tau * (sx - tilt * fx), tau * (sy - tilt * fy), tau * (sz - tilt * fz)
    inward = nx * vx + ny * vy + nz * vz  # S'v, with S' = H (1 - n n')/|gradient|
    vx, vy, vz = (vx - inward * nx) / size, (vy - inward * ny) / size, (vz - inward * nz) / size
    return (
        fz * sy - fy * sz - (h[4] * vx + h[7] * vy + h[8] * vz),
        fx * sz - fz * sx - (h[7] * vx + h[5] * vy + h[9] * vz),
        fy * sx - fx * sy - (h[8] * vx + h[9] * vy + h[6] * vz),
    )


@inner
def _settle(equation, table, f, m, p, h):
    """Solve for the soft finger's contact by Newton, from p in place. Return False if it fails or does not press."""
    fx, fy, fz, mx, my, mz = f[0], f[1], f[2], m[0], m[1], m[2]
    sign = 1.0 if fz >= 0.0 else -1.0  # two unit vectors across f
    k = -1.0 / (sign + fz)
    g = fx * fy * k
    ux, uy, uz = 1.0 + sign * fx * fx * k, sign * g, -sign * fx
    vx, vy, vz = g, sign + fy * fy * k, -fy
    along = fx * mx + fy * my + fz * mz
    for _ in range(12):
        evaluate(equation, table, p, h)
        size = np.sqrt(h[1] * h[1] + h[2] * h[2] + h[3] * h[3])
        nx, ny, nz = h[1] / size, h[2] / size, h[3] / size
        c = fx * nx + fy * ny + fz * nz
        if not c < -1e-9:
            return False
        tau = along / c
        rx = mx - (p[1] * fz - p[2] * fy) - tau * nx
        ry = my - (p[2] * fx - p[0] * fz) - tau * ny
        rz = mz - (p[0] * fy - p[1] * fx) - tau * nz
        ax, ay, az = _row(ux, uy, uz, fx, fy, fz, nx, ny, nz, h, size, tau, c)
        bx, by, bz = _row(vx, vy, vz, fx, fy, fz, nx, ny, nz, h, size, tau, c)
        ra, rb, rc = -(ux * rx + uy * ry + uz * rz), -(vx * rx + vy * ry + vz * rz), -h[0] / size
        # Cramer: x = (rc a x b + ra b x n + rb n x a)/det
        x, y, z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        det = x * nx + y * ny + z * nz
        x = (rc * x + ra * (by * nz - bz * ny) + rb * (ny * az - nz * ay)) / det
        y = (rc * y + ra * (bz * nx - bx * nz) + rb * (nz * ax - nx * az)) / det
        z = (rc * z + ra * (bx * ny - by * nx) + rb * (nx * ay - ny * ax)) / det
        square = x * x + y * y + z * z
        if not np.isfinite(square):
            return False
        shorter = 0.3 / np.sqrt(square) if square > 0.09 else 1.0
        p[0] += shorter * x
        p[1] += shorter * y
        p[2] += shorter * z
        if square < _ARRIVED * _ARRIVED:
            return True
    return False


@inner
def _follow(equation, table, f, begin, end, p, h):
    """Follow the contact at p from its moment `begin` to `end`, in place. Return False where the path breaks off."""
    x, y, z = p[0], p[1], p[2]
    if _settle(equation, table, f, end, p, h):  # nearly always in one go
        return True
    p[0], p[1], p[2] = x, y, z
    trial, m = np.empty(3), np.empty(3)
    done, step = 0.0, 0.3
    for _ in range(60):
        for k in range(3):
            m[k] = begin[k] + (done + step) * (end[k] - begin[k])
            trial[k] = p[k]
        if _settle(equation, table, f, m, trial, h):
            copy_into(trial, p)
            done += step
            if done >= 1.0:
                return True
            step = min(2.0 * step, 1.0 - done)
        else:
            step *= 0.3
            if step < 1e-5:
                return False
    return False


@inner
def _facing(table, f):
    """Return the row of the sample that faces the force most squarely."""
    best, most = _SAMPLES, np.inf
    for i in range(_SAMPLES, len(table)):
        c = f[0] * table[i, 3] + f[1] * table[i, 4] + f[2] * table[i, 5]
        if c < most:
            best, most = i, c
    return best


@inner
def _note(equation, table, f, p, h, limit, found, count):
    """Write a contact as `_bvh.search` does, unless it is off the ends, beyond the limit or there already."""
    if count == len(found) - 1:
        return count
    for k in range(3):
        if not table[0, k] - _INSIDE <= p[k] <= table[0, 3 + k] + _INSIDE:
            return count
    evaluate(equation, table, p, h)
    size = np.sqrt(h[1] * h[1] + h[2] * h[2] + h[3] * h[3])
    c = (f[0] * h[1] + f[1] * h[2] + f[2] * h[3]) / size
    tangent = np.sqrt(max(0.0, 1.0 - c * c)) / -c
    if not c < -1e-12 or tangent > limit:
        return count
    row = found[count]
    _place(table, p, h, row)
    for i in range(count):
        if (found[i, 8] - row[8]) ** 2 + (found[i, 9] - row[9]) ** 2 + (found[i, 10] - row[10]) ** 2 < 1e-14:
            return count
    row[4] = tangent
    row[5] = f[0] * p[0] + f[1] * p[1] + f[2] * p[2]
    return count + 1


@inner
def _place(table, p, h, row):
    """Write position and unit normal of a point, evaluated to h, into a candidate."""
    size = np.sqrt(h[1] * h[1] + h[2] * h[2] + h[3] * h[3])
    row[:8] = 0.0
    row[6] = _SMOOTH
    _outward(table, p, row[8:11])
    _outward(table, h[1:4], row[11:14])
    for k in range(11, 14):
        row[k] /= size


@inner
def _axis(wrench, table, soft, f, m, bare, p):
    """Compute from a wrench its direction f, m = M/|F|, m without its part along f, and a point p; return the pitch."""
    force = np.sqrt(wrench[0] ** 2 + wrench[1] ** 2 + wrench[2] ** 2)
    pitch = 0.0
    _inward(table, wrench[:3], f)
    _inward(table, wrench[3:], m)
    for k in range(3):
        f[k] /= force
        m[k] /= force
    for k in range(3):
        pitch += f[k] * m[k]
    for k in range(3):
        bare[k] = m[k] - pitch * f[k]
    p[0], p[1], p[2] = f[1] * m[2] - f[2] * m[1], f[2] * m[0] - f[0] * m[2], f[0] * m[1] - f[1] * m[0]
    if soft == 0.0:
        copy_into(bare, m)
    return pitch * soft


@entry("wrench 6, soft float, tan_limit float, equation 10 | function, table s 6 | s 6, found out 17 14")
def contacts(wrench, soft, tan_limit, equation, table, found):
    """Find a wrench's contacts like `_bvh.search`, in unit size, into rows of found; return their number.

    On a convex body that is its one contact, at any pitch. Elsewhere: those reached from where the axis enters the
    surface, and where it does not, from the point that faces the force most squarely.
    """
    work = np.empty((5, 3))
    f, m, bare, a, p, h = work[0], work[1], work[2], work[3], work[4], np.empty(10)
    pitch = _axis(wrench, table, soft, f, m, bare, a)
    count = 0
    places = found[len(found) - 1]
    for i in range(entries(equation, table, a, f, places)):
        for k in range(3):
            p[k] = a[k] + places[i] * f[k]
        if pitch == 0.0 or _follow(equation, table, f, bare, m, p, h):
            count = _note(equation, table, f, p, h, tan_limit, found, count)
    if count == 0 and pitch != 0.0:
        best = _facing(table, f)
        copy_into(table[best], p)
        bare[0], bare[1], bare[2] = p[1] * f[2] - p[2] * f[1], p[2] * f[0] - p[0] * f[2], p[0] * f[1] - p[1] * f[0]
        if _follow(equation, table, f, bare, m, p, h):
            count = _note(equation, table, f, p, h, tan_limit, found, count)
    return count


@inner
def curvature(equation, table, p, t, out):
    """Compute the shape operator at p (3,), in unit size, in tangents t (2, 3): dn = S dp, into out (2, 2) [1/m]."""
    h, work, own = np.empty(10), np.empty(3), np.empty((3, 3))
    _inward(table, p, own[2])
    evaluate(equation, table, own[2], h)
    size = np.sqrt(h[1] * h[1] + h[2] * h[2] + h[3] * h[3]) * table[1, 3]
    for j in range(2):
        _inward(table, t[j], own[j])
    for j in range(2):
        _times(h, own[j], work)
        for i in range(2):
            out[i, j] = (own[i, 0] * work[0] + own[i, 1] * work[1] + own[i, 2] * work[2]) / size


@inner
def _eliminate(a):
    """Solve four equations, a (4, 5), in place; the answer is in its last column. Return False if singular."""
    for i in range(4):
        pivot = i
        for j in range(i + 1, 4):
            if abs(a[j, i]) > abs(a[pivot, i]):
                pivot = j
        if not abs(a[pivot, i]) > 1e-300:
            return False
        for k in range(i, 5):
            a[i, k], a[pivot, k] = a[pivot, k], a[i, k]
        for j in range(4):
            if j != i and a[j, i] != 0.0:
                factor = a[j, i] / a[i, i]
                for k in range(i, 5):
                    a[j, k] -= factor * a[i, k]
    for i in range(4):
        a[i, 4] /= a[i, i]
    return True


@inner
def _pull(metric, p, q, out):
    """Compute the gradient Q (p - q) of half the squared distance into out; return the squared distance."""
    square = 0.0
    for i in range(3):
        out[i] = 0.0
        for k in range(3):
            out[i] += metric[i, k] * (p[k] - q[k])
        square += out[i] * (p[i] - q[i])
    return square


@inner
def nearest(equation, table, metric, q, f, p):
    """Find the point of a surface, within its ends, nearest to q in a metric Q (3, 3); with f not 0, where f . n < 0.

    From the nearest sample, by Newton on Q (p - q) + lambda gradient = 0, value = 0 with the coordinates that have met
    the box kept there. Write it into p (3,); return the squared distance, inf where no sample faces f.
    """
    h, pull, held = np.empty(10), np.empty(3), np.zeros(3)
    a = np.empty((4, 5))
    start, least = -1, np.inf
    for i in range(_SAMPLES, len(table)):
        if (f[0] != 0.0 or f[1] != 0.0 or f[2] != 0.0) and (
            f[0] * table[i, 3] + f[1] * table[i, 4] + f[2] * table[i, 5] >= 0.0
        ):
            continue
        square = _pull(metric, table[i, :3], q, pull)
        if square < least:
            start, least = i, square
    if start < 0:
        return np.inf
    copy_into(table[start], p)
    for _ in range(60):
        evaluate(equation, table, p, h)
        _pull(metric, p, q, pull)
        along, square = 0.0, 0.0
        for k in range(3):
            if held[k] == 0.0:
                along += h[1 + k] * pull[k]
                square += h[1 + k] * h[1 + k]
        multiplier = -along / square
        for i in range(3):
            for k in range(3):
                bend = h[4 + i] if i == k else h[6 + i + k]  # xy 7, xz 8, yz 9
                a[i, k] = metric[i, k] + multiplier * bend + (_SLOPE if i == k else 0.0)
            a[i, 3], a[3, i], a[i, 4] = h[1 + i], h[1 + i], -pull[i]
            if held[i] != 0.0:
                a[i, :] = 0.0
                a[i, i] = 1.0
        a[3, 3], a[3, 4] = 0.0, -h[0]
        if not _eliminate(a):
            break
        step = np.sqrt(a[0, 4] ** 2 + a[1, 4] ** 2 + a[2, 4] ** 2)
        if not np.isfinite(step):
            break
        shorter = 0.2 / step if step > 0.2 else 1.0
        settled = step < 1e-12
        for k in range(3):
            p[k] += shorter * a[k, 4]
            if p[k] < table[0, k]:
                p[k], held[k], settled = table[0, k], -1.0, False
            elif p[k] > table[0, 3 + k]:
                p[k], held[k], settled = table[0, 3 + k], 1.0, False
        if settled:
            inside = True
            for k in range(3):
                if held[k] * (pull[k] + a[3, 4] * h[1 + k]) > 1e-9:  # it is pulled back inside
                    held[k], inside = 0.0, False
            if inside:
                break
    square = _pull(metric, p, q, pull)
    evaluate(equation, table, p, h)
    if not square <= least + 1e-12 or abs(h[0]) > 1e-6 * np.sqrt(h[1] * h[1] + h[2] * h[2] + h[3] * h[3]):
        copy_into(table[start], p)
        return least
    return square


@released("points n 3, equation 10 | function, table s 6 | s 6, out out n 6")
def nearest_points(points, equation, table, out):
    """Find the surface's closest point to each point (n, 3), in unit size, and its unit normal, into out (n, 6)."""
    metric, free, h = np.eye(3), np.zeros(3), np.empty(10)
    for i in range(len(points)):
        nearest(equation, table, metric, points[i], free, out[i, :3])
        evaluate(equation, table, out[i, :3], h)
        size = np.sqrt(h[1] * h[1] + h[2] * h[2] + h[3] * h[3])
        for k in range(3):
            out[i, 3 + k] = h[1 + k] / size


@inner
def nearest_to_line(wrench, equation, table, found):
    """Find the point nearest to the wrench axis that faces the force, as `_nearest.nearest_to_axis` does."""
    f, m, bare, a, p = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    metric, h = np.empty((3, 3)), np.empty(10)
    _axis(wrench, table, 0.0, f, m, bare, a)
    for i in range(3):
        for k in range(3):
            metric[i, k] = (1.0 if i == k else 0.0) - f[i] * f[k]
    square = nearest(equation, table, metric, a, f, p)
    if square == np.inf:
        return np.inf
    evaluate(equation, table, p, h)
    _place(table, p, h, found)
    return np.sqrt(max(0.0, square))


@released("origins n 3, directions n 3, equation 10 | function, table s 6 | s 6, out out n 3")
def enter(origins, directions, equation, table, out):
    """Find where lines (n, 3), in unit size, first enter the surface, into out (n, 3); NaN where they do not."""
    steps = np.empty(4)
    for i in range(len(origins)):
        out[i] = np.nan
        if entries(equation, table, origins[i], directions[i], steps) > 0:
            for k in range(3):
                out[i, k] = origins[i, k] + steps[0] * directions[i, k]
