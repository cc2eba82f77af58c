"""Load cells under a body in a rig: their table, the layout of a log of voltages, and the estimator built from it."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import inf
from pathlib import Path
from typing import ClassVar

import numpy as np
from jaxtyping import Bool

from palpate.errors import InputError
from palpate.files.logs import LogContents
from palpate.files.logs.layout import ArrayChannel, LogLayout
from palpate.files.models import read_model
from palpate.files.units import FORCE_UNITS, known_unit
from palpate.sensors.load_cells.array import START, LoadCellArray
from palpate.sensors.load_cells.model import AXES, LAYOUTS, LoadCells, with_changes
from palpate.sensors.load_cells.resolution import WANTED, nominal_cells, resolution
from palpate.setup import guess
from palpate.setup.body import GivenBody
from palpate.setup.built import BuiltEstimator, Guess
from palpate.setup.makers import named_pose
from palpate.setup.names import time_column, wrench_columns
from palpate.setup.setup import SensorKind, SensorSection, Setup
from palpate.setup.tables import Three, require_positive
from palpate.setup.wrench import wrench_estimator
from palpate.signals.recording import REFERENCE as REFERENCE_CHANNEL
from palpate.signals.recording import VOLTAGE
from palpate.surfaces import Surface

_ORDER = "columns must be x, y, z of cell 1, then of cell 2, and so on, as they were calibrated"
_CELL = re.compile(r"^(?P<head>u|v|ch|cell|volt(?:age)?s?|ai)[\W_]*\d+[\W_]*[xyz]?$", re.IGNORECASE)
_SINGLE = re.compile(r"^(?:u|volt(?:age)?s?|lc|load[\W_]*cell)[\W_]*\d+(?:[\W_]+(?P<unit>\w+))?[\W_]*$", re.IGNORECASE)
_FEW = 3, 8  # cells under a plate
_MOST = 36  # channels: twelve cells; more are a skin
_TEXT = """\
[load_cells]
{where}
units = "V"                          # of the voltages: V, mV, uV
# model = "load_cells.toml"          # written by: palpate calibrate load-cells
# positions = [[0, 0, 0], ...]       # m, of each cell in the surface's frame, as far as they are known
# range = 5.0                        # V: a reading at it is saturated

"""
_PLATE = """\
[load_cells]
axes = ["z"]                         # each cell measures one axis of the surface's frame
{where}
units = {unit}                       # of the readings: V, mV, uV; or of a force
positions = []                       # m: write [x, y, z] of each cell, in the order of the columns
# noise = 0.02                       # V or N, of a reading
# model = "plate.toml"               # written by: palpate calibrate load-cells

