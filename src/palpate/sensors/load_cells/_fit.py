"""The least squares of a calibration of load cells: wrench and contact against a reference.

The wrench is w = B y, y = V' R^-1/2 (u - b) with V the six strongest whitened directions of the voltages. The residuals
of each block, with c the contact, n its normal, t two tangents and M_e = M - e x F the moment about e = c - d n, where
the force acts [load cells, (18), corrected], are force, position and moment along the force:

    r = ( F - F_ref,  t . (n x M_e) / (F . n),  F . M_e / |F|  )
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from palpate.calibration.validation import Validation, cross_validate
from palpate.contact.indentation import Indentation
from palpate.errors import NotIdentifiable
from palpate.sensors.load_cells._log import Blocks
from palpate.signals.correlation import correlation_time
from palpate.spatial.gauss_newton import damped, gauss_newton, huber
from palpate.spatial.pose import skew

__all__ = ["Fit", "ReferenceBlocks", "fit", "linear_start", "residuals", "touches"]

START = np.array([17e-3] * 3 + [100e-6] * 2 + [1e-4])  # N, m, N m: standard deviations before any residual is seen
# Rounds of whitening again by the residuals. More would not be better: where whitening and fit converge together, the
# determinant of the residuals' covariance is least, and a B that scatters less is preferred to one that is right.
ROUNDS = 2
OUTLYING = 3.0  # whitened residuals beyond which a component counts less (Huber)
LAW = np.array([0.0, 0.2]), np.array([2e-3, 1.2])  # bounds of depth [m] at 1 N, and exponent
LAW_START = np.array([2e-4, 0.5])
SAME = 1e-9  # of the cost: for a smaller gain, the first of two starts is used
LIGHTEST = 1e-3  # N: lower bound of the pressing force, for starts that lead to none


@dataclass(frozen=True, eq=False)
class ReferenceBlocks:
    """Blocks of a bench log with the reference's force and contact.

    Attributes:
        time: (n,) [s].
        run: (n,) number of the block's run.
        signal: (n, 6) y.
        force: (n, 3) [N].
        contact: (n, 3) [m] on the surface.
        normal: (n, 3) outward unit normals.
        tangents: (n, 2, 3) unit vectors.
        torque: (n,) [N m] about the normal.
    """

    time: Float[np.ndarray, " n"]
    run: Int[np.ndarray, " n"]
    signal: Float[np.ndarray, "n 6"]
    force: Float[np.ndarray, "n 3"]
    contact: Float[np.ndarray, "n 3"]
    normal: Float[np.ndarray, "n 3"]
    tangents: Float[np.ndarray, "n 2 3"]
    torque: Float[np.ndarray, " n"]

    def picked(self, rows: Bool[np.ndarray, " n"]) -> ReferenceBlocks:
        """Return the blocks of a mask (n,)."""
        return ReferenceBlocks(**{name: values[rows] for name, values in vars(self).items()})


@dataclass(frozen=True, eq=False)
class Fit:
    """A fitted B, the law of indentation if one was fitted, and the residuals.

    Attributes:
        unknowns: (p,) B row by row, then depth and exponent of the law, if fitted.
        covariance: (p, p) of the unknowns.
        residuals: (n, 6) of force [N], position along two tangents [m], moment along the force [N m].
        cost: half the sum of whitened squares.
        correlation: (6,) number of blocks that count as one independent block.
        followed: index of the start that was used.
    """

    unknowns: Float[np.ndarray, " p"]
    covariance: Float[np.ndarray, "p p"]
    residuals: Float[np.ndarray, "n 6"]
    cost: float
    correlation: Float[np.ndarray, "6"]
    followed: int

    @property
    def inverse(self) -> Float[np.ndarray, "6 6"]:
        """Inverse of B, (6, 6)."""
        return np.linalg.inv(_matrix(self.unknowns))

    @property
    def relative_covariance(self) -> Float[np.ndarray, "36 36"]:
        """Covariance (36, 36) of E = -dB B^-1: the true matrix is C (I + E)."""
        turn = np.kron(np.eye(6), self.inverse.T)
        covariance = turn @ self.covariance[:36, :36] @ turn.T
        return (covariance + covariance.T) / 2.0

    @property
    def indentation(self) -> Indentation | None:
        """Law of indentation; None if none was fitted."""
        law = map(float, self.unknowns[36:])
        return Indentation(*law, covariance=self.covariance[36:, 36:]) if len(self.unknowns) > 36 else None


def touches(
    blocks: Blocks,
    signal: Float[np.ndarray, "n 6"],
    contact: Float[np.ndarray, "n 3"],
    normal: Float[np.ndarray, "n 3"],
) -> ReferenceBlocks:
    """Return blocks with contact, normal and tangents, as `fit` takes them."""
    across = np.cross(normal, np.where(np.abs(normal[:, 1:2]) < 0.9, [[0.0, 1.0, 0.0]], [[1.0, 0.0, 0.0]]))
    first = across / np.linalg.norm(across, axis=1, keepdims=True)
    both = np.stack([first, np.cross(normal, first)], axis=1)
    return ReferenceBlocks(blocks.time, blocks.run, signal, blocks.forces, contact, normal, both, blocks.torques)


def linear_start(data: ReferenceBlocks) -> Float[np.ndarray, "36"]:
    """Return B (36,), row by row, by linear least squares on the reference's force and its moment about the contact."""
    frame = np.concatenate([data.tangents, data.normal[:, None]], axis=1)  # (n, 3, 3) rows t1, t2, n
    size = np.maximum(np.linalg.norm(data.force, axis=1), 1e-3)
    rows = np.zeros((len(frame), 6, 6))  # on w
    rows[:, :3, :3] = np.eye(3) / START[0]
    rows[:, 3:, :3] = -np.einsum("nab,nbc->nac", frame, skew(data.contact))  # frame . (c x F)
    rows[:, 3:, 3:] = frame
    rows[:, 3:5] /= (START[3] * size)[:, None, None]
    rows[:, 5] /= START[5]
    right = np.concatenate([data.force / START[0], np.zeros((len(rows), 2)), data.torque[:, None] / START[5]], axis=1)
    lawless = np.zeros((len(rows), 6, 0))
    return damped(_normal(rows, data.signal, lawless), _gradient(rows, data.signal, lawless, right))


