"""Compiled: decide between several candidates by all samples of a touch, and not by its first.

Each candidate is a sample of a *branch*: a place on the surface where this touch may be. While force and torque change,
a contact stays where it is, or slides; a false branch moves about, since it follows the line of action. So each branch
remembers its mean place, and in each sample every branch loses r^2 / 2 - log s, at most `_WORST`: two branches of a
touch that slides lose alike. Here r is the distance, in standard deviations, of the wrench from the nearest that a
contact at that mean place can make, and s the share of the sample's noise in the sum with the error of the mean. The
difference to the branch that is believed is summed, D, and its squares, V: without a true difference D / sqrt(V) is
nearly normal, whatever the samples are. A branch replaces the believed one if D > T, and is no rival if D < -T, with
T = `_LEAST` + a sqrt(V), where a is `_TAKES` for the first and `_APART` for the second.
"""

# pyright: basic
from __future__ import annotations

import numpy as np

from palpate.contact._bounds import distance_to_point
from palpate.contact._edges import EXPLAINED, reach
from palpate.contact._settings import (
    BEFORE,
    BRANCH,
    BRANCHES,
    CONTESTED,
    FOLLOW,
    FRICTION,
    MOST,
    PREVIOUS,
    SAMPLES,
    SCALE,
    SOFT,
    TORSION,
)
from palpate.contact._slopes import to_metres
from palpate.surfaces._bvh import CANDIDATE
from palpate.surfaces._jit import inner
from palpate.surfaces._vectors import copy_into, cross_into, dot

# of a branch: the weight of its mean place, that place [m] and its normal, what it gained, its handicap, last candidate
_WEIGHT, MEAN, _GAIN, _SQUARES, _HANDICAP, _LAST = 0, 1, 7, 8, 9, 10
_KEPT = 1.0 - 1.0 / 32.0  # of the weight of a branch's mean place, from sample to sample
EARLY = 8  # samples in which any branch may appear
_WORST = 8.0  # loss of a sample at most
_LEAST, _TAKES, _APART = 1.0, 2.5, 2.5
_LATE, _LATEST = 0.5, 10.0  # handicap a sample of a branch that appears later, and at most
_WITHIN = 2.0  # samples that a touch counts as old when it begins within another
_ANOTHER, _SURELY = 5.0, 8.0  # standard deviations from a place beyond which it is another touch, and surely so
_REACH = 0.1  # of the tree's size, added to noise: a candidate further from a branch belongs to another
_MAY_BE = 0.5  # of a candidate that noise alone may have put beyond the bounds, where 1 is within them
_GRAZING = 60.0  # bound of friction without noise at most
_STEEPEST = np.arctan(_GRAZING)
_NEAR = 4.0  # standard deviations beyond a bound, or from a place, at which a branch is followed still


@inner
def torsion(w, place, i, soft):
    """Return the torque about the normal of place i, (M - p x F) . n, and F . n; without slices of arrays: slow."""
    nx, ny, nz = place[i, 3], place[i, 4], place[i, 5]
    pressing = w[0] * nx + w[1] * ny + w[2] * nz
    if soft == 1.0:
        return (w[0] * w[3] + w[1] * w[4] + w[2] * w[5]) / pressing, pressing
    x = place[i, 1] * w[2] - place[i, 2] * w[1]
    y = place[i, 2] * w[0] - place[i, 0] * w[2]
    z = place[i, 0] * w[1] - place[i, 1] * w[0]
    return w[3] * nx + w[4] * ny + w[5] * nz - (x * nx + y * ny + z * nz), pressing


@inner
def within_bounds(found, i, torque, pressing, settings):
    """Return whether candidate i is within the bounds of friction and torsion; write 1 or 0 into found[i, 7]."""
    within = found[i, 4] <= settings[FRICTION] and abs(torque) <= settings[TORSION] * abs(pressing)
    found[i, 7] = 1.0 if within else 0.0
    return within


@inner
def friction(wrench, noise, settings, state):
    """Return the bound on tan(theta) for a search.

    While several branches are possible it is wider by the angle that noise can turn the force: the true place may lie
    beyond the bound in one sample.
    """
    if state[FOLLOW] == 1.0 or (state[SAMPLES] >= EARLY and state[CONTESTED] == 0.0):
        return settings[FRICTION]
    turned = max(noise[0, 0], noise[1, 1], noise[2, 2]) / dot(wrench[:3], wrench[:3])
    angle = np.arctan(settings[FRICTION]) + _NEAR * np.sqrt(turned)
    return np.tan(angle) if angle < _STEEPEST else _GRAZING


