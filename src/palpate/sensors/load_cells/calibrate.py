"""Calibrate load cells under a rigid frame with a ball that slides over their surface, and a reference sensor."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float
from numpy.typing import ArrayLike

from palpate.calibration.validation import Validation
from palpate.calls import called_as
from palpate.errors import InputError
from palpate.sensors.load_cells._coverage import CalibratedRegion, coverage
from palpate.sensors.load_cells._fit import Fit, ReferenceBlocks, fit, linear_start, touches, validated
from palpate.sensors.load_cells._log import BenchLog, Blocks, UnloadedStretch, blocks_of, rest_noise, rests
from palpate.sensors.load_cells.model import LENGTH, LoadCells, require_directions, require_layout, with_changes
from palpate.spatial._arrays import require_complete
from palpate.spatial.arguments import frozen_value, takes_arrays
from palpate.surfaces import Surface

BALL = 2e-3  # m: radius of the paper's ball, of 4 mm diameter
LEAST = 0.3  # N: lighter touches are omitted
BEYOND = 5.0  # times the reference's noise: lighter touches are omitted too
NOWHERE = 5.0  # times the ball's radius: a centre farther off the surface is an error
PULLING = 0.3  # of the loaded blocks: a ball presses
UNEXPLAINED = 0.05, 50.0  # share of a reading, and times its noise, that no wrench explains: other cells than these
FARTHEST = 0.2  # of the ball's radius: distance between ball and surface, or depth, above which a note is given
ODD = 100.0  # times the others: gains of cells do not differ so much, prefixes of units do
LEAST_PUSH, AS_NOISE = 0.01, 1.5  # N, rms along a direction of the wrench, and times the reference's noise
LEAST_ANSWER = 5.0  # times the noise of a reading, for 1 N or 10 N mm: less is no response
AT_RANGE = 0.001  # share of samples at a limit that is too much


@frozen_value
class CalibrationOptions:
    """Settings of a calibration of load cells, and facts that are not in the log.

    Attributes:
        ball: [m] radius of the ball.
        positions: (k, 3) [m] of the cells, NaN where not known; None: all.
        limits: (3 k, 2) [V] range of each channel; None: not known.
        noise: (3 k,) standard deviations [V] or (3 k, 3 k) covariance [V^2] of one reading; None: estimated from the
            unloaded stretches.
        least: [N] lighter touches are omitted.
        start: (6, 3 k) map from voltages to wrenches, a start in addition to the linear one; None: no other. A note
            states if it leads to a worse fit and is not used.
        robust: whether residuals beyond three standard deviations count less.
        names: names of the channels, for messages.
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
    """Calibrated load cells, and how well they explain their log.

    Attributes:
        cells: the model, with notes.
        touches: blocks of the log that were used, with the reference's force and contact.
        fit: the fit to `touches`.
        reference_noise: [N] standard deviation of one unloaded reading of the reference.
        coverage: parts of the surface and directions of force that the log contains.
        validation: errors of touches that a fit had not seen, over those expected.
    """

    cells: LoadCells
    touches: ReferenceBlocks
    fit: Fit
    reference_noise: float
    coverage: CalibratedRegion
    validation: Validation

    @property
    def rms(self) -> tuple[float, float, float]:
        """Root mean square lengths of the residuals: force [N], position [m] and moment along the force [N m]."""
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
    """Identify C, its covariance and the noise from voltages, a reference force and a ball's position [load cells, D].

    A linear least squares, then the paper's nonlinear one on wrench and contact, with the moment along the force in
    addition. The bias is taken in every unloaded stretch.

    Args:
        time: (n,) [s]; a gap begins a new run. Rows with a number that is not finite are omitted.
        voltages: (n, 3 k) [V], cell by cell.
        forces: (n, 3) [N] of the ball on the fingertip, in the surface's frame.
        centres: (n, 3) [m] of the ball's centre there; the contact is the point of the surface nearest to it.
        surface: touched surface, undeformed.
        torques: (n,) [N m] about the normal, if the reference measures it; None: none acts.
        indentation: fit the depth below the surface at which the force of the ball acts, as on a soft layer.
        options: other settings and known facts.

    Returns:
        A `LoadCellCalibration`; C is the `matrix` of its `cells`.

    Raises:
        InputError: a shape is wrong, the log does not begin unloaded or has too few touches, a channel never moves, is
            at its range or has another unit, the ball is far off or does not press, or no wrench explains the readings.
        NotIdentifiable: the log lacks a direction of the wrench or an indentation, or the cells do not measure one.
    """
    log, names = _complete(time, voltages, forces, centres, torques), options.names
    if options.positions is not None:
        require_layout(np.asarray(options.positions, dtype=np.float64))
    found = rests(log)
    seen, correlation, reference = rest_noise(log, found)
    stated = seen if options.noise is None else np.asarray(options.noise, dtype=np.float64)
    stated = np.diag(stated**2) if stated.ndim == 1 else stated
    names = names or tuple(f"u{cell + 1}{axis}" for cell in range(log.voltages.shape[1] // 3) for axis in "xyz")
    _check_channels(log.voltages, found, seen, options.limits, names)
    blocks = blocks_of(log, found, max(options.least, BEYOND * reference))
    contact, normal, _ = surface.project(blocks.centres)
    doubts = _off_surface(blocks, contact, normal, options.ball)
    _require_pressing(blocks, normal)
    wrenches = np.concatenate([blocks.forces, np.cross(contact, blocks.forces) / LENGTH], axis=1)
    _check_directions(wrenches, reference)
    lower = np.linalg.cholesky(stated)
    white = np.linalg.solve(lower, blocks.voltages.T).T
    _check_response(white, wrenches)
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
            f"the cells do not measure the load of one body: no wrench explains {misfit:.1%} of a reading and a drift "
            f"of {drift:.0f} times the noise.",
            where="voltages",
            hint="Check that each column is the same cell and axis throughout, that all cells are wired, and that "
            "nothing is loose.",
        )
    cells = LoadCells(
        lower @ basis @ answer.inverse,
        stated,
        limits=options.limits,
        covariance=answer.relative_covariance,
        positions=options.positions,
        indentation=answer.indentation,
        bias=np.mean([rest.voltage for rest in found], axis=0),
        drift=drift,
        misfit=misfit,
        correlation=correlation,
        samples=len(log.time),
        provenance=options.provenance,
    )
    covered = coverage(data, cells)
    lost = ("The start that was given leads to a worse fit than the linear start, and was not used.",)
    notes = (*doubts, *(lost if given and answer.followed == 1 else ()), *covered.notes, *left.notes)
    return LoadCellCalibration(with_changes(cells, notes=notes), data, answer, reference, covered, left)


def _complete(
    time: ArrayLike, voltages: ArrayLike, forces: ArrayLike, centres: ArrayLike, torques: ArrayLike | None
) -> BenchLog:
    at, u, f, c = (np.asarray(part, dtype=np.float64) for part in (time, voltages, forces, centres))
    if u.ndim != 2 or u.shape[1] < 9 or u.shape[1] % 3:
        raise InputError(f"voltages must be (n, 3 k) of at least three cells, not {u.shape}.")
    if at.shape != (len(u),) or f.shape != (len(u), 3) or c.shape != (len(u), 3):
        raise InputError(f"time, forces and centres must have a row for each of the {len(u)} voltages.")
    t = np.zeros(len(u)) if torques is None else np.asarray(torques, dtype=np.float64)
    complete: Bool[np.ndarray, " n"] = np.all(np.isfinite(np.column_stack([at, u, f, c, t])), axis=1)
    require_complete(complete)
    return BenchLog(*(each[complete] for each in (at, u, f, c, t)))


def _unexplained(white: np.ndarray, basis: np.ndarray, blocks: Blocks, correlation: float) -> tuple[float, float]:
    """Return drift and misfit of `LoadCells`, from readings across the six directions of the wrench.

    A channel's square is noise/samples + drift^2 + misfit^2 |along|^2 / (m - 6). The drift is that of the worst run.
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
    pulling = np.count_nonzero(np.sum(blocks.forces * normal, axis=1) > 0) / len(normal)
    if pulling > PULLING:
        raise InputError(
            f"the reference's force points out of the surface in {pulling:.0%} of the loaded log.",
            where="ref_fx, ref_fy, ref_fz",
            hint="Reverse its sign or axes: it is the force of the ball on the fingertip, in the surface's frame.",
        )


def _off_surface(blocks: Blocks, contact: np.ndarray, normal: np.ndarray, ball: float) -> tuple[str, ...]:
    """Return a note if the ball's centre is not its radius, less some indentation, off the surface; else ()."""
    height = np.einsum("nk,nk->n", blocks.centres - contact, normal)
    middle = float(np.median(height))
    if -FARTHEST * ball <= middle <= (1 + FARTHEST) * ball:
        return ()
    said = (
        f"the ball's centre is {1e3 * middle:.2f} mm off the surface on average, and its radius is {1e3 * ball:.2g} "
        "mm: ref_x, ref_y, ref_z must be the ball's centre, in metres, in the surface's frame."
    )
    if middle > NOWHERE * ball or middle < -ball:  # no ball sinks in by its radius
        raise InputError(said, where="ref_x, ref_y, ref_z")
    return (said,)


def _check_channels(
    voltages: Float[np.ndarray, "n m"],
    found: list[UnloadedStretch],
    noise: Float[np.ndarray, "m m"],
    limits: ArrayLike | None,
    names: tuple[str, ...],
) -> None:
    if still := [name for name, span in zip(names, np.ptp(voltages, axis=0), strict=True) if span == 0]:
        raise InputError(
            f"{_listed(still)} never changes: the cell is dead, or not connected.",
            hint="Repair it, or leave the three columns of that cell out of [load_cells] columns.",
        )
    if limits is not None:
        low, high = np.asarray(limits, dtype=np.float64).T
        share = np.mean((voltages <= low) | (voltages >= high), axis=0)
        if full := [name for name, part in zip(names, share, strict=True) if part > AT_RANGE]:
            raise InputError(
                f"{_listed(full)} is at the end of its range in {share.max():.1%} of the samples.",
                hint="Push less hard, or correct the range in [load_cells].",
            )
    middle = np.mean([rest.voltage for rest in found], axis=0)
    size = np.median(np.abs(voltages - middle), axis=0) + np.sqrt(np.diag(noise))
    ratio = size / np.median(size)
    if odd := {name: part for name, part in zip(names, ratio, strict=True) if not 1 / ODD < part < ODD}:
        raise InputError(
            f"{_listed(odd)} moves {next(iter(odd.values())):.3g} times as much as the other channels: "
            "it is probably in another unit (mV instead of V).",
            hint="State its unit in [load_cells] units, or write all voltages in V.",
        )


def _check_directions(wrenches: Float[np.ndarray, "n 6"], reference: float) -> None:
    """Raise NotIdentifiable if wrenches, torques over `LENGTH`, do not span six directions."""
    _, values, directions = np.linalg.svd(wrenches, full_matrices=False)
    require_directions(
        values / np.sqrt(len(wrenches)) > max(LEAST_PUSH, AS_NOISE * reference),
        directions,
        "the forces in the log have too few directions: {} is missing. "
        "Slide the ball over the complete surface in directions that cross, so that friction pulls along x and y.",
    )


def _check_response(white: Float[np.ndarray, "n m"], wrenches: Float[np.ndarray, "n 6"]) -> None:
    """Raise NotIdentifiable if whitened voltages do not respond to a direction of the wrench."""
    directions, values, _ = np.linalg.svd(np.linalg.lstsq(wrenches, white)[0])
    require_directions(
        values > LEAST_ANSWER,
        directions.T,
        "the voltages do not respond to {}: "
        "cells in line cannot measure the moment about their line. Place one cell away from that line.",
    )


def _listed(names: Iterable[str]) -> str:
    return "column " + ", ".join(map(repr, names))
