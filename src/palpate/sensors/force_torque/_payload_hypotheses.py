"""Named mistakes in how a log's wrenches and rotations were recorded, and the correction of each.

The residual distinguishes the frame of the wrenches, the swap of y and z (a left-handed sensor) and the direction of
the rotations. A reversed sign shows only as a weight that points up: against the given gravity, or else in a base whose
z points up. No poses show a reversed torque, which mirrors the centre, or a fixed rotation of sensor or base.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError, NotIdentifiable
from palpate.sensors.force_torque._payload_rank import check_noise
from palpate.sensors.force_torque._payload_solve import PayloadSettings, PayloadSolution, rms, solve
from palpate.signals.payload import Payload
from palpate.spatial.arguments import takes_arrays

__all__ = ["AS_IS", "Hypothesis", "corrected", "diagnose", "doubts"]

AS_IS = "as is"
BASE = "base frame"
SWAPPED = "y and z swapped"
REVERSED = "sign reversed"
INVERSE = "inverse rotations"
MEANINGS = {
    BASE: "the wrenches are written in the base frame",
    SWAPPED: "y and z of force and torque are swapped",
    REVERSED: "the sensor reports the reaction",
    INVERSE: "the rotations are base in sensor",
}
SWAP = [0, 2, 1, 3, 5, 4]
BAD_NOISE = 5.0  # residuals above so many times the stated noise,
BAD_SHARE = 0.05  # and above this share of the weight, or of the torque's variation, are doubted: good rigs leave 1-3 %
BAD_LEFT_OUT = 0.2  # or more than this share of the samples set aside
FAR_BETTER = 3.0  # an explanation must reduce the misfit by this


@takes_arrays
@dataclass(frozen=True, eq=False)
class Hypothesis:
    """A way to read a log: "as is", or with mistakes undone.

    Attributes:
        name: name that `identify_payload(..., hypothesis=name)` takes.
        residual: (2,) rms of force [N] and torque [N m] per axis, over every sample.
        misfit: geometric mean of the force and the torque that four samples in five stay within.
    """

    name: str
    residual: Float[np.ndarray, "2"]
    misfit: float


def compose(*hypotheses: str) -> str:
    """Return several names joined into one, in the order of `MEANINGS`.

    Raises:
        InputError: a name is not known.
    """
    given = {part for name in hypotheses for part in parts(name)}
    return " + ".join(part for part in MEANINGS if part in given) or AS_IS


def parts(hypothesis: str) -> tuple[str, ...]:
    """Return the simple names in a name such as "base frame + sign reversed".

    Raises:
        InputError: a simple name is not known.
    """
    found = tuple(part.strip() for part in hypothesis.split("+") if part.strip() not in ("", AS_IS))
    if unknown := [part for part in found if part not in MEANINGS]:
        known = ", ".join(repr(name) for name in (AS_IS, *MEANINGS))
        raise InputError(
            f"hypothesis {unknown[0]!r} is not known.", hint=f"Use one of these, or several joined by ' + ': {known}."
        )
    return found


def corrected(
    wrenches: Float[np.ndarray, "n 6"], rotations: Float[np.ndarray, "n 3 3"], hypothesis: str
) -> tuple[Float[np.ndarray, "n 6"], Float[np.ndarray, "n 3 3"]]:
    """Return wrenches (n, 6) in the sensor frame and rotations (n, 3, 3), sensor in base, if the hypothesis is true.

    Raises:
        InputError: the hypothesis is not known.
    """
    told = parts(hypothesis)
    if INVERSE in told:
        rotations = rotations.swapaxes(-1, -2)
    if BASE in told:  # first: a driver swaps in the sensor frame
        wrenches = np.einsum("nji,nkj->nki", rotations, wrenches.reshape(-1, 2, 3)).reshape(-1, 6)
    if SWAPPED in told:
        wrenches = wrenches[:, SWAP]
    return (-wrenches if REVERSED in told else wrenches), rotations


def diagnose(
    wrenches: Float[np.ndarray, "n 6"], rotations: Float[np.ndarray, "n 3 3"], settings: PayloadSettings
) -> list[Hypothesis]:
    """Return the hypotheses under which the log determines a payload, best fit first.

    Each has the sign with which the weight points down.
    """
    found: list[Hypothesis] = []
    choices = product(("", BASE), ("", SWAPPED), ("", INVERSE))  # simplest first below, without the sign
    for name in sorted((compose(*choice) for choice in choices), key=lambda name: len(parts(name))):
        try:
            solution = solve(*corrected(wrenches, rotations, name), settings)
            if points_up(solution.payload, settings):
                name = compose(name, REVERSED)
                solution = solve(*corrected(wrenches, rotations, name), settings)
        except NotIdentifiable:
            continue
        found.append(Hypothesis(name, rms(solution.residuals), misfit(solution)))
    return sorted(found, key=lambda hypothesis: hypothesis.misfit)


def misfit(solution: PayloadSolution) -> float:
    """Return the misfit of `Hypothesis`."""
    lengths = np.linalg.norm(solution.residuals.reshape(-1, 2, 3), axis=2)
    return float(np.sqrt(np.prod(np.quantile(lengths, 0.8, axis=0))))


def points_up(payload: Payload, settings: PayloadSettings) -> bool:
    """Return whether the weight points against gravity: as given, or else within 60 degrees of the base's +z."""
    if settings.direction is not None:
        return float(payload.weight @ settings.direction) < 0
    return float(payload.weight[2]) > 0.5 * float(np.linalg.norm(payload.weight))