"""
VOLT_UNITS: Mapping[str, float] = {"V": 1.0, "mV": 1e-3, "uV": 1e-6}
PLATE_UNITS: Mapping[str, float] = {**VOLT_UNITS, **FORCE_UNITS}
REFERENCE = ("ref_fx", "ref_fy", "ref_fz", "ref_x", "ref_y", "ref_z")
WEIGHTS = {"x": ("ref_f", "ref_y", "ref_z"), "y": ("ref_f", "ref_z", "ref_x"), "z": ("ref_f", "ref_x", "ref_y")}


@dataclass(frozen=True)
class RigLoadCells:
    """Rig table of cells under a rigid frame, with the columns or topic of their voltages.

    `model` is the file of `palpate calibrate load-cells`; `columns` are one for each of the `axes` of each cell, or
    `topic` has arrays of as many numbers; `units` are theirs (one, or one each). `axes` is x, y, z, or one of them, as
    under a plate, whose readings may be forces, and where `shear` is the usual ratio to the force of the shear that is
    not measured. Known beforehand, for a calibration or a design: `positions` [m] of the cells in the surface's frame,
    `noise` [V] of a reading, `range` [V], `sensitivity` [N/V]. `drift` [V] is that of the bias within a session;
    `without` names bad cells, counted from 1; contacts less certain than `accuracy` [m] are too_light.
    For a calibration: `reference` columns of force [N] on the fingertip and of the ball's centre [m], the `ball`'s
    diameter [m], and `indentation`, true where the surface is soft; of a plate, the weight [N] and its place [m] along
    the two other axes, or the weight alone.

    Raises:
        ValueError: a number, a unit or the columns cannot be those of load cells.
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
    reference: tuple[str, ...] = ()
    ball: float = 4e-3
    indentation: bool = False
    axes: tuple[str, ...] = AXES
    shear: float | None = None

    def __post_init__(self) -> None:
        if self.axes not in LAYOUTS:
            raise ValueError('axes must be ["x", "y", "z"], or one of them, such as ["z"]')
        each = len(self.axes)
        if self.columns and (len(self.columns) < 3 * each or len(self.columns) % each):
            per = "three" if each > 1 else "one"
            raise ValueError(f"columns must be {per} for each of at least three cells, not {len(self.columns)}")
        if self.reference and len(self.reference) not in ((6,) if each > 1 else (1, 3)):
            wanted = "six columns" if each > 1 else "a weight, or a weight and its place"
            raise ValueError(f"reference must be {wanted}")
        if twice := [name for name in self.columns if self.columns.count(name) > 1]:
            raise ValueError(f"column {twice[0]!r} is named twice")
        if not isinstance(self.units, str) and len(self.units) != len(self.columns):
            raise ValueError(f"units must be one unit, or one for each of the {len(self.columns)} columns")
        stated = [self.units] if isinstance(self.units, str) else self.units
        known = VOLT_UNITS if each > 1 else PLATE_UNITS
        if unknown := [unit for unit in stated if known_unit(unit, known) is None]:
            raise ValueError(f"unit {unknown[0]!r} is not one of {', '.join(known)}")
        require_positive(self, "noise", "range", "sensitivity", "drift", "accuracy", "ball", "shear")

    def names(self, cells: int) -> tuple[str, ...]:
        """Return the names of the columns, (a k,): u1x, u1y, u1z, u2x, ... or u1, u2, ... where the rig names none."""
        axes = self.axes if len(self.axes) > 1 else ("",)
        return self.columns or tuple(f"u{cell + 1}{axis}" for cell in range(cells) for axis in axes)

    @property
    def newtons(self) -> bool:
        """True if the readings are forces."""
        return known_unit(self.units if isinstance(self.units, str) else self.units[0], FORCE_UNITS) is not None

    def scales(self, count: int) -> tuple[float, ...]:
        """Return the size [V or N] of one unit of each of `count` columns."""
        units = [self.units] * count if isinstance(self.units, str) else self.units
        return tuple(PLATE_UNITS[str(known_unit(unit, PLATE_UNITS))] for unit in units)

    def count(self) -> int:
        """Return the number of cells without a model: that of the columns or the positions; else 4, as in the paper."""
        return len(self.columns) // len(self.axes) or (len(self.positions) if self.positions else 4)

    def limits(self, cells: int) -> np.ndarray | None:
        """Return the channels' limits (a k, 2) [V]; None if the rig does not state the range."""
        return None if self.range is None else np.tile([-self.range, self.range], (len(self.axes) * cells, 1))


