"""Name another unit, lag or order of a truth that fits contacts far better than the truth as stated."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from palpate.contact.contacts import Contacts
from palpate.contact.ground_truth import TrueSamples, TrueTouches
from palpate.evaluation.evaluate import EvaluationReport, evaluate

HELD = 0.7  # share of the ellipses that hold the truth, above which it is taken as right
FAR_BETTER = 5.0  # times smaller a median error of another truth
BETTER = 1.1  # times smaller, to replace a simpler explanation
LEAST = 4  # compared contacts or touches whose median error is used
MATCHED = 0.7  # share of the contacts compared with the stated truth that another truth must match as well
MANY = 4_000  # contacts and instants that are looked at
UNITS = {"mm": 1e-3, "cm": 1e-2, "in": 0.0254, "um": 1e-6}
LAGS = np.concatenate([np.arange(0.05, 0.5, 0.05), np.arange(0.5, 5.0, 0.1)])  # s
_Truth = TrueSamples | TrueTouches


def other_truth(contacts: Contacts, truth: _Truth, found: EvaluationReport, *, tolerance: float = 0.02) -> str:
    """Return a sentence on what explains a truth that the contacts contradict; "" without one.

    Args:
        contacts: as compared.
        truth: as stated.
        found: the comparison.
        tolerance: [s] as for `evaluate`.

    Raises:
        InputError: the tolerance is negative.
    """
    stated = found.location
    right = found.coverage.count and found.coverage.inside > HELD
    if stated is None or stated.count < LEAST or right or not np.isfinite(stated.median):
        return ""
    contacts = contacts[:: max(1, len(contacts) // MANY)]
    if isinstance(truth, TrueSamples):
        truth = truth[np.arange(0, len(truth.time), max(1, len(truth.time) // MANY))]
    as_stated = evaluate(contacts, truth, tolerance=tolerance).answered
    smallest, explanation = stated.median / FAR_BETTER, ""
    for what, other in _others(truth):
        report = evaluate(contacts, other, tolerance=tolerance)
        errors, spread = report.location, np.linalg.norm(other.point - np.median(other.point, axis=0), axis=1)
        if errors is None or errors.count < LEAST or report.answered < MATCHED * as_stated:
            continue
        if errors.median > np.median(spread) / 2:
            continue  # points that a unit shrinks to one fit all that is near it
        if errors.median < smallest:
            smallest, explanation = errors.median / BETTER, what
    if not explanation:
        return ""
    errors = f"{1e3 * BETTER * smallest:.3g} mm in the median then, {1e3 * stated.median:.3g} mm as stated"
    return f"the truth fits far better {explanation} ({errors})"


def _others(truth: _Truth) -> Iterator[tuple[str, _Truth]]:
    """Yield what might be wrong, for the sentence, and the truth without it; the simplest first."""
    for unit, metres in UNITS.items():
        yield f"if its points are in {unit}: write them in m", replace(truth, point=metres * truth.point)
    for by in (-1, 1) if isinstance(truth, TrueTouches) else ():
        moved = replace(truth, point=np.roll(truth.point, by, axis=0))
        yield f"with each point moved {'up' if by < 0 else 'down'} by a row: pair them anew", moved
    for lag in np.concatenate([-LAGS, LAGS]).tolist():
        times = {name: getattr(truth, name) + lag for name in ("start", "end", "time") if hasattr(truth, name)}
        yield f"about {abs(lag):.2g} s {'later' if lag > 0 else 'earlier'}: correct its clock", replace(truth, **times)
