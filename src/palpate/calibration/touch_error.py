"""Estimate errors of touches at known points beyond wrench noise: indentation, marks, a drift of marks or sensor."""

from __future__ import annotations

from dataclasses import dataclass
from math import log2

import numpy as np
from jaxtyping import Float

from palpate.signals.correlation import correlation_time
from palpate.spatial.arguments import takes_arrays

FEWEST, MANY = 4, 48  # touches whose errors are estimated; of more, groups are averaged
VARIANCES = np.geomspace(1e-3, 30.0, 32)  # that are tried, over that of the residuals
DOUBTFUL = 0.2  # probability of no drift above which there is none
SURE = 4.0  # over sqrt(n): a correlation time of n touches that differs from 1 by less is none


@dataclass(frozen=True)
class TouchError:
    """Standard deviations [m] along one tangent of the apparent points of touches about their marks.

    Attributes:
        jitter: beyond the noise, different in each touch.
        drift: common to touches that follow each other.
        lasting: touches after which the correlation of the drift falls to 1/e.
    """

    jitter: float = 0.0
    drift: float = 0.0
    lasting: float = 1.0

    def placement(self, marks: float) -> float:
        """Return the part [m] that is not due to marks hit with a standard deviation of `marks` [m]."""
        return float(np.hypot(max(self.jitter**2 - marks**2, 0.0) ** 0.5, self.drift))

    @takes_arrays
    def carried(self, gains: Float[np.ndarray, "n p 3"]) -> Float[np.ndarray, "p p"]:
        """Return the covariance (p, p) of the sum of gains (n, p, 3) times the drift of each touch.

        Raises:
            InputError: gains have another shape.
        """
        touch = np.arange(len(gains))
        alike = self.drift**2 * np.exp(-np.abs(np.subtract.outer(touch, touch)) / self.lasting)
        return np.einsum("kpi,kqi->pq", gains, np.tensordot(alike, gains, 1))


@takes_arrays
def touch_error(
    errors: Float[np.ndarray, "n 2"], slopes: Float[np.ndarray, "n 2 6"], noise: Float[np.ndarray, " n"]
) -> TouchError:
    """Estimate the `TouchError` of touches by their errors from a pose that was fitted to them.

    They are white noise of variance u and a shift of the surface that drifts, of variance s^2 along each axis and
    correlation exp(-|k - l| / tau) between touches k and l. Returned are the means of u and s^2 over their restricted
    likelihood [Patterson & Thompson 1971], if log u, log s, log tau are evenly distributed, tau from one touch to all,
    and s = 0 as probable as not. Of many touches, the means of groups show s and tau, and u is what remains in these
    and within: marks of single samples may err alike for some samples. Fewer than four touches, or errors of 0, show
    nothing.

    Args:
        errors: (n, 2) [m] of apparent points, along two tangents.
        slopes: (n, 2, 6) of the errors in the pose: rotation vector [rad], translation [m].
        noise: (n,) [m^2] variance of an error due to the wrench's noise.

    Raises:
        InputError: arrays of other shapes.
    """
    if len(errors) < FEWEST or not errors.any():
        return TouchError()
    size = -(-len(errors) // MANY)
    groups, scale = len(errors) // size, float(np.sum(errors**2)) / (errors.size - slopes.shape[2])
    grouped = errors[: groups * size].reshape(groups, size, 2)
    mean, slope = grouped.mean(axis=1), slopes[: groups * size].reshape(groups, size, 2, 6).mean(axis=1)
    within = float(np.sum((grouped - mean[:, None]) ** 2)) / grouped.size
    white, drift = scale * VARIANCES, scale * np.append(0.0, VARIANCES)
    lasting: Float[np.ndarray, " t"] = groups * 0.5 ** np.arange(log2(groups))  # groups show no drift that lasts longer
    likelihood = np.stack([_likelihood(mean, slope, white, drift, each) for each in lasting])
    likelihood[..., 0] += np.log(len(VARIANCES))
    weight = np.exp(likelihood - likelihood.max())
    if np.sum(weight[..., 0]) > DOUBTFUL * np.sum(weight):
        weight[..., 1:] = 0.0
    weight /= np.sum(weight)
    jitter = max(float(np.sum(weight, axis=(0, 2)) @ white) + within - float(noise.mean()), 0.0) ** 0.5
    drifts = np.sum(weight, axis=1) @ drift  # by how long they last
    if not drifts.any():
        return TouchError(jitter)
    return TouchError(jitter, float(drifts.sum()) ** 0.5, size * float(np.average(lasting, weights=drifts)))


def _likelihood(
    errors: Float[np.ndarray, "g 2"],
    slopes: Float[np.ndarray, "g 2 6"],
    white: Float[np.ndarray, " u"],
    drift: Float[np.ndarray, " s"],
    lasting: float,
) -> Float[np.ndarray, "u s"]:
    """Return the log-likelihood of the errors that no pose explains, by variances of noise and drift."""
    touch, known, shifts = np.arange(len(errors)), slopes.reshape(-1, 6), slopes[:, :, 3:]
    free = np.linalg.svd(known / np.linalg.norm(known, axis=0).clip(1e-300))[0][:, 6:]
    correlation = np.exp(-np.abs(np.subtract.outer(touch, touch)) / lasting)
    alike = np.einsum("kai,kl,lbi->kalb", shifts, correlation, shifts).reshape(errors.size, errors.size)
    share, axes = np.linalg.eigh(free.T @ alike @ free)
    variance = white[:, None, None] + drift[:, None] * share.clip(0.0)
    square = np.square((free @ axes).T @ errors.ravel())
    return -0.5 * np.sum(np.log(variance) + square / variance, axis=2)


@takes_arrays
def spread_in_time(errors: Float[np.ndarray, "n k"]) -> float:
    """Return the longest correlation time of errors (n, k) of n touches, in touches; 1 if it is not significant.

    Raises:
        InputError: errors has another shape.
    """
    longest = float(correlation_time(errors).max())
    return longest if longest > 1.0 + SURE / len(errors) ** 0.5 else 1.0
