"""From the voltages of load cells under an elliptic cylinder to contacts, in one compiled step."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy.typing import ArrayLike

from palpate.contact.estimate import ROW, ContactEstimate, Status
from palpate.errors import InputError, NotIdentifiable
from palpate.sensors.load_cell_zero import Zero, take_zero
from palpate.sensors.load_cells import LoadCells
from palpate.surfaces import EllipticCylinder, Surface

__all__ = ["WANTED", "Fingertip"]

METHODS = ("soft_finger", "wrench_axis")
COLUMNS = 32  # of the factor of the calibration's covariance
LANES = 16  # outputs of a mapping are a multiple of it: the compiler adds so many at a time
CHANCE = 1e-6  # that sound cells leave more than the bound
WANTED = 2e-3  # m: the accuracy that the paper asks for


class Fingertip:
    """Prepared: what does not depend on the sample is computed here, and the loops are compiled.

    A sample is answered from all cells, or, where those contradict each other, from the subset without one cell that
    does not (see `LoadCells`); what one sample leaves to the next is whether it touched, and how much each cell was to
    blame. With more than one bad cell, or one among three, the sample is INVALID. A cell at its range is left out; two
    at it make the sample SATURATED.

    Args:
        cells: the model.
        surface: an `EllipticCylinder`, in the frame of the cells' matrix.
        method: "soft_finger" (force, and torque about the normal) or "wrench_axis" (a force alone: the wrench is first
            taken to the nearest without moment along the force, which sharpens the point where there is no torque).
        friction: bound on tan(theta), theta between -force and normal.
        torsion: bound on |torque|/|F . n| [m].
        accuracy: [m] 3-D standard deviation above which the answer is TOO_LIGHT; None: none.
        on, off: force [N] from which there is a contact, and below which there is none any more. None: 10 and 5 times
            the noise.
        sound: (k,) cells to use; None: all.

    Raises:
        InputError: another surface, an unknown method, or bounds that are not positive.
        NotIdentifiable: the sound cells tell no wrench.
    """

    def __init__(
        self,
        cells: LoadCells,
        surface: Surface,
        method: str = "soft_finger",
        friction: float = 1.0,
        torsion: float = 5e-3,
        accuracy: float | None = None,
        on: float | None = None,
        off: float | None = None,
        sound: Bool[np.ndarray, " k"] | None = None,
    ) -> None:
        from palpate.contact import _fingertip  # compiled: loaded when first needed

        if not isinstance(surface, EllipticCylinder) or not _is_identity(surface):
            raise InputError(
                "load cells are read under an elliptic cylinder along y about the origin.",
                where="surface",
                mend='Take kind = "elliptic_cylinder" with a, b and half_length.',
            )
        if method not in METHODS:
            raise InputError(f"unknown method {method!r}.", mend=f"Use one of {', '.join(METHODS)}.")
        if not (friction > 0 and torsion >= 0 and (accuracy is None or accuracy > 0)):
            raise InputError(f"friction ({friction}) and accuracy ({accuracy}) must be > 0, torsion ({torsion}) >= 0.")
        self.cells, self.surface, self.method = cells, surface, method
        self.friction, self.torsion, self.accuracy = float(friction), float(torsion), accuracy
        self.sound = np.ones(cells.cells, dtype=bool) if sound is None else np.array(sound, dtype=bool)
        self._mappings, self._spreads, self._bounds = _subsets(cells, self.sound)
        noise = float(np.sqrt(np.diag(self._spreads[0])[:3].max()))
        self.on = max(10.0 * noise, off or 0.0) if on is None else float(on)
        self.off = min(0.5 * self.on, 5.0 * noise) if off is None else float(off)
        if not 0 <= self.off <= self.on:
            raise InputError(f"contact thresholds must be 0 <= off <= on; got on = {self.on}, off = {self.off} N.")
        self._metric = _metric(cells)
        self._doubts = _doubts(cells.covariance)
        law = cells.indentation
        self._settings = np.zeros(_fingertip.SETTINGS)
        for place, value in (
            (_fingertip.A, surface.a),
            (_fingertip.B, surface.b),
            (_fingertip.HALF, surface.half_length),
            (_fingertip.DEPTH, 0.0 if law is None else law.depth),
            (_fingertip.EXPONENT, 1.0 if law is None else law.exponent),
            (_fingertip.FRICTION, self.friction),
            (_fingertip.TORSION, self.torsion),
            (_fingertip.ON, self.on),
            (_fingertip.OFF, self.off),
            (_fingertip.ACCURACY, accuracy or 0.0),
            (_fingertip.PURE, float(method == "wrench_axis")),
            (_fingertip.DRIFT, cells.drift),
            (_fingertip.MISFIT, cells.misfit),
            (_fingertip.UPPER, float(surface.upper)),
        ):
            self._settings[place] = value
        self._many: Callable[..., Any] = _fingertip.contacts
        self._single: Callable[..., Any] = _fingertip.one_contact
        self._limits = cells.limits.copy()
        self._reading, self._which = np.zeros((1, len(cells.matrix))), np.zeros(1, np.int64)
        self._state, self.zero = np.zeros(1 + 4 * cells.cells), Zero(cells.bias)
        self.set_zero(self.zero)
        self(cells.bias, self.empty())
        self.reset()

    @staticmethod
    def empty(*batch: int) -> Float[np.ndarray, "*batch 22"]:
        """Rows to write into; `ContactEstimate.from_rows` names what is in them."""
        return np.full((*batch, ROW.length), np.nan)

    def reset(self) -> None:
        """Forget whether it touched, and what was blamed; not the zero."""
        self._state[:] = 0.0
        self._state[1 + self.cells.cells :] = np.nan

    def set_zero(self, zero: Zero) -> None:
        """What the cells read unloaded; its variance goes into every covariance."""
        self.zero = zero
        self._bias = zero.voltage.copy()
        self._noise = self._spreads * (1.0 + zero.share + self.cells.drift**2)

    def tare(self, voltages: Float[np.ndarray, "n m"], where: str = "") -> Zero:
        """Take the zero from a window in which nothing touches, from now on; then `reset`.

        Raises:
            InputError: the window does not stand still, or is too short.
        """
        zero = take_zero(self.cells, voltages, where)
        if zero.touch is not None and not self._presses(zero.touch):
            zero = replace(zero, doubt="", touch=None)
        self.set_zero(zero)
        self.reset()
        return zero

    def __call__(self, voltages: ArrayLike, out: Float[np.ndarray, "22"]) -> None:
        """Voltages (m,) to a row of `empty()`; carries the hysteresis. What a control loop calls."""
        self._reading[0] = voltages
        self._run(self._reading, out.reshape(1, -1), self._which)

    def run(self, voltages: Float[np.ndarray, "n m"]) -> ContactEstimate:
        """Contacts of a time series of voltages, in the surface's frame; carries the hysteresis."""
        return ContactEstimate.from_rows(self.run_into(self.empty(len(voltages)), voltages)[0])

    def run_into(
        self, rows: Float[np.ndarray, "n 22"], voltages: Float[np.ndarray, "n m"]
    ) -> tuple[Float[np.ndarray, "n 22"], Int[np.ndarray, " n"]]:
        """`run` into rows; also which subset answered: 0 all, 1 + i without cell i, negative none."""
        which = np.empty(len(voltages), np.int64)
        self._run(np.require(voltages, np.float64, ["C", "W"]), rows, which)
        return rows, which

    def _run(self, voltages: np.ndarray, rows: np.ndarray, which: np.ndarray) -> None:
        self._many(
            voltages,
            self._bias,
            self._limits,
            self._mappings,
            self._metric,
            self._noise,
            self._bounds,
            self._doubts,
            self._settings,
            self._state,
            rows,
            which,
        )

    def smallest_force(self, point: ArrayLike, direction: ArrayLike, accuracy: float = WANTED) -> float:
        """Force [N] from which a touch is located within an accuracy, the 3-D standard deviation [m].

        Noise of a reading and of the zero err as 1/F, the calibration by the same at every force: s_n^2/F^2 + s_c^2.

        Args:
            point: (3,) [m] of the surface.
            direction: (3,) of the force on it, of any length.
            accuracy: [m].

        Returns:
            inf where the calibration alone errs by more.
        """
        push = np.asarray(direction, dtype=np.float64)
        push = push / np.linalg.norm(push)
        wrench = np.concatenate([push, np.cross(np.asarray(point, dtype=np.float64), push)])
        noise, doubt = self._deviation(wrench, calibrated=False), self._deviation(wrench, calibrated=True)
        left = accuracy**2 - max(0.0, doubt**2 - noise**2)
        return float(noise / np.sqrt(left)) if left > 0 else np.inf

    def _presses(self, wrench: Float[np.ndarray, "6"]) -> bool:
        """Whether a touch of the surface makes such a wrench."""
        row = self.empty()
        self._single(wrench.copy(), self._noise[:1].copy(), self._doubts, self._settings, row, np.zeros((2, 6)))
        return bool(row[ROW.status] == Status.CONTACT)

    def _deviation(self, wrench: Float[np.ndarray, "6"], *, calibrated: bool) -> float:
        """3-D standard deviation [m] of the point of a wrench of 1 N, rigid."""
        from palpate.contact._fingertip import ACCURACY, DEPTH, FRICTION, OFF, ON, TORSION

        row, settings = self.empty(), self._settings.copy()
        settings[[DEPTH, ON, OFF, ACCURACY]] = 0.0
        settings[[FRICTION, TORSION]] = np.inf
        doubts = self._doubts if calibrated else np.zeros((36, 0))
        self._single(wrench.copy(), self._noise[:1].copy(), doubts, settings, row, np.zeros((2, 6)))
        return float(np.sqrt(row[10] + row[14] + row[18]))


