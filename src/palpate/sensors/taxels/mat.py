"""Calibrate a pressure mat, or another sheet, by one frame at each of several pressures on all of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError, NotIdentifiable
from palpate.sensors.taxels.calibrate import identify_intensity, scaled
from palpate.sensors.taxels.intensity import Intensity
from palpate.sensors.taxels.model import TaxelBody
from palpate.spatial.arguments import takes_arrays

FEWEST = 4  # pressures that give each cell a gain
LEAST = 0.1  # of the usual gain, of a cell that answers
AGAIN = 2  # that the common curve and the gains are fitted


@takes_arrays
def identify_by_pressures(
    pressures: Float[np.ndarray, " n"],
    frames: Float[np.ndarray, "n k"],
    body: TaxelBody,
    *,
    kind: str = "auto",
    degree: int | None = None,
    provenance: Mapping[str, str] | None = None,
) -> Intensity:
    """Return the `Intensity` of a sheet by frames at known pressures: one curve, and a gain for each usable cell.

    The force on a cell is the pressure times its area.

    Args:
        pressures: (n,) [Pa] on all cells.
        frames: (n, k) raw readings of the body's cells.
        body: the cells, with their areas.
        kind: as of `identify_intensity`.
        degree: as of `identify_intensity`.
        provenance: origin of the frames.

    Raises:
        NotIdentifiable: fewer than four pressures, or readings that never change.
        InputError: taxels on no sheet, frames of another number of cells, negative pressures, or a curve that does not
            rise; or arrays of other shapes.
    """
    if frames.shape[1] != len(body) or len(pressures) != len(frames):
        what = f"{len(frames)} frames of {frames.shape[1]} readings do not fit {len(pressures)} pressures on a body of"
        raise InputError(f"{what} {body.named()}.", where="pressures")
    if not body.rows:
        hint = "State a map or a pitch in [skin], or press taxels one by one."
        raise InputError("pressures need a sheet, whose cells have known areas.", where="skin", hint=hint)
    if len(np.unique(pressures)) < FEWEST:
        few = f"{len(np.unique(pressures))} pressures are too few for a gain of each cell (at least {FEWEST})."
        raise NotIdentifiable(few, rank=len(pressures), missing=("curve",))
    cells, rest = np.flatnonzero(body.usable), frames[np.argmin(pressures)]
    force = np.outer(pressures, body.areas[cells])
    above = np.where((frames >= body.top) & (body.bits is not None), np.nan, frames - rest)[:, cells]

    def fitted(gain: np.ndarray) -> tuple[Intensity, np.ndarray, np.ndarray]:
        alike = above / np.where(gain > LEAST, gain, np.nan)
        found = identify_intensity(force.ravel(), alike.ravel(), kind=kind, degree=degree, provenance=provenance)
        curve = found.curves[0]
        return found, *_line((-1.0 if curve.falling else 1.0) * curve.intensity(force), above)

    slope = _line(force, above)[0]
    found, gain, error = fitted(slope / float(np.nanmedian(slope)))
    for _ in range(AGAIN):
        found, gain, error = fitted(gain)
    common = found.curves[0]
    which, curves = np.zeros(len(body), dtype=np.int64), [common]
    for k in np.flatnonzero(gain > LEAST).tolist():
        which[cells[k]] = len(curves)
        end = float(rest[cells[k]]) + float(gain[k]) * common.saturation  # a reading; the common curve counts from rest
        curves.append(scaled(common, float(gain[k]), float(error[k]), end))
    known = gain[gain > LEAST]
    notes = [*found.notes, f"gains of cells differ by {100 * float(np.std(known / known.mean())):.1f} %"]
    if len(known) < len(body):
        notes.append(f"{len(body) - len(known)} of {len(body)} cells have no gain: they do not answer, or are masked")
    return replace(found, curves=tuple(curves), which=which.reshape(body.shape), notes=tuple(notes))


def _line(
    x: Float[np.ndarray, "n k"], y: Float[np.ndarray, "n k"]
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """Return the slope (k,) of each cell's y over x, where both are finite, and its standard deviation."""
    x = np.where(np.isfinite(y), x, np.nan)
    x, y = x - np.nanmean(x, axis=0), y - np.nanmean(y, axis=0)
    square = np.nansum(x**2, axis=0)
    slope = np.nansum(x * y, axis=0) / square
    freedom = np.maximum(np.isfinite(y).sum(axis=0) - 2, 1)
    return slope, np.sqrt(np.nansum((y - slope * x) ** 2, axis=0) / freedom / square)


@takes_arrays
def pressure_errors(
    pressures: Float[np.ndarray, " n"],
    frames: Float[np.ndarray, "n k"],
    body: TaxelBody,
    *,
    kind: str = "auto",
    degree: int | None = None,
) -> Float[np.ndarray, "m k"]:
    """Return errors (m, k) [Pa] of the frames between the lowest and the highest pressure, each by the others alone.

    Readings count from the frame of the lowest pressure, which should be 0. Masked cells, and cells without a gain, are
    NaN.

    Args:
        pressures: as of `identify_by_pressures`.
        frames: as of `identify_by_pressures`.
        body: as of `identify_by_pressures`.
        kind: as of `identify_intensity`.
        degree: as of `identify_intensity`.

    Raises:
        NotIdentifiable, InputError: as by `identify_by_pressures`, or fewer than five pressures.
    """
    order = np.argsort(pressures, kind="stable")
    pressures, frames = pressures[order], frames[order]
    errors = np.full((max(len(order) - 2, 0), len(body)), np.nan)
    for k in range(1, len(order) - 1):
        rest = order != order[k]
        found = identify_by_pressures(pressures[rest], frames[rest], body, kind=kind, degree=degree)
        above = np.abs(frames[k] - frames[0])
        for cell, which in enumerate(found.numbers(body.shape).tolist()):
            force = float(found.curves[int(which)].force(above[cell : cell + 1])[0]) if which else np.nan
            errors[k - 1, cell] = force / body.areas[cell] + pressures[0] - pressures[k]
    return errors
