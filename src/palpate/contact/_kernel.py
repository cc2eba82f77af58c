"""Compiled: turn one wrench into one row of an estimate (`estimate.ROW`), and loop over many."""

# pyright: basic
from __future__ import annotations

import numpy as np

from palpate.contact._bounds import distance_to_bounds, distance_to_point
from palpate.contact._cones import distance_to_edges
from palpate.contact._edges import EXPLAINED, at_edge, exact
from palpate.contact._settings import (
    ACCURACY,
    BEFORE,
    BRANCH,
    BRANCHES,
    CONTESTED,
    DEPTH,
    EDGED,
    EXPONENT,
    FOLLOW,
    FRICTION,
    HAS_PREVIOUS,
    LARGEST,
    MOST,
    NOISY,
    OFF,
    ON,
    PREVIOUS,
    SAMPLES,
    SCALE,
    SOFT,
    STATE,
    TOUCHING,
)
from palpate.contact._slopes import (
    sandwich,
    sandwich_into,
    sensitivity,
    slopes_at,
    softened,
    to_metres,
    to_unit,
)
from palpate.contact._touch import (
    EARLY,
    MEAN,
    better,
    beyond,
    follow,
    forget,
    friction,
    misfit,
    rival,
    torsion,
    within_bounds,
)
from palpate.surfaces._bvh import CANDIDATE, CAPACITY, room
from palpate.surfaces._jit import inlined, inner, released
from palpate.surfaces._kernels import nearest_to_axis, search_in, shape_operator
from palpate.surfaces._vectors import copy_into, cross_into, dot, tangents

_GRAZING = 60.0  # tan(theta) beyond which a contact is searched for without a limit
_CHI2_95 = 5.991464547107979  # two degrees of freedom
_VAGUE = 0.03  # of the body's size: a deviation from which on an ellipse is doubted while a touch begins
_PROBED = 2.5  # standard deviations along a tangent, at which it is looked for what the ellipse does not know
# Standard deviations between an answer and the mean place of its touch; between the wrench and what makes it there; and
# the ratio of their squares, 1 where the surface is flat.
_APART, _NEAR, _BENT = 3.0, 8.0, 1.5
_CONTACT, _AMBIGUOUS, _NO_CONTACT, _TOO_LIGHT, _OFF_SURFACE, _IMPLAUSIBLE, _INVALID = 0, 1, 2, 3, 4, 5, 7
_SETTLING, _SETTLED = 60, 1e-11  # steps to where a force acts under a soft layer; arm of what is left, of the size
_RESIDUAL, _CANDIDATES, _STATUS = 19, 20, 21  # estimate._Row, which compiled code cannot read


@inner
def _choose(wrench, settings, state, found, count, places, torques):
    """Return the best candidate and the number of candidates within the bounds; mark these in found[:, 7]."""
    best, plausible, nearest = -1, 0, np.inf
    for i in range(count):
        to_metres(found[i], settings, places[i])
        torques[i], pressing = torsion(wrench, places, i, settings[SOFT])
        if not within_bounds(found, i, torques[i], pressing, settings):
            continue
        plausible += 1
        if state[HAS_PREVIOUS] == 1.0:
            gap = 0.0
            for k in range(3):
                gap += (places[i, k] - state[PREVIOUS + k]) ** 2
            if gap < nearest:
                best, nearest = i, gap
        elif best < 0 or better(found, i, best):
            best = i
    if best < 0:
        for i in range(count):
            if best < 0 or better(found, i, best):
                best = i
    return best, plausible


@inner
def _ambiguous(found, places, count, best, t, spread, noisy, state, branches):
    """Return whether another candidate that is still possible lies outside the 95 % ellipse of the chosen one."""
    det = spread[0, 0] * spread[1, 1] - spread[0, 1] * spread[1, 0]
    for i in range(count):
        if i == best or found[i, 7] == 0.0 or (noisy and not rival(state, branches[i])):
            continue
        if not noisy or _outside(places[i], places[best], t, spread, det, _CHI2_95):
            return True
    if noisy and state[CONTESTED] == 1.0:
        for k in range(MOST):
            mean = BRANCHES + k * BRANCH + MEAN
            if (k == 0 or rival(state, k)) and _outside(state[mean : mean + 3], places[best], t, spread, det, _CHI2_95):
                return True
    return False


