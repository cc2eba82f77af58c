"""Fit a payload and an accelerometer's mounting to rests of unknown orientation, each with its own gravity.

At rest i, gravity comes from above along a unit vector u_i of the sensor's axes. With W the weight the readings are

    F = f0 - W u,    M = m0 - c x W u,    a = |g| Q u + b.

All three err, each by a variance of its own, so each u_i is fitted too: total least squares. The sixteen parameters are
-W, f0, c, m0, the rotation vector of Q about the sensor's axes, and b.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from palpate.calibration.validation import Validation, cross_validate
from palpate.errors import NotIdentifiable
from palpate.sensors.force_torque._payload_fit import CUTOFF, HUBER, ROUNDING, robust_spread
from palpate.sensors.force_torque._payload_rank import MAX_SHARE, across, named
from palpate.spatial.pose import Pose, skew

FEWEST = 4  # rests: three points lie on two spheres of radius |g|
NARROW = 0.1  # rms of u along an axis, 6 degrees, below which a bias of the accelerometer could be all that is seen
KINDS = (slice(0, 3), slice(3, 6), slice(6, 9))  # of a rest's numbers: force, torque, acceleration
HUBER_ROUNDS, ROUNDS, OWN_ROUNDS = 15, 60, 5


@dataclass(frozen=True, eq=False)
class ImuFit:
    """Parameters, and the directions of gravity that fit them.

    Attributes:
        weight: [N] W.
        turn: (3, 3) Q.
        rest: (12,) f0 [N], c [m], m0 [N m] and b [m/s^2].
        up: (n, 3) u of each rest.
        deviations: (9,) standard deviation of each number, equal within a kind.
        kept: mask (n,) of the rests that were used.
        information: (16, 16) inverse covariance of the parameters.
    """

    weight: float
    turn: Float[np.ndarray, "3 3"]
    rest: Float[np.ndarray, "12"]
    up: Float[np.ndarray, "n 3"]
    deviations: Float[np.ndarray, "9"]
    kept: Bool[np.ndarray, " n"]
    information: Float[np.ndarray, "16 16"]

    @property
    def covariance(self) -> Float[np.ndarray, "16 16"]:
        """Covariance (16, 16) of the parameters."""
        size = 1.0 / np.sqrt(np.diag(self.information))
        return np.linalg.inv(self.information * np.outer(size, size)) * np.outer(size, size)

    def residuals(self, readings: Float[np.ndarray, "n 9"], magnitude: float) -> Float[np.ndarray, "n 9"]:
        """Return the residuals (n, 9) [N, N m, m/s^2] of readings of the same rests."""
        load = -self.weight * self.up
        torque = self.rest[6:9] + np.cross(self.rest[3:6], load)
        felt = self.rest[9:] + magnitude * self.up @ self.turn.T
        return readings - np.concatenate([self.rest[:3] + load, torque, felt], axis=1)


def require_spread(accelerations: Float[np.ndarray, "n 3"], of: str) -> None:
    """Require that gravity's directions in the accelerometer determine all parameters.

    Raises:
        NotIdentifiable: they do not; names what is missing, and the turn to add.
    """
    unknown = ("weight", "force_bias", "center_of_mass", "rotation of the IMU")
    if len(accelerations) < FEWEST:
        raise NotIdentifiable(
            f"an IMU needs {FEWEST} {of} or more, as its own mounting and bias are found too, and has "
            f"{len(accelerations)}. Add orientations that differ by 30 degrees or more, about two axes.",
            rank=7 * len(accelerations),  # nine numbers each, and two for gravity's direction
            missing=unknown,
        )
    up = accelerations / np.linalg.norm(accelerations, axis=1, keepdims=True)
    widths, axes = np.linalg.eigh(np.cov(up.T, bias=True))
    if widths[1] < NARROW**2:  # it stays, or moves along one line
        middle = up.mean(axis=0)
        turns = [across(middle)] if widths[2] < NARROW**2 else []
        turns.append(np.cross(middle, turns[0]) if turns else axes[:, 2])
        raise NotIdentifiable(
            "the orientations differ too little, so the mounting of the IMU and the weight cannot be told from the "
            f"biases. Add orientations turned by 30 degrees or more about {' and about '.join(map(named, turns))} of "
            "the IMU.",
            rank=7 if widths[2] < NARROW**2 else 14,
            missing=unknown,
        )
    widths, axes = np.linalg.eigh(up.T @ up / len(up))
    if widths[0] < NARROW**2:
        axis = named(axes[:, 0] * np.sign(axes[np.abs(axes[:, 0]).argmax(), 0]))
        raise NotIdentifiable(
            f"every orientation turns about {axis} of the IMU, which stays level: the bias of the IMU along it cannot "
            f"be told from its mounting and the force bias. Add orientations in which {axis} points up or down by 30 "
            "degrees or more.",
            rank=15,
            missing=("force_bias", "rotation of the IMU", f"bias of the IMU along {axis}"),
        )


def fit(
    readings: Float[np.ndarray, "n 9"],
    magnitude: float,
    of: str,
    *,
    robust: bool = True,
    deviations: Float[np.ndarray, "9"] | None = None,
) -> ImuFit:
    """Fit the wrenches and accelerations of rests.

    Args:
        readings: (n, 9) [N, N m, m/s^2].
        magnitude: |g| [m/s^2].
        of: name of a row in messages.
        robust: begin with a Huber fit, and set rests aside that lie beyond `CUTOFF` robust deviations.
        deviations: (9,) of the readings; None: from the residuals.

    Raises:
        NotIdentifiable: the orientations do not determine the parameters, or the weight is lost in the residuals.
    """
    require_spread(readings[:, 6:], of)
    now = _first(readings, magnitude)
    for _ in range(HUBER_ROUNDS if robust else 0):
        residuals, spread = _spread(now, readings, magnitude)
        far = (np.abs(residuals) / spread).max(axis=1)
        now = replace(now, deviations=spread)
        now = _stepped(now, readings, magnitude, np.minimum(1.0, HUBER / np.maximum(far, 1e-12)))[0]
    for _ in range(10):
        before = now.kept
        if robust:
            residuals, spread = _spread(now, readings, magnitude)
            now = replace(now, kept=np.asarray(np.all(np.abs(residuals) <= CUTOFF * spread, axis=1), dtype=bool))
        if now.information.any() and np.array_equal(now.kept, before):
            break
        require_spread(readings[now.kept, 6:], of)
        now = _converged(now, readings, magnitude, deviations)
    error = float(np.sqrt(now.covariance[0, 0]))
    if not error <= MAX_SHARE * now.weight:
        raise NotIdentifiable(
            f"a weight of {now.weight:.2g} N cannot be told from the force bias with these orientations and residuals "
            f"(its standard error is {error:.2g} N). Turn further, or average more samples; if the sensor carries "
            "nothing, or its driver compensates for gravity already, use a payload without weight (a tare).",
            rank=0,
            missing=("weight", "force_bias", "center_of_mass"),
        )
    return now


def left_out(found: ImuFit, readings: Float[np.ndarray, "n 9"], magnitude: float, of: str) -> Validation:
    """Return how well the fit to the other rests predicts each quarter of them, as a `Validation`."""
    used = readings[found.kept]

    def predict(left: Bool[np.ndarray, " n"]) -> tuple[np.ndarray, np.ndarray]:  # of the normal equations
        part = fit(used[~left], magnitude, of, robust=False, deviations=found.deviations)
        up = (used[left, 6:] - part.rest[9:]) @ part.turn
        there = replace(part, up=up / np.linalg.norm(up, axis=1, keepdims=True))
        for _ in range(OWN_ROUNDS):
            there = _stepped(there, used[left], magnitude, None)[0]
        slopes, residuals, _ = _linear(there, used[left], magnitude)
        expected = np.einsum("nip,niq->pq", slopes, slopes)
        return np.einsum("nip,ni->p", slopes, residuals), expected + expected @ part.covariance @ expected

    return cross_validate(len(used), predict)


def _first(readings: np.ndarray, magnitude: float) -> ImuFit:
    """Return a first fit: F = d - (W / |g|) Q^T a is a similarity [Umeyama 1991], and the torque is linear then."""
    force, torque, felt = (readings[:, kind] for kind in KINDS)
    away, pulled = felt - felt.mean(axis=0), force.mean(axis=0) - force
    left, size, right = np.linalg.svd(away.T @ pulled)
    proper = np.array([1.0, 1.0, np.linalg.det(left @ right)])
    turn = left @ np.diag(proper) @ right
    weight = magnitude * max(float(proper @ size) / float((away**2).sum()), 1e-9)
    up = felt @ turn / np.linalg.norm(felt, axis=1, keepdims=True)
    levers = np.concatenate([weight * skew(up), np.broadcast_to(np.eye(3), (len(up), 3, 3))], axis=2)
    lever = _least_squares(levers.reshape(-1, 6), torque.ravel())
    rest = np.concatenate([(force + weight * up).mean(axis=0), lever, np.zeros(3)])
    made = ImuFit(weight, turn, rest, up, np.ones(9), np.ones(len(up), dtype=bool), np.zeros((16, 16)))
    squares = (made.residuals(readings, magnitude) ** 2).mean(axis=0)
    return replace(made, deviations=_alike(squares + _floor(readings) ** 2))


def _converged(now: ImuFit, readings: np.ndarray, magnitude: float, deviations: np.ndarray | None) -> ImuFit:
    """Return the least squares of the rests that are kept, with deviations from their residuals where not stated."""
    for _ in range(ROUNDS):
        before = now if deviations is None else replace(now, deviations=deviations)
        now, step = _stepped(before, readings, magnitude, now.kept.astype(np.float64))
        slopes, residuals, projectors = (each[now.kept] for each in _linear(now, readings, magnitude))
        now = replace(now, information=np.einsum("nip,niq->pq", slopes, slopes))
        if deviations is None:  # each kind's squares over its redundancy [Foerstner 1979]
            used = np.einsum("nip,pq,niq->i", slopes, now.covariance, slopes)
            free = np.diagonal(projectors, axis1=1, axis2=2).sum(axis=0) - used
            squares = ((residuals * now.deviations) ** 2).sum(axis=0)
            ratios = np.concatenate([np.full(3, squares[k].sum() / max(free[k].sum(), 1e-3)) for k in KINDS])
            now = replace(now, deviations=np.sqrt(np.maximum(ratios, _floor(readings) ** 2)))
        if np.abs(step).max() < 1e-3 and np.allclose(now.deviations, before.deviations, rtol=1e-3):
            break
    slopes = _linear(now, readings, magnitude)[0][now.kept]
    return replace(now, information=np.einsum("nip,niq->pq", slopes, slopes))


def _stepped(
    now: ImuFit, readings: np.ndarray, magnitude: float, weights: Float[np.ndarray, " n"] | None
) -> tuple[ImuFit, Float[np.ndarray, "16"]]:
    """Return the fit after a Gauss-Newton step, and the step in standard deviations; without weights only u moves."""
    jacobian, own, residuals = _jacobians(now, readings, magnitude)
    inverse, step, size = _inverse(own), np.zeros(16), np.zeros(16)
    if weights is not None:
        without = (np.eye(9) - own @ inverse) * np.sqrt(weights)[:, None, None]
        matrix = (without @ jacobian).reshape(-1, 16)
        size = np.linalg.norm(matrix, axis=0)
        step = _least_squares(matrix / size, (without @ residuals[..., None]).ravel()) / size
    moved = inverse @ (residuals - jacobian @ step)[..., None]
    up = now.up + (_tangents(now.up) @ moved)[..., 0]
    rest, turned = now.rest + np.delete(step, [0, 10, 11, 12]), Pose.from_rotation_vector(step[10:13], np.zeros(3))
    up = up / np.linalg.norm(up, axis=1, keepdims=True)
    return replace(now, weight=now.weight - step[0], rest=rest, turn=now.turn @ turned.rotation, up=up), step * size


def _linear(now: ImuFit, readings: np.ndarray, magnitude: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return whitened slopes (n, 9, 16), residuals (n, 9) and projectors (n, 9, 9), all without what u explains."""
    jacobian, own, residuals = _jacobians(now, readings, magnitude)
    projectors = np.eye(9) - own @ _inverse(own)
    return projectors @ jacobian, (projectors @ residuals[..., None])[..., 0], projectors


