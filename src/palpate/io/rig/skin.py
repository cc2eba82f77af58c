"""A sheet of taxels in a rig: its table, how a log of frames is read, and what is built of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from palpate.contact.taxel_estimator import TaxelEstimator
from palpate.errors import InputError
from palpate.io.logs.layout import ArrayChannel, Layout
from palpate.io.models import read_model
from palpate.io.rig.guess_skin import guess_skin
from palpate.io.rig.kind import Prepared, SensorKind
from palpate.io.rig.wrench import first_seconds, noted_filter, rig_filter
from palpate.io.skin_map import read_skin_map
from palpate.sensors.intensity import Intensity
from palpate.sensors.recording import CELLS, Recording
from palpate.sensors.skin_map import SkinMap
from palpate.sensors.taxel_health import examine
from palpate.sensors.taxels import TaxelBody

if TYPE_CHECKING:
    from palpate.io.rig.rig import Rig

__all__ = ["SKIN", "RigSkin", "rig_body", "rig_map", "rig_skin"]

HEAD = 2048  # frames of the start of a log from which rest, noise and bad cells are taken


@dataclass(frozen=True)
class RigSkin:
    """The sheet, its map and its curves, and where a log keeps its frames.

    `map` is a file of `palpate map skin`, `intensity` one of `palpate calibrate intensity`; without it intensities are
    taken for forces. `bits` 0: readings are floats. `cells` names the columns of a table, row-major; `masked` cells
    [row, column] are not used; `tare` [s]: the log starts untouched for so long.
    """

    map: str
    rows: int | None = None
    columns: int | None = None
    bits: int = 8
    intensity: str | None = None
    cells: tuple[str, ...] | None = None
    topic: str | None = None
    rate: float | None = None
    masked: tuple[tuple[int, int], ...] = ()
    tare: float | None = None

    def __post_init__(self) -> None:
        if not 0 <= self.bits <= 16:
            raise ValueError(f"bits must lie between 1 and 16, or be 0 for floats, not {self.bits}")
        for name in ("rate", "tare"):
            if (value := getattr(self, name)) is not None and not value > 0:
                raise ValueError(f"{name} must be positive")


def rig_skin(rig: Rig) -> RigSkin:
    """The table of a rig.

    Raises:
        InputError: there is none.
    """
    table = rig.sensors.get("skin")
    if table is None:
        raise InputError("the rig has no [skin].", where="rig", hint="A rig of a taxel sheet needs one: map = FILE.")
    return table


def rig_map(rig: Rig) -> SkinMap:
    """Where the cells sit.

    Raises:
        InputError: the map cannot be read, or is of another sheet than `rows` and `columns` say.
    """
    table = rig_skin(rig)
    path = rig.folder / table.map
    found = read_skin_map(path)
    rows, columns = table.rows or found.rows, table.columns or found.columns
    if (rows, columns) != (found.rows, found.columns):
        raise InputError(
            f"maps {found.rows} x {found.columns} cells, but the rig's [skin] says {rows} x {columns}.",
            where=str(path),
            hint="Make the map for this sheet with palpate map skin --sheet.",
        )
    return found


def _intensity(rig: Rig) -> Intensity | None:
    """What readings mean; None: a count is taken for a newton."""
    name = rig_skin(rig).intensity
    return None if name is None else read_model(rig.folder / name, Intensity)


def _layout(rig: Rig) -> Layout:
    table, place = rig_skin(rig), rig_map(rig)
    cells = ArrayChannel(CELLS, (place.rows, place.columns), table.cells, table.topic, table="skin")
    return Layout(
        time=rig.time.column, time_unit=rig.time.unit, wrench=None, arrays=(cells,), rate=table.rate, **rig.poses()
    )


def rig_body(rig: Rig) -> TaxelBody:
    """The cells of the sheet on the link."""
    table = rig_skin(rig)
    return TaxelBody.sheet(rig_map(rig), bits=table.bits or None, masked=table.masked)


def _build(rig: Rig, head: Recording | None) -> Prepared:
    body, intensity, tare = rig_body(rig), _intensity(rig), rig.estimate.tare or rig_skin(rig).tare
    health = None
    if head is not None:
        first = max(HEAD, 0 if tare is None else len(first_seconds(head, tare)))
        falling = intensity is not None and intensity.curves[0].falling
        health = examine(head.picked(slice(0, first)), body, seconds=tare, falling=falling)
    smooth, rate = rig_filter(rig, head)
    estimator = TaxelEstimator(
        body,
        intensity,
        health,
        settings=rig.contacts,
        filter=smooth.filter(),
        rate=rate,
        mount=rig.mount(),
    )
    made = Prepared(estimator, said=noted_filter(smooth, rate), facts=dict(vars(rig.contacts)))
    if tare is None:
        made.said.append(
            "cells at rest are found in the log itself; tare = seconds in [skin] says when nothing touches"
        )
    return made


_NO_WRENCH = "cells measure no wrench"
SKIN = SensorKind(
    name="skin",
    called="a sheet of taxels",
    table=RigSkin,
    channels=(CELLS,),
    layout=_layout,
    build=_build,
    guess=guess_skin,
    paths=("map", "intensity"),
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
)
