"""Kinds of arguments, so that help reads the same everywhere."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

__all__ = [
    "ContactsFile",
    "FileOption",
    "Log",
    "MeshFile",
    "Output",
    "Pair",
    "RigFile",
    "Scalar",
    "SomeFile",
    "TruthFile",
]

Log = Annotated[Positional[Path], arg(metavar="LOG")]
MeshFile = Annotated[Positional[Path], arg(metavar="MESH")]
ContactsFile = Annotated[Positional[Path], arg(metavar="CONTACTS")]
TruthFile = Annotated[Positional[Path], arg(metavar="TRUTH")]
SomeFile = Annotated[Positional[Path], arg(metavar="FILE")]
Output = Annotated[Path, arg(aliases=["-o"], metavar="FILE")]
RigFile = Annotated[Path, arg(metavar="FILE")]
FileOption = Annotated[Path | None, arg(metavar="FILE", help_behavior_hint="")]
Scalar = Annotated[float | None, arg(metavar="X", help_behavior_hint="")]
Pair = Annotated[tuple[float, float] | None, arg(metavar="X X", help_behavior_hint="")]
