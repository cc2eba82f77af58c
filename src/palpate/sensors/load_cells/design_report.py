"""Compose the page of a design of load cells: maps and curves of its resolution, and those of variants."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from palpate.errors import NotIdentifiable
from palpate.sensors.load_cells.model import LoadCells
from palpate.sensors.load_cells.resolution import Resolution, resolution
from palpate.surfaces import Surface
from palpate.viewer import maps
from palpate.viewer.report import Picture, Report, ReportTable, Section, Tile, picture

STEEPEST = 0.2  # cosine between normal and view: steeper parts are hardly seen from there
REACH = np.geomspace(3e-3, 30.0, 81)  # N: forces of the curves
EVEN = 0.01  # relative difference below which a map would be one colour


@dataclass(frozen=True, eq=False)
class Design:
    """Cells under a surface, and the accuracy wanted of them.

    Attributes:
        name: name of the rig.
        cells: calibrated model, or the one predicted from the layout.
        surface: touched surface.
        accuracy: [m] wanted accuracy of the place.
        force: [N] of the maps.
        friction: tangent of the angle between force and normal.
        tared: number of independent readings of the bias.
        variants: pairs (name of the difference, cells) of other layouts to compare with.
    """

    name: str
    cells: LoadCells
    surface: Surface
    accuracy: float = 2e-3
    force: float = 1.0
    friction: float = 0.5
    tared: float = 100.0
    variants: tuple[tuple[str, LoadCells], ...] = ()

    @cached_property
    def places(self) -> tuple[Float[np.ndarray, "v 3"], Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"]]:
        """Points (v, 3) [m] of the surface, outward unit normals (v, 3), and triangles (f, 3) between them.

        Raises:
            GeometryError: an implicit surface cannot be drawn.
        """
        mesh = self.surface.drawn()
        points, normals, _ = self.surface.project(mesh.vertices)
        return points, normals, mesh.faces

    @cached_property
    def view(self) -> tuple[int, float]:
        """Axis (0 to 2) and side (+-1) that most of the surface faces; of a closed body, away from the cells."""
        points, normals, _ = self.places
        looks = normals.mean(axis=0)
        if np.linalg.norm(looks) < STEEPEST and np.isfinite(self.cells.positions).all():
            looks = points.mean(axis=0) - self.cells.positions.mean(axis=0)
        axis = int(np.abs(looks).argmax())
        return axis, 1.0 if looks[axis] >= 0 else -1.0

    @cached_property
    def seen(self) -> Bool[np.ndarray, " v"]:
        """Mask (v,) of the points that face the side of `view`: those of maps and figures."""
        axis, side = self.view
        return side * self.places[1][:, axis] > STEEPEST

    @cached_property
    def found(self) -> Resolution:
        """`Resolution` at all points; NaN where they are not `seen`.

        Raises:
            InputError: `tared` is not positive, or `friction` is negative.
            NotIdentifiable: the cells do not determine a wrench.
        """
        return self.with_changes()

    def with_changes(self, **changes: Any) -> Resolution:
        """Return the `Resolution` with other arguments of `resolution`; NaN where points are not `seen`.

        Args:
            changes: `cells`, `friction`, `tare` or `sound`.

        Raises:
            InputError: `tare` is not positive, or `friction` is negative.
            NotIdentifiable: the sound cells do not determine a wrench.
        """
        points, normals, _ = self.places
        arguments: dict[str, Any] = {"cells": self.cells, "friction": self.friction, "tare": self.tared, **changes}
        made = resolution(points=points, normals=normals, **arguments)
        return Resolution(**{name: np.where(self.seen, value, np.nan) for name, value in vars(made).items()})


def compose(design: Design) -> Report:
    """Return the design's page as a `Report`.

    Raises:
        InputError: `tared` is not positive, `friction` is negative, or the package for reports is not installed.
    """
    known = "their calibration" if design.cells.samples else "the layout and the noise alone, before they are built"
    sections = (_maps(design), _curves(design), _dead(design), _variants(design), _facts(design))
    return Report(
        title=f"What {design.name} can resolve",
        summary=f"{design.cells.cells} force cells under a rigid frame: how well place, force and torque of a touch "
        f"can be known, from {known}.",
        tiles=tuple(tiles(design)),
        warnings=tuple(warnings(design)),
        sections=tuple(section for section in sections if section.pictures or section.tables or section.settings),
        footer="To first order in the noise; root mean squares in three dimensions, of single readings. Forces and "
        "points in the surface's frame. A soft layer's indentation is not in it.",
    )


def tiles(design: Design) -> Iterator[Tile]:
    """Yield each `Tile` at the top of the page: smallest and largest force, errors of position, force and torque."""
    found, wanted = design.found, f"for {1e3 * design.accuracy:g} mm"
    least = found.smallest(design.accuracy)
    yield Tile(
        "smallest force", _force(np.nanmedian(least)), f"{wanted}; at the worst place {_force(np.nanmax(least))}"
    )
    error = found.position(design.force)
    yield Tile(
        f"position at {design.force:g} N",
        _length(np.nanmedian(error)),
        f"at the worst place {_length(np.nanmax(error))}",
    )
    yield Tile("force", _force(np.nanmedian(found.force)), "of its vector, by the noise")
    if np.isfinite(found.torque).any():
        torque = np.nanmedian(found.torque)
        yield Tile("torque", f"{1e3 * torque:.2g} mN m", "about the normal")
    if np.isfinite(found.largest).any():
        yield Tile("largest force", f"{np.nanmin(found.largest):.3g} N", "before the first cell is at its range")


def warnings(design: Design) -> Iterator[str]:
    """Yield warnings as str where the wanted accuracy is not reached, or only beyond a cell's range."""
    least = design.found.smallest(design.accuracy)[design.seen]
    if not np.isfinite(least).all():
        share = 100 * float(np.mean(~np.isfinite(least)))
        yield (
            f"At {share:.0f} % of the surface no force is located within {1e3 * design.accuracy:g} mm: the calibration "
            "is not accurate enough there."
        )
    if (design.found.largest[design.seen] < least).any():
        yield "In places a cell is at the end of its range before the force is large enough for the required accuracy."


