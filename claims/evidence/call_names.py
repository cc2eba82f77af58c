"""Public callables that the walk of calls cannot call, and those that it reaches only in full."""

import tomllib
from collections.abc import Iterable
from pathlib import Path

_NAMES = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
UNCALLED = {name for names in _NAMES["uncalled"].values() for name in names}  # a class stands for its methods
LATER = set(_NAMES["later"]["names"])


def uncalled(names: Iterable[str]) -> set[str]:
    """Return those of the names that are listed in `UNCALLED`, by themselves or by their class."""
    return {name for name in names if name in UNCALLED or name.rpartition(".")[0] in UNCALLED}
