"""Read the [skin] table of a rig; build the layout of its log, the taxel body and the estimator."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from math import prod
from typing import Any, ClassVar

import numpy as np

from palpate.errors import InputError
from palpate.files.logs.layout import ArrayChannel, LogLayout
from palpate.files.models import read_model
from palpate.files.units import CELL_UNITS, ELECTRIC_UNITS, FORCE_UNITS, PRESSURE_UNITS, known_unit
from palpate.sensors.taxels.guess import guess_skin
from palpate.sensors.taxels.intensity import Intensity, load_direction
from palpate.sensors.taxels.model import TaxelBody
from palpate.sensors.taxels.place_formats import read_taxel_places
from palpate.sensors.taxels.places import TaxelPlaces
from palpate.sensors.taxels.response import TaxelResponse
from palpate.sensors.taxels.skin_map.files import read_skin_map
from palpate.sensors.taxels.skin_map.model import SkinMap, flat_map
from palpate.setup.built import BuiltEstimator
from palpate.setup.setup import SensorKind, SensorSection, Setup
from palpate.setup.tables import require_path, require_positive
from palpate.signals.recording import CELLS

_X = (1.0, 0.0, 0.0)
REST = 5.0  # s of a stream from which the same is taken, where no tare says how long


@dataclass(frozen=True)
class RigSkin:
    """The [skin] table of a rig: a sheet with its map or its pitch, or taxels anywhere, and how a log stores them.

    Attributes:
        map: file of `palpate map skin`, for a sheet.
        pitch: [m] between the cells of a flat sheet, or between its rows and between its columns; see `flat_map`.
        taxels: file of taxel places, for taxels anywhere.
        count: number of readings in a frame, where no places are known yet.
        rows, columns: of the sheet; None: as in the map.
        order: "columns" where a sheet's numbers are recorded, or named, column by column; "rows": row by row.
        bits: of a reading in counts; 0: readings are floats, as those in a unit of force or pressure.
        intensity: file of `palpate calibrate intensity`; None: intensities are taken for forces.
        axes: names of the three numbers of a taxel, as columns, or members of messages, have them ("1_x", "Z24",
            "taxels[].x"), its x, y and z in this order: the last side of frames. None: a taxel has one number.
        response: file of `palpate calibrate response`, for taxels with three axes; None: a count is taken for 1 N.
        temperature: column or topic of the temperature [K or degrees C] of taxels with three axes, whose effect
            `palpate calibrate response` learns and estimates take off.
        cells: columns of a table with the readings, row by row for a sheet; or a field path: a pattern of columns
            ("S* [kPa]"), an array, a column of lists, or a field of messages ("sensors[0].values"). None: found by the
            numbers in names.
        topic: of a bag with the readings.
        unit: of the readings without an intensity: of a force, or of a pressure, which the cells' areas turn into
            forces; or counts, V, Ohm, taken as they are. None: counts, or N.
        rate: [Hz] of frames without times.
        masked: cells [row, column], or indices of taxels, that are not used.
        tare: [s] at the start of the log in which nothing touches.
        falling: readings fall under load; None: as those of `intensity`, or else found in the log.

    Raises:
        ValueError: keys exclude each other, are missing or are out of their range.
    """

    map: str | None = None
    pitch: float | tuple[float, float] | None = None
    taxels: str | None = None
    count: int | None = None
    rows: int | None = None
    columns: int | None = None
    order: str = "rows"
    bits: int = 8
    intensity: str | None = None
    axes: tuple[str, ...] | None = None
    response: str | None = None
    temperature: str | None = None
    cells: tuple[str, ...] | str | None = None
    topic: str | None = None
    unit: str | None = None
    rate: float | None = None
    masked: tuple[int, ...] | tuple[tuple[int, int], ...] = ()
    tare: float | None = None
    falling: bool | None = None

    def __post_init__(self) -> None:
        for name in ("map", "taxels"):
            require_path(name, getattr(self, name))
        places = [name for name in ("map", "pitch", "taxels") if getattr(self, name) is not None]
        if len(places) > 1 or (self.sheet and self.count is not None):
            raise ValueError(
                "map, pitch, taxels and count exclude each other: map and pitch are for a sheet, taxels and count for "
                "taxels anywhere"
            )
        if not places and self.count is None:
            raise ValueError(
                "map, pitch or taxels is missing: a file of the places of a sheet's cells, the pitch [m] of a flat "
                "sheet, or a file of taxels"
            )
        if not self.sheet and (self.rows or self.columns or self.order != "rows"):
            raise ValueError("rows, columns and order are for a sheet, which needs a map or a pitch")
        if self.order not in ("rows", "columns"):
            raise ValueError(f'order must be "rows" or "columns", not {self.order!r}')
        if self.axes is not None and [axis[-1:].lower() for axis in self.axes] != ["x", "y", "z"]:
            raise ValueError('axes must be three names that end in x, y and z, in this order, such as ["x", "y", "z"]')
        for name in ("response", "temperature") if self.axes is None else ():
            if getattr(self, name) is not None:
                raise ValueError(f"a {name} is for taxels with three axes, whose names axes states")
        if self.axes is not None and self.intensity is not None:
            what = "intensity is for taxels with one axis: palpate calibrate response is for those with three"
            raise ValueError(what)
        if self.pitch is not None and not (self.rows and self.columns):
            raise ValueError("a pitch needs rows and columns, the numbers of the flat sheet's rows and columns")
        if self.unit is not None and not known_unit(self.unit, {**CELL_UNITS, **ELECTRIC_UNITS}):
            raise ValueError(f"unknown unit {self.unit!r}: known are {', '.join({**CELL_UNITS, **ELECTRIC_UNITS})}")
        if self.intensity is not None and self.unit is not None and not self.electric:
            raise ValueError("unit and intensity exclude each other: an intensity turns readings as they are to forces")
        if self.count is not None and self.count < 1:
            raise ValueError("count must be positive")
        if any(isinstance(cell, int) == self.sheet for cell in self.masked):
            raise ValueError("masked must be [row, column] of cells of a sheet, or numbers of taxels")
        if not 0 <= self.bits <= 16:
            raise ValueError(f"bits must be between 1 and 16, or 0 for floats, not {self.bits}")
        require_positive(self, "rate", "tare", "pitch")

    @property
    def sheet(self) -> bool:
        """True for a sheet, with rows and columns; False for taxels anywhere."""
        return self.map is not None or self.pitch is not None

    @property
    def electric(self) -> bool:
        """True if the unit is that of a number which is taken as it is: counts, V, Ohm."""
        return self.unit is not None and known_unit(self.unit, ELECTRIC_UNITS) is not None


class SkinSection(SensorSection):
    """A skin as a rig states it."""

    name: ClassVar[str] = "skin"
    called: ClassVar[str] = "a skin of taxels"
    table: RigSkin

    @cached_property
    def map(self) -> SkinMap:
        """Return the sheet's `SkinMap`.

        Raises:
            InputError: the rig states no map, or one that cannot be read or has other rows and columns.
        """
        if self.table.pitch is not None:
            return flat_map(self.table.rows or 0, self.table.columns or 0, self.table.pitch)
        if self.table.map is None:
            hint = "Make one with `palpate map skin`, then name its file: map = FILE."
            raise InputError("the rig's [skin] is not a sheet: it has no map.", where="skin.map", hint=hint)
        path = self.link.folder / self.table.map
        found = read_skin_map(path)
        rows, columns = self.table.rows or found.rows, self.table.columns or found.columns
        if (rows, columns) != (found.rows, found.columns):
            what = f"maps {found.rows} x {found.columns} cells, but the rig's [skin] states {rows} x {columns}."
            hint = "Make the map for this sheet with palpate map skin --sheet."
            raise InputError(what, where=str(path), hint=hint)
        return found

    @cached_property
    def _read(self) -> TaxelPlaces:
        return read_taxel_places(self.link.folder / str(self.table.taxels)).in_surface()

    @cached_property
    def taxels(self) -> TaxelPlaces:
        """Return the `TaxelPlaces` of taxels on no sheet, each with a normal, the file's or that of [surface].

        Raises:
            InputError: the rig names no file, the file cannot be read or has not `count` taxels, or normals are missing
                and there is no [surface].
            GeometryError: the file of [surface], needed for normals, has no usable surface.
        """
        table, link = self.table, self.link
        if table.taxels is None:
            what = "the rig's [skin] states the number of taxels, but not their places."
            hint = "Run `palpate calibrate taxels` on a log of pokes, then name its file: taxels = FILE."
            raise InputError(what, where="skin.taxels", hint=hint)
        path, places = link.folder / table.taxels, self._read
        if table.count not in (None, len(places)):
            raise InputError(f"has {len(places)} taxels, but count = {table.count} in [skin].", where=str(path))
        lacking = places.there & ~np.isfinite(places.normals).all(axis=1)
        if not lacking.any():
            return places
        if link.stated is None and np.nanmax(places.positions[:, 2]) == np.nanmin(places.positions[:, 2]):
            said = "the taxels lie at one z, and +z is taken for their normals: columns nx, ny, nz would state them"
            normals = np.where(lacking[:, None], (0.0, 0.0, 1.0), places.normals)
            return replace(places, normals=normals, notes=(*places.notes, said))
        if link.stated is None:
            raise InputError(
                f"does not state the normals of {np.count_nonzero(lacking)} of {np.count_nonzero(places.there)} "
                "taxels.",
                where=str(path),
                hint="Add columns nx, ny, nz, or name the link's mesh in [surface], from which they are then taken.",
            )
        normals = places.normals.copy()
        normals[lacking] = link.surface().project(places.positions[lacking])[1]
        return replace(places, normals=normals)

    @cached_property
    def intensity(self) -> Intensity | None:
        """Return the `Intensity` from readings to forces; None: one count is taken for 1 N.

        Raises:
            InputError: its file cannot be read.
        """
        name = self.table.intensity
        return None if name is None else read_model(self.link.folder / name, Intensity)

    @cached_property
    def body(self) -> TaxelBody:
        """Return the `TaxelBody` on the link: the cells of the sheet, or the taxels.

        Raises:
            InputError: as by `map` and `taxels`, the places are no body, or a masked cell does not exist.
            GeometryError: as by `taxels`.
        """
        table, three = self.table, self.table.axes is not None
        counts = (table.unit is None or table.electric) and not three  # a force, a pressure or a load has no bits
        options: dict[str, Any] = {"bits": table.bits if counts and table.bits else None, "masked": table.masked}
        if table.sheet:
            body = TaxelBody.sheet(self.map, **options)
            if three:  # the first axis is along the columns of a sheet, or the link's x
                flat = TaxelBody.anywhere(body.positions, body.normals, body.areas, along=body.ways())
                body = replace(flat, usable=body.usable, notes=body.notes)
        else:
            places = self.taxels
            options |= {"covariance": places.covariance, "along": _X if three else None}
            body = TaxelBody.placed(places.positions, places.normals, **options)
            body = replace(body, notes=(*body.notes, *places.notes))
        if not three:
            return body
        if table.response is not None:
            return replace(body, response=read_model(self.link.folder / table.response, TaxelResponse))
        said = "there is no response, so a count is taken for 1 N on each axis: palpate calibrate response makes one"
        guessed = TaxelResponse.guessed(len(body), float(np.median(body.spacing)))
        return replace(body, response=guessed, notes=(*body.notes, said))

    def shape(self) -> tuple[int, ...]:
        """Return the shape of a frame without axes: (rows, columns) of a sheet, or (number of readings,).

        Raises:
            InputError: the file of the map or of the taxels cannot be read.
        """
        table = self.table
        if table.sheet:
            if table.rows and table.columns:  # as the map says too, or `map` refuses it
                return table.rows, table.columns
            return self.map.rows, self.map.columns
        return (int(table.count or 0),) if table.taxels is None else (len(self._read),)

    def channel(self) -> ArrayChannel:
        """Return the channel of the readings: which numbers of a log they are, in which order and unit.

        Raises:
            InputError: the file of the map or of the taxels cannot be read; for a unit of pressure, as by `body`.
            GeometryError: as by `body`.
        """
        table = self.table
        read = None if table.intensity is not None or table.electric else table.unit or ""
        ids = None if table.taxels is None else self._read.ids
        axes = table.axes or ()
        shape = (*self.shape(), len(axes)) if axes else self.shape()
        names = (CELLS, shape, table.cells, table.topic, self._scale(), SkinSection.name)
        return ArrayChannel(*names, order=table.order, ids=ids, unit=read, axes=axes)

    def _scale(self) -> float | tuple[float, ...]:
        """Return the force [N] of one unit of a reading; for a pressure, of each taxel by its area."""
        unit = known_unit(self.table.unit or "N", CELL_UNITS)
        if unit is None or unit in FORCE_UNITS:
            return 1.0 if unit is None else FORCE_UNITS[unit]
        body, areas = self.body, np.ones(prod(self.shape()))
        areas[slice(None) if body.numbers is None else body.numbers] = PRESSURE_UNITS[unit] * body.areas
        return tuple(np.repeat(areas, len(self.table.axes or ("z",))).tolist())


def _layout(setup: Setup) -> LogLayout:
    skin = setup.of(SkinSection)
    common = setup.common
    common |= {"rate": skin.table.rate or setup.time.rate, "temperature": skin.table.temperature}
    return LogLayout(wrench=None, arrays=(skin.channel(),), **common)


def _build(setup: Setup) -> BuiltEstimator:
    from palpate.sensors.taxels.estimator import HEAD, TaxelEstimator  # here: to guess at a log needs none of them
    from palpate.sensors.taxels.health import FALLS, examine, falls_under_load
    from palpate.setup.wrench import noted_filter

    skin, head = setup.of(SkinSection), setup.head
    body, intensity, tare, falling = skin.body, skin.intensity, skin_tare(setup), skin.table.falling
    health, stated = None, load_direction(intensity, falling)
    if head is not None:
        first = max(HEAD, 0 if tare is None else len(head.first(tare)))
        falling = falls_under_load(head, body, tare) if stated is None else stated
        health = examine(head.picked(slice(0, first)), body, seconds=tare, falling=falling)
    smooth, rate = setup.smoothing()
    estimator = TaxelEstimator(
        body,
        intensity,
        health,
        settings=setup.contacts,
        filter=smooth.filter(),
        rate=rate,
        mount=setup.link.mount,
        falling=falling,
    )
    made = BuiltEstimator(estimator, notes=noted_filter(smooth, rate), settings=dict(vars(setup.contacts)))
    if body.response is not None and (unknown := _unknown(skin.table, body.response, live=head is None)):
        made.notes.append(unknown)
    if tare is None:
        made.notes.append(
            "cells at rest are found in the log itself; write tare = SECONDS in [skin] if nothing touches at its start"
        )
    if health is not None and health.falling and stated is None and not body.calibrated:
        made.notes.append(FALLS)
    return made


def _unknown(table: RigSkin, response: TaxelResponse, live: bool) -> str:
    """Return the sentence that readings are not corrected for the temperature, and why; "" if they are, or need not."""
    if not len(response.thermal):
        why = "the response does not know what the temperature does: calibrate while it changes, with the same key"
        return why if table.temperature is not None else ""
    known = f"the response corrects readings to a temperature of {response.temperature:.3g}"
    lacks = "live sources have none" if live else "" if table.temperature is not None else "[skin] names none"
    return f"{known}, but {lacks}: they are taken as they are" if lacks else ""


def skin_tare(setup: Setup) -> float | None:
    """Return the time [s] at the start of a log in which nothing touches; None: the rig does not state it.

    Raises:
        InputError: the rig has no [skin].
    """
    return setup.estimate.tare or setup.of(SkinSection).table.tare


_NO_WRENCH = "cells measure no wrench"
SKIN = SensorKind(
    name="skin",
    called=SkinSection.called,
    table=RigSkin,
    section=SkinSection,
    channels=(CELLS,),
    layout=_layout,
    build=_build,
    guess=guess_skin,
    paths=("map", "taxels", "intensity", "response"),
    refused={
        "payload": f"{_NO_WRENCH}, so no payload is in their readings",
        "noise": f"{_NO_WRENCH}: the noise of each cell is taken from the log",
        "method": "contacts are where cells are pressed: there is no line of action to locate",
        "friction": "cells feel no shear, so there is no friction to bound",
        "torsion": "cells feel no torque about the normal",
        "contact": "thresholds are those of each cell: on and off in [contacts], in deviations of its noise",
        "crease": "contacts are placed on the map of the sheet, not on a mesh",
        "mesh": "contacts are placed on the map of the sheet, not on a mesh",
    },
    needs_surface=False,
    view="palpate.sensors.taxels.view.TaxelView",
    start=lambda setup: skin_tare(setup) or REST,
)
