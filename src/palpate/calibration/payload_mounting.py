"""The payload where the sensor's own orientation on the robot is not known either."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from palpate.calibration._payload_fit import covariance, force_columns, model, residual_covariance
from palpate.calibration._payload_solve import Settings, rms, solve
from palpate.calibration.payload import left_out, settings_of, usable
from palpate.errors import NotIdentifiable
from palpate.sensors.force_torque import STANDARD_GRAVITY, Payload
from palpate.spatial.pose import skew

__all__ = ["MountedPayload", "identify_payload_and_mounting"]

DISTINCT = np.radians(2.0)  # minima closer than this are one
CLEAR = 3.0  # the second minimum must leave this many times more
MIN_SINGULAR = 0.02  # as for poses alone: orientations are only good to about a degree


@dataclass(frozen=True, eq=False)
class MountedPayload:
    """A payload, and the orientation of the sensor on what carries it.

    Attributes:
        payload: its covariance is the marginal of the one below: it carries the mounting's uncertainty.
        mounting: (3, 3), sensor in flange. `Payload.compensate` takes rotations_base_flange @ mounting.
        covariance: (15, 15) of the payload's twelve and of the mounting's rotation vector [rad], perturbed on the right
            (in the sensor frame): mounting exp(phi).
        minima: every orientation at which the fit cannot be improved by a small turn, the best first, with the rms of
        the
            force it leaves [N].
    """

    payload: Payload
    mounting: Float[np.ndarray, "3 3"]
    covariance: Float[np.ndarray, "15 15"]
    minima: tuple[tuple[Float[np.ndarray, "3 3"], float], ...]


def identify_payload_and_mounting(
    wrenches: ArrayLike,
    rotations: ArrayLike,
    *,
    gravity: ArrayLike | None = None,
    magnitude: float = STANDARD_GRAVITY,
    noise: ArrayLike | None = None,
    robust: bool = True,
    provenance: Mapping[str, str] | None = None,
) -> MountedPayload:
    """Payload and the sensor's orientation X on the flange: F = X^T R^T w + f0, bilinear in X and w.

    For X the rest is linear, and for the rest X is the rotation that turns one set of vectors into another: the two
    alternate from the 24 orientations of a cube, and least squares finishes each. Force alone decides X. Several minima
    may remain; all are reported, and a note says when the second explains the log almost as well.

    Args:
        wrenches: (n, 6) [N, N m] in the sensor frame.
        rotations: (n, 3, 3) of the flange in the base.
        gravity: as for `identify_payload`, as are the others.
        magnitude: |g| [m/s^2].
        noise: of one reading.
        robust: set samples aside that disagree with the best minimum.
        provenance: kept in the payload.

    Raises:
        NotIdentifiable: the poses cannot separate the parameters.
        InputError: shapes, or a row that is not a rotation.
    """
    settings = settings_of(gravity, magnitude, noise, robust=robust)
    used, turns, finite = usable(wrenches, rotations)
    minima = _minima(used[:, :3], turns, settings)
    solution = solve(used, turns @ minima[0][0], settings)
    if not solution.kept.all():  # once more without what disagrees
        used, turns = used[solution.kept], turns[solution.kept]
        minima = _minima(used[:, :3], turns, settings)
    exact = solve(used, turns @ minima[0][0], replace(settings, robust=False, noise=None))
    joint = _joint_covariance(exact.payload, exact.residuals, turns @ minima[0][0], settings)
    notes = (*left_out(finite, solution.kept), *solution.payload.notes, *_ambiguous(minima))
    payload = replace(
        exact.payload,
        covariance=joint[:12, :12],
        notes=notes,
        residual=rms(exact.residuals),
        provenance=provenance or {},
    )
    return MountedPayload(payload, minima[0][0], joint, tuple(minima))


def _minima(
    forces: Float[np.ndarray, "n 3"], rotations: Float[np.ndarray, "n 3 3"], settings: Settings
) -> list[tuple[np.ndarray, float]]:
    from scipy.spatial.transform import Rotation  # here: it takes 0.1 s to import

    found: list[tuple[np.ndarray, float, bool]] = []
    for start in Rotation.create_group("O").as_matrix():
        mounting = _alternated(forces, rotations, start, settings.direction)
        if any(_angle(mounting, other) < DISTINCT for other, _, _ in found):
            continue
        mounting, left = _finished(forces, rotations, mounting, settings.direction)
        if any(_angle(mounting, other) < DISTINCT for other, _, _ in found):
            continue
        weight = _linear(forces, rotations @ mounting, settings.direction)[0]
        pulls = settings.direction is None or float(weight @ settings.direction) > 0
        found.append((mounting, left, pulls))
    pulling = [(mounting, left) for mounting, left, pulls in found if pulls]  # with the given gravity, not against it
    return sorted(pulling or [(mounting, left) for mounting, left, _ in found], key=lambda minimum: minimum[1])


def _angle(one: np.ndarray, other: np.ndarray) -> float:
    return 2.0 * float(np.arcsin(min(1.0, float(np.linalg.norm(one - other)) / np.sqrt(8.0))))


def _alternated(
    forces: np.ndarray, rotations: np.ndarray, mounting: np.ndarray, direction: np.ndarray | None
) -> Float[np.ndarray, "3 3"]:
    """To the neighbourhood of a minimum: it converges from anywhere, but slowly at the end."""
    for _ in range(30):
        weight, bias, _ = _linear(forces, rotations @ mounting, direction)
        turned, target = rotations.swapaxes(1, 2) @ weight, forces - bias
        left, _, right = np.linalg.svd(turned.T @ target)  # the turn that maximises trace(X^T sum turned target^T)
        mounting = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    return mounting


def _finished(
    forces: np.ndarray, rotations: np.ndarray, mounting: np.ndarray, direction: np.ndarray | None
) -> tuple[Float[np.ndarray, "3 3"], float]:
    """Least squares in the mounting with the rest eliminated, and the rms that it leaves [N]."""
    from scipy.optimize import least_squares
    from scipy.spatial.transform import Rotation

    def residuals(turn: np.ndarray) -> np.ndarray:
        return _linear(forces, rotations @ (mounting @ Rotation.from_rotvec(turn).as_matrix()), direction)[2].ravel()

    result = least_squares(residuals, np.zeros(3), xtol=1e-12, ftol=1e-14, gtol=1e-12)
    return mounting @ Rotation.from_rotvec(result.x).as_matrix(), float(np.sqrt(np.mean(result.fun**2)))


def _linear(
    forces: np.ndarray, rotations: np.ndarray, direction: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Weight, force bias and what they leave, for a given mounting."""
    columns = force_columns(rotations, direction)
    matrix = columns.reshape(-1, columns.shape[-1])
    solution = np.linalg.lstsq(matrix, forces.ravel(), rcond=None)[0]
    weight = solution[:3] if direction is None else solution[0] * direction
    return weight, solution[-3:], forces - (matrix @ solution).reshape(-1, 3)


