"""The base class of estimators, which turn readings into contacts."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from operator import is_
from types import MappingProxyType
from typing import Any, NamedTuple, cast

import numpy as np
from jaxtyping import Float, Int
from numpy.typing import ArrayLike

from palpate.contact.contacts import Contacts
from palpate.contact.estimate import ROW
from palpate.contact.plausibility import Plausibility
from palpate.errors import InputError
from palpate.signals.filters import Filter
from palpate.signals.recording import Recording, split_channels
from palpate.signals.smoothing import require_forward
from palpate.signals.wrench_sensor import Tare
from palpate.spatial._arrays import FLOAT, INT64, form_of, require_out, shaped
from palpate.spatial.pose import Pose

__all__ = ["NOTHING_BESIDE", "Answered", "Channels", "ContactEstimator", "Counts", "Known", "Rows", "Times"]

NOTHING_BESIDE: Mapping[str, np.ndarray] = MappingProxyType({})
_KEPT = 64  # forms of arguments of `run_into`

Rows = Float[np.ndarray, "rows width"]
Times = Float[np.ndarray, " n"]
Counts = Int[np.ndarray, " n"]
Known = ArrayLike | None
Channels = Mapping[str, np.ndarray]


class Answered(NamedTuple):
    """Samples with the rows of their contacts.

    Attributes:
        block: the samples.
        rows: (r, width) of all of them, in order.
        counts: (n,) number of rows of each sample.
        seen: readings to show: the force [N] of each taxel, (n, k), or the positions [px] of the markers, (n, m, 2);
            None: there are none, or they were not requested.
    """

    block: Recording
    rows: Float[np.ndarray, "r width"]
    counts: Int[np.ndarray, " n"]
    seen: np.ndarray | None = None


class ContactEstimator(ABC):
    """Base class of estimators; blocks of any size give the same contacts to the last bit.

    A subclass overrides `answers` if later samples improve the contacts of a log, and `_arrays` if arrays are answered
    faster than recordings.

    Args:
        channels: names of channels that a recording must have.
        features: names of the columns that the sensor adds.
        most: largest number of rows of one sample.
        mount: T_sensor_surface, for results in other frames; None: the identity.
        filter: applied to the readings; one of zero phase works in `pairs` and `stream` only.
        dtype: type of a reading.

    Attributes:
        plausibility: check of whether the wrenches of a log fit the body; None: the sensor has no wrenches.
    """

    def __init__(
        self,
        channels: tuple[str, ...],
        features: tuple[str, ...] = (),
        most: int = 1,
        mount: Pose | None = None,
        filter: Filter | None = None,
        dtype: np.dtype[Any] = FLOAT,
    ) -> None:
        self.channels, self.features, self.most, self.filter = channels, features, most, filter
        self.mount = Pose.identity() if mount is None else mount
        self._width, self._dtype = ROW.length + len(features) + (most > 1), dtype
        self.plausibility: Plausibility | None = None
        self._fitting = set[tuple[Any, ...]]()  # forms of arguments that `run_into` took as they are
        self._samples = 0  # that `update`, `update_into` and `run_into` have answered

    @abstractmethod
    def answer(self, block: Recording, watched: bool = False) -> Answered:
        """Return a block with its contacts as `Answered`, from samples so far.

        Args:
            block: the samples.
            watched: also return `Answered.seen`.

        Raises:
            InputError: a channel is missing or has another shape.
        """

    @abstractmethod
    def tare(self, recording: Recording) -> Tare:
        """Subtract the mean of a steady, untouched window from now on, instead of an earlier tare; then `reset`.

        Returns:
            a `Tare`: a note on what is subtracted, and a warning if the window could be a touch, else "".

        Raises:
            InputError: too few samples, or they are not steady; a channel is missing.
        """

    @abstractmethod
    def reset(self) -> None:
        """Forget the state that samples left behind (filter, last contact); keep the tare."""
        self._samples = 0

    @abstractmethod
    def notes(self) -> tuple[str, ...]:
        """Return remarks on the samples so far, a tuple of sentences."""

    @abstractmethod
    def warnings(self) -> tuple[str, ...]:
        """Return possible faults of the sensor or log so far, a tuple of sentences; () without any."""

    @property
    def unbelievable(self) -> str:
        """Return a sentence if nothing in the samples so far can be believed, else ""."""
        return ""

    @abstractmethod
    def _single(self, time: float, reading: ArrayLike, out: Rows, rotation: Known, acceleration: Known) -> int:
        """Write the contacts of one sample, as many as fit, and return their number."""

    def answers(self, blocks: Iterable[Recording], watched: bool = False) -> Iterator[Answered]:
        """Yield each block of a log with its contacts as `Answered`, as soon as these are known.

        Args:
            blocks: of the log, in order, from its start.
            watched: also return `Answered.seen`.

        Raises:
            InputError: a channel is missing or has another shape.
        """
        return map(partial(self.answer, watched=watched), blocks)

    def empty(self, *batch: int) -> Float[np.ndarray, "*batch width"]:
        """Return zeros (*batch, width) to write into: `ROW`, `features`, and the identity if `most` is above 1."""
        return np.zeros((*batch, self._width))

    def run(self, recording: Recording) -> Contacts:
        """Return the `Contacts` of a block in the surface's frame, at least one row per sample.

        Raises:
            InputError: a channel is missing or has another shape, or the filter has zero phase.
        """
        require_forward(self.filter)
        return self._contacts(self.answer(recording), 0)

    def pairs(
        self, blocks: Iterable[Recording], watch: Callable[[Recording, np.ndarray], None] | None = None
    ) -> Iterator[tuple[Recording, Contacts]]:
        """Yield (block, `Contacts`) for each block of a log, as soon as its contacts are known.

        Args:
            blocks: of the log, in order, from its start.
            watch: called before each pair with the block and its `Answered.seen`, if the sensor has any.

        Raises:
            InputError: a channel is missing or has another shape.
        """
        first = 0
        for answered in self.answers(blocks, watch is not None):
            if watch is not None and answered.seen is not None:
                watch(answered.block, answered.seen)
            yield answered.block, self._contacts(answered, first)
            first += len(answered.block)

    def stream(self, blocks: Iterable[Recording]) -> Iterator[Contacts]:
        """Yield the `Contacts` of each block of a log, in the surface's frame.

        Raises:
            InputError: the log cannot be read on, a channel is missing or has another shape, or a skin's first frames
                are too few or show no usable cell.
        """
        return (contacts for _, contacts in self.pairs(blocks))

    def update(
        self,
        time: ArrayLike,
        reading: ArrayLike,
        rotation: ArrayLike | None = None,
        acceleration: ArrayLike | None = None,
    ) -> Contacts:
        """Return the `Contacts` of one live sample in the surface's frame; without a contact, one row with its status.

        Args:
            time: [s] on the clock of the samples.
            reading: as measured, in the form that the class describes.
            rotation: (3, 3) sensor in base, if payload or frame need it; NaN: not known now.
            acceleration: (3,) [m/s^2] of the sensor's origin in the sensor's frame; None: at rest.

        Raises:
            InputError: an argument has another shape; the rotation is needed and missing; the baseline of a skin is not
                known; the filter has zero phase.
        """
        rows, time, first = self.empty(self.most), instant(time), self._samples
        rows = rows[: self.update_into(time, reading, rows, rotation, acceleration)]
        sample = np.full(len(rows), first)
        return Contacts.of_rows(sample, np.full(len(rows), time, dtype=np.float64), rows, self.features)

    def update_into(
        self,
        time: ArrayLike,
        reading: ArrayLike,
        out: Float[np.ndarray, "*rows width"],
        rotation: ArrayLike | None = None,
        acceleration: ArrayLike | None = None,
    ) -> int:
        """Write the contacts of one live sample, given as to `update`, into rows of `empty`.

        Returns:
            number of rows written: at least 1, and as many as fit.

        Raises:
            InputError: an argument has another shape; the rotation is needed and missing; the baseline of a skin is not
                known; the filter has zero phase.
        """
        require_forward(self.filter)
        count = self._single(instant(time), reading, rows_of(out, self._width), rotation, acceleration)
        self._samples += 1
        return count

    def run_into(
        self,
        time: ArrayLike,
        readings: ArrayLike,
        out: Float[np.ndarray, "rows width"],
        counts: Int[np.ndarray, " n"],
        extra_channels: Mapping[str, ArrayLike] = NOTHING_BESIDE,
    ) -> int:
        """Locate the contacts of live samples given as arrays, and write them into rows that `empty` made.

        Args:
            time: (n,) [s].
            readings: (n, ...), each as in `update`.
            out: (rows, width), written from its first row on.
            counts: (n,) int64, into which the number of rows of each answered sample is written.
            extra_channels: other channels of a `Recording`, such as `ORIENTATION`.

        Returns:
            The number of samples answered, from the first on: all, or as many as `out` has room for.

        Raises:
            InputError: the filter has zero phase; an array has another shape, or cannot be written into; a channel is
                missing; the baseline of a skin is not known.
        """
        require_forward(self.filter)
        form = form_of((time, readings, out, counts, *extra_channels.values()))
        if form not in self._fitting:
            require_out(out, (None, self._width))
            given = time, readings, *extra_channels.values()
            time, readings, extra_channels = _samples(time, readings, counts, extra_channels, self._dtype)
            if all(map(is_, given, (time, readings, *extra_channels.values()))):
                if len(self._fitting) == _KEPT:
                    self._fitting.clear()
                self._fitting.add(form)
        arrays = cast("tuple[Times, np.ndarray, Channels]", (time, readings, extra_channels))
        return run_fitting(self, *arrays, out, counts)

    def _arrays(self, time: Times, readings: np.ndarray, beside: Channels, out: Rows, counts: Counts) -> int:
        """Answer as many samples at a time as certainly fit; return the number of samples answered."""
        done = used = 0
        while fits := min(len(time) - done, (len(out) - used) // self.most):
            part = slice(done, done + fits)
            channels = split_channels(self.channels, readings[part]) | {
                name: each[part] for name, each in beside.items()
            }
            _, rows, counts[part], _ = self.answer(Recording(time[part], channels, source="the stream"))
            out[used : used + len(rows)] = rows
            done, used = done + fits, used + len(rows)
        return done

    def _contacts(self, answered: Answered, first: int) -> Contacts:
        block, rows, counts, _ = answered
        return Contacts.of_rows(
            first + np.repeat(np.arange(len(block)), counts), np.repeat(block.time, counts), rows, self.features
        )


def run_fitting(
    estimator: ContactEstimator, time: Times, readings: np.ndarray, extra_channels: Channels, out: Rows, counts: Counts
) -> int:
    """Do what an estimator's `run_into` does, for arrays like those that it took as they are."""
    given = time, readings, extra_channels, out, counts
    done = estimator._arrays(*given)  # pyright: ignore[reportPrivateUsage] - no method: it checks nothing
    estimator._samples += done  # pyright: ignore[reportPrivateUsage] - the same
    return done


