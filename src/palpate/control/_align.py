"""Compiled: the small steps of a control cycle, each of which would take 50 us of calls in NumPy."""

# pyright: basic
from __future__ import annotations

import numpy as np

from palpate.surfaces._jit import entry, inner
from palpate.surfaces._vectors import cross_into

MISJUDGED = 0.25  # of what the payload's motion takes
STEEPEST = 0.866  # sine of the largest angle that a place on the face can mean


@inner
def _turned(matrix, vector, out):
    """Write matrix (3, 3) times vector (3,) into out."""
    for i in range(3):
        out[i] = matrix[i, 0] * vector[0] + matrix[i, 1] * vector[1] + matrix[i, 2] * vector[2]


@inner
def _back(matrix, vector, out):
    """Write matrix^T (3, 3) times vector (3,) into out."""
    for i in range(3):
        out[i] = matrix[0, i] * vector[0] + matrix[1, i] * vector[1] + matrix[2, i] * vector[2]


@entry("motion 12, sensor 3 3, inertia 3 3, load 3, wrench 6, out out 6, acceleration out 3, moved out 3")
def felt(motion, sensor, inertia, load, wrench, out, acceleration, moved):
    """Write the wrench (6,) plus the moment that turns the payload, M + I al + w x I w, and its centre's acceleration.

    motion (12,) of the payload's centre in the base (`Arm.motion_into`), sensor (3, 3) in the base; acceleration (3,)
    is in the sensor's frame. load (3,): mass times the vector from the tip to the payload's centre. moved (3,):
    the moment about the tip, in the sensor's frame, that the payload's complete motion takes.
    """
    turning, speeding, momentum, gyro = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    _back(sensor, motion[3:6], turning)
    _back(sensor, motion[6:9], acceleration)
    _back(sensor, motion[9:12], speeding)
    _turned(inertia, turning, momentum)
    cross_into(turning, momentum, gyro)
    cross_into(load, acceleration, moved)
    for i in range(3):
        spent = gyro[i]
        for j in range(3):
            spent += inertia[i, j] * speeding[j]
        out[i] = wrench[i]
        out[3 + i] = wrench[3 + i] + spent
        moved[i] += spent


@entry(
    """
    row 22, sensor 3 3, place 3, face 3 3, middle 3, axes 3 3, tip 3, moved 3, rotation out 3 3, at out 3, found
    out 3, variance out 2, force out 3
    """
)
def sensed(row, sensor, place, face, middle, axes, tip, moved, rotation, at, found, variance, force):
    """Write a law's input: axes of the face and its middle in the base; place, variance and force in the face's axes.

    row (22,) of the estimate in the surface's frame, where the face has its axes (3, 3) `face` and its `middle`; `axes`
    and `tip` are the same in the sensor's frame, whose pose is sensor, place. A share of `moved`, see `felt`, is taken
    as its error: the displacement by this moment adds to the variance of the place.
    """
    for i in range(3):
        at[i] = place[i]
        found[i] = force[i] = 0.0
        for j in range(3):
            at[i] += sensor[i, j] * tip[j]
            found[i] += (row[j] - middle[j]) * face[j, i]
            force[i] += row[6 + j] * face[j, i]
            rotation[i, j] = 0.0
            for k in range(3):
                rotation[i, j] += sensor[i, k] * axes[k, j]
    for i in range(2):
        variance[i] = 0.0
        for j in range(3):
            for k in range(3):
                variance[i] += face[j, i] * row[10 + 3 * j + k] * face[k, i]
        if not variance[i] >= 0.0:
            variance[i] = 0.0
        moment = MISJUDGED * (moved[0] * axes[0, 1 - i] + moved[1] * axes[1, 1 - i] + moved[2] * axes[2, 1 - i])
        variance[i] += moment * moment / (force[2] * force[2] + 1e-6)


@inner
def _outward(values, axes, out):
    """Write the normal in the base, into the tissue, of a surface that leans by two angles in the first axes."""
    x, y = np.tan(values[0]), np.tan(values[1])
    length = np.sqrt(x * x + y * y + 1.0)
    for i in range(3):
        out[i] = (axes[i, 0] * x + axes[i, 1] * y + axes[i, 2]) / length


