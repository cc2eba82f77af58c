"""Write a table as CSV, as a laboratory would keep it."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float


def write_rows(path: Path, names: Sequence[str], rows: Iterable[Iterable[str]]) -> None:
    """Write a header and rows of text."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(names)
        writer.writerows(rows)


def formatted(numbers: Float[np.ndarray, "n k"], form: str) -> Iterator[list[str]]:
    """Yield the numbers of each row as text, in a format such as ".6f"."""
    return ([f"{value:{form}}" for value in row] for row in numbers.tolist())
