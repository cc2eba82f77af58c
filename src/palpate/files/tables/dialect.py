"""Find the dialect of a delimited text: delimiter, decimal point, column names, and lines before the rows."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from palpate.errors import InputError
from palpate.files.inputs import refuse_calibration
from palpate.files.units import FORCE_UNITS, TIME_UNITS, TORQUE_UNITS, known_unit

LOOKED_AT = 1 << 16  # bytes of a text that are looked at
SPACES = " "  # as a delimiter: runs of spaces and tabs
COMMENTS = ("#", "%", "//")  # begin a line that is no row
_DELIMITERS = (",", ";", "\t", "|", SPACES)
_MOST = 20_000  # columns: a skin of 128 x 128 taxels has fewer; more mean that line ends were lost
_LINES = 150  # lines looked at, at most
_NUMBER = re.compile(r"[-+]?(?:\d[\d.,']*|[.,]\d+)(?:[eE][-+]?\d+)?|[-+]?(?:nan|inf)", re.IGNORECASE)
_is_number = _NUMBER.fullmatch
_THOUSANDS = re.compile(r"[-+]?\d{1,3}(?:(?:,\d{3})+\.\d*|(?:\.\d{3})+,\d*|(?:,\d{3}){2,}|(?:'\d{3})+(?:[.,]\d*)?)")
_EITHER = re.compile(r"[-+]?[1-9]\d{0,2},\d{3}")  # a decimal comma, or a thousand
_FACT = re.compile(r"([^\W\d][^:=,;\t]*?)\s*[:=]\s*([^,;\t]+)")
_MARKUP = re.compile(rb"\s*(?:<[?!]|<(?s:.)*?(?:</|/>))")  # XML or HTML: a table may begin with `<Pose> x y z` too
_TAG = re.compile(r"\s*<[^<>]*>[\s,;]*")  # before the names
_MARK = re.compile(r"^\s*(?:#+|%+|//+|;+)\s*")
_CALLED = {",": "commas", ";": "semicolons", "\t": "tabs", "|": "bars", SPACES: "spaces"}


@dataclass(frozen=True)
class Dialect:
    """The format of a delimited text.

    Attributes:
        delimiter: comma, semicolon, tab, bar, or `SPACES`.
        decimal: "." or ",".
        names: of the columns.
        units: of the columns, from a row of their own, "" where it has none; empty without that row.
        first: index of the line at which rows may begin.
        header: index of the line with the names; -1: there are none, and `column_1`, ... are used.
        stated: key in lower case -> value, from the lines before the header.
    """

    delimiter: str
    decimal: str
    names: tuple[str, ...]
    units: tuple[str, ...] = ()
    first: int = 1
    header: int = 0
    stated: Mapping[str, str] = field(default_factory=dict[str, str])

    def described(self) -> str:
        """Return in words how the text differs from a plain table; "" if it does not."""
        said = [
            (self.delimiter not in ",;\t", f"separated by {_CALLED[self.delimiter]}"),
            (self.decimal == "," and self.delimiter == ",", "decimal commas in quotes"),
            (self.header < 0, f"without names: its columns are called {', '.join(self.names[:2])}, ..."),
            (self.header > 0 and bool(self.stated), f"names in line {self.header + 1}"),
            (any(self.units), f"units in a row of their own: {', '.join(self.units)}"),
        ]
        return "; ".join(text for there, text in said if there)


def find_dialect(text: bytes, path: Path) -> Dialect:
    """Return the dialect of a text, found in its first `LOOKED_AT` bytes.

    Raises:
        InputError: the text is empty, is XML or HTML, has only one column or more than 20,000, an open quote in its
            header, or numbers that have, or may have, marks between thousands.
    """
    if _MARKUP.match(text[:LOOKED_AT]):
        refuse_calibration(text[:LOOKED_AT], path)
        raise InputError("is XML or HTML, not a table.", where=str(path))
    lines = [_decoded(line) for line in _whole_lines(text)]
    filled = [k for k, line in enumerate(lines) if line.strip()]
    found = _plain(lines, filled, path) or _found(lines[:_LINES], path) or _header_only(lines, filled, path)
    if len(found.names) > _MOST:
        what = f"the first line has {len(found.names):,} fields, which is too many."
        raise InputError(what, where=str(path), hint="Name the columns in it.")
    found = replace(found, names=tuple(name or f"column_{k + 1}" for k, name in enumerate(found.names)))
    if found.delimiter == "," and b'"' not in text[:LOOKED_AT]:
        return found
    return replace(found, decimal=_decimal(lines[found.first :][:_LINES], found.delimiter, found.first, path))


def spaces_to_tabs(text: bytes) -> bytes:
    """Return a text with each run of spaces and tabs as one tab, and none at the ends of lines."""
    return re.sub(rb"(?m)^\t|\t?\r?$", b"", re.sub(rb"[ \t]+", b"\t", text))


def _whole_lines(text: bytes) -> list[bytes]:
    """Return the complete lines in the first `LOOKED_AT` bytes, or three longer ones."""
    lines = text[:LOOKED_AT].split(b"\n")
    if len(text) <= LOOKED_AT:
        return lines
    return lines[:-1] if len(lines) > 3 else text.split(b"\n", 3)[:3]


def _decoded(line: bytes) -> str:
    """Decode a line as UTF-8, or else as Windows' cp1252."""
    try:
        return line.rstrip(b"\r").decode()
    except UnicodeDecodeError:
        return line.rstrip(b"\r").decode("cp1252", errors="replace")


