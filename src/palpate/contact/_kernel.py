"""Compiled: from one wrench to one row of an estimate (`estimate.ROW`), and the loop over many.

A contact at p with unit normal n and torsion tau satisfies M - p x F - tau n = 0 with tau = F . M/(F . n). Differentiated
along the surface, dn = S dp with S the shape operator, and projected on two tangents t_a:

    (F . n) J dp - tau S dp = t . (-dM + p x dF),   J = [[0, -1], [1, 0]],

so dp/dW is a 2 x 2 solve, and the covariance of p is that of W carried through it: rank 2, in the tangent plane. On facets,
edges and corners S is 0: there the plane across n stands for the surface, which errs to the wide side.
"""

# pyright: basic
from __future__ import annotations

import numpy as np

from palpate.surfaces._bvh import CANDIDATE, CAPACITY, _compiled, nearest_to_axis, search

__all__ = ["SETTINGS", "STATE", "estimate", "estimate_many"]

# settings: what a Locator was made with, as numbers
SETTINGS = 10
CENTRE, SCALE, SOFT, FRICTION, TORSION, ON, OFF, NOISY = 0, 3, 4, 5, 6, 7, 8, 9
# state: what one sample leaves to the next
STATE = 5
TOUCHING, HAS_PREVIOUS, PREVIOUS = 0, 1, 2

_CHI2_95 = 5.991464547107979  # two degrees of freedom
_CONTACT, _AMBIGUOUS, _NO_CONTACT, _TOO_LIGHT, _OFF_SURFACE, _IMPLAUSIBLE, _INVALID = 0, 1, 2, 3, 4, 5, 7
_RESIDUAL, _CANDIDATES, _STATUS, _LENGTH = 19, 20, 21, 22  # estimate._Row, which compiled code cannot read
_STEPS = 30  # of the search for the nearest wrench within the bounds


@_compiled()
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@_compiled()
def _cross_into(a, b, out):
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@_compiled()
def _tangents(n, out):
    """Two unit vectors across n, right-handed with it (Duff et al. 2017), into out (2, 3)."""
    sign = 1.0 if n[2] >= 0.0 else -1.0
    a = -1.0 / (sign + n[2])
    b = n[0] * n[1] * a
    out[0, 0], out[0, 1], out[0, 2] = 1.0 + sign * n[0] * n[0] * a, sign * b, -sign * n[0]
    out[1, 0], out[1, 1], out[1, 2] = b, sign + n[1] * n[1] * a, -n[1]


@_compiled()
def _shape(row, b, n, t, scale, out):
    """Shape operator of a patch with interpolated normals in the tangents t: dn = S dp, into out (2, 2) [1/m]."""
    a, d = np.empty((2, 2)), np.empty((2, 2))  # tangential parts of the edges and of the change of the normal
    length = 0.0
    for k in range(3):
        length += (b[0] * row[3 + k] + b[1] * row[9 + k] + b[2] * row[15 + k]) * n[k]
    for i in range(2):
        for j in range(2):
            o = 6 * (j + 1)
            a[i, j] = d[i, j] = 0.0
            for k in range(3):
                a[i, j] += t[i, k] * (row[o + k] - row[k]) * scale
                d[i, j] += t[i, k] * (row[o + 3 + k] - row[3 + k]) / length
    det = a[0, 0] * a[1, 1] - a[0, 1] * a[1, 0]
    if det == 0.0:
        out[:] = 0.0
        return
    out[0, 0] = (d[0, 0] * a[1, 1] - d[0, 1] * a[1, 0]) / det
    out[0, 1] = (d[0, 1] * a[0, 0] - d[0, 0] * a[0, 1]) / det
    out[1, 0] = (d[1, 0] * a[1, 1] - d[1, 1] * a[1, 0]) / det
    out[1, 1] = (d[1, 1] * a[0, 0] - d[1, 0] * a[0, 1]) / det


