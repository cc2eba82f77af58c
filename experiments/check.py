"""What an experiment's expected.toml asks for, beside what was measured, and tables as Markdown."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

__all__ = ["Check", "checks_of", "table"]


@dataclass(frozen=True)
class Check:
    """One figure.

    Args:
        what: in words, with the unit that is shown.
        got: measured; NaN: not measured.
        least, most: what is asked; None: no bound there.
        theirs: what others say of it, a column each; None: nothing.
        scale: from what is compared to what is shown: 1e3 for metres in millimetres.
    """

    what: str
    got: float
    least: float | None = None
    most: float | None = None
    theirs: tuple[float | None, ...] = (None,)
    scale: float = 1.0

    @classmethod
    def of(
        cls, want: Mapping[str, Any], got: float, what: str = "", theirs: Sequence[str] = ("paper",), scale: float = 1.0
    ) -> Check:
        """Of a table of expected.toml: `what`, `at_least`, `at_most`, and a key for each of `theirs`."""
        said = tuple(want.get(name) for name in theirs)
        return cls(what or want["what"], got, want.get("at_least"), want.get("at_most"), said, scale)

    @property
    def met(self) -> bool:
        """Within its bounds; NaN is not."""
        return (self.least is None or self.got >= self.least) and (self.most is None or self.got <= self.most)

    def cells(self) -> list[str]:
        """A row of the table: what, theirs, got, asked, verdict."""
        bounds = ((">=", self.least), ("<=", self.most))
        asked = ", ".join(f"{sign} {self._shown(value)}" for sign, value in bounds if value is not None)
        missed = "**not measured**" if np.isnan(self.got) else "**missed**"
        verdict = "" if not asked else "met" if self.met else missed
        return [self.what, *map(self._shown, self.theirs), self._shown(self.got), asked, verdict]

    def _shown(self, value: float | None) -> str:
        return "" if value is None else f"{self.scale * value:.4g}"


def checks_of(
    expected: Path,
    got: Mapping[str, float],
    theirs: Sequence[str] = ("paper",),
    scale: Callable[[str], float] = lambda figure: 1.0,
) -> list[Check]:
    """All that a file asks for, a table a figure; `scale` of a figure's name."""
    wanted = tomllib.loads(expected.read_text(encoding="utf-8"))
    return [Check.of(want, got[name], theirs=theirs, scale=scale(name)) for name, want in wanted.items()]


def table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """As Markdown."""
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", r"\|") for cell in line) + " |" for line in lines)