def _plain(lines: list[str], filled: list[int], path: Path) -> Dialect | None:
    """Return the dialect of a line of names above numbers in as many fields; else None."""
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
    """Check whether names are a first row: numbers, and words among them."""
    numbers = [name for name in names if _is_number(name)]
    return len(numbers) == len(names) or (
        bool(_is_number(names[0])) and 2 * len(numbers) > len(names) and any("." in number for number in numbers)
    )


def _header_only(lines: list[str], filled: list[int], path: Path) -> Dialect:
    """Return the dialect of a line of names without rows, or of one name above numbers."""
    if not filled:
        raise InputError("the file is empty.", where=str(path))
    head = lines[filled[0]]
    delimiter = max(_DELIMITERS[:4], key=_bare(head).count)
    if delimiter not in _bare(head):
        if not _is_number(head) and len(filled) > 1 and all(_is_number(lines[k]) for k in filled[1:]):
            return Dialect(",", ".", (head.strip(),), first=filled[0] + 1, header=filled[0])
        raise InputError("has only one column.", where=str(path), hint="Separate columns by , or ; or tab or spaces.")
    names = _fields(head, delimiter, path, filled[0])
    return Dialect(delimiter, ".", tuple(names), first=filled[0] + 1, header=filled[0])


def _found(lines: list[str], path: Path) -> Dialect | None:
    """Return the dialect by the rows of numbers, and the names above them."""
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
    stated = [re.sub(r"^[\[(]|[\])]$", "", unit) for fields in units.values() for unit in fields]  # one line at most
    return Dialect(delimiter, ".", tuple(names), tuple(stated), first, header, dict(_facts(before)))


def _rows(lines: Sequence[str], delimiter: str) -> dict[int, tuple[int, float]]:
    """Return line -> (field count, share of numbers) of lines with half numbers or more."""
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
    """Return the index of the line of names (-1: none), the names, and the line of units."""
    units: dict[int, list[str]] = {}
    for k in reversed(above[-3:]):
        remark = lines[k].startswith(COMMENTS) or (lines[k].startswith(";") and delimiter != ";")
        marked = _MARK.sub("", lines[k], count=1) if remark else lines[k]
        fields = _parted(marked, delimiter, width)
        if len(fields) != width and len(bare := _parted(_TAG.sub("", marked, count=1), delimiter, width)) == width:
            fields = bare
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
            return k, fields, {}  # names that no row fits, which an error states later
    return -1, [], {}


def _are_units(fields: Sequence[str]) -> bool:
    """Check whether fields are units, empty or dashes, with a force, torque or time among them."""
    bare = [re.sub(r"^[\[(]|[\])]$", "", text) for text in fields]
    known = [text for text in bare if any(known_unit(text, each) for each in (TIME_UNITS, FORCE_UNITS, TORQUE_UNITS))]
    others = [text for text in bare if text not in known and text not in ("", "-", "--", "1", "m", "mm", "deg", "rad")]
    bracketed = all(re.fullmatch(r"[\[(].*[\])]|-?", text) for text in fields)
    return len(fields) > 1 and bool(known) and (bracketed or len(others) <= len(fields) // 4)


def _parted(line: str, delimiter: str, width: int) -> list[str]:
    """Split a header, whose names may contain the spaces that separate fields of rows."""
    if delimiter != SPACES:
        return _split(line, delimiter)
    for way in (r"\s+", r"\s{2,}|\t", r"\s*,\s*", r"\s+(?![\[(])"):
        if len(fields := re.split(way, line.strip())) == width:
            return fields
    return _split(line, SPACES)


def _split(line: str, delimiter: str) -> list[str]:
    """Split a line into fields, without quotes and spaces around them."""
    if delimiter == SPACES:
        return re.split(r"[ \t]+", line.strip(" \t"))
    if '"' not in line:
        return [text.strip() for text in line.split(delimiter)]
    try:
        return [text.strip() for text in next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))]
    except csv.Error:  # a carriage return outside of quotes, or a field that is too long
        return [text.strip() for text in line.split(delimiter)]


def _fields(line: str, delimiter: str, path: Path, number: int) -> list[str]:
    if line.count('"') % 2:
        raise InputError("a quote is not closed in the header.", where=f"{path}, line {number + 1}")
    return _split(line, delimiter)


def _bare(line: str) -> str:
    return re.sub(r'"[^"]*"', "", line)


def _facts(lines: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Yield keys and values from `key: value`, `key = value`, or two fields."""
    for line in lines:
        bare = _MARK.sub("", line, count=1).strip().strip('"')
        pairs = _FACT.findall(bare) or [fields for fields in (re.split(r"\s*[,;\t]\s*", bare),) if len(fields) == 2]
        yield from ((key.strip().lower(), value.strip().strip('"')) for key, value in pairs)


def _decimal(lines: Sequence[str], delimiter: str, first: int, path: Path) -> str:
    """Return the decimal point: a comma only where it cannot separate thousands."""
    doubted, points, commas = "", False, False
    for k, line in enumerate(lines):
        if line.count('"') % 2 or (delimiter == "," and '"' not in line):
            continue
        for text in _split(line, delimiter):
            if not _is_number(text):
                continue
            points |= "." in text
            if _THOUSANDS.fullmatch(text):
                what = f"{text!r} has a separator between thousands."
                hint = "Export the numbers without separators."
                raise InputError(what, where=f"{path}, line {first + k + 1}", hint=hint)
            if _EITHER.fullmatch(text):
                doubted = doubted or f"{path}, line {first + k + 1}: {text!r}"
            elif "," in text:
                commas = True
    if doubted and not commas:
        what = "the comma can be a decimal point or a separator of thousands."
        raise InputError(what, where=doubted, hint="Export with decimal points, or without separators of thousands.")
    return "," if commas or (delimiter != "," and not points) else "."