def _matrix(unknowns: Float[np.ndarray, " p"]) -> Float[np.ndarray, "6 6"]:
    return unknowns[:36].reshape(6, 6)


def _normal(
    by_wrench: Float[np.ndarray, "n 6 6"], signal: Float[np.ndarray, "n 6"], by_law: Float[np.ndarray, "n 6 l"]
) -> Float[np.ndarray, "p p"]:
    """Return J' J for unknowns (B row by row, law): for B a sum of products (A' A) x (y y')."""
    count, laws = len(signal), by_law.shape[2]
    gram = np.swapaxes(by_wrench, 1, 2) @ by_wrench
    pairs = signal[:, :, None] * signal[:, None, :]
    both = np.einsum("na,nb->ab", gram.reshape(count, 36), pairs.reshape(count, 36))  # BLAS's threads take longer
    both = both.reshape(6, 6, 6, 6)
    out = np.empty((36 + laws, 36 + laws))
    out[:36, :36] = both.transpose(0, 2, 1, 3).reshape(36, 36)
    mixed = (np.swapaxes(by_law, 1, 2) @ by_wrench).transpose(1, 2, 0) @ signal  # (l, 6, 6)
    out[36:, :36] = mixed.reshape(laws, 36)
    out[:36, 36:] = out[36:, :36].T
    out[36:, 36:] = np.einsum("nra,nrb->ab", by_law, by_law)
    return out


def _gradient(
    by_wrench: Float[np.ndarray, "n 6 6"],
    signal: Float[np.ndarray, "n 6"],
    by_law: Float[np.ndarray, "n 6 l"],
    right: Float[np.ndarray, "n 6"],
) -> Float[np.ndarray, " p"]:
    """Return J' r for unknowns (B row by row, law)."""
    by_matrix = np.einsum("nra,nr->na", by_wrench, right).T @ signal
    return np.concatenate([by_matrix.reshape(36), np.einsum("nrl,nr->l", by_law, right)])


def fit(
    data: ReferenceBlocks,
    starts: Sequence[Float[np.ndarray, "36"]],
    zeros: Float[np.ndarray, "9"],
    *,
    indented: bool,
    robust: bool,
) -> Fit:
    """Return the nonlinear least squares `Fit` from the best of several starts, whitened again by its residuals.

    Args:
        data: blocks.
        starts: values of B, row by row.
        zeros: (9,) variances of the zero of y and of the reference force [N^2], the same in all blocks of a run.
        indented: fit the law of indentation too.
        robust: whether outliers count less, see `CalibrationOptions`.

    Raises:
        NotIdentifiable: the log does not determine the law of indentation.
    """
    law = LAW_START.copy() if indented else np.zeros(0)
    whitener = np.diag(1.0 / START)
    ends = [_solve(data, np.concatenate([start, law]), whitener, robust=robust) for start in starts]
    followed = int(np.argmin([cost * (1.0 + (k > 0) * SAME) for k, (_, cost) in enumerate(ends)]))
    found, cost = ends[followed]
    for _ in range(ROUNDS):
        whitener = _whitener(residuals(data, found)[0])
        found, cost = _solve(data, found, whitener, robust=robust)
    covariance, times = _covariance(data, found, whitener, zeros)
    return Fit(found, covariance, residuals(data, found)[0], cost, times, followed)


