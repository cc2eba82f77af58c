"""One claim, and what was measured."""

from __future__ import annotations

import math
import os
import tomllib
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

ROOT = Path(__file__).resolve().parents[1]


@dataclass(frozen=True)
class Row:
    """A claim, its target, what was measured, and whether that meets it.

    Attributes:
        what: with the size of what was measured.
        target: "" where nothing is asked.
        got: measured.
        passed: None: only reported, or skipped.
        theirs: what the paper or others have, a column each.
    """

    what: str
    target: str
    got: str
    passed: bool | None = None
    theirs: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.passed is not None:  # numpy's False is not False
            object.__setattr__(self, "passed", bool(self.passed))

    @classmethod
    def bounded(
        cls, want: Mapping[str, Any], got: float, what: str = "", others: tuple[str, ...] = ("paper",), scale: float = 1
    ) -> Row:
        """Return the claim of a table of expected.toml.

        Args:
            want: `what`, `at_least`, `at_most`, and a key for each of `others`.
            got: measured; NaN: not measured, which meets no bound.
            what: in words, with the unit that is shown; "": that of `want`.
            others: keys of what others have.
            scale: from what is compared to what is shown: 1e3 for metres in millimetres.
        """
        shown = {name: f"{scale * value:.4g}" for name, value in want.items() if name != "what"}
        bounds = {"at_least": ">= ", "at_most": "<= "}
        target = ", ".join(sign + shown[name] for name, sign in bounds.items() if name in want)
        met = got >= want.get("at_least", -math.inf) and got <= want.get("at_most", math.inf)
        figure = "not measured" if math.isnan(got) else f"{scale * got:.4g}"
        theirs = tuple(shown.get(other, "") for other in others)
        return cls(what or want["what"], target, figure, met if target else None, theirs)

    @property
    def verdict(self) -> str:
        if self.got.startswith("skipped"):
            return "skipped"
        return "reported" if self.passed is None else "met" if self.passed else "**missed**"


def expected(
    folder: Path, got: Mapping[str, float], *others: str, scale: Callable[[str], float] = lambda figure: 1.0
) -> list[Row]:
    """Return all that a folder's expected.toml asks for, a table a figure; `scale` of a figure's name."""
    wanted = tomllib.loads((folder / "expected.toml").read_text(encoding="utf-8"))
    return [Row.bounded(want, got[name], "", others or ("paper",), scale(name)) for name, want in wanted.items()]


def shared() -> Path | None:
    """Return the folder of real recordings that are not part of the project; None where it is absent."""
    folder = Path(os.environ.get("PALPATE_SHARED", ROOT.parent / "shared"))
    return folder if (folder / "data").is_dir() else None


@contextmanager
def scratch() -> Generator[Path]:
    """A folder that is gone afterwards."""
    with TemporaryDirectory() as folder:
        yield Path(folder)


def skipped(what: str, target: str) -> list[Row]:
    """Return the row of a claim that cannot be tried for lack of data."""
    return [Row(what, target, "skipped: no shared data (PALPATE_SHARED, or ../shared)")]