def _maps(design: Design) -> Section:
    found, force = design.found, design.force
    named = (
        (1e6 * found.position(force), f"position error [µm] at {force:g} N", "How well the place is known."),
        (
            1e3 * found.smallest(design.accuracy),
            f"force [mN] for {1e3 * design.accuracy:g} mm",
            "The smallest force that is located within this accuracy.",
        ),
        (
            1e3 * np.hypot(found.force, found.scale * force),
            f"force error [mN] at {force:g} N",
            "How well the force vector is known.",
        ),
        (1e3 * found.torque, "torque error [mN m]", "How well the torque about the normal is known."),
        (found.largest, "largest force [N]", "The force at which the first cell is at its range."),
    )
    vertices, _, faces = design.places
    even: list[str] = []
    pictures: list[Picture] = []
    for values, label, words in named:
        known = values[np.isfinite(values)]
        if not len(known):
            continue
        if np.ptp(known) < EVEN * np.abs(known).max():
            name, _, unit = label.partition(" [")
            even.append(f"{words} The same everywhere: {name} {known.mean():.3g} {unit.partition(']')[0]}.")
            continue
        drawn = maps.surface_map(vertices, faces, values, label, cells=design.cells.positions, view=design.view)
        pictures.append(picture(drawn, words))
    return Section("Over the surface", text=tuple(even), pictures=tuple(pictures))


def _curves(design: Design) -> Section:
    found, seen = design.found, design.seen
    errors = np.stack([found.position(float(force))[seen] for force in REACH])
    curves = {"best place": errors.min(axis=1), "median": np.median(errors, axis=1), "worst": errors.max(axis=1)}
    drawn = maps.error_over_force(REACH, curves, design.accuracy)
    words = (
        "The effect of the noise on the place falls as the force grows; the error of the calibration remains. "
        "Where the line reaches the size of the body, the place is not known."
    )
    return Section("Over the force", pictures=(picture(drawn, words),))


def _dead(design: Design) -> Section:
    """Return the section with one dead cell after the other, which does not answer but still carries its load."""
    rows: list[tuple[str, ...]] = [("all answer", *_summary(design, design.found))]
    every = np.arange(design.cells.cells)
    for cell in every:
        try:
            found = _summary(design, design.with_changes(sound=every != cell))
        except NotIdentifiable as problem:
            found = (f"no wrench: rank {problem.rank}",)
        rows.append((f"cell {cell + 1} dead", *found))
    caption = (
        "A dead cell still carries load; the others determine the wrench by the forward model, if they are enough."
    )
    return Section("With a cell less", tables=(ReportTable(_header(design), tuple(rows), caption),))


def _variants(design: Design) -> Section:
    if not design.variants:
        return Section("What would change it")
    changes: tuple[tuple[str, dict[str, Any]], ...] = (
        ("as it is", {}),
        *((name, {"cells": cells}) for name, cells in design.variants),
        ("the bias from four times as many readings", {"tare": 4 * design.tared}),
        ("without friction", {"friction": 0.0}),
    )
    rows = [(name, *_summary(design, design.with_changes(**change))) for name, change in changes]
    caption = "Nearer cells know moments better, as their noise has shorter arms, and carry more for the same moment."
    return Section("What would change it", tables=(ReportTable(_header(design), tuple(rows), caption),))


def _facts(design: Design) -> Section:
    cells = design.cells
    noise = np.sqrt(np.diag(cells.noise))
    places = tuple(
        (f"{number}", *(f"{1e3 * value:.2f}" for value in place)) for number, place in enumerate(cells.positions, 1)
    )
    facts = (
        ("cells", f"{cells.cells}, {'calibrated' if cells.samples else 'as drawn: equal, of one stiffness'}"),
        ("noise", f"{1e3 * noise.mean():.3g} mV of a reading"),
        ("friction", f"{design.friction:g}, in the worst direction"),
        ("bias", f"from {design.tared:g} independent readings"),
        ("drift", f"{1e3 * cells.drift * noise.mean():.3g} mV since then"),
        ("wanted", f"{1e3 * design.accuracy:g} mm"),
    )
    return Section(
        "What this is for", settings=facts, tables=(ReportTable(("cell", "x [mm]", "y [mm]", "z [mm]"), places),)
    )


def _header(design: Design) -> tuple[str, ...]:
    return (
        "",
        f"smallest force for {1e3 * design.accuracy:g} mm",
        "at the worst place",
        f"position at {design.force:g} N",
        "at the worst place",
        "largest force",
    )


def _summary(design: Design, found: Resolution) -> tuple[str, ...]:
    least, error = found.smallest(design.accuracy), found.position(design.force)
    forces = (np.nanmedian(least), np.nanmax(least))
    largest = _force(np.nanmin(found.largest)) if np.isfinite(found.largest).any() else "not known"
    return (*(_force(value) for value in forces), _length(np.nanmedian(error)), _length(np.nanmax(error)), largest)


def _force(value: float) -> str:
    if not np.isfinite(value):
        return "none"
    return f"{value:.3g} N" if value >= 0.1 else f"{1e3 * value:.3g} mN"


def _length(value: float) -> str:
    return f"{1e3 * value:.3g} mm" if value >= 1e-3 else f"{1e6 * value:.3g} µm"
