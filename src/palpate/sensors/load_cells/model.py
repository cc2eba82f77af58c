"""Force cells of three axes or one under a rigid frame: the forward model, and the wrench from any sound subset."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from numpy.typing import ArrayLike

from palpate.contact.indentation import Indentation
from palpate.errors import InputError, NotIdentifiable
from palpate.signals.recording import VOLTAGE
from palpate.spatial._arrays import Value, frozen
from palpate.spatial.arguments import frozen_value, takes_arrays
from palpate.spatial.shown import one_line

__all__ = ["AXES", "VOLTAGE", "LoadCells", "require_directions", "require_layout", "with_changes"]

AXES = ("x", "y", "z")

LENGTH = 0.01  # m: a torque of 1 N at this arm counts as much as 1 N where ranks are judged
SHEAR = 0.3  # of the force: standard deviation, along each tangent, of shear that is not measured
FLATTEST = 1e-3  # of the largest singular value: below it a direction of the wrench is not measured
LAYOUTS = (AXES, *((axis,) for axis in AXES))  # of the axes of a cell
IN_LINE = 0.02  # of the layout's extent: cells nearer to one line than this cannot measure the moment about it


@frozen_value(init=False)
class LoadCells(Value):
    """k cells of a axes under a rigid frame read u = C w + b + noise, w the wrench on the frame [load cells, (1)-(8)].

    The paper sums the cells' own forces, w = sum (f_i, l_i x f_i), f_i = S_i (u_i - b_i): without a dead cell, which
    still carries load, the sums are wrong; C without its three rows is not.

    Cells of one axis, as under a plate, measure three of the six: the force along it and the moments about the others.
    The rest of w is 0, with the covariance of `errors`.

    Args:
        matrix: (a k, 6) C [V/N, V/(N m)], force first, about the origin of the surface's frame.
        noise: (a k, a k) covariance [V^2] or (a k,) standard deviations [V] of one reading.
        limits: (a k, 2) [V] lowest and highest reading; None: not known.
        covariance: (36, 36) of E, row by row: the true matrix is C (I + E); None: 0.
        positions: (k, 3) [m] of the cells, NaN where not known; None: all.
        indentation: law of the soft layer on the frame; None: rigid.
        bias: (a k,) [V] b in the calibration, with which later ones are compared; None: 0.
        drift: standard deviation of the bias's drift after the zero was taken, over that of a reading's noise.
        misfit: share of a reading's whitened length that C does not explain, in addition to noise.
        correlation: number of samples that count as one independent sample.
        samples: number used in the calibration.
        provenance: origin of the calibration.
        notes: on the calibration, one sentence each.
        axes: of the surface's frame that each cell measures: three, or one, for which all positions must be known.
        shear: of a touch, along each tangent, over its force: standard deviation, where cells of one axis do not
            measure it.

    Raises:
        InputError: a shape is wrong, a number is not finite, or the noise is not positive definite.
        NotIdentifiable: the matrix does not determine a wrench, or all cells lie on one line.
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
    axes: tuple[str, ...]
    shear: float

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
        axes: Sequence[str] = AXES,
        shear: float = SHEAR,
    ) -> None:
        rows = np.shape(matrix)[0] if np.ndim(matrix) == 2 else 0
        each = len(axes)
        if tuple(axes) not in LAYOUTS:
            raise InputError(f"axes must be x, y, z, or one of them, not {', '.join(axes)}.", where="load_cells")
        if rows < 3 * each or rows % each:
            raise InputError(f"load cells need {each} rows for each of at least three cells, not {rows} rows.")
        spread = np.asarray(noise, dtype=np.float64)
        vars(self).update(
            matrix=_shaped("matrix", matrix, (rows, 6)),
            noise=_shaped("noise", np.diag(spread**2) if spread.ndim == 1 else spread, (rows, rows)),
            limits=_shaped("limits", limits, (rows, 2), [-np.inf, np.inf]),
            covariance=_shaped("covariance", covariance, (36, 36)),
            positions=_shaped("positions", positions, (rows // each, 3), np.nan),
            indentation=indentation,
            bias=_shaped("bias", bias, (rows,)),
            drift=float(drift),
            misfit=float(misfit),
            correlation=float(correlation),
            samples=int(samples),
            provenance=MappingProxyType(dict(provenance or {})),
            notes=tuple(notes),
            axes=tuple(axes),
            shear=float(shear),
        )
        if each == 1 and not np.isfinite(self.positions).all():
            raise InputError("cells of one axis need positions: [x, y, z] in m of each cell.", where="load_cells")
        if not np.all(np.linalg.eigvalsh(self.noise) > 0):
            raise InputError("noise must be a positive definite covariance [V^2].", where="load_cells")
        require_layout(self.positions, self.axes)
        self.require_rank(np.ones(rows // each, dtype=bool))

    @property
    def cells(self) -> int:
        """Number of cells, k."""
        return len(self.matrix) // len(self.axes)

    @property
    def measured(self) -> Float[np.ndarray, "6 d"]:
        """Orthonormal wrenches (6, d) that the cells measure: all six, or three of cells of one axis."""
        return measured(self.axes)

    @property
    def errors(self) -> Float[np.ndarray, "36 36"]:
        """Covariance (36, 36) of E by the calibration, and by what cells of one axis miss, see `unmeasured`."""
        out, along = np.zeros((36, 36)), AXES.index(self.axes[0])
        for wrench in self.shear * unmeasured(self.axes, self.positions).T:
            slope = np.zeros((6, 6))
            slope[:, along], slope[3 + along, 3:] = wrench, -wrench[:3]
            out += np.outer(slope, slope)
        return self.covariance + out

    def label(self, channel: int) -> str:
        """Return the name of a channel, from 0, for messages, such as "channel x of cell 1", or "cell 1"."""
        cell, axis = divmod(channel, len(self.axes))
        return f"channel {self.axes[axis]} of cell {cell + 1}" if len(self.axes) > 1 else f"cell {cell + 1}"

    def channels(self, sound: Bool[np.ndarray, " some"] | None = None) -> Bool[np.ndarray, " m"]:
        """Return the mask (a k,) of the channels of sound cells (k,); of all for None; a mask (a k,) as it is.

        Raises:
            InputError: sound has another shape.
        """
        if sound is not None and len(sound) == len(self.matrix):
            return sound
        return np.repeat(np.ones(self.cells, dtype=bool) if sound is None else sound, len(self.axes))

    def inverse(
        self, sound: Bool[np.ndarray, " some"] | None = None
    ) -> tuple[Float[np.ndarray, "6 m"], Float[np.ndarray, "6 6"], Float[np.ndarray, "r m"]]:
        """Return the map from readings to wrenches by generalised least squares, its covariance, and what no wrench is.

        Args:
            sound: (k,) cells or (a k,) channels to use; None: all.

        Returns:
            A (6, a k) [N/V, N m/V] with w = A (u - b), 0 for unused channels; P (6, 6), the covariance of w from the
            noise of one reading, `complete`; and Q (r, a k) [1/V], the r = channels - d combinations of unit variance
            that no wrench makes, with d wrenches measured.

        Raises:
            InputError: sound has another shape.
            NotIdentifiable: the sound channels do not determine a wrench.
        """
        kept = self.channels(sound)
        self.require_rank(kept)
        lower = np.linalg.cholesky(self.noise[np.ix_(kept, kept)])
        white = np.linalg.solve(lower, np.eye(len(lower)))
        wrenches, d = self.measured, self.measured.shape[1]
        basis, upper = np.linalg.qr(white @ (self.matrix[kept] @ wrenches), mode="complete")
        solved = np.linalg.inv(upper[:d])
        inverse, rest = np.zeros((6, len(kept))), np.zeros((len(lower) - d, len(kept)))
        inverse[:, kept] = wrenches @ (solved @ basis[:, :d].T @ white)
        rest[:, kept] = basis[:, d:].T @ white
        return inverse, self.complete(wrenches @ (solved @ solved.T) @ wrenches.T), rest

    def complete(self, covariance: Float[np.ndarray, "6 6"]) -> Float[np.ndarray, "6 6"]:
        """Return the covariance (6, 6) of a wrench with shear and torque, if not measured, as unsure as the force.

        Raises:
            InputError: covariance has another shape.
        """
        unknown, along = unmeasured(self.axes, self.positions), AXES.index(self.axes[0])
        return covariance + covariance[along, along] * unknown @ unknown.T

    def wrenches(
        self, readings: Float[np.ndarray, "*batch m"], sound: Bool[np.ndarray, " some"] | None = None
    ) -> tuple[Float[np.ndarray, "*batch 6"], Float[np.ndarray, "*batch 6 6"]]:
        """Return wrenches (*batch, 6) [N, N m] and their covariances (*batch, 6, 6) from noise, drift and calibration.

        Args:
            readings: (*batch, a k) [V], u - b.
            sound: (k,) cells or (a k,) channels to use; None: all.

        Raises:
            InputError: arrays of other shapes.
            NotIdentifiable: the sound channels do not determine a wrench.
        """
        inverse, covariance, _ = self.inverse(sound)
        found = readings @ inverse.T
        return found, (1.0 + self.drift**2) * covariance + self.calibration_covariance(found)

    def calibration_covariance(self, wrenches: Float[np.ndarray, "*batch 6"]) -> Float[np.ndarray, "*batch 6 6"]:
        """Return the covariance (*batch, 6, 6) of E w in wrenches (*batch, 6) [N, N m], by `errors`.

        Raises:
            InputError: wrenches has another shape.
        """
        blocks = self.errors.reshape(6, 6, 6, 6)
        return np.einsum("iajb,...a,...b->...ij", blocks, wrenches, wrenches)

    def chi_square(
        self, readings: Float[np.ndarray, "*batch m"], sound: Bool[np.ndarray, " some"] | None = None
    ) -> Float[np.ndarray, "*batch"]:
        """Return the chi-square (*batch,) of readings, the squared residual of a fitted wrench over its variance.

        Its degrees of freedom are the used channels less the wrenches measured. The variance is that of noise,
        drift and misfit under load.

        Args:
            readings: (*batch, a k) [V], u - b.
            sound: (k,) cells or (a k,) channels to use; None: all.

        Raises:
            InputError: arrays of other shapes.
            NotIdentifiable: the sound channels do not determine a wrench.
        """
        inverse, _, rest = self.inverse(sound)
        left = np.sum((readings @ rest.T) ** 2, axis=-1)
        explained = readings @ inverse.T @ self.matrix[self.channels(sound)].T
        lower = np.linalg.cholesky(self.noise[np.ix_(self.channels(sound), self.channels(sound))])
        size = np.sum(np.linalg.solve(lower, explained[..., None])[..., 0] ** 2, axis=-1)
        return left / (1.0 + self.drift**2 + self.misfit**2 * size / len(rest)) if len(rest) else left

    def require_rank(self, sound: Bool[np.ndarray, " some"]) -> None:
        """Require that the sound cells (k,) or channels (a k,) determine the wrenches that such cells measure.

        Raises:
            InputError: sound has another shape.
            NotIdentifiable: they do not; it names the directions that they do not measure.
        """
        kept, wrenches = self.channels(sound), self.measured
        scaled = self.matrix[kept] / np.sqrt(np.diag(self.noise))[kept, None]
        scaled = scaled * [1.0, 1.0, 1.0, LENGTH, LENGTH, LENGTH] @ wrenches
        count = np.count_nonzero(kept)
        if count < wrenches.shape[1]:
            raise NotIdentifiable(
                f"only {count // len(self.axes)} of the load cells work, and a wrench needs three: leave fewer out, or "
                "repair.",
                rank=int(count),
                missing=("wrench",),
            )
        _, values, directions = np.linalg.svd(scaled)
        require_directions(
            values > FLATTEST * values[0],
            directions @ wrenches.T,
            "the cells do not measure {}: their readings are the same with and without it. "
            "Cells in line cannot measure the moment about their line; place one away from that line.",
        )

    def __repr__(self) -> str:
        return one_line(self)


def measured(axes: tuple[str, ...]) -> Float[np.ndarray, "6 d"]:
    """Return orthonormal wrenches (6, d) that cells measure: of one axis a, force along a and moments about the others.

    They do not depend on the origin: a force along a has no moment about a.
    """
    if len(axes) != 1:
        return np.eye(6)
    along = AXES.index(axes[0])
    return np.eye(6)[:, [along, 3 + (along + 1) % 3, 3 + (along + 2) % 3]]


def unmeasured(axes: tuple[str, ...], positions: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "6 e"]:
    """Return the wrenches (6, e) that cells do not measure: shear of 1 N in their plane, and 0.01 N m about the axis.

    They are the null space of C. Cells of three axes have none. A force F a at the point p with a shear e F t has the
    moment of p x e F t too. In the cells' plane, where the others measure M, its part along a is -e t . M; above that
    plane, shear displaces the measured point.
    """
    if len(axes) != 1:
        return np.zeros((6, 0))
    along, out = AXES.index(axes[0]), np.zeros((6, 3))
    shear = np.eye(3)[[(along + 1) % 3, (along + 2) % 3]]
    out[:3, :2] = shear.T
    out[3:, :2] = float(positions[:, along].mean()) * np.cross(np.eye(3)[along], shear).T
    out[3 + along, 2] = LENGTH
    return out


@takes_arrays
def require_layout(positions: Float[np.ndarray, "k 3"], axes: Sequence[str] = AXES) -> None:
    """Require that cells are not all on one line: forces there have no moment about it [load cells, (4)].

    Args:
        positions: (k, 3) [m]; nothing is checked if one is not finite.
        axes: that each cell measures; cells of one axis must not be on one line as seen along it.

    Raises:
        InputError: positions has another shape.
        NotIdentifiable: all cells lie on one line or at one point.
    """
    if not np.isfinite(positions).all():
        return
    centred = positions - positions.mean(axis=0)
    if len(axes) == 1:
        centred = np.where(np.isin(AXES, axes), 0.0, centred)
    _, values, lines = np.linalg.svd(centred)
    if values[0] > 0 and values[1] > IN_LINE * values[0]:
        return
    if values[0] == 0:
        raise NotIdentifiable("all cells are at one point, so they measure no moment.", rank=3, missing=("torque",))
    axis = _named_axis(lines[0])
    raise NotIdentifiable(
        f"all {len(positions)} cells are in line along {axis}: forces at points of a line have no moment about it, "
        f"so the torque about {axis} cannot be measured. Place one cell away from the line.",
        rank=5,
        missing=(f"torque about {axis}",),
    )


def require_directions(known: Bool[np.ndarray, " d"], directions: Float[np.ndarray, "d 6"], problem: str) -> None:
    """Require that all directions of the wrench are known.

    Args:
        known: mask (d,) of the directions.
        directions: (d, 6), a direction per row: force, and torque / 0.01 m.
        problem: message, with {} in place of the missing directions.

    Raises:
        NotIdentifiable: a direction is not known.
    """
    if not known.all():
        missing = tuple(_wrench_direction(row) for row in directions[~known])
        raise NotIdentifiable(problem.format(" and ".join(missing)), rank=int(known.sum()), missing=missing)


def _wrench_direction(direction: Float[np.ndarray, "6"]) -> str:
    """Return a direction (6,) of `require_directions` in words, such as "force along x with torque about z"."""
    force, torque = direction[:3], direction[3:]
    parts = [
        f"{word} {_named_axis(part)}"
        for word, part in (("force along", force), ("torque about", torque))
        if np.linalg.norm(part) > 0.3 * np.linalg.norm(direction)
    ]
    return " with ".join(parts)


def _named_axis(axis: Float[np.ndarray, "3"]) -> str:
    """Return an axis (3,) as text: "x", "y" or "z" within 11 degrees, else as "(0.71, 0.71, 0.00)"."""
    unit = axis / np.linalg.norm(axis)
    largest = int(np.abs(unit).argmax())
    unit = unit * np.sign(unit[largest])
    if unit[largest] > 0.98:  # 11 degrees
        return "xyz"[largest]
    return "(" + ", ".join(f"{value:.2f}" for value in unit + 0.0) + ")"


def with_changes(cells: LoadCells, **changes: Any) -> LoadCells:
    """Return new `LoadCells` with some fields changed.

    Raises:
        InputError: a value is none that `LoadCells` takes.
        NotIdentifiable: a new matrix does not determine a wrench, or new positions lie on one line.
    """
    return LoadCells(**(vars(cells) | changes))


def _shaped(
    name: str, values: ArrayLike | None, shape: tuple[int, ...], unknown: ArrayLike = 0.0
) -> Float[np.ndarray, "..."]:
    array = frozen(np.full(shape, unknown) if values is None else values)
    if array.shape != shape or not (name in ("positions", "limits") or np.isfinite(array).all()):  # there NaN, inf mean
        seen = f"shape {array.shape}" if array.shape != shape else "numbers that are not finite"
        raise InputError(f"{name} must be {shape} finite numbers, not {seen}.", where="load_cells")
    return array
