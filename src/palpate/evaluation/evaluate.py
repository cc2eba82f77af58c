"""Compare contacts with the ground truth."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from palpate.contact.contacts import Contacts
from palpate.contact.estimate import Status
from palpate.contact.ground_truth import TrueSamples, TrueTouches
from palpate.errors import InputError
from palpate.evaluation.errors import EllipseCoverage, ErrorSummary, angles, coverage, distances
from palpate.evaluation.matching import match_instants, match_touches
from palpate.spatial.arguments import frozen_value, takes_arrays


@dataclass(frozen=True)
class JudgedTouch:
    """The median of one touch's answered samples, compared with its known point.

    Attributes:
        label: of the truth.
        samples: in the interval, without those of other contacts alone; answered: of these.
        error: [m]; NaN where none was answered.
        scatter: [m] median distance of the answered samples from their median.
    """

    label: str
    samples: int
    answered: int
    error: float
    scatter: float


@frozen_value
class EvaluationReport:
    """Comparison of contacts with the truth.

    Attributes:
        samples: rows of contacts; matched: with a truth; answered: of those matched.
        statuses: (len(Status),) number of matched rows with each status.
        location: [m] of the answered rows, or of the touches if the truth is touches.
        normal: [rad] between normals; None without any. force_angle: likewise between forces.
        force: [N] length of the difference; None without any.
        coverage: of the answered rows' covariance.
        errors: (n,) [m] of each answered row, turned: (n,) [rad] of its normal; NaN without truth.
        touches: if the truth is touches.
        unmatched: answered contacts at an instant whose truths all belong to others.
        missed: truths without a contact at an instant at which another has one.
        outside: rows compared with nothing, because they are near a truth, but before or after all that are known.
    """

    samples: int
    matched: int
    answered: int
    statuses: Int[np.ndarray, " s"]
    location: ErrorSummary | None
    normal: ErrorSummary | None
    force: ErrorSummary | None
    force_angle: ErrorSummary | None
    coverage: EllipseCoverage
    errors: Float[np.ndarray, " n"]
    turned: Float[np.ndarray, " n"]
    touches: tuple[JudgedTouch, ...] = ()
    unmatched: int = 0
    missed: int = 0
    outside: int = 0


def evaluate(contacts: Contacts, truth: TrueSamples | TrueTouches, *, tolerance: float = 0.02) -> EvaluationReport:
    """Compare contacts with the truth in an `EvaluationReport`; at every instant, a truth has at most one contact.

    Args:
        contacts: of any sensor, in the truth's frame.
        truth: instants, several of which may have one time, or touches.
        tolerance: [s] largest difference of times at an instant. Where instants are at most twice that apart, truths
            end half their usual distance after the last of them: later samples have none.

    Raises:
        InputError: the tolerance is negative.
    """
    if not tolerance >= 0:
        raise InputError(f"the tolerance must not be negative: {tolerance:g} s.")
    if isinstance(truth, TrueTouches):
        match, due, own = match_touches(contacts, truth)
        touches = tuple(_touch(contacts, truth, k, rows) for k, rows in enumerate(own))
        return report(contacts, truth.instants(), match, due, touches)
    match, due, near = match_instants(contacts, truth, tolerance)
    return replace(report(contacts, truth, match, due), outside=int(np.count_nonzero(near)))


def evaluate_robot(
    contacts: Contacts, truth: TrueSamples | TrueTouches, *, tolerance: float = 0.02
) -> tuple[EvaluationReport, dict[str, EvaluationReport]]:
    """Compare the contacts of a robot's sensors with the truth, each sensor with its own; return all, and each by name.

    Args:
        contacts: of a robot, in the truth's frame.
        truth: instants or touches that name their sensor.
        tolerance: [s] as for `evaluate`.

    Raises:
        InputError: the contacts have no origins, or the truth names no sensors; or the tolerance is negative.
    """
    if contacts.origins is None or not truth.sensor:
        raise InputError("the contacts and the truth must both name the sensor of each row.")
    match, due = np.full(len(contacts), -1), np.zeros(len(contacts), dtype=bool)
    named, each = np.array(truth.sensor), dict[str, EvaluationReport]()
    for name in dict.fromkeys(truth.sensor):
        rows, known = np.flatnonzero(contacts.sensor == name), np.flatnonzero(named == name)
        own, its = contacts[rows], truth[known]
        each[name] = evaluate(own, its, tolerance=tolerance)
        if isinstance(its, TrueTouches):
            found, due[rows], _ = match_touches(own, its)
        else:
            found, due[rows], _ = match_instants(own, its, tolerance)
        match[rows] = np.where(found >= 0, known[found], -1)
    touches = tuple(touch for one in each.values() for touch in one.touches)
    instants = truth.instants() if isinstance(truth, TrueTouches) else truth
    counts = {name: sum(getattr(one, name) for one in each.values()) for name in ("missed", "outside")}
    return replace(report(contacts, instants, match, due, touches), **counts), each


@takes_arrays
def report(
    contacts: Contacts,
    truth: TrueSamples,
    match: Int[np.ndarray, " n"],
    due: Bool[np.ndarray, " n"] | None = None,
    touches: tuple[JudgedTouch, ...] = (),
) -> EvaluationReport:
    """Return the comparison of n contacts with k truths to which they are matched.

    Args:
        contacts: of any sensor.
        truth: the instants.
        match: (n,) number of each contact's truth, -1 for none.
        due: (n,) there was a truth at its time; None: unmatched contacts are not counted.
        touches: of which `location` is the summary, if any.

    Raises:
        InputError: arrays of other shapes.
    """
    answered = (match >= 0) & contacts.answered
    row = np.where(answered, match, -1)
    point, nothing = _picked(truth.point, row), np.full((len(truth.time), 3), np.nan)
    normal = _picked(nothing if truth.normal is None else truth.normal, row)
    force = _picked(nothing if truth.force is None else truth.force, row)
    errors, turned = distances(contacts.point, point), angles(contacts.normal, normal)
    return EvaluationReport(
        samples=len(contacts),
        matched=int(np.count_nonzero(match >= 0)),
        answered=int(np.count_nonzero(answered)),
        statuses=np.bincount(contacts.status[match >= 0], minlength=len(Status)),
        location=ErrorSummary.of(np.array([touch.error for touch in touches]) if touches else errors),
        normal=ErrorSummary.of(turned),
        force=ErrorSummary.of(distances(contacts.force, force)),
        force_angle=ErrorSummary.of(angles(contacts.force, force)),
        coverage=coverage(contacts.estimate, point, answered),
        errors=errors,
        turned=turned,
        touches=touches,
        unmatched=int(0 if due is None else np.count_nonzero(due & (match < 0) & contacts.answered)),
        missed=0 if touches else _missed(truth.time, match),
    )


def _touch(contacts: Contacts, truth: TrueTouches, which: int, rows: Int[np.ndarray, " m"]) -> JudgedTouch:
    points = contacts.point[rows[contacts.answered[rows]]]
    error = scatter = float("nan")
    if len(points):
        middle = np.median(points, axis=0)
        error = float(np.linalg.norm(middle - truth.point[which]))
        scatter = float(np.median(np.linalg.norm(points - middle, axis=1)))
    return JudgedTouch(truth.label[which], len(rows), len(points), error, scatter)


def _missed(time: Float[np.ndarray, " k"], match: Int[np.ndarray, " n"]) -> int:
    """Count truths without a contact at an instant at which another has one."""
    found = np.zeros(len(time), dtype=bool)
    found[match[match >= 0]] = True
    return int(np.count_nonzero(~found & np.isin(time, time[found])))


def _picked(values: Float[np.ndarray, "k 3"], match: Int[np.ndarray, " n"]) -> Float[np.ndarray, "n 3"]:
    if not len(values):
        return np.full((len(match), 3), np.nan)
    return np.where((match >= 0)[:, None], values[match], np.nan)
