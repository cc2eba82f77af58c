"""Touches of a taxel sheet as values, and how they are looked for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from math import inf

import numpy as np
from jaxtyping import Bool, Float, Int

from palpate.contact.estimate import ContactEstimate

__all__ = ["SkinSettings", "SkinTouches"]


@dataclass(frozen=True)
class SkinSettings:
    """How touches are found.

    Args:
        on, off: a touch begins where a cell stands so many deviations of its noise above its rest, and reaches as far
            as cells that stand `off` above: a threshold of each cell's own, that follows its drift.
        sure, share: two peaks are two touches if the saddle lies deeper than `sure` deviations and than this share of
            the lower peak.
        drift: [s] in which the rest of an untouched cell is followed; inf: it stays.
        reach, speed, patience: of `contact.track.Tracker`.
    """

    on: float = 6.0
    off: float = 3.0
    sure: float = 5.0
    share: float = 0.05
    drift: float = 10.0
    reach: float = 0.012
    speed: float = 0.5
    patience: float = 0.3

    def __post_init__(self) -> None:
        if not 0 < self.off <= self.on < inf:
            raise ValueError(f"off ({self.off:g}) must lie between 0 and on ({self.on:g})")
        if not (self.drift > 0 and self.sure >= 0 and 0 <= self.share < 1):
            raise ValueError("drift must be positive, sure not negative and share between 0 and 1")
        if not (self.reach > 0 and self.speed >= 0 and self.patience >= 0):
            raise ValueError("reach must be positive, speed and patience not negative")


@dataclass(frozen=True, eq=False)
class SkinTouches:
    """Touches of some frames, at least one row a frame.

    Attributes:
        sample: (n,) which frame; time: (n,) [s]; contact: (n,) identity.
        estimate: point, normal, force and covariance in the link's frame; the torque about the normal is NaN, because
            cells feel no shear. SATURATED: located, but the force is a lower bound.
        row, column: (n,) between cell centres, which have whole numbers; NaN without a touch, as all that follows.
        area: (n,) [m^2] of the cells that are pressed.
        load: (n,) [N] sum of the cells' forces along their own normals; on a curved link more than the force.
        pressure: (n,) [Pa] mean; peak: (n,) [Pa] of one cell.
        axes: (n, 2) [cells], deviations of the pressure along its principal axes, the long one first.
        angle: (n,) [rad] of the long axis, from the direction of rising rows towards that of rising columns.
        cells: (n,) how many.
    """

    sample: Int[np.ndarray, " n"]
    time: Float[np.ndarray, " n"]
    contact: Int[np.ndarray, " n"]
    estimate: ContactEstimate
    row: Float[np.ndarray, " n"]
    column: Float[np.ndarray, " n"]
    area: Float[np.ndarray, " n"]
    load: Float[np.ndarray, " n"]
    peak: Float[np.ndarray, " n"]
    pressure: Float[np.ndarray, " n"]
    axes: Float[np.ndarray, "n 2"]
    angle: Float[np.ndarray, " n"]
    cells: Float[np.ndarray, " n"]

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, np.ndarray):
                value.flags.writeable = False

    def __len__(self) -> int:
        return len(self.sample)

    @property
    def found(self) -> Bool[np.ndarray, " n"]:
        """Rows that hold a touch."""
        return np.isfinite(self.row)

    @classmethod
    def joined(cls, parts: Sequence[SkinTouches]) -> SkinTouches:
        """One after the other."""
        names = [field.name for field in fields(cls) if field.name != "estimate"]
        columns = {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
        return cls(estimate=ContactEstimate.joined([part.estimate for part in parts]), **columns)
