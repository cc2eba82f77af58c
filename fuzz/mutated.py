"""Change a text as a person might: a word or a number becomes another, a line goes or comes twice."""

from __future__ import annotations

import random
import re

_WORD = re.compile(rb'"[^"\n]*"|[-+]?[\w.]+|[^\s\w]')
_ODD = (
    *(b"nan", b"inf", b"-inf", b"-1", b"0", b"-0.0", b"1", b"0.5", b"3", b"1e9", b"1e-320", b"1e308", b"1e400"),
    *(b"9223372036854775808", b"18446744073709551616", b"-2147483649", b"true", b'""', b'"a"', b'"/"', b'"."'),
    *(b"[]", b"[[]]", b"{}", b"[0.0, 0.0, 0.0]", b"[1e300, nan]", b"[true]", b'["x", "x"]', b"\xc3\xa9", b"\xff"),
)


def changed(data: bytes, seed: int) -> bytes:
    """Return a text with one change that the seed draws; without words, the same."""
    rng = random.Random(seed)
    words, lines = list(_WORD.finditer(data)), data.splitlines(keepends=True)
    if not words:
        return data
    if rng.random() < 0.2:
        at = rng.randrange(len(lines))
        lines[at : at + 1] = [] if rng.random() < 0.5 else [lines[at], rng.choice(lines)]
        return b"".join(lines)
    word = rng.choice(words)
    new = rng.choice(_ODD) if rng.random() < 0.5 else rng.choice(words)[0]
    return data[: word.start()] + new + data[word.end() :]
