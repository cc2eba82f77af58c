"""Every error that Palpate raises on purpose.

PalpateError
|-- InputError          a file, a row or a field is wrong: the problem, its place, how to correct it
|-- GeometryError       a mesh or surface cannot be used as it is
`-- NotIdentifiable     the data cannot determine the result: rank and what is missing
"""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager


class PalpateError(Exception):
    """The base class: catch it to catch every error that Palpate raises on purpose."""


class InputError(PalpateError):
    """A file, a row or a field cannot be used.

    Args:
        what: the problem, a sentence without the place.
        where: file, row, column or key, as the user knows it.
        hint: how to correct it.
    """

    def __init__(self, what: str, *, where: str = "", hint: str = "") -> None:
        self.what, self.where, self.hint = what, where, hint
        place = f"{where}: " if where else ""
        advice = f" {hint}" if hint else ""
        super().__init__(f"{place}{what}{advice}")


def not_loaded(problem: ImportError, what: str, extra: str, where: str = "") -> InputError:
    """Return the `InputError` to raise where the library of an extra is missing, or is installed but does not load.

    Args:
        problem: the error of the import.
        what: which use needs the library, without a full stop: "bags need rosbags".
        extra: of Palpate, that brings it.
        where: file, as the user knows it.
    """
    if isinstance(problem, ModuleNotFoundError):
        return InputError(f"{what}.", where=where, hint=f"pip install 'palpate[{extra}]'")
    hint = "Install the library that is named, which bare systems lack."
    return InputError(f"{what}, which is installed but does not load ({problem}).", where=where, hint=hint)


@contextmanager
def importing_extra(what: str, extra: str, where: str = "") -> Generator[None]:
    """Open a context for imports of an extra's library, which raise what `not_loaded` returns where they fail.

    Raises:
        InputError: the library is missing, or does not load.
    """
    try:
        yield
    except ImportError as problem:
        raise not_loaded(problem, what, extra, where) from problem


class GeometryError(PalpateError):
    """A mesh or surface cannot be used as it is."""


class NotIdentifiable(PalpateError):  # no Error in the name: it is a finding about the data, not a failure of the code
    """The data cannot determine the requested result.

    Args:
        message: the sentence a user needs to correct the data.
        rank: number of directions that the data determine.
        missing: names of the directions that they do not.
    """

    def __init__(self, message: str, *, rank: int, missing: tuple[str, ...]) -> None:
        self.rank, self.missing = rank, missing
        super().__init__(message)