class LoadCellSection(SensorSection):
    """Load cells as a rig states them."""

    name: ClassVar[str] = "load_cells"
    called: ClassVar[str] = "load cells under a body"
    table: RigLoadCells

    @cached_property
    def cells(self) -> LoadCells:
        """Calibrated `LoadCells`; range, drift and noise that the rig states replace the model's own.

        Raises:
            InputError: the rig names no model, the file cannot be read, or the model does not fit the rig.
            NotIdentifiable: the cells that the rig uses do not determine a wrench.
        """
        table = self.table
        if table.model is None and table.newtons:
            return self.nominal()
        if table.model is None:
            raise InputError(
                "the cells are not calibrated.",
                where="load_cells.model",
                hint="Run `palpate calibrate load-cells LOG --rig RIG -o fingertip.toml`, then name that file as "
                "model.",
            )
        path = self.link.folder / table.model
        model = read_model(path, LoadCells)
        if table.axes != model.axes:
            what = f"are {', '.join(table.axes)}, but {path.name} is of cells that measure {', '.join(model.axes)}."
            raise InputError(what, where="load_cells.axes")
        if table.columns and len(table.columns) != len(model.matrix):
            known = f"{path.name} has {model.cells} cells, with a column for each of {', '.join(model.axes)}"
            raise InputError(f"names {len(table.columns)} columns, but {known}.", where="load_cells.columns")
        if unknown := [cell for cell in table.without if not 1 <= cell <= model.cells]:
            what = f"cell {unknown[0]} does not exist: cells are 1 to {model.cells}."
            raise InputError(what, where="load_cells.without")
        noise = float(np.sqrt(np.median(np.diag(model.noise))))
        stated = {
            "limits": table.limits(model.cells),
            "drift": None if table.drift is None else table.drift / noise,
            "noise": None if table.noise is None else np.full(len(model.matrix), table.noise),
            "shear": table.shear,
        }
        return with_changes(model, **{name: value for name, value in stated.items() if value is not None})

    @property
    def used(self) -> Bool[np.ndarray, " k"]:
        """Mask (k,) of the calibrated cells that the rig does not exclude.

        Raises:
            InputError: the rig names no model, the file cannot be read, or the model does not fit the rig.
            NotIdentifiable: the cells that the rig uses do not determine a wrench.
        """
        return ~np.isin(np.arange(self.cells.cells) + 1, self.table.without)

    def nominal(self) -> LoadCells:
        """Return the calibrated `LoadCells`; without a model those predicted from positions, sensitivity and noise.

        Raises:
            InputError: the model cannot be read or does not fit the rig, or there is none and a prediction lacks a key.
            NotIdentifiable: the positions do not determine a wrench.
        """
        table = self.table
        if table.model is not None:
            return self.cells
        sensitivity = 1.0 if table.newtons else table.sensitivity
        if not table.positions or sensitivity is None or table.noise is None:
            raise InputError(
                "positions, sensitivity and noise must be stated when there is no model.",
                where="load_cells",
                hint="Write positions = [[x, y, z], ...] in m, sensitivity in N/V, unless units are of a force, and "
                "noise in V or N.",
            )
        made = nominal_cells(table.positions, sensitivity, table.noise, table.range or inf, axes=table.axes)
        return made if table.shear is None else with_changes(made, shear=table.shear)


def load_cells_layout(setup: Setup, *, bench: bool = False) -> LogLayout:
    """Return the `LogLayout` of a log with voltages and poses; with `bench`, of a bench log, with the reference too.

    Raises:
        InputError: the rig has no [load_cells]; or, without `bench`, its model cannot be read or does not fit.
    """
    section = setup.of(LoadCellSection)
    table = section.table
    count = table.count() if bench or table.model is None else section.cells.cells
    names = table.names(count)
    scales = table.scales(len(names))
    arrays = [ArrayChannel(VOLTAGE, (len(names),), names, table.topic, scales, table="load_cells")]
    if bench:
        columns = table.reference or (WEIGHTS[table.axes[0]] if len(table.axes) == 1 else REFERENCE)
        arrays.append(ArrayChannel(REFERENCE_CHANNEL, (len(columns),), columns, table="load_cells"))
    return LogLayout(wrench=None, arrays=tuple(arrays), **setup.common)


def _build(setup: Setup) -> BuiltEstimator:
    section, tare = setup.of(LoadCellSection), setup.estimate.tare or START
    table, cells = section.table, section.cells
    array = LoadCellArray(cells, section.used, names=table.names(cells.cells), seconds=tare)
    soft = {"indentation": cells.indentation, "accuracy": table.accuracy}
    drift = setup.followed(len(cells.matrix))
    made = wrench_estimator(setup, array, tare=tare, mounted=False, drift=drift, **soft)
    made.settings["without"] = table.without
    made.notes.append(_least(setup.link.surface(), cells, table))
    if len(cells.axes) == 1:
        made.notes.append(
            f"the cells measure force along {cells.axes[0]} alone: shear and torque are not known, and written as 0; "
            f"the ellipses contain a shear of {cells.shear:g} of the force (one standard deviation)"
        )
        made.settings["shear"] = f"not measured, {cells.shear:g} of the force is usual"
    made.warnings += [f"cell {cell} is left out, as the rig says" for cell in table.without]
    return made