@inner
def _outside(point, place, t, spread, det, limit):
    """Return whether a point is more than `limit` squared standard deviations from a place with this covariance."""
    if not det > 0.0:
        return True
    off = point[:3] - place[:3]
    x, y, z = dot(off, t[0]), dot(off, t[1]), dot(off, place[3:])
    square = (spread[1, 1] * x * x - 2.0 * spread[0, 1] * x * y + spread[0, 0] * y * y) / det
    return square > limit or z * z > limit * (spread[0, 0] + spread[1, 1])


@inner
def _jumped(wrench, noise, state, place, t, spread):
    """Return whether this place is far from the mean of its touch, though a contact there would explain the wrench too.

    If the surface is flat within the ellipse one excludes the other, whether the contact slides or not. So at least one
    of the two is wrong by more than the ellipse shows: the surface bends within it, or folds.
    """
    gap = 0.0
    for k in range(3):
        gap += (place[k] - state[BEFORE + MEAN + k]) ** 2
    det = spread[0, 0] * spread[1, 1] - spread[0, 1] * spread[1, 0]
    # the least variance is more than det / trace
    if state[BEFORE] == 0.0 or gap * (spread[0, 0] + spread[1, 1]) <= _APART**2 * det:
        return False
    before, mean = state[BEFORE : BEFORE + MEAN + 6], np.empty(6)
    if not (_outside(before[MEAN:], place, t, spread, det, _APART**2) and dot(wrench[:3], before[MEAN + 3 :]) < 0.0):
        return False
    square, share = misfit(wrench, noise, before, mean)
    return square * share < _NEAR**2 and _outside(mean, place, t, spread, det, _BENT * square)


