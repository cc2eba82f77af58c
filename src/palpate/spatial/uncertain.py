"""Covariances: from a user's statement of the noise, and from the uncertainty of a pose."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from palpate.errors import InputError
from palpate.spatial.arguments import takes_arrays
from palpate.spatial.pose import Pose, skew

__all__ = ["inverse_pose_covariance", "noise_covariance", "pose_noise_on_wrench"]

LARGEST = 1e9  # N, N m: no sensor, and its square is a number


@takes_arrays
def noise_covariance(noise: ArrayLike) -> Float[np.ndarray, "6 6"]:
    """Return a 6 x 6 covariance [N, N m], force first, from a covariance or from standard deviations.

    Args:
        noise: the standard deviations of force and torque, the same along each axis; of each of the six numbers; or a
            covariance.

    Raises:
        InputError: none of the three shapes, not finite, not symmetric or negative.
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
def pose_noise_on_wrench(
    wrench: Float[np.ndarray, "*batch 6"], covariance: Float[np.ndarray, "6 6"]
) -> Float[np.ndarray, "*batch 6 6"]:
    """Return the covariance (*batch, 6, 6) [N, N m] of a wrench in the target frame that an uncertain pose causes.

    Args:
        wrench: (*batch, 6) already in the target frame, force first.
        covariance: of (rotation vector [rad], translation [m]) of the pose T_target_source perturbed on the
            *left*: T = exp(xi) T_mean.

    To first order dF = omega x F and dM = omega x M + rho x F.
    """
    force, torque = skew(wrench[..., :3]), skew(wrench[..., 3:])
    jacobian = np.zeros((*wrench.shape[:-1], 6, 6))
    jacobian[..., :3, :3] = -force
    jacobian[..., 3:, :3] = -torque
    jacobian[..., 3:, 3:] = -force
    return jacobian @ covariance @ np.swapaxes(jacobian, -1, -2)


@takes_arrays
def inverse_pose_covariance(pose: Pose, covariance: Float[np.ndarray, "6 6"]) -> Float[np.ndarray, "6 6"]:
    """Return the covariance (6, 6) [rad, m] of the inverse of a pose, each perturbed on its left.

    (exp(xi) T)^-1 = exp(-Ad(T^-1) xi) T^-1, with Ad = [[R, 0], [[t]x R, R]] for (rotation, translation).
    """
    inverse = pose.inverse()
    adjoint = inverse.wrench_matrix()  # the same block pattern: rotation plays force, translation plays torque
    return adjoint @ covariance @ adjoint.T
