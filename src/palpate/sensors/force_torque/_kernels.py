"""Compiled loops from a reading to the contact's wrench in the surface's frame, with its covariance.

Explicit loops, sample by sample: a product by BLAS has other last bits in a batch of another size.
"""

# pyright: basic
from __future__ import annotations

import numpy as np

from palpate.signals._placing import mounting_errors, row, to_surface
from palpate.surfaces._jit import entry, inner, released
from palpate.surfaces._vectors import copy_into, cross_into, rotation_into

_SATURATED, _INVALID, _NO_POSE = 6, 7, 8
_LARGEST = 1e9  # signals.recording.LARGEST
# load: the payload, as numbers
# slope: of the mass by the weight, (w/|w|)/|g|; lever: 1/L^2 of `ForceTorque.gain_error`
_WEIGHT, _CENTER, _SLOPE, _MASS, _LEVER = 0, 3, 6, 9, 10


@inner
def _finite(values):
    """Return whether every value is a number of at most 1e9; False for NaN."""
    for value in values:  # noqa: SIM110 - numba knows no generators here
        if not abs(value) <= _LARGEST:
            return False
    return True


@inner
def _hang(rotation, acceleration, load, weight):
    """Write the force [N] of an accelerated payload in the sensor's frame, u = R^T w - m a, into `weight`."""
    for k in range(3):
        weight[k] = -load[_MASS] * acceleration[k]
        for j in range(3):
            weight[k] += rotation[j, k] * load[_WEIGHT + j]


@released("quaternions n 4, rotations out n 3 3")
def rotate(quaternions, rotations):
    """Compute `rotation_from_quaternion` of quaternions (n, 4) that are `sound_quaternions`; NaN of the others."""
    for i in range(len(quaternions)):
        rotation_into(quaternions[i], rotations[i])


@entry("readings n 6, quaternions n|0 4, accelerations n|0 3, unsteady n|0 1, ages n|0 1, inputs out 20n")
def gather(readings, quaternions, accelerations, unsteady, ages, inputs):
    """Lay out n samples as `Compensation.inputs` does; of arrays without rows, rotations are the identity, others 0."""
    n = len(readings)
    for i in range(n):
        copy_into(readings[i], inputs[6 * i : 6 * i + 6])
        rotation = inputs[6 * n + 9 * i : 6 * n + 9 * i + 9].reshape((3, 3))
        if len(quaternions) > 0:
            rotation_into(quaternions[i], rotation)
        else:
            for j in range(3):
                for k in range(3):
                    rotation[j, k] = 1.0 if j == k else 0.0
        for k in range(3):
            inputs[15 * n + 3 * i + k] = accelerations[i, k] if len(accelerations) > 0 else 0.0
        inputs[18 * n + i] = unsteady[i, 0] if len(unsteady) > 0 else 0.0
        inputs[19 * n + i] = ages[i, 0] if len(ages) > 0 else 0.0


@released(
    """
    readings n 6, rotations n|1 3 3, accelerations n|1 3, limits 6, load 11, zero 6, base bool, wrenches out n 6,
    statuses out int8 n
    """
)
def compensate(readings, rotations, accelerations, limits, load, zero, base, wrenches, statuses):
    """Compute `Payload.compensate` without its covariance, and each sample's status (-1: to be located).

    Takes readings (n, 6) as measured, in the base's frame or the sensor's; rotations (n, 3, 3), sensor in base, and
    accelerations (n, 3), or one row for all; limits (6,) of the sensor; zero (6,), its biases and the tare. Writes
    wrenches (n, 6) and statuses (n,); saturated samples are compensated too.
    """
    weight, moment = np.empty(3), np.empty(3)
    for i in range(len(readings)):
        reading, wrench = readings[i], wrenches[i]
        rotation, acceleration = row(rotations, i), row(accelerations, i)
        statuses[i] = -1
        if not _finite(reading):
            statuses[i] = _INVALID
        elif not _finite(rotation.flat):
            statuses[i] = _NO_POSE
        if base and statuses[i] == -1:
            for k in range(3):
                wrench[k] = rotation[0, k] * reading[0] + rotation[1, k] * reading[1] + rotation[2, k] * reading[2]
                wrench[3 + k] = rotation[0, k] * reading[3] + rotation[1, k] * reading[4] + rotation[2, k] * reading[5]
        else:
            copy_into(reading, wrench)
        if statuses[i] == -1 or (statuses[i] == _NO_POSE and not base):
            for k in range(6):
                if abs(wrench[k]) >= limits[k]:
                    statuses[i] = _SATURATED
        if load[_MASS] > 0.0 and not _finite(acceleration) and statuses[i] == -1:
            statuses[i] = _INVALID
        if statuses[i] == _INVALID or statuses[i] == _NO_POSE:
            wrench[:] = np.nan
            continue
        _hang(rotation, acceleration, load, weight)
        cross_into(load[_CENTER : _CENTER + 3], weight, moment)
        for k in range(3):
            wrench[k] -= weight[k] + zero[k]
            wrench[3 + k] -= moment[k] + zero[3 + k]


