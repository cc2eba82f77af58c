"""Read the [skin] table of a rig; build the layout of its log, the taxel body and the estimator."""

from __future__ import annotations

import math
import re
from collections import Counter
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from palpate.errors import InputError
from palpate.files.logs import LogContents
from palpate.files.logs.layout import ArrayChannel, LogLayout
from palpate.files.models import read_model
from palpate.sensors.taxels.estimator import HEAD, TaxelEstimator
from palpate.sensors.taxels.health import examine
from palpate.sensors.taxels.intensity import Intensity
from palpate.sensors.taxels.model import TaxelBody
from palpate.sensors.taxels.place_formats import read_taxel_places
from palpate.sensors.taxels.places import TaxelPlaces
from palpate.sensors.taxels.skin_map.files import read_skin_map
from palpate.sensors.taxels.skin_map.model import SkinMap
from palpate.setup import guess
from palpate.setup.body import GivenBody
from palpate.setup.built import BuiltEstimator, Guess
from palpate.setup.makers import named_pose, pose_columns
from palpate.setup.names import time_column, wrench_columns
from palpate.setup.setup import SensorKind, SensorSection, Setup
from palpate.setup.tables import require_path, require_positive
from palpate.setup.wrench import noted_filter
from palpate.signals.recording import CELLS

RATE = 100.0  # Hz
FEWEST = 16  # cells: fewer columns of numbers can be anything
_TEXT = """\
[skin]
map = "skin_map.toml"                # written by: palpate map skin MESH --sheet {rows}x{columns} ...
rows = {rows}
columns = {columns}
bits = 8                             # of a whole-number reading; 0: readings are floats
# intensity = "intensity.toml"       # written by: palpate calibrate intensity; without it a count is taken for 1 N
{where}# tare = 1.0                         # s: the log starts so long untouched

[contacts]
on = 6.0                             # a touch begins where a cell stands so many deviations of its noise above its rest
off = 3.0                            # and reaches as far as cells that stand so many above
# unequal = 0.02                     # share by which a cell's gain may be off from its curve: it widens the ellipses

"""
REST = 5.0  # s of a stream from which the same is taken, where no tare says how long


