"""What contacts are appended to: OUTPUT.part in the making, format by format."""

from __future__ import annotations

import shutil
from importlib.metadata import version
from pathlib import Path
from typing import Protocol, runtime_checkable

import polars as pl

from palpate.contact.contacts import Contacts
from palpate.contact.table import schema, to_frame
from palpate.io.atomic import PART, WHOLE
from palpate.io.contacts.csv import header, to_csv
from palpate.io.contacts.mcap import Messages, topics
from palpate.io.contacts.mcap_write import McapWriter

__all__ = ["SINKS", "Sink"]

_SMALL = 4096  # rows up to which Parquet files grow, should blocks be small
_GROUP = 20_000  # rows of a group in the joined Parquet file: memory is a few of them
_CHUNK = 2048  # samples of a chunk of MCAP


@runtime_checkable
class Sink(Protocol):
    """A file that grows."""

    def append(self, contacts: Contacts) -> None:
        """Write rows; they are on their way to the disk when this returns."""
        ...

    def finish(self) -> None:
        """Make it a whole file of what was appended, and close it."""
        ...

    def abandon(self, *, keep: bool) -> None:
        """Close it as it is, or remove it."""
        ...


class _Appended:
    """Bytes appended all or not at all, as far as a reader of the finished file can see."""

    def __init__(self, path: Path, head: bytes) -> None:
        self._path = path
        self._file = path.open("wb", buffering=0)  # the system has each block, though the process be killed
        self.size = 0
        self.append(head)

    def append(self, raw: bytes) -> None:
        left = memoryview(raw)
        while left:
            left = left[self._file.write(left) :]
        self.size += len(raw)

    def finish(self, tail: bytes, size: int) -> None:
        """Cut what lies beyond `size`, which an interrupt left torn, and end the file."""
        self._file.seek(size)
        self._file.truncate()
        self.append(tail)
        self._file.close()

    def abandon(self, *, keep: bool) -> None:
        self._file.close()
        if not keep:
            self._path.unlink()


class _Csv:
    def __init__(self, path: Path, _: str, features: tuple[str, ...]) -> None:
        self._file = _Appended(path, header(features))

    def append(self, contacts: Contacts) -> None:
        self._file.append(to_csv(contacts))

    def finish(self) -> None:
        self._file.finish(b"", self._file.size)

    def abandon(self, *, keep: bool) -> None:
        self._file.abandon(keep=keep)


class _Mcap:
    def __init__(self, path: Path, frame_id: str, features: tuple[str, ...]) -> None:
        self._mcap = McapWriter(topics(features), f"palpate {version('palpate')}")
        self._messages = Messages(frame_id, features)
        self._file = _Appended(path, self._mcap.head)

    def append(self, contacts: Contacts) -> None:
        for start in range(0, len(contacts), _CHUNK):
            raw, chunk = self._mcap.chunk(*self._messages.of(contacts[start : start + _CHUNK]))
            self._file.append(raw)
            self._mcap.chunks.append(chunk)

    def finish(self) -> None:
        self._file.finish(self._mcap.tail(), self._mcap.size)

    def abandon(self, *, keep: bool) -> None:
        self._file.abandon(keep=keep)


class _Parquet:
    """A folder of small files, each of them whole, joined at the end: a Parquet file has its index where it ends."""

    def __init__(self, path: Path, _: str, features: tuple[str, ...]) -> None:
        self._folder = path
        self._rows = pl.DataFrame(schema=schema(features))
        self._files = 0
        path.mkdir()

    def append(self, contacts: Contacts) -> None:
        rows = pl.concat([self._rows, to_frame(contacts)])
        file = self._folder / f"{self._files:08d}.parquet"
        beside = file.with_suffix(PART)
        rows.write_parquet(beside, compression="lz4", statistics=False)
        beside.replace(file)
        full = len(rows) >= _SMALL
        self._rows, self._files = (rows.clear(), self._files + 1) if full else (rows, self._files)

    def finish(self) -> None:
        if files := sorted(self._folder.glob("*.parquet")):
            beside = self._folder / f"joined{PART}"  # only what nothing interrupted is called `WHOLE`
            pl.scan_parquet(files, glob=False).sink_parquet(
                beside, compression="zstd", compression_level=1, row_group_size=_GROUP
            )
            beside.replace(self._folder / WHOLE)
        else:
            self._rows.write_parquet(self._folder / WHOLE)

    def abandon(self, *, keep: bool) -> None:
        if not keep:
            shutil.rmtree(self._folder)


SINKS: dict[str, type[_Csv] | type[_Parquet] | type[_Mcap]] = {".csv": _Csv, ".parquet": _Parquet, ".mcap": _Mcap}