@inner
def _payload_errors(turn, weight, center, factor, matrix, work, errors):
    """Write J L for each row of a factor (r, 12), L L^T = C, of the payload's covariance: squares sum to J C J^T.

    An error dw, df, dc, dm changes the load by A dw + df in force and by c x (A dw) + dc x u + dm in torque.
    """
    error, moment = work[0], work[1]
    for i in range(len(factor)):
        column = factor[i]
        for k in range(3):
            error[k] = turn[k, 0] * column[0] + turn[k, 1] * column[1] + turn[k, 2] * column[2]
        cross_into(center, error, error[3:])
        cross_into(column[6:9], weight, moment)
        for k in range(3):
            error[k] += column[3 + k]
            error[3 + k] += moment[k] + column[9 + k]
        to_surface(matrix, error, errors[i])


@released(
    """
    wrenches n 6, rotations n|1 3 3, accelerations n|1 3, unsteady n|1 1, age n|1 1, share n|1, load 11, mean 4 3,
    factor c 12, mounting d 6, matrix 6 6, constant 5 6 6, located out n 6, covariance out n 6 6
    """
)
def place(
    wrenches,
    rotations,
    accelerations,
    unsteady,
    age,
    share,
    load,
    mean,
    factor,
    mounting,
    matrix,
    constant,
    located,
    covariance,
):
    """Transform wrenches (n, 6) to the surface's frame, and compute their covariances.

    Per sample, or one row for all: unsteady (n, 1), standard deviation of the acceleration, age (n, 1) [s] of the zero,
    and share (n,) of the noise that remains after a filter. Constant: mean (4, 3), the A = R^T - a (dm/dw)^T and u of a
    tare; factor (r, 12) of the payload's covariance, mounting (q, 6) of the mounting's; matrix (6, 6) from sensor to
    surface; constant (5, 6, 6), covariances in the surface's frame: 0, the part of the noise that a filter removes;
    1, the remaining noise, with the tare and the payload's misfit; 2, an acceleration of standard deviation 1; 3, the
    gains for a wrench of size 1; 4, a second of drift. Writes located (n, 6) and covariance (n, 6, 6).
    """
    turn, weight, work = np.empty((3, 3)), np.empty(3), np.empty((2, 6))
    errors = np.empty((len(factor) + len(mounting), 6))
    for i in range(len(wrenches)):
        rotation, acceleration = row(rotations, i), row(accelerations, i)
        to_surface(matrix, wrenches[i], located[i])
        if len(factor) > 0:
            _hang(rotation, acceleration, load, weight)
            for k in range(3):
                weight[k] -= mean[3, k]
                for j in range(3):
                    turn[k, j] = rotation[j, k] - acceleration[k] * load[_SLOPE + j] - mean[k, j]
            _payload_errors(turn, weight, load[_CENTER : _CENTER + 3], factor, matrix, work, errors)
        mounting_errors(located[i], mounting, work, errors[len(factor) :])
        kept, jolt, wrench, square = row(share, i), row(unsteady, i)[0], wrenches[i], 0.0
        old = row(age, i)[0]
        for k in range(3):
            square += wrench[k] * wrench[k] + load[_LEVER] * wrench[3 + k] * wrench[3 + k]
        for a in range(6):
            for b in range(a, 6):
                total = kept * constant[0, a, b] + constant[1, a, b] + jolt * jolt * constant[2, a, b]
                total += square * constant[3, a, b] + old * constant[4, a, b]
                for k in range(len(errors)):
                    total += errors[k, a] * errors[k, b]
                covariance[i, a, b] = covariance[i, b, a] = total
