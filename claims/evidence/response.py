"""A map from the readings of neighbouring strips or taxels straight to where they were touched, learnt from presses."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from palpate.errors import InputError, NotIdentifiable
from palpate.spatial._arrays import frozen

NOISE = 0.01  # of the readings' say: variance of a position that readings cannot explain, as a share of its spread
MOST = 4000  # presses: the map holds all of them
_LEAST = 0.5  # of a coordinate's variance must be explained where it was held out, else the readings do not know it
_SAMPLE = 500  # presses from which the typical distance between readings is taken


@dataclass(frozen=True, eq=False)
class ResponseMap:
    """p(r) = mean + sum_i w_i exp(-|r - r_i|^2 / 2 l^2): the mean of a Gaussian process (kernel ridge regression).

    Attributes:
        readings: (n, k) of the presses it was learnt from.
        weights: (n, d); mean: (d,) [m or the unit of the positions].
        length: l, in the unit of the readings.
        error: (d,) rms where positions were held out, in their unit.
    """

    readings: Float[np.ndarray, "n k"]
    weights: Float[np.ndarray, "n d"]
    mean: Float[np.ndarray, " d"]
    length: float
    error: Float[np.ndarray, " d"]

    def position(self, readings: Float[np.ndarray, "m k"]) -> Float[np.ndarray, "m d"]:
        return self.mean + _kernel(readings, self.readings, self.length) @ self.weights


def identify_response(
    readings: Float[np.ndarray, "n k"],
    positions: Float[np.ndarray, "n d"],
    groups: Int[np.ndarray, " n"],
    *,
    names: tuple[str, ...] = ("x", "y", "z"),
) -> ResponseMap:
    """Learn the map, and try it where it has seen nothing: each group of presses by a map of the others.

    Args:
        readings: (n, k), each on the same scale.
        positions: (n, d) of the presses, d <= 3.
        groups: (n,) presses that are held out together: one stroke, one row.
        names: of the coordinates, for messages.

    Raises:
        NotIdentifiable: a coordinate is not explained where it was held out: the readings say nothing of it.
        InputError: too many presses, or one group only.
    """
    if len(readings) > MOST:
        raise InputError(f"{len(readings):,} presses are more than the {MOST:,} that a map holds: thin them.")
    if len(np.unique(groups)) < 2:
        raise InputError("there is one group of presses only: nothing can be held out.")
    length = _length(readings)
    held = np.empty_like(positions)
    for group in np.unique(groups):
        out = groups == group
        held[out] = _learnt(readings[~out], positions[~out], length).position(readings[out])
    error: Float[np.ndarray, " d"] = np.sqrt(np.mean((held - positions) ** 2, axis=0))
    explained = 1.0 - error**2 / np.maximum(positions.var(axis=0), 1e-300)
    lost = tuple(name for name, share in zip(names, explained.tolist(), strict=False) if share < _LEAST)
    if lost:
        raise NotIdentifiable(
            f"the readings say nothing of {' and '.join(lost)}: held out, presses are placed hardly better there than "
            "by their mean. Leave it out, or use a sensor that has more than one row.",
            rank=len(explained) - len(lost),
            missing=lost,
        )
    found = _learnt(readings, positions, length)
    return ResponseMap(found.readings, found.weights, found.mean, length, frozen(error))


def _learnt(readings: np.ndarray, positions: np.ndarray, length: float) -> ResponseMap:
    mean = positions.mean(axis=0)
    kernel = _kernel(readings, readings, length)
    kernel[np.diag_indices(len(kernel))] += NOISE
    weights: Float[np.ndarray, "n d"] = np.asarray(np.linalg.solve(kernel, positions - mean), np.float64)
    return ResponseMap(frozen(readings), frozen(weights), frozen(mean), length, np.full(len(mean), np.nan))


def _length(readings: np.ndarray) -> float:
    some = readings[:: max(len(readings) // _SAMPLE, 1)]
    apart = np.linalg.norm(some[:, None] - some[None], axis=-1)
    typical = float(np.median(apart[np.triu_indices(len(some), 1)]))
    if not typical > 0:
        raise NotIdentifiable("all presses have the same readings.", rank=0, missing=("position",))
    return typical / 2


def _kernel(one: np.ndarray, other: np.ndarray, length: float) -> np.ndarray:
    square = (one**2).sum(axis=1)[:, None] + (other**2).sum(axis=1) - 2 * one @ other.T
    return np.exp(-np.maximum(square, 0.0) / (2 * length**2))
