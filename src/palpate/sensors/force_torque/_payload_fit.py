"""The algebra of payload identification: the model and its Jacobian, two linear fits, their covariance, outliers.

Parameters are always the twelve (weight, force_bias, center_of_mass, torque_bias) of `palpate.Payload`, restricted to
a subspace by a basis where something is given.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from palpate.spatial.pose import skew

CUTOFF = 5.0  # robust standard deviations beyond which a sample is set aside: 3 in a million good ones
HUBER = 1.5
BLOCKS = 200  # into which a long log is parted for the drift of its bias
FEWEST = 12  # blocks without which a drift is not looked for
ROUNDING = 1e-9  # N, N m: residuals below it are no errors
DRIFTS = 3.5  # standard deviations of the ratio that shows a drift: 1 in 700 of six axes without one

Vector = Float[np.ndarray, "12"]


def model(theta: Vector, rotations: Float[np.ndarray, "n 3 3"]) -> tuple[np.ndarray, np.ndarray]:
    """Return a payload's wrenches (n, 6) and their Jacobian (n, 6, 12): F = R^T w + f0, M = c x (R^T w) + m0."""
    weight, center = rotations.swapaxes(-1, -2) @ theta[:3], theta[6:9]
    jacobian = np.zeros((len(rotations), 6, 12))
    jacobian[:, :3, :3] = rotations.swapaxes(-1, -2)
    jacobian[:, 3:, :3] = skew(center) @ jacobian[:, :3, :3]
    jacobian[:, :3, 3:6] = np.eye(3)
    jacobian[:, 3:, 6:9] = -skew(weight)
    jacobian[:, 3:, 9:] = np.eye(3)
    return np.concatenate([weight + theta[3:6], np.cross(center, weight) + theta[9:]], axis=1), jacobian


def two_stage(
    wrenches: Float[np.ndarray, "n 6"],
    rotations: Float[np.ndarray, "n 3 3"],
    direction: Float[np.ndarray, "3"] | None,
    weights: Float[np.ndarray, "n 2"] | None = None,
) -> Vector:
    """Fit force on (weight, bias), then torque on (centre, bias), and return all (12,).

    The torque's regressor is the modelled weight: the noise of the measured force, as [probe] prints it, would pull the
    centre towards the sensor.

    Args:
        wrenches: (n, 6) in the sensor frame.
        rotations: (n, 3, 3), sensor in base.
        direction: (3,) unit vector of gravity in the base; None: free.
        weights: (n, 2) of the samples' forces and torques; None: ones.
    """
    weights = np.ones((len(wrenches), 2)) if weights is None else weights
    columns = force_columns(rotations, direction)
    solution = _weighted(columns, wrenches[:, :3], weights[:, 0])
    weight = solution[:3] if direction is None else solution[0] * direction
    torque = _weighted(torque_columns(rotations, weight), wrenches[:, 3:], weights[:, 1])
    return np.concatenate([weight, solution[-3:], torque])


def force_columns(rotations: np.ndarray, direction: np.ndarray | None) -> Float[np.ndarray, "n 3 p"]:
    """Return the force's regressor (n, 3, p) on (w, f0), or on (|w|, f0) along a given direction."""
    transposed = rotations.swapaxes(-1, -2)
    first = transposed if direction is None else (transposed @ direction)[..., None]
    return np.concatenate([first, np.broadcast_to(np.eye(3), transposed.shape)], axis=-1)


def torque_columns(rotations: np.ndarray, weight: np.ndarray) -> Float[np.ndarray, "n 3 6"]:
    """Return the torque's regressor (n, 3, 6) on (c, m0), for a weight [N] in the base frame."""
    levers = -skew(rotations.swapaxes(-1, -2) @ weight)
    return np.concatenate([levers, np.broadcast_to(np.eye(3), levers.shape)], axis=-1)


def _weighted(columns: np.ndarray, target: np.ndarray, weights: np.ndarray) -> np.ndarray:
    root = np.sqrt(weights)[:, None]
    matrix = (columns * root[..., None]).reshape(-1, columns.shape[-1])
    return np.linalg.lstsq(matrix, (target * root).ravel(), rcond=None)[0]


