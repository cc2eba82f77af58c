"""An opened log, whatever its format: read in blocks, any number of times."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Protocol, runtime_checkable

from palpate.sensors.recording import Recording

__all__ = ["Log", "Watched"]


@runtime_checkable
class Watched(Protocol):
    """What is read piece by piece while somebody looks on.

    Attributes:
        size: bytes to read in all; `position`: bytes read so far in the running iteration, for who watches.
        torn: after an iteration, the sentence that says where the file was cut; "" where it is whole.
    """

    @property
    def size(self) -> int: ...  # noqa: D102 - said above

    @property
    def position(self) -> int: ...  # noqa: D102 - said above

    @property
    def torn(self) -> str: ...  # noqa: D102 - said above

    def notes(self) -> tuple[str, ...]:
        """What a reader of the results should know of what was read so far, one sentence each."""
        ...


@runtime_checkable
class Log(Watched, Protocol):
    """What every reader gives; `path` is of the file or folder."""

    @property
    def path(self) -> Path: ...  # noqa: D102 - said above

    def blocks(self) -> Iterator[Recording]:
        """The samples from the start, in the order of the file, every one once, in pieces as they come.

        Raises:
            InputError: what the layout asks for is not there.
        """
        ...
