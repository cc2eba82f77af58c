"""From pokes to the places of taxels, by the method that is named."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from palpate.calibration.taxels.priors import Priors
from palpate.sensors.pokes import Pokes
from palpate.sensors.taxel_modules import ModuleLayout
from palpate.sensors.taxel_places import TaxelPlaces
from palpate.surfaces.surface import Surface

__all__ = ["METHODS", "TaxelCalibration", "calibrate_taxels"]

METHODS = ("free", "weighted", "surface", "modules")


@dataclass(frozen=True, eq=False)
class TaxelCalibration:
    """What pokes tell.

    Attributes:
        places: of the taxels, with covariance.
        residual: (n, 3) [N m] of each poke's torque, NaN of those that were not used.
        used: how many pokes were.
        noise: how many times larger the residuals are than the covariance of the wrenches explains.
        nuisances: name -> estimate of what was estimated with the taxels, (configurations, 6) or (6, 6).
        notes: what was found; doubts: what may be wrong, a sentence each.
    """

    places: TaxelPlaces
    residual: Float[np.ndarray, "n 3"]
    used: int
    noise: float
    nuisances: dict[str, np.ndarray] = field(default_factory=lambda: {})
    notes: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()


def calibrate_taxels(
    pokes: Pokes,
    *,
    method: str = "modules",
    surface: Surface | None = None,
    start: TaxelPlaces | None = None,
    layout: ModuleLayout | None = None,
    priors: Priors | None = None,
) -> TaxelCalibration:
    """Places of taxels, in the link's frame.

    Args:
        pokes: of all configurations.
        method: "free", "weighted", "surface" [taxel poking, (5), K and II-B] or "modules".
        surface: of the link, in its frame; "surface" needs one.
        start: where taxels are thought to be (CAD); None: nothing is known.
        layout: of modules; None: that of the start.
        priors: of what is estimated with them.

    Raises:
        InputError: the method needs what is not given.
        NotIdentifiable: too few pokes; what cannot be known is named.
    """
    raise NotImplementedError