def residual_covariance(residuals: Float[np.ndarray, "n 6"], force_unknowns: int) -> Float[np.ndarray, "6 6"]:
    """Return the covariance (6, 6) of one sample's residual, unbiased for the number of fitted unknowns."""
    count = residuals.size // 2
    free = np.array([max(count - unknowns, 1) for unknowns in (force_unknowns, 6)])
    scale = np.repeat(np.sqrt(count / free), 3)
    return (residuals.T @ residuals / len(residuals)) * np.outer(scale, scale)


@dataclass(frozen=True, eq=False)
class Errors:
    """Errors of a log's wrenches: independent noise, and a drift of the bias.

    Attributes:
        white: (6, 6) covariance of each wrench's independent error.
        drift: (2, 6) of the bias from block to block: standard deviation of its random walk, and its trend; 0 where
            none is seen.
        block: (n,) index of each wrench's block.
    """

    white: Float[np.ndarray, "6 6"]
    drift: Float[np.ndarray, "2 6"]
    block: Int[np.ndarray, " n"]

    @staticmethod
    def of(residuals: Float[np.ndarray, "n 6"], white: Float[np.ndarray, "6 6"]) -> Errors:
        """Return the `Errors` that explain residuals (n, 6) in the order of time; `white` is their covariance."""
        from palpate.calibration.random_walk import fit_walk, steps_of  # scipy.optimize: loaded when first needed

        count = len(residuals)
        blocks = min(count, BLOCKS)
        block: Int[np.ndarray, " n"] = np.arange(count, dtype=np.int64) * blocks // count
        size, drift, alone = np.bincount(block), np.zeros((2, 6)), np.ones(6)
        means = np.stack([np.bincount(block, column) / size for column in residuals.T], axis=1)
        felt = np.flatnonzero(np.mean(means**2, axis=0) > ROUNDING**2)
        if _drifts(means, felt):
            steps = steps_of(np.arange(blocks, dtype=np.float64), means[:, felt], 0.0)
            each = [[k] for k in range(len(felt))]
            plain, fit = fit_walk(steps, each), fit_walk(steps.with_shape(np.ones(blocks - 1)), each, np.inf)
            trends = np.abs(fit.course[0]) > DRIFTS * np.sqrt(fit.covariance[:, 0, 0])
            seen, noise = plain.seen | trends, np.where(trends, fit.noise, plain.noise)
            drift[0, felt] = np.where(seen, np.where(trends, fit.walk, plain.walk), 0.0)
            drift[1, felt] = np.where(trends, fit.course[0], 0.0)
            if blocks == count:
                alone[felt] = np.where(seen, np.minimum(1.0, noise / np.sqrt(np.diag(white)[felt])), 1.0)
        white = white * np.outer(alone, alone)
        return Errors(white, drift, block)

    @property
    def notes(self) -> tuple[str, ...]:
        """Return a tuple of one sentence where the bias drifts; else ()."""
        if not self.drift.any():
            return ()
        blocks = int(self.block[-1]) + 1
        drift = np.hypot(self.drift[0] * blocks**0.5, self.drift[1] * blocks)
        kinds = ((slice(3), 1.0, "N"), (slice(3, 6), 1e3, "N mm"))
        sizes = ((scale * float(drift[part].max()), unit) for part, scale, unit in kinds)
        amounts = " and ".join(f"{size:.2g} {unit}" for size, unit in sizes if size > 0)
        return (
            f"The bias drifts by about {amounts} in all during the log, which the covariance includes. Record the "
            "poses faster, or let the sensor warm up first.",
        )

    def spread(self, gain: Float[np.ndarray, "p n 6"]) -> Float[np.ndarray, "p p"]:
        """Return the covariance (p, p) of an estimate's errors, `gain` times the errors of the wrenches.

        What counts is the bias when the sensor is used, at either end of the log. From there the biases at blocks i and
        j of B have the covariance walk^2 (B - |i - j|) / 2 + trend^2 (i j + (B - i) (B - j)) / 2.
        """
        found = np.einsum("pni,ij,qnj->pq", gain, self.white, gain, optimize=True)
        if self.drift.any():
            last = int(self.block[-1]) + 1
            summed, number = (
                np.add.reduceat(gain, np.searchsorted(self.block, np.arange(last)), axis=1),
                np.arange(last),
            )
            lags, left = np.abs(np.subtract.outer(number, number)), last - number
            kernels = np.stack([last - lags, np.outer(number, number) + np.outer(left, left)]) / 2.0
            moved = np.sum(kernels[:, None] @ (summed * self.drift[:, None, None] ** 2), axis=0)
            found = found + np.einsum("pai,qai->pq", summed, moved)
        return found


