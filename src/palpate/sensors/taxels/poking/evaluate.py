"""Compare places of taxels with reference places."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int

from palpate.errors import InputError
from palpate.evaluation.errors import ErrorSummary
from palpate.sensors.taxels.places import TaxelPlaces
from palpate.spatial.arguments import frozen_value
from palpate.spatial.pose import Pose

_CHI2_95 = np.array([np.inf, 3.841458820694124, 5.991464547107979, 7.814727903251179])  # of 0 to 3 degrees of freedom
_FLAT = 1e-6  # of the largest variance: below it a direction has none
FEWEST = 3  # taxels that a rigid motion is found from


@frozen_value
class TaxelErrors:
    """Errors of the k taxels that have both places.

    Attributes:
        number: (k,) index of each taxel; module: (k,) index of its module, -1: none.
        touched: (k,) true where a poke touched the taxel; all true where pokes are not known.
        estimate, truth: (k, 3) [m].
        absolute: (k,) [m]; relative: (k,) [m] after `motion`, NaN for fewer than three taxels.
        motion: from the estimate to the truth; None for fewer than three taxels.
        inside: (k,) true where the 95 % ellipsoid contains the truth; known: (k,) true where there is an ellipsoid.
        lacking: number of indices at which only one of both has a taxel.
    """

    number: Int[np.ndarray, " k"]
    module: Int[np.ndarray, " k"]
    touched: Bool[np.ndarray, " k"]
    estimate: Float[np.ndarray, "k 3"]
    truth: Float[np.ndarray, "k 3"]
    absolute: Float[np.ndarray, " k"]
    relative: Float[np.ndarray, " k"]
    motion: Pose | None
    inside: Bool[np.ndarray, " k"]
    known: Bool[np.ndarray, " k"]
    lacking: int

    @property
    def coverage(self) -> float:
        """Return the share, 0 to 1, of the 95 % ellipsoids that contain the truth; NaN without any."""
        return float(self.inside[self.known].mean()) if self.known.any() else float("nan")

    def summaries(self) -> list[tuple[str, ErrorSummary]]:
        """Return (name, `ErrorSummary`) pairs [m], without those of no finite error.

        They are of all taxels, of all after one rigid motion, of those touched, of the others, and of each module.
        """
        rows = {"absolute": self.absolute, "one rigid motion taken off": self.relative}
        if not self.touched.all():
            rows |= {"of those touched": self.absolute[self.touched]}
            rows |= {"of those never touched": self.absolute[~self.touched]}
        for number in np.unique(self.module[self.module >= 0]).tolist():
            rows[f"module {number}"] = self.absolute[self.module == number]
        made = [(name, ErrorSummary.of(values)) for name, values in rows.items()]
        return [(name, summary) for name, summary in made if summary is not None]


def compare_places(estimate: TaxelPlaces, truth: TaxelPlaces) -> TaxelErrors:
    """Return the `TaxelErrors` of estimated places, for each taxel that has a place in both, matched by index.

    Raises:
        InputError: the numbers of taxels differ, or no taxel has both places.
    """
    if len(estimate) != len(truth):
        raise InputError(
            f"the estimate has {len(estimate)} taxels, but the truth has {len(truth)}: they must be of the same skin.",
            where="taxels",
        )
    both = estimate.there & truth.there
    if not both.any():
        raise InputError("no taxel has a place in both estimate and truth.", where="taxels")
    number = np.flatnonzero(both)
    one, other = estimate.positions[both], truth.positions[both]
    motion = _motion(one, other)
    moved = np.full_like(one, np.nan) if motion is None else motion.apply(one)
    inside, known = _held(one - other, estimate.covariance[both])
    pokes = estimate.pokes[both]
    module = np.where(estimate.module[both] >= 0, estimate.module[both], truth.module[both])
    return TaxelErrors(
        number=number,
        module=module,
        touched=pokes > 0 if pokes.any() else np.ones(len(number), dtype=bool),
        estimate=one,
        truth=other,
        absolute=np.linalg.norm(one - other, axis=1),
        relative=np.linalg.norm(moved - other, axis=1),
        motion=motion,
        inside=inside,
        known=known,
        lacking=int(np.count_nonzero(estimate.there ^ truth.there)),
    )


def _motion(one: Float[np.ndarray, "k 3"], other: Float[np.ndarray, "k 3"]) -> Pose | None:
    """Return the rigid motion that fits one set to the other best; None for fewer than three taxels."""
    from scipy.spatial.transform import Rotation  # here: scipy is slow to import

    if len(one) < FEWEST:
        return None
    middle, target = one.mean(axis=0), other.mean(axis=0)
    turned, _ = Rotation.align_vectors(other - target, one - middle)[:2]
    rotation = turned.as_matrix()
    return Pose(rotation, target - rotation @ middle)


def _held(
    away: Float[np.ndarray, "k 3"], covariance: Float[np.ndarray, "k 3 3"]
) -> tuple[Bool[np.ndarray, " k"], Bool[np.ndarray, " k"]]:
    """Return whether d' C^+ d is below the 95 % quantile of chi-square with C's rank as degrees of freedom."""
    known = np.asarray(np.isfinite(covariance).all(axis=(1, 2)))
    values, axes = np.linalg.eigh(np.where(known[:, None, None], covariance, np.eye(3)))
    free = values > _FLAT * values[:, -1:]
    known &= values[:, -1] > 0
    along = np.einsum("kij,ki->kj", axes, away)
    square = np.where(free, along**2 / np.where(free, values, 1.0), 0.0).sum(axis=1)
    return np.asarray(square <= _CHI2_95[free.sum(axis=1)]) & known, known
