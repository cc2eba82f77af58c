"""Find lines of numbers that one damaged character has changed, by a checksum or by a jump that no sensor makes.

A line may end in `*` and two hexadecimal digits, the exclusive or of the bytes before (those after a first `$` or `!`),
as NMEA 0183 has it. Without a checksum, a line is doubtful if

1. one number, and no other, is far from the line before: by more than 12 times its usual step, the others within 7,
2. the number is back in the next two lines, and
3. another character in its place, one less or one more, would make it agree with the lines before and after.

A touch or an impact changes several numbers, lasts longer, or rings. If it does none of these, it is doubtful only if
its digits happen to agree. Without a checksum, damage is not found that changes a number by less than 12 usual steps,
in several numbers at once, while others jump, or among the first 16 lines.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import reduce
from math import isfinite
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

_SEAL = re.compile(rb"\*([0-9A-Fa-f]{2})\s*$")
_TRUST = 10  # lines that settle whether their ends are checksums
_FAR = 12.0  # usual steps from the line before: a jump
_QUIET = 7.0  # usual steps: what noise makes, of which the usual one is the median
_NEAR = 5.0  # usual steps within which a mended number agrees with the mean of the lines around it
_AFTER = 2  # lines after the jump in which the number is back
_MOST = 6  # lines that wait
_AFTERMATH = 6  # lines after a jump of another cause, such as an impact, in which a number may ring
_LEARN = 16  # lines from which the first usual step comes
_FORGET = 1 / 64  # weight of a new step
_LONGEST = 40  # characters of a number that may be mended: every one is tried
_CHARACTERS = "0123456789.-+"


class Line(NamedTuple):
    """Numbers of a line.

    Attributes:
        texts: (k,) the numbers as they were sent.
        values: (k,) the numbers.
        lost: number of samples missing before it.
    """

    texts: tuple[str, ...]
    values: Float[np.ndarray, " k"]
    lost: int = 0


def sealed(line: bytes) -> bytes:
    """Return the checksum of a line: `*` and two hexadecimal digits."""
    return b"*%02X" % reduce(lambda one, other: one ^ other, line.lstrip(b"$!"), 0)


class Seals:
    """A check of lines by the checksums at their ends, once it is clear that they have any."""

    def __init__(self) -> None:
        self._trust = 0

    def damaged(self, line: bytes) -> bool:
        """Return whether the checksum of the next line is wrong or missing; False if the ends are no checksums."""
        found = _SEAL.search(line)
        if found is None:
            return self._trust > 0
        right = sealed(line[: found.start()])[1:] == found[1].upper()
        self._trust = min(max(self._trust + (1 if right else -1), -_TRUST), _TRUST)
        return not right and self._trust > -_TRUST


class DamageWatch:
    """A watch of the numbers of lines, which holds back a line with a jump until the next ones show what it is."""

    def __init__(self) -> None:
        self._first = list[Line]()
        self._waiting = list[tuple[Line, int]]()  # lines, the first with a jump; the index of each jump, or -1
        self._last = self._usual = self._finest = np.zeros(0)  # of each number: sound value, usual and finest step
        self._since = np.zeros(0, dtype=np.int64)  # lines since a jump of each number that no damage made

    def __len__(self) -> int:
        return len(self._waiting)

    @np.errstate(over="ignore", invalid="ignore")  # a line may hold any number
    def add(self, line: Line) -> list[tuple[Line, int]]:
        """Add the next line, and return those that are settled, each with the index of its damaged number, or -1."""
        if len(self._usual) == 0:
            self._learn(line)
            return [(line, -1)]
        settled = list[tuple[Line, int]]()
        column = self._jumped(line)
        if self._waiting and not self._goes_on(line, column):
            settled = self.flush()
            column = self._jumped(line)
        if self._waiting or column >= 0:
            self._waiting.append((line, column))
            return [*settled, *(self._judged() if self._quiet() else ())]
        self._pass(line.values)
        return [*settled, (line, -1)]

    @np.errstate(over="ignore", invalid="ignore")
    def flush(self) -> list[tuple[Line, int]]:
        """Return the lines that wait, as sound ones."""
        waiting, self._waiting = self._waiting, []
        for line, _ in waiting:
            self._pass(line.values)
        return [(line, -1) for line, _ in waiting]

    def _goes_on(self, line: Line, column: int) -> bool:
        """Return whether the numbers that jumped are back in a line, while another number may jump in it."""
        jumped = [each for _, each in self._waiting if each >= 0]
        if len(self._waiting) == _MOST or column in jumped or (column < 0 and self._far(line).any()):
            return False
        return bool(np.all(np.abs(line.values - self._last)[jumped] <= _QUIET * self._usual[jumped]))

    def _quiet(self) -> bool:
        """Return whether no number jumped in the last lines that wait."""
        return len(self._waiting) > _AFTER and all(column < 0 for _, column in self._waiting[-_AFTER:])

    def _judged(self) -> list[tuple[Line, int]]:
        """Return the lines that wait; a number that jumped is damaged if it can be mended."""
        after, last = self._waiting[-_AFTER][0].values, self._last
        judged = [
            (line, column if self._mends(line, column, 0.5 * (after + last), _NEAR) else -1)
            for line, column in self._waiting
        ]
        for line, column in judged:
            if column < 0:
                self._pass(line.values)
        self._waiting = []
        return judged

    def _far(self, line: Line) -> Bool[np.ndarray, " k"]:
        return np.abs(line.values - self._last) > _FAR * self._usual

    def _jumped(self, line: Line) -> int:
        """Return the index of the only number that changed much, if one character explains that; else -1."""
        far = np.flatnonzero(np.abs(line.values - self._last) > _QUIET * self._usual)
        if len(far) != 1 or not self._far(line)[far[0]] or self._since[far[0]] < _AFTERMATH:
            return -1
        return int(far[0]) if self._mends(line, int(far[0]), self._last, _QUIET) else -1

    def _mends(self, line: Line, column: int, values: Float[np.ndarray, " k"], steps: float) -> bool:
        """Return whether a line's number agrees with its value, within usual steps, if one character is another."""
        near, text = steps * self._usual[column], line.texts[column]
        if column < 0 or len(text) > _LONGEST:
            return False
        return any(abs(each - values[column]) <= near for each in _changed(text))

    def _pass(self, values: Float[np.ndarray, " k"]) -> None:
        step, far = np.nan_to_num(np.abs(values - self._last)), _FAR * self._usual
        self._since = np.where(step > far, 0, self._since + 1)
        step = np.minimum(step, far)
        self._usual = np.maximum(self._usual + _FORGET * (step - self._usual), self._finest)
        self._last = values

    def _learn(self, line: Line) -> None:
        """Take the usual steps from the first lines."""
        self._first.append(line)
        if len(self._first) < _LEARN:
            return
        values = np.array([each.values for each in self._first])
        self._finest = np.min([[_finest(text) for text in each.texts] for each in self._first], axis=0)
        self._last, self._since = values[-1], np.full(len(line.values), _AFTERMATH)
        steps = np.abs(np.diff(values, axis=0))
        known = np.isfinite(steps)
        steps = np.where(known, steps, np.where(known.any(axis=0), np.nan, 0.0))
        self._usual = np.maximum(np.nanmedian(steps, axis=0), self._finest)


def _finest(text: str) -> float:
    """Return the place value of a number's last digit."""
    number, _, exponent = text.lower().partition("e")
    return 10.0 ** (min(float(exponent or 0), 308.0) - len(number.partition(".")[2]))


def _changed(text: str) -> Iterator[float]:
    """Yield the finite numbers that differ from a number's text in one character, replaced, inserted or removed."""
    for at in range(len(text) + 1):
        for new in ("", *_CHARACTERS):
            for end in {at, min(at + 1, len(text))}:
                try:
                    number = float(text[:at] + new + text[end:])
                except ValueError:
                    continue
                if isfinite(number):
                    yield number
