"""Compiled: a serial chain's pose, Jacobian and motion, the damped step and the limits of its joints.

A chain is one array (n + 1, 16): row i holds the fixed transform before joint i (rotation by rows, translation), the
joint's axis in its own frame, and 1 if it turns or 0 if it slides; the last row is the transform to the sensor.
"""

# pyright: basic
from __future__ import annotations

import math

import numpy as np

from palpate.surfaces._jit import entry, inner
from palpate.surfaces._vectors import cross_into

_SHIFT, _AXIS, _TURNS = 9, 12, 15
_LOWER, _UPPER, _SPEED, _ACCELERATION = 0, 1, 2, 3


@inner
def _start(rotation, position):
    for r in range(3):
        position[r] = 0.0
        for c in range(3):
            rotation[r, c] = 1.0 if r == c else 0.0


@inner
def _shift_into(chain, i, rotation, out):
    """Write R t_i, in base axes, into out (3,)."""
    x, y, z = chain[i, _SHIFT], chain[i, _SHIFT + 1], chain[i, _SHIFT + 2]
    for r in range(3):
        out[r] = rotation[r, 0] * x + rotation[r, 1] * y + rotation[r, 2] * z


@inner
def _orient(chain, i, rotation, axis):
    """Set R to R R_i, and write the axis of joint i in base axes."""
    for r in range(3):
        a, b, c = rotation[r, 0], rotation[r, 1], rotation[r, 2]
        for k in range(3):
            rotation[r, k] = a * chain[i, k] + b * chain[i, 3 + k] + c * chain[i, 6 + k]
        axis[r] = (
            rotation[r, 0] * chain[i, _AXIS]
            + rotation[r, 1] * chain[i, _AXIS + 1]
            + rotation[r, 2] * chain[i, _AXIS + 2]
        )


@inner
def _turn(axis, angle, rotation):
    """Set R to exp([axis] angle) R by Rodrigues' formula, column by column."""
    c, s = math.cos(angle), math.sin(angle)
    for k in range(3):
        x, y, z = rotation[0, k], rotation[1, k], rotation[2, k]
        along = (1.0 - c) * (axis[0] * x + axis[1] * y + axis[2] * z)
        rotation[0, k] = c * x + s * (axis[1] * z - axis[2] * y) + along * axis[0]
        rotation[1, k] = c * y + s * (axis[2] * x - axis[0] * z) + along * axis[1]
        rotation[2, k] = c * z + s * (axis[0] * y - axis[1] * x) + along * axis[2]


@inner
def _walk(chain, q, point, rotation, position, axes):
    """Go to the point of the sensor frame; write the place of each joint into axes[0:3] and its axis into axes[3:6]."""
    _start(rotation, position)
    work = np.zeros((2, 3))
    axis, step = work[0], work[1]
    for i in range(len(q) + 1):
        _shift_into(chain, i, rotation, step)
        for r in range(3):
            position[r] += step[r]
        _orient(chain, i, rotation, axis)
        if i == len(q):
            break
        for r in range(3):
            axes[r, i] = position[r]
            axes[3 + r, i] = axis[r]
        if chain[i, _TURNS] > 0.5:
            _turn(axis, q[i], rotation)
        else:
            for r in range(3):
                position[r] += axis[r] * q[i]
    for r in range(3):
        position[r] += rotation[r, 0] * point[0] + rotation[r, 1] * point[1] + rotation[r, 2] * point[2]


@entry("chain n+1 16, q n, rotation out 3 3, translation out 3")
def pose(chain, q, rotation, translation):
    """Write T_base_sensor at joint positions q (n,) into rotation (3, 3) and translation (3,)."""
    _walk(chain, q, np.zeros(3), rotation, translation, np.empty((6, len(q))))


@entry("chain n+1 16, q n, point 3, out out 6 n")
def jacobian(chain, q, point, out):
    """Write the Jacobian of a point of the sensor frame, linear rows, then angular, in base axes, into out (6, n)."""
    position, rotation = np.empty(3), np.empty((3, 3))
    _walk(chain, q, point, rotation, position, out)
    for i in range(len(q)):
        zx, zy, zz = out[3, i], out[4, i], out[5, i]
        if chain[i, _TURNS] > 0.5:
            x, y, z = position[0] - out[0, i], position[1] - out[1, i], position[2] - out[2, i]
            out[0, i], out[1, i], out[2, i] = zy * z - zz * y, zz * x - zx * z, zx * y - zy * x
        else:
            out[0, i], out[1, i], out[2, i] = zx, zy, zz
            out[3, i], out[4, i], out[5, i] = 0.0, 0.0, 0.0


