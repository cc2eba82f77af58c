"""The figures in the prose of pages, numbers with a unit, and the lines that bear them out.

A piece is a paragraph, an item of a list or a row of a table. One that names themes of `claims/themes.toml`, in sight
or in a comment, has all of its figures, also decimals without a unit, from rows that these measured and that share a
word with what is near the figure. Any other has them from a block of its page, or from a line of the source that sets
or states them, with two such words around it. A row of a table that names no theme has those of the text above it.
"""

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from claims.page import FIGURES, THEMES
from tests.support.blocks import ROOT, blocks

_UNITS = {
    "m": {"nm": 1e-9, "um": 1e-6, "micrometres": 1e-6, "mm": 1e-3, "cm": 1e-2, "m": 1.0},
    "N": {"mN": 1e-3, "N": 1.0},
    "s": {"us": 1e-6, "ms": 1e-3, "s": 1.0, "seconds": 1.0, "min": 60.0, "minutes": 60.0},
    "deg": {"deg": 1.0, "degrees": 1.0},
    "Hz": {"Hz": 1.0, "kHz": 1e3},
    "kg": {"g": 1e-3, "kg": 1.0},
    "MB": {"MB": 1.0, "MiB": 1.0},
    "1": {"%": 0.01, "times": 1.0},
}
_OF = {unit: (kind, scale) for kind, units in _UNITS.items() for unit, scale in units.items()}
_UNIT = "|".join(sorted(_OF, key=len, reverse=True))
_NUMBER = r"\d+(?:,\d{3})*(?:\.\d+)?(?:e-?\d+)?"
_LINKS = r"\s?(?:,|/|-|and|to|or|of|against|\+-|x)\s?"
_FIGURE = re.compile(rf"(?<![\w.#^{{])({_NUMBER}(?:{_LINKS}{_NUMBER})*)\s?({_UNIT})(?![\w$^*])")
_DECIMAL = re.compile(r"(?<![\w.])\d+\.\d+(?![\w.])")
_SET = re.compile(rf"= ?\(?({_NUMBER}(?:, {_NUMBER})*)(?![\w.*])")
_COMMENT = re.compile(rf"# ({_UNIT})\b")
_THEME = re.compile("|".join(rf"\b{re.escape(name)}\b" for group in THEMES.values() for name in group))
_UNSEEN = re.compile(r"^```.*?^```|<!--(?!\w+\.\w+-->).*?-->|\$\$.*?\$\$", re.MULTILINE | re.DOTALL)
_QUOTED = re.compile(r"`[^`]*`")
_BREAK = re.compile(r"\n(?=\s*\n|\s*- |\s*\d+\. |\|)")
_NEAR = 60  # characters on either side of a figure, whose words count; of a row all do
_AROUND = 2  # lines on either side of a line of the source whose words are its own
_COMMON = set(re.findall(r"\w+", "with from that this than each which their have them only into over when where more"))


@dataclass(frozen=True)
class Piece:
    """A paragraph, an item or a row of a page, and the themes that its figures are of."""

    page: Path
    line: int
    text: str
    themes: tuple[str, ...]

    def figures(self) -> list[tuple[str, str, str]]:
        """Each number, its unit, and the text near it."""
        found, text = list[tuple[str, str, str]](), _QUOTED.sub(lambda code: re.sub(r"\d", "", code[0]), self.text)
        for match in _FIGURE.finditer(text):
            reach = len(text) if text.startswith("|") else _NEAR
            near = text[max(0, match.start() - reach) : match.end() + reach]
            found += [(one, match[2], near) for one in re.findall(_NUMBER, match[1])]
        bare = _DECIMAL.findall(_FIGURE.sub(" ", text)) if self.themes else []
        return found + [(one, "", self.text) for one in bare]