@dataclass(frozen=True)
class RigSkin:
    """The [skin] table of a rig: a sheet with its map, or taxels anywhere, and how a log stores them.

    Attributes:
        map: file of `palpate map skin`, for a sheet.
        taxels: file of taxel places, for taxels anywhere.
        count: number of readings in a frame, where no places are known yet.
        rows, columns: of the sheet; None: as in the map.
        bits: of a reading; 0: readings are floats.
        intensity: file of `palpate calibrate intensity`; None: intensities are taken for forces.
        cells: columns of a table with the readings, row by row for a sheet.
        topic: of a bag with the readings.
        rate: [Hz] of frames without times.
        masked: cells [row, column], or indices of taxels, that are not used.
        tare: [s] at the start of the log in which nothing touches.

    Raises:
        ValueError: keys exclude each other, are missing or are out of their range.
    """

    map: str | None = None
    taxels: str | None = None
    count: int | None = None
    rows: int | None = None
    columns: int | None = None
    bits: int = 8
    intensity: str | None = None
    cells: tuple[str, ...] | None = None
    topic: str | None = None
    rate: float | None = None
    masked: tuple[int, ...] | tuple[tuple[int, int], ...] = ()
    tare: float | None = None

    def __post_init__(self) -> None:
        for name in ("map", "taxels"):
            require_path(name, getattr(self, name))
        if self.map is not None and (self.taxels is not None or self.count is not None):
            raise ValueError(
                "map, taxels and count exclude each other: map is for a sheet, taxels and count for taxels anywhere"
            )
        if self.map is None and self.taxels is None and self.count is None:
            raise ValueError("map or taxels is missing: a file of the places of a sheet's cells, or a file of taxels")
        if self.map is None and (self.rows or self.columns):
            raise ValueError("rows and columns are for a sheet, which needs a map")
        if self.count is not None and self.count < 1:
            raise ValueError("count must be positive")
        if any(isinstance(cell, int) == (self.map is not None) for cell in self.masked):
            raise ValueError("masked must be [row, column] of cells of a sheet, or numbers of taxels")
        if not 0 <= self.bits <= 16:
            raise ValueError(f"bits must be between 1 and 16, or 0 for floats, not {self.bits}")
        require_positive(self, "rate", "tare")


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
        if self.table.map is None:
            hint = "Make one with `palpate map skin`, then name its file: map = FILE."
            raise InputError("the rig's [skin] is not a sheet: it has no map.", where="skin.map", hint=hint)
        path = self.link.folder / self.table.map
        found = read_skin_map(path)
        rows, columns = self.table.rows or found.rows, self.table.columns or found.columns
        if (rows, columns) != (found.rows, found.columns):
            raise InputError(
                f"maps {found.rows} x {found.columns} cells, but the rig's [skin] states {rows} x {columns}.",
                where=str(path),
                hint="Make the map for this sheet with palpate map skin --sheet.",
            )
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
            raise InputError(
                "the rig's [skin] states the number of taxels, but not their places.",
                where="skin.taxels",
                hint="Run `palpate calibrate taxels` on a log of pokes, then name its file: taxels = FILE.",
            )
        path, places = link.folder / table.taxels, self._read
        if table.count not in (None, len(places)):
            raise InputError(f"has {len(places)} taxels, but count = {table.count} in [skin].", where=str(path))
        lacking = places.there & ~np.isfinite(places.normals).all(axis=1)
        if not lacking.any():
            return places
        if link.stated is None:
            raise InputError(
                f"does not state the normals of {np.count_nonzero(lacking)} of {np.count_nonzero(places.there)} "
                "taxels.",
                where=str(path),
                hint="Name the link's mesh in [surface], from which they are then taken.",
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
        options: dict[str, Any] = {"bits": self.table.bits or None, "masked": self.table.masked}
        if self.table.map is not None:
            return TaxelBody.sheet(self.map, **options)
        places = self.taxels
        return TaxelBody.placed(places.positions, places.normals, covariance=places.covariance, **options)

    def shape(self) -> tuple[int, ...]:
        """Return the shape of a frame: (rows, columns) of a sheet, or (number of readings,).

        Raises:
            InputError: the file of the map or of the taxels cannot be read.
        """
        table = self.table
        if table.map is not None:
            if table.rows and table.columns:  # as the map says too, or `map` refuses it
                return table.rows, table.columns
            return self.map.rows, self.map.columns
        return (int(table.count or 0),) if table.taxels is None else (len(self._read),)


def _layout(setup: Setup) -> LogLayout:
    skin = setup.of(SkinSection)
    cells = ArrayChannel(CELLS, skin.shape(), skin.table.cells, skin.table.topic, table="skin")
    common = setup.common
    common["rate"] = skin.table.rate or setup.time.rate
    return LogLayout(wrench=None, arrays=(cells,), **common)


def _build(setup: Setup) -> BuiltEstimator:
    skin, head = setup.of(SkinSection), setup.head
    body, intensity, tare = skin.body, skin.intensity, skin_tare(setup)
    health = None
    if head is not None:
        first = max(HEAD, 0 if tare is None else len(head.first(tare)))
        falling = intensity is not None and intensity.curves[0].falling
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
    )
    made = BuiltEstimator(estimator, notes=noted_filter(smooth, rate), settings=dict(vars(setup.contacts)))
    if tare is None:
        made.notes.append(
            "cells at rest are found in the log itself; write tare = SECONDS in [skin] if nothing touches at its start"
        )
    return made


def skin_tare(setup: Setup) -> float | None:
    """Return the time [s] at the start of a log in which nothing touches; None: the rig does not state it.

    Raises:
        InputError: the rig has no [skin].
    """
    return setup.estimate.tare or setup.of(SkinSection).table.tare


