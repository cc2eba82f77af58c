"""Identify a payload, and an accelerometer's mounting on the sensor, from rests of unknown orientation."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from jaxtyping import Float

from palpate.calls import called_as
from palpate.errors import InputError, NotIdentifiable
from palpate.sensors.force_torque._payload_hypotheses import WORST_SHARE, far_centre, unused
from palpate.sensors.force_torque._payload_imu import ImuFit, fit, left_out
from palpate.sensors.force_torque._payload_solve import rms
from palpate.signals.acceleration import kind_of_acceleration
from palpate.signals.imu import Imu
from palpate.signals.payload import STANDARD_GRAVITY, Payload
from palpate.signals.recording import LARGEST
from palpate.spatial._arrays import require_complete
from palpate.spatial.arguments import takes_arrays
from palpate.spatial.pose import quaternion_from_rotation

MIRRORED = 3.0  # times smaller residuals name mirrored axes
OFF, MOVED = 0.01, 0.05  # of |g|: a length of gravity that errs by more is noted, one that varies by more is refused


@called_as("palpate.identify_payload_with_imu(wrenches, accelerations)")
@takes_arrays
def identify_payload_with_imu(
    wrenches: Float[np.ndarray, "n 6"],
    accelerations: Float[np.ndarray, "n 3"],
    *,
    magnitude: float = STANDARD_GRAVITY,
    noise: float | None = None,
    robust: bool = True,
    of: str = "samples",
    provenance: Mapping[str, str] | None = None,
) -> Payload:
    """Identify weight, centre of mass, biases, and the accelerometer's rotation and bias, without orientations.

    The sensor rests in four orientations or more that differ about two axes, each with a gravity of its own: total
    least squares of forces, torques and accelerations, each kind weighted by its residuals. The covariance comes from
    these, and is widened where parts of the log do not predict each other. Average the samples of each rest first.

    Args:
        wrenches: (n, 6) [N, N m] in the sensor frame, in the order of time. Rows with NaN or infinity are ignored.
        accelerations: (n, 3) [m/s^2] of the accelerometer in its own axes; at rest 1 g, against gravity.
        magnitude: |g| [m/s^2].
        noise: [m/s^2] standard deviation of one reading of the accelerometer, kept in the model; None: that of a row.
        robust: set rows aside that lie 5 robust standard deviations from the fit, and list their number in the notes.
        of: name of a row in messages: "samples", or "rests" where each is a mean.
        provenance: kept in the payload, in addition to the options used here.

    Returns:
        The payload as a `Payload`, with its `imu` and notes.

    Raises:
        NotIdentifiable: the orientations cannot separate the parameters; names which, and the turn to add.
        InputError: a shape is wrong, no row is complete, the magnitude is not positive, the accelerations are not those
            of an accelerometer at rest in m/s^2, or the residual is more than 20 % of the weight.
    """
    if not 0.0 < magnitude <= LARGEST:  # NaN too
        raise InputError(f"magnitude of gravity must be positive, not {magnitude}.")
    rows = np.concatenate([wrenches, accelerations], axis=1)
    complete = np.asarray((np.abs(rows) <= LARGEST).all(axis=1), dtype=bool)
    readings = rows[complete]
    require_complete(complete)
    _require_gravity(readings[:, 6:], magnitude)
    try:
        found = fit(readings, magnitude, of, robust=robust)
        wrong = _unexplained(found, readings, magnitude)
    except NotIdentifiable as refused:
        if (mirrored := _mirrored(readings, magnitude, of, np.inf)) is not None:
            raise mirrored from refused
        raise
    if wrong is not None:
        raise _mirrored(readings, magnitude, of, _share(found, readings, magnitude)) or wrong
    left = left_out(found, readings, magnitude, of)
    lengths, far = _lengths(found, readings, magnitude), far_centre(found.rest[3:6])
    notes = [*unused(complete, found.kept, of), *lengths, *left.notes, *far]
    covariance = np.zeros((18, 18))
    covariance[2:, 2:] = left.widening * found.covariance
    options = {"gravity": "IMU", "robust": str(robust).lower(), "left_out": str(left)}
    seen = float(found.deviations[-1]) if noise is None else noise
    return Payload(
        [0.0, 0.0, -found.weight],
        *found.rest[:9].reshape(3, 3),
        covariance=covariance[:12, :12],
        magnitude=magnitude,
        residual=rms(found.residuals(readings, magnitude)[found.kept, :6]),
        samples=int(found.kept.sum()),
        provenance={**options, **(provenance or {})},
        notes=notes,
        imu=Imu(quaternion_from_rotation(found.turn), found.rest[9:], seen, covariance[12:]),
    )


def _require_gravity(accelerations: Float[np.ndarray, "n 3"], magnitude: float) -> None:
    """Raise an InputError unless accelerations (n, 3) have a length near gravity's."""
    kind, unit, length = kind_of_acceleration(accelerations, None)
    lengths = np.linalg.norm(accelerations, axis=1)
    if kind == "imu" and unit != "m/s^2":
        raise InputError(
            f"the accelerations are in {unit}: their median length is {length:.3g}, not {magnitude:.3g} m/s^2.",
            hint=f'Write unit = "{unit}" in the rig\'s [acceleration], or multiply them to get m/s^2.',
        )
    if np.median(lengths) < 0.5 * magnitude:
        raise InputError(
            f"the accelerations hold no gravity: their median length is {np.median(lengths):.2g} m/s^2, and that of an "
            f"accelerometer at rest {magnitude:.3g}. They are the rates of a gyroscope, or gravity was taken off.",
            hint="Name the columns or the topic of the accelerometer in the rig's [acceleration].",
        )
    if not 0.7 * magnitude < np.median(lengths) < 1.3 * magnitude:
        raise InputError(
            f"an accelerometer at rest reads {magnitude:.3g} m/s^2, but the median length here is "
            f"{np.median(lengths):.3g}: correct unit in the rig's [acceleration], or name the accelerometer there."
        )


