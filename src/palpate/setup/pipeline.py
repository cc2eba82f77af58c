"""From a log to contacts, by a rig: what `palpate estimate` does, and Python with it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from itertools import chain
from math import inf
from os import PathLike
from pathlib import Path
from time import perf_counter
from types import TracebackType
from typing import Any, cast

import numpy as np
from jaxtyping import Float

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
from palpate.setup.built import BuiltEstimator
from palpate.setup.prefetch import LogReader, MotionAhead, PrefetchedLog, reading_in_process
from palpate.setup.rig import Rig, load_rig, with_mesh
from palpate.setup.setup import Setup
from palpate.signals.recording import CELLS, ORIENTATION, POSITION, Recording
from palpate.surfaces._jit import compile_seconds
from palpate.waiting import waiting

__all__ = ["FRAMES", "HEAD", "OpenedLog", "Pipeline", "estimate", "open_log"]

FRAMES = ("surface", "sensor", "base")
HEAD = 20_000  # samples of the start of a log from which noise, rate and rest are taken
KEPT = 5_000  # samples of the log, evenly spread, that doubts are raised from
HEAD_VALUES = 3_000_000  # numbers, where a sample has many
_LINE = 'palpate.estimate("log.csv", "rig.toml") or palpate.estimate("log.csv", mesh="probe.stl", unit="mm")'
LogLike = str | PathLike[str] | DataFrame | Mapping[str, Any] | np.ndarray
HEAD_FRAMES = 30  # of a camera, whatever the seconds


class OpenedLog:
    """A log of a rig: blocks of one of its sensors, and its start, which may be looked at before.

    Attributes:
        setup: the link and its sensors, without the start of the log.
        kind: the sensor.
        seconds: spent on reading so far.
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
        """Bytes to read in all."""
        return self._log.size

    @property
    def position(self) -> int:
        """Bytes read so far."""
        return self._log.position

    @property
    def torn(self) -> str:
        """After the last block, the sentence that says where the file was cut; "" where it is whole."""
        return self._log.torn

    def notes(self) -> tuple[str, ...]:
        """What a reader of the results should know of what was read so far."""
        return self._log.notes()

    def prefetching(self) -> AbstractContextManager[LogReader]:
        """A process that can read it from the start, for `read_ahead`; it starts meanwhile."""
        return reading_in_process(self.path, self.setup.layout())

    def prefetch(self, reader: LogReader, estimator: ContactEstimator, threads: int) -> None:
        """From now on its blocks are read by a process of its own, from the start, and located in threads: sooner.

        Args:
            reader: the process.
            estimator: of the log; accelerations that its sensor takes from poses are told there too.
            threads: that locate at a time.
        """
        motion, told = None, None
        if isinstance(estimator, WrenchEstimator):
            estimator.threads, sensor = threads, cast("Any", estimator.sensor)
            if (motion := getattr(sensor, "motion", None)) is not None:
                told = sensor.motion = MotionAhead()
        self._log, self._ahead = PrefetchedLog(self._log, reader, motion, told), True

    def head(self, seconds: float = 0.0) -> Recording:
        """The start of the log: 20,000 samples or so many seconds, if it is that long; nothing of it is lost.

        Of images some 30 frames.
        """
        if self._blocks is None:
            self._blocks = self._timed(self._log.blocks())
        count, values = sum(map(len, self._first)), 0
        while self._short(count, values, seconds):
            block = next(self._blocks, None)
            if block is None:
                break
            self._first.append(block)
            count += len(block)
            values += sum(channel.size for channel in block.channels.values())
        if not count:
            raise InputError("holds no samples.", where=str(self.path))
        return join(self._first)

    def _short(self, count: int, values: int, seconds: float) -> bool:
        """Whether what was read is less than is asked for."""
        if self._images:
            return count < HEAD_FRAMES
        return not (count >= HEAD or values >= HEAD_VALUES) or bool(_span(self._first) <= seconds)

    def prepared(self) -> BuiltEstimator:
        """Return the estimator of the sensor, with notes and warnings about it; see `Setup.prepared`."""
        return self.setup.with_head(self.head(self.setup.estimate.tare or 1.0)).prepared()

    def __iter__(self) -> Iterator[Recording]:
        """Every sample once, in blocks, from the start."""
        first, self._first = self._first, []
        blocks, self._blocks = self._blocks, None
        if self._ahead:  # it knows nothing of what was looked at before
            first, blocks = [], None
        yield from chain(first, self._timed(self._log.blocks()) if blocks is None else blocks)

    def __enter__(self) -> OpenedLog:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, raised: BaseException | None, at: TracebackType | None
    ) -> None:
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
    """Open a log as a rig says: CSV, Parquet, NumPy, MCAP, a ROS 1 or 2 bag; or a table or arrays in memory.

    Args:
        log: the file, or a bag's folder; or a table of polars or pandas, or arrays by their names, as a file has them.
        rig: or its file.
        sensor: name of the sensor's table in the rig, where there are several that the log could be of.
        topic: of the sensor's readings, in place of the one that the rig names.

    Raises:
        InputError: the log cannot be read, or has nothing for a sensor of the rig.
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
    """Return the setup of the sensor that a log is of, by its channels; of all together where it has those of all."""
    path, setup = there.path, rig.resolve()
    lacking = {kind.name: missing(there, setup.answering(kind).layout()) for kind in rig.kinds}
    fitting = [kind for kind in rig.kinds if not lacking[kind.name]]
    if rig.pokes is not None and len(fitting) > 1:  # then wrenches are there to find the taxels by
        fitting = [kind for kind in fitting if kind.channels == (CELLS,)] or fitting
    together = [kind for kind in fitting if kind.parts and topic is None]
    if together or len(fitting) == 1:
        return setup.answering((together or fitting)[0])
    if fitting:
        names = ", ".join(kind.name for kind in fitting)
        raise InputError(
            f"could be of several sensors of the rig: {names}.", where=str(path), hint="Name one: --sensor."
        )
    why = "; ".join(f"{name}: no {', '.join(what[:3])}" for name, what in lacking.items())
    raise InputError(f"has nothing for a sensor of the rig ({why}).", where=str(path))


class SeenSamples:
    """Some samples of a log, evenly spread, and how its contacts turned out: what does not fit shows in them."""

    def __init__(self) -> None:
        self._count, self._stride, self._kept = 0, 1, list[Recording]()
        self._statuses, self._small = np.zeros(len(Status), dtype=np.int64), 0
        self._found = list[Contacts]()

    def add(self, block: Recording, found: Contacts, size: float, *, keep: bool = True) -> None:
        """The next samples and their contacts, on a body of a size [m]; `keep`: doubts are raised from the samples."""
        spread: Float[np.ndarray, " n"] = np.trace(found.covariance, axis1=1, axis2=2)
        self._small += int(np.count_nonzero(found.answered & ~(CHI2_95 * spread > size**2)))
        self._statuses += np.bincount(found.status, minlength=len(Status))
        if keep:
            self._keep(block, found)
        self._count += len(block)

    def _keep(self, block: Recording, found: Contacts) -> None:
        even = slice(-self._count % self._stride, None, self._stride)
        self._kept.append(block.picked(even))
        if len(found) == len(block):  # of several contacts a sample nobody asks for bounds
            self._found.append(found[even])
        while sum(map(len, self._kept)) > 2 * KEPT:  # every second one of those kept stays
            half = slice(None, None, 2)
            self._kept = [join(self._kept).picked(half)]
            self._found = [Contacts.joined(self._found)[half]] if self._found else []
            self._stride *= 2

    def required_bounds(self, estimator: ContactEstimator) -> RequiredBounds | None:
        """Return which bounds of friction and torsion the samples ask for; None where the sensor has none."""
        judge = estimator.plausibility
        return judge.required_bounds(Contacts.joined(self._found)) if judge is not None and self._count else None

    def unbelievable(self) -> str:
        """The sentence to end with when not one sample can be believed, else empty."""
        return unbelievable(self._statuses, self._small)

    def warnings(self, estimator: ContactEstimator) -> list[str]:
        """Units, bias, mounting: what a wrench says of them, and how many samples no contact explains."""
        said = unexplained(self._statuses, self.required_bounds(estimator))
        judge = estimator.plausibility
        return said if judge is None or not self._count else [*judge.warnings(join(self._kept)), *said]


@dataclass
class Pipeline:
    """A log on its way to contacts, once.

    Attributes:
        log, frame, estimator: what it is made of.
        initial_notes, initial_warnings: on what was done before the first sample, one sentence each.
        settings: settings in force.
        seconds: spent on preparing, on compiling what was not compiled before, and on locating; the log knows those of
            reading.
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
        """Prepare everything that the samples of a log go through.

        Raises:
            InputError: a file of the rig cannot be used, the log does not begin at rest where it should, or the base
                frame is asked for and the log has no poses.
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
        """Blocks of the log with their contacts, in the surface's frame and in the one asked for.

        Args:
            watch: is given each block with what the sensor shows beside contacts; see `ContactEstimator.pairs`.
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
        """Which bounds of friction and torsion would hold 95 % of the samples so far, or ""."""
        asked = self._seen.required_bounds(self.estimator)
        return "" if asked is None else asked.proposal

    def unbelievable(self) -> str:
        """After the last block: the sentence to end with when not one sample can be believed, or ""."""
        return self._seen.unbelievable()

    def notes(self) -> list[str]:
        """What was met on the way, so far."""
        return list(dict.fromkeys((*self.initial_notes, *self.estimator.notes(), *self.log.notes())))

    def warnings(self) -> list[str]:
        """What may be wrong, by what was seen so far."""
        return list(
            dict.fromkeys((*self.initial_warnings, *self.estimator.warnings(), *self._seen.warnings(self.estimator)))
        )


