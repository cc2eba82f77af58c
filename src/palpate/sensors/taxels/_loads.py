"""Compiled: fit the forces of touches to the loads of taxels with three axes.

A force f on the skin puts the load u = K(d) f on a taxel at the offset d from it [pitches], with f and u along the two
tangents and into the body. K is the same whichever way it is turned, and a patch of variance t smears it:

    u_tangent = C f_tangent + (G (d . f_tangent) + H f_normal) d + T n x d,    u_normal = B (d . f_tangent) + A f_normal

A, B, C, G, H are sums of Gaussians of |d|, and T is what a torque does, the limit of two opposite tangential forces.
The places, patches, forces and torques of all touches of an area are found together, by Gauss and Newton's steps with
Marquardt's damping.
"""

# pyright: basic
from __future__ import annotations

import numpy as np

from palpate.sensors.taxels._fit import chart
from palpate.sensors.taxels._rest import AT, FORCE, LIVE, LOAD, ROUGH, SLOW, SPREAD
from palpate.surfaces._jit import inner, uncounted
from palpate.surfaces._vectors import solve_positive

WIDTHS = (0.35, 0.6, 1.0, 1.7)  # pitches, deviations of the Gaussians
PROFILES = 6  # A, B, C, G, H, and T of the torque; each a sum of Gaussians
LEAST_PATCH = -0.8 * WIDTHS[0] ** 2  # of the patch's variance, which counts from that of a usual tip
# what a model array holds: the profiles' shares of the Gaussians, then
PITCH, MISFIT, PATCH, LOOSE, CURVE, WIDENING, INEXACT, UNUSUAL = 20, 21, 23, 25, 26, 31, 34, 37
SUMS, LATE, MODEL = 40, 41, 44
UNKNOWN = 7  # of a touch: place (2) [pitches], patch, force along both tangents and inwards [N], torque [N pitches]
_POWERS = (1.0, 2.0, 1.0, 3.0, 2.0, 2.0)  # of a Gaussian's variance, with which each profile falls as a patch grows
_PLACE = 0.7  # pitches: deviation of a touch from the taxel where it is looked for
_TWIST = 0.15  # pitches: deviation of the torque, over the normal force
_STEPS, _DONE = 25, 1e-3
# of a touch without a peak, which presses on other skins showed: deviations by which a load exceeds that of the heavy
# touch, pitches from this one to the taxel and to the place, decrease of the sum of squares; and the sum from which it
# is looked for
_CLEAR, _NEXT, DISTANCE, _BETTER, UNEXPLAINED = 3.5, 1.0, 1.7, 30.0, 10.0
_FAINT, _AROUND = 4.0, 5.0  # misfits that a load must exceed to be a touch, and pitches to what causes them


@uncounted
def _profiles(square, patch, model, out):
    """Write the profiles at a squared distance into out (6, 3), with derivatives by it and by the patch."""
    out[:], many = 0.0, len(WIDTHS)
    for b in range(many):
        wide = WIDTHS[b] * WIDTHS[b] + patch
        narrow, ratio = 0.5 / wide, WIDTHS[b] * WIDTHS[b] / wide
        value = ratio * np.exp(-narrow * square)
        grows = square * narrow / wide
        c, g = model[2 * many + b], model[3 * many + b]
        tilt, lean = model[many + b] * ratio / WIDTHS[b], model[4 * many + b] * ratio / WIDTHS[b]
        shares = (model[b], tilt, c, g * ratio / wide, lean, 0.5 * (c + g) / wide)
        for p in range(PROFILES):
            out[p, 0] += shares[p] * value
            out[p, 1] -= shares[p] * value * narrow
            out[p, 2] += shares[p] * value * (grows - _POWERS[p] / wide)
        bulk = g * value  # what smearing moves from G to C
        out[2, 0] += bulk * (1.0 - ratio)
        out[2, 1] -= bulk * (1.0 - ratio) * narrow
        out[2, 2] += bulk * (ratio / wide + (1.0 - ratio) * (grows - 1.0 / wide))


