"""Files of contacts: what was estimated, at least one row for every sample of the log, as CSV, Parquet or MCAP.

While it is written, OUTPUT is OUTPUT.part, which can be read up to its last block at any moment.
"""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from palpate.contact.contacts import Contacts
from palpate.errors import InputError
from palpate.io.atomic import PART, growing, part, writing
from palpate.io.contacts.reading import contact_blocks
from palpate.io.contacts.sinks import SINKS, Sink

__all__ = [
    "ContactsWriter",
    "contact_blocks",
    "open_contacts",
    "read_contacts",
    "require_format",
    "unfinished",
    "write_contacts",
]


class ContactsWriter:
    """Takes contacts block by block; each is in the file when `write` returns."""

    def __init__(self, path: Path, sink: Sink, features: tuple[str, ...]) -> None:
        self._path, self._sink, self._features = path, sink, features
        self.rows = 0

    def write(self, contacts: Contacts) -> None:
        """Append a block, in the frame of the file, with the features that it was opened for."""
        if tuple(contacts.features) != self._features:
            raise ValueError(f"contacts have features {tuple(contacts.features)}, the file {self._features}")
        if len(contacts):
            with writing(self._path):
                self._sink.append(contacts)
            self.rows += len(contacts)


def require_format(path: Path) -> None:
    """Refuse a suffix that says no format, before any work is done.

    Raises:
        InputError: the suffixes that there are.
    """
    if path.suffix.lower() not in SINKS:
        raise InputError(
            f"no format of contacts ends in {path.suffix!r}.", where=str(path), hint=f"Use {', '.join(SINKS)}."
        )


@contextmanager
def open_contacts(
    path: str | Path, *, frame_id: str = "surface", features: tuple[str, ...] = ()
) -> Generator[ContactsWriter]:
    """A file of contacts to write block by block, in memory that does not grow; the suffix says the format.

    OUTPUT.part takes the name of OUTPUT when the block ends well, or by Ctrl-C once there is a row. After any other
    error, or a kill, it stays, with every block that was written; without a row it is removed. OUTPUT itself is not
    touched before.

    Args:
        path: OUTPUT, ending in .csv, .parquet or .mcap.
        frame_id: name of the contacts' frame, for viewers; only MCAP holds it.
        features: names of the columns that the sensor adds, behind the others.

    Raises:
        InputError: another suffix, or it cannot be written.
    """
    path = Path(path)
    require_format(path)
    with growing(path) as temporary:
        with writing(path):
            sink = SINKS[path.suffix.lower()](temporary, frame_id, features)
        writer = ContactsWriter(path, sink, features)
        try:
            yield writer
        except BaseException as problem:
            with writing(path):
                _end(writer, sink, isinstance(problem, KeyboardInterrupt))
            raise
        with writing(path):
            sink.finish()


def write_contacts(path: str | Path, contacts: Contacts, *, frame_id: str = "surface") -> None:
    """Write contacts in one go; see `open_contacts`."""
    with open_contacts(path, frame_id=frame_id, features=tuple(contacts.features)) as writer:
        writer.write(contacts)


def read_contacts(path: str | Path) -> Contacts:
    """All rows of a file of contacts, finished or not; numbers are those that were written, to the last bit.

    Raises:
        InputError: it is none, or a row is not one of contacts.
    """
    return Contacts.joined(list(contact_blocks(Path(path))))


def unfinished(path: Path) -> Path | None:
    """OUTPUT.part where there is no OUTPUT, or what was named is such a file itself: writing it was cut short."""
    if path.suffix == PART:
        return path if path.exists() else None
    try:
        return part(path) if not path.exists() and part(path).exists() else None
    except (InputError, OSError, ValueError):
        return None


def _end(writer: ContactsWriter, sink: Sink, interrupted: bool) -> None:
    """After an error: an interrupt makes a whole file of the rows, without a row nothing is left."""
    if writer.rows and interrupted:
        sink.finish()
    else:
        sink.abandon(keep=bool(writer.rows))