@inner
def better(found, i, j):
    """Return whether candidate i is preferred to j: met first along the force from outside, then smaller friction.

    The candidate met first is preferred because the object that presses is on the side from which the force comes. The
    rate at which this is right on real probes is in docs/evidence.md.
    """
    gap = found[i, 5] - found[j, 5]
    if abs(gap) > 1e-9:
        return gap < 0.0
    return found[i, 4] < found[j, 4]


@inner
def _branch(state, k):
    return state[BRANCHES + k * BRANCH : BRANCHES + (k + 1) * BRANCH]


@inner
def forget(state):
    """Reset the branches at the end of a touch."""
    state[SAMPLES] = state[CONTESTED] = 0.0
    for k in range(MOST):
        state[BRANCHES + k * BRANCH] = 0.0


@inner
def _begin(branch, candidate, place, weight, handicap):
    """Begin a branch at a candidate."""
    branch[:] = 0.0
    branch[_HANDICAP] = handicap
    _moved(branch, candidate, place, weight)


@inner
def _moved(branch, candidate, place, weight):
    """Update a branch by its candidate in a sample; samples are weighted by their squared force [N^2]."""
    branch[_WEIGHT] = _KEPT * branch[_WEIGHT] + weight
    share = weight / branch[_WEIGHT]
    for k in range(6):
        branch[MEAN + k] += (place[k] - branch[MEAN + k]) * share
    copy_into(candidate, branch[_LAST : _LAST + CANDIDATE])


@inner
def beyond(wrench, noise, place, torque, tangent, settings):
    """Return by how many squared standard deviations a candidate exceeds the bounds of friction and torsion."""
    pressing = -dot(wrench[:3], place[3:])
    if not pressing > 0.0:
        return np.inf
    most = max(noise[0, 0], noise[1, 1], noise[2, 2])
    over = max(0.0, tangent - settings[FRICTION]) * pressing / (1.0 + tangent * tangent)
    total = over * over / most if most > 0.0 else np.inf if over > 0.0 else 0.0
    over = abs(torque) - settings[TORSION] * pressing
    if over > 0.0:
        row, square = np.empty(6), 0.0
        cross_into(place[:3], place[3:], row)  # tau = n . (M - p x F)
        for k in range(3):
            row[3 + k] = place[3 + k]
        for i in range(6):
            for j in range(6):
                square += row[i] * noise[i, j] * row[j]
        total += over * over / square if square > 0.0 else np.inf
    return total


@inner
def _at(wrench, noise, place, settings):
    """Return `beyond` for a contact at a place (6,), point and normal, with the torsion that the wrench has there."""
    one, turned = np.empty((1, 6)), np.empty(1)
    copy_into(place, one[0])
    turned[0], pressing = torsion(wrench, one, 0, 0.0)
    tangent = np.inf
    if pressing < 0.0:
        tangent = np.sqrt(max(0.0, dot(wrench[:3], wrench[:3]) / (pressing * pressing) - 1.0))
    return beyond(wrench, noise, place, turned[0], tangent, settings)


@inner
def _gap(branch, place):
    total = 0.0
    for k in range(3):
        total += (branch[MEAN + k] - place[k]) ** 2
    return total


@inner
def _far(wrench, noise, settings, state):
    """Return the distance [m] from a branch beyond which a candidate belongs to another; it grows with the noise."""
    known, moved = settings[SCALE] * _REACH, reach(wrench, noise, settings)
    if state[FOLLOW] == 1.0:
        moved *= min(1.0, np.sqrt(dot(wrench[:3], wrench[:3]) / state[BRANCHES + _WEIGHT]))
    return known + moved


@inner
def _alone(wrench, noise, state, settings, place):
    """Return whether there is only one branch and the place belongs to it."""
    for k in range(1, MOST):
        if state[BRANCHES + k * BRANCH] > 0.0:
            return False
    far = _far(wrench, noise, settings, state)
    return _gap(_branch(state, 0), place) < far * far


@inner
def _assign(wrench, noise, state, settings, places, near, count, of_branch, of_candidate):
    """Assign candidates to branches, closest pairs first; those far beyond the bounds only to the believed branch."""
    far = _far(wrench, noise, settings, state)
    for _ in range(MOST):
        least, which, whose = far * far, -1, -1
        for k in range(MOST):
            branch = _branch(state, k)
            if branch[_WEIGHT] == 0.0 or of_branch[k] >= 0:
                continue
            for i in range(count):
                if of_candidate[i] >= 0 or not (k == 0 or near[i] < _NEAR**2):
                    continue
                apart = _gap(branch, places[i])
                if apart < least:
                    least, which, whose = apart, i, k
        if which < 0:
            return
        of_branch[whose], of_candidate[which] = which, whose