def _jacobians(now: ImuFit, readings: np.ndarray, magnitude: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return whitened derivatives by the parameters (n, 9, 16) and by u's tangents (n, 9, 2), and residuals (n, 9)."""
    count, lever = len(now.up), skew(now.rest[3:6])
    jacobian, own = np.zeros((count, 9, 16)), np.zeros((count, 9, 3))
    jacobian[:, :3, 0], jacobian[:, 3:6, 0] = now.up, now.up @ lever.T
    jacobian[:, :3, 1:4] = jacobian[:, 3:6, 7:10] = jacobian[:, 6:, 13:] = np.eye(3)
    jacobian[:, 3:6, 4:7] = now.weight * skew(now.up)
    jacobian[:, 6:, 10:13] = -magnitude * now.turn @ skew(now.up)
    own[:, :3], own[:, 3:6], own[:, 6:] = -now.weight * np.eye(3), -now.weight * lever, magnitude * now.turn
    scale = now.deviations[:, None]
    return jacobian / scale, own @ _tangents(now.up) / scale, now.residuals(readings, magnitude) / now.deviations


def _least_squares(matrix: np.ndarray, target: np.ndarray) -> np.ndarray:
    return np.linalg.lstsq(matrix, target, rcond=None)[0]


def _inverse(own: Float[np.ndarray, "n 9 2"]) -> Float[np.ndarray, "n 2 9"]:
    """Return the pseudo-inverse of each matrix."""
    return np.linalg.solve(own.swapaxes(1, 2) @ own, own.swapaxes(1, 2))


def _tangents(up: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3 2"]:
    """Return two unit vectors across each row, as columns."""
    first = np.cross(up, np.eye(3)[np.abs(up).argmin(axis=1)])
    first = first / np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(up, first)], axis=2)


def _alike(squares: Float[np.ndarray, "9"]) -> Float[np.ndarray, "9"]:
    """Return roots (9,) of the means of squares within each kind."""
    return np.repeat(np.sqrt(squares.reshape(3, 3).mean(axis=1)), 3)


def _spread(now: ImuFit, readings: np.ndarray, magnitude: float) -> tuple[np.ndarray, Float[np.ndarray, "9"]]:
    """Return residuals (n, 9) and robust standard deviations (9,) of the errors, of which the fit explains a part."""
    residuals, count = now.residuals(readings, magnitude), len(readings)
    explained = np.sqrt(9 * count / (7 * count - 16))
    return residuals, explained * _alike(robust_spread(residuals, _floor(readings)) ** 2)


def _floor(readings: Float[np.ndarray, "n 9"]) -> Float[np.ndarray, "9"]:
    """Return (9,) the residuals below which none is an error: rounding."""
    return ROUNDING * np.repeat(np.abs(readings).reshape(-1, 3, 3).max(axis=(0, 2)) + 1e-3, 3)
