"""Count the rows and fields of a file that could not be read, summed over its pieces."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from palpate.errors import InputError
from palpate.spatial.arguments import takes_arrays


@takes_arrays
class Fields:
    """Counts of the rows of some columns and of the fields in them that are not numbers.

    Attributes:
        rows, bad: numbers of rows, and of those with a field that is missing or no number.
        first_bad: place of the first of these; "" without any.
        unread: column -> place and text of its first field that is neither a number nor empty nor nan.
        stamped: columns of dates or times of day, which were read in seconds.
    """

    def __init__(self) -> None:
        self.rows = self.bad = 0
        self.first_bad = ""
        self.unread: dict[str, tuple[str, str]] = {}
        self.stamped: set[str] = set()
        self._numeric: set[str] = set()

    def see(self, name: str, values: Float[np.ndarray, " n"]) -> None:
        """Record whether a column has a number in a piece (n,); NaN is none.

        Raises:
            InputError: values has another shape.
        """
        if name not in self._numeric and not np.isnan(values).all():
            self._numeric.add(name)

    def count(self, values: Float[np.ndarray, "n k"], place: Callable[[int], str]) -> None:
        """Count a piece (n, k) of fields, NaN where no number; `place` returns the place of a row, in words.

        Raises:
            InputError: values has another shape.
        """
        bad = np.any(np.isnan(values), axis=1)
        self.rows += len(bad)
        self.bad += int(np.count_nonzero(bad))
        if bad.any() and not self.first_bad:
            self.first_bad = place(int(np.argmax(bad)))

    def require_numbers(self, path: Path) -> None:
        """Check that every column with text in it has a number, too.

        Raises:
            InputError: one, of the file `path`, has none.
        """
        for name, (place, text) in self.unread.items():
            if name not in self._numeric:
                raise InputError(f"column {name!r} has no numbers; {place} has {text!r}.", where=str(path))

    def notes(self) -> tuple[str, ...]:
        """Return a sentence on rows with a field that is missing or no number, in a tuple; () without any."""
        if not self.bad:
            return ()
        unread = (f"{place}, column {name!r}, {text!r}" for name, (place, text) in self.unread.items())
        first = next(unread, self.first_bad)
        return (f"{self.bad} of {self.rows} rows have a field that is missing or not a number (first: {first})",)


@takes_arrays
class RowCount:
    """Counts of the rows of a file with the fields of its header.

    Attributes:
        count, unclosed, ragged: numbers of rows, of those with an open quote, and of those with other fields.
        cut: True if the last row so far has fewer fields than the header.
    """

    def __init__(self) -> None:
        self.count = self.unclosed = self.ragged = 0
        self.cut = False
        self._first = self._first_unclosed = self._first_ragged = ""
        self._fields, self._delimiter = 0, ""

    def add(self, lines: Int[np.ndarray, " n"], fields: Int[np.ndarray, " n"], width: int, delimiter: str) -> None:
        """Add a piece: line number and field count (-1: an open quote) of each row, field count of the header.

        Raises:
            InputError: arrays of other shapes.
        """
        unclosed, ragged = fields < 0, (fields >= 0) & (fields != width)
        if not self.count and len(lines):
            found = f"{fields[0]}" if fields[0] >= 0 else "a quote that is not closed"
            self._first = f"line {lines[0]} has {found}"
        self.count += len(lines)
        self.cut = bool(len(fields) and 0 <= fields[-1] < width)
        self._fields, self._delimiter = width, delimiter
        self.unclosed += int(np.count_nonzero(unclosed))
        self.ragged += int(np.count_nonzero(ragged))
        if unclosed.any() and not self._first_unclosed:
            self._first_unclosed = f"line {lines[int(np.argmax(unclosed))]}"
        if ragged.any() and not self._first_ragged:
            self._first_ragged = f"line {lines[int(np.argmax(ragged))]}"

    def require(self, path: Path) -> None:
        """Check that there is a row with as many fields as the header.

        Raises:
            InputError: there is none in the file `path`.
        """
        if not self.count:
            raise InputError("there is a header, but no rows.", where=str(path))
        if self.unclosed + self.ragged == self.count:
            what = f"no row has the {self._fields} fields of the header; {self._first}."
            hint = "If decimal points are commas, separate the columns by ;." if self._delimiter == "," else ""
            raise InputError(what, where=str(path), hint=hint)

    def notes(self) -> tuple[str, ...]:
        """Return a sentence each on rows with an open quote and on rows with other fields than the header."""
        said = (
            (self.unclosed, "have a quote that is not closed", self._first_unclosed),
            (self.ragged, f"do not have {self._fields} fields", self._first_ragged),
        )
        return tuple(f"{count} rows {what} (first: {first})" for count, what, first in said if count)
