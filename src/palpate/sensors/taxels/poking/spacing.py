"""Compare the spacing of taxels on their modules with what places or pokes show."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import sqrt

import numpy as np
from jaxtyping import Float

from palpate.calibration.touch_error import spread_in_time
from palpate.sensors.taxels.modules import ModuleLayout
from palpate.sensors.taxels.poking.rigid_groups import Units, placed
from palpate.spatial.arguments import takes_arrays

SURE = 3.0  # standard deviations: beyond them the layout's spacing is contradicted
_STEP = 1e-2  # of the scale: of the differences that stand for derivatives


@dataclass(frozen=True)
class Spacing:
    """The spacing of neighbouring taxels on a module [m].

    Attributes:
        stated: of the layout as given.
        found: in the data, with its standard deviation `deviation`; NaN: it cannot be found.
        used: of the modules as they are laid.
    """

    stated: float
    found: float
    deviation: float
    used: float

    @property
    def contradicted(self) -> bool:
        """Return whether the data contradict the stated spacing."""
        return abs(self.found - self.stated) > SURE * self.deviation

    def __str__(self) -> str:
        found = f"{1e3 * self.found:.2f} +- {1e3 * self.deviation:.2f} mm found, " if self.deviation > 0 else ""
        return f"{found}{1e3 * self.stated:.2f} mm in the layout, {1e3 * self.used:.2f} mm used"

    def warnings(self, by: str) -> tuple[str, ...]:
        """Return a warning, or (), where the data, named `by` ("the pokes"), contradict the layout."""
        if not self.contradicted and self.used == self.stated:
            return ()
        if self.used != self.stated:
            done = "modules are laid with that; --spacing states another"
        else:
            done = "modules are laid as stated"
        return (
            f"{by} show taxels {1e3 * self.found:.2f} +- {1e3 * self.deviation:.2f} mm from their neighbours, not "
            f"{1e3 * self.stated:.2f} mm as in the layout: {done}",
        )


@takes_arrays
def by_scale(units: Units) -> Float[np.ndarray, "k 3"]:
    """Return the derivatives (k, 3) [m] of taxels' places by a scale of the layout about 1; 0 without a place."""
    ends = [
        replace(units, layout=ModuleLayout(units.layout.places * scale, units.layout.module)).places[0]
        for scale in (1.0 + _STEP, 1.0 - _STEP)
    ]
    return np.nan_to_num((ends[0] - ends[1]) / (2.0 * _STEP))


@takes_arrays
def scale_in_places(units: Units, places: Float[np.ndarray, "k 3"]) -> tuple[float, float]:
    """Return the factor by which the layout of fitted modules fits places best, and its standard deviation.

    Both are NaN with fewer distances than unknowns.

    Args:
        units: fitted to the places.
        places: (k, 3) [m] of the taxels, NaN if not known.
    """
    rows = np.flatnonzero(placed(units.layout, places))
    along, by, gap = by_scale(units)[rows], units.jacobian[rows], (places - units.places[0])[rows]
    unit = units.layout.module[rows]
    square, right = np.zeros((len(units), units.freedom, units.freedom)), np.zeros((len(units), units.freedom))
    np.add.at(square, unit, np.einsum("kia,kib->kab", by, by))
    np.add.at(right, unit, np.einsum("kia,ki->ka", by, along))
    share = np.einsum("uab,ub->ua", np.linalg.pinv(square), right)
    along = along - np.einsum("kia,ka->ki", by, share[unit])  # what no motion of the modules can do
    freedom, told = gap.size - units.freedom * len(units) - 1, float((along**2).sum())
    if freedom <= 0 or told <= 0:
        return np.nan, np.nan
    step = float((along * gap).sum()) / told
    left = gap - step * along
    alike = spread_in_time(left)
    return 1.0 + step, sqrt(alike * float((left**2).sum()) / freedom / told)
