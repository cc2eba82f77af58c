"""Replay a log as a source of live samples."""

from __future__ import annotations

import time
from bisect import bisect_right
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import DTypeLike

from palpate.errors import InputError
from palpate.files.logs import open_log
from palpate.files.logs.layout import LogLayout
from palpate.live.source import Batch, drained
from palpate.setup.setup import Setup
from palpate.setup.source import RigSource
from palpate.signals.recording import ACCELERATION, AVERAGED, FORCE, IMAGE, ORIENTATION, POSITION, TORQUE, Recording

ROWS = 256  # of a log of topics that are read at once: several sensors then read the same part of it
_READER = ThreadPoolExecutor(1, thread_name_prefix="replay")


def bare(layout: LogLayout) -> LogLayout:
    """Return a `LogLayout` that leaves numbers as they are recorded, with their units and axes."""
    arrays = tuple(array.as_recorded() for array in layout.arrays)
    units = {"force_unit": "N", "torque_unit": "N m", "acceleration_unit": "m/s^2"}
    return replace(layout.as_recorded(), arrays=arrays, **units)


def values_of(recording: Recording) -> np.ndarray:
    """Return the readings of a recording, (n, ...), in its units: wrenches (n, 6), force first; or its array or images.

    Of an array with wrenches, a row holds the flat array, the wrench, and, if recorded, the readings in its mean.
    """
    channels = recording.channels
    beside = (FORCE, TORQUE, ORIENTATION, POSITION, ACCELERATION, AVERAGED)
    rest = [values for name, values in channels.items() if name not in beside]
    if FORCE not in channels:
        return rest[0]
    count = len(recording)
    parts = [*(values.reshape(count, -1) for values in rest[:1]), channels[FORCE], channels[TORQUE]]
    return np.concatenate([*parts, channels[AVERAGED]] if AVERAGED in channels else parts, axis=1)


class _Block(NamedTuple):
    """A block of the log: stamps [ns] and values of its samples, and when each is due [s of the log]."""

    channels: Mapping[str, np.ndarray]
    stamp: np.ndarray
    values: np.ndarray
    due: Sequence[float]  # a list: its numbers are looked at one by one

    @classmethod
    def of(cls, recording: Recording) -> _Block:
        times = np.nan_to_num(recording.time)
        stamp = np.rint(times * 1e9).astype(np.int64)
        return cls(recording.channels, stamp, values_of(recording), np.maximum.accumulate(times).tolist())


class Replay:
    """A log as a `Source`.

    Stamps are the log's times; samples whose times are missing, repeat or run backwards come at once.

    Args:
        path: the log.
        layout: the layout of the log; a `bare` one gives numbers as they are recorded.
        speed: factor of the speed of the recording; 0: as fast as samples are taken.
        loop: begin again at the end, with times that continue.

    Attributes:
        felt: whether the log has accelerations.
        ended: whether the log is at its end.
        patient: whether samples wait until they are received (speed 0).

    Raises:
        InputError: the log cannot be read, or holds no samples.
    """

    def __init__(self, path: Path, layout: LogLayout, speed: float = 1.0, loop: bool = False) -> None:
        self.path, self._layout, self._speed, self._loop = path, layout, speed, loop
        self._begun = self._first = 0.0
        self._rest = self._samples()
        self._coming = self._read()
        first = self._coming.result()
        if first is None:
            raise InputError("holds no samples.", where=str(path))
        values = values_of(first)
        self.shape: tuple[int, ...] = tuple(values.shape[1:])
        self.dtype: DTypeLike = np.uint8 if IMAGE in first.channels else np.float64
        self.felt = ACCELERATION in first.channels
        self.poses = ORIENTATION in first.channels
        self.ended, self.patient = False, not speed
        self._said: list[str] = []
        self._block: _Block | None = None
        self._next = 0  # number of the next sample in the block

    @classmethod
    def of(cls, stated: RigSource, setup: Setup) -> Replay:
        """Return the `Replay` of the log that a rig's [source] names, with numbers as recorded.

        Raises:
            InputError: the log is missing, cannot be read, or holds no samples.
        """
        path = setup.link.folder / stated.address
        if not path.exists():
            raise InputError("the log to replay does not exist.", where=f"{path}, [source] of the rig")
        return cls(path, bare(setup.layout()), stated.speed, stated.loop)

    def open(self) -> None:
        """Start the clock: the first sample comes now."""
        self.begin(time.monotonic())

    def begin(self, at: float) -> None:
        """Start the clock: the first sample comes at a time [s], by `time.monotonic`."""
        self._begun = at

    def receive(self, batch: Batch, timeout: float) -> int:
        """Fill a batch with due samples and return how many; wait up to `timeout` [s] for the first.

        Raises:
            InputError: the log cannot be read further.
        """
        if self._block is None:
            found = self._coming.result()
            if found is None:
                if not self.ended:
                    self._said.append(f"{self.path.name} has been played to its end")
                self.ended = True
                time.sleep(timeout)
                return 0
            self._coming = self._read()
            self._block, self._next = _Block.of(found), 0
        block, start = self._block, self._next
        if count := self._due(block.due, start, min(start + len(batch), len(block.due)), timeout):
            part = slice(start, start + count)
            batch.stamp[:count], batch.lost[:count], batch.values[:count] = block.stamp[part], 0, block.values[part]
            batch.arrive(count, time.time_ns())
            if self.poses or self.felt:
                extra = (ORIENTATION, batch.orientation), (POSITION, batch.position), (ACCELERATION, batch.acceleration)
                for name, into in extra:
                    into[:count] = block.channels[name][part] if name in block.channels else np.nan
            self._next = start + count
            if self._next == len(block.due):
                self._block = None
        return count

    def due(self) -> float:
        """Return when the next sample comes [s], by `time.monotonic`; inf: the log is at its end."""
        if self._block is None or not self._speed:
            return np.inf if self.ended else -np.inf
        return self._begun + (self._block.due[self._next] - self._first) / self._speed

    def events(self) -> list[str]:
        """Return the sentence on the end of the log once; else []."""
        return drained(self._said)

    def close(self) -> None:
        """End the replay: no more samples come."""
        self._rest, self._block = iter(()), None
        self._coming = self._read()

    def _due(self, due: Sequence[float], start: int, end: int, timeout: float) -> int:
        """Return how many samples from `start` to `end`, due at [s] of the log in order, are due.

        Wait up to `timeout` for the first.
        """
        if not self._speed:
            return end - start
        waiting = self.due() - time.monotonic()
        if waiting > timeout:
            time.sleep(timeout)
            return 0
        if waiting > 0:
            time.sleep(waiting)
        now = self._first + (time.monotonic() - self._begun) * self._speed
        return max(1, bisect_right(due, now, start, end) - start)

    def _read(self) -> Future[Recording | None]:
        """Read the next block while samples before it are given: it takes longer than the time between two."""
        return _READER.submit(next, self._rest, None)

    def _blocks(self) -> Iterator[Recording]:
        log = open_log(self.path, self._layout)
        log.block_rows = ROWS
        return iter(log.blocks())

    def _samples(self) -> Iterator[Recording]:
        shift, last = 0.0, np.nan
        while True:
            fresh = True
            for block in self._blocks():
                known = block.time[np.isfinite(block.time)]
                if fresh and len(known):
                    if np.isnan(last):
                        self._first = float(known[0])
                    else:
                        shift = last + (block.rate() or 1.0) ** -1 - float(known[0])
                    fresh = False
                last = float(known[-1]) + shift if len(known) else last
                yield block if not shift else replace(block, time=block.time + shift)
            if not self._loop:
                return
