"""Logs of frames of a taxel sheet, read in blocks: CSV with one column a cell, NumPy, MCAP and bags."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from os import SEEK_END
from pathlib import Path
from typing import Any, Protocol, runtime_checkable
from zipfile import BadZipFile
from zlib import error as ZlibError

import numpy as np

from palpate.errors import InputError
from palpate.io.logs.bag import BagFile, open_folder
from palpate.io.logs.frame_messages import FRAMES, STAMPED, frame
from palpate.io.logs.log import Watched
from palpate.io.logs.mcap import McapFile
from palpate.io.logs.messages import Source, Topic
from palpate.io.tables.fields import Fields, Rows
from palpate.io.tables.lines import open_input, read_some
from palpate.io.tables.table import Table, tables
from palpate.io.units import TIME_UNITS, near, to_si
from palpate.sensors.skin import Frames

__all__ = ["FrameLayout", "FrameLog", "open_frames"]

BLOCK = 2048  # frames
PIECE = 1 << 21  # bytes of text
_DAMAGED = (
    OSError,
    ValueError,
    EOFError,
    KeyError,
    SyntaxError,
    MemoryError,
    NotImplementedError,
    BadZipFile,
    ZlibError,
)
_NUMPY = (b"\x93NUMPY", b"PK\x03\x04")
_MCAP, _BAG, _DB3 = b"\x89MCAP0\r\n", b"#ROSBAG V", b"SQLite format 3\0"


@dataclass(frozen=True)
class FrameLayout:
    """Where a log keeps its frames.

    Args:
        rows, columns: of the sheet.
        time, time_unit: column of the time in a table, or array in an .npz.
        cells: columns of a table, row-major; None: all but the time, in their order.
        topic: of a log with topics; None: the only one that holds frames.
        rate: [Hz] of frames that come without times (.npy).
    """

    rows: int
    columns: int
    time: str = "time"
    time_unit: str = "s"
    cells: tuple[str, ...] | None = None
    topic: str | None = None
    rate: float | None = None


@runtime_checkable
class FrameLog(Watched, Protocol):
    """What every reader of frames gives; `path` is of the file or folder."""

    @property
    def path(self) -> Path: ...  # noqa: D102 - said above

    def blocks(self) -> Iterator[Frames]:
        """Frames from the start, every one once; one that could not be read is NaN."""
        ...


def open_frames(path: Path, layout: FrameLayout) -> FrameLog:
    """Open a log of frames by what the file is.

    Raises:
        InputError: it is not there, or not what its name says.
    """
    if path.is_dir():
        return _Messages(path, layout, open_folder(path))
    with open_input(path) as file:
        first = read_some(file, path, 16) if path.is_file() else b""  # a pipe gives its first bytes once
    if first.startswith(_NUMPY):
        return _Numpy(path, layout)
    if first.startswith(_MCAP):
        return _Messages(path, layout, McapFile(path))
    if first.startswith((_BAG, _DB3)):
        return _Messages(path, layout, BagFile(path))
    if path.suffix.lower() in (".npy", ".npz", ".mcap", ".bag", ".db3"):
        raise InputError(f"does not begin as a {path.suffix.lower()} file does.", where=str(path))
    return _Text(path, layout)


class _Text:
    """A table: a row a frame."""

    def __init__(self, path: Path, layout: FrameLayout) -> None:
        self.path, self._layout = path, layout
        self.position, self.size = 0, path.stat().st_size if path.exists() else 0
        self.torn = ""
        self._rows, self._fields = Rows(), Fields()

    def blocks(self) -> Iterator[Frames]:
        self._rows, self._fields, self.torn = Rows(), Fields(), ""
        layout, time = self._layout, Fields()
        per_second = round(1 / to_si(layout.time_unit, TIME_UNITS, where="time_unit"))
        with open_input(self.path) as file:
            for table in tables(file, self.path, PIECE):
                self.position = file.tell() if file.seekable() else 0
                table.counted(self._rows)
                cells = self._cells(table)
                if len(table):
                    stamps = table.read([layout.time], time)[:, 0] / per_second
                    values = table.read(cells, self._fields).reshape(-1, layout.rows, layout.columns)
                    yield Frames(stamps, values, self.path.name)
            if self._rows.cut and file.seekable():
                file.seek(-1, SEEK_END)
                if file.read(1) not in b"\r\n":
                    self.torn = "the file is torn: its last line ends within a row"
        self._rows.require(self.path)
        time.require_numbers(self.path)

    def notes(self) -> tuple[str, ...]:
        return (*self._rows.notes(), *self._fields.notes())

    def _cells(self, table: Table) -> list[str]:
        layout = self._layout
        if layout.time not in table.names:
            raise InputError(
                f"there is no column {layout.time!r}.", where=str(self.path), mend=near(layout.time, table.names)
            )
        cells = [name for name in table.names if name != layout.time] if layout.cells is None else [*layout.cells]
        wanted = layout.rows * layout.columns
        if len(cells) != wanted:
            raise InputError(
                f"has {len(cells)} columns beside the time, but a sheet of {layout.rows} x {layout.columns} "
                f"has {wanted} cells.",
                where=str(self.path),
                mend="Put the sheet's rows and columns right in the rig's [skin], or name the cells' columns there.",
            )
        table.require(cells)
        return cells


class _Numpy:
    """An .npy of frames, or an .npz with the arrays `time` and `frames`."""

    torn = ""

    def __init__(self, path: Path, layout: FrameLayout) -> None:
        self.path, self._layout = path, layout
        self.position, self.size = 0, path.stat().st_size
        self._notes: tuple[str, ...] = ()

    def blocks(self) -> Iterator[Frames]:
        time, frames = self._arrays()
        layout = self._layout
        shape = (layout.rows, layout.columns)
        if frames.ndim == 2 and frames.shape[1] == layout.rows * layout.columns:
            frames = frames.reshape(-1, *shape)
        if frames.ndim != 3 or frames.shape[1:] != shape:
            raise InputError(
                f"holds frames of shape {frames.shape}, not n x {layout.rows} x {layout.columns}.",
                where=str(self.path),
                mend="Put the sheet's rows and columns right in the rig's [skin].",
            )
        if len(time) != len(frames):
            raise InputError(f"has {len(time)} times for {len(frames)} frames.", where=str(self.path))
        if not len(frames):
            raise InputError("holds no frames.", where=str(self.path))
        for start in range(0, len(frames), BLOCK):
            self.position = self.size * min(start + BLOCK, len(frames)) // len(frames)
            piece = slice(start, start + BLOCK)
            yield Frames(time[piece], frames[piece].astype(np.float64), self.path.name)

    def notes(self) -> tuple[str, ...]:
        return self._notes

    def _arrays(self) -> tuple[np.ndarray, np.ndarray]:
        layout = self._layout
        try:
            with open_input(self.path) as file:
                loaded: Any = np.load(file, allow_pickle=False)
                several = not isinstance(loaded, np.ndarray)
                named: dict[str, np.ndarray] = dict(loaded) if several else {"frames": loaded}
        except _DAMAGED as problem:
            raise InputError(f"is no NumPy file that can be read ({problem}).", where=str(self.path)) from problem
        if "frames" not in named:
            raise InputError("has no array 'frames'.", where=str(self.path), mend=near("frames", named))
        frames = np.asarray(named["frames"])
        if not (np.issubdtype(frames.dtype, np.integer) or np.issubdtype(frames.dtype, np.floating)):
            raise InputError(f"frames are {frames.dtype}, not numbers.", where=str(self.path))
        if layout.time in named:
            per_second = round(1 / to_si(layout.time_unit, TIME_UNITS, where="time_unit"))
            return np.asarray(named[layout.time], dtype=np.float64).reshape(-1) / per_second, frames
        if layout.rate is None:
            raise InputError(
                f"has no times ({layout.time!r}).",
                where=str(self.path),
                mend="Give the rate [Hz] of the frames in the rig's [skin], or write an .npz with time and frames.",
            )
        self._notes = (f"frames have no times: {layout.rate:g} Hz is taken, as the rig says",)
        return np.arange(len(frames)) / layout.rate, frames


class _Messages:
    """Images or arrays on a topic."""

    def __init__(self, path: Path, layout: FrameLayout, source: Source) -> None:
        self.path, self._layout, self._source = path, layout, source
        self._count = self._unread = 0
        self._unstamped = False

    @property
    def size(self) -> int:
        return self._source.size

    @property
    def position(self) -> int:
        return self._source.position

    @property
    def torn(self) -> str:
        return self._source.torn

    def blocks(self) -> Iterator[Frames]:
        topic = self._topic()
        self._count = self._unread = 0
        self._unstamped = topic.kind != STAMPED
        waiting: list[tuple[float, np.ndarray]] = []
        for messages in self._source.messages([topic.name]):
            mine, data = messages.of(topic), memoryview(messages.data)
            for time, start, length in zip(mine.time.tolist(), mine.start.tolist(), mine.length.tolist(), strict=True):
                waiting.append(self._read(data[start : start + length], topic, time))
                if len(waiting) == BLOCK:
                    yield self._block(waiting)
                    waiting = []
        if waiting:
            yield self._block(waiting)
        if not self._count:
            raise InputError(f"topic {topic.name!r} has no messages.", where=str(self.path), mend=self.torn)

    def notes(self) -> tuple[str, ...]:
        said = [*self._source.notes()]
        layout = self._layout
        if self._unread:
            said.append(
                f"{self._unread} of {self._count} frames are not {layout.rows} x {layout.columns}, or cut short"
            )
        if self._unstamped:
            said.append("frames have no stamps: the times at which they were recorded are taken")
        return tuple(said)

    def _read(self, data: memoryview, topic: Topic, time: int) -> tuple[float, np.ndarray]:
        layout = self._layout
        found = frame(data, topic.kind, topic.encoding, layout.rows, layout.columns)
        self._count += 1
        if found is None:
            self._unread += 1
            return time / 1e9, np.full((layout.rows, layout.columns), np.nan)
        stamp, cells = found
        return (stamp or time) / 1e9, cells

    def _block(self, waiting: list[tuple[float, np.ndarray]]) -> Frames:
        times, cells = zip(*waiting, strict=True)
        return Frames(np.array(times), np.stack(cells), self.path.name)

    def _topic(self) -> Topic:
        topics = self._source.topics()
        name = self._layout.topic
        fitting = [topic for topic in topics if topic.kind in FRAMES and topic.count and name in (None, topic.name)]
        if len(fitting) == 1:
            return fitting[0]
        listed = ", ".join(f"{topic.name} ({topic.kind or 'of no type'})" for topic in topics[:12])
        if fitting:
            raise InputError(
                f"{len(fitting)} topics hold frames: {', '.join(topic.name for topic in fitting)}.",
                where=str(self.path),
                mend="Name one in the rig, as topic in [skin].",
            )
        raise InputError(
            f"no topic {'' if name is None else repr(name) + ' '}holds frames; there is {listed or 'none at all'}.",
            where=str(self.path),
            mend="Frames are read from Image (one channel) and from UInt8MultiArray, UInt16MultiArray, "
            "Float32MultiArray and the like.",
        )