@inner
def _elsewhere(wrench, unit, noise, nodes, corners, settings, limit, place, t, spread, found, free):
    """Return whether noise of `_PROBED` standard deviations along a tangent leads to a place outside the ellipse.

    This happens past an edge, or if the surface bends within the ellipse: slopes show neither.
    """
    moved, spot, slopes = np.empty(6), np.empty((1, 6)), np.empty((2, 6))
    if not slopes_at(wrench, place, t, np.zeros((2, 2)), settings[SOFT], slopes):
        return True
    det = spread[0, 0] * spread[1, 1] - spread[0, 1] * spread[1, 0]
    for k in range(4):
        side, square = slopes[k // 2], 0.0
        for i in range(6):
            moved[i] = 0.0
            for j in range(6):
                moved[i] += noise[i, j] * side[j]
            square += side[i] * moved[i]
        scale = (_PROBED - 2.0 * _PROBED * (k % 2)) / np.sqrt(square)
        for i in range(6):
            moved[i] = wrench[i] + scale * moved[i]
        to_unit(moved, settings, unit)
        count = search_in(unit, settings[SOFT], limit, nodes, corners, found, free)
        for i in range(count):
            to_metres(found[i], settings, spot[0])
            torque, pressing = torsion(moved, spot, 0, settings[SOFT])
            off = beyond(moved, noise, spot[0], torque, found[i, 4], settings)
            if off < EXPLAINED**2 and pressing < 0.0 and _outside(spot[0], place, t, spread, det, _APART**2):
                return True
    return False


@inner
def _strength(wrench, noise, settings):
    """Return the number to compare with the thresholds: the force [N], or its standard deviations from zero."""
    if settings[ON] >= 0.0:
        return np.sqrt(dot(wrench[:3], wrench[:3]))
    return _deviations(wrench, noise)


@inner
def _deviations(wrench, noise):
    """Return the distance of a force from zero in standard deviations."""
    x, y, z = wrench[0], wrench[1], wrench[2]
    a, b, c = noise[0, 0], noise[1, 1], noise[2, 2]
    d, e, f = noise[1, 2], noise[0, 2], noise[0, 1]
    i, j, k = b * c - d * d, d * e - c * f, f * d - b * e  # of the adjugate, as are those below
    det = a * i + f * j + e * k
    if not det > 0.0:
        return np.inf
    p, q, r = a * c - e * e, e * f - a * d, a * b - f * f
    return np.sqrt((x * x * i + y * y * p + z * z * r + 2.0 * (x * y * j + x * z * k + y * z * q)) / det)


@inner
def _gate(wrench, noise, settings, state):
    """Return the status before anything is located, or CONTACT; update the hysteresis."""
    for k in range(6):
        if not abs(wrench[k]) <= LARGEST:  # NaN too
            return _INVALID
    strength = _strength(wrench, noise, settings)
    if wrench[0] == 0.0 and wrench[1] == 0.0 and wrench[2] == 0.0:
        strength = -1.0
    if strength >= abs(settings[ON]):
        state[TOUCHING] = 1.0
    elif strength < abs(settings[OFF]) or strength < 0.0:
        state[TOUCHING] = 0.0
        return _NO_CONTACT
    return _CONTACT if state[TOUCHING] == 1.0 else _TOO_LIGHT


@inner
def _search(wrench, unit, nodes, corners, settings, limit, found, free):
    """Return the number of candidates of a wrench; write it into unit in the tree's size. `limit`: friction at most."""
    to_unit(wrench, settings, unit)
    count = 0
    while count == 0 and limit < np.inf:  # outside the bounds, wider step by step: a search without a limit is slow
        count = search_in(unit, settings[SOFT], limit, nodes, corners, found, free)
        limit = 4.0 * max(1.0, limit) if limit < _GRAZING else np.inf
    if count == 0:
        count = search_in(unit, settings[SOFT], np.inf, nodes, corners, found, free)
    return count


@inner
def _at_surface(wrench, nodes, corners, settings, near, found, free):
    """Return the wrench that the same force would make at the surface; under a soft layer it acts d below.

    A force at p - d n has the moment M = (p - d n) x F + tau n, so M' = M + d n x F, d = depth |F . n|^exponent, is
    that of a contact at p on the bare surface. Both depend on p: this is iterated, each step corrected by the last
    two (Anderson 1965). The candidate that is followed becomes the last contact, in `near`.
    """
    out, unit, moved = wrench.copy(), np.empty(6), np.empty(3)
    now, before, at_before = np.empty(3), np.zeros(3), np.zeros(3)
    places, torques = np.empty((CAPACITY + 1, 6)), np.empty(CAPACITY + 1)
    size = np.sqrt(dot(wrench[:3], wrench[:3])) * settings[SCALE]
    for step in range(_SETTLING):
        count = _search(out, unit, nodes, corners, settings, settings[FRICTION], found, free)
        if count == 0:
            break
        best, _ = _choose(out, settings, near, found, count, places, torques)
        place = places[best]
        near[HAS_PREVIOUS] = 1.0
        copy_into(place, near[PREVIOUS : PREVIOUS + 3])
        cross_into(place[3:], wrench[:3], now)
        depth = settings[DEPTH] * abs(dot(wrench[:3], place[3:])) ** settings[EXPONENT]
        left, turned, square = 0.0, 0.0, 0.0
        for k in range(3):
            now[k] = wrench[3 + k] + depth * now[k]
            moved[k] = now[k] - out[3 + k]
            left += moved[k] * moved[k]
            turned += moved[k] * (moved[k] - before[k])
            square += (moved[k] - before[k]) ** 2
        if left <= (_SETTLED * size) ** 2:
            break
        share = turned / square if step > 0 and square > 0.0 and abs(turned) < square else 0.0
        for k in range(3):
            out[3 + k] = now[k] - share * (now[k] - at_before[k])
            before[k], at_before[k] = moved[k], now[k]
    return out


@inner
def _workspace():
    """Return the arrays that `_estimate` writes into, allocated once for many wrenches."""
    places, torques, branches = np.empty((CAPACITY + 1, 6)), np.empty(CAPACITY + 1), np.empty(CAPACITY + 1, np.int64)
    slopes = np.empty((2, 3)), np.empty((2, 2)), np.empty((2, 6)), np.empty((2, 2))
    return np.empty(6), np.empty(6), np.empty((CAPACITY + 1, CANDIDATE)), places, torques, branches, slopes, room()


@inlined
def _estimate(wrench, noise, nodes, corners, settings, state, row, work):
    """Write the row of `estimate.ROW` of one wrench (6,) with covariance (6, 6), in the surface's frame."""
    row[:] = np.nan
    row[_CANDIDATES] = 0.0
    status = _gate(wrench, noise, settings, state)
    row[_STATUS] = status
    if status == _INVALID:
        return
    copy_into(wrench, row[6:9])
    if status != _CONTACT:
        state[HAS_PREVIOUS] = 0.0
        forget(state)
        return
    unit, nearest, found, places, torques, branches, (t, shape, slopes, spread), free = work
    near = state
    if settings[DEPTH] > 0.0:
        near = state.copy()
        wrench = _at_surface(wrench, nodes, corners, settings, near, found, free)
    noisy = settings[NOISY] == 1.0
    limit = friction(wrench, noise, settings, state) if noisy else settings[FRICTION]
    count = _search(wrench, unit, nodes, corners, settings, limit, found, free)
    places[0] = 0.0  # where there is none
    best = plausible = within = 0
    doubtful = False
    if count > 0:
        chosen, plausible = _choose(wrench, settings, near, found, count, places, torques)
        best = chosen
        if noisy:
            best = follow(wrench, noise, settings, state, found, places, torques, count, chosen, branches)
            if state[FOLLOW] == 1.0:
                doubtful = best < count and branches[best] != 0
            elif best == count and found[count, 7] < 1.0 and found[chosen, 7] == 1.0:
                doubtful, best = True, chosen
        within = plausible if found[best, 7] == 1.0 else 0
    remembered, place = count > 0 and best == count, places[best]
    if noisy and within == 0 and not remembered and _deviations(wrench, noise) < EXPLAINED:
        row[_STATUS] = _TOO_LIGHT  # noise alone explains the force, and so it would any contact
        return
    spread[:] = 0.0
    known = noisy and count > 0 and sensitivity(wrench, found[best], place, nodes, corners, settings, t, shape, slopes)
    if known:
        if settings[DEPTH] > 0.0:
            shape_operator(found[best], t, settings[SCALE], nodes, corners, shape)
            softened(wrench[:3], place[3:], t, shape, settings, slopes)
        sandwich_into(slopes, noise, slopes, spread)
    moved, away = 0, found[count, 5] if remembered else np.inf
    if not remembered:
        if within == 0 and noisy and count > 0:
            away = distance_to_bounds(wrench, noise, nodes, corners, settings, found[best], place, nearest)
            det = spread[0, 0] * spread[1, 1] - spread[0, 1] * spread[1, 0]
            doubtful = doubtful or (away <= EXPLAINED and _outside(nearest, place, t, spread, det, _CHI2_95))
        edged = settings[EDGED] == 1.0
        if edged and (noisy or within == 0):
            moved, beside = _beside(wrench, unit, noise, nodes, corners, settings, near, within, place, t, spread)
            away = _least(beside, away)
        if edged and within == 0 and noisy and not away <= EXPLAINED:
            away, other = _nearest(wrench, unit, noise, nodes, corners, settings, near, away, moved, place, t, spread)
            moved = 1 if other else moved
        if within == 0 and noisy and count > 1 and plausible == 0 and near[HAS_PREVIOUS] == 0.0 and away > EXPLAINED:
            away = _of_others(wrench, noise, nodes, corners, settings, found, places, count, best, away)
            doubtful = doubtful or away <= EXPLAINED
        if moved == 1 or moved == 3:
            known, torques[best] = noisy, torsion(wrench, places, best, 0.0)[0]
        if count == 0 and not away <= EXPLAINED:
            _off_surface(wrench, unit, noise, nodes, corners, settings, noisy, found, row)
            return
    if known and settings[ACCURACY] > 0.0 and spread[0, 0] + spread[1, 1] > settings[ACCURACY] ** 2:
        row[_STATUS] = _TOO_LIGHT
        return
    copy_into(place, row[:6])
    row[9] = torques[best]
    if known:
        _carry(t, spread, row[10:19])
    explained = (within > 0 and not remembered) or away <= EXPLAINED
    row[_CANDIDATES] = max(1, plausible) if explained else 0
    row[_RESIDUAL] = 0.0 if within > 0 and not remembered else away if noisy and away < np.inf else np.nan
    if not explained:
        row[_STATUS] = _IMPLAUSIBLE
        return
    several = count + state[CONTESTED] > 1.0 and state[FOLLOW] == 0.0
    several = several and _ambiguous(found, places, count, best, t, spread, noisy, state, branches)
    if moved > 1 or doubtful or several or (known and _jumped(wrench, noise, state, place, t, spread)):
        row[_STATUS] = _AMBIGUOUS
    elif known and state[FOLLOW] == 0.0 and 1.0 < state[SAMPLES] <= EARLY:
        vague = spread[0, 0] + spread[1, 1] > (_VAGUE * settings[SCALE]) ** 2
        guessed = within == 0 and moved == 0 and not remembered
        if vague and (
            guessed or _elsewhere(wrench, unit, noise, nodes, corners, settings, limit, place, t, spread, found, free)
        ):
            row[_STATUS] = _AMBIGUOUS
    state[HAS_PREVIOUS] = 1.0
    copy_into(place, state[PREVIOUS : PREVIOUS + 6])


@inner
def _carry(t, spread, out):
    """Write a covariance in two tangents as one in space, into out (9,)."""
    for i in range(3):
        for j in range(i, 3):
            total = 0.0
            for a in range(2):
                for c in range(2):
                    total += t[a, i] * spread[a, c] * t[c, j]
            out[3 * i + j] = out[3 * j + i] = total  # symmetric to the last bit


@inner
def _beside(wrench, unit, noise, nodes, corners, settings, near, plausible, place, t, spread):
    """Return the answer of `at_edge`, with a covariance for rounding if the noise is not known."""
    if settings[NOISY] == 0.0:
        noise = np.empty((6, 6))
        exact(wrench, settings, noise)
    return at_edge(wrench, unit, noise, nodes, corners, settings, near, plausible, place, t, spread)


@inner
def _least(one, two):
    """Return the lesser of two numbers; NaN does not count as lesser."""
    return two if two < one else one


@inner
def _nearest(wrench, unit, noise, nodes, corners, settings, state, away, moved, place, t, spread):
    """Return the distance from the bounds, with edges and corners nearer than `away`, and whether they give the answer.

    They give it if nothing else explains the wrench and they do; then point, normal, tangents and covariance change.
    """
    spot = place.copy()
    most = away if away < np.inf else EXPLAINED  # what presses on no facet is looked for near by
    least = distance_to_edges(wrench, unit, noise, nodes, corners, settings, state, most, spot)
    if not least < most:
        return away, False
    if moved > 0 or least > EXPLAINED:
        return least, False
    shape, slopes = np.zeros((2, 2)), np.empty((2, 6))
    copy_into(spot, place)
    tangents(place[3:], t)
    if not slopes_at(wrench, place, t, shape, 1.0, slopes):
        return least, False
    both = sandwich(slopes, noise, slopes)
    for a in range(2):
        copy_into(both[a], spread[a])
    return least, True


@inner
def _of_others(wrench, noise, nodes, corners, settings, found, places, count, best, away):
    """Return the least of `away` and the distances from the bounds at the other candidates."""
    spot = np.empty(6)
    for i in range(count):
        if i != best:
            away = _least(distance_to_bounds(wrench, noise, nodes, corners, settings, found[i], places[i], spot), away)
    return away


@inner
def _off_surface(wrench, unit, noise, nodes, corners, settings, noisy, found, row):
    """Write a row for a wrench that no patch can make: the nearest point, with the status OFF_SURFACE."""
    row[_STATUS] = _OFF_SURFACE
    if nearest_to_axis(unit, nodes, corners, found[0]) == np.inf:
        return
    to_metres(found[0], settings, row[:6])
    if noisy:
        row[_RESIDUAL] = distance_to_point(wrench, noise, row[:6])


@released(
    """
    wrenches n 6, noises n|1 6 6, forced int8 n, nodes float32 k 14 8 | 10 | function, corners p 20 | s 6 | s 6,
    settings 14, state out 162, sequential bool, rows out n 22
    """
)
def estimate_many(wrenches, noises, forced, nodes, corners, settings, state, sequential, rows):
    """Run `_estimate` over wrenches (n, 6) with noises (n, 6, 6) or (1, 6, 6); forced (n,) >= 0 is a known status.

    If sequential, the hysteresis and the previous contact go from sample to sample; otherwise each starts from `state`.
    """
    start, work = state.copy(), _workspace()
    for i in range(len(wrenches)):
        if not sequential:
            copy_into(start, state)
        if forced[i] >= 0:
            rows[i] = np.nan
            rows[i, _CANDIDATES] = 0.0
            rows[i, _STATUS] = forced[i]
            continue
        noise = noises[i] if len(noises) > 1 else noises[0]
        _estimate(wrenches[i], noise, nodes, corners, settings, state, rows[i], work)


@released("wrenches n 6, noises n|1 6 6, forced int8 n, settings 14")
def first_free(wrenches, noises, forced, settings):
    """Return the first sample of `estimate_many` that has no contact whatever came before it; -1 if there is none."""
    state = np.zeros(STATE)
    for i in range(len(wrenches)):
        noise = noises[i] if len(noises) > 1 else noises[0]
        if forced[i] < 0 and _gate(wrenches[i], noise, settings, state) == _NO_CONTACT:
            return i
    return -1
