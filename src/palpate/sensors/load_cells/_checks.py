"""Check the channels and the directions of a bench log before anything is fitted to it."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from palpate.errors import InputError
from palpate.sensors.load_cells._log import UnloadedStretch
from palpate.sensors.load_cells.model import require_directions

__all__ = ["check_channels", "check_directions", "check_response"]

ODD = 100.0  # times the others: gains of cells do not differ so much, prefixes of units do
LEAST_PUSH, AS_NOISE = 0.01, 1.5  # N, rms along a direction of the wrench, and times the reference's noise
LEAST_ANSWER = 5.0  # times the noise of a reading, for 1 N or 10 N mm: less is no response
AT_RANGE = 0.001  # share of samples at a limit that is too much


def check_channels(
    voltages: Float[np.ndarray, "n m"],
    found: list[UnloadedStretch],
    noise: Float[np.ndarray, "m m"],
    limits: ArrayLike | None,
    names: tuple[str, ...],
) -> None:
    """Require that every channel of a bench log moves within its range, in the unit of the others.

    Args:
        voltages: (n, m) [V].
        found: unloaded stretches of the log.
        noise: (m, m) covariance of a reading.
        limits: (m, 2) range of each channel [V]; None: not known.
        names: names of the channels, for messages.

    Raises:
        InputError: a channel never moves, is at its range, or has another unit.
    """
    still = [name for name, span in zip(names, np.ptp(voltages, axis=0), strict=True) if span == 0]
    if still:
        raise InputError(
            f"{_listed(still)} never changes: the cell is dead, or not connected.",
            hint="Repair it, or leave the three columns of that cell out of [load_cells] columns.",
        )
    if limits is not None:
        low, high = np.asarray(limits, dtype=np.float64).T
        share = np.mean((voltages <= low) | (voltages >= high), axis=0)
        full = [name for name, part in zip(names, share, strict=True) if part > AT_RANGE]
        if full:
            raise InputError(
                f"{_listed(full)} is at the end of its range in {share.max():.1%} of the samples.",
                hint="Push less hard, or correct the range in [load_cells].",
            )
    middle = np.mean([rest.voltage for rest in found], axis=0)
    size = np.median(np.abs(voltages - middle), axis=0) + np.sqrt(np.diag(noise))
    ratio = size / np.median(size)
    odd = {name: part for name, part in zip(names, ratio, strict=True) if not 1 / ODD < part < ODD}
    if odd:
        raise InputError(
            f"{_listed(odd)} moves {next(iter(odd.values())):.3g} times as much as the other channels: "
            "it is probably in another unit (mV instead of V).",
            hint="State its unit in [load_cells] units, or write all voltages in V.",
        )


def check_directions(wrenches: Float[np.ndarray, "n 6"], reference: float) -> None:
    """Require that wrenches (n, 6), torques over `LENGTH`, span six directions; `reference` is their noise [N].

    Raises:
        NotIdentifiable: they do not; it names the missing directions.
    """
    _, values, directions = np.linalg.svd(wrenches, full_matrices=False)
    require_directions(
        values / np.sqrt(len(wrenches)) > max(LEAST_PUSH, AS_NOISE * reference),
        directions,
        "the forces in the log have too few directions: {} is missing. "
        "Slide the ball over the complete surface in directions that cross, so that friction pulls along x and y.",
    )


def check_response(white: Float[np.ndarray, "n m"], wrenches: Float[np.ndarray, "n 6"]) -> None:
    """Require that whitened voltages (n, m) respond to every direction of the wrenches (n, 6).

    Raises:
        NotIdentifiable: they do not; it names the directions.
    """
    directions, values, _ = np.linalg.svd(np.linalg.lstsq(wrenches, white)[0])
    require_directions(
        values > LEAST_ANSWER,
        directions.T,
        "the voltages do not respond to {}: "
        "cells in line cannot measure the moment about their line. Place one cell away from that line.",
    )


def _listed(names: Iterable[str]) -> str:
    return "column " + ", ".join(map(repr, names))
