"""The least error that noise allows: the Cramer-Rao bound over the surface, from the forward model alone.

A soft finger at p(u, v) makes W = (F, p x F + tau n(p)). Its six numbers hold six unknowns (F, u, v, tau), so the bound
is J^-1 Sigma J^-T with J by central differences on the exact shape. No estimator, and no covariance of one, is used.
"""

import numpy as np

from claims.papers.probe.assumed import NOISE
from claims.papers.probe.shapes import Probe
from palpate_lab.simulation import contact_wrenches


def bound(probe: Probe, point: np.ndarray, wrench: np.ndarray) -> float:
    """The rms error [m] on the surface that no unbiased estimate undercuts, for one reading with the assumed noise."""
    normal = probe.normals(point)
    first = np.cross(normal, [0.0, 1.0, 0.0])
    first /= np.linalg.norm(first)
    tangents = np.stack([first, np.cross(normal, first)])
    torque = (wrench[3:] - np.cross(point, wrench[:3])) @ normal
    at = np.concatenate([wrench[:3], [0.0, 0.0, torque]])

    def forward(x: np.ndarray) -> np.ndarray:
        here = probe.land(point + x[:, 3:5] @ tangents, normal)
        return contact_wrenches(here, probe.normals(here), x[:, :3], x[:, 5])

    steps = np.diag([1e-3] * 3 + [1e-6] * 2 + [1e-5])
    slopes = (forward(at + steps) - forward(at - steps)) / (2 * np.diag(steps)[:, None])
    inverse = np.linalg.inv(slopes.T)
    covariance = inverse @ np.diag(NOISE**2) @ inverse.T
    return float(np.sqrt(covariance[3, 3] + covariance[4, 4]))
