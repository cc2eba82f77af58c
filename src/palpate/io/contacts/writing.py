"""Files of contacts: what was estimated, at least one row for every sample of the log, as CSV, Parquet or MCAP.

While it is written, OUTPUT is OUTPUT.part, which can be read up to its last block at any moment.
"""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from palpate.contact.estimate import ContactEstimate
from palpate.errors import InputError
from palpate.io.atomic import PART, growing, part, writing
from palpate.io.contacts.reading import contact_blocks
from palpate.io.contacts.rows import COLUMNS, Contacts
from palpate.io.contacts.sinks import SINKS, Sink

__all__ = [
    "COLUMNS",
    "Contacts",
    "ContactsWriter",
    "contact_blocks",
    "open_contacts",
    "read_contacts",
    "require_format",
    "unfinished",
    "write_contacts",
]


class ContactsWriter:
    """Takes estimates block by block; each is in the file when `write` returns."""

    def __init__(self, path: Path, sink: Sink) -> None:
        self._path, self._sink = path, sink
        self._samples = 0
        self.rows = 0

    def write(
        self,
        time: Float[np.ndarray, " n"],
        estimate: ContactEstimate,
        *,
        sample: Int[np.ndarray, " n"] | None = None,
        contact: Int[np.ndarray, " n"] | None = None,
        cell: Float[np.ndarray, "n 3"] | None = None,
    ) -> None:
        """Append a block.

        Args:
            time: (n,) [s] as in the log.
            estimate: batch of n, in the frame of the file.
            sample: (n,) rows of the log; None: one row each, going on from the block before.
            contact: (n,) which of the sample's contacts; None: 0.
            cell: (n, 3) row, column and area [m^2], in a file that was opened for a skin.
        """
        count = len(time)
        if not count:
            return
        sample = np.arange(self._samples, self._samples + count) if sample is None else sample
        contact = np.zeros(count, dtype=np.int64) if contact is None else contact
        with writing(self._path):
            self._sink.append(Contacts(sample, time, contact, estimate, cell=cell))
        self._samples = int(sample[-1]) + 1
        self.rows += count


def require_format(path: Path) -> None:
    """Refuse a suffix that says no format, before any work is done.

    Raises:
        InputError: the suffixes that there are.
    """
    if path.suffix.lower() not in SINKS:
        raise InputError(
            f"no format of contacts ends in {path.suffix!r}.", where=str(path), mend=f"Use {', '.join(SINKS)}."
        )


@contextmanager
def open_contacts(path: Path, *, frame_id: str = "surface", skin: bool = False) -> Generator[ContactsWriter]:
    """A file of contacts to write block by block, in memory that does not grow; the suffix says the format.

    OUTPUT.part takes the name of OUTPUT when the block ends well, or by Ctrl-C once there is a row. After any other
    error, or a kill, it stays, with every block that was written; without a row it is removed. OUTPUT itself is not
    touched before.

    Args:
        path: OUTPUT, ending in .csv, .parquet or .mcap.
        frame_id: name of the contacts' frame, for viewers; only MCAP holds it.
        skin: the contacts have cells, in columns behind the others.

    Raises:
        InputError: another suffix, or it cannot be written.
    """
    require_format(path)
    with growing(path) as temporary:
        with writing(path):
            sink = SINKS[path.suffix.lower()](temporary, frame_id, skin)
        writer = ContactsWriter(path, sink)
        try:
            yield writer
        except BaseException as problem:
            with writing(path):
                _end(writer, sink, isinstance(problem, KeyboardInterrupt))
            raise
        with writing(path):
            sink.finish()


def write_contacts(
    path: Path,
    time: Float[np.ndarray, " n"],
    estimate: ContactEstimate,
    *,
    sample: Int[np.ndarray, " n"] | None = None,
    contact: Int[np.ndarray, " n"] | None = None,
) -> None:
    """Write estimates in one go; see `open_contacts` and `ContactsWriter.write`."""
    with open_contacts(path) as writer:
        writer.write(time, estimate, sample=sample, contact=contact)


def read_contacts(path: Path) -> Contacts:
    """All rows of a file of contacts, finished or not; numbers are those that were written, to the last bit.

    Raises:
        InputError: it is none, or a row is not one of contacts.
    """
    blocks = list(contact_blocks(path))
    if len(blocks) == 1:
        return blocks[0]
    return Contacts(
        np.concatenate([block.sample for block in blocks]),
        np.concatenate([block.time for block in blocks]),
        np.concatenate([block.contact for block in blocks]),
        ContactEstimate.joined([block.estimate for block in blocks]),
        tuple(dict.fromkeys(note for block in blocks for note in block.notes)),
        _cells(blocks),
    )


def _cells(blocks: list[Contacts]) -> Float[np.ndarray, "n 3"] | None:
    if all(block.cell is None for block in blocks):
        return None
    return np.concatenate([np.full((len(block), 3), np.nan) if block.cell is None else block.cell for block in blocks])


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
