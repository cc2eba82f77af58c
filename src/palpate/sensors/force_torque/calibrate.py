"""Identify the payload and the sensor's bias from free motion: nothing touches the sensor, its orientation is known."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float
from numpy.typing import ArrayLike

from palpate.calls import called_as
from palpate.errors import InputError, NotIdentifiable
from palpate.sensors.force_torque._payload_hypotheses import WORST_SHARE, doubts, far_centre, is_bad, mistaken, unused
from palpate.sensors.force_torque._payload_mistakes import AS_IS, corrected
from palpate.sensors.force_torque._payload_solve import PayloadSettings, judged, solve
from palpate.signals.payload import STANDARD_GRAVITY, Payload
from palpate.signals.recording import LARGEST
from palpate.spatial._arrays import require_complete, shaped
from palpate.spatial.arguments import takes_arrays
from palpate.spatial.pose import rotation_from_quaternion
from palpate.spatial.uncertain import noise_covariance
from palpate.spatial.wrench import Wrench


@called_as("palpate.identify_payload(wrenches, quaternions)")
@takes_arrays
def identify_payload(
    wrenches: Wrench | ArrayLike,
    rotations: ArrayLike,
    *,
    gravity: ArrayLike | None = None,
    magnitude: float = STANDARD_GRAVITY,
    noise: ArrayLike | None = None,
    robust: bool = True,
    hypothesis: str = AS_IS,
    unchecked: bool = False,
    of: str = "samples",
    provenance: Mapping[str, str] | None = None,
) -> Payload:
    """Identify weight, centre of mass and biases from wrenches of the payload alone [probe, (1)-(2), corrected].

    Two linear least squares: force on (weight, bias), then torque on (centre, bias) with the modelled weight; then all
    jointly, if `noise` is given and explains the residuals. The covariance comes from the residuals, or from the noise
    if it explains them, and from the drift of the bias; it is widened where parts of the log do not predict each other.
    From residuals alone it is too small by 1.1 at 40 poses, by 2 at 12: with few poses state the noise. Average the
    samples of each pose first: they share one error.

    Args:
        wrenches: (n, 6) [N, N m], or a `Wrench` of n, in the sensor frame, in the order of time. Rows with NaN or
            infinity (above 1e9) are ignored and listed in the notes.
        rotations: (n, 3, 3), sensor in base; or (n, 4) its quaternions x, y, z, w.
        gravity: (3,) its direction in the base, of any length; None: identified.
        magnitude: |g| [m/s^2], by which the weight is divided into a mass.
        noise: of a reading: standard deviations of force and torque, or six, or a (6, 6) covariance; None: not known.
        robust: set samples aside that lie 5 robust standard deviations from the fit, and list them in the notes.
        hypothesis: mistake in the log, as an error names it, for which the log is corrected before the fit. Later
            wrenches must be corrected in the same way before `Payload.compensate`.
        unchecked: return the payload also of a log that a known mistake explains far better, or that leaves more than
            20 % of the weight; notes say so.
        of: name of a row in messages: "samples", or "poses" where each is a mean.
        provenance: kept in the payload, in addition to the options used here.

    Returns:
        The payload as a `Payload`, with notes.

    Raises:
        NotIdentifiable: the poses cannot separate the parameters; names which, and the pose to add.
        InputError: a shape is wrong, a row is not a rotation, no row is complete, or an option is invalid; unless
            `unchecked`, a known mistake explains the log far better, or the residual is more than 20 % of the weight.
    """
    settings = PayloadSettings(
        None if gravity is None else _direction(gravity),
        float(magnitude),
        None if noise is None else noise_covariance(noise),
        robust,
        of,
    )
    wrenches, rotations, finite = _usable(wrenches, rotations)
    undone = corrected(wrenches, rotations, hypothesis)
    try:
        solution = solve(*undone, settings)
        doubtful = doubts(solution, hypothesis, wrenches, rotations, settings)
    except NotIdentifiable:
        if (mistake := mistaken(wrenches, rotations, hypothesis, settings)) is not None:
            raise mistake from None
        raise
    wrong = mistaken(wrenches, rotations, hypothesis, settings) if is_bad(solution, wrenches, settings) else None
    wrong = wrong or _unexplained(solution.payload)
    if wrong is not None and not unchecked:
        raise wrong
    payload, left = judged(solution, *undone, settings)
    wrongs = () if wrong is None else (f"{str(wrong)[0].upper()}{str(wrong)[1:]}",)
    remarks = (*payload.notes, *doubtful, *wrongs, *far_centre(payload.center_of_mass))
    notes = (*unused(finite, solution.kept, of), *remarks)
    options = {
        "gravity": "free" if gravity is None else "given",
        "robust": str(robust).lower(),
        "hypothesis": hypothesis,
        "left_out": str(left),
    }
    return replace(payload, notes=notes, provenance={**options, **(provenance or {})})


def _direction(gravity: ArrayLike) -> Float[np.ndarray, "3"]:
    """Return gravity's direction with length 1; raise an InputError unless it has three numbers, not all zero."""
    direction = np.asarray(gravity, dtype=np.float64)
    largest = float(np.abs(direction).max(initial=0.0))
    if direction.shape != (3,) or not np.isfinite(largest) or largest == 0.0:
        raise InputError(
            f"gravity must be three numbers that are not all zero, not {gravity}.", hint="Leave it out if unknown."
        )
    direction = direction / largest  # first: the square of 1e200 is no number
    return direction / np.linalg.norm(direction)


def _usable(wrenches: Wrench | ArrayLike, rotations: ArrayLike) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return wrenches (m, 6) and rotation matrices (m, 3, 3) of the complete rows, and a mask (n,) of these."""
    wrenches = shaped(wrenches.vector() if isinstance(wrenches, Wrench) else wrenches, (None, 6), "wrenches")
    if np.shape(rotations) == (len(wrenches), 4):
        with np.errstate(invalid="ignore"):  # a quaternion of zeros is NaN, which is ignored
            rotations = rotation_from_quaternion(np.asarray(rotations, dtype=np.float64))
    rotations = shaped(rotations, (len(wrenches), 3, 3), "rotations")
    rows = np.column_stack([wrenches, rotations.reshape(-1, 9)])
    finite = np.asarray((np.abs(rows) <= LARGEST).all(axis=1), dtype=bool)
    _check_rotations(rotations, finite)
    require_complete(finite)
    return wrenches[finite], rotations[finite], finite


def _unexplained(payload: Payload) -> InputError | None:
    """Return the error that says that the log is no payload's; None where it leaves little."""
    share = payload.residual[0] / float(np.linalg.norm(payload.weight))
    if share <= WORST_SHARE:
        return None
    return InputError(
        f"the fit leaves {payload.residual[0]:.2g} N, {share:.0%} of the weight, and no known mistake explains it.",
        hint="Check for touches, fast motion, and wrong units or times; or pass unchecked=True (--force).",
    )


def _check_rotations(rotations: np.ndarray, finite: Bool[np.ndarray, " n"]) -> None:
    proper = np.where(finite[:, None, None], rotations, np.eye(3))
    skewed = np.abs(proper @ proper.swapaxes(1, 2) - np.eye(3)).max(axis=(1, 2)) > 1e-3
    mirrored = np.linalg.det(proper) < 0
    if (skewed | mirrored).any():
        row = int(np.argmax(skewed | mirrored))
        fault = "is not orthonormal" if skewed[row] else "is a reflection (determinant -1)"
        hint = "Check that quaternions are in the order x, y, z, w, and that the axes are right-handed."
        raise InputError(f"the rotation {fault}", where=f"row {row}", hint=hint)