def _whitener(left: Float[np.ndarray, "n 6"]) -> Float[np.ndarray, "6 6"]:
    """Return the inverse Cholesky factor of the residuals' covariance about 0, with outliers clipped."""
    deviation = np.sqrt(np.median(left**2, axis=0) / 0.4549)  # the median of chi-square of one degree
    cut_off = np.clip(left, -OUTLYING * deviation, OUTLYING * deviation)
    covariance = cut_off.T @ cut_off / len(left) / 0.973  # what a normal keeps of its variance within 3
    return np.linalg.inv(np.linalg.cholesky(covariance + 1e-12 * np.diag(np.diag(covariance))))


def residuals(
    data: ReferenceBlocks, unknowns: Float[np.ndarray, " p"]
) -> tuple[Float[np.ndarray, "n 6"], Float[np.ndarray, "n 6 6"], Float[np.ndarray, "n 6 l"]]:
    """Return the residuals r (n, 6), and their derivatives by the wrench (n, 6, 6) and by the law (n, 6, l)."""
    law, normal = unknowns[36:], data.normal
    wrench = data.signal @ _matrix(unknowns).T
    force = wrench[:, :3]
    pressing = np.minimum(_dot(force, normal), -LIGHTEST)
    at = data.contact - (law[0] * (-pressing) ** law[1])[:, None] * normal if len(law) else data.contact
    about = wrench[:, 3:] - np.cross(at, force)
    size = np.maximum(np.linalg.norm(force, axis=1), LIGHTEST)
    unit = force / size[:, None]
    offset = np.einsum("nak,nk->na", data.tangents, np.cross(normal, about)) / pressing[:, None]
    ratio = pressing / size
    left = np.concatenate([force - data.force, offset, (_dot(unit, about) - data.torque * ratio)[:, None]], axis=1)
    turned = data.tangents @ skew(normal) / pressing[:, None, None]
    about_by, by_law = np.zeros((len(force), 3, 6)), np.zeros((len(force), 6, len(law)))
    about_by[:, :, :3], about_by[:, :, 3:] = -skew(at), np.eye(3)
    if len(law):
        across = np.cross(normal, force)  # what a depth adds to the moment
        rate = law[0] * law[1] * (-pressing) ** (law[1] - 1.0)
        about_by[:, :, :3] -= rate[:, None, None] * across[:, :, None] * normal[:, None, :]
        by_law[:, 3:5, 0] = (turned @ across[..., None])[..., 0] * ((-pressing) ** law[1])[:, None]
        by_law[:, 3:5, 1] = by_law[:, 3:5, 0] * (law[0] * np.log(-pressing))[:, None]
    by_wrench = np.zeros((len(force), 6, 6))
    by_wrench[:, :3, :3] = np.eye(3)
    by_wrench[:, 3:5] = turned @ about_by
    by_wrench[:, 3:5, :3] -= (offset / pressing[:, None])[:, :, None] * normal[:, None, :]
    by_wrench[:, 5] = (unit[:, None] @ about_by)[:, 0]
    by_wrench[:, 5, :3] += (about - unit * _dot(unit, about)[:, None]) / size[:, None]
    by_wrench[:, 5, :3] -= (data.torque / size)[:, None] * (normal - ratio[:, None] * unit)
    return left, by_wrench, by_law


