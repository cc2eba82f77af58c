"""Load cells as TOML, the same to the last bit when read back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit

from palpate.errors import InputError, NotIdentifiable
from palpate.io.atomic import write_text
from palpate.io.models import load_model, toml_array
from palpate.io.strict import covariance_matrix, parse
from palpate.sensors.load_cells import Indentation, LoadCells

__all__ = ["read_load_cells", "write_load_cells"]

UNBOUNDED = 1e18  # V: stands for a range that is not known
Rows = tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class _IndentationTable:
    """The law of a soft layer."""

    depth: float
    exponent: float
    covariance: Rows = ((0.0, 0.0), (0.0, 0.0))

    def value(self) -> Indentation:
        """As a value."""
        return Indentation(self.depth, self.exponent, np.array(self.covariance))


@dataclass(frozen=True)
class _LoadCellsFile:
    """A model of load cells as its file spells it; a cell whose place is not known has an empty list."""

    kind: str
    matrix: Rows
    noise: Rows
    covariance: Rows
    bias: tuple[float, ...]
    limits: Rows
    positions: Rows = ()
    drift: float = 0.0
    misfit: float = 0.0
    correlation: float = 1.0
    samples: int = 0
    indentation: _IndentationTable | None = None
    notes: tuple[str, ...] = ()
    provenance: Mapping[str, Any] = field(default_factory=lambda: {})

    def __post_init__(self) -> None:
        covariance_matrix(self.covariance, 36, "covariance")
        covariance_matrix(self.noise, len(self.matrix), "noise")
        for name, rows, width in (("matrix", self.matrix, 6), ("limits", self.limits, 2)):
            if len(rows) != len(self.matrix) or any(len(row) != width for row in rows):
                raise ValueError(f"{name} must be {len(self.matrix)} rows of {width} numbers")
        if any(len(row) not in (0, 3) for row in self.positions):
            raise ValueError("positions must be three numbers a cell, or none")
        if self.misfit < 0 or self.drift < 0 or self.correlation < 1 or self.samples < 0:
            raise ValueError("misfit, drift and samples must not be negative, and correlation at least 1")

    def cells(self) -> LoadCells:
        """As a value."""
        limits = np.array(self.limits)
        return LoadCells(
            np.array(self.matrix),
            np.array(self.noise),
            limits=np.where(np.abs(limits) >= UNBOUNDED, np.sign(limits) * np.inf, limits),
            covariance=np.array(self.covariance),
            positions=np.array([row or (np.nan,) * 3 for row in self.positions]) if self.positions else None,
            indentation=None if self.indentation is None else self.indentation.value(),
            bias=np.array(self.bias),
            drift=self.drift,
            misfit=self.misfit,
            correlation=self.correlation,
            samples=self.samples,
            provenance={name: str(said) for name, said in self.provenance.items()},
            notes=self.notes,
        )


def write_load_cells(path: Path, cells: LoadCells) -> None:
    """Write a model of load cells."""
    document = tomlkit.document()
    document.add(
        tomlkit.comment("Cells under a rigid frame: u = C (I + E) w + b. Written by `palpate calibrate load-cells`.")
    )
    document.add("kind", tomlkit.item("load_cells"))
    law = cells.indentation
    plain = {
        "drift": (cells.drift, "of the zero after it was taken, in standard deviations of a reading"),
        "misfit": (cells.misfit, "share of a reading that no wrench explains"),
        "correlation": (cells.correlation, "samples that tell as much as one independent sample"),
        "samples": (cells.samples, "of the calibration"),
        "bias": (cells.bias.tolist(), "V, of each channel, in the calibration"),
    }
    for name, (value, comment) in plain.items():
        document.add(name, tomlkit.item(value).comment(comment))
    limits = np.clip(cells.limits, -UNBOUNDED, UNBOUNDED)
    places: list[list[float]] = [row.tolist() if np.isfinite(row).all() else [] for row in cells.positions]
    tables: tuple[tuple[str, list[list[float]], str], ...] = (
        ("positions", places, "m, of the cells, as far as they are known"),
        ("limits", limits.tolist(), "V, lowest and highest of each channel; 1e18 is none"),
        ("matrix", cells.matrix.tolist(), "C: V/N and V/(N m), channel by channel, force first"),
        ("noise", cells.noise.tolist(), "V^2, covariance of one reading"),
        ("covariance", cells.covariance.tolist(), "of E, row by row: 36 x 36"),
    )
    for name, rows, comment in tables:
        document.add(tomlkit.comment(comment))
        document.add(name, toml_array(rows) if all(rows) else tomlkit.item(rows))
    document.add("notes", tomlkit.item(list(cells.notes)))
    if law is not None:
        table = {"depth": law.depth, "exponent": law.exponent, "covariance": law.covariance.tolist()}
        document.add("indentation", tomlkit.item(table))
    document.add("provenance", tomlkit.item(dict(cells.provenance)))
    write_text(path, tomlkit.dumps(document))


def read_load_cells(path: Path) -> LoadCells:
    """Read a model of load cells back.

    Raises:
        InputError: not one, a key misspelt or missing, a value of the wrong kind, or cells that tell no wrench.
    """
    table = load_model(path, "load_cells", "a model of load cells", "palpate calibrate load-cells")
    stated = parse(table, _LoadCellsFile, file=str(path))
    try:
        return stated.cells()
    except (InputError, NotIdentifiable) as problem:  # it does not know its file
        raise InputError(str(problem), where=str(path)) from problem
