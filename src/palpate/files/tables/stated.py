"""Find the units and the rate that a table states, in its names or before its rows, or that its times suggest."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from math import log
from pathlib import Path

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError
from palpate.files.tables.dialect import Dialect
from palpate.files.units import FORCE_UNITS, TIME_UNITS, TORQUE_UNITS, known_unit, split_unit
from palpate.spatial.arguments import takes_arrays

_RATE = re.compile(
    r"\b(?:(?:rdt )?(?:sampl\w*|data|output|acquisition|scan)[ _]?(?:rate|freq\w*)|abtastrate|freq\w*|rate)\b"
)
_INTERVAL = re.compile(r"\b(?:sampl\w*[ _](?:interval|period|time)|time[ _]step|delta_?[xt]|dt)\b")
_COUNTS = re.compile(r"\bcounts? ?(?:per|/) ?(?:unit )?(force|torque|n ?m|n)\b")
_EPOCHS = ((1e17, "ns"), (1e14, "us"), (1e11, "ms"))  # times of day above these cannot be seconds
_DATES = (1e9, 2.5e9)  # s: of the years 2001 to 2049, unless steps are as long as microseconds make them
_LONGEST_STEP = 50.0  # us: of 20 kHz
_RATES = (1.0, 2e4)  # Hz: of a log of forces; 1 kHz in ms would be 1 Hz in s
_SHORTEST = 0.1  # s: a log of forces is longer
_NOT_READ = re.compile(r"(?:[\W_])(mins?|minutes?|h|hrs?|hours?|days?)\W*$", re.IGNORECASE)  # of a column of times
_USUAL = 300.0  # Hz: what a rate is nearest to, where two units make one


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


def stated_unit(column: str, stated: Stated, path: Path) -> str:
    """Return the unit of the times in a column that a table states, as `TIME_UNITS` spells it; "" if it states none.

    Raises:
        InputError: the unit is not one of time, or is longer than a second.
    """
    unit = stated.unit(column) or known_unit(column, TIME_UNITS) or ""  # a column may be called ms
    if not unit and (match := _NOT_READ.search(column)):
        unit = match[1]
    known = known_unit(unit, TIME_UNITS)
    if unit and known is None and ":" not in unit:  # hh:mm:ss is a stamp
        raise InputError(
            f"unknown unit {unit!r} of {column!r}.", where=str(path), hint=f"Known: {', '.join(TIME_UNITS)}."
        )
    return known or ""


@takes_arrays
def judged_unit(time: Float[np.ndarray, " n"], column: str) -> tuple[str, str]:
    """Return the unit of times that state none, "s", "ms", "us" or "ns", and a remark, "" if the unit is clear.

    The unit follows from the size of times since 1970, and for other times from the rate and the length of the log that
    result: whole numbers 0, 1, 2, ... are milliseconds, and seconds where there are too few for that.

    Raises:
        InputError: time has another shape.
    """
    known = time[np.isfinite(time)]
    largest = np.abs(known).max(initial=0.0)
    if epoch := next((unit for limit, unit in _EPOCHS if largest > limit), None):
        return epoch, ""
    steps = np.diff(known)
    forward = steps[steps > 0]
    if 3 * len(forward) < len(steps):
        most = "repeat the one before" if 2 * np.count_nonzero(steps == 0) > len(steps) else "run backwards"
        doubt = f"{column!r} may not be the time: most of its values {most}"
        return "s", f"{doubt}; name another column in [time], or leave column out and write rate, in Hz"
    if not len(forward):
        return "s", ""
    step = float(np.median(forward))
    if _DATES[0] <= largest <= _DATES[1] and step < _LONGEST_STEP:
        return "s", ""
    rates = {unit: 1.0 / (step * scale) for unit, scale in TIME_UNITS.items()}
    likely = [unit for unit, rate in rates.items() if _RATES[0] <= rate * (1 + 1e-9) and rate <= _RATES[1]]
    likely = [unit for unit in likely if unit == "s" or np.ptp(known) * TIME_UNITS[unit] >= _SHORTEST]
    whole = bool((known == np.round(known)).all())
    if not whole and "s" in likely:
        likely = ["s"]
    if not likely:
        return "s", f"{column!r} may not be the time: its steps of {step:.4g} would be {rates['s']:.4g} Hz"
    unit = min(likely, key=lambda each: abs(log(rates[each] / _USUAL)))
    if unit == "s" and len(likely) == 1:
        return "s", ""
    others = ", ".join(each for each in TIME_UNITS if each != unit and rates[each] < 1e5 and rates[each] > 1e-2)
    doubt = f"{column!r} states no unit: its steps of {step:.4g} are taken for {unit} ({rates[unit]:.4g} Hz)"
    return unit, f"{doubt}; for {others} change [time] unit" if others else doubt


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
