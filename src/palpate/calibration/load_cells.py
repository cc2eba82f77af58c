"""Load cells under a rigid frame, calibrated with a ball that a reference sensor and stages push over their surface."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float
from numpy.typing import ArrayLike

from palpate.calibration._load_cell_checks import check_channels, check_directions, check_response
from palpate.calibration._load_cell_coverage import Coverage, coverage
from palpate.calibration._load_cell_fit import Fit, Zeros, fit, linear_start, touches
from palpate.calibration._load_cell_log import Blocks, blocks_of, rest_noise, rests
from palpate.errors import InputError
from palpate.sensors.load_cells import LoadCells, require_layout, with_changes

__all__ = ["LoadCellCalibration", "Projecting", "identify_load_cells"]

BALL = 2e-3  # m: radius of the paper's ball, of 4 mm diameter
LEAST = 0.3  # N: lighter touches are left out
BEYOND = 5.0  # times the reference's noise that they must also be
FEWEST = 200  # blocks
NOWHERE = 5.0  # times its radius: a log that cannot be meant
FARTHEST = 0.2  # of the ball's radius: how far off the surface its centre may say that it touches, before it is said


@runtime_checkable
class Projecting(Protocol):
    """What the calibration needs of a surface; see `palpate.surfaces.Surface`."""

    def project(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Closest points, outward unit normals there, and facets."""
        ...


@dataclass(frozen=True, eq=False)
class LoadCellCalibration:
    """The cells, and how well they explain the log they come from.

    Attributes:
        cells: the model.
        time: (n,) [s] of each block of the log that was used.
        contact: (n, 3) [m] and force: (n, 3) [N], of the reference.
        residuals: (n, 6) estimate less reference: force [N], position along two tangents [m], moment along the force
            [N m].
        cost: of the fit, half the sum of whitened squares.
        correlation: (6,) blocks that tell as much as one independent block.
        reference_noise: [N] of one reading of the reference, unloaded.
        coverage: what the log did not visit.
        notes: what a user should know, one sentence each.
    """

    cells: LoadCells
    time: Float[np.ndarray, " n"]
    contact: Float[np.ndarray, "n 3"]
    force: Float[np.ndarray, "n 3"]
    residuals: Float[np.ndarray, "n 6"]
    cost: float
    correlation: Float[np.ndarray, "6"]
    reference_noise: float
    coverage: Coverage
    notes: tuple[str, ...]

    @property
    def rms(self) -> tuple[float, float, float]:
        """Root mean squares of force [N], position [m] and moment along the force [N m], as lengths."""
        square = np.mean(self.residuals**2, axis=0)
        return float(np.sqrt(square[:3].sum())), float(np.sqrt(square[3:5].sum())), float(np.sqrt(square[5]))