def _share(found: ImuFit, readings: np.ndarray, magnitude: float) -> float:
    """Return the rms of the force's residual over the weight, of all rows."""
    return float(rms(found.residuals(readings, magnitude)[:, :6])[0]) / found.weight


def _unexplained(found: ImuFit, readings: np.ndarray, magnitude: float) -> InputError | None:
    """Return the error that says that the log is not one of rests with a payload; None where the fit explains it."""
    left = found.residuals(readings, magnitude)[found.kept]
    varies = float(np.linalg.norm(readings[found.kept, 6:] - found.rest[9:], axis=1).std())
    if varies > MOVED * magnitude:
        return InputError(
            f"the length of gravity by the IMU varies by {varies:.2g} m/s^2 about {magnitude:.3g}: the sensor moved.",
            hint="Hold it still in each orientation for a second, or check for accelerations of another sensor.",
        )
    if (share := rms(left[:, :6])[0] / found.weight) > WORST_SHARE or not found.kept.mean() > 0.5:
        return InputError(
            f"the fit keeps {found.kept.mean():.0%} of the log and leaves {share:.0%} of the weight in it: forces and "
            "accelerations do not turn together.",
            hint="Check for touches and motion, wrong units or times, and that the IMU is fixed to the sensor.",
        )
    return None


def _mirrored(readings: np.ndarray, magnitude: float, of: str, share: float) -> InputError | None:
    """Return the error that names reversed or mirrored axes, if they leave far less of the force than `share`."""
    try:
        other = fit(readings * np.repeat([1.0, -1.0], [6, 3]), magnitude, of)
    except NotIdentifiable:
        return None
    if _share(other, readings * np.repeat([1.0, -1.0], [6, 3]), magnitude) > min(share / MIRRORED, WORST_SHARE):
        return None
    return InputError(
        "forces and accelerations are mirror images: the accelerations point along gravity at rest, or one of the two "
        "has left-handed axes, or the wrench acts on the payload.",
        hint="Reverse the accelerations or one axis of theirs, or correct axes or acts_on in the rig's [force_torque].",
    )


def _lengths(found: ImuFit, readings: np.ndarray, magnitude: float) -> Iterator[str]:
    """Yield a sentence where the lengths of gravity are not what they must be at rest."""
    lengths = np.linalg.norm(readings[found.kept, 6:] - found.rest[9:], axis=1)
    if lengths.std() > OFF * magnitude:
        yield (
            f"The length of gravity by the IMU varies by {lengths.std():.2g} m/s^2: the sensor moved, or the axes of "
            "the IMU have unequal scales."
        )
    if abs(lengths.mean() / magnitude - 1.0) > OFF:
        yield (
            f"Gravity by the IMU is {lengths.mean():.3f} m/s^2, not {magnitude:.3f}: its scale is off, which is taken "
            "for an acceleration of the payload."
        )
