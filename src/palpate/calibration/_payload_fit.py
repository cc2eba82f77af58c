"""The algebra of payload identification: the model and its Jacobian, two linear fits, their covariance, outliers.

Parameters are always the twelve (weight, force_bias, center_of_mass, torque_bias) of `palpate.sensors.Payload`, held to
a subspace by a basis where something is given.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

from palpate.spatial.pose import skew

__all__ = ["covariance", "force_columns", "kept_samples", "model", "residual_covariance", "torque_columns", "two_stage"]

CUTOFF = 5.0  # robust standard deviations beyond which a sample is set aside: 3 in a million good ones
HUBER = 1.5

Vector = Float[np.ndarray, "12"]


def model(theta: Vector, rotations: Float[np.ndarray, "n 3 3"]) -> tuple[np.ndarray, np.ndarray]:
    """Wrenches (n, 6) that a payload makes, and their Jacobian (n, 6, 12): F = R^T w + f0, M = c x (R^T w) + m0."""
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
    """Force on (weight, bias), then torque on (centre, bias) with the *modelled* weight as the regressor.

    With the measured force as the regressor, as [probe] prints it, its noise pulls the centre towards the sensor.

    Args:
        wrenches: (n, 6) in the sensor frame.
        rotations: (n, 3, 3), sensor in base.
        direction: unit vector of gravity in the base; None when free.
        weights: (n, 2) of the samples' forces and torques; None for ones.
    """
    weights = np.ones((len(wrenches), 2)) if weights is None else weights
    columns = force_columns(rotations, direction)
    solution = _weighted(columns, wrenches[:, :3], weights[:, 0])
    weight = solution[:3] if direction is None else solution[0] * direction
    torque = _weighted(torque_columns(rotations, weight), wrenches[:, 3:], weights[:, 1])
    return np.concatenate([weight, solution[-3:], torque])


def force_columns(rotations: np.ndarray, direction: np.ndarray | None) -> Float[np.ndarray, "n 3 p"]:
    """The regressor of the force: on (w, f0), or on (|w|, f0) along a given direction."""
    transposed = rotations.swapaxes(-1, -2)
    first = transposed if direction is None else (transposed @ direction)[..., None]
    return np.concatenate([first, np.broadcast_to(np.eye(3), transposed.shape)], axis=-1)


def torque_columns(rotations: np.ndarray, weight: np.ndarray) -> Float[np.ndarray, "n 3 6"]:
    """The regressor of the torque, on (c, m0), for a weight in the base."""
    levers = -skew(rotations.swapaxes(-1, -2) @ weight)
    return np.concatenate([levers, np.broadcast_to(np.eye(3), levers.shape)], axis=-1)


def _weighted(columns: np.ndarray, target: np.ndarray, weights: np.ndarray) -> np.ndarray:
    root = np.sqrt(weights)[:, None]
    matrix = (columns * root[..., None]).reshape(-1, columns.shape[-1])
    return np.linalg.lstsq(matrix, (target * root).ravel(), rcond=None)[0]


def residual_covariance(residuals: Float[np.ndarray, "n 6"], force_unknowns: int) -> Float[np.ndarray, "6 6"]:
    """Of one sample, unbiased for the unknowns that force and torque were fitted with."""
    count = residuals.size // 2
    free = np.array([max(count - unknowns, 1) for unknowns in (force_unknowns, 6)])
    scale = np.repeat(np.sqrt(count / free), 3)
    return (residuals.T @ residuals / len(residuals)) * np.outer(scale, scale)


def covariance(
    jacobian: Float[np.ndarray, "n 6 p"], noise: Float[np.ndarray, "6 6"], *, joint: bool
) -> tuple[Float[np.ndarray, "p p"], Float[np.ndarray, "p n 6"]]:
    """Covariance of an estimate that solves sum Z_i^T r_i = 0, and the gain that takes residuals to its change.

    With G = sum Z_i^T J_i it is G^-1 (sum Z_i^T S Z_i) G^-T. Jointly whitened, Z = S^-1 J and this is
    (J^T S^-1 J)^-1; in two stages, Z is J without the torque's say on the force's parameters. Either way c carries the
    weight's error.

    Args:
        jacobian: of every sample, in the parameters that are free; the last six only the torque determines.
        noise: S, of one sample.
        joint: whitened jointly, or in two stages.
    """
    if joint:
        instruments = np.linalg.solve(noise, jacobian)
    else:
        instruments = jacobian.copy()
        instruments[:, 3:, :-6] = 0.0
    rows, columns = (array.reshape(-1, jacobian.shape[-1]) for array in (instruments, jacobian))
    inverse = np.linalg.inv(rows.T @ columns)
    middle = rows.T @ (noise @ instruments).reshape(rows.shape)
    return inverse @ middle @ inverse.T, np.moveaxis(instruments @ inverse.T, -1, 0)


def kept_samples(
    wrenches: Float[np.ndarray, "n 6"],
    rotations: Float[np.ndarray, "n 3 3"],
    direction: Float[np.ndarray, "3"] | None,
    floor: Float[np.ndarray, "6"],
) -> Bool[np.ndarray, " n"]:
    """Samples within `CUTOFF` robust standard deviations, channel by channel, of a fit that the others do not pull.

    A Huber fit to start, then least squares on what lies within, until that no longer changes. Gaussian data keep the
    efficiency of plain least squares. Regressors are rotations, bounded: poses that are spread
    out leave no leverage to guard against.
    """

    def left(weights: np.ndarray | None) -> np.ndarray:
        return wrenches - model(two_stage(wrenches, rotations, direction, weights), rotations)[0]

    residuals = left(None)
    for _ in range(10):
        distance = (np.abs(residuals) / _spread(residuals, floor)).reshape(-1, 2, 3).max(axis=2)
        residuals = left(np.minimum(1.0, HUBER / np.maximum(distance, 1e-12)))
    kept = np.ones(len(wrenches), dtype=bool)
    for _ in range(20):
        inside = np.all(np.abs(residuals) <= CUTOFF * _spread(residuals, floor), axis=1)
        before, kept = kept, np.asarray(inside, dtype=bool)
        if np.array_equal(before, kept):
            break
        residuals = left(np.repeat(kept[:, None].astype(np.float64), 2, axis=1))
    return kept


def _spread(residuals: np.ndarray, floor: np.ndarray) -> Float[np.ndarray, "6"]:
    """Standard deviations from the median absolute residual, widened where samples are few [Rousseeuw 1987]."""
    free = max(len(residuals) - 2, 1)  # six unknowns are two samples' worth
    middle = 1.4826 * (1.0 + 5.0 / free) * np.asarray(np.median(np.abs(residuals), axis=0))
    return np.maximum(middle, floor)
