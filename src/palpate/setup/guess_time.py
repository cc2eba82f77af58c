"""Guess the time of a table's samples: its column and unit, or the rate at which the samples come."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import log

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError
from palpate.files.logs import LogContents
from palpate.files.units import SAMPLES, TIME_UNITS, known_unit
from palpate.setup.guess import time_table
from palpate.setup.names import counter_column, made_up, split_stamp, time_column
from palpate.spatial.arguments import takes_arrays

__all__ = ["TimeGuess", "guess_time", "unit_by_size"]

_EPOCHS = ((1e17, "ns"), (1e14, "us"), (1e11, "ms"))  # times of day above these cannot be seconds
_RATES = (1.0, 2e4)  # Hz: of a log of forces; 1 kHz in ms would be 1 Hz in s
_NOT_READ = re.compile(r"(?:[\W_])(mins?|minutes?|h|hrs?|hours?|days?)\W*$", re.IGNORECASE)  # of a column of times
_USUAL = 300.0  # Hz: what a rate is nearest to, where two units make one


@takes_arrays
@dataclass(frozen=True)
class TimeGuess:
    """A guess at the time of a table's samples.

    Attributes:
        column: the time's column; "" if there is none.
        unit: unit of the times, as `palpate.files.units` spells it; "": `judged` finds it.
        rate: [Hz] if the samples are counted, or have no column of time.
        lacking: what must be known before the log can be read in seconds, or "".
        remarks: what the reader should check, one sentence each.
        stated: [Hz] that the log or --rate states in addition to the column.
    """

    column: str
    unit: str = "s"
    rate: float | None = None
    lacking: str = ""
    remarks: tuple[str, ...] = ()
    stated: float | None = None

    def judged(self, time: Float[np.ndarray, " n"]) -> TimeGuess:
        """Return the guess with a unit, by the times if none is stated; without a column if no time is finite.

        Raises:
            InputError: time has another shape.
        """
        if len(time) and not np.isfinite(time).any():  # as LabVIEW leaves its X_Value
            lacking = "" if self.stated else f"there are no times in column {self.column!r}"
            return replace(self, column="", unit="s", rate=self.stated or 1.0, lacking=lacking, remarks=())
        if self.unit:
            return self
        if re.fullmatch(r"column_\d+", self.column) and (np.diff(time) == 1.0).all():
            return replace(self, unit=SAMPLES, rate=1.0, lacking=_lacking((), self.column))
        unit, doubt = unit_by_size(time, self.column)
        return replace(self, unit=unit, remarks=(*([doubt] if doubt else []), *self.remarks))

    def text(self) -> str:
        """Return the [time] of a rig as TOML text."""
        return time_table(self.column, self.unit, self.rate)


def guess_time(contents: LogContents, wrench: Sequence[str]) -> TimeGuess:
    """Guess the time from the columns that are not the wrench's, and from the rate that the log states.

    Raises:
        InputError: the unit that the log states for the time is unknown.
    """
    names = [name for name in contents.names if name not in wrench]
    stated, counter = contents.stated, counter_column(names)
    column = time_column(names)
    if column is None and names[:1] == ["column_1"]:
        column = names[0]  # of a table without names, or an index that has none
    if stated.rate is not None and (counter is not None or column is None):
        remark = f"samples are taken at {stated.rate:.6g} Hz, as the log or --rate states: check rate in [time]"
        return TimeGuess(counter or "", SAMPLES if counter else "s", stated.rate, remarks=(remark,))
    if column is None:
        return TimeGuess(counter or "", SAMPLES if counter else "s", 1.0, lacking=_lacking(names, counter))
    unit = stated.unit(column) or known_unit(column, TIME_UNITS) or ""  # a column may be called ms
    if not unit and (match := _NOT_READ.search(column)):
        unit = match[1]
    known = known_unit(unit, TIME_UNITS)
    if unit and known is None and ":" not in unit:  # hh:mm:ss is a stamp
        hint = f"Known: {', '.join(TIME_UNITS)}."
        raise InputError(f"unknown unit {unit!r} of {column!r}.", where=str(contents.path), hint=hint)
    remarks = ()
    if stated.rate:
        remarks = (f"times are those of {column!r}; the rate of {stated.rate:.6g} Hz that is also stated is not used",)
    return TimeGuess(column, known or "", remarks=remarks, stated=stated.rate)


@takes_arrays
def unit_by_size(time: Float[np.ndarray, " n"], column: str) -> tuple[str, str]:
    """Return the likely unit of times, "s", "ms", "us" or "ns", and a remark, "" if the unit is clear.

    Times since 1970 are told by their size, others by the rate that results.

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
    rates = {unit: 1.0 / (step * scale) for unit, scale in TIME_UNITS.items()}
    likely = [unit for unit, rate in rates.items() if _RATES[0] <= rate * (1 + 1e-9) and rate <= _RATES[1]]
    if "s" in likely and (known != np.round(known)).any():
        likely = ["s"]
    if not likely:
        return "s", f"{column!r} may not be the time: its steps of {step:.4g} would be {rates['s']:.4g} Hz"
    unit = min(likely, key=lambda each: abs(log(rates[each] / _USUAL)))
    if unit == "s" and len(likely) == 1:
        return "s", ""
    others = ", ".join(each for each in TIME_UNITS if each != unit and rates[each] < 1e5 and rates[each] > 1e-2)
    doubt = f"{column!r} states no unit: its steps of {step:.4g} are taken for {unit} ({rates[unit]:.4g} Hz)"
    return unit, f"{doubt}; for {others} change [time] unit" if others else doubt


def _lacking(names: Sequence[str], counter: str | None) -> str:
    if parts := split_stamp(names):
        return f"its times are in two columns ({', '.join(parts)}), and one column is needed"
    if counter is not None:
        return f"{counter!r} counts the samples, and their rate is not known"
    if made_up(names):
        return "no column is recognised as the time"
    return f"no column looks like the time: {', '.join(names[:12])}"
