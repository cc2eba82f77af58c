"""Explanations of load cells that contradict each other: one wrong channel or cell, and the wrench without it."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

from palpate.errors import NotIdentifiable
from palpate.sensors.load_cells.model import LoadCells
from palpate.spatial.arguments import frozen_value, takes_arrays

CHANCE = 1e-6  # that sound channels leave more than the bound


@frozen_value
class Explanations:
    """The explanations of k cells of a axes: e is that cell e is wrong, for e < k, or else channel e - k; s = k + a k.

    Readings u without zero are a wrench w = A u, and v = Q u that no wrench makes, of unit variance. With U an
    orthonormal basis of Q_J, J the omitted channels, the rest of |v|^2 is |v|^2 - |U v|^2, and the wrench without J is
    w - K U v with K = A_J Q_J^+ U'.

    Attributes:
        cells: the model.
        inverse: (6, m) A.
        rest: (r, m) Q.
        directions: (s, 3, r) U, rows of zeros where J is smaller.
        corrections: (s, 3, 6) K'.
        covariances: (1 + s, 6, 6) of the wrench from a reading's noise: with all channels, then by each explanation.
        bounds: (1 + s,) of the rest of |v|^2; 0: no degree of freedom remains to judge by; -1: no wrench is determined.
    """

    cells: LoadCells
    inverse: Float[np.ndarray, "6 m"]
    rest: Float[np.ndarray, "r m"]
    directions: Float[np.ndarray, "s 3 r"]
    corrections: Float[np.ndarray, "s 3 6"]
    covariances: Float[np.ndarray, "t 6 6"]
    bounds: Float[np.ndarray, " t"]

    def metric(self) -> Float[np.ndarray, "6 6"]:
        """Return the metric (6, 6) of a wrench's squared length in whitened voltages, per degree of freedom of v."""
        matrix = self.cells.matrix
        spare = len(matrix) - self.cells.measured.shape[1]
        return matrix.T @ np.linalg.solve(self.cells.noise, matrix) / max(1, spare)

    def channels(self, which: int) -> Bool[np.ndarray, " m"]:
        """Return a mask (m,) of the channels that an explanation omits."""
        count = self.cells.cells
        numbers = np.arange(len(self.cells.matrix))
        return numbers // len(self.cells.axes) == which if which < count else numbers == which - count

    def cell(self, which: int) -> int:
        """Return the number, from 0, of the cell that an explanation is about."""
        count = self.cells.cells
        return which if which < count else (which - count) // len(self.cells.axes)

    def fits(self, readings: Float[np.ndarray, "n m"]) -> tuple[Bool[np.ndarray, " n"], Bool[np.ndarray, "n s"]]:
        """Return masks for readings [V] less the zero: all channels agree (n,), and each explanation fits (n, s).

        Raises:
            InputError: readings has another shape.
        """
        metric = self.metric()
        wrench, left = readings @ self.inverse.T, readings @ self.rest.T
        square = np.sum(left**2, axis=1)
        agree = square <= self.bounds[0] * self._expected(wrench, metric)
        fits = np.zeros((len(readings), len(self.directions)), dtype=bool)
        for e in np.flatnonzero(self.bounds[1:] > 0.0):
            shares = left @ self.directions[e].T
            expected = self._expected(wrench - shares @ self.corrections[e], metric)
            fits[:, e] = square - np.sum(shares**2, axis=1) <= self.bounds[1 + e] * expected
        return agree, fits

    def simplest(self, fits: Bool[np.ndarray, "*batch s"]) -> Bool[np.ndarray, "*batch s"]:
        """Return the mask `fits` (*batch, s) without complete cells where a single channel fits.

        Raises:
            InputError: fits has another shape.
        """
        kept = fits.copy()
        kept[..., : self.cells.cells] &= ~fits[..., self.cells.cells :].any(axis=-1, keepdims=True)
        return kept

    def wrenches(self, readings: Float[np.ndarray, "n m"], which: int) -> Float[np.ndarray, "n 6"]:
        """Return wrenches (n, 6) [N, N m] of readings [V] without zero, by the channels that an explanation keeps.

        Raises:
            InputError: readings has another shape.
        """
        shares = readings @ self.rest.T @ self.directions[which].T
        return readings @ self.inverse.T - shares @ self.corrections[which]

    def _expected(self, wrench: Float[np.ndarray, "n 6"], metric: Float[np.ndarray, "6 6"]) -> np.ndarray:
        """Return the expected square (n,) of an entry of v: noise, drift, and misfit under load."""
        load = np.einsum("ni,ij,nj->n", wrench, metric, wrench)
        return 1.0 + self.cells.drift**2 + self.cells.misfit**2 * load


@takes_arrays
def explanations(cells: LoadCells, sound: Bool[np.ndarray, " some"] | None = None) -> Explanations:
    """Return the `Explanations` for sound cells (k,) or channels (a k,); None: all.

    Raises:
        InputError: sound has another shape.
        NotIdentifiable: the sound channels do not determine a wrench.
    """
    kept = cells.channels(sound)
    inverse, covariance, rest = cells.inverse(kept)
    count, freedom = cells.cells + len(kept), len(rest)
    directions, corrections = np.zeros((count, 3, freedom)), np.zeros((count, 3, 6))
    covariances, bounds = np.tile(covariance, (1 + count, 1, 1)), -np.ones(1 + count)
    bounds[0] = unlikely(freedom)
    made = Explanations(cells, inverse, rest, directions, corrections, covariances, bounds)
    for e in range(count):
        out = made.channels(e) & kept
        size = int(np.count_nonzero(out))
        try:
            cells.require_rank(kept & ~out)
        except NotIdentifiable:
            continue
        if not size or size > freedom:
            continue
        basis, triangle = np.linalg.qr(rest[:, out])
        directions[e, :size] = basis.T
        corrections[e, :size] = np.linalg.solve(triangle.T, inverse[:, out].T)
        covariances[1 + e] += corrections[e].T @ corrections[e]
        bounds[1 + e] = unlikely(freedom - size) if freedom > size else 0.0
    return made


def unlikely(freedom: int) -> float:
    """Return the chi-square that sound channels exceed once in a million samples; inf without degrees of freedom."""
    from scipy.special import chdtri  # here: scipy is slow to import, its stats most of all

    return float(chdtri(freedom, CHANCE)) if freedom > 0 else np.inf