def identify_load_cells(
    time: ArrayLike,
    voltages: ArrayLike,
    forces: ArrayLike,
    centres: ArrayLike,
    surface: Projecting,
    *,
    ball: float = BALL,
    torques: ArrayLike | None = None,
    indentation: bool = False,
    positions: ArrayLike | None = None,
    limits: ArrayLike | None = None,
    noise: ArrayLike | None = None,
    least: float = LEAST,
    start: ArrayLike | None = None,
    robust: bool = True,
    names: tuple[str, ...] = (),
    provenance: Mapping[str, str] | None = None,
) -> LoadCellCalibration:
    """C, its covariance and the noise, from voltages beside a reference force and the place of a ball [load cells, D].

    A global linear least squares, then the paper's nonlinear one on wrench and contact, with the moment along the
    force beside them (see `palpate.calibration._load_cell_fit`). The bias is taken in every unloaded stretch.
    Samples are averaged over blocks of 10 ms, and blocks counted as what their correlation leaves of them.

    Args:
        time: (n,) [s]; a gap begins a new run.
        voltages: (n, 3 k) [V], cell by cell.
        forces: (n, 3) [N] that the ball puts on the fingertip, in the surface's frame.
        centres: (n, 3) [m] of the ball's centre there; the contact is the point of the surface nearest to it.
        surface: that is touched, undeformed.
        ball: its radius [m].
        torques: (n,) [N m] about the normal, if the reference knows one; None: none acts.
        indentation: fit the depth below the surface at which the force of the ball acts, as on a soft layer.
        positions: (k, 3) [m] of the cells as far as known, NaN else: checked, and kept.
        limits: (3 k, 2) range of each channel [V].
        noise: (3 k,) or (3 k, 3 k) of one reading; None: as the unloaded stretches show it.
        least: [N] lighter touches are left out.
        start: (6, 3 k) a map from voltages to wrenches to start from, beside the linear least squares; where it leads
            to a worse fit, it is not followed, and that is said.
        robust: what lies more than three deviations out counts less.
        names: of the channels, for messages.
        provenance: kept in the model.

    Raises:
        InputError: shapes; a log that does not begin unloaded; a channel that never moves, or of another unit.
        NotIdentifiable: directions of the wrench that the log does not hold, or that the cells cannot tell.
    """
    rows = _Rows.of(time, voltages, forces, centres, torques, positions, names)
    found = rests(rows.time, rows.voltages, rows.forces)
    seen, correlation, reference = rest_noise(found, rows.voltages, rows.forces)
    stated = seen if noise is None else np.asarray(noise, dtype=np.float64)
    stated = np.diag(stated**2) if stated.ndim == 1 else stated
    check_channels(rows.voltages, found, seen, limits, rows.names)
    least = max(least, BEYOND * reference)
    blocks = blocks_of(found, *rows.arrays, least)
    if len(blocks.time) < FEWEST:
        raise InputError(
            f"only {len(blocks.time)} blocks of 10 ms are loaded by {least:g} N or more, and {FEWEST} are needed.",
            hint="Slide the ball over the whole surface, with 1 N or more.",
        )
    contact, normal, _ = surface.project(blocks.centres)
    doubts = _off_surface(blocks, contact, normal, ball)
    check_directions(blocks.forces, contact, reference)
    lower, basis = _signal(blocks, stated)
    white = np.linalg.solve(lower, blocks.voltages.T).T
    check_response(white, blocks.forces, contact)
    y = white @ basis
    data = touches(blocks, y, contact, normal)
    starts = [] if start is None else [np.asarray(start, dtype=np.float64) @ lower @ basis]
    starts.append(linear_start(data, np.zeros(0)))
    resting = float(np.mean([rest.rows[1] - rest.rows[0] for rest in found])) / correlation
    zeros = Zeros(
        tuple(np.flatnonzero(blocks.run == run) for run in np.unique(blocks.run)),
        np.array([1.0] * 6 + [reference**2] * 3) / resting,
    )
    answer = fit(data, starts, zeros, indented=indentation, robust=robust)
    drift, misfit = _unexplained(white, basis, blocks, correlation)
    matrix = lower @ basis @ np.linalg.inv(answer.matrix)
    cells = LoadCells(
        matrix,
        stated,
        limits=limits,
        covariance=_relative(answer),
        positions=positions,
        indentation=answer.indentation,
        bias=np.mean([rest.voltage for rest in found], axis=0),
        drift=drift,
        misfit=misfit,
        correlation=correlation,
        samples=len(rows.time),
        provenance=provenance,
    )
    covered = coverage(data, cells)
    lost = ("The start that was given leads to a worse fit than the linear one, and was not followed.",)
    notes = (*doubts, *(lost if start is not None and answer.followed == 1 else ()), *covered.notes)
    return LoadCellCalibration(
        with_changes(cells, notes=notes),
        blocks.time,
        contact,
        blocks.forces,
        answer.residuals,
        answer.cost,
        answer.correlation,
        reference,
        covered,
        notes,
    )


