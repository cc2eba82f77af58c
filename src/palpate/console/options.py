"""Define kinds of arguments, so that help reads the same everywhere."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Optional, Union

from tyro.conf import Positional, arg

from palpate.errors import InputError

Log = Annotated[Positional[Path], arg(metavar="LOG")]
MeshFile = Annotated[Positional[Path], arg(metavar="MESH")]
ContactsFile = Annotated[Positional[Path], arg(metavar="CONTACTS")]
TruthFile = Annotated[Positional[Path], arg(metavar="TRUTH")]
SomeFile = Annotated[Positional[Path], arg(metavar="FILE")]
Output = Annotated[Path, arg(aliases=["-o"], metavar="FILE")]
RigFile = Annotated[Path, arg(metavar="FILE")]
FileOption = Annotated[Optional[Path], arg(metavar="FILE", help_behavior_hint="")]
NameOption = Annotated[Optional[str], arg(metavar="NAME", help_behavior_hint="")]
CountOption = Annotated[Optional[int], arg(metavar="N", help_behavior_hint="")]
Scalar = Annotated[Optional[float], arg(metavar="X", help_behavior_hint="")]
Pair = Annotated[Union[None, tuple[float, float]], arg(metavar="X X", help_behavior_hint="")]  # None first: the default


def require_positive(value: float | None, option: str) -> None:
    """Check the value of an option.

    Raises:
        InputError: it is zero, negative or NaN; None is none of these.
    """
    if value is not None and not value > 0:
        raise InputError("must be positive.", where=option)


def require_port(value: int, option: str) -> None:
    """Check that the value of an option is a port, or 0 for any that is free.

    Raises:
        InputError: it is not from 0 to 65535.
    """
    if not 0 <= value < 2**16:
        raise InputError("must be a port from 1 to 65535, or 0 for any free one.", where=option)
