"""Fit a payload to wrenches in the sensor frame: robust, two-stage or jointly whitened, with its covariance."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from palpate.calibration.validation import Validation, cross_validate
from palpate.errors import InputError, NotIdentifiable
from palpate.sensors.force_torque._payload_fit import (
    Errors,
    gain_of,
    kept_samples,
    model,
    residual_covariance,
    two_stage,
)
from palpate.sensors.force_torque._payload_rank import check_poses
from palpate.signals.payload import Payload

BELIEVED = 2.0  # chi-square per degree of freedom up to which the stated noise is taken to explain the residuals


@dataclass(frozen=True)
class PayloadSettings:
    """Settings of a payload identification.

    Attributes:
        direction: (3,) unit vector of gravity in the base; None: identified.
        magnitude: |g| [m/s^2].
        noise: (6, 6) covariance of one reading; None: not known.
        robust: whether outliers are set aside.
        of: name of a row in messages.

    Raises:
        InputError: the magnitude is not positive.
    """

    direction: Float[np.ndarray, "3"] | None
    magnitude: float
    noise: Float[np.ndarray, "6 6"] | None
    robust: bool
    of: str

    def __post_init__(self) -> None:
        if not (np.isfinite(self.magnitude) and self.magnitude > 0):
            raise InputError(f"magnitude of gravity must be positive, not {self.magnitude}.")

    def basis(self) -> Float[np.ndarray, "12 p"]:
        """Return a basis (12, p) of the free directions of the twelve parameters; p is 10 with gravity given."""
        if self.direction is None:
            return np.eye(12)
        basis = np.zeros((12, 10))
        basis[:3, 0] = self.direction
        basis[3:, 1:] = np.eye(9)
        return basis

    def floor(self, wrenches: Float[np.ndarray, "n 6"]) -> Float[np.ndarray, "6"]:
        """Return the residuals (6,) [N, N m] below which no sample is an outlier: the noise, at least rounding."""
        rounding = 1e-9 * np.repeat(np.abs(wrenches).reshape(-1, 2, 3).max(axis=(0, 2)) + 1e-3, 3)
        return rounding if self.noise is None else np.maximum(np.sqrt(np.diag(self.noise)), rounding)


@dataclass(frozen=True)
class PayloadSolution:
    """A fitted payload, with the covariance of the fit.

    Attributes:
        payload: the payload.
        noise: [N] standard deviation of a force.
        residuals: (n, 6) [N, N m] of every sample.
        kept: mask (n,) of the samples that were used.
        white: (6, 6) covariance of a sample's error.
        joint: whether the fit was whitened by `white`.
    """

    payload: Payload
    noise: float
    residuals: Float[np.ndarray, "n 6"]
    kept: Bool[np.ndarray, " n"]
    white: Float[np.ndarray, "6 6"]
    joint: bool


def solve(
    wrenches: Float[np.ndarray, "n 6"], rotations: Float[np.ndarray, "n 3 3"], settings: PayloadSettings
) -> PayloadSolution:
    """Fit a payload to wrenches in the sensor frame.

    Raises:
        NotIdentifiable: the poses do not determine the parameters.
    """
    direction, basis = settings.direction, settings.basis()
    kept = np.ones(len(wrenches), dtype=bool)
    theta = two_stage(wrenches, rotations, direction)
    _check(rotations, kept, theta, settings)
    if settings.robust:
        kept = kept_samples(wrenches, rotations, direction, settings.floor(wrenches))
        theta = two_stage(wrenches[kept], rotations[kept], direction)
        _check(rotations, kept, theta, settings)
    spread = residual_covariance((wrenches - model(theta, rotations)[0])[kept], basis.shape[1] - 6)
    theta, white, notes, joint = _refined(theta, wrenches[kept], rotations[kept], spread, settings)
    predicted, jacobian = model(theta, rotations)
    residuals = wrenches - predicted
    gain = gain_of(jacobian[kept] @ basis, white if joint else None)[0]
    payload = Payload(
        *theta.reshape(4, 3),
        covariance=basis @ Errors(white, np.zeros((2, 6)), np.zeros(0, dtype=np.int64)).spread(gain) @ basis.T,
        magnitude=settings.magnitude,
        residual=rms(residuals[kept]),
        samples=int(kept.sum()),
        notes=notes,
    )
    stated = 0.0 if settings.noise is None else float(np.trace(settings.noise[:3, :3]))
    deviation = float(np.sqrt(max(np.trace(spread[:3, :3]), stated) / 3))
    return PayloadSolution(payload, deviation, residuals, kept, white, joint)


def judged(
    solution: PayloadSolution,
    wrenches: Float[np.ndarray, "n 6"],
    rotations: Float[np.ndarray, "n 3 3"],
    settings: PayloadSettings,
) -> tuple[Payload, Validation]:
    """Return the payload, its covariance with the bias's drift and widened by a cross-validation, and the latter.

    Raises:
        NotIdentifiable: the poses do not determine the parameters.
    """
    kept, basis, payload = solution.kept, settings.basis(), solution.payload
    wrenches, rotations = wrenches[kept], rotations[kept]
    rounding = np.diag(replace(settings, noise=None).floor(wrenches) ** 2)
    errors = Errors.of(solution.residuals[kept], solution.white + rounding)
    noise = solution.white if solution.joint else None
    gain = gain_of(model(_parameters(payload), rotations)[1] @ basis, noise)[0]

    def predict(left: Bool[np.ndarray, " n"]) -> tuple[np.ndarray, np.ndarray]:  # of the normal equations, Z^T r
        part = solve(wrenches[~left], rotations[~left], replace(settings, robust=False)).payload
        predicted, jacobian = model(_parameters(part), rotations)
        jacobian = jacobian @ basis
        own, instruments = np.zeros((basis.shape[1], len(left), 6)), gain_of(jacobian, noise)[1][left]
        own[:, left] = np.moveaxis(instruments, -1, 0)
        slope = np.einsum("nip,niq->pq", instruments, jacobian[left])
        own[:, ~left] = -np.einsum("pq,qni->pni", slope, gain_of(jacobian[~left], noise)[0])
        return np.einsum("nip,ni->p", instruments, (wrenches - predicted)[left]), errors.spread(own)

    left = cross_validate(len(wrenches), predict)
    covariance = left.widening * (basis @ errors.spread(gain) @ basis.T)
    return replace(payload, covariance=covariance, notes=(*payload.notes, *errors.notes, *left.notes)), left


def _parameters(payload: Payload) -> Float[np.ndarray, "12"]:
    return np.concatenate([payload.weight, payload.force_bias, payload.center_of_mass, payload.torque_bias])


def rms(residuals: Float[np.ndarray, "n 6"]) -> Float[np.ndarray, "2"]:
    """Return the rms of residuals per axis, (2,), of force [N] and torque [N m]."""
    return np.sqrt((residuals.reshape(-1, 2, 3) ** 2).mean(axis=(0, 2)))


def _check(rotations: np.ndarray, kept: np.ndarray, theta: np.ndarray, settings: PayloadSettings) -> None:
    try:
        check_poses(rotations[kept], settings.direction, theta[:3])
    except NotIdentifiable as refused:
        away = "" if kept.all() else f" ({int((~kept).sum())} {settings.of}, far from the rest, were set aside.)"
        raise NotIdentifiable(f"{refused}{away}", rank=refused.rank, missing=refused.missing) from None


def _refined(
    theta: np.ndarray, wrenches: np.ndarray, rotations: np.ndarray, spread: np.ndarray, settings: PayloadSettings
) -> tuple[Float[np.ndarray, "12"], Float[np.ndarray, "6 6"], tuple[str, ...], bool]:
    """Return parameters, a sample's covariance, notes, and whether the stated noise explains and whitened them."""
    basis, noise = settings.basis(), settings.noise
    predicted, jacobian = model(theta, rotations)
    if noise is None or np.linalg.cond(noise / np.sqrt(np.outer(np.diag(noise), np.diag(noise)))) > 1e12:
        return theta, spread, (), False
    freedom = wrenches.size - basis.shape[1]
    excess = _chi_square(wrenches - predicted, noise) / freedom
    if excess > BELIEVED:
        note = (
            f"The residuals are {np.sqrt(excess):.1f} times the stated noise: the model, not the noise, limits this "
            "fit. Force and torque were fitted one after the other, and the covariance is from the residuals."
        )
        return theta, spread, (note,), False
    for _ in range(8):  # bilinear in c and w, and it starts a few standard errors away
        gain = gain_of(jacobian @ basis, noise)[0]
        theta = theta + basis @ np.einsum("pni,ni->p", gain, wrenches - predicted)
        predicted, jacobian = model(theta, rotations)
    excess = _chi_square(wrenches - predicted, noise) / freedom
    if excess > 1.0 + 3.0 * np.sqrt(2.0 / freedom):  # more than chance makes: widen
        noise = noise * excess
    return theta, noise, (), True


def _chi_square(residuals: np.ndarray, noise: np.ndarray) -> float:
    return float((residuals * np.linalg.solve(noise, residuals.T).T).sum())
