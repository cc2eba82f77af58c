"""One claim, and what was measured."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

__all__ = ["ROOT", "Row", "shared", "skipped"]

ROOT = Path(__file__).resolve().parents[1]


@dataclass(frozen=True)
class Row:
    """A claim, its target, what was measured, and whether that meets it (None: only reported, or skipped)."""

    row: str
    what: str
    target: str
    got: str
    passed: bool | None
    command: str

    def __post_init__(self) -> None:
        if self.passed is not None:  # numpy's False is not False
            object.__setattr__(self, "passed", bool(self.passed))

    @property
    def verdict(self) -> str:
        """As the table says it."""
        if self.got.startswith("skipped"):
            return "skipped"
        return "reported" if self.passed is None else "met" if self.passed else "**missed**"


def shared() -> Path | None:
    """The folder of real recordings that are not part of the project; None where it is absent."""
    folder = Path(os.environ.get("PALPATE_SHARED", ROOT.parent / "shared"))
    return folder if (folder / "data").is_dir() else None


def skipped(row: str, what: str, target: str, command: str) -> list[Row]:
    """The row of a claim that cannot be tried for lack of data."""
    return [Row(row, what, target, "skipped: no shared data (PALPATE_SHARED, or ../shared)", None, command)]