def _guess(log: Path, contents: LogContents, body: GivenBody | None) -> Guess | None:
    """Guess a skin from images, arrays of frames, or many columns of numbers next to a time."""
    if contents.topics:
        return _of_topic(log, contents)
    frames = [(name, shape) for name, shape in contents.names.items() if math.prod(shape) >= FEWEST]
    if frames:
        name, shape = frames[0]
        where = f"rate = {RATE:g}                        # Hz, of frames without times: it is not known, correct it\n"
        return _guessed(shape, f"array {name!r} holds frames", where, rate=RATE)
    there = list(contents.names)
    time, known = time_column(there), _other_columns(there)
    cells = tuple(name for name in there if name not in known)
    if time is None or len(cells) < FEWEST or wrench_columns(there) is not None:
        return None
    (unit, doubts), (orientation, _) = guess.time_unit(log, time), guess.orientation_table(named_pose(there))
    named = "" if len(known) == 1 else f"cells = {guess.quoted(cells)}\n"
    why = f"{len(cells)} columns in addition to the time look like cells"
    around = (guess.time_table(time, unit), orientation)
    found = _guessed((len(cells),), why, named, around, cells=cells, time=time, time_unit=unit)
    return replace(found, remarks=(*doubts, *found.remarks))


def guess_with_wrench(log: Path, contents: LogContents) -> Guess | None:
    """Return the `Guess` of a skin in a log with wrenches, an array topic or columns numbered alike; None: no skin.

    Raises:
        InputError: the log cannot be read.
    """
    if contents.topics:
        arrays = tuple(topic for topic in contents.topics if topic.kind.endswith("MultiArray"))
        return _of_topic(log, replace(contents, topics=arrays)) if arrays else None
    there = list(contents.names)
    known = _other_columns(there)
    kinds = Counter(_NUMBERS.sub("#", name) for name in there if name not in known)
    alike, count = kinds.most_common(1)[0] if kinds else ("", 0)
    if count < FEWEST or "#" not in alike:
        return None
    cells = tuple(name for name in there if name not in known and _NUMBERS.sub("#", name) == alike)
    why = f"{count} columns that are numbered alike look like cells"
    return _guessed((count,), why, f"cells = {guess.quoted(cells)}\n", cells=cells)


def _other_columns(there: list[str]) -> set[str | None]:
    return {time_column(there), *pose_columns(there), *(wrench_columns(there) or ())}


def _of_topic(log: Path, contents: LogContents) -> Guess | None:
    found = guess.array_topic(log, contents, lambda shape: math.prod(shape) >= FEWEST)
    if found is None:
        return None
    topic, size = found
    why = f"topic {topic!r} holds {'images' if len(size) == 2 else 'arrays'} of {' x '.join(map(str, size))} numbers"
    around = ("", guess.pose_table(guess.topics_of(contents, "pose")))
    return _guessed(size, why, f"topic = {guess.quoted(topic)}\n", around, topic=topic)


def _guessed(
    shape: tuple[int, ...],
    why: str,
    where: str,
    around: tuple[str, str] = ("", ""),
    *,
    cells: tuple[str, ...] | None = None,
    topic: str | None = None,
    **time: Any,
) -> Guess:
    """Return the guess of a sheet; numbers in one row are arranged as nearly square as possible."""
    rows, columns = shape if len(shape) == 2 else _square(math.prod(shape))
    layout = LogLayout(wrench=None, arrays=(ArrayChannel(CELLS, (rows, columns), cells, topic, table="skin"),), **time)
    text = around[0] + _TEXT.format(rows=rows, columns=columns, where=where) + around[1]
    remark = f"check the sheet's {rows} rows and {columns} columns, and the bits of a reading"
    return Guess(why, layout, text, (remark,))


def _square(count: int) -> tuple[int, int]:
    rows = next(k for k in range(int(count**0.5), 0, -1) if count % k == 0)
    return rows, count // rows


_NUMBERS = re.compile(r"\d+")
_NO_WRENCH = "cells measure no wrench"
SKIN = SensorKind(
    name="skin",
    called=SkinSection.called,
    table=RigSkin,
    section=SkinSection,
    channels=(CELLS,),
    layout=_layout,
    build=_build,
    guess=_guess,
    paths=("map", "taxels", "intensity"),
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