@inner
def misfit(wrench, noise, branch, place):
    """Return the squared distance from a wrench to the nearest that a contact at a branch's mean place can make.

    It is in standard deviations of the wrench. The second value is the share of it that remains once the error of the
    mean is counted as well. The mean place goes into place (6,).
    """
    known = branch[_WEIGHT]
    length = np.sqrt(dot(branch[MEAN + 3 : MEAN + 6], branch[MEAN + 3 : MEAN + 6]))
    for k in range(3):
        place[k], place[3 + k] = branch[MEAN + k], branch[MEAN + 3 + k] / length
    far = distance_to_point(wrench, noise, place)
    return far * far, known / (known + dot(wrench[:3], wrench[:3]))


@inner
def _threshold(branch, deviations):
    return _LEAST + deviations * np.sqrt(branch[_SQUARES])


@inner
def _anew(wrench, state, found, places, near, count, best, squares, of_candidate):
    """Begin another touch, since a log may have one sample of each; if uncertain, old branches remain as rivals.

    Every candidate of the sample is possible, as in the first sample of a touch.
    """
    free = MOST - 1
    for k in range(MOST - 1, -1, -1):
        branch = _branch(state, k)
        if squares[k] < _SURELY**2 and (k == 0 or rival(state, k)):
            branch[_GAIN], branch[_SQUARES], branch[_HANDICAP] = -_WORST, _WORST**2, 0.0
        else:
            branch[_WEIGHT] = 0.0
            free = max(1, k)
    copy_into(_branch(state, 0), _branch(state, free))
    _begin(_branch(state, 0), found[best], places[best], dot(wrench[:3], wrench[:3]), 0.0)
    of_candidate[:] = -1
    of_candidate[best] = 0
    state[SAMPLES] = 1.0
    _born(wrench, state, found, places, near, count, squares, of_candidate)
    state[SAMPLES] = _WITHIN


@inner
def _believe(state, k, count, of_candidate):
    """Make branch k the first; the gains of the others are counted relative to it."""
    gain, squares = state[BRANCHES + k * BRANCH + _GAIN], state[BRANCHES + k * BRANCH + _SQUARES]
    for i in range(BRANCH):
        a, b = BRANCHES + i, BRANCHES + k * BRANCH + i
        state[a], state[b] = state[b], state[a]
    for j in range(1, MOST):
        branch = _branch(state, j)
        if j == k:
            branch[_GAIN], branch[_SQUARES], branch[_HANDICAP] = -0.5 * gain, squares, 0.0
        else:
            branch[_GAIN] -= gain
            branch[_SQUARES] += squares
    for i in range(count):
        if of_candidate[i] == k or of_candidate[i] == 0:
            of_candidate[i] = k - of_candidate[i]
    copy_into(_branch(state, 0)[MEAN : MEAN + 6], state[PREVIOUS : PREVIOUS + 6])  # edges are looked for near by


@inner
def _born(wrench, state, found, places, near, count, squares, of_candidate):
    """Make branches of the candidates that belong to none, while there is room."""
    handicap = min(_LATEST, _LATE * (state[SAMPLES] - 1.0))
    for i in range(count):
        if of_candidate[i] >= 0 or not near[i] < _NEAR**2:
            continue
        worst, which = np.inf, -1
        for k in range(1, MOST):
            branch = _branch(state, k)
            gain = -np.inf if branch[_WEIGHT] == 0.0 else branch[_GAIN] - branch[_HANDICAP]
            if gain < worst:
                worst, which = gain, k
        if worst < -handicap:
            _begin(_branch(state, which), found[i], places[i], dot(wrench[:3], wrench[:3]), handicap)
            of_candidate[i], squares[which] = which, np.inf


@inner
def _judge(wrench, noise, settings, state, found, places, near, of_branch, squares):
    """Add a sample's losses and move the branches; write their squared standard deviations into squares (MOST,)."""
    place, first_loss = np.empty(6), 0.0
    for k in range(MOST):
        branch = _branch(state, k)
        if branch[_WEIGHT] == 0.0:
            continue
        (off, share), i = misfit(wrench, noise, branch, place), of_branch[k]
        squares[k] = off * share + (near[i] if i >= 0 else _at(wrench, noise, place, settings))
        loss = min(_WORST, 0.5 * squares[k] - np.log(share))
        if i >= 0:
            _moved(branch, found[i], places[i], dot(wrench[:3], wrench[:3]))
        if k == 0:
            first_loss = loss
        else:
            gain = first_loss - loss
            branch[_GAIN] += gain
            branch[_SQUARES] += gain * gain