def pieces(page: Path) -> Iterator[Piece]:
    """Every piece of a page, in order."""
    text = _UNSEEN.sub(lambda match: "\n" * match[0].count("\n"), page.read_text(encoding="utf-8"))
    line, above = 1, ()
    for part in _BREAK.split(text):
        themes = tuple(_THEME.findall(part))
        above = above if part.startswith("|") or not part.strip() else themes
        yield Piece(page, line, part, themes or above)
        line += part.count("\n") + 1


def unborne(piece: Piece) -> list[str]:
    """The figures of a piece that nothing bears out."""
    return [f"{one} {unit}".strip() for one, unit, near in piece.figures() if not _borne(piece, one, unit, near)]


def _borne(piece: Piece, number: str, unit: str, near: str) -> bool:
    named = _words(near)
    if piece.themes:
        rows = (row for theme in piece.themes for row in _measured(theme) if not named or _words(row) & named)
        return any(borne_out(number, unit, row) for row in rows)
    lines = (line for line, words in _source() if len(words & named) > 1)
    return any(borne_out(number, unit, line, si=True) for line in (*_shown(piece.page), *lines))


def borne_out(number: str, unit: str, line: str, *, si: bool = False) -> bool:
    """Whether a line rounds to a number, in a unit of the line or, where it has none, in SI (`si`) or the number's."""
    kind, scale = _OF.get(unit, ("", 1.0))
    others, units = _read(line)
    share = unit == "%" and "%" not in units
    scales = {_OF[each][1] for each in units if _OF[each][0] == kind}
    if not scales and (si or kind in ("", "1") or not {_OF[each][0] for each in units} - {"1"}):
        scales = {1.0 if si or share else scale}
    zeros = re.search(r"[0,]*$", number) if "," in number else None
    step = 10.0 ** (zeros[0].count("0") if zeros else -len(number.partition(".")[2]))
    wanted = float(number.replace(",", ""))
    return any(abs(other * each / scale - wanted) <= 0.5000001 * step for other in others for each in scales)


@cache
def _read(line: str) -> tuple[tuple[float, ...], frozenset[str]]:
    """The numbers of a line, and its units."""
    numbers = re.findall(rf"(?<![\w.]){_NUMBER}", line)
    units = re.findall(rf"(?<![A-Za-z])(?:{_UNIT})(?![A-Za-z])", line)
    return tuple(float(one.replace(",", "")) for one in numbers), frozenset(units)


@cache
def _words(text: str) -> frozenset[str]:
    return frozenset(word[:5].lower() for word in re.findall(r"[A-Za-z]{4,}", text)) - _COMMON


@cache
def _measured(theme: str) -> tuple[str, ...]:
    """What a theme measured, a line a row: of figures.json or, where it has none there and for papers, of its page."""
    kept = json.loads(FIGURES.read_text(encoding="utf-8"))
    rows = [" ".join((*row[:3], *row[4])) for row in kept.get(theme, {"rows": []})["rows"]]
    group, _, name = theme.partition(".")
    page = ROOT / "claims" / (f"{group}/{name}/README.md" if group == "papers" else f"{group}/RESULTS.md")
    if rows and group != "papers":
        return tuple(rows)
    head = ""
    for line in page.read_text(encoding="utf-8").splitlines():
        head = (head or line) if line.startswith("|") else ""
        rows.append(f"{head} {line}")
    return tuple(rows)


@cache
def _shown(page: Path) -> tuple[str, ...]:
    return tuple(line for block in blocks(page) for line in block.code.splitlines())


@cache
def _source() -> tuple[tuple[str, frozenset[str]], ...]:
    """What lines of the source set behind `=` or state with a unit, and the words around."""
    found: list[tuple[str, frozenset[str]]] = []
    for file in sorted((ROOT / "src").rglob("*.py")):
        lines = file.read_text(encoding="utf-8").splitlines()
        for k, line in enumerate(lines):
            stated = [*_SET.findall(line), *(match[0] for match in _FIGURE.finditer(line)), *_COMMENT.findall(line)]
            if stated:
                near = " ".join(lines[max(0, k - _AROUND) : k + _AROUND + 1])
                found.append((" ".join(stated), _words(near)))
    return tuple(found)