@_compiled()
def _slopes(wrench, p, n, t, shape, soft, slopes):
    """d(p . t)/dW into slopes (2, 6). False where the wrench does not determine the point.

    For the wrench axis (soft = 0) the moment left over is along F instead of n: the same equations, projected across
    F instead of across n, with the pitch in the place of tau S.
    """
    force, moment = wrench[:3], wrench[3:]
    across = t
    tau, pitch = 0.0, 0.0
    if soft == 1.0:
        tau = _dot(force, moment) / _dot(force, n)
    else:
        unit = force / np.sqrt(_dot(force, force))
        across = np.empty((2, 3))
        _tangents(unit, across)
        pitch = _dot(force, moment) / _dot(force, force)
    work, right = np.empty(3), np.empty((2, 6))
    g = np.empty((2, 2))
    for a in range(2):
        for c in range(2):
            _cross_into(force, t[c], work)
            g[a, c] = _dot(across[a], work) - soft * tau * shape[a, c]
        _cross_into(across[a], p, work)  # t . (p x dF) = (t x p) . dF
        for k in range(3):
            right[a, k] = work[k] + pitch * across[a, k]
            right[a, 3 + k] = -across[a, k]
    det = g[0, 0] * g[1, 1] - g[0, 1] * g[1, 0]
    if abs(det) < 1e-14 * _dot(force, force):
        return False
    for k in range(6):
        slopes[0, k] = (g[1, 1] * right[0, k] - g[0, 1] * right[1, k]) / det
        slopes[1, k] = (g[0, 0] * right[1, k] - g[1, 0] * right[0, k]) / det
    return True


@_compiled()
def _sandwich(left, middle, right):
    """left (i, 6) middle (6, 6) right (j, 6)^T, small and without a call into BLAS."""
    out = np.zeros((len(left), len(right)))
    half = np.empty(6)
    for i in range(len(left)):
        for k in range(6):
            total = 0.0
            for m in range(6):
                total += left[i, m] * middle[m, k]
            half[k] = total
        for j in range(len(right)):
            total = 0.0
            for k in range(6):
                total += half[k] * right[j, k]
            out[i, j] = total
    return out


@_compiled()
def _torsion(wrench, p, n, soft):
    """Torque about the normal, (M - p x F) . n, and F . n."""
    pressing = _dot(wrench[:3], n)
    if soft == 1.0:
        return _dot(wrench[:3], wrench[3:]) / pressing, pressing
    work = np.empty(3)
    _cross_into(p, wrench[:3], work)
    return _dot(wrench[3:], n) - _dot(work, n), pressing


@_compiled()
def _contact(candidate, settings, place):
    """A candidate in metres: p and n into place (6,)."""
    for k in range(3):
        place[k] = candidate[8 + k] * settings[SCALE] + settings[CENTRE + k]
        place[3 + k] = candidate[11 + k]


@_compiled()
def _to_unit(wrench, settings, out):
    """The wrench about the tree's centre, in its unit size."""
    work = np.empty(3)
    _cross_into(settings[CENTRE : CENTRE + 3], wrench[:3], work)
    for k in range(3):
        out[k] = wrench[k]
        out[3 + k] = (wrench[3 + k] - work[k]) / settings[SCALE]


@_compiled()
def _sensitivity(wrench, candidate, place, corners, settings, t, shape, slopes):
    """Tangents, shape operator and slopes of a candidate. False where the point is not determined."""
    n = place[3:]
    _tangents(n, t)
    if candidate[6] == 1.0 and settings[SOFT] == 1.0:
        _shape(corners[int(candidate[0])], candidate[1:4], n, t, settings[SCALE], shape)
    else:
        shape[:] = 0.0
    return _slopes(wrench, place[:3], n, t, shape, settings[SOFT], slopes)


@_compiled()
def _solve_two(matrix, right, count):
    """right^T matrix^-1 right and the solution, for one or two equations; (-1, 0, 0) when singular."""
    if count == 1:
        if matrix[0, 0] <= 0.0:
            return -1.0, 0.0, 0.0
        x = right[0] / matrix[0, 0]
        return right[0] * x, x, 0.0
    det = matrix[0, 0] * matrix[1, 1] - matrix[0, 1] * matrix[1, 0]
    if det <= 1e-14 * matrix[0, 0] * matrix[1, 1] or det <= 0.0:
        return -1.0, 0.0, 0.0
    x = (matrix[1, 1] * right[0] - matrix[0, 1] * right[1]) / det
    y = (matrix[0, 0] * right[1] - matrix[1, 0] * right[0]) / det
    return right[0] * x + right[1] * y, x, y


