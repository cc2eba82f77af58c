"""`palpate design load-cells`: predict what a layout of force cells can resolve, before it is built."""

from __future__ import annotations

from collections.abc import Iterator
from math import inf
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from palpate.console.console import lines, note, title
from palpate.console.options import Output
from palpate.errors import InputError
from palpate.files.atomic import keep_inputs, write_text
from palpate.sensors.load_cells.design_report import Design, compose, tiles, warnings
from palpate.sensors.load_cells.model import LoadCells
from palpate.sensors.load_cells.resolution import nominal_cells
from palpate.sensors.load_cells.section import LoadCellSection, RigLoadCells
from palpate.setup import load_rig
from palpate.viewer.report import render, require_report

__all__ = ["design_load_cells"]

STEP = 0.25  # relative change of the cells' distances in the variants


def design_load_cells(
    rig: Annotated[Positional[Path], arg(metavar="RIG")],
    /,
    output: Output,
    accuracy: Annotated[float, arg(metavar="X")] = 2e-3,
    force: Annotated[float, arg(metavar="X")] = 1.0,
    friction: Annotated[float, arg(metavar="X")] = 0.5,
    tared: Annotated[float, arg(metavar="N")] = 100.0,
) -> None:
    """Draw what a layout of load cells can resolve.

    Draw how well place, force and torque can be known over the surface, and the smallest force that will do.

    Args:
        rig: TOML with a [surface] and [load_cells]: positions, noise and sensitivity, or a calibrated model.
        output: page to write, HTML.
        accuracy: wanted accuracy of the place [m], root mean square in three dimensions.
        force: force that the maps are drawn for [N].
        friction: tangent of the angle between force and normal; the worst direction counts.
        tared: number of independent readings that the bias is taken from.

    Raises:
        InputError: a number is not allowed, rig or model cannot be read, the rig lacks [surface], [load_cells] or a
            key, the page cannot be written or would replace an input, or the package for reports is not installed.
        NotIdentifiable: the cells do not determine a wrench.
    """
    require_report()
    for name, value in (("accuracy", accuracy), ("force", force), ("tared", tared)):
        if not 0 < value < inf:
            raise InputError(f"--{name} must be positive, not {value:g}.")
    if not 0 <= friction < inf:
        raise InputError(f"--friction must not be negative, not {friction:g}.")
    stated = load_rig(rig)
    keep_inputs(output, (rig, *stated.files().values()))
    setup = stated.resolve()
    surface, frame = setup.link.surface(), setup.of(LoadCellSection)
    cells = frame.nominal()
    design = Design(rig.name, cells, surface, accuracy, force, friction, tared, tuple(_variants(frame.table, cells)))
    write_text(output, render(compose(design)))
    title(f"{rig} -> {output}")
    lines([(tile.name, f"{tile.value} {tile.word}".rstrip()) for tile in tiles(design)])
    note(warnings(design), "warning")


def _variants(table: RigLoadCells, cells: LoadCells) -> Iterator[tuple[str, LoadCells]]:
    """Yield names and cells of changed layouts, to compare; none for a calibrated model."""
    places = cells.positions
    if table.model is not None or table.sensitivity is None or table.noise is None:
        return
    middle, drift = places.mean(axis=0), cells.drift * table.noise
    for name, spread, noise in (
        ("half the noise", 1.0, 0.5),
        (f"cells {100 * STEP:g} % nearer together", 1.0 - STEP, 1.0),
        (f"cells {100 * STEP:g} % further apart", 1.0 + STEP, 1.0),
    ):
        moved = middle + spread * (places - middle)
        yield name, nominal_cells(moved, table.sensitivity, noise * table.noise, table.range or inf, drift=drift)
