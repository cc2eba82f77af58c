"""Determine whether recorded accelerations contain gravity, as an IMU's do, or only the motion."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from palpate.spatial.arguments import takes_arrays
from palpate.spatial.pose import rotation_from_quaternion

G = 9.80665  # m/s^2
_NEAR = 0.1  # share by which a length may miss gravity: gains, and some motion
_QUICK = 0.5 * G  # m/s^2: a motion is slower at the median of a log, and an IMU reads more
_SCALES = {"m/s^2": 1.0, "g": G, "mg": 1e-3 * G}


@takes_arrays
def kind_of_acceleration(values: Float[np.ndarray, "n 3"], unit: str | None) -> tuple[str, str, float]:
    """Return the kind of accelerations ("imu", "motion" or "none"), their unit, and their median length in it.

    Args:
        values: (n, 3) [m/s^2] where the unit is known, else as recorded.
        unit: "m/s^2", "g" or "mg", as recorded; None: whichever makes the length that of gravity, else m/s^2.

    Raises:
        InputError: values has another shape.
    """
    length, steady = _length(values)
    if unit is not None:
        length /= _SCALES[unit]
    for each in (unit,) if unit is not None else ("m/s^2", "g", "mg"):
        if abs(length * _SCALES[each] / G - 1.0) < _NEAR and (steady or each == "m/s^2"):
            return "imu", each, length
    known = unit or "m/s^2"
    return ("motion" if length * _SCALES[known] < _QUICK else "none"), known, length


@takes_arrays
def wrong_acceleration(values: Float[np.ndarray, "n 3"], kind: str) -> str:
    """Return why accelerations (n, 3) [m/s^2] cannot be of a kind, and how to correct the rig; "" where they can.

    Args:
        values: (n, 3) [m/s^2].
        kind: "imu" or "motion"; nothing is wrong with any other.

    Raises:
        InputError: values has another shape.
    """
    length, _ = _length(values)
    if kind == "motion":
        found, unit, _ = kind_of_acceleration(values, None)
        if found == "imu":
            mend = 'kind = "imu"' if unit == "m/s^2" else f'kind = "imu" and unit = "{unit}"'
            return f"the accelerations contain gravity (their median length is {length:.3g}): write {mend}"
        if found == "none":
            return f'the median acceleration, {length:.3g} m/s^2, is not a motion: correct unit, or write kind = "none"'
    if kind == "imu" and abs(length / G - 1.0) > 3 * _NEAR:
        known, unit, _ = kind_of_acceleration(values, None)
        if known == "imu":
            return f'the accelerations are in {unit} (their median length is {length:.3g}): write unit = "{unit}"'
        return (
            f"an IMU reads 9.81 m/s^2 at rest, but the median length of the accelerations is {length:.3g}: "
            'correct unit, or write kind = "motion" or "none"'
        )
    return ""


@takes_arrays
def turned_from_gravity(
    values: Float[np.ndarray, "n 3"], quaternions: Float[np.ndarray, "n 4"], gravity: Float[np.ndarray, "3"]
) -> float:
    """Return the median angle [degrees] between an IMU's readings and those at rest, -R^T g; 0 without finite rows.

    Args:
        values: (n, 3) [m/s^2] in the sensor frame.
        quaternions: (n, 4) x, y, z, w: sensor in base.
        gravity: (3,) [m/s^2] in the base.

    Raises:
        InputError: arrays of other shapes.
    """
    known = np.isfinite(values).all(axis=1) & np.isfinite(quaternions).all(axis=1) & quaternions.any(axis=1)
    if not known.any():
        return 0.0
    rest = -np.einsum("nji,j->ni", rotation_from_quaternion(quaternions[known]), gravity)
    felt = values[known]
    lengths = np.linalg.norm(felt, axis=1) * np.linalg.norm(gravity)
    cosines = np.einsum("ni,ni->n", felt, rest) / np.maximum(lengths, 1e-12)
    return float(np.degrees(np.arccos(np.clip(np.median(cosines), -1.0, 1.0))))


def _length(values: Float[np.ndarray, "n 3"]) -> tuple[float, bool]:
    """Return the median length, and whether it is as steady as gravity's."""
    lengths = np.linalg.norm(values, axis=1)
    lengths = lengths[np.isfinite(lengths)]
    if not len(lengths):
        return 0.0, False
    low, middle, high = np.quantile(lengths, [0.1, 0.5, 0.9])
    return float(middle), bool(high - low < 0.4 * middle)
