"""Doubts about an identified payload: known mistakes in the log that explain its residuals, or residuals of no reason.

The residual distinguishes mistakes of orientation, frame and axes. It does not distinguish the sign. Reversing force
and torque reverses the weight and keeps the centre, so it shows only as a weight that points up: against the given
gravity, or else against a base whose z points up. Reversing the torque alone mirrors the centre: no set of poses can
show it. Mistakes that explain a log equally well are named together, the simplest first.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from jaxtyping import Bool, Float

from palpate.errors import InputError
from palpate.sensors.force_torque._payload_mistakes import MISTAKES, REVERSED, compose, corrected, mistake_of, parts
from palpate.sensors.force_torque._payload_rank import check_noise
from palpate.sensors.force_torque._payload_search import FAR, fitted, likely, search, upward
from palpate.sensors.force_torque._payload_solve import PayloadSettings, PayloadSolution

BAD_NOISE = 5.0  # residuals above so many times the stated noise,
BAD_SHARE = 0.05  # and above this share of the weight, or of the torque's variation, are doubted: good rigs leave 1-3 %
WORST_SHARE = 0.2  # of the weight: residuals above it are those of no payload
BAD_LEFT_OUT = 0.2  # or more than this share of the samples set aside
ALIKE, ALIKE_COST = 1.2, 0.3  # misfits within this factor, and costs, name a mistake as well
FAR_BETTER = 3.0  # an explanation must reduce the misfit by this


def mistaken(
    wrenches: Float[np.ndarray, "n 6"],
    rotations: Float[np.ndarray, "n 3 3"],
    hypothesis: str,
    settings: PayloadSettings,
) -> InputError | None:
    """Return the error that names the mistake by which a log fits far better than under `hypothesis`; None if none."""
    now = fitted(*corrected(wrenches, rotations, hypothesis), settings.direction)
    found = likely(search(wrenches, rotations, settings.direction))
    if now is None or not found or found[0].name == hypothesis:
        return None
    best, better = found[0], now.misfit / found[0].misfit
    alike = [each for each in found if each.cost <= best.cost + ALIKE_COST and each.misfit <= ALIKE * best.misfit][:3]
    what = "; or, as well, if ".join(_meaning(each.name) for each in alike)
    if better >= FAR_BETTER:
        return InputError(f"the log fits {better:.0f} times better if {what}.", hint=_mend(best.name))
    if now.lever > FAR and best.lever <= FAR:
        return InputError(
            f"a centre of mass {now.lever:.3g} m from the sensor is implausible; it is nearer if {what}.",
            hint=_mend(best.name),
        )
    return None


def _meaning(name: str) -> str:
    return " and ".join(mistake_of(part).meaning for part in parts(name)) or "it is taken as it is"


def _mend(name: str) -> str:
    """Return the settings that correct how the log is read."""
    settings: dict[str, list[str]] = {}
    for found in map(mistake_of, parts(name)):
        settings.setdefault(found.table, []).append(found.rig)
    lines = " and ".join(f"{', '.join(lines)} in [{table}]" for table, lines in settings.items())
    return f"Write {lines} of the rig, or pass hypothesis={name!r}."


def doubts(
    solution: PayloadSolution, hypothesis: str, wrenches: np.ndarray, rotations: np.ndarray, settings: PayloadSettings
) -> tuple[str, ...]:
    """Return warnings about a fit under `hypothesis`; wrenches and rotations are those of the log, not corrected.

    Raises:
        NotIdentifiable: the residual hides the weight.
    """
    payload = solution.payload
    used = corrected(wrenches, rotations, hypothesis)[1][solution.kept]
    check_noise(used, settings.direction, payload.weight, solution.noise)
    said: tuple[str, ...] = ()
    share = payload.residual[0] / float(np.linalg.norm(payload.weight))
    if is_bad(solution, wrenches, settings) and share > BAD_SHARE:
        said += (
            f"The fit has residuals of {payload.residual[0]:.2g} N and {payload.residual[1]:.2g} N m, {share:.0%} of "
            "the weight, and no known mistake explains them: check for touches, fast motion, and wrong units or times.",
        )
    if upward(payload.weight, settings.direction):
        said += (_upward(settings, hypothesis),)
    return said


def is_bad(solution: PayloadSolution, wrenches: Float[np.ndarray, "n 6"], settings: PayloadSettings) -> bool:
    """Return whether the residual is larger than that of a sound log, or too many samples were set aside.

    `wrenches` are those of the log, from which the torque's variation is computed.
    """
    stated = np.zeros(2) if settings.noise is None else np.sqrt(np.diag(settings.noise).reshape(2, 3).mean(axis=1))
    variation = float(np.std(wrenches[:, 3:], axis=0).max())
    share = BAD_SHARE * np.array([np.linalg.norm(solution.payload.weight), variation])
    left = solution.payload.residual > np.maximum(BAD_NOISE * stated, share)
    far = float(np.linalg.norm(solution.payload.center_of_mass)) > FAR
    return bool(left.any() or far or solution.kept.mean() < 1.0 - BAD_LEFT_OUT)


def _upward(settings: PayloadSettings, hypothesis: str) -> str:
    against = "up in the base (z)" if settings.direction is None else "against the given gravity"
    cause = "the base's z points down" if settings.direction is None else "that direction is wrong"
    name = compose(hypothesis, REVERSED)
    reversed_sign = f"{MISTAKES[REVERSED].meaning} (hypothesis={name!r})"
    return f"The weight points {against}: either {cause}, or {reversed_sign}. The poses alone cannot tell which."


def unused(finite: Bool[np.ndarray, " n"], kept: Bool[np.ndarray, " m"], of: str) -> Iterator[str]:
    """Yield sentences about the rows that were not used: incomplete ones, and those of the others not kept."""
    name = "rows" if of == "samples" else of
    lost, away = np.flatnonzero(~finite), np.flatnonzero(finite)[~kept]
    if len(lost):
        yield f"{len(lost)} of {len(finite)} {name} hold NaN or infinity and were ignored ({name} {_listed(lost)})."
    if len(away):
        yield f"{len(away)} of {len(kept)} {of} are far from the fit and were set aside ({name} {_listed(away)})."


def far_centre(centre: Float[np.ndarray, "3"]) -> Iterator[str]:
    """Yield a sentence where a centre of mass [m] is too far from the sensor."""
    far = float(np.linalg.norm(centre))
    if far > FAR:
        yield f"The centre of mass is {far:.3g} m from the sensor: check the unit of the torque."


def _listed(rows: np.ndarray) -> str:
    return ", ".join(str(row) for row in rows[:5]) + (", ..." if len(rows) > 5 else "")
