"""Compare the units that a log of columns states with those of the layout."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from palpate.errors import InputError
from palpate.files.logs.layout import WRENCH_COLUMNS, LogLayout
from palpate.files.tables.stated import Stated
from palpate.files.units import ACCELERATION_UNITS, FORCE_UNITS, SAMPLES, TIME_UNITS, TORQUE_UNITS, split_unit, to_si

__all__ = ["require_stated", "stated_layout"]


def stated_layout(layout: LogLayout, names: Iterable[str], stated: Stated) -> LogLayout:
    """Return a `LogLayout` with `Fx [N]`, `Time [ms]` in place of missing `fx`, `time`, and with their units.

    Each name must have one match, and a match must have a unit: for other names a rig states the column.
    """
    if layout.wrench != WRENCH_COLUMNS or layout.time != "time":
        return layout
    known = set(names)
    wanted = [name for name in (layout.time, *WRENCH_COLUMNS) if name not in known]
    if not wanted:
        return layout
    found: dict[str, list[str]] = {name: [] for name in wanted}
    for name in known:
        bare = split_unit(name)[0].lower()
        if name in stated.units and bare in found:
            found[bare].append(name)
    if not all(len(found[name]) == 1 for name in wanted if name in WRENCH_COLUMNS):
        return layout
    columns = tuple(found[name][0] if name in found else name for name in WRENCH_COLUMNS)
    changes: dict[str, object] = {"wrench": columns}
    for key, part in (("force_unit", columns[:3]), ("torque_unit", columns[3:])):
        units = {stated.units[name] for name in part if name in stated.units}
        if len(units) == 1:
            changes[key] = units.pop()
    if len(time := found.get("time", [])) == 1:
        changes |= {"time": time[0], "time_unit": stated.units[time[0]]}
    return replace(layout, **changes)


def require_stated(layout: LogLayout, stated: Stated, path: Path) -> None:
    """Raise an InputError if the log states a unit that differs from the one in the layout."""
    wrench = layout.wrench or ()
    for kind, columns, unit, table in (
        ("force", wrench[:3], layout.force_unit, FORCE_UNITS),
        ("torque", wrench[3:], layout.torque_unit, TORQUE_UNITS),
        ("time", (layout.time,), layout.time_unit, TIME_UNITS),
        ("acceleration", layout.acceleration or (), layout.acceleration_unit, ACCELERATION_UNITS),
    ):
        if unit != SAMPLES:
            _require_same(kind, columns, unit, table, stated, path)


def _require_same(
    kind: str, columns: Sequence[str], unit: str, table: Mapping[str, float], stated: Stated, path: Path
) -> None:
    for name in columns:
        said = stated.unit(name, kind)
        try:
            same = not said or abs(to_si(said, table, where="") / to_si(unit, table, where="") - 1.0) < 1e-9
        except InputError:  # a unit that is not known: a rig may know better
            same = True
        if not same:
            key = (
                "[time] unit" if kind == "time" else f"[{'acceleration' if kind == 'acceleration' else 'force_torque'}]"
            )
            raise InputError(
                f"the log states that {name!r} is in {said!r}, but it is read in {unit!r}.",
                where=str(path),
                hint=f"Correct the unit in the rig's {key}, or let `palpate rig new` write it.",
            )
