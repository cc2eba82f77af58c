"""How text is spoilt: lines, fields and encodings of a table; keys and values of TOML."""

import re
from functools import partial

from claims.evidence.mutation_bytes import Mutation, Random

NUMBERS = ("nan", "inf", "-inf", "1e308", "-1e308", "1e-320", "-0", "0", "1", "-1", "1e9", "1e17", "-1e17", "1e-17", "")
NUMBERS += ("9" * 400, "18446744073709551616", "0x10", "1_000", "1,5", "NaN", "abc", "--1", '"', "True", "é", "1e", ".")
VALUES = ("nan", "inf", "-inf", "1e308", "1e-308", "-0.0", "0", "1", "-1", "1e17", "-1e17", "1e-14", "9" * 400, "true")
VALUES += ('""', '"x"', '"\\u0000"', "[]", "[[]]", "{}", "[1, 2]", "[0.0, 0.0, 0.0]", "[nan, 0.0, 1.0]", "1979-05-27")
VALUES += ('"base"', '"sensor"', '"plane"', '"mesh"', '"kalman"', '"zero_phase"', '"imu"')
VALUES += ('"."', '"/"', '["x", "x", "y"]')
REALS = ("0.0", "1.0", "-1.0", "1", "0", "-3", "1e17", "-1e17", "1e-17", "1e-300", "1e308", "1e9", "0.3", "7", "1e4")


def encoded(data: bytes, random: Random) -> bytes:
    text = data.decode(errors="replace")
    encoding = str(random.choice(["utf-16", "utf-16-le", "utf-32", "utf-8-sig", "cp037", "latin-1"]))
    return text.encode(encoding, errors="replace")


def line_ends(data: bytes, random: Random) -> bytes:
    return data.replace(b"\n", (b"\r", b"\r\n", b"\n\n", b"\n\r", b"\x0b", b" \n")[int(random.integers(6))])


def delimiters(data: bytes, random: Random) -> bytes:
    new = (b";", b"\t", b", ", b" ", b"|", b",,", b'","')[int(random.integers(7))]
    return data.replace(b",", new, -1 if random.random() < 0.7 else int(random.integers(40)))


def lines(data: bytes, random: Random) -> bytes:
    lines = data.split(b"\n")
    count, at = len(lines), int(random.integers(len(lines)))
    match int(random.integers(7)):
        case 0:
            del lines[at : at + int(random.integers(1, 60))]
        case 1:
            lines = [lines[0], *(lines[1 + k] for k in random.permutation(count - 1).tolist())]
        case 2:
            lines[at:at] = [lines[at]] * int(random.integers(1, 300))
        case 3:
            lines[1:] = lines[:0:-1]
        case 4:
            lines[at] = b""
        case 5:
            lines = lines[at:]
        case _:
            lines[at] = lines[int(random.integers(count))]
    return b"\n".join(lines)


def fields(data: bytes, random: Random) -> bytes:
    """Numbers anywhere in the text become something else: one, a few, or a column of a table."""
    found = list(re.finditer(rb"(?<![\w.])[-+]?\d[\w.+-]*", data))
    if not found:
        return data
    at = int(random.integers(len(found)))
    some = (found[at : at + 1], found[at : at + 40], found[at::11])[int(random.integers(3))]
    new = NUMBERS[int(random.integers(len(NUMBERS)))].encode()
    for match in reversed(some):
        data = data[: match.start()] + new + data[match.end() :]
    return data


def header(data: bytes, random: Random) -> bytes:
    """A name of the first line is dropped, repeated, misspelt, or quoted."""
    first, end, rest = data.partition(b"\n")
    names = first.split(b",")
    at = int(random.integers(len(names)))
    name, quote = names[at], b'"'
    odd = (b"", b" ", quote, names[0], name.upper(), name[:-1], name + b"x", quote + name + quote, b"\xff")
    names[at] = odd[int(random.integers(len(odd)))]
    return b",".join(names) + end + rest


def value(data: bytes, random: Random) -> bytes:
    found = list(re.finditer(rb"(?m)(?<==)[ ]*([^\n#=]+?)[ ]*(?=[#,}\n]|$)", data))
    return _replaced(data, found, VALUES, random)


def element(data: bytes, random: Random, by: tuple[str, ...] = VALUES, among: int | None = None) -> bytes:
    return _replaced(data, list(re.finditer(rb"(?<![\w\"])[-+]?\d[\w.+-]*", data))[:among], by, random)


def _replaced(data: bytes, found: list[re.Match[bytes]], by: tuple[str, ...], random: Random) -> bytes:
    if not found:
        return data
    match = found[int(random.integers(len(found)))]
    new = by[int(random.integers(len(by)))].encode()
    return data[: match.start()] + b" " + new + data[match.end() :]


def key(data: bytes, random: Random) -> bytes:
    found = list(re.finditer(rb"(?m)\w+(?= *=)|(?<=^\[)\w+(?=\]$)", data))
    keys = tuple(match[0].decode() for match in found)
    return _replaced(data, found, (*keys, "x", "folder", "a.b", '""'), random)


TABLE: tuple[Mutation, ...] = (*(fields,) * 3, *(lines,) * 2, *(header,) * 2, delimiters, line_ends, encoded)
ASCII: tuple[Mutation, ...] = (fields, fields, lines, line_ends)
TOML: tuple[Mutation, ...] = (*(partial(element, by=REALS),) * 12, *(value, element, key) * 2, lines, encoded)
PAYLOAD: tuple[Mutation, ...] = (*(partial(element, by=REALS, among=14),) * 30, element, value, key, lines)
