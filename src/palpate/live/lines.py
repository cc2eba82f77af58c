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
- Lines whose checksum does not fit are rejected, and doubtful samples are NaN: see `palpate.live.line_damage`.
"""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Iterable
from itertools import pairwise
from math import isfinite, isnan, nan

import numpy as np
from jaxtyping import Float, Int

from palpate.live.line_damage import DamageWatch, Line, Seals, sealed
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
_WRAPS = (0.0, -(2.0**8), -(2.0**16), -(2.0**32))  # what the next counter may be off by
_LONGEST = 65536  # bytes without an end of line, beyond which they are not text
_SHOWN = 60  # characters of a line in a message


class LineFrames:
    """A decoder of lines, fed as bytes.

    Args:
        count: number of values in a sample.
        columns: indices of the sample's values among the numbers of a line, from 0; None: the last `count` numbers.

    Attributes:
        unknown: number of restarts of a counter, after which the number of missing samples is unknown.
    """

    def __init__(self, count: int, columns: tuple[int, ...] | None = None) -> None:
        self._count, self._columns = count, columns
        self._lines: deque[bytes] = deque()
        self._ready: deque[tuple[np.ndarray, int]] = deque()  # samples, and what is missing before each
        self._seals, self._watch = Seals(), DamageWatch()
        self._rest = b""
        self._joined = False
        self._width: int | None = None  # numbers a line
        self._counts: bool | None = None  # whether the first of one more than the sensor's is a counter; not known yet
        self._step, self._last = 0.0, nan  # of the counter: its step, or 0; that of the last line
        self._sound: float | None = None  # the counter before one that was not expected, until the next line
        self._refused = 0  # lines with numbers, since the last sample
        self.unknown = 0
        self._other, self._agreeing = 0, 0
        self._strange = self._doubtful = 0
        self._example = self._odd = ""
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
            lost: (n,), filled with the number of samples missing before each: by the counter of the lines, or else
                the number of lines that were not understood.
        """
        found = 0
        while found < len(values):
            if self._ready:
                values[found], lost[found] = self._ready.popleft()
                found += 1
            elif self._lines and self._understood(self._lines[0]):
                if (line := self._numbers(self._lines.popleft())) is not None:
                    self._give(self._watch.add(line))
            else:
                break
        return found

    def waiting(self) -> int:
        """Return the number of lines whose samples were not taken yet."""
        return len(self._lines) + len(self._ready) + len(self._watch)

    def position(self) -> tuple[int, ...]:
        """Return the counter of the last sample; () before the first, and if lines have none."""
        return (int(self._last),) if self._step and isfinite(self._last) else ()

    def resume(self, position: tuple[int, ...]) -> None:
        """Continue to count at the position of an earlier decoder."""
        self._last = float(position[0])

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
        if self._doubtful:
            lines = "1 sample is" if self._doubtful == 1 else f"{self._doubtful} samples are"
            why = "one number jumps for one sample, as a damaged character makes it"
            found.append(f"{lines} doubtful and NaN, because {why}, such as {self._odd}")
        self._strange, self._doubtful, self._changed = 0, 0, ""
        return found

    def awaited(self) -> str:
        """Return why the bytes gave no sample, as a clause for a message."""
        example = f"; the last line was {self._example}" if self._example else ""
        return f"but no line of {self._wanted()}: check `baud`, `framing` and `columns`{example}"

    def _numbers(self, line: bytes) -> Line | None:
        """Return the sensor's numbers in a line, after its counter if there is one; None if it is not understood."""
        found = _texts(line)
        if found is None:
            return self._refuse(line, "is not text")
        if self._seals.damaged(line):
            return self._refuse(line, "its checksum does not fit", sample=True)
        if len(found) != self._width and not self._learn(len(found)):
            return self._refuse(line, f"{len(found)} numbers, not {self._wanted()}", sample=bool(found))
        self._agreeing = 0
        if self._columns is not None:
            return self._line([found[column] for column in self._columns])
        if len(found) > self._count and not self._counts:
            return self._refuse(line, "its first number does not count: name the sensor's numbers by `columns`")
        return self._line(found[-self._count :], float(found[0]))

    def _line(self, found: list[str], counter: float = nan) -> Line:
        lost, self._refused = self._refused, 0
        if self._step:
            lost = self._missing(counter)
        return Line(tuple(found), np.array([float(text) for text in found]), lost)

    def _give(self, settled: Iterable[tuple[Line, int]]) -> None:
        """Make samples of lines, each with the index of its damaged number, or -1."""
        for line, damaged in settled:
            if damaged >= 0:
                self._doubtful, self._odd = self._doubtful + 1, f"{line.texts[damaged]} as number {damaged + 1}"
            self._ready.append((line.values if damaged < 0 else np.full(self._count, nan), line.lost))

    def _missing(self, counter: float) -> int:
        """Return the number of samples missing by the counters; a jump counts once the next line confirms it."""
        step, before, sound = self._step, self._last, self._sound
        self._last, self._sound = counter, None
        if isnan(before) or (counter - before - step) in _WRAPS:
            return 0 if sound is None else self._jump(before - sound)
        if sound is None or counter != sound + 2 * step:  # else that between them was damaged
            self._sound = before if sound is None else sound
        return 0

    def _jump(self, jump: float) -> int:
        """Return the number of samples missing in a jump of the counter; 0 after a restart."""
        self.unknown += jump < 0
        return max(0, round(jump / self._step) - 1)

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
            steps = [number - last for last, number in pairwise(firsts)]
            usual = max(steps, key=steps.count)
            self._step = usual if usual.is_integer() and usual > 0 and 2 * steps.count(usual) > len(steps) else 0.0

    def _learn(self, width: int) -> bool:
        """Return whether a count of numbers in a line is accepted from now on."""
        fits = width > max(self._columns) if self._columns else width in (self._count, self._count + 1)
        self._agreeing = self._agreeing + 1 if fits and width == self._other else int(fits)
        self._other = width
        if not fits or (self._width is not None and self._agreeing < _AGREE):
            return False
        if self._width is not None:
            self._changed = f"lines now have {width} numbers, no longer {self._width}"
            self._counts, self._step, self._last, self._sound = None, 0.0, nan, None
            self._give(self._watch.flush())
            self._watch = DamageWatch()
        self._width = width
        return True

    def _wanted(self) -> str:
        if self._width is not None:
            return f"{self._width} numbers"
        if self._columns is not None:
            return f"more than {max(self._columns)} numbers"
        return f"{self._count} or {self._count + 1} numbers"

    def _refuse(self, line: bytes, why: str, *, sample: bool = False) -> None:
        self._strange += 1
        self._refused += sample
        text = ascii(line[:_SHOWN].decode("latin-1"))
        self._example = f"{text} ({why})"


def numbers(line: bytes) -> list[float] | None:
    """Return the numbers of a line, which may have labels, units and decimal commas; None if it is not text."""
    found = _texts(line)
    return None if found is None else [float(each) for each in found]


def _texts(line: bytes) -> list[str] | None:
    """Return the numbers of a line as they were sent, with decimal points and without blanks; None if no text."""
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
    return [each.replace(b" ", b"").decode() for each in found]


@takes_arrays
def printed(values: Float[np.ndarray, "n k"], counter: int) -> tuple[bytes, Int[np.ndarray, " n"]]:
    """Return samples as bytes of lines with checksums, and the index (n,) at which each line ends.

    Args:
        values: (n, k), a row for each line, printed so that it reads back to the same bits.
        counter: number at the start of the first line; it grows by 1 a line, modulo 2^32.

    Raises:
        InputError: values has another shape.
    """
    rows = [",".join([str((counter + k) % 2**32), *map(repr, row)]).encode() for k, row in enumerate(values.tolist())]
    lines = [row + sealed(row) + b"\r\n" for row in rows]
    return b"".join(lines), np.cumsum([len(line) for line in lines], dtype=np.int64)
