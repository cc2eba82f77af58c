"""Read a Parquet log in pieces."""

from __future__ import annotations

import atexit
import json
import os
import subprocess
import sys
from collections.abc import Generator, Iterator
from contextlib import contextmanager, suppress
from functools import lru_cache, reduce
from math import prod
from pathlib import Path
from threading import Lock

import numpy as np
import polars as pl
from jaxtyping import Float

from palpate.errors import InputError
from palpate.files.inputs import open_input
from palpate.files.logs.columns import ColumnLog, Columns
from palpate.files.logs.log import LogContents
from palpate.files.logs.samples import NUMBERS, rows_at_once
from palpate.files.tables.stated import Stated
from palpate.processes import require_polars_threads
from palpate.signals.recording import Recording

PIECE = 1 << 17  # rows: each piece reads the file's own group of rows again, so few
EPISODE = "episode_index"  # column of LeRobot's data sets
_PANIC = 3  # exit code
_PROBE = f"""
import json, select, sys
import polars
while select.select([sys.stdin], [], [], 10.0)[0] and (line := sys.stdin.readline()):
    try:
        rows = polars.scan_parquet(json.loads(line), glob=False)
        rows.select(polars.exclude(polars.Binary, polars.Struct)).sink_ipc("/dev/null")
    except polars.exceptions.PanicException:
        sys.exit({_PANIC})
    except Exception:
        pass  # an error that the caller meets, too
    print(flush=True)
"""
_PROBING = Lock()


class ParquetLog(ColumnLog):
    """A log in a Parquet file."""

    def contents(self) -> LogContents:
        """Return the names of the columns and the units in them.

        Raises:
            InputError: the file does not exist or is damaged.
        """
        with reading_parquet(self.path):
            shapes = sample_shapes(scan_rows(self.path, self._layout.episode))
            return LogContents(self.path, shapes, stated=Stated.of_names(shapes))

    def blocks(self) -> Iterator[Recording]:
        """Yield the rows as recordings in SI.

        Raises:
            InputError: the file does not exist, is damaged or has no rows; a column is not numbers or dates; or the
                layout does not fit.
        """
        with reading_parquet(self.path):
            yield from self._blocks()

    def _blocks(self) -> Iterator[Recording]:
        frame = scan_rows(self.path, self._layout.episode)
        kinds, shapes = frame.collect_schema(), sample_shapes(frame)
        if EPISODE in shapes and (count := int(frame.select(pl.col(EPISODE).n_unique()).collect().item())) > 1:
            what = f"holds {count} episodes, whose times begin again."
            hint = "Write episode = 0 in the rig's [time], or give the data set's folder to `palpate batch`."
            raise InputError(what, where=str(self.path), hint=hint)
        self._columns = columns = Columns(self._layout, self.path, shapes, poses=self.pose_log)
        arrays = list(dict.fromkeys(columns.places[name][0] for name in columns.names))
        for name in arrays:
            kind = kinds[name]
            if not (shapes[name] or kind.is_numeric() or kind == pl.Null or isinstance(kind, pl.Datetime)):
                raise InputError(f"column {name!r} holds {kind}, not numbers.", where=str(self.path))
        dates = {name for name in arrays if isinstance(kinds[name], pl.Datetime)}
        wanted = frame.select(_number(name, shapes[name], date=name in dates) for name in arrays)
        total = int(frame.select(pl.len()).collect().item())
        piece = rows_at_once(PIECE, len(columns.names), 4 * NUMBERS)
        for done in range(0, total, piece):
            rows = wanted.slice(done, piece).collect()
            read = {name: _numbers(rows[name], shapes[name]) for name in arrays}
            yield from self._cut(columns, read, done, total)
        yield from columns.finish()
        if not total:
            raise InputError("has columns, but no rows.", where=str(self.path))


@contextmanager
def reading_parquet(path: Path) -> Generator[None]:
    """Raise what goes wrong in the block, which reads a Parquet file, as an InputError.

    Raises:
        InputError: the file does not exist or is damaged, or the process was forked after polars had started its
            threads.
    """
    require_polars_threads()
    require_pages(path)
    try:
        yield
    except (pl.exceptions.PolarsError, pl.exceptions.PanicException, OSError) as problem:
        raise _refusal(path, str(problem).splitlines()[0]) from problem


def require_pages(path: Path) -> None:
    """Check in another process that polars can decode a Parquet file, as damaged pages abort it without an error.

    A file is checked once, as long as it does not change, in the time that it takes to read it. The process is kept for
    the next file, for up to 10 s.

    Raises:
        InputError: the file does not exist, or its pages are damaged.
    """
    with open_input(path) as file:
        seen = os.fstat(file.fileno())
    if not _decodable(str(path.absolute()), seen.st_mtime_ns, seen.st_size):
        raise _refusal(path, "its pages are damaged")