def _solve(
    data: ReferenceBlocks, start: np.ndarray, whitener: Float[np.ndarray, "6 6"], *, robust: bool
) -> tuple[np.ndarray, float]:
    """Minimize a Huber cost, the law within its bounds; return unknowns and cost."""

    def look(found: np.ndarray) -> tuple[float, Callable[[], tuple[np.ndarray, np.ndarray]]]:
        left, slopes, law_slopes = _whitened(data, found, whitener)
        weight, cost = huber(np.abs(left), OUTLYING if robust else np.inf)

        def equations() -> tuple[np.ndarray, np.ndarray]:
            root = np.sqrt(weight)
            steep, law_steep = slopes * root[..., None], law_slopes * root[..., None]
            return _normal(steep, data.signal, law_steep), _gradient(steep, data.signal, law_steep, -left * root)

        return 0.5 * cost, equations

    def move(found: np.ndarray, step: np.ndarray) -> np.ndarray:
        low, high = (bound[: len(found) - 36] for bound in LAW)
        return np.concatenate([found[:36] + step[:36], np.clip(found[36:] + step[36:], low, high)])

    found = gauss_newton(start, look, move)
    return found.place, found.cost


def _whitened(
    data: ReferenceBlocks, found: np.ndarray, whitener: Float[np.ndarray, "6 6"]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    left, by_wrench, by_law = residuals(data, found)
    return left @ whitener.T, whitener @ by_wrench, whitener @ by_law


def _covariance(
    data: ReferenceBlocks, found: np.ndarray, whitener: Float[np.ndarray, "6 6"], zeros: Float[np.ndarray, "9"]
) -> tuple[Float[np.ndarray, "p p"], Float[np.ndarray, "6"]]:
    """Return the unknowns' covariance H^-1 (sum tau_c s_c^2 J_c' J_c + the part of the runs' zeros) H^-1, and tau."""
    white = _whitened(data, found, whitener)
    times = correlation_time(white[0])
    whole, _, meat = _equations(data, found, whitener, white, times * np.mean(white[0] ** 2, axis=0), zeros)
    size = np.sqrt(np.diag(whole))
    if not size.all():
        raise NotIdentifiable(
            "the log shows no depth below the surface at which the force acts, so the law of indentation is not "
            "determined. Write indentation = false in [load_cells], as for a rigid surface.",
            rank=int(np.count_nonzero(size)),
            missing=("indentation",),
        )
    bread = np.linalg.inv(whole / np.outer(size, size)) / np.outer(size, size)
    return bread @ meat @ bread, times


def _equations(
    data: ReferenceBlocks,
    found: np.ndarray,
    whitener: Float[np.ndarray, "6 6"],
    white: tuple[np.ndarray, np.ndarray, np.ndarray],
    variance: Float[np.ndarray, "6"],
    zeros: Float[np.ndarray, "9"],
) -> tuple[Float[np.ndarray, "p p"], Float[np.ndarray, " p"], Float[np.ndarray, "p p"]]:
    """Return J' J, J' r, and the covariance of J' r from the residuals' variance and the zeros of each run."""
    left, slopes, law_slopes = white
    scale = np.sqrt(variance)[:, None]
    meat = _normal(slopes * scale, data.signal, law_slopes * scale)
    for run in np.unique(data.run):
        rows = np.flatnonzero(data.run == run)
        pushed = np.concatenate([slopes[rows] @ _matrix(found), whitener[:, :3][None].repeat(len(rows), 0)], 2)
        joint = np.empty((len(found), 9))
        joint[:36] = np.einsum("nra,nrz,nc->acz", slopes[rows], pushed, data.signal[rows], optimize=True).reshape(36, 9)
        joint[36:] = np.einsum("nrl,nrz->lz", law_slopes[rows], pushed)
        meat += (joint * zeros) @ joint.T
    right = _gradient(slopes, data.signal, law_slopes, left)
    return _normal(slopes, data.signal, law_slopes), right, meat


def validated(data: ReferenceBlocks, found: Fit, zeros: Float[np.ndarray, "9"], *, robust: bool) -> Validation:
    """Return the cross-validation of a fit to all blocks, by J' r; `zeros` and `robust` are those of `fit`."""
    whitener = _whitener(found.residuals)
    variance = found.correlation * np.mean((found.residuals @ whitener.T) ** 2, axis=0)

    def predict(left: Bool[np.ndarray, " n"]) -> tuple[np.ndarray, np.ndarray]:
        rest, part = data.picked(~left), data.picked(left)
        unknowns, _ = _solve(rest, found.unknowns, whitener, robust=robust)
        known = _covariance(rest, unknowns, whitener, zeros)[0]
        white = _whitened(part, unknowns, whitener)
        own, error, spread = _equations(part, unknowns, whitener, white, variance, zeros)
        return error, spread + own @ known @ own

    return cross_validate(len(data.time), predict)


def _dot(a: np.ndarray, b: np.ndarray) -> Float[np.ndarray, " n"]:
    return np.einsum("nk,nk->n", a, b)
