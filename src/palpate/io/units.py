"""Units as people write them, and what they are in SI."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Mapping
from math import floor, isfinite, log10

from palpate.errors import InputError

__all__ = ["FORCE_UNITS", "TIME_UNITS", "TORQUE_UNITS", "measured", "near", "to_si"]

_POUND, _KILOPOND, _INCH = 4.4482216152605, 9.80665, 0.0254

FORCE_UNITS: Mapping[str, float] = {
    "N": 1.0,
    "kN": 1e3,
    "mN": 1e-3,
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


def to_si(unit: str, table: Mapping[str, float], *, where: str) -> float:
    """What one `unit` is in SI; "N m", "Nm", "N*m" and "N.m" are the same.

    Raises:
        InputError: the unit is not in the table.
    """
    spelled = {_squeezed(name): factor for name, factor in table.items()}
    try:
        return spelled[_squeezed(unit)]
    except KeyError:
        raise InputError(f"unknown unit {unit!r}.", where=where, hint=f"Known: {', '.join(table)}.") from None


def near(name: str, names: Iterable[str]) -> str:
    """A sentence that offers the names nearest to `name`, or lists them when few, or nothing."""
    known = list(names)
    by_lower = {other.lower(): other for other in known}
    close = [by_lower[match] for match in difflib.get_close_matches(name.lower(), list(by_lower), n=3, cutoff=0.6)]
    if close:
        return f"Did you mean {' or '.join(repr(match) for match in close)}?"
    shown = ", ".join(repr(other) for other in known[:12])
    return f"There is {shown}{', ...' if len(known) > 12 else ''}." if known else ""


def measured(values: Iterable[float], spreads: Iterable[float], unit: str) -> str:
    """Values and their standard deviations, with the digits that the deviations leave standing."""
    both = list(zip(values, spreads, strict=True))
    largest = max((spread for _, spread in both), default=0.0)
    digits = min(8, max(0, 1 - floor(log10(largest)))) if largest > 0 and isfinite(largest) else 4
    left, right = (", ".join(f"{pair[k]:.{digits}f}" for pair in both) for k in (0, 1))
    return f"{left} +- {right} {unit}" if len(both) == 1 else f"({left}) +- ({right}) {unit}"


def _squeezed(unit: str) -> str:
    return re.sub(r"[\s.*·⋅-]", "", unit)
