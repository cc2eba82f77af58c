"""Where each taxel of a skin sits, how well that is known, and on which module it is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import nan

import numpy as np
from jaxtyping import Bool, Float, Int

from palpate.errors import InputError
from palpate.spatial._arrays import Value, frozen
from palpate.spatial.arguments import takes_arrays

__all__ = ["TaxelPlaces"]


@takes_arrays
@dataclass(frozen=True, eq=False)
class TaxelPlaces(Value):
    """k taxels in the frame of the link that carries them.

    Attributes:
        positions: (k, 3) [m]; NaN of a number at which there is no taxel.
        normals: (k, 3) outward, unit; NaN where not known.
        covariance: (k, 3, 3) [m^2] of the positions; NaN where not known.
        module: (k,) which module each is on, -1: none.
        pokes: (k,) how many pokes it answered to; 0: it was never touched, and is placed by its module.
        relative: (k,) [m] standard deviation (root of the trace) once one rigid motion of the whole skin is taken off;
            NaN where not known.
        reach: [m] deviation of the response to a poke over its distance from the taxel; NaN where not known.
        configurations: (d, 8) of the arm in which pokes were made: the link in the sensor's frame, x y z [m] and
            quaternion x y z w, and how many pokes.
        noise: (6,) deviations of the wrench of a poke [N, N m]; none where not known.
        provenance: what it was made from.
        notes: what to know of it, a sentence each.
    """

    positions: Float[np.ndarray, "k 3"]
    normals: Float[np.ndarray, "k 3"]
    covariance: Float[np.ndarray, "k 3 3"] = field(default_factory=lambda: np.zeros((0, 3, 3)))
    module: Int[np.ndarray, " k"] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    pokes: Int[np.ndarray, " k"] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    relative: Float[np.ndarray, " k"] = field(default_factory=lambda: np.zeros(0))
    reach: float = nan
    configurations: Float[np.ndarray, "d 8"] = field(default_factory=lambda: np.zeros((0, 8)))
    noise: Float[np.ndarray, " six"] = field(default_factory=lambda: np.zeros(0))
    provenance: Mapping[str, str] = field(default_factory=lambda: {})
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        count = len(self.positions)
        unknown = {"covariance": nan, "relative": nan, "module": -1, "pokes": 0}
        shapes = {"positions": (3,), "normals": (3,), "covariance": (3, 3), "relative": (), "module": (), "pokes": ()}
        for name, tail in shapes.items():
            given = np.asarray(getattr(self, name))
            if name in unknown and not given.size:
                given = np.full((count, *tail), unknown[name])
            if given.shape != (count, *tail):
                raise InputError(f"{name} of shape {given.shape} does not belong to {count} taxels.", where="taxels")
            array = np.array(given, dtype=np.int64) if name in ("module", "pokes") else frozen(given)
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        object.__setattr__(self, "configurations", frozen(self.configurations, tail=(8,), name="configurations"))
        object.__setattr__(self, "noise", frozen(self.noise, name="noise"))

    def __len__(self) -> int:
        return len(self.positions)

    @property
    def there(self) -> Bool[np.ndarray, " k"]:
        """(k,) at which numbers there is a taxel."""
        return np.asarray(np.isfinite(self.positions).all(axis=1), dtype=bool)

    @property
    def modules(self) -> int:
        """How many modules there are."""
        return int(self.module.max(initial=-1)) + 1

    def deviations(self) -> Float[np.ndarray, " k"]:
        """[m] root of the trace of each covariance."""
        return np.sqrt(np.trace(self.covariance, axis1=1, axis2=2))
