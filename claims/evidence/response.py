"""Where neighbouring strips or taxels are touched, by a map from their readings that is learnt from presses.

p(r) = mean + sum_i w_i exp(-|r - r_i|^2 / 2 l^2): the mean of a Gaussian process (kernel ridge regression).
"""

import numpy as np

NOISE = 0.01  # of the readings' say: variance of a position that readings cannot explain, as a share of its spread
SAMPLE = 500  # presses from which the typical distance between readings, 2 l, is taken


def held_out(readings: np.ndarray, positions: np.ndarray, groups: np.ndarray) -> tuple[float, float]:
    """Return the rms error of positions (n, 1), each group by a map of the others, and the share that is explained."""
    some = readings[:: max(len(readings) // SAMPLE, 1)]
    apart = np.linalg.norm(some[:, None] - some[None], axis=-1)
    length, found = float(np.median(apart[np.triu_indices(len(some), 1)])) / 2, np.empty_like(positions)
    for group in np.unique(groups):
        out = groups == group
        known, mean = readings[~out], positions[~out].mean(axis=0)
        kernel = _kernel(known, known, length)
        kernel[np.diag_indices(len(kernel))] += NOISE
        weights = np.linalg.solve(kernel, positions[~out] - mean)
        found[out] = mean + _kernel(readings[out], known, length) @ weights
    error = np.sqrt(np.mean((found - positions) ** 2))
    return float(error), float(1.0 - error**2 / positions.var())


def _kernel(one: np.ndarray, other: np.ndarray, length: float) -> np.ndarray:
    square = (one**2).sum(axis=1)[:, None] + (other**2).sum(axis=1) - 2 * one @ other.T
    return np.exp(-np.maximum(square, 0.0) / (2 * length**2))