@entry(
    """
    place 3, variance 2, force 3, rotation 3 3, tip 3, radii 2, axes 3 3, origin 3, values 3, wanted float,
    stiffness float, floor 3, readings out 3, worth out 3
    """
)
def observed(
    place, variance, force, rotation, tip, radii, axes, origin, values, wanted, stiffness, floor, readings, worth
):
    """Write angles and height of the surface from one contact into readings (3,); return the normal force [N].

    worth (3,): variances of the readings, for the angles from that of the place (2,), none below floor (3,).

    place, force (3,) are in the face's axes, whose pose is `rotation`, `tip`; axes, origin: of the first touch;
    values (3,): present estimate of the surface, for the lowest point of the probe.
    """
    normal, local, low = np.empty(3), np.empty(3), np.empty(3)
    local[0], local[1] = place[0] / radii[0], place[1] / radii[1]
    sine = np.sqrt(local[0] * local[0] + local[1] * local[1])
    if sine > STEEPEST:
        local[0] *= STEEPEST / sine
        local[1] *= STEEPEST / sine
        sine = STEEPEST
    local[2] = np.sqrt(1.0 - sine * sine)
    _turned(rotation, local, normal)
    _back(axes, normal, low)
    readings[0], readings[1] = np.arctan2(low[0], low[2]), np.arctan2(low[1], low[2])
    _outward(values, axes, normal)
    _back(rotation, normal, local)
    pressing = -(local[0] * force[0] + local[1] * force[1] + local[2] * force[2])
    along, across = radii[0] * local[0], radii[1] * local[1]
    drop = -0.5 * (along * local[0] + across * local[1])  # the lowest point is R (n, -n^2 / 2) off the middle
    height = upright = 0.0
    for i in range(3):
        low[i] = rotation[i, 0] * along + rotation[i, 1] * across + rotation[i, 2] * drop + tip[i] - origin[i]
        height += low[i] * normal[i]
        upright += normal[i] * axes[i, 2]
    readings[2] = (height - (pressing - wanted) / stiffness) / upright
    worth[2] = floor[2]
    for k in range(2):
        worth[k] = max(floor[k], variance[k] / (radii[k] * radii[k]))
    return pressing


@entry("goal 3, smoothing 3, period float, value out 3, rate out 3")
def smoothed(goal, smoothing, period, value, rate):
    """Move values and rates (c,) over a period [s] to goals (c,), critically damped, with lags `smoothing` (c,) [s]."""
    for c in range(len(value)):
        w = 2.0 / smoothing[c]
        decay = np.exp(-w * period)
        off = value[c] - goal[c]
        slope = rate[c] + w * off
        moved = (off + slope * period) * decay
        value[c] = goal[c] + moved
        rate[c] = slope * decay - w * moved


@entry("values 3, axes 3 3, origin 3, depth float, rotation 3 3, tip 3, out out 6")
def target(values, axes, origin, depth, rotation, tip, out):
    """Write the step (6,) from a pose (rotation, tip) to the pose that meets the surface, in base axes.

    The probe's axis goes to the normal n by the least rotation (Rodrigues), so that the probe does not spin. The
    surface, `depth` above the height of the wanted force, meets the first axis at one point; the tip goes `depth` below
    that point along n, so that a surface which turns is not dragged sideways.
    """
    n, v, turned = np.empty(3), np.empty(3), np.empty((3, 3))
    _outward(values, axes, n)
    upright = n[0] * axes[0, 2] + n[1] * axes[1, 2] + n[2] * axes[2, 2]
    for i in range(3):
        out[i] = origin[i] + (values[2] - depth / upright) * axes[i, 2] + depth * n[i] - tip[i]
    cross_into(axes[:, 2], n, v)
    one, two = np.empty(3), np.empty(3)
    for j in range(3):
        cross_into(v, axes[:, j], one)
        cross_into(v, one, two)
        for i in range(3):
            turned[i, j] = axes[i, j] + one[i] + two[i] / (1.0 + upright)
    _vector(turned, rotation, out[3:])


@inner
def _vector(to, of, out):
    """Write the rotation vector in the base that turns the axes `of` into `to`, by less than half a turn."""
    out[0] = out[1] = out[2] = 0.0
    trace = 0.0
    for j in range(3):
        out[0] += 0.5 * (of[1, j] * to[2, j] - of[2, j] * to[1, j])
        out[1] += 0.5 * (of[2, j] * to[0, j] - of[0, j] * to[2, j])
        out[2] += 0.5 * (of[0, j] * to[1, j] - of[1, j] * to[0, j])
        for i in range(3):
            trace += to[i, j] * of[i, j]
    sine = np.sqrt(out[0] * out[0] + out[1] * out[1] + out[2] * out[2])
    if sine > 1e-9:
        size = np.arctan2(sine, 0.5 * (trace - 1.0)) / sine
        for i in range(3):
            out[i] *= size