@uncounted
def _load(x, y, touch, model, profiles, load, slopes):
    """Write the load (3,) at an offset (x, y) from a touch, and its derivatives (3, 7) by the touch's unknowns."""
    _profiles(x * x + y * y, touch[2], model, profiles)
    fx, fy, fz, twist = touch[3], touch[4], touch[5], touch[6]
    along = x * fx + y * fy
    a, b, c, g, h, t = profiles[0], profiles[1], profiles[2], profiles[3], profiles[4], profiles[5]
    for way in range(3):  # the load, and its derivatives by the squared distance and by the patch
        slopes[0, way] = c[way] * fx + (g[way] * along + h[way] * fz) * x - t[way] * y * twist
        slopes[1, way] = c[way] * fy + (g[way] * along + h[way] * fz) * y + t[way] * x * twist
        slopes[2, way] = b[way] * along + a[way] * fz
    even = g[0] * along + h[0] * fz
    for axis in range(3):
        load[axis], far = slopes[axis, 0], slopes[axis, 1]
        slopes[axis, 0], slopes[axis, 1] = -2.0 * x * far, -2.0 * y * far
    slopes[0, 0] -= even + g[0] * x * fx
    slopes[0, 1] -= g[0] * x * fy - t[0] * twist
    slopes[1, 0] -= g[0] * y * fx + t[0] * twist
    slopes[1, 1] -= even + g[0] * y * fy
    slopes[2, 0] -= b[0] * fx
    slopes[2, 1] -= b[0] * fy
    slopes[0, 3], slopes[0, 4], slopes[0, 5], slopes[0, 6] = c[0] + g[0] * x * x, g[0] * x * y, h[0] * x, -t[0] * y
    slopes[1, 3], slopes[1, 4], slopes[1, 5], slopes[1, 6] = g[0] * x * y, c[0] + g[0] * y * y, h[0] * y, t[0] * x
    slopes[2, 3], slopes[2, 4], slopes[2, 5], slopes[2, 6] = b[0] * x, b[0] * y, a[0], 0.0


@inner
def _normal(taxels, touches, count, model, work, normal, pull):
    """Write the normal equations about `touches` (c, 7), the lower triangle, and return the sum of squares.

    Of `taxels` the first are the offsets of each from the taxel of every touch, (c, 2, m), then their loads and
    weights, (3, m) each.
    """
    offsets, loads, weights = taxels
    profiles, load, slopes, left = work
    size = UNKNOWN * count
    normal[:size, :size], pull[:size] = 0.0, 0.0
    cost = 0.0
    for i in range(loads.shape[1]):
        for a in range(3):
            left[a] = loads[a, i]
        for p in range(count):
            _load(offsets[p, 0, i] - touches[p, 0], offsets[p, 1, i] - touches[p, 1], touches[p], model, profiles,
                  load, slopes[:, UNKNOWN * p : UNKNOWN * (p + 1)])  # fmt: skip
            for a in range(3):
                left[a] -= load[a]
        for a in range(3):
            weight = weights[a, i]
            cost += weight * left[a] * left[a]
            for r in range(size):
                slope = weight * slopes[a, r]
                pull[r] += slope * left[a]
                for s in range(r + 1):
                    normal[r, s] += slope * slopes[a, s]
    for p in range(count):
        cost += _prior(touches[p], UNKNOWN * p, model, normal, pull)
    return cost


@uncounted
def _usual(touch, model):
    """Return the variance of the patch that is usual by a touch's force."""
    return max(model[PATCH] + model[PATCH + 1] * max(touch[5], 0.0) ** (2.0 / 3.0), LEAST_PATCH)


@uncounted
def _shape(touch, model):
    """Return by how much a touch's patch exceeds a usual one; of sums their concentration, which stands in its place.

    As gains are off on each taxel by itself, sums are more certain where many taxels bear a force.
    """
    return touch[2] if model[SUMS] > 0.0 else touch[2] - _usual(touch, model)