def is_bad(solution: PayloadSolution, wrenches: Float[np.ndarray, "n 6"], settings: PayloadSettings) -> bool:
    """Return whether residuals are larger than those of a sound log, or too many samples are set aside."""
    stated = np.zeros(2) if settings.noise is None else np.sqrt(np.diag(settings.noise).reshape(2, 3).mean(axis=1))
    variation = float(np.std(wrenches[:, 3:], axis=0).max())
    share = BAD_SHARE * np.array([np.linalg.norm(solution.payload.weight), variation])
    left = solution.payload.residual > np.maximum(BAD_NOISE * stated, share)
    return bool(left.any() or solution.kept.mean() < 1.0 - BAD_LEFT_OUT)


def doubts(
    solution: PayloadSolution, hypothesis: str, wrenches: np.ndarray, rotations: np.ndarray, settings: PayloadSettings
) -> tuple[str, ...]:
    """Return warnings about a fit under `hypothesis`; wrenches and rotations are those of the log, not corrected.

    Raises:
        InputError: the hypothesis is not known.
        NotIdentifiable: the residual hides the weight, and no hypothesis explains that.
    """
    payload, bad = solution.payload, is_bad(solution, wrenches, settings)
    if bad and (mistake := _explanation(diagnose(wrenches, rotations, settings), misfit(solution))):
        return (mistake,)
    used = corrected(wrenches, rotations, hypothesis)[1][solution.kept]
    check_noise(used, settings.direction, payload.weight, solution.noise)
    said: list[str] = []
    share = payload.residual[0] / float(np.linalg.norm(payload.weight))
    if bad and share > BAD_SHARE:
        said.append(
            f"The fit has residuals of {payload.residual[0]:.2g} N and {payload.residual[1]:.2g} N m, {share:.0%} of "
            "the weight, and no known mistake explains them: check for touches, fast motion, and wrong units or times."
        )
    if points_up(payload, settings):
        against = "up in the base (z)" if settings.direction is None else "against the given gravity"
        cause = "the base's z points down" if settings.direction is None else "that direction is wrong"
        said.append(
            f"The weight points {against}: either {cause}, or {MEANINGS[REVERSED]} "
            f"(hypothesis={compose(hypothesis, REVERSED)!r}). The poses alone cannot tell which."
        )
    return tuple(said)


def _explanation(found: list[Hypothesis], misfit_now: float) -> str:
    """Return a sentence that names the hypothesis that fits far better than the present one, or ""."""
    if not found or found[0].misfit * FAR_BETTER > misfit_now:
        return ""
    best = found[0]
    meaning = " and ".join(MEANINGS[part] for part in parts(best.name)) or "it is taken as it is"
    return (
        f"The log fits {misfit_now / max(best.misfit, 1e-300):.0f} times better if {meaning}: the residuals "
        f"are then {best.residual[0]:.2g} N and {best.residual[1]:.2g} N m. Correct how the log is read, or pass "
        f"hypothesis={best.name!r}."
    )
