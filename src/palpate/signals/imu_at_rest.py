"""Identify an accelerometer's bias and rotation on the sensor from a log's own rests, whose orientations are known."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from jaxtyping import Float

from palpate.signals.acceleration import G
from palpate.signals.imu import Imu
from palpate.signals.motion import Motion
from palpate.signals.recording import ACCELERATION, ORIENTATION, UNSTEADY, Recording
from palpate.spatial.arguments import takes_arrays
from palpate.spatial.pose import rotation_from_quaternion, skew
from palpate.spatial.pose_track import sound_quaternions

FEWEST = 50  # samples at rest
LENGTHS = {0.5: 1.5382, 0.99: 3.3682}  # quantiles of the length of a normal 3-vector: readings have longer tails
TILT, BIAS = np.radians(3.0), 0.5  # rad, m/s^2: most that the prior standard deviations may be
LEAST = 1e-6  # m/s^2: deviation of numbers without noise
LASTING, ROUNDS = 1.0, 10  # s of a rest that counts as one reading


@takes_arrays
def imu_at_rest(recording: Recording, motion: Motion) -> Imu | None:
    """Return the accelerometer of a recording as an `Imu`; None without orientations, or with under 50 samples at rest.

    At rest, by the poses, it reads a = Q f + bias with f = -R^T g, or 0 where its readings are without gravity. Q and
    bias are those of maximum posterior density. Their prior standard deviations are the readings' deviation from f,
    and that over 1 g, at most 0.5 m/s^2 and 3 degrees. Each second of a rest counts as one reading, for errors that
    last. A single orientation shows only what both add up to; the covariance holds how uncertain that is in others.

    Args:
        recording: with ACCELERATION.
        motion: source of the accelerations, "motion" or "imu".

    Raises:
        InputError: the recording has no accelerations.
    """
    if ORIENTATION not in recording.channels:
        return None
    readings, forces, rests = _at_rest(recording, motion)
    if len(readings) < FEWEST:
        return None
    middles = np.array([np.median(readings[rest], axis=0) for rest in rests])
    directions = np.array([np.median(forces[rest], axis=0) for rest in rests])
    noise = _deviation(readings - forces)
    least = 1.0 / np.repeat([min(noise / G, TILT), min(noise, BIAS)], 3) ** 2
    state, covariance = np.zeros(6), np.zeros((6, 6))  # rotation vector [rad] of Q, bias
    for _ in range(ROUNDS):
        turn = _imu(state, covariance, noise).rotation
        slope = np.concatenate([-turn @ skew(directions), np.tile(np.eye(3), (len(rests), 1, 1))], axis=2).reshape(
            -1, 6
        )
        away = (middles - directions @ turn.T - state[3:]).ravel()
        information: Float[np.ndarray, "6 6"] = slope.T @ slope / noise**2 + np.diag(least)
        covariance = np.linalg.inv(information)
        state = state + covariance @ (slope.T @ away / noise**2 - least * state)
        noise = _deviation(_imu(state, covariance, noise).forces(readings) - forces)
    return _imu(state, covariance, noise)


def _imu(state: Float[np.ndarray, "6"], covariance: Float[np.ndarray, "6 6"], noise: float) -> Imu:
    """Return the `Imu` of a small rotation vector and a bias, which no payload is correlated with."""
    return Imu([*state[:3] / 2.0, 1.0], state[3:], noise, np.concatenate([np.zeros((6, 12)), covariance], axis=1))


def _at_rest(
    recording: Recording, motion: Motion
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"], list[slice]]:
    """Return the readings (n, 3) where poses show no motion, the specific forces (n, 3) there, and seconds of rests."""
    still = Motion(window=motion.window, lever=motion.lever).stream(iter([recording]))
    unsteady = np.concatenate([block.channels[UNSTEADY][:, 0] for block in still])
    readings, quaternions = recording.channels[ACCELERATION], recording.channels[ORIENTATION]
    known = (unsteady == 0.0) & np.isfinite(readings).all(axis=1) & sound_quaternions(quaternions)
    gravity = np.zeros(3) if motion.source != "imu" or motion.gravity is None else motion.gravity
    forces = -np.einsum("nji,j->ni", rotation_from_quaternion(quaternions[known]), gravity)
    rows, seconds = np.flatnonzero(known), np.floor(recording.time[known] / LASTING)
    cuts: list[int] = [0, *(np.flatnonzero((np.diff(rows) > 1) | (np.diff(seconds) != 0)) + 1).tolist(), len(rows)]
    return readings[known], forces, [slice(start, end) for start, end in pairwise(cuts)]


def _deviation(off: Float[np.ndarray, "n 3"]) -> float:
    """Return the standard deviation [m/s^2] along each axis that explains most lengths, and the longest 1 % too."""
    found = np.quantile(np.linalg.norm(off, axis=1), list(LENGTHS))
    return max(float((found / list(LENGTHS.values())).max()), LEAST)
