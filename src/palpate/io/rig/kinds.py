"""The table of sensors. Add a row, and every command, page and test takes it."""

from __future__ import annotations

from collections.abc import Iterator, MutableMapping

from palpate.calls import by_name
from palpate.io.rig.setup import SensorKind

__all__ = ["KINDS", "Kinds"]


class Kinds(MutableMapping[str, SensorKind]):
    """Name of a sensor's table in a rig -> the sensor, in the order in which they are tried on a log.

    Args:
        rows: by name the sensor, or where it is defined ("palpate.io.rig.skin.SKIN"), which is imported when it is
            first asked for.
    """

    def __init__(self, rows: dict[str, str | SensorKind]) -> None:
        self._rows = rows

    def __getitem__(self, name: str) -> SensorKind:
        row = self._rows[name]
        if isinstance(row, str):
            row = self._rows[name] = by_name(row)
        return row

    def __setitem__(self, name: str, kind: SensorKind) -> None:
        self._rows[name] = kind

    def __delitem__(self, name: str) -> None:
        del self._rows[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._rows)

    def __len__(self) -> int:
        return len(self._rows)


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
