"""Open a log with the rig of one sensor, and process its samples to contacts."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from itertools import chain
from math import inf
from os import PathLike
from pathlib import Path
from time import perf_counter
from typing import Any, cast

import numpy as np
from jaxtyping import Bool, Float

from palpate.calls import called_as
from palpate.contact.contacts import Contacts
from palpate.contact.estimate import CHI2_95, Status
from palpate.contact.estimator import ContactEstimator
from palpate.contact.frames import placed
from palpate.contact.plausibility import RequiredBounds, unbelievable, unexplained
from palpate.contact.wrench_estimator import WrenchEstimator
from palpate.errors import InputError
from palpate.files.logs import Log, LogContents, contents, join, missing
from palpate.files.logs import open_log as open_by_layout
from palpate.files.logs.arrays import DataFrame, arrays_of
from palpate.files.logs.layout import pose_path
from palpate.files.tables.stated import judged_unit
from palpate.setup.built import BuiltEstimator
from palpate.setup.load import load_rig
from palpate.setup.prefetch import LogReader, MotionAhead, PrefetchedLog, reading_in_process
from palpate.setup.rig import Rig
from palpate.setup.setup import Setup
from palpate.signals.recording import CELLS, ORIENTATION, POSITION, Recording
from palpate.surfaces._jit import compile_seconds

__all__ = ["FRAMES", "HEAD", "OpenedLog", "Pipeline", "open_log"]

FRAMES = ("surface", "sensor", "base")
HEAD = 20_000  # samples of the start of a log from which noise, rate and rest are taken
KEPT = 5_000  # samples of the log, evenly spread, from which warnings are derived
HEAD_VALUES = 3_000_000  # numbers, where a sample has many
LogLike = str | PathLike[str] | DataFrame | Mapping[str, Any] | np.ndarray
HEAD_FRAMES = 30  # images at the start of a camera's log, whatever the time


class OpenedLog:
    """A log opened with a rig: the blocks of one sensor's samples, and its start, which can be read in advance.

    Attributes:
        setup: the link and its sensors, without the start of the log.
        kind: kind of the sensor.
        path: file or folder of the log.
        seconds: time [s] spent on reading so far.
    """

    def __init__(self, source: Path | Mapping[str, np.ndarray], setup: Setup) -> None:
        self.setup, self.kind = setup, setup.kind
        layout = setup.layout()
        self._log: Log = open_by_layout(source, layout)
        self.path = self._log.path
        self._ahead = False
        self._images = layout.images is not None
        self._blocks: Iterator[Recording] | None = None
        self._first: list[Recording] = []
        self.seconds = 0.0

    @property
    def size(self) -> int:
        """Number of bytes of the log."""
        return self._log.size

    @property
    def position(self) -> int:
        """Number of bytes read so far."""
        return self._log.position

    @property
    def share(self) -> float:
        """Share (0 to 1) of the log that was read."""
        return self.position / max(self.size, 1)

    @property
    def torn(self) -> str:
        """Sentence that says where the file was cut off; "" if it is complete, or before the last block."""
        return self._log.torn

    def notes(self) -> tuple[str, ...]:
        """Return notes on what was read so far, one sentence each."""
        return self._log.notes()

    def files(self) -> dict[str, Path]:
        """Return a dict, key -> path, of the files that the setup names, with the table of "poses" of this log."""
        poses = pose_path(self.setup.orientation.file, self.path)
        return self.setup.files() | ({} if poses is None else {"poses": poses})

    def prefetching(self) -> AbstractContextManager[LogReader]:
        """Return a context that starts a process for `prefetch`, without waiting for it."""
        return reading_in_process(self.path, self.setup.layout())

    def prefetch(self, reader: LogReader, estimator: ContactEstimator, threads: int) -> None:
        """Read the blocks from the start in another process from now on, and locate contacts in threads.

        Args:
            reader: the process, of `prefetching`.
            estimator: the estimator of the log; accelerations that its sensor needs are added in the process.
            threads: number of threads.
        """
        ahead = None
        if isinstance(estimator, WrenchEstimator):
            estimator.threads, sensor = threads, cast("Any", estimator.sensor)
            if getattr(sensor, "motion", None) is not None:
                ahead = sensor.motion = MotionAhead(sensor.motion)
        self._log, self._ahead = PrefetchedLog(self._log, reader, ahead), True

    def head(self, seconds: float = 0.0) -> Recording:
        """Return the log's start as a `Recording`, and keep it for reading on.

        It has 20,000 samples (or 3,000,000 numbers), and at least `seconds` [s]; of a camera 30 images.

        Raises:
            InputError: the log cannot be read, holds no samples, or lacks something that the rig requests.
        """
        for _ in self.reading(seconds):
            pass
        if not any(map(len, self._first)):
            raise InputError("holds no samples.", where=str(self.path))
        head = join(self._first)
        head = head.picked(slice(self._enough(head, seconds)))  # however long the blocks are
        again = _recorded_again(head)
        return head.picked(~again) if again.any() else head

    def reading(self, seconds: float = 0.0) -> Iterator[Recording]:
        """Yield the blocks that `head` still lacks, as they are read and kept.

        Raises:
            InputError: the log cannot be read, or lacks something that the rig requests.
        """
        if self._blocks is None:
            self._blocks = self._timed(self._log.blocks())
        count, values = sum(map(len, self._first)), 0
        while self._short(count, values, seconds) and (block := next(self._blocks, None)) is not None:
            self._first.append(block)
            count += len(block)
            values += sum(channel.size for channel in block.channels.values())
            yield block

    def in_blocks_of(self, size: int) -> OpenedLog:
        """Return the log itself, read in blocks of `size` bytes of the file, as those of other sensors in it."""
        self._log.block_bytes = size
        return self

    def _short(self, count: int, values: int, seconds: float) -> bool:
        """Return whether less of the log was read than `head` needs."""
        if self._images:
            return count < HEAD_FRAMES
        return not (count >= HEAD or values >= HEAD_VALUES) or bool(_span(self._first) <= seconds)

    def _enough(self, head: Recording, seconds: float) -> int:
        """Return the number of samples of a `head`, which may be read further."""
        if self._images:
            return HEAD_FRAMES
        numbers = sum(channel.size for channel in head.channels.values()) // len(head)
        spans = np.fmax.accumulate(head.time) - np.fmin.accumulate(head.time) > seconds
        long = int(np.argmax(spans)) + 1 if spans.any() else len(head)
        return max(long, min(HEAD, -(-HEAD_VALUES // max(numbers, 1))))

    def prepared(self) -> BuiltEstimator:
        """Return the estimator of the sensor, with notes and warnings about it.

        Raises:
            InputError: the log cannot be read, has no samples, lacks something that the rig requests, or does not begin
                at rest although it must; the rig lacks something, a file that it names cannot be used, or a filter does
                not fit the rate.
            GeometryError: the file of the surface has no usable surface.
            NotIdentifiable: the load cells that the rig uses do not determine a wrench.
        """
        head = self.head(self.setup.estimate.tare or 1.0)
        try:
            return self.setup.with_head(head).prepared()
        except InputError as problem:
            unit, _ = judged_unit(head.time, "time")
            if unit == "s":
                raise
            step = f"A step between samples is {np.median(np.diff(head.time)):.4g} s"
            hint = f'{step}, so times look like {unit}: unit = "{unit}" in [time].'
            raise InputError(problem.what, where=problem.where or head.source, hint=hint) from problem

    def __iter__(self) -> Iterator[Recording]:
        """Yield every sample once, in blocks, from the start."""
        first, self._first = self._first, []
        blocks, self._blocks = self._blocks, None
        if self._ahead:  # the reader's process begins at the start, whatever `head` has read
            first, blocks = [], None
        yield from chain(first, self._timed(self._log.blocks()) if blocks is None else blocks)

    def __enter__(self) -> OpenedLog:
        return self

    def __exit__(self, *raised: object) -> None:
        self._first, self._blocks = [], None

    def _timed(self, blocks: Iterator[Recording]) -> Iterator[Recording]:
        while True:
            begin, before = perf_counter(), compile_seconds()
            block = next(blocks, None)
            self.seconds += perf_counter() - begin - (compile_seconds() - before)
            if block is None:
                return
            yield block


@called_as('palpate.open_log("log.csv", "rig.toml")')
def open_log(
    log: LogLike, rig: Rig | str | PathLike[str], sensor: str | None = None, topic: str | None = None
) -> OpenedLog:
    """Open a log with a rig: CSV, Parquet, NumPy, MCAP, a ROS 1 or 2 bag, or a table or arrays in memory.

    Args:
        log: the file, or a bag's folder; or a table of polars or pandas, or arrays by their names, as a file has them.
        rig: the rig, or its file.
        sensor: name of the sensor's table in the rig, if the log fits several sensors.
        topic: topic of the sensor's readings, in place of the one that the rig names.

    Raises:
        InputError: the log or the rig cannot be read, the log fits no sensor of the rig, or several and none is named,
            or a topic is named and the log has none.
    """
    source = Path(log) if isinstance(log, str | PathLike) else arrays_of(log)
    rig = rig if isinstance(rig, Rig) else load_rig(rig)
    known = sensor or len(rig.kinds) == 1
    setup = rig.resolve(rig.kind(sensor)) if known else _fitting(contents(source), rig, topic)
    if topic is not None and ((there := contents(source)).names or there.images is not None):
        what = "is a table, and has no topics." if there.names else "has no topics."
        raise InputError(what, where=str(there.path), hint="Leave --topic out.")
    name = setup.kind.name
    return OpenedLog(source, setup if topic is None else rig.with_topic(topic, name).resolve(name))


def _fitting(there: LogContents, rig: Rig, topic: str | None) -> Setup:
    """Return the setup of the sensor whose channels a log has, of the combined one first."""
    path, setup = there.path, rig.resolve()
    lacking = {kind.name: missing(there, setup.answering(kind).layout()) for kind in rig.kinds}
    fitting = [kind for kind in rig.kinds if not lacking[kind.name]]
    if rig.pokes is not None and len(fitting) > 1:  # the wrenches of pokes only serve to locate the taxels
        fitting = [kind for kind in fitting if kind.channels == (CELLS,)] or fitting
    together = [kind for kind in fitting if kind.parts and topic is None]
    if together or len(fitting) == 1:
        return setup.answering((together or fitting)[0])
    if fitting:
        names = ", ".join(kind.name for kind in fitting)
        raise InputError(f"fits several sensors of the rig: {names}.", where=str(path), hint="Name one with --sensor.")
    why = " ".join(f"[{name}]: {', '.join(what[:3])}" for name, what in lacking.items())
    raise InputError(f"fits no sensor of the rig. {why}", where=str(path))


class SeenSamples:
    """Samples of a log, evenly spread, and statistics of its contacts, from which warnings are derived."""

    def __init__(self) -> None:
        self._count, self._stride, self._kept = 0, 1, list[Recording]()
        self._statuses, self._small = np.zeros(len(Status), dtype=np.int64), 0
        self._found = list[Contacts]()

    def add(self, block: Recording, found: Contacts, size: float, *, keep: bool = True) -> None:
        """Add the next samples and their contacts on a body of `size` [m]; `keep`: samples serve for warnings too."""
        spread: Float[np.ndarray, " n"] = np.trace(found.covariance, axis1=1, axis2=2)
        self._small += int(np.count_nonzero(found.answered & ~(CHI2_95 * spread > size**2)))
        self._statuses += np.bincount(found.status, minlength=len(Status))
        if keep:
            self._keep(block, found)
        self._count += len(block)

    def _keep(self, block: Recording, found: Contacts) -> None:
        even = slice(-self._count % self._stride, None, self._stride)
        self._kept.append(block.picked(even))
        if len(found) == len(block):  # bounds are not required of samples with several contacts
            self._found.append(found[even])
        while sum(map(len, self._kept)) > 2 * KEPT:  # every second one of those kept stays
            half = slice(None, None, 2)
            self._kept = [join(self._kept).picked(half)]
            self._found = [Contacts.joined(self._found)[half]] if self._found else []
            self._stride *= 2

    def required_bounds(self, estimator: ContactEstimator) -> RequiredBounds | None:
        """Return the bounds of friction and torsion that the samples need; None without samples or bounds."""
        judge = estimator.plausibility
        return judge.required_bounds(Contacts.joined(self._found)) if judge is not None and self._count else None

    def unbelievable(self) -> str:
        """Return the sentence that no sample can be trusted; "" if some can."""
        return unbelievable(self._statuses, self._small)

    def warnings(self, estimator: ContactEstimator) -> list[str]:
        """Return warnings on units, bias, mounting and unexplained samples, one sentence each."""
        judge = estimator.plausibility
        if judge is None or not self._count:
            return []
        return [*judge.warnings(join(self._kept)), *unexplained(self._statuses, self.required_bounds(estimator))]


@dataclass
class Pipeline:
    """The processing of a log from samples to contacts, which can run once.

    Attributes:
        log: the log.
        frame: frame of the contacts: "surface", "sensor" or "base".
        estimator: the estimator.
        initial_notes, initial_warnings: those from before the first sample, one sentence each.
        settings: settings in force, name -> value.
        seconds: time [s] spent on "prepare", "compile" and "locate"; without that of reading, `log.seconds`.
    """

    log: OpenedLog
    frame: str
    estimator: ContactEstimator
    initial_notes: list[str]
    initial_warnings: list[str]
    settings: dict[str, object]
    seconds: dict[str, float] = field(default_factory=lambda: {"prepare": 0.0, "compile": 0.0, "locate": 0.0})
    _seen: SeenSamples = field(default_factory=SeenSamples)

    @classmethod
    def of(cls, log: OpenedLog, frame: str = "surface") -> Pipeline:
        """Return the pipeline of a log, prepared for its first sample.

        Raises:
            InputError: the log or a file of the rig cannot be used, the log has no samples or does not begin at rest
                although it must, the frame is unknown, or it is the base and the log has no poses.
            GeometryError: the file of the surface has no usable surface.
        """
        if frame not in FRAMES:
            raise InputError(f"there is no frame {frame!r}.", hint=f"Use one of {', '.join(FRAMES)}.")
        begin, read, before = perf_counter(), log.seconds, compile_seconds()
        head = log.head()
        if frame == "base":
            _require_pose(log, head)
        made = log.prepared()
        pipeline = cls(log, frame, made.estimator, made.notes, made.warnings, made.settings)
        compiling = pipeline.seconds["compile"] = compile_seconds() - before
        pipeline.seconds["prepare"] = perf_counter() - begin - (log.seconds - read) - compiling
        return pipeline

    def stream(
        self, watch: Callable[[Recording, np.ndarray], None] | None = None
    ) -> Iterator[tuple[Recording, Contacts, Contacts]]:
        """Yield each block with its contacts in the surface's frame and in the requested frame.

        Args:
            watch: called with each block and what the sensor shows: force [N] of each taxel, (n, k), or positions [px]
                of the markers, (n, m, 2).

        Raises:
            InputError: the log cannot be read on, or lacks a channel that the estimator needs.
        """
        located, judge = self.estimator.pairs(self.log, watch), self.estimator.plausibility
        while True:
            begin, read, before = perf_counter(), self.log.seconds, compile_seconds()
            pair = next(located, None)
            compiling = compile_seconds() - before
            self.seconds["compile"] += compiling  # the rate of the rest is that of the next run, too
            self.seconds["locate"] += perf_counter() - begin - (self.log.seconds - read) - compiling
            if pair is None:
                return
            block, found = pair
            self._seen.add(block, found, inf if judge is None else judge.size, keep=judge is not None)
            yield block, found, placed(found, block, self.frame, self.estimator.mount)

    def proposed_bounds(self) -> str:
        """Return the sentence on bounds of friction and torsion that hold 95 % of the samples so far, or ""."""
        asked = self._seen.required_bounds(self.estimator)
        return "" if asked is None else asked.proposal

    def unbelievable(self) -> str:
        """Return the sentence that no sample so far can be trusted; "" if some can."""
        return self._seen.unbelievable() or self.estimator.unbelievable

    def notes(self) -> list[str]:
        """Return notes on the log and on the estimate so far, one sentence each."""
        return list(dict.fromkeys((*self.initial_notes, *self.estimator.notes(), *self.log.notes())))

    def warnings(self) -> list[str]:
        """Return what may be wrong with the samples so far, one sentence each."""
        said = (*self.initial_warnings, *self.estimator.warnings(), *self._seen.warnings(self.estimator))
        return list(dict.fromkeys(said))


def _require_pose(log: OpenedLog, head: Recording) -> None:
    for channel in (ORIENTATION, POSITION):
        if channel not in head.channels:
            raise InputError(
                f"the base frame needs the sensor's {channel} in the base, which this log does not have.",
                where=str(log.path),
                hint="Add columns qx,qy,qz,qw and x,y,z to a table, a topic of poses or the tree of /tf to messages. "
                "Write other names in the rig's [orientation] (columns, position, topic, base and sensor).",
            )


def _recorded_again(samples: Recording) -> Bool[np.ndarray, " n"]:
    """Return the mask of samples with the time and the numbers of the one before, as of two recorders at once."""
    again = np.append(False, np.diff(samples.time) == 0.0)
    for values in samples.channels.values() if again.any() else ():
        rows = values.reshape(len(again), -1)
        again[1:] &= ((rows[1:] == rows[:-1]) | (np.isnan(rows[1:]) & np.isnan(rows[:-1]))).all(axis=1)
    return again


def _span(blocks: Iterable[Recording]) -> float:
    """Return the time [s] from the first finite time of the blocks to the last; -inf if there is none."""
    known = np.concatenate([np.empty(0), *(block.time[np.isfinite(block.time)] for block in blocks)])
    return float(np.ptp(known)) if len(known) else -inf
