"""Read files of contacts in blocks, finished or not, in any format."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import cast

import numpy as np
import polars as pl

from palpate.contact.contacts import Contacts
from palpate.contact.table import ORIGIN, features_of, from_frame, schema
from palpate.errors import InputError
from palpate.files.atomic import PART
from palpate.files.contacts.csv import csv_blocks, noted, require_columns
from palpate.files.contacts.mcap import KIND, from_messages
from palpate.files.inputs import open_input, read_some
from palpate.files.logs.parquet import require_pages
from palpate.files.mcap.reader import MAGIC, McapFile
from palpate.files.messages import MessageBlock
from palpate.processes import require_polars_threads

_ROWS = 65_536  # of a Parquet file read at a time
_KIND = KIND.replace("/msg/", "/")


def contact_blocks(path: Path) -> Iterator[Contacts]:
    """Yield the rows of a file of contacts, in order, in pieces, at least one; their notes have remarks on the file.

    Of OUTPUT.part every complete block is read.

    Raises:
        InputError: the file cannot be read or holds no contacts, or a row in it is invalid; or the process was forked
            after polars had started its threads.
    """
    require_polars_threads()
    if path.is_dir():  # OUTPUT.part of a Parquet file
        files = sorted(path.glob("*.parquet"))
        if not files:
            raise InputError("is a folder without rows of contacts (*.parquet).", where=str(path))
        for file in files:
            yield from _parquet(file)
        return
    with open_input(path) as file:
        start = read_some(file, path, len(MAGIC))
    if start == MAGIC:
        yield from _mcap(path)
    elif start.startswith(b"PAR1"):
        yield from _parquet(path)
    else:
        yield from csv_blocks(path, torn=path.suffix == PART)


def _parquet(path: Path) -> Iterator[Contacts]:
    require_pages(path)
    try:
        rows = pl.scan_parquet(path, glob=False)
        names = rows.collect_schema().names()
        require_columns(path, names)
        types = schema((*(name for name in ORIGIN if name in names), *features_of(names)))
        rows = rows.select(pl.col(name).cast(kind) for name, kind in types.items())
        count = cast(int, rows.select(pl.len()).collect().item())
        for start in range(0, max(count, 1), _ROWS):
            yield from_frame(rows.slice(start, _ROWS).collect())
    except (pl.exceptions.PolarsError, pl.exceptions.PanicException, ValueError, OSError) as problem:
        raise InputError(f"is not a file of contacts ({str(problem).splitlines()[0]}).", where=str(path)) from problem


def _mcap(path: Path) -> Iterator[Contacts]:
    """Yield the rows; a last piece without rows has the note on damage."""
    file, rows = McapFile(path), 0
    try:
        for messages in file.messages():
            definition = file.definitions.get(_KIND, "")
            groups = list(_ours(messages))
            if groups:
                found = [from_messages(records, definition) for _, records in groups]
                rows += sum(map(len, found))
                order = np.argsort(np.concatenate([place for place, _ in groups]), kind="stable")
                yield found[0] if len(found) == 1 else Contacts.joined(found)[order]
        note = file.torn
        if not rows and _KIND not in [topic.kind for topic in file.topics()]:
            raise InputError(f"has no topic of type {KIND}.", where=str(path), hint="`palpate estimate` writes one.")
    except (ValueError, OSError) as problem:
        raise InputError(f"is not a file of contacts ({problem}).", where=str(path)) from problem
    if note or not rows:
        yield noted(from_frame(pl.DataFrame(schema=schema())), note)


def _ours(messages: MessageBlock) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield the messages that hold contacts, (n, length) bytes of one topic and length, and their order, (n,)."""
    keys = [key for key, topic in messages.topics.items() if topic.kind == _KIND and topic.encoding == "cdr"]
    for key in keys:
        ours = np.flatnonzero(messages.topic == key)
        place = messages.time[ours] if len(keys) > 1 else ours  # of a robot's sensors, in turn
        start, length = messages.start[ours], messages.length[ours]
        changes = np.flatnonzero(np.diff(length)) + 1
        for places, starts, lengths in zip(*(np.split(each, changes) for each in (place, start, length)), strict=True):
            if len(starts) and (width := int(lengths[0])):
                everywhere = np.ndarray(len(messages.data) - width + 1, f"V{width}", messages.data, strides=(1,))
                yield places, everywhere[starts].view(np.uint8).reshape(-1, width)
