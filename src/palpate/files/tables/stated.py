"""Extract the units and the rate that a table states in its names, in a row of units, or before them."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from palpate.files.tables.dialect import Dialect
from palpate.files.units import FORCE_UNITS, TIME_UNITS, TORQUE_UNITS, known_unit, split_unit

_RATE = re.compile(
    r"\b(?:(?:rdt )?(?:sampl\w*|data|output|acquisition|scan)[ _]?(?:rate|freq\w*)|abtastrate|freq\w*|rate)\b"
)
_INTERVAL = re.compile(r"\b(?:sampl\w*[ _](?:interval|period|time)|time[ _]step|delta_?[xt]|dt)\b")
_COUNTS = re.compile(r"\bcounts? ?(?:per|/) ?(?:unit )?(force|torque|n ?m|n)\b")


@dataclass(frozen=True)
class Stated:
    """Units, as spelt in a table, and rate that it states.

    Attributes:
        units: column -> unit, where its name or a row of units has one.
        force, torque: unit of columns that state none, or "": "N", or "N/1000000" for a million counts per newton.
        rate: [Hz] of the samples; None if it is not stated.
        pitch: [m] between the cells of frames; None if it is not stated.
    """

    units: Mapping[str, str] = field(default_factory=dict[str, str])
    force: str = ""
    torque: str = ""
    rate: float | None = None
    pitch: float | None = None

    @classmethod
    def of_names(cls, names: Iterable[str]) -> Stated:
        """Return the units that column names contain."""
        return cls({name: unit for name in names if (unit := split_unit(name)[1])})

    @classmethod
    def of_dialect(cls, dialect: Dialect) -> Stated:
        """Return the units and the rate that a text states before its rows."""
        rows = dict(zip(dialect.names, dialect.units, strict=False))
        units = {name: unit for name, unit in rows.items() if unit.strip("-")}
        for name, unit in cls.of_names(dialect.names).units.items():
            units[name] = unit if units.get(name, unit) == unit else f"{unit} and {units[name]}"  # no unit at all
        facts = dialect.stated
        force, torque = _unit(facts, r"\bforce units?\b", "N"), _unit(facts, r"\b(?:torque|moment) units?\b", "N m")
        for key, value in facts.items():
            if (match := _COUNTS.search(key)) and _number(value):
                count = f"{_number(value):.15g}"
                if match[1] in ("force", "n"):
                    force = f"{force or 'N'}/{count}"
                else:
                    torque = f"{torque or 'N m'}/{count}"
        return cls(units, force, torque, _rate(facts))

    def unit(self, name: str, kind: str = "") -> str:
        """Return the unit of a column; "" if none is stated. `kind` is "force", "torque" or anything else."""
        return self.units.get(name) or (self.force if kind == "force" else self.torque if kind == "torque" else "")


def _unit(facts: Mapping[str, str], key: str, usual: str) -> str:
    table = FORCE_UNITS if usual == "N" else TORQUE_UNITS
    return next((value for name, value in facts.items() if re.search(key, name) and known_unit(value, table)), "")


def _rate(facts: Mapping[str, str]) -> float | None:
    """Return the rate [Hz] over the number averaged; None if it is not stated."""
    rate: float | None = None
    averaged = 1.0
    for key, value in facts.items():
        if (number := _number(value)) and "averag" in key:
            averaged = number
        elif number and _RATE.search(key) and "baud" not in key:
            rate = number * (1e3 if re.search(r"\bkhz\b", f"{key} {value}", re.IGNORECASE) else 1.0)
        elif number and _INTERVAL.search(key) and rate is None:
            unit = known_unit(split_unit(key)[1] or value.split()[-1], TIME_UNITS) or "s"
            rate = 1.0 / (number * TIME_UNITS[unit])
    return None if rate is None else rate / averaged


def _number(text: str) -> float:
    match = re.match(r"\d+(?:[.,]\d*)?(?:[eE][-+]?\d+)?", text)
    return float(match[0].replace(",", ".")) if match else 0.0
