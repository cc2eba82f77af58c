"""How noisy a log is, from the log itself."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

__all__ = ["estimate_noise"]

# The median of |difference of two independent normals of deviation s| is s sqrt(2) 0.6745.
_MEDIAN_STEP = 2**0.5 * 0.6744897501960817


def estimate_noise(wrenches: Float[np.ndarray, "n k"]) -> Float[np.ndarray, " k"] | None:
    """Standard deviations [N, N m] of one reading, from its steps; None where fewer than ten steps are finite.

    The median absolute step over 0.954, which touches that come and go hardly move. It reads the fast part only: where
    the driver has filtered the log, the noise comes out too small. Readings that merely repeat the one before are left
    out; where the resolution hides the noise (a median of 0), the deviation of the steps is taken instead.

    Args:
        wrenches: (n, 6) [N, N m] as logged, or other readings (n, k).
    """
    steps = np.diff(wrenches, axis=0)
    steps = steps[np.isfinite(steps).all(axis=1) & (steps != 0).any(axis=1)]
    if len(steps) < 10:
        return None
    typical = np.median(np.abs(steps), axis=0) / _MEDIAN_STEP
    return np.where(typical > 0, typical, np.std(steps, axis=0) / 2**0.5)
