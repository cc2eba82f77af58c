"""The table of sensors. Add a row, or an entry point of another package, and every command, page and test takes it."""

from __future__ import annotations

from collections.abc import Collection, Iterator, MutableMapping

from palpate.calls import by_name
from palpate.io.rig.setup import SensorKind

__all__ = ["ASSUMED", "KINDS", "Kinds"]

GROUP = "palpate.sensors"
"""Entry points of other packages: `name = "module:SENSOR_KIND"`."""


class Kinds(MutableMapping[str, SensorKind]):
    """Name of a sensor's table in a rig -> the sensor, in the order in which they are tried on a log.

    Sensors of other packages come first. They are looked for when a name is asked for that is not in the rows, or when
    all are.

    Args:
        rows: by name the sensor, or where it is defined ("palpate.io.rig.skin.SKIN"), which is imported when it is
            first asked for.
    """

    def __init__(self, rows: dict[str, str | SensorKind]) -> None:
        self._rows, self._complete = rows, False

    def among(self, names: Collection[str]) -> Iterator[SensorKind]:
        """Yield the sensors of these names, in order; what is no sensor's name is left out."""
        rows = self._rows if set(names) <= set(self._rows) else self._all()
        return (self[name] for name in list(rows) if name in names)

    def __getitem__(self, name: str) -> SensorKind:
        row = self._rows[name] if name in self._rows else self._all()[name]
        if isinstance(row, str):
            row = self._rows[name] = by_name(row)
        return row

    def __setitem__(self, name: str, kind: SensorKind) -> None:
        self._rows[name] = kind

    def __delitem__(self, name: str) -> None:
        del self._rows[name]

    def __contains__(self, name: object) -> bool:
        return name in self._rows or name in self._all()

    def __iter__(self) -> Iterator[str]:
        return iter(self._all())

    def __len__(self) -> int:
        return len(self._all())

    def _all(self) -> dict[str, str | SensorKind]:
        if not self._complete:
            from importlib.metadata import entry_points  # here: most rigs name sensors of Palpate's own

            outside = {each.name: each.value.replace(":", ".") for each in entry_points(group=GROUP)}
            self._rows = {**{name: row for name, row in outside.items() if name not in self._rows}, **self._rows}
            self._complete = True
        return self._rows


ASSUMED = "force_torque"
"""The sensor of a rig that states none."""
KINDS = Kinds(
    {
        "fusion": "palpate.io.rig.fusion.FUSION",
        "force_torque": "palpate.io.rig.force_torque.FORCE_TORQUE",
        "load_cells": "palpate.io.rig.load_cells.LOAD_CELLS",
        "marker_ring": "palpate.io.rig.marker_ring.MARKER_RING",
        "skin": "palpate.io.rig.skin.SKIN",
    }
)