@dataclass(frozen=True, eq=False)
class _Rows:
    """The log as arrays of one length."""

    time: np.ndarray
    voltages: np.ndarray
    forces: np.ndarray
    centres: np.ndarray
    torques: np.ndarray
    names: tuple[str, ...]

    @classmethod
    def of(
        cls,
        time: ArrayLike,
        voltages: ArrayLike,
        forces: ArrayLike,
        centres: ArrayLike,
        torques: ArrayLike | None,
        positions: ArrayLike | None,
        names: tuple[str, ...],
    ) -> _Rows:
        at, u, f, c = (np.asarray(part, dtype=np.float64) for part in (time, voltages, forces, centres))
        if u.ndim != 2 or u.shape[1] < 9 or u.shape[1] % 3:
            raise InputError(f"voltages must be (n, 3 k) of at least three cells, not {u.shape}")
        if at.shape != (len(u),) or f.shape != (len(u), 3) or c.shape != (len(u), 3):
            raise InputError(f"time, forces and centres must have a row for each of the {len(u)} voltages")
        if positions is not None:
            require_layout(np.asarray(positions, dtype=np.float64))
        t = np.zeros(len(u)) if torques is None else np.asarray(torques, dtype=np.float64)
        named = names or tuple(f"u{cell + 1}{axis}" for cell in range(u.shape[1] // 3) for axis in "xyz")
        whole: Bool[np.ndarray, " n"] = np.all(np.isfinite(np.column_stack([at, u, f, c, t])), axis=1)
        if not whole.any():
            raise InputError("no row of the log is complete.", hint="Check the columns and the log's length.")
        return cls(at[whole], u[whole], f[whole], c[whole], t[whole], named)

    @property
    def arrays(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        return self.time, self.voltages, self.forces, self.centres, self.torques


def _signal(
    blocks: Blocks, noise: Float[np.ndarray, "m m"]
) -> tuple[Float[np.ndarray, "m m"], Float[np.ndarray, "m 6"]]:
    """Cholesky factor of the noise, and the six strongest directions of the whitened voltages."""
    lower = np.linalg.cholesky(noise)
    white = np.linalg.solve(lower, blocks.voltages.T)
    _, vectors = np.linalg.eigh(white @ white.T)
    return lower, vectors[:, :-7:-1]


def _unexplained(white: np.ndarray, basis: np.ndarray, blocks: Blocks, correlation: float) -> tuple[float, float]:
    """Drift and misfit of `LoadCells`: squares across the six directions beyond the noise that a block has left.

    A channel's square is noise/samples + drift^2 + misfit^2 |along|^2 / (m - 6). The drift is that of the worst run:
    others will be as bad.
    """
    from scipy.optimize import nnls

    size = np.sum((white @ basis) ** 2, axis=1)
    spare = white.shape[1] - 6
    across = (np.sum(white**2, axis=1) - size) / spare - correlation / max(correlation, blocks.size)
    loads = np.column_stack([np.ones(len(size)), size / spare])
    found, _ = nnls(loads, across)
    drifted = across - found[1] * loads[:, 1]
    worst = max(float(drifted[blocks.run == run].mean()) for run in np.unique(blocks.run))
    return float(np.sqrt(max(0.0, worst))), float(np.sqrt(found[1]))


def _relative(answer: Fit) -> Float[np.ndarray, "36 36"]:
    """Covariance of E = -dB B^-1: the true matrix is C (I + E)."""
    turn = np.kron(np.eye(6), np.linalg.inv(answer.matrix).T)
    covariance = turn @ answer.covariance[:36, :36] @ turn.T
    return (covariance + covariance.T) / 2.0


def _off_surface(blocks: Blocks, contact: np.ndarray, normal: np.ndarray, ball: float) -> tuple[str, ...]:
    """A doubt where the ball's centre is not its radius, less some indentation, off the surface."""
    height = np.einsum("nk,nk->n", blocks.centres - contact, normal)
    middle = float(np.median(height))
    if -FARTHEST * ball <= middle <= (1 + FARTHEST) * ball:
        return ()
    said = (
        f"the ball's centre lies {1e3 * middle:.2f} mm off the surface on average, and its radius is {1e3 * ball:.2g} "
        "mm: ref_x, ref_y, ref_z are the ball's centre, in metres, in the surface's frame."
    )
    if abs(middle) > NOWHERE * ball:
        raise InputError(said, where="ref_x, ref_y, ref_z")
    return (said,)