def _least(surface: Surface, cells: LoadCells, table: RigLoadCells) -> str:
    accuracy = table.accuracy or WANTED
    above = surface.centre + np.array([0.0, 0.0, surface.size])
    points, normals, _ = surface.project(above[None])
    least = float(resolution(cells, points, normals).smallest(accuracy)[0])
    within = f"is located within {1e3 * accuracy:g} mm"
    if least == np.inf:
        return f"no touch {within}: calibration or unmeasured shear is not known that well"
    return f"a touch of {least:.2g} N or more on the middle of the surface {within}"


def _guess(log: Path, contents: LogContents, body: GivenBody | None) -> Guess | None:
    if contents.topics:
        return _guess_topic(log, contents)
    there = list(contents.names)
    plate, time = [match for name in there if (match := _SINGLE.match(name))], time_column(there)
    single = _FEW[0] <= len(plate) <= _FEW[1]
    names = tuple(match[0] for match in plate) if single else _voltage_columns(there)
    if names is None or time is None or (wrench_columns(there) is not None and not single):
        return None
    named, ends = f"columns = {guess.quoted(names)}", f"columns {names[0]} to {names[-1]} look like"
    if single:
        stated = known_unit(plate[0]["unit"] or "", PLATE_UNITS) or "V"
        text, order = _PLATE.format(where=named, unit=guess.quoted(stated)), "positions of the cells must be filled in"
        why = f"{ends} the {len(names)} single-axis cells of a plate"
    else:
        text, order = _TEXT.format(where=named), _ORDER
        why = f"{len(names)} {ends} three voltages for each of {len(names) // 3} cells"
    unit, doubts = guess.time_unit(log, time)
    orientation, remarks = guess.orientation_table(named_pose(there))
    array = ArrayChannel(VOLTAGE, (len(names),), names, table="load_cells")
    layout = LogLayout(time=time, time_unit=unit, wrench=None, arrays=(array,))
    return Guess(why, layout, guess.time_table(time, unit) + text + orientation, (*doubts, *remarks, order))


def _guess_topic(log: Path, contents: LogContents) -> Guess | None:
    found = guess.array_topic(log, contents, lambda shape: len(shape) == 1 and _threes(shape[0]))
    if found is None:
        return None
    topic, (count, *_) = found
    text = _TEXT.format(where=f"topic = {guess.quoted(topic)}") + guess.pose_table(guess.topics_of(contents, "pose"))
    why = f"topic {topic!r} holds arrays of {count} numbers, three for each of {count // 3} cells"
    array = ArrayChannel(VOLTAGE, (count,), None, topic, table="load_cells")
    return Guess(why, LogLayout(wrench=None, arrays=(array,)), text, (_ORDER,))


def _voltage_columns(names: Sequence[str]) -> tuple[str, ...] | None:
    heads: dict[str, list[str]] = {}
    for name in names:
        if match := _CELL.match(name):
            heads.setdefault(match["head"].lower(), []).append(name)
    found = max(heads.values(), key=len, default=list[str]())
    return tuple(found) if _threes(len(found)) else None


def _threes(count: int) -> bool:
    return 9 <= count <= _MOST and count % 3 == 0


LOAD_CELLS = SensorKind(
    name="load_cells",
    called=LoadCellSection.called,
    table=RigLoadCells,
    section=LoadCellSection,
    channels=(VOLTAGE,),
    layout=load_cells_layout,
    build=_build,
    guess=_guess,
    paths=("model",),
    refused={
        "payload": "the zero of the cells is taken at the start of the log, and they carry no payload",
        "noise": "the calibration of the cells states their noise; to state it, write noise in V in the rig's "
        "[load_cells]",
    },
    view="palpate.sensors.load_cells.view.LoadCellView",
    drift="palpate.sensors.load_cells.drift.voltage_drift",
    start=lambda setup: setup.estimate.tare or START,
)
