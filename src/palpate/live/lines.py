"""Lines of numbers, as makers print them: what a sensor sends to a terminal.

A line ends with CR, LF or both. Numbers stand between commas, semicolons, tabs or blanks, in brackets or not, with
labels (`Fx=1.2`), units and other text: `( 0.12 , -3.4 , ...)`, `0.001 N 0.0009 Nm`, `4711;1,5;-0,25`, `+  1.23kg`.

- A number begins where no letter or digit stands before it: the 1 of `F1=` is none. It is none before `:` or `=` either
  (`12:30:05.2` is one number, 5.2), nor where digits and letters are mixed (`3F2A`). `nan` and `inf` are numbers.
- A comma is a decimal comma where every comma of the line stands between two digits, no number has two or a point,
  and something else sets numbers apart: `1,5;2,5` and `1,5 2,5`, but not `1,2`.
- The sensor's numbers are those that `columns` names, else all, else all but the first: a counter or a time.
- How many numbers a line has is learnt from the first; one with another number is not understood, until ten in a row
  agree on it.

The first line after a connection is passed over, as its beginning may be missing. Lines have no check: a digit that was
damaged into another digit is not noticed, which is what frames (`palpate.live.cobs`) are for.
"""

from __future__ import annotations

import re
from collections import deque

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
_LONGEST = 65536  # bytes without an end of line, which is no text then
_SHOWN = 60  # characters of a line in a message


class LineFrames:
    """Samples out of lines as they come.

    Args:
        count: numbers a sample.
        columns: which of the numbers of a line, from 0. None: see above.
    """

    unit = "line"

    def __init__(self, count: int, columns: tuple[int, ...] | None = None) -> None:
        self.longest = 32 * count
        self._count, self._columns = count, columns
        self._lines: deque[bytes] = deque()
        self._rest = b""
        self._joined = False
        self._width: int | None = None  # numbers a line
        self._other, self._agreeing = 0, 0
        self._strange, self._example = 0, ""
        self._changed = ""

    def feed(self, data: bytes) -> None:
        """Take bytes as they were read."""
        *lines, self._rest = (self._rest + data).replace(b"\r", b"\n").split(b"\n")
        if lines and not self._joined:
            self._joined = True
            del lines[0]
        self._lines.extend(line for line in lines if line and not line.isspace())
        if len(self._rest) > _LONGEST:
            self._refuse(self._rest, "no end of line")
            self.forget()

    def take(self, values: Float[np.ndarray, "n k"], lost: Int[np.ndarray, " n"]) -> int:
        """Samples of what was fed, as many as fit.

        Args:
            values: filled from the first row on.
            lost: set to 0, as lines have no counter that is known to be one.

        Returns:
            how many.
        """
        rows: list[list[float]] = []
        while self._lines and len(rows) < len(values):
            line = self._lines.popleft()
            if (row := self._row(line)) is not None:
                rows.append(row)
        if rows:
            values[: len(rows)] = rows
            lost[: len(rows)] = 0
        return len(rows)

    def waiting(self) -> int:
        """Samples that still lie in what was fed."""
        return len(self._lines)

    def forget(self) -> None:
        """Begin anew with the next line but one, as after a broken connection."""
        self._rest = b""
        self._joined = False

    def faults(self) -> list[str]:
        """What went wrong since this was last asked."""
        found = [self._changed] if self._changed else []
        if self._strange:
            lines = "1 line" if self._strange == 1 else f"{self._strange} lines"
            found.append(f"{lines} not understood, such as {self._example}")
        self._strange, self._changed = 0, ""
        return found

    def awaited(self) -> str:
        """Why the bytes that came gave no sample, for a message."""
        example = f"; the last line was {self._example}" if self._example else ""
        return f"no line of {self._wanted()} among them: is it `baud`, `framing` or `columns`{example}?"

    def _row(self, line: bytes) -> list[float] | None:
        """The sensor's numbers; None, and counted, where the line is not understood."""
        found = numbers(line)
        if found is None:
            return self._refuse(line, "no text")
        if len(found) != self._width and not self._learn(len(found)):
            return self._refuse(line, f"{len(found)} numbers, not {self._wanted()}")
        self._agreeing = 0
        if self._columns is None:
            return found[-self._count :]
        return [found[column] for column in self._columns]

    def _learn(self, width: int) -> bool:
        """Whether so many numbers are what a line has from now on."""
        fits = width > max(self._columns) if self._columns else width in (self._count, self._count + 1)
        self._agreeing = self._agreeing + 1 if fits and width == self._other else int(fits)
        self._other = width
        if not fits or (self._width is not None and self._agreeing < _AGREE):
            return False
        if self._width is not None:
            self._changed = f"lines have {width} numbers now, no longer {self._width}"
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
    """The numbers of a line, see above; None where it is no text."""
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
    """Samples as lines: the counter and the numbers, to the last bit.

    Args:
        values: one row a line.
        counter: of the first.

    Returns:
        the bytes, and where each line ends in them.
    """
    lines = [
        ",".join([str((counter + k) % 2**32), *map(repr, row)]).encode() + b"\r\n"
        for k, row in enumerate(values.tolist())
    ]
    return b"".join(lines), np.cumsum([len(line) for line in lines], dtype=np.int64)
