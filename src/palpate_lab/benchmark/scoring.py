"""Score the answers of any estimator against the true contacts, misses included."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from palpate.contact.contacts import Contacts
from palpate.contact.ground_truth import TrueSamples
from palpate.evaluation.errors import EllipseCoverage, coverage, distances
from palpate.evaluation.matching import match_instants
from palpate.spatial.arguments import takes_arrays

NEAR = 0.002  # m: a place that is found


@dataclass(frozen=True)
class Score:
    """The score of one estimator at one task; a contact without an answer is a miss, infinitely far off.

    Attributes:
        contacts: number of true contacts.
        answered: share of them that have an answer.
        median, p95: [m] the least distance within which half, and 95 %, of all contacts were found; inf where too many
            have no answer.
        near: share of all contacts that were found within 2 mm.
        force: [N] median length of the force's error, over answers that state a force; NaN where none does.
        coverage: coverage of the ellipses of answers that state a covariance.
        false: number of answers at judged samples that match no contact.
    """

    contacts: int
    answered: float
    median: float
    p95: float
    near: float
    force: float
    coverage: EllipseCoverage
    false: int


@takes_arrays
def score(answers: Contacts, truth: TrueSamples, quiet: Int[np.ndarray, " q"]) -> Score:
    """Score answers and return the `Score`; the time of answers and truth is the number of the sample.

    Within a sample answers and contacts are paired one to one, by the least sum of distances.

    Args:
        answers: contacts with a point; those at samples that are neither in the truth nor in `quiet` do not count.
        truth: true contacts, at least one.
        quiet: (q,) samples in which nothing touches.

    Raises:
        InputError: quiet has another shape.
    """
    match, due, _ = match_instants(answers, truth, 0.25)
    found = match >= 0
    apart: Float[np.ndarray, " n"] = np.where(found, distances(answers.point, truth.point[match]), np.inf)
    errors: Float[np.ndarray, " k"] = np.full(len(truth.time), np.inf)
    np.minimum.at(errors, match[found], apart[found])
    wrong: Float[np.ndarray, " n"] = np.full(len(match), np.nan)
    if truth.force is not None:
        wrong = np.where(found, distances(answers.force, truth.force[match]), np.nan)
    stated = wrong[np.isfinite(wrong)]
    extra = (due & ~found) | np.isin(answers.sample, quiet)
    return Score(
        contacts=len(errors),
        answered=float(np.mean(np.isfinite(errors))),
        median=float(np.quantile(errors, 0.5, method="inverted_cdf")),
        p95=float(np.quantile(errors, 0.95, method="inverted_cdf")),
        near=float(np.mean(errors <= NEAR)),
        force=float(np.median(stated)) if len(stated) else float("nan"),
        coverage=coverage(answers.estimate, truth.point[match], found),
        false=int(np.count_nonzero(extra)),
    )
