"""Run a source and the estimator of a rig in one process: samples in, rows of contacts out."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from concurrent.futures import wait as wait_for
from dataclasses import replace
from math import prod
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from palpate.calls import called_as
from palpate.contact.estimate import ROW, Status
from palpate.contact.estimator import run_fitting
from palpate.contact.wrench_estimator import WrenchEstimator
from palpate.errors import InputError
from palpate.files.logs.decoding import seconds
from palpate.files.logs.samples import SampleReader
from palpate.files.logs.topics import LIVE_BOTH
from palpate.live.imu_source import ImuSource
from palpate.live.losses import LossCount
from palpate.live.replay import Replay
from palpate.live.ros_poses import RosPoses
from palpate.live.source import BATCH, Batch, Source, drained, source_of
from palpate.live.stream_buffer import SlotForm, StreamBuffer
from palpate.live.stuck_watch import StuckWatch
from palpate.setup.built import BuiltEstimator
from palpate.setup.load import load_rig
from palpate.setup.rig import Rig
from palpate.setup.setup import Setup
from palpate.setup.tables import RigFilter
from palpate.signals.recent_motion import RecentMotion
from palpate.signals.recording import (
    ACCELERATION,
    FORCE,
    ORIENTATION,
    POSITION,
    TORQUE,
    UNSTEADY,
    Recording,
    split_channels,
)
from palpate.signals.wrench_sensor import MovedSensor
from palpate.spatial.arguments import frozen_value, unchecked

NUMBERS = 1 << 22  # of a batch
JUMP = 50_000_000  # ns of change between the system's clock and the monotonic one, which counts as a jump
TILT = 9.81 / 3**0.5  # m/s^2 along each axis, for a radian by which the direction of gravity is off
PAUSE = 0.005  # s
AGAIN = 10.0  # s between sentences on starts that cannot be used
TARE = 1.0  # s of a tare if the rig states none
UNMOVED = (
    "no acceleration is known: while the sensor speeds up or brakes, covariances are widened by the payload's inertia; "
    "name the topic of an IMU in [acceleration], or write from_poses = true there"
)


@frozen_value(eq=True)
class AnsweredSamples:
    """Samples with their contacts, in order; iteration gives (time [s], row).

    Attributes:
        stamp: (n,) [ns] since 1970.
        counts: (n,) number of rows of each sample.
        rows: (m, width) contacts of all samples, with the columns of `open_live`.
    """

    stamp: Int[np.ndarray, " n"]
    counts: Int[np.ndarray, " n"]
    rows: Float[np.ndarray, "m width"]

    def __iter__(self) -> Iterator[tuple[float, Float[np.ndarray, " width"]]]:
        """Yield (time [s], row) of each contact; a sample without a contact has one row."""
        return zip(np.repeat(seconds(self.stamp), self.counts).tolist(), self.rows, strict=True)


_Answers = tuple[np.ndarray, np.ndarray, np.ndarray]  # stamps, numbers of rows and rows, as of `AnsweredSamples`


class _Samples(NamedTuple):
    """Samples as arrays for an estimator, which the next batch overwrites, but for the readings."""

    stamp: Int[np.ndarray, " n"]
    time: Float[np.ndarray, " n"]
    readings: np.ndarray
    extra_channels: Mapping[str, np.ndarray]

    def picked(self, part: slice) -> _Samples:
        channels = {name: values[part] for name, values in self.extra_channels.items()}
        return _Samples(self.stamp[part], self.time[part], self.readings[part], channels)

    def copied(self) -> _Samples:
        channels = {name: values.copy() for name, values in self.extra_channels.items()}
        return self._replace(stamp=self.stamp.copy(), time=self.time.copy(), extra_channels=channels)

    def recording(self, names: tuple[str, ...], frame: str) -> Recording:
        channels = {**split_channels(names, self.readings), **self.extra_channels}
        return Recording(self.time, channels, frame=frame, source="the stream")


class _Window:
    """Samples, collected until they span `length` [s]."""

    def __init__(self, length: float) -> None:
        self.length, self.held = length, list[_Samples]()

    def add(self, samples: _Samples) -> bool:
        """Add a copy of samples, and return whether the window is full."""
        self.held.append(samples.copied())
        return bool(self.held[-1].stamp[-1] - self.held[0].stamp[0] >= 1e9 * self.length)

    def joined(self) -> _Samples:
        first = self.held[0]
        beside = {
            name: np.concatenate([each.extra_channels[name] for each in self.held]) for name in first.extra_channels
        }
        stamp = np.concatenate([each.stamp for each in self.held])
        return _Samples(stamp, seconds(stamp), np.concatenate([each.readings for each in self.held]), beside)


class Live:
    """Live contacts of a device, estimated in this process; see `open_live`.

    Values that the rig takes from the start of a stream (a tare, the noise, cells at rest) come from its first seconds,
    whose samples are answered afterwards, as in a log. A start that cannot be used, because it is not at rest, is
    reported and taken again; its samples are INVALID.

    Args:
        rig: a rig with a [source], or its file.
        sensor: name of the sensor's table, if there are several.
        source: source that replaces the rig's.

    Attributes:
        kind: the sensor.
        setup: the rig's values for it.
        source: the source, which the context opens and closes.
        estimator: the estimator; another one once the start is known.

    Raises:
        InputError: the rig cannot be used, or its source lacks something, such as an orientation.
    """

    def __init__(self, rig: Rig | str | Path, sensor: str | None = None, source: Source | None = None) -> None:
        from palpate.live import _stream  # compiled: loaded when first needed

        rig = rig if isinstance(rig, Rig) else load_rig(rig, sensor)
        self.kind = rig.kind(sensor)
        self.setup = rig.resolve(self.kind)
        self._where = "[source]" if rig.source is None else f"[source] {rig.source.kind}"
        self.source = source_of(rig.stream(), self.setup) if source is None else source
        self._poses = None if self.source.poses else RosPoses.of(rig.orientation, rig.source, self.setup.link.folder)
        given = isinstance(self.source, ImuSource) or (isinstance(self.source, Replay) and self.source.felt)
        self._felt = given and rig.acceleration.recorded
        self._posed = self.source.poses or self._poses is not None
        layout = self.setup.layout()
        layout.require_live()
        self._samples, self._frame = SampleReader(layout, Path("the stream")), layout.frame
        limits = None if layout.wrench_range is None else self._samples.recorded(layout.wrench_range)
        self._stuck = StuckWatch(limits) if self.kind.channels == (FORCE, TORQUE) else None
        self.estimator = _unseen(self.setup).prepared().estimator  # what is slow, before samples come
        size = max(1, min(BATCH, NUMBERS // prod(self.source.shape)))
        self._batch, self._unsteady = Batch(self.source.shape, size, self.source.dtype), np.zeros(size)
        self._rows = self.estimator.empty(max(self.estimator.most, min(size * self.estimator.most, 4 * BATCH)))
        self._top = self._rows[: self.estimator.most]
        self._require_enough()
        length = self.setup.start()
        self._start = _Window(length) if length else None
        self._build: Future[BuiltEstimator] | None = None
        self._maker = ThreadPoolExecutor(1, thread_name_prefix="start")
        self._tare: _Window | None = None
        self._ring: StreamBuffer | None = None
        self._losses: LossCount | None = None
        self._seconds, self._readings = _stream.seconds.unchecked, unchecked(self._samples.readings)
        self._one = self._views(1)
        self._seconds(self._one.stamp, self._one.time)  # compiles
        self._said: list[str] = []
        self._motion: RecentMotion | None = None
        payload = getattr(getattr(self.estimator, "sensor", None), "payload", None)
        if self._posed and not self._felt and payload is not None and payload.weight.any():
            stated = self.setup.acceleration
            self._motion = RecentMotion(payload.center_of_mass, stated.window, answers=stated.from_poses)
            self._said += [] if stated.from_poses else [UNMOVED]
        self._clock, self._quiet, self._fits = _offset(), 0.0, False

    def form(self, rig: str = "") -> SlotForm:
        """Return the description of samples and contacts for a ring of this stream.

        Args:
            rig: file of the rig, noted in the description.
        """
        estimator, source, layout = self.estimator, self.source, self.setup.layout()
        channels = layout.images or next(iter(layout.arrays), None)
        topic = layout.wrench_topic if channels is None else LIVE_BOTH if self.kind.parts else channels.topic
        return SlotForm(
            sensor=self.kind.name,
            shape=tuple(source.shape),
            images=np.dtype(source.dtype) == np.uint8,
            features=tuple(estimator.features),
            width=int(estimator.empty(1).shape[1]),
            max_contacts=int(estimator.most),
            rig=rig,
            poses=self._posed or self._felt,
            topic=topic or "",
            wrenches=self.kind.channels == (FORCE, TORQUE),
        )

    def into(self, ring: StreamBuffer) -> None:
        """Store samples in a ring as they are received, and contacts as they are known, from now on."""
        if (most := max(1, ring.safe // 2)) < len(self._batch):  # or one batch would lap its readers
            self._batch = Batch(self.source.shape, most, self.source.dtype)
            self._one = self._views(1)
        ring.take_in(self._batch, 0, self._unsteady)  # of nothing: compiles, before samples come
        ring.answer(self._rows[:0], np.zeros(0, dtype=np.int64))
        self._ring, self._losses = ring, LossCount(ring, self.source)

    @property
    def patient(self) -> bool:
        """True if samples wait until they are received, as those of a log replayed at speed 0."""
        return isinstance(self.source, Replay) and self.source.patient

    @property
    def ended(self) -> bool:
        """True once no more samples come, because a replayed log is at its end."""
        return isinstance(self.source, Replay) and self.source.ended

    def __enter__(self) -> Live:
        if self._poses is not None:
            self._poses.open()
        self.source.open()
        return self

    def __exit__(self, *_: object) -> None:
        self.source.close()
        if self._poses is not None:
            self._poses.close()
        self._maker.shutdown(wait=False, cancel_futures=True)

    def __iter__(self) -> Iterator[tuple[float, Float[np.ndarray, " width"]]]:
        """Yield (time [s], row) of each contact until a replayed log ends; a sample without a contact has one row.

        Raises:
            InputError: the estimator needs a value that the source does not give, or a replayed log cannot be read.
            OSError: the device cannot be read.
        """
        while not self.ended:
            yield from self.step()
        yield from self.finish()

    def events(self) -> list[str]:
        """Return the events since the last call, one sentence each."""
        return drained(self._said)

    def tare(self) -> None:
        """Take a tare over the next second, or the time that the rig states; `events` reports its success.

        Without effect while values are taken from the start, or another tare is running.
        """
        if self._start is None and self._tare is None:
            self._tare = _Window(self.setup.estimate.tare or TARE)

    def step(self, timeout: float = 0.1) -> AnsweredSamples:
        """Return waiting samples with their contacts; none if no sample comes within `timeout` [s].

        While the first seconds are collected, there are none; then all their samples are returned at once.

        Raises:
            InputError: the estimator needs a value that the source does not give, or a replayed log cannot be read.
            OSError: the device cannot be read.
        """
        return AnsweredSamples(*(each.copy() for each in self.pass_on(timeout)))

    def pass_on(self, timeout: float = 0.1) -> _Answers:
        """Take a step as `step` does, and return the same arrays without a copy, which the next call overwrites."""
        count = 0 if self._held_back(timeout) else self.source.receive(self._batch, timeout)
        self._watch()
        samples = self._taken(count) if count else None
        if self._start is not None:
            return self._started(self._start, samples)
        if samples is None:
            return self._none
        answers = self._answered(samples)
        if self._tare is not None:
            self._tared(self._tare, samples)
        return answers

    def _held_back(self, timeout: float) -> bool:
        """Return whether samples must wait, or the recorder would lose some."""
        ring = self._ring
        if ring is None or not (self.patient and ring["recording"]):
            return False
        unrecorded = ring["received"] - ring["recorded"]
        behind = unrecorded > 0 and unrecorded + len(self._batch) > ring.safe
        if behind:
            time.sleep(min(PAUSE, timeout))
        return behind

    @property
    def _none(self) -> _Answers:
        return self._batch.stamp[:0], self._batch.stamp[:0], self._rows[:0]

    def _require_enough(self) -> None:
        """Raise InputError if the estimator needs an orientation or an IMU and gets none."""
        if isinstance(self.estimator, WrenchEstimator):
            given = {ORIENTATION: np.full((1, 4), np.nan)} if self._posed else {}
            given |= {ACCELERATION: np.full((1, 3), np.nan)} if self._felt else {}
            nothing = self._samples.readings(np.zeros((1, *self.source.shape), self.source.dtype))
            try:
                self.estimator.run_into(np.zeros(1), nothing, self._rows, np.zeros(1, dtype=np.int64), given)
            except InputError as problem:
                hint = (
                    "This source sends wrenches alone: name a topic of ROS 2 for what is missing, of poses in "
                    "[orientation] or of the IMU in [acceleration], or remove the payload."
                )
                raise InputError(problem.what, where=self._where, hint=hint) from problem
            self.estimator.reset()

    def _views(self, count: int) -> _Samples:
        """Return views of the batch's first samples, with room for their times [s]."""
        batch, extra = self._batch, dict[str, np.ndarray]()
        if self._posed:
            extra = {ORIENTATION: batch.orientation[:count], POSITION: batch.position[:count]}
            extra[UNSTEADY] = self._unsteady[:count, None]
        return _Samples(batch.stamp[:count], np.empty(count), batch.values[:count], extra)

    def _taken(self, count: int) -> _Samples:
        """Return the batch's first samples, in the estimator's units; store them in the ring."""
        batch, unsteady = self._batch, self._unsteady
        views = self._one if count == 1 else self._views(count)  # one, as a rule
        stamp, time, values, extra = views
        if self._poses is not None:
            self._poses.at(stamp).into(batch)
        if self._posed:
            unsteady[:count] = TILT * batch.turned[:count]
        if self._felt:
            extra = {**extra, ACCELERATION: self._samples.acceleration * batch.acceleration[:count]}
        if self._ring is not None and self._losses is not None:
            self._ring.take_in(batch, count, unsteady)
            if event := self._losses.add(count, int(batch.lost[0])):
                self._said.append(event)
        self._seconds(stamp, time)
        readings = self._readings(values)
        if self._stuck is not None:
            if event := self._stuck.add(time, values):
                self._said.append(event)
            if self._stuck.stuck:
                readings[:] = np.nan
        return _Samples(stamp, time, readings, extra)

    def _answered(self, samples: _Samples) -> _Answers:
        """Return samples with their contacts; store these in the ring."""
        rest, most, parts = self._moved(self._followed(samples)), len(self._batch), list[_Answers]()
        while total := len(rest.stamp):
            piece = rest if total <= most else rest.picked(slice(most))
            counts = np.zeros(len(piece.stamp), dtype=np.int64)
            extra = piece.extra_channels
            if len(counts) == 1 and self._fits:  # as a rule: to check arrays again would take a tenth of a step
                step = run_fitting(self.estimator, piece.time, piece.readings, extra, self._top, counts)
            else:
                step = self.estimator.run_into(piece.time, piece.readings, self._rows, counts, extra)
                self._fits |= len(counts) == 1
            rows = self._rows[: sum(counts[:step].tolist())]  # quicker than NumPy's, for most batches hold one sample
            if self._ring is not None:
                self._ring.answer(rows, counts[:step])
            if step == total and not parts:
                return samples.stamp, counts, rows
            parts.append((piece.stamp[:step], counts[:step], rows.copy()))
            rest = rest.picked(slice(step, None))
        stamp, counts, rows = map(np.concatenate, zip(*parts, strict=True))
        return stamp, counts, rows

    def _followed(self, samples: _Samples) -> _Samples:
        """Return samples with accelerations from their poses, where no sensor measures them."""
        if self._motion is None:
            return samples
        known = samples.extra_channels
        acceleration, unsteady = self._motion.at(samples.time, known[ORIENTATION], known[POSITION], known[UNSTEADY])
        return samples._replace(extra_channels={**known, ACCELERATION: acceleration, UNSTEADY: unsteady})

    def _moved(self, samples: _Samples) -> _Samples:
        """Return samples with the accelerations that the estimator's sensor takes."""
        if not self._felt:
            return samples
        sensor = getattr(self.estimator, "sensor", None)
        moved = isinstance(sensor, MovedSensor)
        return samples._replace(extra_channels=sensor.moved(samples.extra_channels)) if moved else samples

    def _started(self, start: _Window, samples: _Samples | None) -> _Answers:
        """Collect samples of the start; return them, answered, once its values are known."""
        enough = samples is not None and start.add(samples)
        if self._build is None:
            if enough:
                self._build = self._prepared(start)
            if self._build is None or not self.patient:
                return self._none
            wait_for([self._build])  # or half a log were received meanwhile
        return self._built(start, self._build) if self._build.done() else self._none

    def finish(self) -> AnsweredSamples:
        """Return the samples of a start that still wait, with their contacts, after the last sample.

        Raises:
            InputError: the estimator needs a value that the source does not give.
        """
        start, build = self._start, self._build
        if start is None or not start.held:
            return AnsweredSamples(*self._none)
        return AnsweredSamples(*self._built(start, self._prepared(start) if build is None else build))

    def _prepared(self, start: _Window) -> Future[BuiltEstimator]:
        """Begin to build the estimator from the first seconds, in a thread."""
        seen = start.joined()
        setup, span = self.setup, 1e-9 * float(seen.stamp[-1] - seen.stamp[0])
        if setup.filter.rate is None and span > 0:  # stamps on arrival come in bursts: the steps between say little
            setup = replace(setup, filter=replace(setup.filter, rate=(len(seen.stamp) - 1) / span))
        return self._maker.submit(setup.with_head(seen.recording(self.estimator.channels, self._frame)).prepared)

    def _built(self, start: _Window, build: Future[BuiltEstimator]) -> _Answers:
        """Return the answered samples of the start, INVALID if it cannot be used."""
        self._build = None
        try:
            made = build.result()
        except InputError as problem:
            if time.monotonic() > self._quiet:
                self._said.append(f"contacts are invalid, and the start is tried again: {problem}")
                self._quiet = time.monotonic() + AGAIN
            self._start = _Window(start.length)
            return self._refused(start.joined())
        self._said += [*made.warnings, *made.notes]
        self.estimator, self._start, self._fits = made.estimator, None, False
        return self._answered(start.joined())

    def _refused(self, samples: _Samples) -> _Answers:
        """Return samples with one INVALID row each, and store these in the ring."""
        count = len(samples.stamp)
        rows, counts = self.estimator.empty(count), np.ones(count, dtype=np.int64)
        rows[:] = np.nan
        rows[:, ROW.candidates], rows[:, ROW.status] = 0.0, Status.INVALID
        if self._ring is not None:
            for start in range(0, count, BATCH):
                self._ring.answer(rows[start : start + BATCH], counts[start : start + BATCH])
        return samples.stamp, counts, rows

    def _tared(self, tare: _Window, samples: _Samples) -> None:
        if not tare.add(samples):
            return
        window, self._tare = self._moved(tare.joined()), None
        try:
            taken = self.estimator.tare(window.recording(self.estimator.channels, self._frame))
        except InputError as problem:
            self._said.append(f"the tare failed, and the previous one stays in use: {problem}")
        else:
            self._said += [taken.note, *([taken.warning] if taken.warning else [])]

    def _watch(self) -> None:
        self._said += self.source.events()
        if self._poses is not None:
            self._said += self._poses.events()
        clock = _offset()
        if abs(clock - self._clock) > JUMP:
            jump = (clock - self._clock) / 1e9
            self._said.append(f"the system's clock jumped by {jump:+.3f} s, and so did the times of the samples")
            self._clock = clock


