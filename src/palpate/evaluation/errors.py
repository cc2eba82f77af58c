"""Compute errors of estimates, and how well their covariance predicts them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from palpate.contact.estimate import CHI2_95, ContactEstimate
from palpate.spatial.arguments import frozen_value, takes_arrays

HEADER = ("mean", "median", "95 %", "worst", "count")
_FLAT = 1e-9  # of the largest variance: below it a direction has none


@frozen_value(eq=True)
class ErrorSummary:
    """Count, mean, median, 95 % percentile and largest of errors, in their unit."""

    count: int
    mean: float
    median: float
    p95: float
    worst: float

    @classmethod
    def of(cls, errors: Float[np.ndarray, " n"]) -> ErrorSummary | None:
        """Return the summary, in their unit, of the finite errors (n,); None if there are none.

        Raises:
            InputError: errors has another shape.
        """
        known = errors[np.isfinite(errors)]
        if not len(known):
            return None
        p95 = float(np.percentile(known, 95))
        return cls(len(known), float(known.mean()), float(np.median(known)), p95, float(known.max()))

    def row(self, scale: float) -> tuple[str, ...]:
        """Return mean, median, 95 % percentile, largest (times `scale`), and count, as texts under `HEADER`."""
        figures = (self.mean, self.median, self.p95, self.worst)
        return (*(f"{scale * value:.3f}" for value in figures), f"{self.count:,}")


@dataclass(frozen=True)
class EllipseCoverage:
    """Agreement between covariance and errors in the tangent plane.

    Attributes:
        count: estimates with a covariance of rank 2.
        inside: share of them whose 95 % ellipse holds the truth.
        mean_square: mean squared Mahalanobis distance; 2 if the covariance is right.
    """

    count: int
    inside: float
    mean_square: float


@takes_arrays
def distances(points: Float[np.ndarray, "n 3"], truth: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
    """Return the distances between points, (n,) [m]; NaN where either point is NaN.

    Raises:
        InputError: arrays of other shapes.
    """
    return np.linalg.norm(points - truth, axis=-1)


@takes_arrays
def angles(one: Float[np.ndarray, "n 3"], other: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
    """Return the angles between directions, (n,) [rad]; NaN where either is NaN or zero.

    Raises:
        InputError: arrays of other shapes.
    """
    sine, cosine = np.linalg.norm(np.cross(one, other), axis=-1), np.sum(one * other, axis=-1)
    zero = (np.linalg.norm(one, axis=-1) == 0) | (np.linalg.norm(other, axis=-1) == 0)
    return np.where(zero, np.nan, np.arctan2(sine, cosine))


@takes_arrays
def coverage(
    estimate: ContactEstimate, truth: Float[np.ndarray, "n 3"], which: Bool[np.ndarray, " n"]
) -> EllipseCoverage:
    """Return the coverage of the estimates that `which` (n,) selects; without any, count is 0 and the rest NaN.

    Those without truth (n, 3) [m], or whose covariance C is NaN or not of rank 2, are omitted. The squared distance is
    d' C^+ d, C^+ the inverse within the two directions in which C has variance.

    Raises:
        InputError: arrays of other shapes.
    """
    usable = which & np.isfinite(estimate.covariance).all(axis=(-2, -1)) & np.isfinite(truth).all(axis=-1)
    rows: Int[np.ndarray, " k"] = np.flatnonzero(usable)
    values, vectors = np.linalg.eigh(estimate.covariance[rows])
    flat = values[:, 1] <= _FLAT * values[:, 2]
    along = np.einsum("nik,ni->nk", vectors[:, :, 1:], estimate.point[rows] - truth[rows])
    square: Float[np.ndarray, " k"] = np.sum(along[~flat] ** 2 / values[~flat, 1:], axis=-1)
    if not len(square):
        return EllipseCoverage(0, np.nan, np.nan)
    return EllipseCoverage(len(square), float(np.mean(square <= CHI2_95)), float(square.mean()))