@inner
def _winner(state, of_branch, squares):
    """Return the branch that replaces the believed one; 0 if none does.

    If the believed branch cannot make the wrench, any other that can may win; the one that gained most does.
    """
    lost = of_branch[0] < 0 and not squares[0] < _ANOTHER**2
    top, winner = -np.inf if lost else 0.0, 0
    for k in range(1, MOST):
        branch = _branch(state, k)
        if branch[_WEIGHT] == 0.0 or not (squares[k] < EXPLAINED**2 if lost else of_branch[k] >= 0):
            continue
        margin = branch[_GAIN] - branch[_HANDICAP] - _threshold(branch, _TAKES)
        if margin > top:
            top, winner = margin, k
    return winner


@inner
def _remembered(wrench, state, settings, found, places, torques, count, square):
    """Write the last candidate of the believed branch into the row after this sample's candidates.

    Its residual is stored in place of its height.
    """
    copy_into(_branch(state, 0)[_LAST : _LAST + CANDIDATE], found[count])
    to_metres(found[count], settings, places[count])
    torques[count], _ = torsion(wrench, places, count, settings[SOFT])
    found[count, 5] = np.sqrt(square)
    found[count, 7] = 1.0 if found[count, 5] <= EXPLAINED else 0.0


@inner
def follow(wrench, noise, settings, state, found, places, torques, count, best, of_candidate):
    """Return the number of the candidate of the believed branch after this sample; write each one's branch, or -1.

    The branches go into of_candidate. If the believed branch has no candidate, but the wrench is near one made there,
    its last candidate is returned, in row `count`. `best` is the candidate to begin with.
    """
    state[SAMPLES] += 1.0
    first, weight = _branch(state, 0), wrench[0] ** 2 + wrench[1] ** 2 + wrench[2] ** 2
    for k in range(MEAN + 6):
        state[BEFORE + k] = first[k]
    of_candidate[:] = -1
    if first[_WEIGHT] == 0.0:
        _begin(first, found[best], places[best], weight, 0.0)
    state[CONTESTED] = 0.0
    if count == 1 and found[0, 7] == 1.0 and _alone(wrench, noise, state, settings, places[0]):
        _moved(first, found[0], places[0], weight)
        of_candidate[0] = 0
        return 0
    which = _followed(wrench, noise, settings, state, found, places, torques, count, best, of_candidate)
    for k in range(1, MOST):
        if rival(state, k):
            state[CONTESTED] = 1.0
    return which


@inner
def _followed(wrench, noise, settings, state, found, places, torques, count, best, of_candidate):
    """Do the work of `follow` if there are several branches, or a candidate away from the believed one."""
    near, of_branch = np.empty(count), np.full(MOST, -1)
    for i in range(count):
        near[i] = 0.0 if found[i, 7] == 1.0 else beyond(wrench, noise, places[i], torques[i], found[i, 4], settings)
        if 0.0 < near[i] < EXPLAINED**2:
            found[i, 7] = _MAY_BE
    _assign(wrench, noise, state, settings, places, near, count, of_branch, of_candidate)
    squares = np.full(MOST, np.inf)
    _judge(wrench, noise, settings, state, found, places, near, of_branch, squares)
    if state[FOLLOW] == 0.0:
        _born(wrench, state, found, places, near, count, squares, of_candidate)
        winner = _winner(state, of_branch, squares)
        if winner > 0:
            _believe(state, winner, count, of_candidate)
            of_branch[0], squares[0] = of_branch[winner], squares[winner]
    if of_branch[0] >= 0:
        return of_branch[0]
    if state[FOLLOW] == 0.0 and not squares[0] < _ANOTHER**2:
        _anew(wrench, state, found, places, near, count, best, squares, of_candidate)
        return best
    _remembered(wrench, state, settings, found, places, torques, count, squares[0])
    return count


@inner
def rival(state, branch):
    """Return whether this branch is still possible next to the believed one."""
    if branch < 0:
        return False
    one = _branch(state, branch)
    late = max(0.0, one[_HANDICAP] - _LATE * (EARLY - 1))
    return one[_WEIGHT] > 0.0 and one[_GAIN] - late > -_threshold(one, _APART)
