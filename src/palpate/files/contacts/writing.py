"""Write files of contacts as CSV, Parquet or MCAP.

While it is being written, OUTPUT is OUTPUT.part, which can be read up to its last block at any moment.
"""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path

import polars as pl

from palpate.contact.contacts import Contacts
from palpate.contact.events import Events
from palpate.contact.origins import Origin
from palpate.contact.table import ORIGIN, schema, to_frame
from palpate.errors import InputError
from palpate.files.atomic import PART, WHOLE, growing, part, replacing, writing
from palpate.files.contacts.csv import header, to_csv
from palpate.files.contacts.mcap import ContactMessages, topics
from palpate.files.contacts.reading import contact_blocks
from palpate.files.mcap.writer import McapWriter
from palpate.processes import require_polars_threads

_SMALL = 4096  # rows up to which Parquet files grow, should blocks be small
_GROUP = 20_000  # rows of a group in the joined Parquet file: memory is a few of them
_CHUNK = 2048  # samples of a chunk of MCAP


FrameId = str | Mapping[Origin, str]
"""Name of the contacts' frame, for viewers; of a robot's, a name for the contacts of each sensor."""


def _added(frame_id: FrameId, features: tuple[str, ...]) -> tuple[str, ...]:
    return features if isinstance(frame_id, str) else (*ORIGIN, *features)


class _Appended:
    """A file to which bytes are appended; an interrupted write is cut off at the end."""

    def __init__(self, path: Path, head: bytes) -> None:
        self._path = path
        self._file = path.open("wb", buffering=0)  # unbuffered: a block survives if the process is killed
        self.size = 0
        self.write(head)

    def write(self, raw: bytes) -> None:
        left = memoryview(raw)
        while left:
            left = left[self._file.write(left) :]
        self.size += len(raw)

    def end(self, tail: bytes, size: int) -> None:
        """Cut what lies beyond `size`, the remains of an interrupted write, append `tail` and close the file."""
        self._file.seek(size)
        self._file.truncate()
        self.write(tail)
        self._file.close()

    def abandon(self, *, keep: bool) -> None:
        self._file.close()
        if not keep:
            self._path.unlink()


class _Csv(_Appended):
    def __init__(self, path: Path, frame_id: FrameId, features: tuple[str, ...]) -> None:
        super().__init__(path, header(_added(frame_id, features)))

    def append(self, contacts: Contacts) -> None:
        self.write(to_csv(contacts))

    def finish(self) -> None:
        self.end(b"", self.size)


class _Mcap(_Appended):
    def __init__(self, path: Path, frame_id: FrameId, features: tuple[str, ...]) -> None:
        origins = () if isinstance(frame_id, str) else tuple(frame_id)
        self._mcap = McapWriter(topics(features, origins), f"palpate {version('palpate')}")
        self._messages = ContactMessages(frame_id, features)
        super().__init__(path, self._mcap.head)

    def append(self, contacts: Contacts) -> None:
        for start in range(0, len(contacts), _CHUNK):
            raw, chunk = self._mcap.chunk(self._messages.of(contacts[start : start + _CHUNK]))
            self.write(raw)
            self._mcap.chunks.append(chunk)

    def finish(self) -> None:
        self.end(self._mcap.tail(), self._mcap.size)


class _Parquet:
    """A folder of small, complete files, joined at the end."""

    def __init__(self, path: Path, frame_id: FrameId, features: tuple[str, ...]) -> None:
        self._folder = path
        self._rows = pl.DataFrame(schema=schema(_added(frame_id, features)))
        self._files = 0
        path.mkdir()

    def append(self, contacts: Contacts) -> None:
        rows = pl.concat([self._rows, to_frame(contacts)])
        file = self._folder / f"{self._files:08d}.parquet"
        beside = file.with_suffix(PART)
        with _of_the_system():
            rows.write_parquet(beside, compression="lz4", statistics=False)
        beside.replace(file)
        full = len(rows) >= _SMALL
        self._rows, self._files = (rows.clear(), self._files + 1) if full else (rows, self._files)

    def finish(self) -> None:
        if files := sorted(self._folder.glob("*.parquet")):
            beside = self._folder / f"joined{PART}"  # renamed to `WHOLE` only once it is complete
            rows = pl.scan_parquet(files, glob=False)
            with _of_the_system():
                rows.sink_parquet(beside, compression="zstd", compression_level=1, row_group_size=_GROUP)
            beside.replace(self._folder / WHOLE)
        else:
            self._rows.write_parquet(self._folder / WHOLE)

    def abandon(self, *, keep: bool) -> None:
        if not keep:
            shutil.rmtree(self._folder)


@contextmanager
def _of_the_system() -> Generator[None]:
    """Raise the system's error, such as that of a full disk, which polars wraps."""
    try:
        yield
    except pl.exceptions.ComputeError as problem:
        number = re.search(r"\(os error (\d+)\)", str(problem))
        raise OSError(int(number[1]), os.strerror(int(number[1]))) if number else OSError(str(problem)) from problem


