"""Numbers in what is shown, held against the values that they come from."""

import re
from collections.abc import Mapping, Sequence
from html import unescape
from html.parser import HTMLParser

import numpy as np
from jaxtyping import Float

_NUMBER = re.compile(r"(?<![\w.])[-+]?\d[\d,]*(?:\.\d+)?(?:e[-+]?\d+)?(?!\w)")


def near(shown: str, value: float) -> bool:
    """Return whether a number is a value, rounded to the digits that are shown."""
    bare, _, power = shown.replace(",", "").partition("e")
    digits = len(bare.partition(".")[2])
    return abs(float(shown.replace(",", "")) - value) <= 0.501 * 10.0 ** (int(power or 0) - digits)


def plain(html: str) -> str:
    """Return the words of a piece of HTML."""
    return unescape(re.sub(r"<style.*?</style>|<[^>]*>", " ", html, flags=re.DOTALL))


def assert_told(text: str, *values: float) -> None:
    """Assert that the numbers of a text are these values, in this order, and no others."""
    found = _NUMBER.findall(plain(text))
    assert len(found) == len(values), f"{found} are not as many as {values}: {text}"
    wrong = [(shown, value) for shown, value in zip(found, values, strict=True) if not near(shown, value)]
    assert not wrong, f"{wrong}: {text}"


def assert_columns(
    header: Sequence[str], rows: Sequence[Sequence[str]], known: Mapping[str, Float[np.ndarray, " k"]]
) -> None:
    """Assert that each cell of a table is the value of its row under the name of its column, with its unit."""
    assert len(set(header)) == len(header)
    assert rows
    for k, row in enumerate(rows):
        for name, cell in zip(header, row, strict=True):
            assert name in known, f"state in the test where the column {name!r} comes from"
            assert near(cell, float(known[name][k])), f"row {k} has {cell} under {name}, not {known[name][k]}"


class _Tables(HTMLParser):
    def __init__(self, text: str) -> None:
        super().__init__()
        self.found, self._cell = list[list[list[str]]](), False
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag == "table":
            self.found.append([])
        elif tag == "tr" and self.found:
            self.found[-1].append([])
        elif tag in ("td", "th") and self.found:
            if not self.found[-1]:
                self.found[-1].append([])
            self.found[-1][-1].append("")
            self._cell = True

    def handle_endtag(self, tag: str) -> None:
        self._cell = self._cell and tag not in ("td", "th")

    def handle_data(self, data: str) -> None:
        if self._cell:
            self.found[-1][-1][-1] += data


def tables(html: str) -> list[list[list[str]]]:
    """Return the tables of a page, each as rows of the texts of its cells."""
    return [[row for row in table if row] for table in _Tables(html).found]
