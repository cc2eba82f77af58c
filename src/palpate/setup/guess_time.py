"""Guess the time of a table's samples: its column and unit, or the rate at which the samples come."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from palpate.files.logs import LogContents
from palpate.files.tables.stated import stated_unit
from palpate.files.units import SAMPLES, TIME_UNITS
from palpate.setup.guess import time_table
from palpate.setup.names import counter_column, made_up, split_stamp, time_column
from palpate.spatial.arguments import frozen_value


@frozen_value(eq=True)
class TimeGuess:
    """A guess at the time of a table's samples.

    Attributes:
        column: name of the time's column; "" if there is none.
        unit: unit of the times, as `palpate.files.units` spells it; "": the one in which the log is read.
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

    def judged(self, time: Float[np.ndarray, " n"], unit: str, doubt: str) -> TimeGuess:
        """Return a `TimeGuess` completed from the times as they were read; without finite times, no column.

        Args:
            time: (n,) [s].
            unit: the unit in which they were read.
            doubt: a remark on the unit, or "".
        """
        if len(time) and not np.isfinite(time).any():  # as LabVIEW leaves its X_Value
            lacking = "" if self.stated else f"there are no times in column {self.column!r}"
            return replace(self, column="", unit="s", rate=self.stated or 1.0, lacking=lacking, remarks=())
        if self.unit:
            return self
        if re.fullmatch(r"column_\d+", self.column) and np.allclose(np.diff(time), TIME_UNITS[unit], rtol=1e-6, atol=0):
            return replace(self, unit=SAMPLES, rate=1.0, lacking=_lacking((), self.column))
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
    unit = stated_unit(column, stated, contents.path)
    remark = (
        f"times are those of {column!r}; the rate of {stated.rate:.6g} Hz that is also stated is not used"
        if stated.rate
        else ""
    )
    return TimeGuess(column, unit, remarks=(remark,) if remark else (), stated=stated.rate)


def _lacking(names: Sequence[str], counter: str | None) -> str:
    if parts := split_stamp(names):
        return f"its times are in two columns ({', '.join(parts)}), and one column is needed"
    if counter is not None:
        return f"{counter!r} counts the samples, and their rate is not known"
    if not names or made_up(names):
        return "no column is recognised as the time"
    return f"no column looks like the time: {', '.join(names[:12])}"