@_compiled()
def _bounds(wrench, place, t, shape, slopes, settings, values, rows):
    """The friction and the torsion bound, tan(theta) - mu and |tau| - c |F . n|, and their slopes by W (2, 6)."""
    force, moment, n = wrench[:3], wrench[3:], place[3:]
    size = np.sqrt(_dot(force, force))
    pressing = _dot(force, n)
    cosine = -pressing / size
    sine = np.sqrt(max(1e-300, 1.0 - cosine * cosine))
    tau = _dot(force, moment) / pressing
    values[0] = sine / cosine - settings[FRICTION]
    values[1] = abs(tau) - settings[TORSION] * abs(pressing)
    sign = 1.0 if tau >= 0.0 else -1.0
    turn = np.zeros(6)  # F . dn
    for k in range(6):
        for i in range(2):
            dn = shape[i, 0] * slopes[0, k] + shape[i, 1] * slopes[1, k]
            turn[k] += _dot(force, t[i]) * dn
    for k in range(6):
        dpress = turn[k] + (n[k] if k < 3 else 0.0)
        dsize = force[k] / size if k < 3 else 0.0
        dcos = -dpress / size - cosine * dsize / size
        rows[0, k] = -dcos / (cosine * cosine * sine)
        dboth = moment[k] if k < 3 else force[k - 3]
        rows[1, k] = sign * (dboth - tau * dpress) / pressing + settings[TORSION] * dpress


@_compiled()
def _inverse(matrix):
    """Inverse of a 6 x 6 covariance by Gauss and Jordan; NaN where it has none."""
    size = len(matrix)
    work, out = matrix.copy(), np.eye(size)
    for i in range(size):
        pivot = work[i, i]
        if not pivot > 0.0:
            out[:] = np.nan
            return out
        for k in range(size):
            work[i, k] /= pivot
            out[i, k] /= pivot
        for j in range(size):
            factor = work[j, i]
            if j != i and factor != 0.0:
                for k in range(size):
                    work[j, k] -= factor * work[i, k]
                    out[j, k] -= factor * out[i, k]
    return out


@_compiled()
def _allowed(wrench, place, settings, out):
    """A wrench that a contact within the bounds makes at this point, near the given one. False if it only pulls."""
    force, n = wrench[:3], place[3:]
    mu, normal = settings[FRICTION], -_dot(force, n)
    side = np.empty(3)
    for k in range(3):
        side[k] = force[k] + normal * n[k]
    slip = np.sqrt(_dot(side, side))
    grip = normal
    if slip > mu * normal:  # onto the friction cone, along the shortest way
        grip = (normal + mu * slip) / (1.0 + mu * mu)
        if grip <= 0.0:
            return False
    keep = 1.0 if slip <= mu * normal else mu * grip / slip
    for k in range(3):
        out[k] = keep * side[k] - grip * n[k]
    _cross_into(place[:3], out[:3], out[3:])
    _cross_into(place[:3], force, side)
    tau = _dot(wrench[3:], n) - _dot(side, n)
    most = settings[TORSION] * grip
    tau = min(most, max(-most, tau))
    for k in range(3):
        out[3 + k] += tau * n[k]
    return True


@_compiled()
def _metric(a, b, inverse):
    """sqrt((a - b)' inverse (a - b))."""
    total = 0.0
    for i in range(6):
        for j in range(6):
            total += (a[i] - b[i]) * inverse[i, j] * (a[j] - b[j])
    return np.sqrt(max(0.0, total))


