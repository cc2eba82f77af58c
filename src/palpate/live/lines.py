"""Read and write samples as lines of numbers, as sensors print them to a terminal.

Commas, semicolons, tabs, blanks, brackets, labels, units or other text may separate numbers: `( 0.12 , -3.4 , ...)`,
`Fx=1.2`, `0.001 N 0.0009 Nm`, `4711;1,5;-0,25`, `+  1.23kg`.

- A number does not follow a letter or digit (the 1 of `F1=`), precede `:` or `=` (`12:30:05.2` is one number, 5.2), or
  mix with letters (`3F2A`). `nan` and `inf` are numbers.
- A comma is decimal if every comma of the line is between two digits, no number has two commas or a point, and another
  character separates the numbers: `1,5;2,5`, but not `1,2`.
- The sensor's numbers are those that `columns` names, or else all, or all but the first if it is a counter or a time:
  lines wait until it has risen eight times, and are refused if it does not (a sum may be the last number).
- The first line sets the count of numbers; another count is rejected until ten lines in a row agree on it.
"""

from __future__ import annotations

import re
from collections import deque
from itertools import pairwise

import numpy as np
from jaxtyping import Float, Int

from palpate.spatial.arguments import takes_arrays

__all__ = ["numbers", "printed"]

_NUMBER = re.compile(
    rb"(?:(?<![\w.^*+\-\x80-\xff])|[-+] *)"  # a sign may stand apart, as on scales
    rb"(?:(?:\d++(?:\.\d*+)?+|\.\d++)(?:[eE][-+]?\d++)?+(?![\d.:=]|[A-Za-z]+\d)|(?:nan|inf)(?![\w.:=]))",
    re.IGNORECASE,
)
_POINT = re.compile(rb"\d\.\d")
_NO_DECIMAL = re.compile(rb"(?<!\d),|,(?!\d)|,\d+,")
_TEXT = bytes([9, *range(32, 127), *range(128, 256)])  # what a line of text may hold
_AGREE = 10  # lines with another count of numbers, after which it is the count
_RISES = 8  # of a counter; at most _AGREE other lines may be between, and one start anew, to
_ANEW = 0.5  # of the number before
_LONGEST = 65536  # bytes without an end of line, beyond which they are not text
_SHOWN = 60  # characters of a line in a message


