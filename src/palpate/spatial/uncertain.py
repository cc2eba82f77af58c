"""Covariances of wrenches from stated noise, and of inverse poses."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from palpate.errors import InputError
from palpate.spatial.arguments import takes_arrays
from palpate.spatial.pose import Pose

LARGEST = 1e9  # N, N m: no sensor, and its square is a number


@takes_arrays
def noise_covariance(noise: ArrayLike) -> Float[np.ndarray, "6 6"]:
    """Return a 6 x 6 covariance [N, N m], force first, from a covariance or from standard deviations.

    Args:
        noise: (2,) standard deviations of force [N] and torque [N m] along each axis; or (6,) of each number; or a
            covariance (6, 6).

    Raises:
        InputError: another shape; a deviation that is negative or above 1e9; a covariance that is not finite, not
            symmetric, or has a negative eigenvalue.
    """
    array = np.asarray(noise, dtype=np.float64)
    array = np.repeat(array, 3) if array.shape == (2,) else array
    if array.shape == (6,) and np.all((array >= 0) & (array <= LARGEST)):
        return np.diag(array**2)
    if array.shape != (6, 6):
        got = f"shape {array.shape}" if array.shape != (6,) else str(array.tolist())
        raise InputError(
            f"noise must be two or six standard deviations from 0 to {LARGEST:g} or a 6 x 6 covariance, force first, "
            f"not {got}.",
            hint="Write noise=(0.02, 0.001): N, N m.",
        )
    if not np.all(np.isfinite(array)) or not np.allclose(array, array.T, rtol=1e-9, atol=1e-12 * np.abs(array).max()):
        raise InputError("noise covariance must be finite and symmetric.")
    if np.linalg.eigvalsh(array).min() < -1e-12 * np.abs(array).max():
        raise InputError("noise covariance has a negative eigenvalue.")
    return array


@takes_arrays
def inverse_pose_covariance(pose: Pose, covariance: Float[np.ndarray, "6 6"]) -> Float[np.ndarray, "6 6"]:
    """Return the covariance (6, 6) of the inverse of a pose: rotation vector [rad], then translation [m].

    Both poses are perturbed on the left: (exp(xi) T)^-1 = exp(-Ad(T^-1) xi) T^-1, Ad = [[R, 0], [[t]x R, R]].

    Raises:
        InputError: the covariance has another shape.
    """
    adjoint = pose.inverse().wrench_matrix()  # the same block pattern: rotation plays force, translation plays torque
    return adjoint @ covariance @ adjoint.T
