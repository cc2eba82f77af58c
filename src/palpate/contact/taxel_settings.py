"""Settings with which contacts are found in frames of taxels."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

from palpate.errors import InputError


@dataclass(frozen=True)
class TaxelSettings:
    """Thresholds, drift and tracking by which contacts are found in frames of taxels.

    Args:
        on, off: a contact begins at a taxel that reads `on` standard deviations of its noise above its baseline, and
            extends over taxels that read `off` above it.
        sure, share: two peaks are two contacts if the saddle between them is deeper than `sure` standard deviations and
            than this share of the lower peak.
        unequal: share by which a taxel's gain may differ from its curve, in addition to its noise; None: 0.02 for
            taxels whose curves are known, 0.1 for others.
        drift: [s] time in which the baseline of an untouched taxel is followed; inf: it stays.
        walk: [counts/sqrt(s)] random walk of a taxel's baseline; 0: not known. Otherwise it replaces `drift`: a Kalman
            filter follows the baseline, a second late and while nothing touches the taxel, and its uncertainty widens
            the thresholds and the covariance.
        reach, speed, patience: for identities: a contact may differ by `reach` [m] from one frame to the next, plus
            `speed` [m/s] of motion; one that is lost is waited for during `patience` [s].

    Raises:
        InputError: not 0 < off <= on < inf; drift or reach is not positive; share is not from 0 to below 1; sure, walk,
            unequal, speed or patience is negative; walk or unequal is infinite.
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
            raise InputError(f"off ({self.off:g}) must be above 0 and at most on ({self.on:g}).")
        if not (self.drift > 0 and self.sure >= 0 and 0 <= self.share < 1):
            raise InputError("drift must be positive, sure 0 or more, and share 0 or more and below 1.")
        if not 0 <= self.walk < inf:
            raise InputError("walk must not be negative.")
        if self.unequal is not None and not 0 <= self.unequal < inf:
            raise InputError("unequal must not be negative.")
        if not (self.reach > 0 and self.speed >= 0 and self.patience >= 0):
            raise InputError("reach must be positive, and speed and patience 0 or more.")
