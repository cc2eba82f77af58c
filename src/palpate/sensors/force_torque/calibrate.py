"""Identify the payload and the sensor's bias from free motion: nothing touches the sensor, its orientation is known."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from jaxtyping import Bool
from numpy.typing import ArrayLike

from palpate.calls import called_as
from palpate.errors import InputError, NotIdentifiable
from palpate.sensors.force_torque._payload_hypotheses import WORST_SHARE, Hypothesis, diagnose, doubts, is_bad, mistaken
from palpate.sensors.force_torque._payload_mistakes import AS_IS, corrected
from palpate.sensors.force_torque._payload_search import FAR
from palpate.sensors.force_torque._payload_solve import PayloadSettings, judged, solve
from palpate.signals.payload import STANDARD_GRAVITY, Payload
from palpate.signals.recording import LARGEST
from palpate.spatial._arrays import shaped
from palpate.spatial.arguments import takes_arrays
from palpate.spatial.pose import rotation_from_quaternion
from palpate.spatial.uncertain import noise_covariance
from palpate.spatial.wrench import Wrench

__all__ = ["Hypothesis", "diagnose_payload", "identify_payload"]


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

    Two linear least squares: force on (weight, bias), then torque on (centre, bias) with the modelled weight. If
    `noise` is given and explains the residuals, all are then fitted jointly, whitened: the torque sharpens the
    weight's direction. Otherwise they are not: the residuals of real rigs are errors of the model (gains, cross-talk,
    flexing). The covariance covers all twelve parameters, the centre carrying the weight's error. It is computed from
    the residuals' covariance (or from the stated noise, if that explains them), with the drift of the bias where the
    residuals show one. Parts of the log are omitted in turn, and the covariance is widened where they lie further
    from the prediction of the other parts than it allows. Rows must be in the order of time. If a log has many samples
    per pose, average each pose first: they share one error. With few poses state the noise: from residuals alone it is
    too small, by 1.1 at 40 poses, by 2 at 12.

    Args:
        wrenches: (n, 6) [N, N m], or a `Wrench` of n, in the sensor frame. Rows with NaN or infinity (above 1e9) are
            ignored and listed in the notes.
        rotations: (n, 3, 3), sensor in base; or (n, 4) its quaternions x, y, z, w.
        gravity: (3,) its direction in the base, of any length; None when unknown: it is then identified.
        magnitude: |g| [m/s^2], used only to divide the weight into a mass.
        noise: noise of one reading, if known: standard deviations of force and torque, or six, or a (6, 6) covariance.
        robust: set samples aside that lie 5 robust standard deviations from the fit, and list them in the notes.
        hypothesis: a name that `diagnose_payload` gave; the log is corrected for it before the fit. Later wrenches must
            be corrected in the same way before `Payload.compensate`.
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
    settings = replace(settings_of(gravity, magnitude, noise, robust=robust), of=of)
    wrenches, rotations, finite = usable(wrenches, rotations)
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
    notes = (*validated(finite, solution.kept, of), *payload.notes, *doubtful, *wrongs, *_far_centre(payload))
    options = {
        "gravity": "free" if gravity is None else "given",
        "robust": str(robust).lower(),
        "hypothesis": hypothesis,
    }
    options["left_out"] = str(left)
    return replace(payload, notes=notes, provenance={**options, **(provenance or {})})


@takes_arrays
def diagnose_payload(
    wrenches: Wrench | ArrayLike,
    rotations: ArrayLike,
    *,
    gravity: ArrayLike | None = None,
    magnitude: float = STANDARD_GRAVITY,
    noise: ArrayLike | None = None,
    robust: bool = True,
) -> list[Hypothesis]:
    """Return a list of each `Hypothesis` that explains the log as well as the best, the simplest first; [] if none.

    Arguments are those of `identify_payload`. The sign of each hypothesis is the one under which the weight points down
    (see `palpate.sensors.force_torque._payload_mistakes` for the mistakes).

    Raises:
        InputError: no row is complete, a row is not a rotation, or an option is invalid.
    """
    settings = settings_of(gravity, magnitude, noise, robust=robust)
    wrenches, rotations, _ = usable(wrenches, rotations)
    return diagnose(wrenches, rotations, settings)


def settings_of(
    gravity: ArrayLike | None, magnitude: float, noise: ArrayLike | None, *, robust: bool
) -> PayloadSettings:
    """Return the checked settings as `PayloadSettings`, with gravity's direction of length 1.

    Raises:
        InputError: `magnitude` is not positive, gravity is not three finite numbers, not all zero, or `noise` is no
            standard deviations or covariance.
    """
    if not (np.isfinite(magnitude) and magnitude > 0):
        raise InputError(f"magnitude of gravity must be positive, not {magnitude}.")
    direction = None if gravity is None else np.asarray(gravity, dtype=np.float64)
    if direction is not None:
        largest = float(np.abs(direction).max(initial=0.0))
        if direction.shape != (3,) or not np.isfinite(largest) or largest == 0.0:
            raise InputError(
                f"gravity must be three numbers that are not all zero, not {gravity}.", hint="Leave it out if unknown."
            )
        direction = direction / largest  # first: the square of 1e200 is no number
        direction = direction / np.linalg.norm(direction)
    return PayloadSettings(direction, float(magnitude), None if noise is None else noise_covariance(noise), robust)


def usable(wrenches: Wrench | ArrayLike, rotations: ArrayLike) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the complete rows' wrenches (m, 6), their rotation matrices (m, 3, 3), and a mask (n,) of these rows.

    Args:
        wrenches: (n, 6), force first.
        rotations: (n, 3, 3), or (n, 4) quaternions x, y, z, w.

    Raises:
        InputError: no row is complete, or the rotation of a complete row is not orthonormal or is a reflection.
    """
    wrenches = shaped(wrenches.vector() if isinstance(wrenches, Wrench) else wrenches, (None, 6), "wrenches")
    if np.shape(rotations) == (len(wrenches), 4):
        with np.errstate(invalid="ignore"):  # a quaternion of zeros is NaN, which is ignored
            rotations = rotation_from_quaternion(np.asarray(rotations, dtype=np.float64))
    rotations = shaped(rotations, (len(wrenches), 3, 3), "rotations")
    rows = np.column_stack([wrenches, rotations.reshape(-1, 9)])
    finite = np.asarray((np.abs(rows) <= LARGEST).all(axis=1), dtype=bool)
    _check_rotations(rotations, finite)
    if not finite.any():
        raise InputError(
            f"each of the {len(wrenches)} rows lacks a number.", hint="Check the columns and the log's length."
        )
    return wrenches[finite], rotations[finite], finite


