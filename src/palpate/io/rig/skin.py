"""The rig of a taxel sheet: [skin] in place of a force/torque sensor, and what it builds."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from palpate.contact.several import Skin, SkinSettings
from palpate.errors import InputError
from palpate.io.intensity import read_intensity
from palpate.io.logs.layout import ArrayChannel, Layout
from palpate.io.models import load_toml
from palpate.io.rig.surface import RigSurface
from palpate.io.rig.tables import RigForceTorque, RigTime
from palpate.io.skin_map import read_skin_map
from palpate.io.strict import parse
from palpate.io.units import TIME_UNITS, to_si
from palpate.sensors.intensity import Curve, Intensity
from palpate.sensors.recording import CELLS
from palpate.sensors.skin import Health, Sheet
from palpate.sensors.skin_map import SkinMap

__all__ = ["RigSkin", "SkinRig", "build_skin", "is_skin_rig", "load_skin_rig"]

_PLAIN = Curve("polynomial", np.ones(1), np.zeros((1, 1)), largest=1.0)  # a count is taken for a newton


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


@dataclass(frozen=True)
class SkinRig:
    """The whole file; `folder` is where relative paths start."""

    skin: RigSkin
    time: RigTime = field(default_factory=RigTime)
    contacts: SkinSettings = field(default_factory=SkinSettings)
    surface: RigSurface | None = None
    force_torque: RigForceTorque = field(default_factory=RigForceTorque)
    folder: Path = field(default_factory=Path)

    def map_path(self) -> Path:
        """Of the map."""
        return self.folder / self.skin.map

    def intensity_path(self) -> Path | None:
        """Of the curves, if they are named."""
        return None if self.skin.intensity is None else self.folder / self.skin.intensity

    def place(self) -> SkinMap:
        """Where the cells sit.

        Raises:
            InputError: the map cannot be read, or is of another sheet than `rows` and `columns` say.
        """
        found, skin = read_skin_map(self.map_path()), self.skin
        rows, columns = skin.rows or found.rows, skin.columns or found.columns
        if (rows, columns) != (found.rows, found.columns):
            raise InputError(
                f"maps {found.rows} x {found.columns} cells, but the rig's [skin] says {rows} x {columns}.",
                where=str(self.map_path()),
                mend="Make the map for this sheet with palpate map skin --sheet.",
            )
        return found

    def intensity(self) -> Intensity:
        """What readings mean; where the rig names nothing, a count is taken for a newton."""
        path = self.intensity_path()
        return Intensity((_PLAIN,), unit="newtons") if path is None else read_intensity(path)

    def sheet(self, place: SkinMap) -> Sheet:
        """Of the map's size."""
        return Sheet(place.rows, place.columns, self.skin.bits or None, self.skin.masked)

    def layout(self, place: SkinMap) -> Layout:
        """How to read a log of this rig."""
        skin = self.skin
        cells = ArrayChannel(CELLS, (place.rows, place.columns), skin.cells, skin.topic, table="skin")
        return Layout(time=self.time.column, time_unit=self.time.unit, wrench=None, arrays=(cells,), rate=skin.rate)


def is_skin_rig(path: Path) -> bool:
    """Whether a rig has a [skin]; what is wrong with it is said by who loads it."""
    return "skin" in load_toml(path)


def load_skin_rig(path: Path) -> SkinRig:
    """Read a rig with a [skin].

    Raises:
        InputError: not there, not TOML, a key misspelt or missing, a value of another kind or out of bounds.
    """
    table = load_toml(path)
    if "skin" not in table:
        raise InputError("has no [skin].", where=str(path), mend="A rig of a taxel sheet needs one: map = FILE.")
    if "folder" in table:
        raise InputError("unknown key 'folder'.", where=str(path))
    rig = replace(parse(table, SkinRig, file=str(path)), folder=path.parent)
    to_si(rig.time.unit, TIME_UNITS, where=f"{path}: time.unit")
    return rig


def build_skin(rig: SkinRig, place: SkinMap, health: Health) -> Skin:
    """The chain of a rig, once the sheet at rest is known."""
    return Skin(place, rig.intensity(), rig.sheet(place), health, rig.contacts)