@called_as(
    _LINE,
    rate='palpate.estimate({"time": np.arange(len(wrenches)) / rate, "force": wrenches[:, :3], '
    '"torque": wrenches[:, 3:]}, "rig.toml")',
    start='contacts = palpate.estimate("log.csv", "rig.toml"), then contacts[contacts.time >= start]',
    end='contacts = palpate.estimate("log.csv", "rig.toml"), then contacts[contacts.time < end]',
    surface="palpate.WrenchEstimator(surface, palpate.ForceTorque(noise=(0.02, 0.001))).run("
    'palpate.Recording(time, {"force": force, "torque": torque})), or a rig with [surface] kind = "ellipsoid"',
    payload='a rig with [force_torque] payload = "payload.toml", then palpate.estimate("log.csv", "rig.toml")',
    output='palpate.estimate("log.csv", "rig.toml").save("contacts.csv")',
)
def estimate(
    log: LogLike,
    rig: Rig | str | PathLike[str] | None = None,
    *,
    mesh: str | PathLike[str] | None = None,
    unit: str | None = None,
    frame: str = "surface",
    sensor: str | None = None,
    topic: str | None = None,
) -> Contacts:
    """Return every contact in a log: exactly what `palpate estimate` writes.

    Args:
        log: the file, or a bag's folder; or a table of polars or pandas, or arrays by their names, as a file has them.
        rig: or its file. None: the mesh is in the frame of a tared six-axis sensor.
        mesh: file of the surface, in place of the rig's.
        unit: of the mesh file's numbers: m, cm, mm, um or in.
        frame: of the result: "surface", "sensor" or "base".
        sensor: name of the sensor's table in the rig, where there are several that the log could be of.
        topic: of the sensor's readings, in place of the one that the rig names.

    Returns:
        At least one row a sample; what a reader should know, doubts first, is in `notes`.

    Raises:
        InputError: the log, the mesh or a file of the rig cannot be used, or there is neither a rig nor a mesh.
    """
    known = rig if isinstance(rig, Rig) or rig is None else load_rig(rig)
    known = known if mesh is None else with_mesh(known, mesh, unit)
    if known is None:
        raise InputError("nothing says what is touched.", hint=f"Write {_LINE}.")
    if mesh is None and unit is not None:
        raise InputError("unit is of a mesh, and none is given.", hint='Write mesh="probe.stl", unit="mm".')
    name = log if isinstance(log, str | PathLike) else "the log"
    with waiting(f"finding the contacts in {name}"), open_log(log, known, sensor, topic) as opened:
        pipeline = Pipeline.of(opened, frame)
        found = Contacts.joined([contacts for _, _, contacts in pipeline.stream()])
        first = [said for said in (opened.torn, pipeline.unbelievable()) if said]
        return found.noted((*first, *pipeline.warnings(), *pipeline.notes()))


def _require_pose(log: OpenedLog, head: Recording) -> None:
    for channel in (ORIENTATION, POSITION):
        if channel not in head.channels:
            raise InputError(
                f"the base frame needs the sensor's {channel} in the base, which this log does not have.",
                where=str(log.path),
                hint="A table needs columns qx,qy,qz,qw and x,y,z, messages a topic of poses or the tree of /tf; other "
                "names stand in the rig's [orientation] (columns, position, topic, base and sensor).",
            )


def _span(blocks: Iterable[Recording]) -> float:
    """Seconds from the first time to the last."""
    times = [block.time[np.isfinite(block.time)] for block in blocks]
    known = [time for time in times if len(time)]
    return max(time.max() for time in known) - min(time.min() for time in known) if known else -np.inf
