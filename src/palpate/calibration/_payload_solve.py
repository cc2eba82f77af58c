"""One identification under one reading of the data: robust, two-stage or jointly whitened, with its covariance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from palpate.calibration._payload_fit import covariance, kept_samples, model, residual_covariance, two_stage
from palpate.calibration._payload_rank import check_poses
from palpate.errors import NotIdentifiable
from palpate.sensors.force_torque import Payload

__all__ = ["Settings", "Solution", "rms", "solve"]

BELIEVED = 2.0  # chi-square per degree of freedom up to which the stated noise is taken to explain the residuals


@dataclass(frozen=True)
class Settings:
    """What the caller chose, checked: gravity's unit direction or None, |g|, noise covariance or None, robust.

    `of` is what a row is called in messages.
    """

    direction: Float[np.ndarray, "3"] | None
    magnitude: float
    noise: Float[np.ndarray, "6 6"] | None
    robust: bool
    of: str = "samples"

    def basis(self) -> Float[np.ndarray, "12 p"]:
        """The free directions among the twelve parameters."""
        if self.direction is None:
            return np.eye(12)
        basis = np.zeros((12, 10))
        basis[:3, 0] = self.direction
        basis[3:, 1:] = np.eye(9)
        return basis

    def floor(self, wrenches: Float[np.ndarray, "n 6"]) -> Float[np.ndarray, "6"]:
        """Residuals below this are not worth doubting: the stated noise, at least rounding."""
        rounding = 1e-9 * np.repeat(np.abs(wrenches).reshape(-1, 2, 3).max(axis=(0, 2)) + 1e-3, 3)
        return rounding if self.noise is None else np.maximum(np.sqrt(np.diag(self.noise)), rounding)


@dataclass(frozen=True)
class Solution:
    """A payload, the standard deviation of a force [N], what is left of every sample, and which were used."""

    payload: Payload
    noise: float
    residuals: Float[np.ndarray, "n 6"]
    kept: Bool[np.ndarray, " n"]


def solve(wrenches: Float[np.ndarray, "n 6"], rotations: Float[np.ndarray, "n 3 3"], settings: Settings) -> Solution:
    """Fit wrenches in the sensor frame; see `identify_payload` for what is done and why.

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
    theta, cov, notes = _refined(theta, wrenches[kept], rotations[kept], spread, settings)
    residuals = wrenches - model(theta, rotations)[0]
    payload = Payload(
        *theta.reshape(4, 3),
        covariance=basis @ cov @ basis.T,
        magnitude=settings.magnitude,
        residual=rms(residuals[kept]),
        samples=int(kept.sum()),
        notes=notes,
    )
    stated = 0.0 if settings.noise is None else float(np.trace(settings.noise[:3, :3]))
    return Solution(payload, float(np.sqrt(max(np.trace(spread[:3, :3]), stated) / 3)), residuals, kept)


def rms(residuals: Float[np.ndarray, "n 6"]) -> Float[np.ndarray, "2"]:
    """Of force and torque, per axis."""
    return np.sqrt((residuals.reshape(-1, 2, 3) ** 2).mean(axis=(0, 2)))


def _check(rotations: np.ndarray, kept: np.ndarray, theta: np.ndarray, settings: Settings) -> None:
    try:
        check_poses(rotations[kept], settings.direction, theta[:3])
    except NotIdentifiable as refused:
        away = "" if kept.all() else f" ({int((~kept).sum())} {settings.of}, far from the rest, were set aside.)"
        raise NotIdentifiable(f"{refused}{away}", rank=refused.rank, missing=refused.missing) from None


def _refined(
    theta: np.ndarray, wrenches: np.ndarray, rotations: np.ndarray, spread: np.ndarray, settings: Settings
) -> tuple[Float[np.ndarray, "12"], Float[np.ndarray, "p p"], tuple[str, ...]]:
    """Jointly whitened by the stated noise where that explains the residuals, else as it is; and the covariance."""
    basis, noise = settings.basis(), settings.noise
    predicted, jacobian = model(theta, rotations)
    stages = covariance(jacobian @ basis, spread, joint=False)[0]
    if noise is None or np.linalg.cond(noise / np.sqrt(np.outer(np.diag(noise), np.diag(noise)))) > 1e12:
        return theta, stages, ()
    freedom = wrenches.size - basis.shape[1]
    excess = _chi_square(wrenches - predicted, noise) / freedom
    if excess > BELIEVED:
        note = (
            f"The residuals are {np.sqrt(excess):.1f} times the stated noise: the model, not the noise, limits this "
            "fit. Force and torque were fitted one after the other, and the covariance is from the residuals."
        )
        return theta, stages, (note,)
    for _ in range(8):  # bilinear in c and w, and it starts a few standard errors away
        gain = covariance(jacobian @ basis, noise, joint=True)[1]
        theta = theta + basis @ np.einsum("pni,ni->p", gain, wrenches - predicted)
        predicted, jacobian = model(theta, rotations)
    excess = _chi_square(wrenches - predicted, noise) / freedom
    if excess > 1.0 + 3.0 * np.sqrt(2.0 / freedom):  # more than chance makes: widen
        noise = noise * excess
    return theta, covariance(jacobian @ basis, noise, joint=True)[0], ()


def _chi_square(residuals: np.ndarray, noise: np.ndarray) -> float:
    return float((residuals * np.linalg.solve(noise, residuals.T).T).sum())
