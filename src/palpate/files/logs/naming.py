"""Compare the units that a log of columns states with those of the layout."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path

from palpate.errors import InputError
from palpate.files.logs.layout import WRENCH_COLUMNS, LogLayout
from palpate.files.tables.stated import Stated
from palpate.files.units import ACCELERATION_UNITS, FORCE_UNITS, SAMPLES, TIME_UNITS, TORQUE_UNITS, split_unit, to_si

__all__ = ["require_stated", "stated_layout"]


def stated_layout(layout: LogLayout, names: Iterable[str], stated: Stated) -> LogLayout:
    """Return the layout with columns such as `Fx [N]`, `Time [ms]` in place of missing `fx`, `time`, and their units.

    It is unchanged if it names other columns, or if not each missing one of the wrench has exactly one match with a
    unit.
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
    """Check that the log `path` states no unit that differs from the one in the layout.

    Raises:
        InputError: it does.
    """
    wrench = layout.wrench or ()
    for kind, columns, unit, table, key in (
        ("force", wrench[:3], layout.force_unit, FORCE_UNITS, "[force_torque]"),
        ("torque", wrench[3:], layout.torque_unit, TORQUE_UNITS, "[force_torque]"),
        ("time", (layout.time,), layout.time_unit, TIME_UNITS, "[time] unit"),
        ("acceleration", layout.acceleration or (), layout.acceleration_unit, ACCELERATION_UNITS, "[acceleration]"),
    ):
        for name in columns if unit != SAMPLES else ():
            said = stated.unit(name, kind)
            if said and not _same(said, unit, table):
                what = f"the log states that {name!r} is in {said!r}, but it is read in {unit!r}."
                hint = f"Correct the unit in the rig's {key}, or let `palpate rig new` write it."
                raise InputError(what, where=str(path), hint=hint)


def _same(unit: str, other: str, table: Mapping[str, float]) -> bool:
    """Check whether two units are equal, or one is unknown: a rig may know better."""
    try:
        return abs(to_si(unit, table, where="") / to_si(other, table, where="") - 1.0) < 1e-9
    except InputError:
        return True