# Unfinished files to which contacts are appended: `finish` completes one, `abandon` keeps or removes it.
_Sink = _Csv | _Parquet | _Mcap
_SINKS: dict[str, type[_Sink]] = {".csv": _Csv, ".parquet": _Parquet, ".mcap": _Mcap}


class ContactsWriter:
    """A writer of contacts, block by block; each block is in the file when `write` returns.

    Attributes:
        rows: number of rows written so far.
    """

    def __init__(self, path: Path, sink: _Sink, features: tuple[str, ...]) -> None:
        self._path, self._sink, self._features = path, sink, features
        self.rows = 0

    def write(self, contacts: Contacts) -> None:
        """Append a block of contacts in the frame of the file.

        Raises:
            ValueError: the features of the block are not those of the file.
            InputError: the file cannot be written, such as on a full disk.
        """
        if tuple(contacts.features) != self._features:
            raise ValueError(f"contacts have features {tuple(contacts.features)}, but the file has {self._features}")
        if len(contacts):
            with writing(self._path):
                self._sink.append(contacts)
            self.rows += len(contacts)


def require_format(path: Path) -> None:
    """Check that an output has the suffix of a known format.

    Raises:
        InputError: it has another one.
    """
    if path.suffix.lower() not in _SINKS:
        what = f"contacts cannot be written to a file that ends in {path.suffix!r}."
        raise InputError(what, where=str(path), hint=f"Use one of {', '.join(_SINKS)}.")


@contextmanager
def open_contacts(
    path: str | Path, *, frame_id: FrameId = "surface", features: tuple[str, ...] = ()
) -> Generator[ContactsWriter]:
    """Yield a writer of contacts, block by block.

    OUTPUT.part takes the name of OUTPUT when the block ends well, or by Ctrl-C once there is a row. After another
    error, or a kill, it stays with every block that was written, but is removed if it has no row.

    Args:
        path: OUTPUT; its suffix, .csv, .parquet or .mcap, gives the format.
        frame_id: name of the contacts' frame, for viewers, which only MCAP stores; for contacts of a robot's sensors, a
            name for each `Origin`.
        features: names of the columns that the sensor adds, after the others.

    Raises:
        InputError: the suffix is unknown, or the file cannot be written.
    """
    path = Path(path)
    require_format(path)
    with growing(path) as temporary:
        with writing(path):
            sink = _SINKS[path.suffix.lower()](temporary, frame_id, features)
        writer = ContactsWriter(path, sink, features)
        try:
            yield writer
        except BaseException as problem:
            with writing(path):
                if writer.rows and isinstance(problem, KeyboardInterrupt):
                    sink.finish()
                else:
                    sink.abandon(keep=bool(writer.rows))
            raise
        with writing(path):
            sink.finish()


def write_contacts(path: str | Path, contacts: Contacts, *, frame_id: str = "surface") -> None:
    """Write all contacts to a file; the suffix, .csv, .parquet or .mcap, gives the format.

    Only MCAP stores `frame_id`, the name of their frame, for viewers.

    Raises:
        InputError: the suffix is unknown, or the file cannot be written.
    """
    origins = None if contacts.origins is None else contacts.origins.among
    frames = frame_id if origins is None else dict.fromkeys(origins, frame_id)
    with open_contacts(path, frame_id=frames, features=tuple(contacts.features)) as writer:
        writer.write(contacts)


def read_contacts(path: str | Path) -> Contacts:
    """Read all rows of a file of contacts, finished or not; numbers equal those written, to the last bit.

    Raises:
        InputError: the file cannot be read or holds no contacts, or a row in it is invalid; or the process was forked
            after polars had started its threads.
    """
    return Contacts.joined(list(contact_blocks(Path(path))))


def unfinished(path: Path) -> Path | None:
    """Return OUTPUT.part if OUTPUT does not exist, or if `path` is OUTPUT.part; None if there is no such file."""
    if path.suffix == PART:
        return path if path.exists() else None
    try:
        return part(path) if not path.exists() and part(path).exists() else None
    except (InputError, OSError, ValueError):
        return None


def write_events(path: Path, events: Events) -> None:
    """Write touches as CSV, in SI: start,end,px,py,pz,label, then other columns; labels count from 1.

    Raises:
        InputError: the file cannot be written.
    """
    require_polars_threads()
    columns = {
        "start": events.start,
        "end": events.end,
        **dict(zip(("px", "py", "pz"), events.point.T, strict=True)),
        "label": [str(k + 1) for k in range(len(events))],
        **dict(zip(("nx", "ny", "nz"), events.normal.T, strict=True)),
        **{name: getattr(events, name) for name in ("peak_force", "peak_time", "mean_force", "deviation", "slid")},
        "samples": events.samples,
        "ambiguous": events.ambiguous,
        "contact": events.identity,
        **({} if events.origins is None else {"sensor": events.sensor, "link": events.link}),
        **events.features,
    }
    with replacing(path) as temporary:
        pl.DataFrame(columns).with_columns(pl.col(pl.Float64).fill_nan(None)).write_csv(temporary)