def _drifts(means: Float[np.ndarray, "b 6"], felt: Int[np.ndarray, " k"]) -> bool:
    """Return whether one of the axes changes too slowly for independent errors, by the ratio of von Neumann [1941]."""
    count = len(means)
    if count < FEWEST:
        return False
    ratio = np.sum(np.diff(means, axis=0) ** 2, axis=0)[felt] / np.sum(means**2, axis=0)[felt]
    return bool(np.any((1.0 - ratio / 2.0) * np.sqrt((count**2 - 1.0) / (count - 2.0)) > DRIFTS))


def gain_of(
    jacobian: Float[np.ndarray, "n 6 p"], noise: Float[np.ndarray, "6 6"] | None
) -> tuple[Float[np.ndarray, "p n 6"], Float[np.ndarray, "n 6 p"]]:
    """Return the gain G^-1 Z_i^T (p, n, 6), G = sum Z_i^T J_i, of an estimate that solves sum Z_i^T r_i = 0, and Z.

    Args:
        jacobian: J, (n, 6, p), in the free parameters; only the torque determines the last six.
        noise: S, (6, 6) covariance of one sample, for a joint fit, Z = S^-1 J; None: in two stages, Z being J without
            the torque's rows for the force's parameters.
    """
    if noise is not None:
        instruments = np.linalg.solve(noise, jacobian)
    else:
        instruments = jacobian.copy()
        instruments[:, 3:, :-6] = 0.0
    rows, columns = (array.reshape(-1, jacobian.shape[-1]) for array in (instruments, jacobian))
    return np.moveaxis(instruments @ np.linalg.inv(rows.T @ columns).T, -1, 0), instruments


def kept_samples(
    wrenches: Float[np.ndarray, "n 6"],
    rotations: Float[np.ndarray, "n 3 3"],
    direction: Float[np.ndarray, "3"] | None,
    floor: Float[np.ndarray, "6"],
) -> Bool[np.ndarray, " n"]:
    """Return a mask (n,) of the samples within `CUTOFF` robust standard deviations, per channel, of a robust fit.

    Least squares on the samples within follow a Huber fit, until these no longer change. `floor` (6,) is the least
    standard deviation.
    """

    def left(weights: np.ndarray | None) -> np.ndarray:
        return wrenches - model(two_stage(wrenches, rotations, direction, weights), rotations)[0]

    residuals = left(None)
    for _ in range(10):
        distance = (np.abs(residuals) / robust_spread(residuals, floor)).reshape(-1, 2, 3).max(axis=2)
        residuals = left(np.minimum(1.0, HUBER / np.maximum(distance, 1e-12)))
    kept = np.ones(len(wrenches), dtype=bool)
    for _ in range(20):
        inside = np.all(np.abs(residuals) <= CUTOFF * robust_spread(residuals, floor), axis=1)
        before, kept = kept, np.asarray(inside, dtype=bool)
        if np.array_equal(before, kept):
            break
        residuals = left(np.repeat(kept[:, None].astype(np.float64), 2, axis=1))
    return kept


def robust_spread(residuals: Float[np.ndarray, "n k"], floor: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
    """Return standard deviations (k,) from the median absolute residual, wider for few samples [Rousseeuw 1987]."""
    free = max(len(residuals) - 2, 1)  # six unknowns are two samples' worth
    middle = 1.4826 * (1.0 + 5.0 / free) * np.asarray(np.median(np.abs(residuals), axis=0))
    return np.maximum(middle, floor)