def _is_identity(surface: EllipticCylinder) -> bool:
    return bool(np.all(surface.pose.rotation == np.eye(3)) and not surface.pose.translation.any())


def _subsets(
    cells: LoadCells, sound: Bool[np.ndarray, " k"]
) -> tuple[Float[np.ndarray, "s m o"], Float[np.ndarray, "s 6 6"], Float[np.ndarray, " s"]]:
    """Of the sound cells, and without each: what maps voltages, the spread, and the bound of what is left."""
    from scipy.stats import chi2

    rows = len(cells.matrix)
    whole = [sound, *(sound & (np.arange(cells.cells) != cell) for cell in range(cells.cells))]
    width = -(-rows // LANES) * LANES
    mappings, spreads, bounds = np.zeros((len(whole), rows, width)), np.zeros((len(whole), 6, 6)), -np.ones(len(whole))
    for s, kept in enumerate(whole):
        if s and not sound[s - 1]:
            continue
        try:
            inverse, spreads[s], rest = cells.inverse(kept)
        except NotIdentifiable:
            if not s:
                raise
            continue
        mappings[s, :, :6] = inverse.T
        mappings[s, :, 6 : 6 + len(rest)] = rest.T
        bounds[s] = float(chi2.isf(CHANCE, len(rest))) if len(rest) else 0.0
    if bounds[0] == 0.0:
        bounds[0] = np.inf  # nothing to judge by
    return mappings, spreads, bounds


def _metric(cells: LoadCells) -> Float[np.ndarray, "6 6"]:
    """Squared length of a wrench in whitened voltages, a degree of freedom of what is left."""
    return cells.matrix.T @ np.linalg.solve(cells.noise, cells.matrix) / max(1, len(cells.matrix) - 6)


def _doubts(covariance: Float[np.ndarray, "36 36"]) -> Float[np.ndarray, "36 q"]:
    """D with D D' a covariance that may lack rank; in units in which its diagonal is 1.

    Of 36 columns the 32 largest stay, made larger by what the others held: processors work on four or eight at a time.
    """
    if not covariance.any():
        return np.zeros((36, 0))
    scale = np.sqrt(np.diag(covariance))
    scale = np.where(scale > 0, scale, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    values = np.maximum(values, 0.0)
    kept = values[-COLUMNS:] * (values.sum() / values[-COLUMNS:].sum())
    return np.ascontiguousarray(scale[:, None] * vectors[:, -COLUMNS:] * np.sqrt(kept))
