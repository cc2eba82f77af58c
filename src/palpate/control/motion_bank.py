"""What moves in an unknown way: where it is, how fast, and where it will be in a moment."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from palpate.errors import InputError
from palpate.spatial._arrays import shaped

__all__ = ["MotionBank"]

# Densities of white noise on the third derivative, of motions as large as 1: sines of 10, 5, 2 and 1 s; and of one on
# the first, for steps.
JERK = (0.03, 1.0, 30.0, 600.0)
STEP = 0.5
MEMORY = 0.5  # s


class MotionBank:
    """A bank of Kalman filters on each of some series, mixed by their likelihood; no period or shape is assumed.

    Each filter believes in a constant second derivative that white noise of its own density drives, from slow motions
    to quick ones, and one in a constant value that steps. The likelihood of what each foresaw, forgotten within half a
    second, weighs them (multiple-model estimation [bar-shalom]); prediction is by the mixture.

    Args:
        sizes: (c,) of the motions to expect, one a series, in its unit: their order of magnitude is enough.

    Raises:
        InputError: a size that is not positive.
    """

    def __init__(self, sizes: ArrayLike) -> None:
        from palpate.control import _motion_bank as kernel  # compiled: loaded when first needed

        self.sizes = shaped(sizes, (None,), "sizes").copy()
        if not ((self.sizes > 0) & np.isfinite(self.sizes)).all():
            raise InputError(f"sizes of motions must be positive, not {self.sizes.tolist()}.")
        count = len(self.sizes)
        self._densities = self.sizes[:, None] ** 2 * np.array([*JERK, -STEP])
        self._advance, self._foresee = kernel.advance, kernel.foresee
        self._filters = np.zeros((count, self._densities.shape[1], kernel.STATE))
        self._mixed = np.zeros((count, 9))
        self._value, self._rate = np.zeros(count), np.zeros(count)
        self.start(np.zeros(count))
        self.update(0.005, np.zeros(count), np.ones(count))  # compiles
        self.predict(0.0)
        self.start(np.zeros(count))

    def start(self, values: ArrayLike, rates: ArrayLike | None = None) -> None:
        """Begin at these values (c,), known to about the sizes, and at rest within the sizes over a second."""
        self._filters[:] = 0.0
        self._filters[..., 0] = np.asarray(values, dtype=np.float64)[:, None]
        self._filters[..., 1] = 0.0 if rates is None else np.asarray(rates, dtype=np.float64)[:, None]
        for entry, share in ((3, 1.0), (6, 1.0), (8, 10.0)):
            self._filters[..., entry] = share * self.sizes[:, None] ** 2
        self._filters[..., 9] = -np.log(self._filters.shape[1])
        self._mixed[:] = self._filters[:, 0, :9]

    def update(self, step: float, readings: Float[np.ndarray, " c"], variances: Float[np.ndarray, " c"]) -> None:
        """Over a step [s] of time, then by one reading of each series; NaN: none of that series."""
        self._advance(readings, variances, step, self._densities, MEMORY, self._filters, self._mixed)

    def predict(self, ahead: float) -> tuple[Float[np.ndarray, " c"], Float[np.ndarray, " c"]]:
        """Values and rates `ahead` [s] from now; the arrays are written anew by the next call."""
        self._foresee(self._mixed, ahead, self._value, self._rate)
        return self._value, self._rate

    @property
    def deviations(self) -> Float[np.ndarray, " c"]:
        """Standard deviations of the values now."""
        return np.sqrt(self._mixed[:, 3])

    @property
    def weights(self) -> Sequence[Sequence[float]]:
        """How much each filter counts, one row a series; they sum to one."""
        return np.exp(self._filters[..., 9]).tolist()
