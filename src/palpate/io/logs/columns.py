"""A log of columns, CSV or Parquet, in blocks: which columns are what, and how well they could be read."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError
from palpate.io.logs.layout import ACCELERATION_COLUMNS, ORIENTATION_COLUMNS, POSITION_COLUMNS, Layout
from palpate.io.logs.samples import Samples
from palpate.io.tables.fields import Fields
from palpate.io.units import TIME_UNITS, near, to_si
from palpate.sensors.load_cells import REFERENCE, VOLTAGE
from palpate.sensors.recording import ACCELERATION, ORIENTATION, POSITION, Recording

__all__ = ["Columns"]

Read = Callable[[Sequence[str], Fields], Float[np.ndarray, "n k"]]


class Columns:
    """Makes the blocks of a log out of its columns.

    Raises:
        InputError: the layout cannot be meant, or a column that it names is not there.
    """

    def __init__(self, layout: Layout, path: Path, names: Sequence[str]) -> None:
        self._samples, self._path = Samples(layout, path), path
        self._per_second = round(1 / to_si(layout.time_unit, TIME_UNITS, where="time_unit"))
        self._time, self._wrench = [layout.time], () if layout.voltages else layout.wrench
        _require_known([layout.time, *self._wrench, *layout.voltages, *layout.reference], names, path)
        self._others: dict[str, Sequence[str]] = {}
        for channel, declared, usual in (
            (ORIENTATION, layout.orientation, ORIENTATION_COLUMNS),
            (POSITION, layout.position, POSITION_COLUMNS),
            (ACCELERATION, layout.acceleration, ACCELERATION_COLUMNS),
            (VOLTAGE, layout.voltages, None),
            (REFERENCE, layout.reference, None),
        ):
            if columns := declared or (usual if usual and set(usual) <= set(names) else ()):
                _require_known(columns, names, path)
                self._others[channel] = columns
        read = ("time", "wrench") if self._wrench else ("time",)
        self._fields = {columns: Fields() for columns in (*read, *self._others)}

    @property
    def names(self) -> list[str]:
        """Every column that is read."""
        return list(dict.fromkeys([*self._time, *self._wrench, *(name for of in self._others.values() for name in of)]))

    def block(self, read: Read) -> Recording:
        """The next samples; `read` gives columns as numbers."""
        time = read(self._time, self._fields["time"])[:, 0] / self._per_second  # 235 / 1e3 is 0.235, 235 * 1e-3 is not
        wrench = read(self._wrench, self._fields["wrench"]) if self._wrench else None
        others = {channel: read(columns, self._fields[channel]) for channel, columns in self._others.items()}
        return self._samples.block(time, wrench, others)

    def finish(self) -> None:
        """Raise an InputError if a column held no number from the first block to the last."""
        for fields in self._fields.values():
            fields.require_numbers(self._path)

    def notes(self) -> tuple[str, ...]:
        """What a reader should know of the blocks so far."""
        return tuple(note for fields in self._fields.values() for note in fields.notes()) + self._samples.notes()


def _require_known(wanted: Sequence[str], names: Sequence[str], path: Path) -> None:
    """One sentence for all missing columns, not one error after the other."""
    missing = [name for name in wanted if name not in names]
    if missing:
        raise InputError(
            f"there is no column {', '.join(map(repr, missing))}.",
            where=str(path),
            mend=f"{near(missing[0], names)} Columns are named in a rig; `palpate rig new` guesses them.".strip(),
        )