@_compiled()
def _distance_to_bounds(wrench, noise, nodes, corners, tags, settings, first, place):
    """Distance in the metric of `noise` from a wrench to the nearest that a contact within the bounds can make.

    Where the point lies is a function of the wrench, so the bounds are two functions g(W), and the nearest W' with
    g(W') <= 0 is found by the damped iteration of Hasofer, Lind, Rackwitz and Fiessler, y <- S A' (A S A')^-1 (A y - g).
    Every step also gives a contact within the bounds; the nearest of those is returned, so that the figure is one that
    a contact really attains, and where the iteration does not settle (on facets g jumps) it errs to the large side.
    """
    t, shape, slopes = np.empty((2, 3)), np.empty((2, 2)), np.empty((2, 6))
    values, rows, active = np.empty(2), np.empty((2, 6)), np.zeros((2, 6))
    right, near = np.empty(2), np.empty(6)
    current, unit, spot = wrench.copy(), np.empty(6), place.copy()
    found, candidate = np.empty((CAPACITY + 1, CANDIDATE)), first.copy()
    inverse = _inverse(noise)
    best, step_size = np.inf, 1.0
    use0 = use1 = False
    for step in range(_STEPS):
        if step > 0:
            _to_unit(current, settings, unit)
            count = search(unit, settings[SOFT], 0.5 + 2.0 * candidate[4], nodes, corners, tags, found)
            if count == 0:
                break
            chosen = 0
            for i in range(1, count):
                if found[i, 4] < found[chosen, 4]:
                    chosen = i
            candidate[:] = found[chosen]
            _contact(candidate, settings, spot)
        if _allowed(current, spot, settings, near):
            distance = _metric(wrench, near, inverse)
            if distance > 0.995 * best:
                step_size *= 0.5
            best = min(best, distance)
            if step_size < 0.2:
                break
        if not _sensitivity(current, candidate, spot, corners, settings, t, shape, slopes):
            break
        _bounds(current, spot, t, shape, slopes, settings, values, rows)
        use0, use1 = use0 or values[0] > 0.0, use1 or values[1] > 0.0
        count = 0
        for i in range(2):
            if (i == 0 and use0) or (i == 1 and use1):
                active[count] = rows[i]
                right[count] = -values[i]
                for k in range(6):
                    right[count] += rows[i, k] * (current[k] - wrench[k])
                count += 1
        square, x, y = _solve_two(_sandwich(active[:count], noise, active[:count]), right, count)
        if square < 0.0:
            break
        for k in range(6):
            target = wrench[k]
            for m in range(6):
                target += noise[k, m] * (active[0, m] * x + (active[1, m] * y if count == 2 else 0.0))
            current[k] += step_size * (target - current[k])
        if _dot(current[:3], current[:3]) == 0.0:
            break
    return best if best < np.inf else np.nan


@_compiled()
def _distance_to_point(wrench, noise, place):
    """Distance from a wrench to the nearest that a soft finger at a given point can make: two linear equations."""
    t, work, rows, right = np.empty((2, 3)), np.empty(3), np.empty((2, 6)), np.empty(2)
    _tangents(place[3:], t)
    for a in range(2):
        _cross_into(t[a], place[:3], work)
        for k in range(3):
            rows[a, k], rows[a, 3 + k] = -work[k], t[a, k]
        right[a] = 0.0
        for k in range(6):
            right[a] += rows[a, k] * wrench[k]
    square, _, _ = _solve_two(_sandwich(rows, noise, rows), right, 2)
    return np.sqrt(square) if square >= 0.0 else np.nan


@_compiled()
def _better(found, i, j):
    """Is candidate i to be preferred to j: met first along the force from outside, then smaller friction angle?

    Met first comes first because what presses stands on the side that the force comes from: on the three real probes it picks
    the right one of several 96-98 times in 100, the friction angle 80-98 (docs/evidence.md).
    """
    gap = found[i, 5] - found[j, 5]
    if abs(gap) > 1e-9:
        return gap < 0.0
    return found[i, 4] < found[j, 4]


@_compiled()
def _choose(wrench, settings, state, found, count, places, torques):
    """Which candidate is the answer, how many lie within the bounds; those outside the torsion bound get kind < 0."""
    best, plausible, nearest = -1, 0, np.inf
    for i in range(count):
        _contact(found[i], settings, places[i])
        torques[i], pressing = _torsion(wrench, places[i, :3], places[i, 3:], settings[SOFT])
        within = found[i, 4] <= settings[FRICTION] and abs(torques[i]) <= settings[TORSION] * abs(pressing)
        found[i, 7] = 1.0 if within else 0.0
        if not within:
            continue
        plausible += 1
        if state[HAS_PREVIOUS] == 1.0:
            gap = 0.0
            for k in range(3):
                gap += (places[i, k] - state[PREVIOUS + k]) ** 2
            if gap < nearest:
                best, nearest = i, gap
        elif best < 0 or _better(found, i, best):
            best = i
    if best < 0:
        for i in range(count):
            if best < 0 or _better(found, i, best):
                best = i
    return best, plausible


@_compiled()
def _ambiguous(found, places, count, best, t, spread, noisy):
    """Does another plausible candidate lie outside the 95 % ellipse of the one chosen?"""
    det = spread[0, 0] * spread[1, 1] - spread[0, 1] * spread[1, 0]
    for i in range(count):
        if i == best or found[i, 7] == 0.0:
            continue
        if not noisy or not det > 0.0:
            return True
        off = places[i, :3] - places[best, :3]
        x, y, z = _dot(off, t[0]), _dot(off, t[1]), _dot(off, places[best, 3:])
        square = (spread[1, 1] * x * x - 2.0 * spread[0, 1] * x * y + spread[0, 0] * y * y) / det
        if square > _CHI2_95 or z * z > _CHI2_95 * (spread[0, 0] + spread[1, 1]):
            return True
    return False


