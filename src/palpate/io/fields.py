"""How well the columns of a file could be read as numbers, summed over the pieces in which it is read."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from jaxtyping import Float

from palpate.errors import InputError

__all__ = ["Fields"]


class Fields:
    """What was met while some columns were read."""

    def __init__(self) -> None:
        self.rows = self.bad = 0
        self.first_bad = ""
        """The place of the first row with a field that is missing or no number."""
        self.unread: dict[str, tuple[str, str]] = {}
        """Column -> place and text of the first field that is neither a number nor empty nor says nan."""
        self._numeric: set[str] = set()

    def see(self, name: str, values: Float[np.ndarray, " n"]) -> None:
        """The numbers of a column, NaN where there is none."""
        if name not in self._numeric and not np.isnan(values).all():
            self._numeric.add(name)

    def count(self, values: Float[np.ndarray, "n k"], place: Callable[[int], str]) -> None:
        """The rows of a piece, of which some have a field that is missing or no number: NaN."""
        bad = np.any(np.isnan(values), axis=1)
        self.rows += len(bad)
        self.bad += int(np.count_nonzero(bad))
        if bad.any() and not self.first_bad:
            self.first_bad = place(int(np.argmax(bad)))

    def require_numbers(self, path: Path) -> None:
        """Raise an InputError if a column holds text, and not one number."""
        for name, (place, text) in self.unread.items():
            if name not in self._numeric:
                raise InputError(f"no number in column {name!r}; {place} has {text!r}.", where=str(path))

    def notes(self) -> tuple[str, ...]:
        """One sentence if there was anything."""
        if not self.bad:
            return ()
        first = self.first_bad
        for name, (place, text) in self.unread.items():
            first = f"{place}, column {name!r}, {text!r}"
            break
        return (f"{self.bad} of {self.rows} rows have a field that is missing or not a number (first: {first})",)