def validated(finite: Bool[np.ndarray, " n"], kept: Bool[np.ndarray, " m"], of: str) -> tuple[str, ...]:
    """Return sentences about the rows that were not used, an empty tuple if all were.

    Args:
        finite: (n,) the complete rows.
        kept: (m,) of these, the rows that are no outliers.
        of: name of a row: "samples" or "poses".
    """
    name = "rows" if of == "samples" else of
    lost, away = np.flatnonzero(~finite), np.flatnonzero(finite)[~kept]
    said: tuple[str, ...] = ()
    if len(lost):
        said += (
            f"{len(lost)} of {len(finite)} {name} hold NaN or infinity and were ignored ({name} {_listed(lost)}).",
        )
    if len(away):
        said += (f"{len(away)} of {len(kept)} {of} are far from the fit and were set aside ({name} {_listed(away)}).",)
    return said


def _unexplained(payload: Payload) -> InputError | None:
    """Return the error that says that the log is no payload's; None where it leaves little."""
    share = payload.residual[0] / float(np.linalg.norm(payload.weight))
    if share <= WORST_SHARE:
        return None
    return InputError(
        f"the fit leaves {payload.residual[0]:.2g} N, {share:.0%} of the weight, and no known mistake explains it.",
        hint="Check for touches, fast motion, and wrong units or times; or pass unchecked=True (--force).",
    )


def _far_centre(payload: Payload) -> tuple[str, ...]:
    far = float(np.linalg.norm(payload.center_of_mass))
    if far <= FAR:
        return ()
    return (f"The centre of mass is {far:.3g} m from the sensor: check the unit of the torque.",)


def _listed(rows: np.ndarray) -> str:
    return ", ".join(str(row) for row in rows[:5]) + (", ..." if len(rows) > 5 else "")


def _check_rotations(rotations: np.ndarray, finite: Bool[np.ndarray, " n"]) -> None:
    proper = np.where(finite[:, None, None], rotations, np.eye(3))
    skewed = np.abs(proper @ proper.swapaxes(1, 2) - np.eye(3)).max(axis=(1, 2)) > 1e-3
    mirrored = np.linalg.det(proper) < 0
    if (skewed | mirrored).any():
        row = int(np.argmax(skewed | mirrored))
        fault = "is not orthonormal" if skewed[row] else "is a reflection (determinant -1)"
        hint = "Check that quaternions are in the order x, y, z, w, and that the axes are right-handed."
        raise InputError(f"the rotation {fault}", where=f"row {row}", hint=hint)
