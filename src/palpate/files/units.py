"""Parse units in their usual spellings and convert them to SI."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Mapping
from functools import cache, lru_cache
from math import floor, inf, isfinite, log10

from palpate.errors import InputError

_POUND, _KILOPOND, _INCH = 4.4482216152605, 9.80665, 0.0254

FORCE_UNITS: Mapping[str, float] = {
    "N": 1.0,
    "kN": 1e3,
    "mN": 1e-3,
    "daN": 10.0,
    "kgf": _KILOPOND,
    "gf": _KILOPOND * 1e-3,
    "lbf": _POUND,
}
TORQUE_UNITS: Mapping[str, float] = {
    "N m": 1.0,
    "N cm": 1e-2,
    "N mm": 1e-3,
    "kN m": 1e3,
    "mN m": 1e-3,
    "kgf m": _KILOPOND,
    "kgf cm": _KILOPOND * 1e-2,
    "lbf ft": _POUND * 12 * _INCH,
    "lbf in": _POUND * _INCH,
}
TIME_UNITS: Mapping[str, float] = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
SAMPLES = "samples"  # unit of time of a sample counter, which the rate converts to seconds
PRESSURE_UNITS: Mapping[str, float] = {
    "Pa": 1.0,
    "hPa": 1e2,
    "kPa": 1e3,
    "MPa": 1e6,
    "bar": 1e5,
    "mbar": 1e2,
    "psi": _POUND / _INCH**2,
    "mmHg": 133.322387415,
    "N/cm^2": 1e4,
    "N/mm^2": 1e6,
    "kgf/cm^2": _KILOPOND * 1e4,
    "gf/cm^2": _KILOPOND * 10.0,
}
ELECTRIC_UNITS: Mapping[str, float] = {"counts": 1.0, "V": 1.0, "mV": 1.0, "Ohm": 1.0, "kOhm": 1.0, "S": 1.0}
"""Units of readings that a curve turns into forces, as they are."""
CELL_UNITS: Mapping[str, float] = {**FORCE_UNITS, **PRESSURE_UNITS}
ACCELERATION_UNITS: Mapping[str, float] = {"m/s^2": 1.0, "g": _KILOPOND, "mg": _KILOPOND * 1e-3}

_ALIASES: Mapping[str, tuple[str, ...]] = {  # as the tables spell it -> as others do, in lower case, squeezed
    "N": ("n", "newton", "newtons"),
    "kgf": ("kg", "kp"),
    "gf": ("g",),
    "lbf": ("lb", "lbs"),
    "N m": ("nm", "newtonmeter", "newtonmeters", "newtonmetre", "newtonmetres"),
    "N cm": ("ncm",),
    "N mm": ("nmm",),
    "kgf m": ("kgm",),
    "kgf cm": ("kgcm",),
    "lbf ft": ("lbft", "ftlb", "ftlbf", "ftlbs", "lbsft"),
    "lbf in": ("lbin", "inlb", "inlbf", "inlbs", "lbsin"),
    "Pa": ("pa", "pascal"),
    "kPa": ("kpa", "kilopascal"),
    "mmHg": ("mmhg",),
    "N/cm^2": ("n/cm2", "n/cm\u00b2"),
    "N/mm^2": ("n/mm2", "n/mm\u00b2"),
    "kgf/cm^2": ("kgf/cm2", "kg/cm2", "kg/cm^2"),
    "gf/cm^2": ("gf/cm2", "g/cm2", "g/cm^2"),
    "V": ("v", "volt", "volts"),
    "counts": ("count", "cts", "lsb", "adc"),
    "Ohm": ("ohm", "ohms"),
    "kOhm": ("kohm", "kohms"),
    "s": ("sec", "secs", "second", "seconds"),
    "ms": ("msec", "msecs", "millis", "millisecond", "milliseconds"),
    "us": ("\u00b5s", "\u03bcs", "usec", "usecs", "micros", "microsecond", "microseconds"),  # both signs for micro
    "ns": ("nsec", "nsecs", "nanos", "nanosecond", "nanoseconds"),
    "m/s^2": ("m/s\u00b2", "m/s2", "m/s**2", "m/sec^2"),
}
_KNOWN_AS = {alias: name for name, aliases in _ALIASES.items() for alias in aliases}
_TABLES = (TIME_UNITS, FORCE_UNITS, TORQUE_UNITS, ACCELERATION_UNITS)
_FOREIGN = re.compile(  # units in none of the tables: a column with one is refused, not read as SI
    r"[mu]?v|volts?|counts?|cts|lsb|bits|digits|%|percent|mins?|minutes?|hr?s?|hours?|d|days?", re.IGNORECASE
)
_BRACKETED = re.compile(r"\s*(?:\[([^\[\]]*)\]|\(([^()]*)\))")
_TRAILING = re.compile(r"^(.*?\w)(?:\s*/\s*|\s+in\s+|[_\s]+)([^\s_/]+|m/s\^?2)$")


def to_si(unit: str, table: Mapping[str, float], *, where: str) -> float:
    """Return the size of one `unit` in SI; "Nm", "N*m" and "N.m" mean "N m", and "N/1000" is a thousandth of "N".

    Raises:
        InputError: the unit, which stands at the place `where`, is not in the table.
    """
    known, count = known_unit(unit, table), 1.0
    if known is None and "/" in unit:  # counts of a sensor: so many make one unit
        bare, _, parts = unit.rpartition("/")
        known, count = known_unit(bare, table), positive(parts)
    if known is None or not count:
        raise InputError(f"unknown unit {unit!r}.", where=where, hint=f"Known: {', '.join(table)}.")
    return table[known] / count


def known_unit(unit: str, table: Mapping[str, float]) -> str | None:
    """Return the unit in the spelling of the table, or None if the table does not have it."""
    spelled, bare = _spelled(tuple(table)), _squeezed(unit)
    return spelled.get(bare) or spelled.get(_squeezed(_KNOWN_AS.get(bare.lower(), "?")))


@lru_cache(maxsize=1 << 15)  # called several times for each of the columns of a log
def split_unit(name: str) -> tuple[str, str]:
    """Return quantity and unit, or "", of a column's name: `Fx [N]`, `Fx (N)`, `Fx_N`, `Fx / N`.

    Text in square brackets is a unit unless it is an index or an axis; other text only if it is known to be one.
    """
    units = [(match, (match[1] or match[2] or "").strip()) for match in _BRACKETED.finditer(name)]
    units = [(match, text) for match, text in units if not re.fullmatch(r"\d*|[xyzwXYZW]", text)]
    for match, text in sorted(units, key=lambda each: not _known(each[1])):
        if _known(text) or match[1] is not None or _FOREIGN.fullmatch(text):  # words in round brackets may say anything
            return (name[: match.start()] + name[match.end() :]).strip(), text
    if (match := _TRAILING.fullmatch(name)) and (
        _known(match[2], certain=True) or match[2].lower() in ("volt", "volts", "counts", "kpa", "kg")
    ):
        return match[1], match[2]
    return name, ""


def _known(unit: str, *, certain: bool = False) -> bool:
    """Check whether a unit is known; `certain`: as its table spells it, or a word (not `fx_n`)."""
    if certain and len(unit) < 3:
        return unit != "g" and any(unit in table for table in _TABLES)
    return any(known_unit(unit, table) for table in (_TABLES if certain else (*_TABLES, PRESSURE_UNITS)))


def positive(text: str) -> float:
    """Return the positive, finite number that a text is; 0 if it is none."""
    try:
        value = float(text)
    except ValueError:
        return 0.0
    return value if 0.0 < value < inf else 0.0


def near(name: str, names: Iterable[str]) -> str:
    """Return a hint with the names nearest to `name`, else with the first twelve; "" if there are no names."""
    known = list(names)
    by_lower = {other.lower(): other for other in known}
    close = [by_lower[match] for match in difflib.get_close_matches(name.lower(), list(by_lower), n=3, cutoff=0.6)]
    if close:
        return f"Did you mean {' or '.join(repr(match) for match in close)}?"
    shown = ", ".join(repr(other) for other in known[:12])
    return f"Available: {shown}{', ...' if len(known) > 12 else ''}." if known else ""


def measured(values: Iterable[float], spreads: Iterable[float], unit: str) -> str:
    """Return values and their standard deviations as text, to the digits that the deviations justify.

    Raises:
        ValueError: there are more of one than of the other.
    """
    both = list(zip(values, spreads, strict=True))
    largest = max((spread for _, spread in both), default=0.0)
    digits = min(8, max(0, 1 - floor(log10(largest)))) if largest > 0 and isfinite(largest) else 4
    left, right = (", ".join(f"{pair[k]:z.{digits}f}" for pair in both) for k in (0, 1))
    return f"{left} +- {right} {unit}" if len(both) == 1 else f"({left}) +- ({right}) {unit}"


@cache
def _spelled(names: tuple[str, ...]) -> dict[str, str]:
    return {_squeezed(name): name for name in names}


def _squeezed(unit: str) -> str:
    return re.sub(r"[\s.*·⋅-]", "", unit)
