"""Find the most probable pose of a surface from touches and a prior: damped Gauss-Newton with robust weights.

Poses are T_sensor_surface = (R, t), moved by x = (omega, delta): R <- exp(omega) R, t <- t + delta.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from math import radians

import numpy as np
from jaxtyping import Float

from palpate.calibration.touch_error import TouchError, touch_error
from palpate.contact.locate import locate
from palpate.errors import InputError
from palpate.spatial.gauss_newton import gauss_newton, huber
from palpate.spatial.pose import Pose, skew
from palpate.spatial.wrench import Wrench
from palpate.surfaces import Mesh

__all__ = ["Evidence", "KnownPoints", "SomewhereOnSurface", "Spreads", "fit", "offset"]

FLOOR = 1e-5  # m: no touch is believed to be placed better than this, even if the caller states no noise at all
USUAL = 3.0  # standard deviations of a touch: beyond it its weight falls (Huber 1964)
MEDIAN = 2.366  # of the chi-square with 3 degrees of freedom
GRAZING = 0.1  # of the force: of touches that press less, errors along the surface count as if they did
ROUNDS, STILL = 100, 1e-5  # steps, and the longest in standard deviations of the prior that ends them
STEP = 0.03  # rad, and a third of it in sizes of the surface: over many facets, so that the slope is the body's


@dataclass(frozen=True)
class Spreads:
    """Expected standard deviations of quantities that are not measured.

    Args:
        prior: of the initial rotation [rad], and position of the surface's origin [m], by axis.
        placement: of how well a mark is hit [m], by axis, errors of the mesh included.
        torsion: of the torque about the normal over |F| [m].
        friction: of each tangential part of the unit force; used without points only.

    Raises:
        InputError: the placement is not above 0 and at most 1 m.
    """

    prior: tuple[float, float] = (radians(10), 0.01)
    placement: float = 0.5e-3
    torsion: float = 2e-3
    friction: float = 0.2

    def __post_init__(self) -> None:
        if not 0 < self.placement <= 1:  # NaN too
            raise InputError(f"placement must be above 0 and at most 1 m, not {self.placement:g}.")

    @property
    def sizes(self) -> Float[np.ndarray, "6"]:
        """Standard deviations (6,) of the prior [rad, m]."""
        return np.repeat(np.asarray(self.prior, dtype=np.float64), 3)


@dataclass(frozen=True)
class Evidence(ABC):
    """Residuals of n touches, k numbers each, of which three can differ from zero.

    Args:
        wrenches: (n, 6) [N, N m] in the sensor frame.
        covariances: (n, 6, 6).
        spreads: standard deviations of quantities that are not measured.
    """

    wrenches: Float[np.ndarray, "n 6"]
    covariances: Float[np.ndarray, "n 6 6"]
    spreads: Spreads

    @abstractmethod
    def residual(self, pose: Pose) -> Float[np.ndarray, "n k"]:
        """Return the residuals at a pose, (n, k)."""

    @abstractmethod
    def jacobian(self, pose: Pose) -> Float[np.ndarray, "n k 6"]:
        """Return the slope of `residual` in (omega, delta), (n, k, 6)."""

    @abstractmethod
    def whitener(self, pose: Pose) -> Float[np.ndarray, "n k k"]:
        """Return the matrices that make the residual's expected covariance the identity, (n, k, k)."""

    def error(self, pose: Pose) -> TouchError:
        """Return the `TouchError` beyond the noise, as far as the touches show it."""
        return TouchError()

    def whitened(self, pose: Pose) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, "m 6"]]:
        """Return the residuals (n k,) of all touches at a pose, in standard deviations, and their slopes (n k, 6)."""
        whitener = self.whitener(pose)
        slopes: Float[np.ndarray, "m 6"] = (whitener @ self.jacobian(pose)).reshape(-1, 6)
        return _applied(whitener, self.residual(pose)).ravel(), slopes

    def information(self, pose: Pose) -> Float[np.ndarray, "n 6 6"]:
        """Return the information of each touch on (omega, delta) at a pose, (n, 6, 6)."""
        slopes = self.whitened(pose)[1].reshape(len(self.wrenches), -1, 6)
        return np.swapaxes(slopes, 1, 2) @ slopes

    def _unexplained(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Return M - p x F."""
        return self.wrenches[:, 3:] - np.cross(points, self.wrenches[:, :3])

    def _wrench_noise(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3 3"]:
        """Return the covariance of M - p x F by that of the wrench."""
        lever = np.concatenate([-skew(points), np.broadcast_to(np.eye(3), (len(points), 3, 3))], axis=2)
        return lever @ self.covariances @ np.swapaxes(lever, 1, 2)

    def _torque_whitener(
        self, points: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"]
    ) -> Float[np.ndarray, "n 3 3"]:
        """Return the whitener of M - p x F: noise, place of the touch, torsion."""
        force = skew(self.wrenches[:, :3])
        square = np.sum(self.wrenches[:, :3] ** 2, axis=1)[:, None, None]
        place = self.spreads.placement**2 * force @ np.swapaxes(force, 1, 2)
        spin = self.spreads.torsion**2 * square * normals[:, :, None] * normals[:, None, :]
        whole: np.ndarray = self._wrench_noise(points) + place + spin + FLOOR**2 * square * np.eye(3)
        return np.linalg.inv(np.linalg.cholesky(whole))


@dataclass(frozen=True)
class KnownPoints(Evidence):
    """Touches at known points: r = M - (R p + t) x F is noise and the torsion about the normal R n.

    Args:
        points: (n, 3) [m] in the surface's frame.
        normals: (n, 3) at the points.
    """

    points: Float[np.ndarray, "n 3"]
    normals: Float[np.ndarray, "n 3"]

    def residual(self, pose: Pose) -> Float[np.ndarray, "n k"]:
        """Return M - (R p + t) x F (n, 3) [N m]."""
        return self._unexplained(pose.apply(self.points))

    def jacobian(self, pose: Pose) -> Float[np.ndarray, "n k 6"]:
        """Return the slope of `residual` in (omega, delta), (n, 3, 6)."""
        force = skew(self.wrenches[:, :3])  # the point moves by d = omega x (R p) + delta, and -d x F = [F]x d
        return np.concatenate([-force @ skew(pose.rotate(self.points)), force], axis=2)

    def whitener(self, pose: Pose) -> Float[np.ndarray, "n k k"]:
        """Return the whitener of the torque (n, 3, 3)."""
        return self._torque_whitener(pose.apply(self.points), pose.rotate(self.normals))

    def error(self, pose: Pose) -> TouchError:
        """Return the `TouchError` of the touches at their fitted pose.

        A wrench that acts at a distance d from the mark p, across its normal n, has r = M - p x F = d x F + tau n, and
        d = n x r / (n . F).
        """
        normals, points, force = pose.rotate(self.normals), pose.apply(self.points), self.wrenches[:, :3]
        tangents = np.linalg.svd(normals[:, None])[2][:, 1:]
        pressing = np.maximum(np.abs(np.sum(normals * force, axis=1)), GRAZING * np.linalg.norm(force, axis=1))
        across = tangents @ skew(normals) / pressing[:, None, None]
        noise = across @ self._wrench_noise(points) @ np.swapaxes(across, 1, 2)
        errors = np.einsum("nij,nj->ni", across, self.residual(pose))
        return touch_error(errors, across @ self.jacobian(pose), np.trace(noise, axis1=1, axis2=2) / 2.0)


@dataclass(frozen=True)
class SomewhereOnSurface(Evidence):
    """Touches anywhere on the surface, each located with the given pose.

    The information comes from the prior that bodies are mostly pressed, not dragged: the unit force scatters about -n.
    The residual of a wrench that misses the surface is its moment about the nearest point.

    Args:
        surface: mesh in its own frame.
    """

    surface: Mesh

    def _located(self, pose: Pose) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
        """Return points and normals in the sensor's frame."""
        wrench = Wrench.from_vector(self.wrenches).transformed(pose.inverse())
        found = locate(wrench, self.surface, friction=10.0, torsion=1.0)  # wide: the priors judge, softly
        lost: np.ndarray = ~np.all(np.isfinite(found.point + found.normal), axis=1, keepdims=True)
        nearest, normal, _ = self.surface.project(_axis_points(wrench, self.surface))
        return pose.apply(np.where(lost, nearest, found.point)), pose.rotate(np.where(lost, normal, found.normal))

    def residual(self, pose: Pose) -> Float[np.ndarray, "n k"]:
        """Return (M - p x F, F / |F| + n) (n, 6) with the located p and n, in the sensor's frame."""
        points, normals = self._located(pose)
        force = self.wrenches[:, :3]
        unit = force / np.linalg.norm(force, axis=1, keepdims=True)
        return np.concatenate([self._unexplained(points), unit + normals], axis=1)

    def jacobian(self, pose: Pose) -> Float[np.ndarray, "n k 6"]:
        """Return the slope of `residual` in (omega, delta) by central differences, (n, 6, 6)."""
        sizes = np.repeat([STEP, STEP / 3 * self.surface.size], 3)
        pairs = [(self.residual(moved(pose, step)), self.residual(moved(pose, -step))) for step in np.diag(sizes)]
        return np.stack([(up - down) / (2 * size) for (up, down), size in zip(pairs, sizes, strict=True)], axis=2)

    def whitener(self, pose: Pose) -> Float[np.ndarray, "n k k"]:
        """Return the whitener of the torque and of the unit force (n, 6, 6)."""
        whole = np.zeros((len(self.wrenches), 6, 6))
        whole[:, :3, :3] = self._torque_whitener(*self._located(pose))
        whole[:, 3:, 3:] = np.eye(3) / self.spreads.friction
        return whole


def moved(pose: Pose, step: Float[np.ndarray, "6"]) -> Pose:
    """Return the pose turned by omega in place and shifted by delta."""
    turn = Pose.from_rotation_vector(step[:3], np.zeros(3))
    return Pose(turn.rotation @ pose.rotation, pose.translation + step[3:])


def _axis_points(wrench: Wrench, surface: Mesh) -> Float[np.ndarray, "n 3"]:
    """Return the point of each wrench's axis nearest to the surface's middle."""
    square = np.sum(wrench.force**2, axis=1, keepdims=True)
    start = np.cross(wrench.force, wrench.torque) / square
    along = np.sum((surface.centre - start) * wrench.force, axis=1, keepdims=True)
    return start + along / square * wrench.force


def fit(evidence: Evidence, initial: Pose) -> tuple[Pose, Float[np.ndarray, " n"], float]:
    """Return the most probable pose, each touch's residual in standard deviations, (n,), and their scale, 1 or more."""
    pose, sizes = initial, evidence.spreads.sizes

    def look(pose: Pose) -> tuple[float, Callable[[], tuple[np.ndarray, np.ndarray]]]:
        residual, away = _applied(whitener, evidence.residual(pose)), offset(initial, pose) / sizes
        weights, cost = huber(np.linalg.norm(residual, axis=1) / scale, USUAL)

        def equations() -> tuple[np.ndarray, np.ndarray]:
            slope = whitener @ evidence.jacobian(pose)
            normal: np.ndarray = np.einsum("n,nki,nkj->ij", weights, slope, slope) / scale**2 + np.diag(1 / sizes**2)
            return normal, -np.einsum("n,nki,nk->i", weights, slope, residual) / scale**2 - away / sizes

        return cost + float(away @ away), equations

    for _ in range(ROUNDS):
        whitener = evidence.whitener(pose)
        scale = _scale(np.linalg.norm(_applied(whitener, evidence.residual(pose)), axis=1))
        found = gauss_newton(pose, look, moved, rounds=1)
        pose, still = found.place, bool(np.abs(offset(pose, found.place) / sizes).max() < STILL)
        if still:
            break
    distances = np.linalg.norm(_applied(evidence.whitener(pose), evidence.residual(pose)), axis=1)
    return pose, distances, _scale(distances)


def _scale(distances: Float[np.ndarray, " n"]) -> float:
    return max(1.0, float(np.sqrt(np.median(distances**2) / MEDIAN)))


def offset(initial: Pose, pose: Pose) -> Float[np.ndarray, "6"]:
    """Return the offset (6,) from `initial` to `pose`: rotation vector [rad] and shift of the origin [m]."""
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_matrix(pose.rotation @ initial.rotation.T).as_rotvec()
    return np.concatenate([turn, pose.translation - initial.translation])


def _applied(whitener: Float[np.ndarray, "n k k"], residual: Float[np.ndarray, "n k"]) -> Float[np.ndarray, "n k"]:
    """Return each touch's residual in standard deviations, (n, k)."""
    return np.einsum("nij,nj->ni", whitener, residual)
