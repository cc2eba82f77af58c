"""Write and read files of contacts, block by block, as CSV, Parquet and MCAP."""

from palpate.files.contacts.reading import contact_blocks
from palpate.files.contacts.writing import (
    ContactsWriter,
    open_contacts,
    read_contacts,
    require_format,
    unfinished,
    write_contacts,
)

__all__ = [
    "ContactsWriter",
    "contact_blocks",
    "open_contacts",
    "read_contacts",
    "require_format",
    "unfinished",
    "write_contacts",
]