@_compiled()
def _gate(wrench, settings, state):
    """Status before anything is located, or CONTACT; moves the hysteresis."""
    total = 0.0
    for k in range(6):
        total += wrench[k]
    if not np.isfinite(total):
        return _INVALID
    force = np.sqrt(_dot(wrench[:3], wrench[:3]))
    if force >= settings[ON] and force > 0.0:
        state[TOUCHING] = 1.0
    elif force < settings[OFF] or force == 0.0:
        state[TOUCHING] = 0.0
        return _NO_CONTACT
    return _CONTACT if state[TOUCHING] == 1.0 else _TOO_LIGHT


@_compiled()
def estimate(wrench, noise, nodes, corners, tags, settings, state, row):
    """One wrench (6,) with covariance (6, 6) in the surface's frame to one row of `estimate.ROW`."""
    row[:] = np.nan
    row[_CANDIDATES] = 0.0
    status = _gate(wrench, settings, state)
    row[_STATUS] = status
    if status == _INVALID:
        return
    row[6:9] = wrench[:3]
    if status != _CONTACT:
        state[HAS_PREVIOUS] = 0.0
        return
    unit, found = np.empty(6), np.empty((CAPACITY + 1, CANDIDATE))
    _to_unit(wrench, settings, unit)
    count = search(unit, settings[SOFT], settings[FRICTION], nodes, corners, tags, found)
    if count == 0:
        count = search(unit, settings[SOFT], np.inf, nodes, corners, tags, found)
    noisy = settings[NOISY] == 1.0
    if count == 0:
        _off_surface(wrench, unit, noise, nodes, corners, tags, settings, noisy, found, row)
        return
    places, torques = np.empty((count, 6)), np.empty(count)
    best, plausible = _choose(wrench, settings, state, found, count, places, torques)
    place = places[best]
    row[:6] = place
    row[9] = torques[best]
    t, shape, slopes = np.empty((2, 3)), np.empty((2, 2)), np.empty((2, 6))
    spread = np.zeros((2, 2))
    if noisy and _sensitivity(wrench, found[best], place, corners, settings, t, shape, slopes):
        spread = _sandwich(slopes, noise, slopes)
        for i in range(3):
            for j in range(3):
                total = 0.0
                for a in range(2):
                    for c in range(2):
                        total += t[a, i] * spread[a, c] * t[c, j]
                row[10 + 3 * i + j] = total
    row[_CANDIDATES] = plausible
    if plausible == 0:
        row[_STATUS] = _IMPLAUSIBLE
        if noisy:
            row[_RESIDUAL] = _distance_to_bounds(wrench, noise, nodes, corners, tags, settings, found[best], place)
        return
    row[_RESIDUAL] = 0.0
    if plausible > 1 and _ambiguous(found, places, count, best, t, spread, noisy):
        row[_STATUS] = _AMBIGUOUS
    state[HAS_PREVIOUS] = 1.0
    state[PREVIOUS : PREVIOUS + 3] = place[:3]


@_compiled()
def _off_surface(wrench, unit, noise, nodes, corners, tags, settings, noisy, found, row):
    """No patch can make this wrench: give the nearest point, flagged."""
    row[_STATUS] = _OFF_SURFACE
    if nearest_to_axis(unit, nodes, corners, tags, found[0]) == np.inf:
        return
    _contact(found[0], settings, row[:6])
    if noisy:
        row[_RESIDUAL] = _distance_to_point(wrench, noise, row[:6])


@_compiled()
def estimate_many(wrenches, noises, forced, nodes, corners, tags, settings, state, sequential, rows):
    """`estimate` over (n, 6). noises is (n, 6, 6) or (1, 6, 6); forced (n,) >= 0 is a status known beforehand.

    In sequence the hysteresis and the previous contact go from sample to sample; otherwise each starts from `state`.
    """
    start = state.copy()
    for i in range(len(wrenches)):
        if not sequential:
            state[:] = start
        if forced[i] >= 0:
            rows[i] = np.nan
            rows[i, _CANDIDATES] = 0.0
            rows[i, _STATUS] = forced[i]
            continue
        noise = noises[i] if len(noises) > 1 else noises[0]
        estimate(wrenches[i], noise, nodes, corners, tags, settings, state, rows[i])