@called_as('palpate.open_live("rig.toml")')
def open_live(rig: Rig | str | Path, sensor: str | None = None) -> Live:
    """Return live contacts of the device that a rig's [source] names, estimated in this process.

    ```python
    with palpate.open_live("rig.toml") as live:
        for time, row in live:
            point, force = row[ROW.point], row[ROW.force]
    ```

    Args:
        rig: a rig with a [source], or its file.
        sensor: name of the sensor's table, if there are several.

    Returns:
        A `Live`, which connects when its context is entered. `palpate.contact.estimate.ROW` names the columns of a row;
            the columns of `estimator.features` follow, and the identity if a sample can have several contacts, a row
            each.

    Raises:
        InputError: the rig cannot be used or has no [source]; on entering, the device cannot be opened.
    """
    return Live(rig, sensor)


def _unseen(setup: Setup) -> Setup:
    """Return the setup without a filter whose rate must be measured first; raise InputError for zero_phase."""
    if setup.filter.kind == "zero_phase":
        hint = 'Use kind = "butterworth" or "kalman".'
        what = "zero_phase needs later samples, which a stream does not have yet."
        raise InputError(what, where="[filter] of the rig", hint=hint)
    return setup if setup.filter.rate is not None else replace(setup, filter=RigFilter())


def _offset() -> int:
    """Return the system's clock minus the monotonic clock [ns]."""
    return time.time_ns() - time.monotonic_ns()
