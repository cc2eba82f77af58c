"""Match estimates with the truth by time, and report."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from palpate.contact.estimate import ContactEstimate, Status
from palpate.contact.ground_truth import Samples, Touches
from palpate.evaluation.errors import Coverage, Spread, angles, coverage, distances

__all__ = ["Report", "Touch", "evaluate", "nearest_in_time", "status_shares"]


@dataclass(frozen=True)
class Touch:
    """One touch: the median of its answered samples against its known point.

    Attributes:
        label: as in the truth.
        samples: in the interval; answered: of these.
        error: [m], NaN where none was answered.
        scatter: [m], median distance of the answered samples from their median.
    """

    label: str
    samples: int
    answered: int
    error: float
    scatter: float


@dataclass(frozen=True)
class Report:
    """What `palpate evaluate` prints.

    Attributes:
        samples: in the file; matched: with a truth; answered: of those matched.
        statuses: label -> share of the matched samples.
        location: [m] of the answered samples, or of the touches where the truth is touches.
        normal: [rad] between normals, None where the truth has none; force_angle likewise.
        force: [N] length of the difference, None where the truth has none.
        coverage: of the answered samples' covariance.
        touches: one for each, where the truth is touches.
    """

    samples: int
    matched: int
    answered: int
    statuses: dict[str, float]
    location: Spread | None
    normal: Spread | None
    force: Spread | None
    force_angle: Spread | None
    coverage: Coverage
    touches: tuple[Touch, ...] = ()


def evaluate(
    time: Float[np.ndarray, " n"], estimate: ContactEstimate, truth: Samples | Touches, *, tolerance: float = 0.02
) -> Report:
    """Compare estimates with what is known.

    Args:
        time: (n,) [s] of the estimates, one contact a sample.
        estimate: batch of n, in the truth's frame.
        truth: instants (matched to the nearest within `tolerance` [s]) or touches.
        tolerance: [s].
    """
    match = _touch_of(time, truth) if isinstance(truth, Touches) else nearest_in_time(time, truth.time, tolerance)
    matched = match >= 0
    answered = matched & np.asarray(estimate.answered)
    point = _picked(truth.point, match)
    normal = None if isinstance(truth, Touches) else truth.normal
    force = None if isinstance(truth, Touches) else truth.force
    touches = _touches(time, estimate, truth) if isinstance(truth, Touches) else ()
    errors = distances(estimate.point, point)[answered]
    return Report(
        samples=len(time),
        matched=int(np.count_nonzero(matched)),
        answered=int(np.count_nonzero(answered)),
        statuses=status_shares(estimate.status[matched]),
        location=Spread.of(np.array([touch.error for touch in touches]) if touches else errors),
        normal=None if normal is None else Spread.of(angles(estimate.normal, _picked(normal, match))[answered]),
        force=None if force is None else Spread.of(distances(estimate.force, _picked(force, match))[answered]),
        force_angle=None if force is None else Spread.of(angles(estimate.force, _picked(force, match))[answered]),
        coverage=coverage(estimate, point, answered),
        touches=touches,
    )


def nearest_in_time(
    time: Float[np.ndarray, " n"], known: Float[np.ndarray, " k"], tolerance: float
) -> Int[np.ndarray, " n"]:
    """For each time the index of the nearest known one, -1 where none is within `tolerance`; neither need be sorted."""
    order = np.argsort(known)
    order = order[np.isfinite(known[order])]
    if not len(order):
        return np.full(len(time), -1)
    right = np.searchsorted(known[order], time).clip(max=len(order) - 1)
    either = np.stack([order[(right - 1).clip(min=0)], order[right]])
    apart: Float[np.ndarray, "2 n"] = np.abs(known[either] - time)
    best: Int[np.ndarray, " n"] = np.take_along_axis(either, apart.argmin(axis=0)[None], axis=0)[0]
    # times of day have a resolution of 0.2 us in float64
    return np.where(np.min(apart, axis=0) <= tolerance + 1e-6, best, -1)


def status_shares(status: Int[np.ndarray, " n"]) -> dict[str, float]:
    """Label -> share, for those that occur, in the order of the codes."""
    counts = np.bincount(np.asarray(status, dtype=np.int64), minlength=len(Status))
    return {Status(code).label: float(count / len(status)) for code, count in enumerate(counts) if count}


def _touch_of(time: Float[np.ndarray, " n"], touches: Touches) -> Int[np.ndarray, " n"]:
    """Which touch each time falls into (the first, should they overlap), -1 for none."""
    found = np.full(len(time), -1)
    for k in reversed(range(len(touches))):
        found[(time >= touches.start[k]) & (time <= touches.end[k])] = k
    return found


def _touches(time: Float[np.ndarray, " n"], estimate: ContactEstimate, truth: Touches) -> tuple[Touch, ...]:
    answered = np.asarray(estimate.answered)
    reports: list[Touch] = []
    for k, label in enumerate(truth.label):
        inside = (time >= truth.start[k]) & (time <= truth.end[k])
        points = estimate.point[inside & answered]
        error = scatter = float("nan")
        if len(points):
            middle = np.median(points, axis=0)
            error = float(np.linalg.norm(middle - truth.point[k]))
            scatter = float(np.median(np.linalg.norm(points - middle, axis=1)))
        reports.append(Touch(label, int(np.count_nonzero(inside)), len(points), error, scatter))
    return tuple(reports)


def _picked(values: Float[np.ndarray, "k 3"], match: Int[np.ndarray, " n"]) -> Float[np.ndarray, "n 3"]:
    """The matched rows, NaN where there is none."""
    if not len(values):
        return np.full((len(match), 3), np.nan)
    return np.where((match >= 0)[:, None], values[match], np.nan)