@uncounted
def _unexplained(quantity, touch, model):
    """Return the variance that the loads do not explain: of place (0), normal (1) or tangential force (2)."""
    unusual = model[UNUSUAL + quantity] * _shape(touch, model)
    return model[INEXACT + quantity] ** 2 + unusual * unusual


@uncounted
def _prior(touch, first, model, normal, pull):
    """Add what is known of a touch before to the normal equations; return its squared distance from that."""
    pressed, usual, cost = max(touch[5], 0.0), _usual(touch, model), 0.0
    for c in range(4):
        at = c if c < 3 else 6
        mean = usual if c == 2 else 0.0
        deviation = _PLACE if c < 2 else model[LOOSE] if c == 2 else _TWIST * max(pressed, 1e-6)
        sure, off = deviation**-2, touch[at] - mean
        cost += sure * off * off
        pull[first + at] -= sure * off
        normal[first + at, first + at] += sure
    return cost


@inner
def _settle(taxels, touches, count, model, spread):
    """Fit `count` touches from where they are, and write their covariances.

    Return the sum of squares, and its mean, at least 1: what the model cannot explain widens all.
    """
    size = UNKNOWN * count
    work = np.empty((PROFILES, 3)), np.empty(3), np.empty((3, size)), np.empty(3)
    pull, step, ahead, trial = np.empty(size), np.empty(size), np.empty(size), touches.copy()
    normal, other, factor = np.empty((size, size)), np.empty((size, size)), np.empty((size, size))
    cost, damping = _normal(taxels, touches, count, model, work, normal, pull), 1e-3
    for _ in range(_STEPS):
        factor[:] = normal
        for r in range(size):
            factor[r, r] *= 1.0 + damping if r % UNKNOWN < 3 else 1.0
        if not solve_positive(factor, pull, size, step):
            break
        for p in range(count):
            for c in range(UNKNOWN):
                by = step[UNKNOWN * p + c]
                trial[p, c] = touches[p, c] + (min(max(by, -0.5), 0.5) if c < 3 else by)
            trial[p, 2] = max(trial[p, 2], LEAST_PATCH)
        found = _normal(taxels, trial, count, model, work, other, ahead)
        if found < cost:
            settled, damping, cost = cost - found < _DONE, 0.2 * damping, found
            touches[:count], normal[:], pull[:] = trial[:count], other, ahead
            if settled:
                break
        elif damping > 1e6:
            break
        else:
            damping *= 6.0
    excess = max(1.0, cost / max(3 * taxels[1].shape[1] - size, 1))
    _covariances(normal, factor, count, excess, spread)
    return cost, excess


@uncounted
def _variance(k, a, scale, numbers, model):
    """Return the variance of a cell's load along an axis by noise, and by what it follows late."""
    noise = scale * numbers[ROUGH + a, k] if a < 2 else numbers[SPREAD, k]
    return noise * noise + (model[LATE + 2] * numbers[SLOW + a, k]) ** 2


@inner
def _gather(cells, end, scale, numbers, whole, model):
    """Return the cells of an area that read, and their loads and weights, (3, m) each."""
    some = cells[:end][whole[LIVE][cells[:end]] != 0]
    loads, weights = numbers[LOAD : LOAD + 3][:, some], np.empty((3, len(some)))
    peak = np.abs(loads[2]).max()
    for i in range(len(some)):
        own = loads[0, i] ** 2 + loads[1, i] ** 2 + loads[2, i] ** 2
        for a in range(3):
            noise = _variance(some[i], a, scale, numbers, model) + (model[MISFIT] * peak) ** 2
            weights[a, i] = 1.0 / (noise + model[MISFIT + 1] ** 2 * own)
    return some, loads, weights