class LineFrames:
    """A decoder of lines, fed as bytes.

    Args:
        count: number of values in a sample.
        columns: indices of the sample's values among the numbers of a line, from 0; None: the last `count` numbers.
    """

    def __init__(self, count: int, columns: tuple[int, ...] | None = None) -> None:
        self._count, self._columns = count, columns
        self._lines: deque[bytes] = deque()
        self._rest = b""
        self._joined = False
        self._width: int | None = None  # numbers a line
        self._counts: bool | None = None  # whether the first of one more than the sensor's is a counter; not known yet
        self._other, self._agreeing = 0, 0
        self._strange, self._example = 0, ""
        self._changed = ""

    def feed(self, data: bytes) -> None:
        """Append bytes, in pieces of any size.

        The first line is discarded, as its beginning may be missing; so are 64 KiB without an end of line, as a fault.
        """
        *lines, self._rest = (self._rest + data).replace(b"\r", b"\n").split(b"\n")
        if lines and not self._joined:
            self._joined = True
            del lines[0]
        self._lines.extend(line for line in lines if line and not line.isspace())
        if len(self._rest) > _LONGEST:
            self._refuse(self._rest, "no end of line")
            self.forget()

    def take(self, values: Float[np.ndarray, "n k"], lost: Int[np.ndarray, " n"]) -> int:
        """Decode samples into the arrays, as many as they have room for, and return their number.

        Args:
            values: (n, count), filled from the first row on.
            lost: (n,), filled with 0.
        """
        rows: list[list[float]] = []
        while len(rows) < len(values) and self._lines and self._understood(self._lines[0]):
            line = self._lines.popleft()
            if (row := self._row(line)) is not None:
                rows.append(row)
        if rows:
            values[: len(rows)] = rows
            lost[: len(rows)] = 0
        return len(rows)

    def waiting(self) -> int:
        """Return the number of lines not decoded yet."""
        return len(self._lines)

    def forget(self) -> None:
        """Discard the incomplete line, and skip the next one."""
        self._rest = b""
        self._joined = False

    def faults(self) -> list[str]:
        """Return texts on faults since the last call: lines not understood, a changed count of numbers; else []."""
        found = [self._changed] if self._changed else []
        if self._strange:
            lines = "1 line" if self._strange == 1 else f"{self._strange} lines"
            found.append(f"{lines} not understood, such as {self._example}")
        self._strange, self._changed = 0, ""
        return found

    def awaited(self) -> str:
        """Return why the bytes gave no sample, as a clause for a message."""
        example = f"; the last line was {self._example}" if self._example else ""
        return f"but no line of {self._wanted()}: check `baud`, `framing` and `columns`{example}"

    def _row(self, line: bytes) -> list[float] | None:
        """Return the sensor's numbers in a line; None if it is not understood."""
        found = numbers(line)
        if found is None:
            return self._refuse(line, "is not text")
        if len(found) != self._width and not self._learn(len(found)):
            return self._refuse(line, f"{len(found)} numbers, not {self._wanted()}")
        self._agreeing = 0
        if self._columns is not None:
            return [found[column] for column in self._columns]
        if len(found) > self._count and not self._counts:
            return self._refuse(line, "its first number does not count: name the sensor's numbers by `columns`")
        return found[-self._count :]

    def _understood(self, line: bytes) -> bool:
        """Return whether a line can be read now: a number more than the sensor's may be a counter, or a sum behind."""
        if self._columns is not None or self._counts is not None or self._width == self._count:
            return True
        if len(numbers(line) or ()) == self._count + 1:
            self._judge()
            return self._counts is not None
        return True

    def _judge(self) -> None:
        """Decide by the lines that wait whether their first number is a counter."""
        firsts = [found[0] for line in self._lines if len(found := numbers(line) or []) == self._count + 1]
        rises = sum(last < number for last, number in pairwise(firsts))
        falls = [number > _ANEW * last for last, number in pairwise(firsts) if number < last]
        if any(falls) or len(falls) > 1 or len(self._lines) - rises > _AGREE:
            self._counts = False
        elif rises >= _RISES:
            self._counts = True

    def _learn(self, width: int) -> bool:
        """Return whether a count of numbers in a line is accepted from now on."""
        fits = width > max(self._columns) if self._columns else width in (self._count, self._count + 1)
        self._agreeing = self._agreeing + 1 if fits and width == self._other else int(fits)
        self._other = width
        if not fits or (self._width is not None and self._agreeing < _AGREE):
            return False
        if self._width is not None:
            self._changed = f"lines now have {width} numbers, no longer {self._width}"
            self._counts = None
        self._width = width
        return True

    def _wanted(self) -> str:
        if self._width is not None:
            return f"{self._width} numbers"
        if self._columns is not None:
            return f"more than {max(self._columns)} numbers"
        return f"{self._count} or {self._count + 1} numbers"

    def _refuse(self, line: bytes, why: str) -> None:
        self._strange += 1
        text = ascii(line[:_SHOWN].decode("latin-1"))
        self._example = f"{text} ({why})"


def numbers(line: bytes) -> list[float] | None:
    """Return the numbers of a line, which may have labels, units and decimal commas; None if it is not text."""
    if line.translate(None, _TEXT):
        return None
    if not line.isascii():
        try:
            line.decode()
        except UnicodeDecodeError:
            return None
    found = _NUMBER.findall(line)
    if b"," in line and not _POINT.search(line) and not _NO_DECIMAL.search(line):
        decimal = _NUMBER.findall(line.replace(b",", b"."))
        found = decimal if len(decimal) > 1 else found
    return [float(each.replace(b" ", b"")) for each in found]


@takes_arrays
def printed(values: Float[np.ndarray, "n k"], counter: int) -> tuple[bytes, Int[np.ndarray, " n"]]:
    """Return samples as bytes of lines, and the index (n,) at which each line ends.

    Args:
        values: (n, k), a row for each line, printed so that it reads back to the same bits.
        counter: number at the start of the first line; it grows by 1 a line, modulo 2^32.

    Raises:
        InputError: values has another shape.
    """
    lines = [
        ",".join([str((counter + k) % 2**32), *map(repr, row)]).encode() + b"\r\n"
        for k, row in enumerate(values.tolist())
    ]
    return b"".join(lines), np.cumsum([len(line) for line in lines], dtype=np.int64)
