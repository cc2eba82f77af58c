"""Compute wrenches of single touches from point and force: forwards only, never through an estimator."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float


def contact_wrenches(
    points: Float[np.ndarray, "*batch 3"],
    normals: Float[np.ndarray, "*batch 3"],
    forces: Float[np.ndarray, "*batch 3"],
    torsions: Float[np.ndarray, "*batch"],
) -> Float[np.ndarray, "*batch 6"]:
    """Return W = (F, p x F + tau n), (*batch, 6): a force at a point, and a torque about the outward unit normal."""
    return np.concatenate([forces, np.cross(points, forces) + torsions[..., None] * normals], axis=-1)


def touch_wrenches(
    points: Float[np.ndarray, "n 3"],
    normals: Float[np.ndarray, "n 3"],
    rng: np.random.Generator,
    *,
    force: tuple[float, float] = (1.0, 10.0),
    tan_theta: float = 0.5,
    pitch: float = 0.0,
) -> Float[np.ndarray, "n 6"]:
    """Draw random pressing wrenches at given points.

    The force's size is uniform in its bounds, the tangent of the angle between -F and n uniform in [0, tan_theta], its
    azimuth uniform. The pitch h = F . M / |F|^2 is uniform in [-pitch, pitch]; as F . (p x F) = 0 this fixes the
    torsion, tau = h |F|^2 / (F . n).

    Args:
        points: (n, 3) [m] on the surface.
        normals: (n, 3) outward unit normals there.
        rng: random numbers.
        force: bounds of |F| [N].
        tan_theta: the largest friction coefficient in use.
        pitch: the largest |h| [m].

    Returns:
        (n, 6) [N, N m] about the origin of the points' frame, force first.
    """
    count = len(points)
    size = rng.uniform(*force, count)
    forces = directed_forces(normals, size, rng.uniform(0.0, tan_theta, count), rng.uniform(0.0, 2 * np.pi, count))
    pitches = rng.uniform(-pitch, pitch, count)
    return contact_wrenches(points, normals, forces, pitches * size**2 / np.sum(forces * normals, axis=-1))


def directed_forces(
    normals: Float[np.ndarray, "*batch 3"],
    size: Float[np.ndarray, "*batch"],
    tan_theta: Float[np.ndarray, "*batch"],
    azimuth: Float[np.ndarray, "*batch"],
) -> Float[np.ndarray, "*batch 3"]:
    """Return forces (*batch, 3) of a size [N] that press at a friction angle and an azimuth [rad] about the normal.

    The friction angle is given by its tangent.
    """
    first, second = _tangents(normals)
    size, slope, turn = size[..., None], tan_theta[..., None], azimuth[..., None]
    sideways = np.cos(turn) * first + np.sin(turn) * second
    return size * (slope * sideways - normals) / np.sqrt(1.0 + slope**2)


def _tangents(normals: Float[np.ndarray, "*batch 3"]) -> tuple[np.ndarray, np.ndarray]:
    """Return two unit vectors that complete each normal to a right-handed triad."""
    least = np.eye(3)[np.argmin(np.abs(normals), axis=-1)]
    first = np.cross(normals, least)
    first /= np.linalg.norm(first, axis=-1, keepdims=True)
    return first, np.cross(normals, first)
