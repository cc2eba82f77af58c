"""Three-axis force cells under a rigid frame: the forward model, and the wrench from any sound subset of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from numpy.typing import ArrayLike

from palpate.contact.indentation import Indentation
from palpate.errors import InputError, NotIdentifiable
from palpate.signals.recording import REFERENCE, VOLTAGE
from palpate.spatial._arrays import Value, frozen
from palpate.spatial.arguments import takes_arrays
from palpate.spatial.pose import skew
from palpate.spatial.shown import one_line

__all__ = [
    "REFERENCE",
    "VOLTAGE",
    "LoadCells",
    "named_axis",
    "require_layout",
    "single_wrench_map",
    "with_changes",
    "wrench_direction",
]

LENGTH = 0.01  # m: a torque of 1 N at this arm counts as much as 1 N where ranks are judged
FLATTEST = 1e-3  # of the largest singular value: below it a direction of the wrench is not measured
IN_LINE = 0.02  # of the layout's extent: cells nearer to one line than this cannot measure the moment about it


@takes_arrays
@dataclass(frozen=True, eq=False, init=False)
class LoadCells(Value):
    """k three-axis cells under a rigid frame read u = C w + b + noise, w the wrench on the frame [load cells, (1)-(8)].

    The paper sums the cells' own forces, w = sum (f_i, l_i x f_i) with f_i = S_i (u_i - b_i). Under a rigid frame the
    3 k voltages span six dimensions only: C is determined by a calibration, the S_i and l_i are not. A dead cell still
    carries load, so the sums without it are wrong; C without its three rows is not.

    Args:
        matrix: (3 k, 6) C [V/N, V/(N m)], force first, about the origin of the surface's frame.
        noise: (3 k, 3 k) covariance or (3 k,) standard deviations of one reading [V].
        limits: (3 k, 2) lowest and highest voltage; None: not known.
        covariance: (36, 36) of the relative error E, row by row: the true matrix is C (I + E). One E serves every
            subset of cells.
        positions: (k, 3) [m] of the cells, NaN where not known.
        indentation: law of the soft layer on the frame; None: rigid.
        bias: (3 k,) b [V] as it was in the calibration, with which later ones are compared.
        drift: standard deviation of the bias's drift after the zero was taken, over that of a reading's noise.
        misfit: share of a reading's whitened length that C does not explain, in addition to noise.
        correlation: number of samples of this sensor that count as one independent sample.
        samples: number of samples of the calibration.
        provenance: origin of the calibration.
        notes: facts about the calibration, one sentence each.

    Raises:
        InputError: a shape is wrong, a number is not finite, or the noise is not positive definite.
        NotIdentifiable: the matrix or the positions do not determine a wrench.
    """

    matrix: Float[np.ndarray, "m 6"]
    noise: Float[np.ndarray, "m m"]
    limits: Float[np.ndarray, "m 2"]
    covariance: Float[np.ndarray, "36 36"]
    positions: Float[np.ndarray, "k 3"]
    indentation: Indentation | None
    bias: Float[np.ndarray, " m"]
    drift: float
    misfit: float
    correlation: float
    samples: int
    provenance: Mapping[str, str]
    notes: tuple[str, ...]

    def __init__(
        self,
        matrix: ArrayLike,
        noise: ArrayLike,
        *,
        limits: ArrayLike | None = None,
        covariance: ArrayLike | None = None,
        positions: ArrayLike | None = None,
        indentation: Indentation | None = None,
        bias: ArrayLike | None = None,
        drift: float = 0.0,
        misfit: float = 0.0,
        correlation: float = 1.0,
        samples: int = 0,
        provenance: Mapping[str, str] | None = None,
        notes: Sequence[str] = (),
    ) -> None:
        rows = np.shape(matrix)[0] if np.ndim(matrix) == 2 else 0
        if rows < 9 or rows % 3:
            raise InputError(f"load cells need three rows for each of at least three cells, not {rows} rows.")
        spread = np.asarray(noise, dtype=np.float64)
        every = np.tile([-np.inf, np.inf], (rows, 1))
        given: dict[str, tuple[ArrayLike, tuple[int, ...]]] = {
            "matrix": (matrix, (rows, 6)),
            "noise": (np.diag(spread**2) if spread.ndim == 1 else spread, (rows, rows)),
            "limits": (every if limits is None else limits, (rows, 2)),
            "covariance": (np.zeros((36, 36)) if covariance is None else covariance, (36, 36)),
            "positions": (np.full((rows // 3, 3), np.nan) if positions is None else positions, (rows // 3, 3)),
            "bias": (np.zeros(rows) if bias is None else bias, (rows,)),
        }
        for name, (values, shape) in given.items():
            object.__setattr__(self, name, _shaped(name, values, shape))
        for name, value in (
            ("indentation", indentation),
            ("drift", float(drift)),
            ("misfit", float(misfit)),
            ("correlation", float(correlation)),
            ("samples", int(samples)),
            ("provenance", MappingProxyType(dict(provenance or {}))),
            ("notes", tuple(notes)),
        ):
            object.__setattr__(self, name, value)
        if not np.all(np.linalg.eigvalsh(self.noise) > 0):
            raise InputError("noise must be a covariance that is positive in every direction.", where="load_cells")
        require_layout(self.positions)
        self.require_rank(np.ones(rows // 3, dtype=bool))

    def __reduce__(self) -> tuple[Any, tuple[dict[str, Any]]]:
        """Return how to unpickle the cells, with read-only arrays and mappings again."""
        return _remade, ({**vars(self), "provenance": dict(self.provenance)},)

    @property
    def cells(self) -> int:
        """Number of cells, k."""
        return len(self.matrix) // 3

    def channels(self, sound: Bool[np.ndarray, " some"] | None = None) -> Bool[np.ndarray, " m"]:
        """Return a mask (3 k,) of the channels of sound cells (k,); a mask of channels is returned as is; None: all."""
        if sound is not None and len(sound) == len(self.matrix):
            return sound
        return np.repeat(np.ones(self.cells, dtype=bool) if sound is None else sound, 3)

    def inverse(
        self, sound: Bool[np.ndarray, " some"] | None = None
    ) -> tuple[Float[np.ndarray, "6 m"], Float[np.ndarray, "6 6"], Float[np.ndarray, "r m"]]:
        """Return the map from readings u - b to wrenches, by generalised least squares from the sound channels.

        Args:
            sound: (k,) cells or (3 k,) channels to use; None: all.

        Returns:
            A (6, 3 k) [N/V, N m/V] with w = A (u - b) and zeros for the others; P (6, 6), the covariance of w from the
            noise of one reading; and Q (r, 3 k), the combinations of unit variance that no wrench can make, six fewer
            than channels.

        Raises:
            NotIdentifiable: the sound channels do not determine a wrench.
        """
        kept = self.channels(sound)
        self.require_rank(kept)
        lower = np.linalg.cholesky(self.noise[np.ix_(kept, kept)])
        white = np.linalg.solve(lower, np.eye(len(lower)))
        basis, upper = np.linalg.qr(white @ self.matrix[kept], mode="complete")
        solved = np.linalg.inv(upper[:6])
        inverse, rest = np.zeros((6, len(kept))), np.zeros((len(lower) - 6, len(kept)))
        inverse[:, kept] = solved @ basis[:, :6].T @ white
        rest[:, kept] = basis[:, 6:].T @ white
        return inverse, solved @ solved.T, rest

    def wrenches(
        self, readings: Float[np.ndarray, "*batch m"], sound: Bool[np.ndarray, " some"] | None = None
    ) -> tuple[Float[np.ndarray, "*batch 6"], Float[np.ndarray, "*batch 6 6"]]:
        """Return wrenches (*batch, 6) [N, N m], and covariances (*batch, 6, 6) of noise, drift and calibration.

        Args:
            readings: (*batch, 3 k) [V], u - b.
            sound: (k,) cells or (3 k,) channels to use; None: all.

        Raises:
            NotIdentifiable: the sound channels do not determine a wrench.
        """
        inverse, covariance, _ = self.inverse(sound)
        found = readings @ inverse.T
        return found, (1.0 + self.drift**2) * covariance + self.calibration_covariance(found)

    def calibration_covariance(self, wrenches: Float[np.ndarray, "*batch 6"]) -> Float[np.ndarray, "*batch 6 6"]:
        """Return the covariance (*batch, 6, 6) of the error E w of wrenches [N, N m] by the calibration.

        It is common to all samples of a contact; E is that of `LoadCells`.
        """
        blocks = self.covariance.reshape(6, 6, 6, 6)
        return np.einsum("iajb,...a,...b->...ij", blocks, wrenches, wrenches)

    def chi_square(
        self, readings: Float[np.ndarray, "*batch m"], sound: Bool[np.ndarray, " some"] | None = None
    ) -> Float[np.ndarray, "*batch"]:
        """Return the residual (*batch,) of a wrench fitted to readings, squared and in units of its variance.

        It has a chi-square distribution; its degrees of freedom are the number of sound channels (3 k for all) less 6.
        The variance is that of noise, drift and the calibrated misfit, which grows with the load.

        Args:
            readings: (*batch, 3 k) [V], with the biases subtracted.
            sound: (k,) cells or (3 k,) channels to use; None: all.

        Raises:
            NotIdentifiable: the sound channels do not determine a wrench.
        """
        inverse, _, rest = self.inverse(sound)
        left = np.sum((readings @ rest.T) ** 2, axis=-1)
        explained = readings @ inverse.T @ self.matrix[self.channels(sound)].T
        lower = np.linalg.cholesky(self.noise[np.ix_(self.channels(sound), self.channels(sound))])
        size = np.sum(np.linalg.solve(lower, explained[..., None])[..., 0] ** 2, axis=-1)
        return left / (1.0 + self.drift**2 + self.misfit**2 * size / len(rest)) if len(rest) else left

    def require_rank(self, sound: Bool[np.ndarray, " some"]) -> None:
        """Raise NotIdentifiable if the sound cells (k,) or channels (3 k,) do not determine a wrench."""
        kept = self.channels(sound)
        scaled = self.matrix[kept] / np.sqrt(np.diag(self.noise))[kept, None]
        scaled = scaled * [1.0, 1.0, 1.0, LENGTH, LENGTH, LENGTH]
        count = np.count_nonzero(kept)
        if count < 6:
            raise NotIdentifiable(
                f"{count // 3} sound cells cannot determine the six numbers of a wrench: at least three are needed.",
                rank=int(count),
                missing=("wrench",),
            )
        _, values, directions = np.linalg.svd(scaled)
        known = values > FLATTEST * values[0]
        if known.all():
            return
        missing = tuple(wrench_direction(row) for row in directions[~known])
        raise NotIdentifiable(
            f"the cells do not measure {' and '.join(missing)}: their readings are the same with and without it. "
            "Cells in line cannot measure the moment about their line; place one away from that line.",
            rank=int(known.sum()),
            missing=missing,
        )

    def __repr__(self) -> str:
        return one_line(self)


@takes_arrays
def require_layout(positions: Float[np.ndarray, "k 3"]) -> None:
    """Raise NotIdentifiable if all cells lie on one line or at one point.

    Forces at points of a line have no moment about it: sum l_i x f_i spans two dimensions only [load cells, (4)].

    Args:
        positions: (k, 3) [m]; rows of NaN are not known, and nothing is checked then.
    """
    if not np.isfinite(positions).all():
        return
    centred = positions - positions.mean(axis=0)
    _, values, axes = np.linalg.svd(centred)
    if values[0] > 0 and values[1] > IN_LINE * values[0]:
        return
    if values[0] == 0:
        raise NotIdentifiable("all cells are at one point, so they measure no moment.", rank=3, missing=("torque",))
    axis = named_axis(axes[0])
    raise NotIdentifiable(
        f"all {len(positions)} cells are in line along {axis}: forces at points of a line have no moment about it, "
        f"so the torque about {axis} cannot be measured. Place one cell away from the line.",
        rank=5,
        missing=(f"torque about {axis}",),
    )


@takes_arrays
def wrench_direction(direction: Float[np.ndarray, "6"]) -> str:
    """Return a direction (6,), force and torque / 0.01 m, in words, such as "force along x with torque about z"."""
    force, torque = direction[:3], direction[3:]
    parts = [
        f"{word} {named_axis(part)}"
        for word, part in (("force along", force), ("torque about", torque))
        if np.linalg.norm(part) > 0.3 * np.linalg.norm(direction)
    ]
    return " with ".join(parts)


@takes_arrays
def named_axis(axis: Float[np.ndarray, "3"]) -> str:
    """Return an axis (3,) as text: "x", "y" or "z" within 11 degrees, else as "(0.71, 0.71, 0.00)"."""
    unit = axis / np.linalg.norm(axis)
    largest = int(np.abs(unit).argmax())
    unit = unit * np.sign(unit[largest])
    if unit[largest] > 0.98:  # 11 degrees
        return "xyz"[largest]
    return "(" + ", ".join(f"{value:.2f}" for value in unit + 0.0) + ")"


@takes_arrays
def single_wrench_map(position: Float[np.ndarray, "3"]) -> Float[np.ndarray, "6 3"]:
    """Return (I; [l]x), (6, 3), which maps a cell's force at its position l to a wrench."""
    return np.concatenate([np.eye(3), skew(position)])


def with_changes(cells: LoadCells, **changes: Any) -> LoadCells:
    """Return new `LoadCells`, the same but for some fields.

    Raises:
        InputError: a value is none that `LoadCells` takes.
        NotIdentifiable: a new matrix or new positions do not determine a wrench.
    """
    return _remade(vars(cells) | changes)


def _remade(fields: dict[str, Any]) -> LoadCells:
    return LoadCells(fields.pop("matrix"), fields.pop("noise"), **fields)


def _shaped(name: str, values: ArrayLike, shape: tuple[int, ...]) -> Float[np.ndarray, "..."]:
    array = frozen(values)
    unknown = name in ("positions", "limits")  # NaN and infinity have a meaning there
    if array.shape != shape or not (unknown or np.isfinite(array).all()):
        seen = f"shape {array.shape}" if array.shape != shape else "numbers that are not finite"
        raise InputError(f"{name} must be {shape} finite numbers, not {seen}.", where="load_cells")
    return array
