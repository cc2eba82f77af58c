"""Calibrate a pressure mat, or any skin, by one frame at each of several pressures on all of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError
from palpate.sensors.taxels.calibrate import identify_intensity
from palpate.sensors.taxels.intensity import Intensity
from palpate.sensors.taxels.model import TaxelBody
from palpate.spatial.arguments import takes_arrays

FEWEST = 4  # pressures that give each cell a gain


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
    """Return the `Intensity` of a skin by frames at known pressures: one curve, and a gain for each usable cell.

    The force on a cell is the pressure times its area.

    Args:
        pressures: (n,) [Pa] on the whole skin.
        frames: (n, k) raw readings of the body's cells.
        body: the cells, with their areas.
        kind: as of `identify_intensity`.
        degree: as of `identify_intensity`.
        provenance: origin of the frames.

    Raises:
        NotIdentifiable: fewer than four pressures, or readings that never change.
        InputError: frames of another number of cells, negative pressures, or a curve that does not rise; or arrays of
            other shapes.
    """
    if frames.shape[1] != len(body):
        raise InputError(f"frames have {frames.shape[1]} readings, but the body has {body.named()}.", where="pressures")
    rows, columns = body.shape if body.rows else (1, len(body))
    cells = np.flatnonzero(body.usable)
    force = np.outer(pressures, body.areas[cells]).ravel()  # frame by frame, so that frames are left out together
    cell = np.tile(np.column_stack(np.divmod(cells, columns)), (len(frames), 1))
    top = None if body.bits is None else body.top
    found = identify_intensity(
        force,
        frames[:, cells].ravel(),
        cell,
        shape=(rows, columns),
        kind=kind,
        degree=degree,
        top=top,
        provenance=provenance,
    )
    return found if body.rows or found.which is None else replace(found, which=found.which.ravel())


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