@lru_cache(maxsize=1 << 12)
def _decodable(path: str, *_: int) -> bool:
    if not sys.executable:  # Python in another program
        return True
    with _PROBING:
        ended = _probed(path)
        if ended not in (None, _PANIC):  # or it had waited for long, or was killed, before it read the file
            ended = _probed(path)
    return ended is None or 0 <= ended != _PANIC


def _probed(path: str) -> int | None:
    """Return None if the other process has read a file, its exit code if it ended before."""
    process, answered = _prober(os.getpid()), b""
    assert process.stdin
    assert process.stdout
    try:
        with suppress(BrokenPipeError):
            process.stdin.write(f"{json.dumps(path)}\n".encode())
        answered = process.stdout.readline()
    except BaseException:  # such as Ctrl-C: the answer must not be taken for that to the next file
        process.kill()
        raise
    finally:
        if not answered:
            _prober.cache_clear()
            process.communicate()
    return None if answered else process.returncode


@lru_cache(maxsize=1)
def _prober(_: int) -> subprocess.Popen[bytes]:
    """Start the other process of a process; a forked one has its own. It hears no Ctrl-C."""
    pipe, call = subprocess.PIPE, [sys.executable, "-P", "-c", _PROBE]
    made = subprocess.Popen(call, bufsize=0, stdin=pipe, stdout=pipe, stderr=subprocess.DEVNULL, start_new_session=True)
    atexit.register(made.__exit__, None, None, None)  # closes its input, which ends it
    return made


def _refusal(path: Path, why: str) -> InputError:
    hint = "Copy it again: a damaged Parquet file cannot be repaired, and one that was cut lost the index at its end."
    return InputError(f"cannot be read as Parquet ({why}).", where=str(path), hint=hint)


def scan_rows(path: Path, episode: int | None = None) -> pl.LazyFrame:
    """Return the rows of a Parquet file, or of one episode in it, with extension types as the lists that they are.

    Raises:
        InputError: an episode is named, and the file has no column of episodes.
    """
    frame = pl.scan_parquet(path, glob=False)
    kinds = frame.collect_schema()
    extended = [name for name, kind in kinds.items() if hasattr(kind, "ext_storage")]  # such as Array2D of `datasets`
    frame = frame.with_columns(pl.col(extended).ext.storage()) if extended else frame
    if episode is None:
        return frame
    if EPISODE not in kinds:
        hint = "Remove episode from the rig's [time]."
        raise InputError(f"has no column {EPISODE!r}.", where=str(path), hint=hint)
    return frame.filter(pl.col(EPISODE) == episode)


def sample_shapes(frame: pl.LazyFrame) -> dict[str, tuple[int, ...]]:
    """Return column -> (), or the shape of its first list of numbers."""
    kinds = frame.collect_schema()
    lists = [name for name, kind in kinds.items() if isinstance(kind, (pl.List, pl.Array))]
    first = frame.select(lists).head(1).collect() if lists else pl.DataFrame()
    found = {name: np.array(first[name].to_list()[0]) for name in lists if len(first)}
    shapes = {name: values.shape for name, values in found.items() if values.dtype.kind in "iuf" and values.size}
    return {name: shapes.get(name, ()) for name in kinds.names()}


def _number(name: str, shape: tuple[int, ...], *, date: bool) -> pl.Expr:
    """Return the numbers of a column; of lists, however nested, one list of numbers in each row."""
    if date:
        return (pl.col(name).dt.epoch("ns").cast(pl.Float64) / 1e9).fill_null(np.nan)
    column = pl.col(name).cast(reduce(lambda inner, _: pl.List(inner), shape, pl.Float64()))
    for _ in shape[1:]:
        column = column.list.eval(pl.element().explode())
    return column if shape else column.fill_null(np.nan)


def _numbers(column: pl.Series, shape: tuple[int, ...]) -> Float[np.ndarray, "n k"]:
    """Return numbers (n, 1), or lists (n, k), NaN where a row has another count."""
    if not shape:
        return column.to_numpy()[:, None]
    whole = (column.list.len() == prod(shape)).fill_null(value=False)
    values = np.full((len(column), prod(shape)), np.nan)
    values[whole.to_numpy()] = column.filter(whole).explode().fill_null(np.nan).to_numpy().reshape(-1, prod(shape))
    return values