def instant(time: ArrayLike) -> float:
    """Return the time [s] of one sample as a float, from a number or an array of one.

    Raises:
        InputError: the time is not one number.
    """
    return cast("float", time) if type(time) is float else float(shaped(time, (), "time"))


def rows_of(out: Any, width: int) -> Float[np.ndarray, "rows width"]:
    """Return `out` as rows (rows, width) that an estimator can write into.

    Raises:
        InputError: `out` is not as `empty` makes it.
    """
    carray = type(out) is np.ndarray and out.flags.carray
    if carray and out.dtype == FLOAT and out.shape[-1:] == (width,) and out.size:
        return out.reshape(-1, width)
    seen = [str(getattr(out, each)) for each in ("dtype", "shape") if hasattr(out, each)] or [type(out).__name__]
    if type(out) is np.ndarray and not carray:
        seen.append("that cannot be written to" if not out.flags.writeable else "that is not contiguous")
    what = f"out must be rows of {width} numbers, contiguous and float64, not {' '.join(seen)}."
    raise InputError(what, hint="Make it with the estimator's `empty(n)`.")


def _samples(
    time: ArrayLike,
    readings: ArrayLike,
    counts: np.ndarray,
    beside: Mapping[str, ArrayLike],
    dtype: np.dtype[Any],
) -> tuple[Float[np.ndarray, " n"], np.ndarray, dict[str, np.ndarray]]:
    """Return times, readings and other channels as compiled loops take them; raise an InputError for other shapes."""
    time = shaped(time, (None,), "time")
    made = {"readings": shaped(readings, (...,), "readings", dtype)}
    made |= {name: shaped(values, (...,), name) for name, values in beside.items()}
    for name, values in made.items():
        if values.shape[:1] != time.shape:
            raise InputError(f"{name} must have one row for each of {len(time)} times, not shape {values.shape}.")
    require_out(counts, time.shape, "counts", INT64)
    return time, made.pop("readings"), made
