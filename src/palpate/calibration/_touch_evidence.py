"""What touches say about where a surface sits: a residual that vanishes at the true pose, its slope and its size.

Poses are T_sensor_surface = (R, t), moved by x = (omega, delta): R <- exp(omega) R, t <- t + delta.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from palpate.contact.locate import locate
from palpate.spatial.pose import Pose, skew
from palpate.spatial.wrench import Wrench
from palpate.surfaces import Mesh

__all__ = ["Evidence", "KnownPoints", "SomewhereOnSurface", "moved"]

FLOOR = 1e-5  # m: no touch is believed to be placed better than this, even if the caller states no noise at all
STEP = 0.03  # rad, and a third of it in sizes of the surface: over many facets, so that the slope is the body's


class Evidence(ABC):
    """Residuals of n touches, k numbers each, of which `informative` can differ from zero."""

    informative: int

    @abstractmethod
    def residual(self, pose: Pose) -> Float[np.ndarray, "n k"]:
        """What the pose leaves unexplained."""

    @abstractmethod
    def jacobian(self, pose: Pose) -> Float[np.ndarray, "n k 6"]:
        """The slope of `residual` in (omega, delta)."""

    @abstractmethod
    def whitener(self, pose: Pose) -> Float[np.ndarray, "n k k"]:
        """Makes the residual's expected covariance the identity."""


@dataclass(frozen=True)
class Touched:
    """Wrenches in the sensor frame, their covariances, and the spread of what is not measured.

    Args:
        wrenches: (n, 6) [N, N m].
        covariances: (n, 6, 6).
        placement: [m] standard deviation of where a touch is believed to be, along each axis.
        torsion: [m] standard deviation of the torque about the normal, for each newton.
        friction: standard deviation of each tangential part of the unit force.
    """

    wrenches: Float[np.ndarray, "n 6"]
    covariances: Float[np.ndarray, "n 6 6"]
    placement: float
    torsion: float
    friction: float


class KnownPoints(Evidence):
    """Touches at known points: r = M - (R p + t) x F is the torsion about the normal and noise, nothing else.

    The torsion is integrated out: it only widens the covariance along the normal R n.
    """

    informative = 3

    def __init__(self, touched: Touched, points: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"]) -> None:
        self.touched, self.points, self.normals = touched, points, normals

    def residual(self, pose: Pose) -> Float[np.ndarray, "n k"]:
        """M - (R p + t) x F."""
        return _unexplained(self.touched.wrenches, pose.apply(self.points))

    def jacobian(self, pose: Pose) -> Float[np.ndarray, "n k 6"]:
        """The point moves by omega x (R p) + delta, and -(that) x F = [F]x (that)."""
        force = skew(self.touched.wrenches[:, :3])
        return np.concatenate([-force @ skew(pose.rotate(self.points)), force], axis=2)

    def whitener(self, pose: Pose) -> Float[np.ndarray, "n k k"]:
        """Of `_torque_covariance`."""
        return _whitener(_torque_covariance(self.touched, pose.apply(self.points), pose.rotate(self.normals)))


class SomewhereOnSurface(Evidence):
    """Touches anywhere on the surface: each is located with the pose in question, and two priors judge the result.

    Six equations fit six unknowns, so a located touch leaves no residual of torque but its torsion. What informs is
    that bodies are mostly pressed, not dragged: the unit force scatters about -n. Both are written in the sensor's
    frame, so that a turn which changes nothing has no slope; a wrench that misses the surface leaves its moment about
    the nearest point.
    """

    informative = 3

    def __init__(self, touched: Touched, surface: Mesh) -> None:
        self.touched, self.surface = touched, surface

    def _located(self, pose: Pose) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
        """Points and normals, in the sensor's frame."""
        wrench = Wrench.from_vector(self.touched.wrenches).transformed(pose.inverse())
        found = locate(wrench, self.surface, friction=10.0, torsion=1.0)  # wide: the priors judge, softly
        lost: np.ndarray = ~np.all(np.isfinite(found.point + found.normal), axis=1, keepdims=True)
        nearest, normal, _ = self.surface.project(_axis_points(wrench, self.surface))
        return pose.apply(np.where(lost, nearest, found.point)), pose.rotate(np.where(lost, normal, found.normal))

    def residual(self, pose: Pose) -> Float[np.ndarray, "n k"]:
        """(M - p x F, F / |F| + n) with the located p and n."""
        points, normals = self._located(pose)
        force = self.touched.wrenches[:, :3]
        unit = force / np.linalg.norm(force, axis=1, keepdims=True)
        return np.concatenate([_unexplained(self.touched.wrenches, points), unit + normals], axis=1)

    def jacobian(self, pose: Pose) -> Float[np.ndarray, "n k 6"]:
        """Central differences: the located point has no simple slope."""
        sizes = np.repeat([STEP, STEP / 3 * self.surface.size], 3)
        pairs = [(self.residual(moved(pose, step)), self.residual(moved(pose, -step))) for step in np.diag(sizes)]
        return np.stack([(up - down) / (2 * size) for (up, down), size in zip(pairs, sizes, strict=True)], axis=2)

    def whitener(self, pose: Pose) -> Float[np.ndarray, "n k k"]:
        """Of the torque as for known points, and of the unit force."""
        whole = np.zeros((len(self.touched.wrenches), 6, 6))
        whole[:, :3, :3] = _whitener(_torque_covariance(self.touched, *self._located(pose)))
        whole[:, 3:, 3:] = np.eye(3) / self.touched.friction
        return whole


def moved(pose: Pose, step: Float[np.ndarray, "6"]) -> Pose:
    """The pose turned by omega in place and shifted by delta."""
    turn = Pose.from_rotation_vector(step[:3], np.zeros(3))
    return Pose(turn.rotation @ pose.rotation, pose.translation + step[3:])


def _unexplained(wrenches: Float[np.ndarray, "n 6"], points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    return wrenches[:, 3:] - np.cross(points, wrenches[:, :3])


def _torque_covariance(
    touched: Touched, points: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "n 3 3"]:
    """Of M - p x F: noise of M and of F with the lever p, the place of the touch with the lever F, and the torsion."""
    force = skew(touched.wrenches[:, :3])
    square = np.sum(touched.wrenches[:, :3] ** 2, axis=1)[:, None, None]
    lever = np.concatenate([-skew(points), np.broadcast_to(np.eye(3), (len(points), 3, 3))], axis=2)
    noise = lever @ touched.covariances @ np.swapaxes(lever, 1, 2)
    place = touched.placement**2 * force @ np.swapaxes(force, 1, 2)
    spin = touched.torsion**2 * square * normals[:, :, None] * normals[:, None, :]
    return noise + place + spin + FLOOR**2 * square * np.eye(3)


def _whitener(covariance: Float[np.ndarray, "n k k"]) -> Float[np.ndarray, "n k k"]:
    return np.linalg.inv(np.linalg.cholesky(covariance))


def _axis_points(wrench: Wrench, surface: Mesh) -> Float[np.ndarray, "n 3"]:
    """The point of each wrench's axis that is nearest to the middle of the surface."""
    square = np.sum(wrench.force**2, axis=1, keepdims=True)
    start = np.cross(wrench.force, wrench.torque) / square
    along = np.sum((surface.centre - start) * wrench.force, axis=1, keepdims=True)
    return start + along / square * wrench.force
