"""How a delimited text is written: what stands before its rows, what parts its fields, its decimal point, its names."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from palpate.errors import InputError
from palpate.files.units import FORCE_UNITS, TIME_UNITS, TORQUE_UNITS, known_unit

__all__ = ["COMMENTS", "LOOKED_AT", "SPACES", "Dialect", "find_dialect", "spaces_to_tabs"]

LOOKED_AT = 1 << 16  # bytes of a text that are looked at
SPACES = " "  # as a delimiter: runs of spaces and tabs
COMMENTS = ("#", "%", "//")  # begin a line that is no row
_DELIMITERS = (",", ";", "\t", "|", SPACES)
_MOST = 20_000  # columns, of a sheet of 128 x 128 cells: more are rows whose ends were lost
_LINES = 150  # of those, at most
_NUMBER = re.compile(r"[-+]?(?:\d[\d.,']*|[.,]\d+)(?:[eE][-+]?\d+)?|[-+]?(?:nan|inf)", re.IGNORECASE)
_is_number = _NUMBER.fullmatch
_THOUSANDS = re.compile(r"[-+]?\d{1,3}(?:(?:,\d{3})+\.\d*|(?:\.\d{3})+,\d*|(?:,\d{3}){2,}|(?:'\d{3})+(?:[.,]\d*)?)")
_EITHER = re.compile(r"[-+]?[1-9]\d{0,2},\d{3}")  # a decimal comma, or a thousand
_FACT = re.compile(r"([^\W\d][^:=,;\t]*?)\s*[:=]\s*([^,;\t]+)")
_MARK = re.compile(r"^\s*(?:#+|%+|//+|;+)\s*")
_CALLED = {",": "commas", ";": "semicolons", "\t": "tabs", "|": "bars", SPACES: "spaces"}


@dataclass(frozen=True)
class Dialect:
    """How a text is written.

    Attributes:
        delimiter: comma, semicolon, tab, bar, or `SPACES`.
        decimal: "." or ",".
        names: of the columns.
        units: of the columns, as a second row of the header states them; "" where it states none.
        first: the line of the text on which rows may begin, counted from 0.
        header: the line of the names, counted from 0; -1: there are none, and `column_1`, ... were made up.
        stated: what lines before the header say: key in lower case -> value.
    """

    delimiter: str
    decimal: str
    names: tuple[str, ...]
    units: tuple[str, ...] = ()
    first: int = 1
    header: int = 0
    stated: Mapping[str, str] = field(default_factory=dict[str, str])

    def described(self) -> str:
        """What is not as in a plain table, in words; "" where nothing is."""
        said = [
            (self.delimiter not in ",;\t", f"separated by {_CALLED[self.delimiter]}"),
            (self.decimal == "," and self.delimiter == ",", "decimal commas in quotes"),
            (self.header < 0, f"without names: its columns are called {', '.join(self.names[:2])}, ..."),
            (self.header > 0 and bool(self.stated), f"names in line {self.header + 1}"),
            (any(self.units), f"units in a row of their own: {', '.join(self.units)}"),
        ]
        return "; ".join(text for there, text in said if there)


def find_dialect(text: bytes, path: Path) -> Dialect:
    """Look at the start of a text.

    Raises:
        InputError: it is empty, has one column only, or its decimal points cannot be told from thousands.
    """
    if text[:LOOKED_AT].lstrip().startswith(b"<"):
        raise InputError("is XML or HTML, and no table.", where=str(path))
    lines = [_decoded(line) for line in _whole_lines(text)]
    filled = [k for k, line in enumerate(lines) if line.strip()]
    found = _plain(lines, filled, path) or _found(lines[:_LINES], path) or _header_only(lines, filled, path)
    if len(found.names) > _MOST:
        raise InputError(
            f"the first line has {len(found.names):,} fields.", where=str(path), hint="It must name the columns."
        )
    found = replace(found, names=tuple(name or f"column_{k + 1}" for k, name in enumerate(found.names)))
    if found.delimiter == "," and b'"' not in text[:LOOKED_AT]:
        return found
    return replace(found, decimal=_decimal(lines[found.first :][:_LINES], found.delimiter, found.first, path))


def spaces_to_tabs(text: bytes) -> bytes:
    """Runs of spaces and tabs become one tab, none at the ends of a line."""
    return re.sub(rb"(?m)^\t|\t?\r?$", b"", re.sub(rb"[ \t]+", b"\t", text))


def _whole_lines(text: bytes) -> list[bytes]:
    """Those that are looked at: where rows have thousands of fields, three."""
    lines = text[:LOOKED_AT].split(b"\n")
    if len(text) <= LOOKED_AT:
        return lines
    return lines[:-1] if len(lines) > 3 else text.split(b"\n", 3)[:3]


def _decoded(line: bytes) -> str:
    """A line in UTF-8, or in the code page that Windows had before."""
    try:
        return line.rstrip(b"\r").decode()
    except UnicodeDecodeError:
        return line.rstrip(b"\r").decode("cp1252", errors="replace")


def _plain(lines: list[str], filled: list[int], path: Path) -> Dialect | None:
    """Names, and numbers in as many fields in the next line, parted by comma, semicolon or tab: no more to look at."""
    if len(filled) < 2:
        return None
    head, row = lines[filled[0]], lines[filled[1]]
    delimiter = max(_DELIMITERS[:3], key=_bare(head).count)
    count = _bare(head).count(delimiter)
    if not count or _bare(row).count(delimiter) != count or head.startswith(("#", "% ", "//")):
        return None
    following = [_bare(lines[k]).count(delimiter) == count for k in filled[1:12]]
    if 2 * sum(following) <= len(following):  # keys and values before a table
        return None
    names = _fields(head, delimiter, path, filled[0])
    if _is_row(names) or 2 * sum(map(bool, names)) <= len(names):  # no names; or keys and values, a title
        return None
    if not any(map(_is_number, _split(row, delimiter)[:50])):
        return None
    return Dialect(delimiter, ".", tuple(names), first=filled[0] + 1, header=filled[0])


def _is_row(names: Sequence[str]) -> bool:
    """Whether what stands where names do is a first row: numbers, among which there may be words."""
    numbers = [name for name in names if _is_number(name)]
    return len(numbers) == len(names) or (
        bool(_is_number(names[0])) and 2 * len(numbers) > len(names) and any("." in number for number in numbers)
    )


def _header_only(lines: list[str], filled: list[int], path: Path) -> Dialect:
    """The first line names the columns, and what follows is no table of numbers, or nothing at all."""
    if not filled:
        raise InputError("the file is empty.", where=str(path))
    head = lines[filled[0]]
    delimiter = max(_DELIMITERS[:4], key=_bare(head).count)
    if delimiter not in _bare(head):
        raise InputError("found one column only.", where=str(path), hint="Separate columns by , or ; or tab or spaces.")
    return Dialect(
        delimiter, ".", tuple(_fields(head, delimiter, path, filled[0])), first=filled[0] + 1, header=filled[0]
    )


def _found(lines: list[str], path: Path) -> Dialect | None:
    """By the rows of numbers: what parts them best, and the names above the first of them."""
    scores = {delimiter: _rows(lines, delimiter) for delimiter in _DELIMITERS}
    delimiter = max(_DELIMITERS, key=lambda each: sum(score for _, score in scores[each].values()))
    ended = max((k for k, line in enumerate(lines) if line.startswith("***End_of_Header***")), default=-1)  # LabVIEW's
    rows = {k: row for k, row in scores[delimiter].items() if k > ended}
    if not rows:
        return None
    width = Counter(count for count, _ in rows.values()).most_common(1)[0][0]
    start = min(k for k, (count, _) in rows.items() if count == width)
    if width > 2 and _split(lines[start], delimiter) == [str(k) for k in range(width)]:
        lines = [*lines[:start], "", *lines[start + 1 :]]  # pandas numbers columns that have no names
        start += 1
    above = [k for k in range(start) if lines[k].strip()]
    header, names, units = _names(lines, above, delimiter, width, path)
    if header < 0:
        names = [f"column_{k + 1}" for k in range(width)]
    elif len(names) == width + 1 and names[-1] in ("", "Comment"):  # the second: LabVIEW's, which rows may leave out
        names = names[:-1]
    elif len(names) == width - 1 and all(lines[k].rstrip().endswith(delimiter) for k in rows):
        names = [*names, f"column_{width}"]
    before = [lines[k] for k in above if header < 0 or k < header]
    first = max([header, *(k for k in above if k in units)]) + 1 if header >= 0 else start
    stated = next(iter(units.values()), list[str]())
    stated = [re.sub(r"^[\[(]|[\])]$", "", unit) for unit in stated]
    return Dialect(delimiter, ".", tuple(names), tuple(stated), first, header, dict(_facts(before)))


def _rows(lines: Sequence[str], delimiter: str) -> dict[int, tuple[int, float]]:
    """Lines that are rows of numbers, or more than half of them: how many fields, and the share of numbers."""
    found: dict[int, tuple[int, float]] = {}
    for k, line in enumerate(lines):
        if (delimiter != SPACES and delimiter not in line) or line.startswith(COMMENTS):
            continue
        fields = _split(line, delimiter)
        numbers, filled = sum(map(bool, map(_is_number, fields))), sum(map(bool, fields))
        if len(fields) > 1 and numbers > 1 and 2 * numbers >= filled:
            found[k] = len(fields), numbers / filled
    return found


def _names(
    lines: Sequence[str], above: Sequence[int], delimiter: str, width: int, path: Path
) -> tuple[int, list[str], dict[int, list[str]]]:
    """The line of the names (-1: none), the names, and the line of the units with them, above the rows."""
    units: dict[int, list[str]] = {}
    for k in reversed(above[-3:]):
        remark = lines[k].startswith(COMMENTS) or (lines[k].startswith(";") and delimiter != ";")
        marked = _MARK.sub("", lines[k], count=1) if remark else lines[k]
        fields = _parted(marked, delimiter, width)
        if _are_units(fields) and len(fields) == width and not units:
            units[k] = fields
        elif 2 * sum(map(bool, map(_is_number, fields))) > len(fields):
            continue
        elif len(fields) == width or (not remark and delimiter != SPACES and abs(len(fields) - width) == 1):
            if marked.count('"') % 2:
                raise InputError("a quote is not closed in the header.", where=f"{path}, line {k + 1}")
            earlier = above[: above.index(k)]
            if not units and earlier and _are_units(other := _parted(lines[earlier[-1]], delimiter, width)):
                units[earlier[-1]] = other
            return k, fields, units
        elif not remark and len(fields) > 2 and delimiter != SPACES and not units and ":" not in marked:
            return k, fields, {}  # names in another number: no row will have as many, which is said
    return -1, [], {}


def _are_units(fields: Sequence[str]) -> bool:
    """Whether these are units, some of force, torque or time among them, or dashes and nothing."""
    bare = [re.sub(r"^[\[(]|[\])]$", "", text) for text in fields]
    known = [text for text in bare if any(known_unit(text, each) for each in (TIME_UNITS, FORCE_UNITS, TORQUE_UNITS))]
    others = [text for text in bare if text not in known and text not in ("", "-", "--", "1", "m", "mm", "deg", "rad")]
    bracketed = all(re.fullmatch(r"[\[(].*[\])]|-?", text) for text in fields)
    return len(fields) > 1 and bool(known) and (bracketed or len(others) <= len(fields) // 4)


def _parted(line: str, delimiter: str, width: int) -> list[str]:
    """The fields of a header, whose names may have spaces where spaces part the rows."""
    if delimiter != SPACES:
        return _split(line, delimiter)
    for way in (r"\s+", r"\s{2,}|\t", r"\s*,\s*", r"\s+(?![\[(])"):
        if len(fields := re.split(way, line.strip())) == width:
            return fields
    return _split(line, SPACES)


def _split(line: str, delimiter: str) -> list[str]:
    """Fields without the quotes and spaces around them."""
    if delimiter == SPACES:
        return re.split(r"[ \t]+", line.strip(" \t"))
    if '"' not in line:
        return [text.strip() for text in line.split(delimiter)]
    read = csv.reader([line], delimiter=delimiter, skipinitialspace=True)
    return [text.strip() for text in next(read)]


def _fields(line: str, delimiter: str, path: Path, number: int) -> list[str]:
    """Of a line whose quotes must be closed."""
    if line.count('"') % 2:
        raise InputError("a quote is not closed in the header.", where=f"{path}, line {number + 1}")
    return _split(line, delimiter)


def _bare(line: str) -> str:
    return re.sub(r'"[^"]*"', "", line)


def _facts(lines: Sequence[str]) -> Iterator[tuple[str, str]]:
    """`key: value`, `key = value`, several a line, or a key and a value in two fields."""
    for line in lines:
        bare = _MARK.sub("", line, count=1).strip().strip('"')
        pairs = _FACT.findall(bare) or [fields for fields in (re.split(r"\s*[,;\t]\s*", bare),) if len(fields) == 2]
        yield from ((key.strip().lower(), value.strip().strip('"')) for key, value in pairs)


def _decimal(lines: Sequence[str], delimiter: str, first: int, path: Path) -> str:
    """The decimal point of the numbers: a comma only where it cannot part thousands.

    Raises:
        InputError: numbers have thousands parted, or may have.
    """
    doubted, points, commas = "", False, False
    for k, line in enumerate(lines):
        if line.count('"') % 2 or (delimiter == "," and '"' not in line):
            continue
        for text in _split(line, delimiter):
            if not _is_number(text):
                continue
            points |= "." in text
            if _THOUSANDS.fullmatch(text):
                raise InputError(
                    f"{text!r} has a mark between thousands.",
                    where=f"{path}, line {first + k + 1}",
                    hint="Export numbers without them.",
                )
            if _EITHER.fullmatch(text):
                doubted = doubted or f"{path}, line {first + k + 1}: {text!r}"
            elif "," in text:
                commas = True
    if doubted and not commas:
        raise InputError(
            "cannot tell whether the comma is a decimal point or parts thousands.",
            where=doubted,
            hint="Export with decimal points, or without marks between thousands.",
        )
    return "," if commas or (delimiter != "," and not points) else "."