@uncounted
def _square(a, b):
    """Return the squared distance of two points."""
    return (a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2


@uncounted
def is_known(origin, out, place, force, model):
    """Return whether the load on a taxel is of a touch that was added before, a row of `out`.

    Or it is what a response does not explain of the hardest pressed taxel around it.
    """
    positions, strongest, reach = place[0][0], 0.0, _AROUND * model[PITCH]
    for k in range(len(force)):
        if force[k] > strongest and _square(positions[k], positions[origin]) < reach * reach:
            strongest = force[k]
    return feels(origin, out, place, model, DISTANCE) or force[origin] < _FAINT * model[MISFIT] * strongest


@uncounted
def feels(k, out, place, model, reach=_AROUND):
    """Return whether a taxel with three axes lies around a contact: it may pull or shear without being pressed."""
    near = False
    for row in range(len(out)):
        near = near or _square(place[0][0, k], out[row]) < (reach * model[PITCH]) ** 2
    return near


@inner
def _offset(some, origin, place, numbers, model, out):
    """Write the offsets [pitches] of cells from one of them, in the tangent plane there, to out (2, m)."""
    chart(some, len(some), origin, place, numbers[AT:])
    out[:] = place[1][1, origin] / model[PITCH] * numbers[AT : AT + 2][:, some]


@inner
def fit_forces(cells, end, origins, count, scale, place, numbers, whole, model, touches, spread):
    """Fit the touches of an area together, one about each of its peaks; return the sum of squares.

    Args:
        cells: of the area and its rim.
        end: number of those.
        origins: (most,) the cell about which each touch lies.
        count: number of touches.
        scale: of the noise, by a filter.
        place: as of `palpate.sensors.taxels._kernels.frames`.
        numbers: the same.
        whole: the same.
        model: the response, see `TaxelResponse.numbers`.
        touches: (most, 7) unknowns of the touches, written.
        spread: (most, 7, 7) their covariances, written.
    """
    some, loads, weights = _gather(cells, end, scale, numbers, whole, model)
    offsets = np.empty((count, 2, len(some)))
    touches[:] = 0.0
    for p in range(count):
        _offset(some, origins[p], place, numbers, model, offsets[p])
        touches[p, 5] = max(numbers[FORCE, origins[p]], 0.0)
    return _settle((offsets, loads, weights), touches, count, model, spread)[0]


@inner
def add_force(cells, end, origins, out, scale, place, numbers, whole, model, touches, spread):
    """Add a second touch to an area with one peak, if there is one, and return whether; arguments as of `fit_forces`.

    A light touch next to a heavy one has no peak of its own. It is looked for where the loads exceed those of the heavy
    one most. It is found if it is far enough from that and from the touches of other areas, the rows of `out`, and if
    both explain the loads much better than one.
    """
    some, loads, weights = _gather(cells, end, scale, numbers, whole, model)
    offsets, both, unsure = np.empty((2, 2, len(some))), touches[:2].copy(), spread[:2].copy()
    taxels = offsets, loads, weights
    _offset(some, origins[0], place, numbers, model, offsets[0])
    cost, _ = _settle(taxels, both, 1, model, unsure)
    k = _exceeding(offsets[0], loads[2], weights[2], both[0], model)
    if k < 0 or feels(some[k], out, place, model, DISTANCE):
        return False
    origins[1] = some[k]
    _offset(some, origins[1], place, numbers, model, offsets[1])
    both[1, 5] = max(numbers[FORCE, origins[1]], 0.0)
    found, excess = _settle(taxels, both, 2, model, unsure)
    x, y = offsets[0, 0, k] + both[1, 0] - both[0, 0], offsets[0, 1, k] + both[1, 1] - both[0, 1]
    if cost - found < _BETTER * excess or both[1, 5] <= 0.0 or np.sqrt(x * x + y * y) < DISTANCE:
        return False
    touches[:2], spread[:2] = both, unsure
    return True


@inner
def _exceeding(offsets, loads, weights, touch, model):
    """Return the taxel, not next to a touch, whose normal load exceeds the touch's most; -1 if none does clearly."""
    profiles, load, slopes = np.empty((PROFILES, 3)), np.empty(3), np.empty((3, UNKNOWN))
    best, most = -1, _CLEAR
    for i in range(len(loads)):
        x, y = offsets[0, i] - touch[0], offsets[1, i] - touch[1]
        _load(x, y, touch, model, profiles, load, slopes)
        excess = (loads[i] - load[2]) * np.sqrt(weights[i])
        if excess > most and np.sqrt(x * x + y * y) >= _NEXT:
            best, most = i, excess
    return best


@inner
def share_loads(cells, end, origins, count, scale, place, numbers, whole, model, touches, spread, shares, fits):
    """Write the share (c, end) of each touch in the load on each cell of an area, and its place (5,) to `fits`.

    Where taxels bear all of a force among them, as pillars do, force, place and torque are the sums over the shares,
    and `spread` is theirs.
    """
    profiles, load, slopes = np.empty((PROFILES, 3)), np.empty(3), np.empty((3, UNKNOWN))
    offset, total = np.empty((2, end)), np.zeros(end)
    for p in range(count):
        _offset(cells[:end], origins[p], place, numbers, model, offset)
        for i in range(end):
            x, y = offset[0, i] - touches[p, 0], offset[1, i] - touches[p, 1]
            _load(x, y, touches[p], model, profiles, load, slopes)
            shares[p, i] = max(load[2], 1e-12)
            total[i] += shares[p, i]
    for p in range(count):
        shares[p, :end] /= total
        if model[SUMS] > 0.0:
            _offset(cells[:end], origins[p], place, numbers, model, offset)
            if _sum(cells, end, offset, shares[p], numbers, whole, touches[p]):
                _sum_spread(cells, end, offset, shares[p], scale, numbers, whole, model, touches[p], spread[p])
        _place(touches[p], spread[p], model, place[1][1, origins[p]], fits[p])


@uncounted
def _place(touch, spread, model, spacing, out):
    """Write the place of a touch that `fit_forces` found, and its variances and covariance, in spacings to out (5,)."""
    size = model[PITCH] / spacing
    square, more = (size * model[WIDENING]) ** 2, size * size * _unexplained(0, touch, model)
    out[0], out[1] = size * touch[0], size * touch[1]
    out[2], out[3], out[4] = square * spread[0, 0] + more, square * spread[1, 1] + more, square * spread[0, 1]


@uncounted
def _sum(cells, end, offset, shares, numbers, whole, touch):
    """Write the place, force and torque of a touch as the sums over its shares of the loads, and their concentration.

    That is the root of the sum of their squares, over the force: 1 where one taxel bears all of it.
    """
    force, live = numbers[FORCE], whole[LIVE]
    x, y, fx, fy, fz, inside, turn, square = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(end):
        k = cells[i]
        if live[k]:
            own = shares[i] * max(force[k], 0.0)
            inside, x, y = inside + own, x + own * offset[0, i], y + own * offset[1, i]
            along, aside = shares[i] * numbers[LOAD, k], shares[i] * numbers[LOAD + 1, k]
            fx, fy, fz = fx + along, fy + aside, fz + shares[i] * force[k]
            square += along**2 + aside**2 + (shares[i] * force[k]) ** 2
            turn += offset[0, i] * aside - offset[1, i] * along
    if inside > 0.0:
        touch[0], touch[1], touch[3], touch[4], touch[5] = x / inside, y / inside, fx, fy, fz
        touch[6] = turn - touch[0] * fy + touch[1] * fx
        touch[2] = np.sqrt(square / (fx * fx + fy * fy + fz * fz))
    return inside > 0.0 and fz > 0.0


@inner
def _sum_spread(cells, end, offset, shares, scale, numbers, whole, model, touch, spread):
    """Write the covariance of the sums of a touch, by the errors of the loads and of the shares."""
    slopes, loose = np.eye(3, UNKNOWN, 3), spread[2, 2]
    spread[:] = 0.0
    for i in range(end):
        k = cells[i]
        if not whole[LIVE, k]:
            continue
        x, y = offset[0, i] - touch[0], offset[1, i] - touch[1]
        slopes[2, 0], slopes[2, 1] = x / touch[5], y / touch[5]
        slopes[0, 6], slopes[1, 6] = -y, x
        slopes[2, 6] = (y * touch[3] - x * touch[4]) / touch[5]
        for a in range(3):
            mixed = (1.0 - shares[i]) * shares[i] * numbers[LOAD + a, k]
            variance = shares[i] ** 2 * _variance(k, a, scale, numbers, model) + mixed * mixed
            spread += np.outer(slopes[a] * variance, slopes[a])
    spread[2, 2] = loose


@inner
def write_force(touch, spread, model, here, ways, out, first):
    """Write a touch's force and torque; from `first` the slip ratio, two deviations, the covariance (6,), the shape.

    The deviations are those of the ratio of tangential to normal force, and of the torque. A force that the fit finds
    is corrected by the response's curve, which holds for the whole of a touch.
    """
    curve, off = model[CURVE:WIDENING], model[WIDENING:INEXACT]
    x, y, press = touch[3], touch[4], touch[5]
    aside = curve[3] + curve[4] * press
    force = np.array([aside * x, aside * y, (curve[0] + curve[1] * press) * press + curve[2] * (x * x + y * y)])
    slopes = np.array([[aside, 0.0, curve[4] * x], [0.0, aside, curve[4] * y],
                       [2.0 * curve[2] * x, 2.0 * curve[2] * y, curve[0] + 2.0 * curve[1] * press]])  # fmt: skip
    local, fitted = np.empty((3, 3)), spread[3:6, 3:6]
    for a in range(3):
        for b in range(3):
            wide = off[2 if a < 2 else 1] * off[2 if b < 2 else 1]
            local[a, b] = _form(slopes[a], fitted, slopes[b]) * wide
        local[a, a] += _unexplained(2 if a < 2 else 1, touch, model) * (force[0] ** 2 + force[1] ** 2 + force[2] ** 2)
    axes = np.empty((3, 3))  # of x, y and into the body
    for a in range(2):
        axes[a] = ways[a] / np.sqrt(ways[a, 0] ** 2 + ways[a, 1] ** 2 + ways[a, 2] ** 2)
    axes[2] = -here[3:]
    out[6:9] = force[0] * axes[0] + force[1] * axes[1] + force[2] * axes[2]
    out[9] = aside * touch[6] * model[PITCH]
    sideways = np.sqrt(force[0] ** 2 + force[1] ** 2)
    ratio = sideways / force[2] if force[2] > 0.0 else np.nan
    along = np.array([force[0] / sideways if sideways > 0.0 else 1.0, force[1] / sideways if sideways > 0.0 else 0.0,
                      -ratio])  # fmt: skip
    deviation = np.sqrt(_form(along, local, along))
    out[first], out[first + 1] = ratio, deviation / force[2] if force[2] > 0.0 else np.nan
    out[first + 9] = _shape(touch, model)
    out[first + 2] = aside * np.sqrt(spread[6, 6]) * model[PITCH]
    at = first + 3
    for a in range(3):
        for b in range(a, 3):
            out[at] = _form(axes[:, a], local, axes[:, b])
            at += 1


@uncounted
def _form(a, matrix, b):
    """Return a' M b."""
    total = 0.0
    for c in range(3):
        for d in range(3):
            total += a[c] * matrix[c, d] * b[d]
    return total


@inner
def _covariances(normal, factor, count, scale, spread):
    """Write the covariance (7, 7) of each touch, `scale` times the inverse of the normal equations."""
    size = UNKNOWN * count
    unit, column = np.zeros(size), np.empty(size)
    for r in range(size):
        unit[:], factor[:] = 0.0, normal
        unit[r] = scale
        if not solve_positive(factor, unit, size, column):
            column[:] = np.nan
        first = r - r % UNKNOWN
        spread[r // UNKNOWN, r % UNKNOWN] = column[first : first + UNKNOWN]
