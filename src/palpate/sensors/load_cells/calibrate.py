"""Load cells under a rigid frame, calibrated with a ball that a reference sensor and stages push over their surface."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool
from numpy.typing import ArrayLike

from palpate.calibration.validation import Validation
from palpate.calls import called_as
from palpate.errors import InputError
from palpate.sensors.load_cells._checks import check_channels, check_directions, check_response
from palpate.sensors.load_cells._coverage import CalibratedRegion, coverage
from palpate.sensors.load_cells._fit import Fit, ReferenceBlocks, fit, linear_start, touches, validated
from palpate.sensors.load_cells._log import BenchLog, Blocks, blocks_of, rest_noise, rests
from palpate.sensors.load_cells.model import LENGTH, LoadCells, require_layout, with_changes
from palpate.spatial.arguments import takes_arrays
from palpate.surfaces import Surface

__all__ = ["CalibrationOptions", "LoadCellCalibration", "identify_load_cells"]

BALL = 2e-3  # m: radius of the paper's ball, of 4 mm diameter
LEAST = 0.3  # N: lighter touches are left out
BEYOND = 5.0  # times the reference's noise that they must also be
NOWHERE = 5.0  # times its radius: a log that cannot be meant
PULLING = 0.3  # of the loaded blocks: a ball presses
UNEXPLAINED = 0.05, 50.0  # share of a reading, and noise of one, that no wrench explains: other cells than these
FARTHEST = 0.2  # of the ball's radius: how far off the surface its centre may say that it touches, before it is said


@takes_arrays
@dataclass(frozen=True, eq=False)
class CalibrationOptions:
    """What is known beside the log, and how it is fitted.

    Attributes:
        ball: its radius [m].
        positions: (k, 3) [m] of the cells as far as known, NaN else: checked, and kept.
        limits: (3 k, 2) range of each channel [V].
        noise: (3 k,) or (3 k, 3 k) of one reading; None: as the unloaded stretches show it.
        least: [N] lighter touches are left out.
        start: (6, 3 k) a map from voltages to wrenches to start from, beside the linear least squares; where it leads
            to a worse fit, it is not followed, and that is said.
        robust: what lies more than three deviations out counts less.
        names: of the channels, for messages.
        provenance: kept in the model.
    """

    ball: float = BALL
    positions: ArrayLike | None = None
    limits: ArrayLike | None = None
    noise: ArrayLike | None = None
    least: float = LEAST
    start: ArrayLike | None = None
    robust: bool = True
    names: tuple[str, ...] = ()
    provenance: Mapping[str, str] | None = None


_USUAL = CalibrationOptions()


@dataclass(frozen=True, eq=False)
class LoadCellCalibration:
    """The cells, and how well they explain the log they come from.

    Attributes:
        cells: the model.
        touches: the blocks of the log that were used, with the reference's force and contact.
        fit: what the model leaves of them.
        reference_noise: [N] of one reading of the reference, unloaded.
        coverage: what the log did not visit.
        validation: how touches lie that a fit had not seen.
    """

    cells: LoadCells
    touches: ReferenceBlocks
    fit: Fit
    reference_noise: float
    coverage: CalibratedRegion
    validation: Validation

    @property
    def notes(self) -> tuple[str, ...]:
        """What a user should know, one sentence each."""
        return self.cells.notes

    @property
    def rms(self) -> tuple[float, float, float]:
        """Root mean squares of force [N], position [m] and moment along the force [N m], as lengths."""
        square = np.mean(self.fit.residuals**2, axis=0)
        return float(np.sqrt(square[:3].sum())), float(np.sqrt(square[3:5].sum())), float(np.sqrt(square[5]))


@called_as('palpate.identify_load_cells(time, voltages, forces, centres, palpate.Mesh.load("tip.stl", unit="mm"))')
@takes_arrays
def identify_load_cells(
    time: ArrayLike,
    voltages: ArrayLike,
    forces: ArrayLike,
    centres: ArrayLike,
    surface: Surface,
    *,
    torques: ArrayLike | None = None,
    indentation: bool = False,
    options: CalibrationOptions = _USUAL,
) -> LoadCellCalibration:
    """C, its covariance and the noise, from voltages beside a reference force and the place of a ball [load cells, D].

    A global linear least squares, then the paper's nonlinear one on wrench and contact, with the moment along the
    force beside them (see `palpate.sensors.load_cells._fit`). The bias is taken in every unloaded stretch.
    Samples are averaged over blocks of 10 ms, and blocks counted as what their correlation leaves of them.

    Args:
        time: (n,) [s]; a gap begins a new run.
        voltages: (n, 3 k) [V], cell by cell.
        forces: (n, 3) [N] that the ball puts on the fingertip, in the surface's frame.
        centres: (n, 3) [m] of the ball's centre there; the contact is the point of the surface nearest to it.
        surface: that is touched, undeformed.
        torques: (n,) [N m] about the normal, if the reference knows one; None: none acts.
        indentation: fit the depth below the surface at which the force of the ball acts, as on a soft layer.
        options: what else is known.

    Raises:
        InputError: shapes; a log that does not begin unloaded; a channel that never moves, or of another unit.
        NotIdentifiable: directions of the wrench that the log does not hold, or that the cells cannot tell.
    """
    log, names = _complete(time, voltages, forces, centres, torques), options.names
    if options.positions is not None:
        require_layout(np.asarray(options.positions, dtype=np.float64))
    found = rests(log)
    seen, correlation, reference = rest_noise(log, found)
    stated = seen if options.noise is None else np.asarray(options.noise, dtype=np.float64)
    stated = np.diag(stated**2) if stated.ndim == 1 else stated
    names = names or tuple(f"u{cell + 1}{axis}" for cell in range(log.voltages.shape[1] // 3) for axis in "xyz")
    check_channels(log.voltages, found, seen, options.limits, names)
    blocks = blocks_of(log, found, max(options.least, BEYOND * reference))
    contact, normal, _ = surface.project(blocks.centres)
    doubts = _off_surface(blocks, contact, normal, options.ball)
    _require_pressing(blocks, normal)
    wrenches = np.concatenate([blocks.forces, np.cross(contact, blocks.forces) / LENGTH], axis=1)
    check_directions(wrenches, reference)
    lower = np.linalg.cholesky(stated)
    white = np.linalg.solve(lower, blocks.voltages.T).T
    check_response(white, wrenches)
    basis = np.linalg.eigh(white.T @ white)[1][:, :-7:-1]  # the six strongest directions
    data = touches(blocks, white @ basis, contact, normal)
    given = [] if options.start is None else [(np.asarray(options.start, np.float64) @ lower @ basis).reshape(-1)]
    resting = float(np.mean([rest.rows.stop - rest.rows.start for rest in found])) / correlation
    zeros = np.array([1.0] * 6 + [reference**2] * 3) / resting
    answer = fit(data, [*given, linear_start(data)], zeros, indented=indentation, robust=options.robust)
    left = validated(data, answer, zeros, robust=options.robust)
    answer = replace(answer, covariance=left.widening * answer.covariance)
    drift, misfit = _unexplained(white, basis, blocks, correlation)
    if misfit > UNEXPLAINED[0] or drift > UNEXPLAINED[1]:
        raise InputError(
            f"{misfit:.1%} of a reading and a zero that is off by {drift:.0f} times the noise are explained by no "
            "wrench: the cells do not read one body's load.",
            where="voltages",
            hint="Does each column stay the same cell and axis all along? Is each cell wired, and nothing loose?",
        )
    cells = LoadCells(
        lower @ basis @ answer.inverse,
        stated,
        limits=options.limits,
        positions=options.positions,
        indentation=answer.indentation,
        bias=np.mean([rest.voltage for rest in found], axis=0),
        samples=len(log.time),
        provenance=options.provenance,
    )
    errors = {"covariance": answer.relative_covariance, "drift": drift, "misfit": misfit, "correlation": correlation}
    cells = with_changes(cells, **errors)
    covered = coverage(data, cells)
    lost = ("The start that was given leads to a worse fit than the linear one, and was not followed.",)
    notes = (*doubts, *(lost if given and answer.followed == 1 else ()), *covered.notes, *left.notes)
    return LoadCellCalibration(with_changes(cells, notes=notes), data, answer, reference, covered, left)


def _complete(
    time: ArrayLike, voltages: ArrayLike, forces: ArrayLike, centres: ArrayLike, torques: ArrayLike | None
) -> BenchLog:
    """The log's complete rows as arrays of one length."""
    at, u, f, c = (np.asarray(part, dtype=np.float64) for part in (time, voltages, forces, centres))
    if u.ndim != 2 or u.shape[1] < 9 or u.shape[1] % 3:
        raise InputError(f"voltages must be (n, 3 k) of at least three cells, not {u.shape}")
    if at.shape != (len(u),) or f.shape != (len(u), 3) or c.shape != (len(u), 3):
        raise InputError(f"time, forces and centres must have a row for each of the {len(u)} voltages")
    t = np.zeros(len(u)) if torques is None else np.asarray(torques, dtype=np.float64)
    whole: Bool[np.ndarray, " n"] = np.all(np.isfinite(np.column_stack([at, u, f, c, t])), axis=1)
    if not whole.any():
        raise InputError("no row of the log is complete.", hint="Check the columns and the log's length.")
    return BenchLog(at[whole], u[whole], f[whole], c[whole], t[whole])


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


def _require_pressing(blocks: Blocks, normal: np.ndarray) -> None:
    """Raise an InputError where the reference's force points out of the surface."""
    pulling = np.count_nonzero(np.sum(blocks.forces * normal, axis=1) > 0) / len(normal)
    if pulling > PULLING:
        raise InputError(
            f"the reference's force points out of the surface in {pulling:.0%} of the loaded log.",
            where="ref_fx, ref_fy, ref_fz",
            hint="It is what the ball does to the fingertip, in the surface's frame: reverse its sign, or its axes.",
        )


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
    if middle > NOWHERE * ball or middle < -ball:  # no ball sinks in by its radius
        raise InputError(said, where="ref_x, ref_y, ref_z")
    return (said,)
