"""Compiled: the acceleration of a path, from a cubic through its latest points."""

# pyright: basic
from __future__ import annotations

import numpy as np

from palpate.surfaces._jit import entry, inlined, inner
from palpate.surfaces._vectors import rotation_into

PARTS = 9  # of the window, each with a mean point
WIDTH = 9  # columns of a path: a point, or a rotation matrix where the positions are unknown
STATE = 138
_SEEN = 16.0  # times the noise's variance, from which a path counts as moving
_FADING = 0.7  # from part to part, of the share of the fourth order
_LAST, _BEGUN, _COUNT, _AGES, _FILLED, _USED = 0, 1, 2, 3, 4, 5  # of the state
_SUMS, _TIMES, _MEANS = 6, 15, 24  # of the part that grows; of the complete ones, oldest first
_CENTRE, _STEP, _SIZE, _TERMS, _MISFIT, _QUARTIC = 105, 109, 113, 118, 136, 137  # of the fit


@inlined
def _point(quaternion, position, lever, reach, turn, path):
    """Write the rotation matrix and the path's point; return its columns."""
    rotation_into(quaternion, turn)
    if position[0] + position[1] + position[2] != position[0] + position[1] + position[2]:
        for j in range(3):
            for k in range(3):
                path[3 * j + k] = reach * turn[j, k]
        return 9
    for j in range(3):
        path[j] = position[j] + turn[j, 0] * lever[0] + turn[j, 1] * lever[1] + turn[j, 2] * lever[2]
    return 3


@inner
def _begin(state, time, used):
    state[_BEGUN], state[_COUNT], state[_AGES], state[_USED] = time, 0.0, 0.0, used
    state[_SUMS : _SUMS + WIDTH] = 0.0


@inner
def _fit(state, used):
    """Fit polynomials of degree 4 that are orthogonal on the parts' times, by their three-term recurrence."""
    times = state[_TIMES : _TIMES + PARTS]
    now, before, place = np.ones(PARTS), np.zeros(PARTS), times - times[PARTS - 1]
    left, earlier = np.empty((PARTS, WIDTH)), 1.0
    for i in range(PARTS):
        for c in range(used):
            left[i, c] = state[_MEANS + WIDTH * i + c] - state[_MEANS + WIDTH * (PARTS - 1) + c]
    for degree in range(5):
        square, whole = np.sum(now * now), 0.0
        for c in range(used):
            term = 0.0
            for i in range(PARTS):
                term += now[i] * left[i, c]
            term /= square
            whole += term * term * square
            if degree == 2 or degree == 3:
                state[_TERMS + WIDTH * (degree - 2) + c] = term
            for i in range(PARTS):
                left[i, c] -= term * now[i]
        state[_SIZE + degree] = square
        if degree == 4:  # of a swing it passes through 0 twice in a period
            state[_QUARTIC] = max(whole, _FADING * state[_QUARTIC])
        if degree < 4:
            centre, step = np.sum(place * now * now) / square, square / earlier if degree > 0 else 0.0
            state[_CENTRE + degree], state[_STEP + degree] = centre, step
            later = (place - centre) * now - step * before
            before, now, earlier = now, later, square
    misfit = 0.0
    for i in range(PARTS):
        for c in range(used):
            misfit += left[i, c] * left[i, c]
    state[_MISFIT] = misfit / (PARTS - 5)


@inner
def _bend(state, time, used, found):
    """Write the second derivative at a time; return the variances, by noise and by what the cubic leaves out.

    They are summed over the columns.
    """
    place = time - state[_TIMES + PARTS - 1]
    value, slope, bend, value_before, slope_before, bend_before = 1.0, 0.0, 0.0, 0.0, 0.0, 0.0
    noise, rest = 0.0, 0.0
    found[:used] = 0.0
    for degree in range(5):
        if degree >= 2:
            if degree < 4:
                for c in range(used):
                    found[c] += state[_TERMS + WIDTH * (degree - 2) + c] * bend
                noise += state[_MISFIT] * bend * bend / state[_SIZE + degree]
            else:
                rest = max(state[_QUARTIC] - state[_MISFIT], 0.0) * bend * bend / state[_SIZE + degree]
        if degree < 4:
            away, step = place - state[_CENTRE + degree], state[_STEP + degree]
            later = away * value - step * value_before
            later_slope = value + away * slope - step * slope_before
            later_bend = 2.0 * slope + away * bend - step * bend_before
            value_before, slope_before, bend_before = value, slope, bend
            value, slope, bend = later, later_slope, later_bend
    return noise, rest


@entry(
    """
    time n, quaternions n 4, positions n 3, lever 3, window float, gap float, reach float, unknown float, state out 138,
    accelerations out n 3, unsteady out n 1
    """
)
def follow(time, quaternions, positions, lever, window, gap, reach, unknown, state, accelerations, unsteady):
    """Write accelerations (n, 3) [m/s^2] in the sensor's frame; add their variances along an axis to unsteady squared.

    The path is the lever's, or, where positions are NaN, `reach` times the rotation matrix: then the acceleration is 0,
    and its size is written as its deviation, as it is where `unknown` is 0. Else rows without a complete window have
    the deviation `unknown`. Times that go back, or forward by more than `gap`, and rows without a pose begin anew.
    """
    turn, path, found = np.empty((3, 3)), np.empty(WIDTH), np.empty(WIDTH)
    for i in range(len(time)):
        now = time[i]
        accelerations[i] = 0.0
        used = _point(quaternions[i], positions[i], lever, reach, turn, path)
        if not np.isfinite(now) or not np.isfinite(turn[0, 0]):
            state[_LAST] = np.nan
            continue
        step = now - state[_LAST]
        if not 0.0 <= step <= gap or used != int(state[_USED]):
            state[_FILLED] = 0.0
            _begin(state, now, used)
        elif now - state[_BEGUN] >= window / PARTS * (1.0 - 1e-9) and state[_COUNT] > 0.0:
            state[_TIMES : _TIMES + PARTS - 1] = state[_TIMES + 1 : _TIMES + PARTS].copy()
            kept = WIDTH * (PARTS - 1)
            state[_MEANS : _MEANS + kept] = state[_MEANS + WIDTH : _MEANS + WIDTH + kept].copy()
            state[_TIMES + PARTS - 1] = state[_BEGUN] + state[_AGES] / state[_COUNT]
            for c in range(WIDTH):
                state[_MEANS + kept + c] = state[_SUMS + c] / state[_COUNT]
            state[_FILLED] = min(state[_FILLED] + 1.0, PARTS)
            if state[_FILLED] == PARTS:
                _fit(state, used)
            _begin(state, now, used)
        state[_LAST] = now
        state[_COUNT] += 1.0
        state[_AGES] += now - state[_BEGUN]
        for c in range(used):
            state[_SUMS + c] += path[c]
        variance = unknown * unknown
        if state[_FILLED] == PARTS:
            noise, rest = _bend(state, now, used, found)
            if used == 3 and unknown > 0.0:
                variance = (noise + rest) / 3.0
                for k in range(3):
                    accelerations[i, k] = turn[0, k] * found[0] + turn[1, k] * found[1] + turn[2, k] * found[2]
            else:
                size = np.sum(found[:used] ** 2) + rest
                variance = size / 3.0 if size > _SEEN * noise else 0.0
        unsteady[i, 0] = np.sqrt(unsteady[i, 0] * unsteady[i, 0] + variance)
