"""Estimate how many readings of a filtered log count as one independent reading."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from palpate.spatial.arguments import takes_arrays

LONGEST = 1 / 4  # of the series: beyond it a correlation is not known


@takes_arrays
def correlation_time(values: Float[np.ndarray, "n k"]) -> Float[np.ndarray, " k"]:
    """Return the integrated correlation time (k,) of each column, in samples, at least 1.

    The variance of a mean of n samples is the variance of one sample, times this time, over n. With rho the
    autocorrelation,

        tau = 1 + 2 sum rho(t),  t = 1 ... T,

    summed to the first T where rho(2t) + rho(2t + 1) is not positive [Geyer 1992].

    Args:
        values: (n, k) residuals; a constant column has 1.

    Raises:
        InputError: values has another shape.
    """
    count = len(values)
    if count < 4:
        return np.ones(len(values.T))
    centred = values - values.mean(axis=0)
    padded = 1 << (2 * count - 1).bit_length()
    spectrum = np.abs(np.fft.rfft(centred, padded, axis=0)) ** 2
    lags = np.fft.irfft(spectrum, padded, axis=0)[: max(2, int(count * LONGEST) // 2 * 2)]
    with np.errstate(invalid="ignore", divide="ignore"):
        rho = np.where(lags[0] > 0, lags / lags[0], 0.0)
    pairs = rho[0::2] + rho[1::2]
    reached = np.cumprod(pairs > 0, axis=0)
    return np.maximum(2.0 * np.sum(pairs * reached, axis=0) - 1.0, 1.0)
