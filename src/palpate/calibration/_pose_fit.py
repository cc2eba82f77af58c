"""Find the most probable pose of a surface from touches and a prior: damped Gauss-Newton with robust weights."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from palpate.calibration._touch_evidence import Evidence, moved
from palpate.spatial.pose import Pose

__all__ = ["apply", "fit", "offset"]

USUAL = 3.0  # standard deviations of a touch: beyond it its weight falls (Huber 1964)
MEDIAN = 2.366  # of the chi-square with 3 degrees of freedom


def fit(evidence: Evidence, initial: Pose) -> tuple[Pose, Float[np.ndarray, " n"], float]:
    """Return the most probable pose, each touch's residual in standard deviations, (n,), and their scale, 1 or more."""
    pose, damping, sizes = initial, 1e-6, evidence.spreads.sizes
    for _ in range(100):
        whitener = evidence.whitener(pose)
        residual = apply(whitener, evidence.residual(pose))
        distances = np.linalg.norm(residual, axis=1)
        scale = _scale(distances)
        weights = np.minimum(1.0, USUAL * scale / np.maximum(distances, 1e-12)) / scale**2
        slope = whitener @ evidence.jacobian(pose)
        away = offset(initial, pose) / sizes
        normal: np.ndarray = np.einsum("n,nki,nkj->ij", weights, slope, slope) + np.diag(1 / sizes**2)
        descent: np.ndarray = np.einsum("n,nki,nk->i", weights, slope, residual) + away / sizes
        cost = weights @ distances**2 + away @ away
        step: np.ndarray = -np.linalg.solve(normal + damping * np.diag(np.diag(normal)), descent)
        trial = moved(pose, step)
        left = np.linalg.norm(apply(whitener, evidence.residual(trial)), axis=1)
        better = weights @ left**2 + np.sum((offset(initial, trial) / sizes) ** 2) <= cost
        pose, damping = (trial, damping / 10) if better else (pose, max(damping, 1e-7) * 10)
        gain = -float(step @ descent)  # of the cost, expected: the squared step in standard deviations
        if gain < 1e-10 or (gain < 1e-3 and not better):
            break
    distances = np.linalg.norm(apply(evidence.whitener(pose), evidence.residual(pose)), axis=1)
    return pose, distances, _scale(distances)


def _scale(distances: Float[np.ndarray, " n"]) -> float:
    return max(1.0, float(np.sqrt(np.median(distances**2) / MEDIAN)))


def offset(initial: Pose, pose: Pose) -> Float[np.ndarray, "6"]:
    """Return the offset (6,) from `initial` to `pose`: rotation vector [rad] and shift of the origin [m]."""
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_matrix(pose.rotation @ initial.rotation.T).as_rotvec()
    return np.concatenate([turn, pose.translation - initial.translation])


def apply(whitener: Float[np.ndarray, "n k k"], residual: Float[np.ndarray, "n k"]) -> Float[np.ndarray, "n k"]:
    """Return each touch's residual in standard deviations, (n, k)."""
    return np.einsum("nij,nj->ni", whitener, residual)
