"""The rig's table of load cells, as a person writes it."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from pathlib import Path

import numpy as np

from palpate.contact.resolution import nominal_cells
from palpate.errors import InputError
from palpate.io.load_cells import read_load_cells
from palpate.io.logs.layout import ArrayChannel
from palpate.sensors.load_cells import LoadCells, with_changes
from palpate.sensors.recording import REFERENCE, VOLTAGE

__all__ = ["VOLT_UNITS", "RigLoadCells"]

VOLT_UNITS = {"V": 1.0, "mV": 1e-3, "uV": 1e-6}
Three = tuple[float, float, float]
REFERENCE_COLUMNS = ("ref_fx", "ref_fy", "ref_fz", "ref_x", "ref_y", "ref_z")


@dataclass(frozen=True)
class RigLoadCells:
    """Cells under a rigid frame, and where the log keeps their voltages.

    `model` is the file of `palpate calibrate load-cells`; `columns`, three a cell, or a `topic` of arrays with so many
    numbers; `units` of them (one, or one each). What is known beforehand, for a calibration or a design: `positions`
    [m] of the cells in the surface's frame, `noise` [V] of a reading, `range` [V], `sensitivity` [N/V]. `drift` [V] of
    the zero within a session; `without` names bad cells, counted from 1; `accuracy` [m] wanted: what is less sure is
    too_light.
    For a calibration: `reference` columns of force [N] on the fingertip and of the ball's centre [m], the `ball`'s
    diameter [m], and `indentation` true where the surface is soft.
    """

    model: str | None = None
    columns: tuple[str, ...] = ()
    topic: str | None = None
    units: str | tuple[str, ...] = "V"
    positions: tuple[Three, ...] | None = None
    noise: float | None = None
    range: float | None = None
    sensitivity: float | None = None
    drift: float | None = None
    without: tuple[int, ...] = ()
    accuracy: float | None = None
    reference: tuple[str, str, str, str, str, str] = REFERENCE_COLUMNS
    ball: float = 4e-3
    indentation: bool = False

    def __post_init__(self) -> None:
        if self.columns and (len(self.columns) < 9 or len(self.columns) % 3):
            raise ValueError(f"columns must be three for each of at least three cells, not {len(self.columns)}")
        if len(set(self.columns)) < len(self.columns):
            twice = next(name for name in self.columns if self.columns.count(name) > 1)
            raise ValueError(f"column {twice!r} is named twice")
        if not isinstance(self.units, str) and len(self.units) != len(self.columns):
            raise ValueError(f"units must be one, or one for each of the {len(self.columns)} columns")
        stated = [self.units] if isinstance(self.units, str) else self.units
        unknown = [unit for unit in stated if unit not in VOLT_UNITS]
        if unknown:
            raise ValueError(f"unit {unknown[0]!r} is not one of {', '.join(VOLT_UNITS)}")
        for name in ("noise", "range", "sensitivity", "drift", "accuracy", "ball"):
            value = getattr(self, name)
            if value is not None and not 0 < value < inf:
                raise ValueError(f"{name} must be positive")

    def names(self, cells: int) -> tuple[str, ...]:
        """Of the columns: u1x, u1y, u1z, u2x, ... where none are named."""
        return self.columns or tuple(f"u{cell + 1}{axis}" for cell in range(cells) for axis in "xyz")

    def count(self, model: LoadCells | None = None) -> int:
        """How many cells: of the model, the columns or the positions; else the paper's four."""
        if model is not None:
            return model.cells
        return len(self.columns) // 3 or (len(self.positions) if self.positions else 4)

    def channels(self, cells: int, *, bench: bool) -> tuple[ArrayChannel, ...]:
        """The voltages in a log, and the reference beside them in one of their bench."""
        units = [self.units] * (3 * cells) if isinstance(self.units, str) else self.units
        volts = tuple(VOLT_UNITS[unit] for unit in units)
        voltage = ArrayChannel(VOLTAGE, (3 * cells,), self.names(cells), self.topic, volts, "load_cells")
        reference = ArrayChannel(REFERENCE, (6,), self.reference, table="load_cells")
        return (voltage, reference) if bench else (voltage,)

    def places(self) -> np.ndarray | None:
        """(k, 3) [m], if they are stated."""
        return None if self.positions is None else np.array(self.positions)

    def limits(self, cells: int) -> np.ndarray | None:
        """(3 k, 2) [V], if the range is stated."""
        return None if self.range is None else np.tile([-self.range, self.range], (3 * cells, 1))

    def path(self, folder: Path) -> Path | None:
        """Of the model, if one is named."""
        return None if self.model is None else folder / self.model

    def cells(self, folder: Path) -> LoadCells:
        """The calibrated model, with what the rig states over it.

        Raises:
            InputError: no model is named, or it does not fit the rig.
        """
        path = self.path(folder)
        if path is None:
            raise InputError(
                "the cells are not calibrated.",
                where="load_cells.model",
                mend="`palpate calibrate load-cells LOG --rig RIG -o fingertip.toml`, then name that file as model.",
            )
        model = read_load_cells(path)
        if self.columns and len(self.columns) != len(model.matrix):
            raise InputError(
                f"names {len(self.columns)} columns, and {path.name} has {model.cells} cells.",
                where="load_cells.columns",
            )
        unknown = [cell for cell in self.without if not 1 <= cell <= model.cells]
        if unknown:
            raise InputError(
                f"cell {unknown[0]} is none of the {model.cells} (counted from 1).", where="load_cells.without"
            )
        noise = float(np.sqrt(np.median(np.diag(model.noise))))
        changes: dict[str, object] = {}
        if self.range is not None:
            changes["limits"] = self.limits(model.cells)
        if self.drift is not None:
            changes["drift"] = self.drift / noise
        if self.noise is not None:
            changes["noise"] = np.full(len(model.matrix), self.noise)
        return with_changes(model, **changes) if changes else model

    def nominal(self, folder: Path) -> LoadCells:
        """The calibrated model, or what positions, sensitivity and noise say that it will be.

        Raises:
            InputError: neither can be had.
        """
        if self.model is not None:
            return self.cells(folder)
        if self.positions is None or self.sensitivity is None or self.noise is None:
            raise InputError(
                "positions, sensitivity and noise must be stated where there is no model.",
                where="load_cells",
                mend="positions = [[x, y, z], ...] in m, sensitivity in N/V, noise in V.",
            )
        return nominal_cells(np.array(self.positions), self.sensitivity, self.noise, self.range or inf)
