"""How contacts are found in frames of taxels."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

from palpate.errors import InputError

__all__ = ["TaxelSettings"]


@dataclass(frozen=True)
class TaxelSettings:
    """How contacts are found.

    Args:
        on, off: a contact begins where a cell stands so many deviations of its noise above its rest, and reaches as far
            as cells that stand `off` above: a threshold of each cell's own, that follows its drift.
        sure, share: two peaks are two contacts if the saddle lies deeper than `sure` deviations and than this share of
            the lower peak.
        unequal: share by which a cell's gain may be off from its curve, beside its noise; None: 0.02 of cells whose
            curves are known, 0.1 of others.
        drift: [s] in which the rest of an untouched cell is followed; inf: it stays.
        walk: [counts/sqrt(s)] by which a cell's rest wanders. Where it is stated, it takes the place of `drift`: the
            rest is followed by a Kalman filter, a second late and while nothing touches the cell, and what is not
            known of it is in the thresholds and the covariance. 0: not known.
        reach, speed, patience: of identities: a contact may be `reach` [m] off from one frame to the next, and move at
            `speed` [m/s] beside that; one that is lost is waited for `patience` [s].
    """

    on: float = 6.0
    off: float = 3.0
    sure: float = 5.0
    share: float = 0.05
    unequal: float | None = None
    drift: float = 10.0
    walk: float = 0.0
    reach: float = 0.012
    speed: float = 0.5
    patience: float = 0.3

    def __post_init__(self) -> None:
        if not 0 < self.off <= self.on < inf:
            raise InputError(f"off ({self.off:g}) must lie between 0 and on ({self.on:g}).")
        if not (self.drift > 0 and self.sure >= 0 and 0 <= self.share < 1):
            raise InputError("drift must be positive, sure not negative and share between 0 and 1.")
        if not 0 <= self.walk < inf:
            raise InputError("walk must not be negative.")
        if self.unequal is not None and not 0 <= self.unequal < inf:
            raise InputError("unequal must not be negative.")
        if not (self.reach > 0 and self.speed >= 0 and self.patience >= 0):
            raise InputError("reach must be positive, speed and patience not negative.")
