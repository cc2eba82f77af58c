"""Read contacts from files of other commands, in the frame that the body is drawn in."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from palpate.contact.contacts import Contacts
from palpate.errors import InputError
from palpate.files.contacts import contact_blocks, read_contacts
from palpate.files.models import read_provenance
from palpate.setup.link import Link


def written(path: Path) -> Contacts | None:
    """Return the `Contacts` in a file; None if it is no file of contacts.

    Raises:
        InputError: a row after the first block is invalid.
    """
    return read_contacts(path) if _holds_contacts(path) else None


def compared_blocks(path: Path, link: Link) -> Iterator[Contacts]:
    """Return an iterator over blocks of a file's `Contacts` in the frame that the body is drawn in.

    Raises:
        InputError: the file exists but holds no contacts. While iterating: as for `on_body`, the file does not exist,
            or a row is invalid.
    """
    if path.exists() and not _holds_contacts(path):
        hint = "Estimate it first: palpate estimate LOG --rig RIG -o CONTACTS."
        raise InputError("holds no contacts to compare.", where=str(path), hint=hint)
    return (on_body(block, path, link) for block in contact_blocks(path))


def on_body(contacts: Contacts, path: Path, link: Link) -> Contacts:
    """Transform the `Contacts` of a file at `path` into the frame that the body is drawn in.

    Raises:
        InputError: they are in the base frame, in which the body moves.
    """
    frame = read_provenance(path).get("frame", "surface")
    if frame == "base":
        hint = "Estimate without --frame base, or view the log itself."
        raise InputError("these contacts are in the base frame, in which the body moves.", where=str(path), hint=hint)
    moved = frame == "sensor" and link.stated is not None
    return contacts.in_frame(link.mount.inverse()) if moved else contacts


def _holds_contacts(path: Path) -> bool:
    try:
        next(contact_blocks(path))
    except InputError:  # the reader of logs will say what it is instead
        return False
    return True
