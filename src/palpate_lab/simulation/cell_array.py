"""Triaxial force cells under a rigid frame: the frame's division of a load among them, and their voltages."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from palpate.errors import GeometryError
from palpate.spatial._arrays import frozen
from palpate.spatial.pose import skew

GAIN = 0.1  # V/N: of a cell
SPREAD = 0.2  # of gains and stiffnesses, to either side
COUPLING = 0.05  # of the gain: one standard deviation of what another axis adds
STIFFNESS = np.array([1.0e5, 1.0e5, 2.0e5])  # N/m: a coated cell, sideways and down
_DEPTH = -3.5e-3  # m: the cells' plane below the middle of the ellipse
_STIFF_ENOUGH = 1e-9  # least over largest eigenvalue of the frame's stiffness, in lengths of the array


def _plane(*places: tuple[float, float]) -> Float[np.ndarray, "k 3"]:
    return frozen([(1e-3 * x, 1e-3 * y, _DEPTH) for x, y in places], tail=(3,))


LAYOUTS = {  # m: cells on a base of 22 x 32 mm, by how many they are; four is the paper's
    3: _plane((-6.5, -10.5), (6.5, -10.5), (0.0, 10.5)),
    4: _plane((-6.5, -10.5), (6.5, -10.5), (-6.5, 10.5), (6.5, 10.5)),
    5: _plane((-6.5, -10.5), (6.5, -10.5), (0.0, 0.0), (-6.5, 10.5), (6.5, 10.5)),
    6: _plane((-6.5, -10.5), (6.5, -10.5), (-6.5, 0.0), (6.5, 0.0), (-6.5, 10.5), (6.5, 10.5)),
}


def in_line(count: int = 3) -> Float[np.ndarray, "k 3"]:
    """Return the positions (k, 3) [m] of `count` cells on a line along y, an example of a bad arrangement.

    Cells on a line do not measure the moment about it.
    """
    return _plane(*((0.0, y) for y in np.linspace(-10.5, 10.5, count)))


@dataclass(frozen=True)
class CellArray:
    """An array of k cells under a frame: a cell gives u = S^-1 f + b (`load_cells` (8)), f the frame's force on it.

    The frame is rigid and each cell a spring K_i at its place l_i, so that a small motion (d, phi) of the frame loads
    it with f_i = K_i (d + phi x l_i). With G_i = [1, -[l_i]x] the balance of forces and moments, W = sum G_i' f_i,
    gives f_i = K_i G_i (sum G_j' K_j G_j)^-1 W, and W = (F, M) comes back as (`load_cells` (3), (4)).

    Args:
        position: (k, 3) l_i [m].
        sensitivity: (k, 3, 3) S_i [N/V].
        stiffness: (k, 3, 3) K_i [N/m], symmetric.
        twist: stiffness of each cell against turning [N m/rad], by a moment that it does not measure; cells in line
            need one.
    """

    position: Float[np.ndarray, "k 3"]
    sensitivity: Float[np.ndarray, "k 3 3"]
    stiffness: Float[np.ndarray, "k 3 3"]
    twist: float = 0.0

    def __post_init__(self) -> None:
        for name in ("position", "sensitivity", "stiffness"):
            object.__setattr__(self, name, frozen(getattr(self, name)))

    @property
    def count(self) -> int:
        """Number of cells."""
        return len(self.position)

    def shares(self) -> Float[np.ndarray, "k 3 6"]:
        """Return matrices (k, 3, 6) [1, 1/m]: f_i = shares_i W is the force on cell i by a wrench W, force first.

        Raises:
            GeometryError: the frame can turn without loading a cell.
        """
        motion: np.ndarray = np.concatenate(
            [np.broadcast_to(np.eye(3), (self.count, 3, 3)), -skew(self.position)], axis=2
        )
        loads = self.stiffness @ motion  # of a unit motion
        frame: np.ndarray = np.sum(np.swapaxes(motion, 1, 2) @ loads, axis=0)
        frame[3:, 3:] += self.count * self.twist * np.eye(3)
        size = np.r_[np.ones(3), np.full(3, 1.0 / np.ptp(self.position, axis=0).max())]
        values = np.linalg.eigvalsh(size[:, None] * frame * size)
        if values[0] < _STIFF_ENOUGH * values[-1]:
            raise GeometryError(
                "the frame can turn freely about these cells: rotate a cell, or move one out of their line."
            )
        return loads @ np.linalg.inv(frame)

    def forces(self, wrench: Float[np.ndarray, "*batch 6"]) -> Float[np.ndarray, "*batch k 3"]:
        """Return the force on each cell (*batch, k, 3) [N] from a wrench on the frame (*batch, 6) [N, N m].

        Raises:
            GeometryError: the frame can turn without loading a cell.
        """
        return np.einsum("iab,...b->...ia", self.shares(), wrench)

    def forward(self) -> Float[np.ndarray, "m 6"]:
        """Return C (3k, 6) [V/N, V/(N m)] of u = C w + b, with u the voltages, w the wrench and b the biases.

        Raises:
            GeometryError: the frame can turn without loading a cell.
        """
        return (np.linalg.inv(self.sensitivity) @ self.shares()).reshape(-1, 6)

    def voltages(self, wrench: Float[np.ndarray, "*batch 6"]) -> Float[np.ndarray, "*batch m"]:
        """Return the voltages (*batch, 3k) [V], cell by cell and x, y, z in each, without bias and noise.

        Raises:
            GeometryError: the frame can turn without loading a cell.
        """
        return wrench @ self.forward().T

    def voltage_noise(self, noise: float, *, array: bool) -> float:
        """Return the noise [V] of every channel that is worth `noise` [N] an axis, in all cells' sum or in one cell.

        Cells differ, so that this is the root of the mean square over the axes, and over the cells.
        """
        square = float(np.sum(self.sensitivity**2)) / 3.0
        return noise / float(np.sqrt(square if array else square / self.count))


def random_cells(position: Float[np.ndarray, "k 3"], rng: np.random.Generator, *, twist: float = 0.0) -> CellArray:
    """Draw a `CellArray` at places [m]: gains about 0.1 V/N, cross-coupling of 5 %, stiffness that differs by 20 %."""
    count = len(position)
    gain = GAIN * COUPLING * rng.normal(size=(count, 3, 3))
    diagonal = np.arange(3)
    gain[:, diagonal, diagonal] = GAIN * rng.uniform(1 - SPREAD, 1 + SPREAD, (count, 3))
    stiffness = np.zeros((count, 3, 3))
    stiffness[:, diagonal, diagonal] = STIFFNESS * rng.uniform(1 - SPREAD, 1 + SPREAD, (count, 3))
    return CellArray(position, np.linalg.inv(gain), stiffness, twist)