def _joint_covariance(
    payload: Payload, residuals: np.ndarray, rotations: np.ndarray, settings: Settings
) -> Float[np.ndarray, "15 15"]:
    """Of the twelve and the mounting: turning the sensor by phi turns the weight in it by u x phi."""
    theta = np.concatenate([payload.weight, payload.force_bias, payload.center_of_mass, payload.torque_bias])
    weight = rotations.swapaxes(1, 2) @ payload.weight
    basis = np.zeros((15, settings.basis().shape[1] + 3))
    basis[12:, :3] = np.eye(3)
    basis[:12, 3:] = settings.basis()
    turned = np.concatenate([skew(weight), skew(payload.center_of_mass) @ skew(weight)], axis=1)
    jacobian = np.concatenate([model(theta, rotations)[1], turned], axis=2) @ basis
    _check(jacobian[:, :3, :-6], float(np.linalg.norm(payload.weight)))
    spread = residual_covariance(residuals, basis.shape[1] - 6)
    return basis @ covariance(jacobian, spread, joint=False, torque_only=slice(-6, None))[0] @ basis.T


def _check(columns: Float[np.ndarray, "n 3 p"], weight: float) -> None:
    scaled = columns.copy()
    scaled[:, :, :3] /= weight  # the turn's columns are newtons a radian; the others have no unit
    values = np.linalg.svd(scaled.reshape(-1, scaled.shape[-1]), compute_uv=False) / np.sqrt(len(columns))
    if values[-1] <= MIN_SINGULAR:
        raise NotIdentifiable(
            "the poses cannot tell the sensor's mounting from the weight's direction and the force bias. Add poses "
            "turned by 30 degrees or more about two different axes of the flange, or state gravity's direction.",
            rank=int((values > MIN_SINGULAR).sum()),
            missing=("mounting", "weight", "force_bias"),
        )


def _ambiguous(minima: list[tuple[np.ndarray, float]]) -> tuple[str, ...]:
    if len(minima) < 2 or minima[1][1] > CLEAR * minima[0][1]:
        return ()
    return (
        f"A second mounting explains the log almost as well ({minima[1][1]:.2g} N against {minima[0][1]:.2g} N): look "
        "at both, or add poses turned about another axis.",
    )
