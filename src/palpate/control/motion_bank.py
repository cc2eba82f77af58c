"""Estimate and predict unknown motion: its value, its rate, and its value a moment later."""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from palpate.errors import InputError
from palpate.spatial._arrays import shaped
from palpate.spatial.arguments import number, takes_arrays

# Densities of white noise, of motions as large as 1: on the third derivative, for sines from 10 s down to 1 s; and on
# the value itself, for jumps.
JERK = (0.03, 1.0, 30.0, 300.0)
JUMP = 3.0
RATES = (0.1, 0.3, 10.0)  # 1/s: a smooth motion becomes another, a jump begins, and ends


class MotionBank:
    """A bank of Kalman filters on each of several series, combined by likelihood; no period or shape is assumed.

    Each filter assumes a second derivative driven by white noise of another density, from slow motions to fast ones; in
    the last, for jumps, the value is driven by noise as well. Each begins a step from the mixture of all, by their
    probabilities (interacting multiple models, Blom and Bar-Shalom 1988 [bar-shalom]). The mixture predicts.

    Args:
        sizes: (c,) order of magnitude of the expected motions, one per series, in its unit.

    Raises:
        InputError: a size is not positive and finite, or they are no list of numbers.
    """

    @takes_arrays
    def __init__(self, sizes: ArrayLike) -> None:
        from palpate.control import _motion_bank as kernel  # compiled: loaded when first needed

        self.sizes = shaped(sizes, (None,), "sizes").copy()
        if not ((self.sizes > 0) & np.isfinite(self.sizes)).all():
            raise InputError(f"sizes of motions must be positive, not {self.sizes.tolist()}.")
        count = len(self.sizes)
        noises = np.array([*((each, 0.0) for each in JERK), (JERK[0], JUMP)])
        self._densities, self._rates = self.sizes[:, None, None] ** 2 * noises, np.array(RATES)
        self._advance, self._foresee = kernel.advance.unchecked, kernel.foresee.unchecked
        self._filters = np.zeros((count, len(noises), kernel.STATE))
        self._mixed = np.zeros((count, 9))
        self._kept = np.zeros_like(self._filters), np.zeros_like(self._mixed)
        self._value, self._rate = np.zeros(count), np.zeros(count)
        self.start(np.zeros(count))
        self.update(0.005, np.zeros(count), np.ones(count))  # compiles
        self.predict(0.0)
        self.start(np.zeros(count))

    @takes_arrays
    def start(self, values: ArrayLike, series: slice = slice(None)) -> None:
        """Begin at values known to about the sizes, and at rest to within the sizes per second.

        Args:
            values: one per series that begins.
            series: slice of those that begin; all by default.

        Raises:
            InputError: values of another number.
        """
        filters = self._filters[series]
        begun = shaped(values, filters.shape[:-2], "values")
        filters[:] = 0.0
        filters[..., 0] = begun[..., None]
        for entry, share in ((3, 1.0), (6, 1.0), (8, 10.0)):
            filters[..., entry] = share * self.sizes[series, None] ** 2
        filters[..., 9] = 1.0 / filters.shape[-2]
        self._mixed[series] = filters[..., 0, :9]
        self.keep()

    def scale(self, factors: Float[np.ndarray, " c"]) -> None:
        """Multiply values, rates and standard deviations by factors (c,).

        Raises:
            InputError: another number of factors.
        """
        factors = shaped(factors, self.sizes.shape, "factors")
        for known in (self._filters, self._mixed[:, None]):
            known[..., :3] *= factors[:, None, None]
            known[..., 3:9] *= factors[:, None, None] ** 2
        self.keep()

    def keep(self) -> None:
        """Store the present state, for `recall`."""
        self._kept[0][:], self._kept[1][:] = self._filters, self._mixed

    def recall(self) -> None:
        """Restore the state that was stored last, by `keep`, `start` or `scale`."""
        self._filters[:], self._mixed[:] = self._kept

    def update(self, step: float, readings: Float[np.ndarray, " c"], variances: Float[np.ndarray, " c"]) -> None:
        """Advance by a step [s], then correct by one reading and variance of each series, (c,); NaN: no reading.

        Raises:
            InputError: another number of readings or variances.
        """
        shape = self.sizes.shape
        if type(step) is not float:
            step = number(step, "step")
        readings, variances = shaped(readings, shape, "readings"), shaped(variances, shape, "variances")
        self._advance(readings, variances, step, self._densities, self._rates, self._filters, self._mixed)

    def far(self, readings: Float[np.ndarray, " c"], variances: Float[np.ndarray, " c"], step: float) -> float:
        """Return the most standard deviations by which a reading, `step` [s] from now, differs from the prediction.

        Raises:
            InputError: another number of readings or variances.
        """
        shape = self.sizes.shape
        off = shaped(readings, shape, "readings") - self.predict(step)[0]
        known = self._mixed[:, 3] + shaped(variances, shape, "variances")
        return math.sqrt(max(0.0, float(np.max(off * off / known))))  # 0 if no reading is finite

    def predict(self, delay: float) -> tuple[Float[np.ndarray, " c"], Float[np.ndarray, " c"]]:
        """Return values (c,) and rates (c,) [unit, unit/s] `delay` [s] from now; the next call overwrites them."""
        self._foresee(self._mixed, delay, self._value, self._rate)
        return self._value, self._rate