@inner
def _carry(step, out, work):
    """Move the reference point by d = `step` [m] along a rigid body: v + w x d, a + al x d + w x (w x d)."""
    turn, swing, twice = work[0], work[1], work[2]
    cross_into(out[3:6], step, turn)
    cross_into(out[9:12], step, swing)
    cross_into(out[3:6], turn, twice)
    for r in range(3):
        out[r] += turn[r]
        out[6 + r] += swing[r] + twice[r]


@entry("chain n+1 16, q n, rate n, change n, point 3, out out 12")
def motion(chain, q, rate, change, point, out):
    """Write velocity, angular velocity, acceleration, angular acceleration of a sensor-frame point into out (12,).

    From joint to joint, in base axes: the motion of a body, then the contribution of its joint.
    """
    rotation, work = np.empty((3, 3)), np.zeros((5, 3))
    axis, step = work[3], work[4]
    _start(rotation, step)
    for k in range(12):
        out[k] = 0.0
    for i in range(len(q)):
        _shift_into(chain, i, rotation, step)
        _carry(step, out, work)
        _orient(chain, i, rotation, axis)
        cross_into(out[3:6], axis, step)  # how the axis itself moves
        if chain[i, _TURNS] > 0.5:
            for r in range(3):
                out[9 + r] += step[r] * rate[i] + axis[r] * change[i]
                out[3 + r] += axis[r] * rate[i]
            _turn(axis, q[i], rotation)
        else:
            for r in range(3):
                out[r] += axis[r] * rate[i]
                out[6 + r] += 2.0 * step[r] * rate[i] + axis[r] * change[i]
                step[r] = axis[r] * q[i]
            _carry(step, out, work)
    n = len(q)
    _shift_into(chain, n, rotation, step)
    _carry(step, out, work)
    _orient(chain, n, rotation, axis)
    for r in range(3):
        step[r] = rotation[r, 0] * point[0] + rotation[r, 1] * point[1] + rotation[r, 2] * point[2]
    _carry(step, out, work)


@entry("jacobian 6 n, e 6, damping float, out out n")
def damped_step(jacobian, e, damping, out):
    """Write J' y into out (n,), where (J J' + damping^2 I) y = e; return |damping^2 y| / |e|, or NaN with out zero.

    By Cholesky factorisation of a 6 x 6 matrix; a pivot that is not positive means a singular or a bad matrix.
    """
    n, work = jacobian.shape[1], np.empty((7, 6))
    y = work[6]
    asked, left, sound = 0.0, 0.0, True
    for i in range(6):
        asked += e[i] * e[i]
        for j in range(i + 1):
            total = damping * damping if i == j else 0.0
            for k in range(n):
                total += jacobian[i, k] * jacobian[j, k]
            for k in range(j):
                total -= work[i, k] * work[j, k]
            if i == j:
                sound = sound and 0.0 < total < math.inf
                work[i, i] = math.sqrt(total) if sound else 1.0
            else:
                work[i, j] = total / work[j, j]
        total = e[i]
        for k in range(i):
            total -= work[i, k] * y[k]
        y[i] = total / work[i, i]
    for i in range(5, -1, -1):
        for k in range(i + 1, 6):
            y[i] -= work[k, i] * y[k]
        y[i] /= work[i, i]
        left += y[i] * y[i]
    sound = sound and left < math.inf
    for k in range(n):
        total = 0.0
        for i in range(6):
            total += jacobian[i, k] * y[i]
        sound = sound and abs(total) < math.inf
        out[k] = total
    if not sound:
        for k in range(n):
            out[k] = 0.0
        return math.nan
    return damping * damping * math.sqrt(left / asked) if asked > 0.0 else 0.0


@inner
def _brakes(room, slowing):
    """Return the longest step after which steps that shorten by `slowing` per cycle end within `room`.

    k slowing + r, where k (k + 1) / 2 slowing + (k + 1) r = room: the sum of the steps.
    """
    if not room > 0.0:
        return 0.0
    if slowing == math.inf or room == math.inf:
        return room
    if not slowing > 0.0:
        return 0.0
    k = np.floor(0.5 * (math.sqrt(1.0 + 8.0 * room / slowing) - 1.0))
    if not k < 1e9:  # faster than anything
        return room
    return k * slowing + (room - 0.5 * k * (k + 1.0) * slowing) / (k + 1.0)


@entry("limits 4 n, q n, step n, last n, dt float, out out n")
def limit(limits, q, step, last, dt, out):
    """Write q + step into out (n,) as far as the limits (4, n) allow; return the share of the step, NaN for a hold.

    last (n,) is the previous step, from which the acceleration is computed. out may be q itself.
    """
    share, sound = 1.0, 0.0 < dt < math.inf
    for k in range(len(q)):
        if not abs(q[k]) < math.inf:
            return math.nan  # nothing is known: out stays as it is
        sound = sound and abs(step[k]) < math.inf
    if not sound:
        share = 0.0
    else:
        for k in range(len(q)):
            most = limits[_SPEED, k] * dt
            if abs(step[k]) > most:
                share = min(share, most / abs(step[k]))
    period = dt if 0.0 < dt < math.inf else 0.0
    for k in range(len(q)):
        move = share * step[k] if sound else 0.0
        most, change = limits[_SPEED, k] * period, limits[_ACCELERATION, k] * period * period
        if change < math.inf:
            before = last[k] if abs(last[k]) < math.inf else 0.0
            move = min(max(move, before - change), before + change)
        up, down = limits[_UPPER, k] - q[k], q[k] - limits[_LOWER, k]
        move = min(move, _brakes(up, change)) if up >= 0.0 else min(move, 0.0)
        move = max(move, -_brakes(down, change)) if down >= 0.0 else max(move, 0.0)
        move = min(max(move, -most), most)
        goal = q[k] + move
        if up >= 0.0:  # rounding included
            goal = min(goal, limits[_UPPER, k])
        if down >= 0.0:
            goal = max(goal, limits[_LOWER, k])
        out[k] = goal
    return share if sound else math.nan


@entry("chain n+1 16, q n, offset n, axes 3 3, tip 3, turned out 3 3, at out 3")
def stance(chain, q, offset, axes, tip, turned, at):
    """Write axes (3, 3) and a tip (3,) of the sensor's frame in the base, for joints `offset` (n,) away from q (n,)."""
    rotation, translation, joints = np.empty((3, 3)), np.empty(3), np.empty(len(q))
    for k in range(len(q)):
        joints[k] = q[k] + offset[k]
    pose(chain, joints, rotation, translation)
    for i in range(3):
        at[i] = translation[i]
        for j in range(3):
            at[i] += rotation[i, j] * tip[j]
            turned[i, j] = 0.0
            for k in range(3):
                turned[i, j] += rotation[i, k] * axes[k, j]


@inner
def _bound(e, begin, most):
    """Shorten three entries of a wanted step to a length of at most `most`."""
    size = math.sqrt(e[begin] * e[begin] + e[begin + 1] * e[begin + 1] + e[begin + 2] * e[begin + 2])
    if size > most:
        for i in range(begin, begin + 3):
            e[i] *= most / size


@entry("chain n+1 16, limits 4 n, offset n, point 3, e out 6, bounds 3, dt float, command out n, last out n")
def stepped(chain, limits, offset, point, e, bounds, dt, command, last):
    """Advance the joint command (n,) and its step (n,) by one period, toward a wanted step e (6,) of a point.

    e is shortened to the speeds of the point in bounds (3,), damping, [m/s] and [rad/s]; if it is not finite it is set
    to zero. The joints are at command + `offset` (n,).
    """
    n = len(command)
    joints, step, following = np.empty(n), np.empty(n), np.empty(n)
    for i in range(6):
        if not abs(e[i]) < math.inf:
            for k in range(6):
                e[k] = 0.0
    _bound(e, 0, bounds[1] * dt)
    _bound(e, 3, bounds[2] * dt)
    for k in range(n):
        joints[k] = command[k] + offset[k]
        following[k] = command[k]
    columns = np.empty((6, n))
    jacobian(chain, joints, point, columns)
    damped_step(columns, e, bounds[0], step)
    limit(limits, command, step, last, dt, following)
    for k in range(n):
        last[k] = following[k] - command[k]
        command[k] = following[k]
