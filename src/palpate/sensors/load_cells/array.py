"""Load cells as a sensor of wrenches: the channels to use, the zero, and the calibration's uncertainty."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int, Int8
from numpy.typing import ArrayLike

from palpate.calls import called_as
from palpate.errors import InputError
from palpate.sensors.load_cells.explanations import explanations
from palpate.sensors.load_cells.faults import CellFault, find_faults
from palpate.sensors.load_cells.model import LoadCells
from palpate.sensors.load_cells.zero import Zero, take_zero
from palpate.signals.filters import Filter
from palpate.signals.recording import LARGEST, VOLTAGE, Recording
from palpate.signals.repeats import hung
from palpate.signals.wrench_sensor import Placement, Tare
from palpate.signals.zero_filter import Free, ZeroState
from palpate.spatial._arrays import shaped
from palpate.spatial.arguments import number, takes_arrays
from palpate.spatial.pose import Pose

START = 0.5  # s at a start in which nothing is touched, before a tare sets another time
RESTART = 5.0  # s without a sample: a sensor that was switched off has another zero
LANES = 8  # outputs of a product are a multiple of it: the compiler adds that many at a time
KEPT = 20_000  # readings, evenly spread, that are searched for faults
LIVE = 16  # every 16th live reading is kept for them
PULLED = 0.1  # of the largest load, and of the samples with a load: more is a sign or a zero that is wrong
UPPER = np.triu_indices(6)


class _Weighed(NamedTuple):
    """`Measured` with the explanation used (`which`), the covariance of several, and the zero's share of a variance."""

    time: Float[np.ndarray, " n"]
    wrench: Float[np.ndarray, "n 6"]
    status: Int8[np.ndarray, " n"]
    which: Int[np.ndarray, " n"]
    extra: Float[np.ndarray, "n 6 6"]
    slow: float


@called_as("palpate.LoadCellArray(cells)")
class LoadCellArray:
    """The `WrenchSensor` of cells under a rigid frame; see `LoadCells`.

    Where channels contradict each other, a wrench is computed without the one channel or cell that explains it. Where
    several explanations fit, it is their mean, with a covariance that covers them; where none fits, the sample is
    INVALID. It is SATURATED where channels of more than one cell are at their range.

    The zero is that of the calibration until a `tare`. In a stream it is taken again after a gap of 5 s, or where time
    runs back; a start that is not at rest keeps the previous zero, and gives a warning.

    Args:
        cells: the model.
        sound: (k,) cells or (a k,) channels to use; None: all.
        zero: unloaded reading of the cells; None: that of the calibration.
        names: names of the channels, for messages.
        seconds: [s] at a later start in which nothing is touched; a `tare` sets it to the length of its window.

    Raises:
        NotIdentifiable: the sound cells do not determine a wrench.
    """

    channels = (VOLTAGE,)
    loop = "palpate.sensors.load_cells._live.locate"

    @takes_arrays
    def __init__(
        self,
        cells: LoadCells,
        sound: Bool[np.ndarray, " some"] | None = None,
        zero: Zero | None = None,
        names: tuple[str, ...] = (),
        seconds: float = START,
    ) -> None:
        from palpate.sensors.load_cells import _kernels as _load_cells  # compiled: loaded when first needed

        self.cells, self.names, self._shape = cells, names, (len(cells.matrix),)
        self.sound = cells.channels(sound)
        self._measure, self._place = _load_cells.measure, _load_cells.place
        made = explanations(cells, self.sound)
        self._covariances = self._noises = made.covariances
        self._inverse, self._rest, self._corrections = made.inverse, made.rest, (made.corrections, made.directions)
        self._mapping = _padded(np.concatenate([made.inverse, made.rest]).T)
        self._ways, self._bounds = np.concatenate([made.corrections, made.directions], axis=2), made.bounds
        channels, count = len(cells.matrix), len(made.directions)
        self._channels = np.column_stack([np.zeros(channels), cells.limits])
        self._channels[~self.sound, 1:] = -np.inf, np.inf
        self._settings = np.concatenate([made.metric(), np.zeros((1, 6))])
        self.state, self.live_inputs = np.zeros(count + 2 * channels), np.zeros(channels)
        self._seconds, self.revision, self.zeros_taken, self._settled = seconds, 0, 0, 1.0
        self._placement: Placement | None = None
        self._seen_at: Placement | None = None
        self._known = zero is not None
        self.set_zero(Zero(cells.bias) if zero is None else zero)
        first = self._weighed(np.zeros(1), np.zeros((1, channels)))  # compiles, before anything is in a hurry
        self.place(first, first.wrench, np.ones(1), Placement(Pose.identity()))
        self.reset()

    @property
    def noise(self) -> Float[np.ndarray, "6 6"]:
        """Covariance (6, 6) of a wrench from the noise of one reading by all sound channels, force first [N, N m]."""
        return self._noises[0]

    def set_zero(self, zero: Zero) -> None:
        """Set the unloaded reading of the cells, whose variance is in every later covariance."""
        self.zero = zero
        self.zeros_taken += 1
        self.follow(None)

    def smoothed_by(self, filter: Filter | None, rate: float | None, share: float) -> None:
        """Set the least share, up to 1, of the noise's variance that remains after a filter; only `share` is used."""
        self._settled = share

    def ready(self, blocks: Iterable[Recording]) -> Iterator[Recording]:
        """Yield the same rows, cut where the log begins anew; the zero is taken there before they are yielded.

        Raises:
            InputError: the log has no voltages, or not as many as the cells have.
        """
        waiting, begun, last = list[Recording](), np.nan, np.nan
        for block in blocks:
            for part, fresh in _parts(block, last):
                known = part.time[np.isfinite(part.time)]
                if fresh:
                    yield from self._restarted(waiting, begun)
                    begun = known[0] if len(known) else -np.inf
                last = known[-1] if len(known) else last
                if np.isnan(begun):  # the zero of this start is known
                    yield part
                    continue
                waiting.append(part)
                if last > begun + self._seconds:
                    yield from self._restarted(waiting, begun)
                    begun = np.nan
        yield from self._restarted(waiting, begun)

    def measure(self, recording: Recording) -> _Weighed:
        """Return a recording as `Measured`: wrenches (n, 6) [N, N m] in the sensor's frame, and statuses (n,).

        Raises:
            InputError: the log has no voltages, or not as many as the cells have.
        """
        voltages = self._voltages(recording)
        self._keep(recording.time, voltages)
        return self._weighed(recording.time, voltages)

    def single(
        self,
        time: float,
        reading: ArrayLike,
        rotation: ArrayLike | None = None,
        acceleration: ArrayLike | None = None,
    ) -> _Weighed:
        """Return a sample of voltages (a k,) [V] as `Measured`, a wrench (1, 6); rotation, acceleration are not used.

        Raises:
            InputError: the reading has another shape, or the time is no number.
        """
        if type(time) is not float:
            time = number(time, "time")
        self.hold(time, reading, rotation, acceleration)
        return self.measured(np.array([time], dtype=np.float64), self.live_inputs)

    def hold(self, time: float, reading: ArrayLike, rotation: ArrayLike | None, acceleration: ArrayLike | None) -> None:
        """Write the voltages (a k,) [V] of one sample into `live_inputs`; the other arguments are not used.

        Raises:
            InputError: the reading has another shape.
        """
        values = shaped(reading, (...,), "reading")
        if values.shape != self._shape:
            raise InputError(_SHAPE.format(self.cells.cells, *self._shape, values.shape))
        self.live_inputs[:] = values
        self._live += 1
        if self._live % LIVE == 0:
            self._keep(np.array([time], dtype=np.float64), self.live_inputs[None])

    @takes_arrays
    def inputs(
        self,
        time: Float[np.ndarray, " n"],
        readings: Float[np.ndarray, "n m"],
        extra_channels: Mapping[str, np.ndarray],
    ) -> Float[np.ndarray, " _"]:
        """Return the live inputs (a k n,) of n samples: their readings (n, a k) [V] in turn; only these are used.

        Raises:
            InputError: the readings have another shape.
        """
        if readings.shape[1:] != self._shape:
            raise InputError(_SHAPE.format(self.cells.cells, *self._shape, readings.shape[1:]))
        before, self._live = self._live, self._live + len(readings)
        if before // LIVE != self._live // LIVE:
            self._keep(time[-1:], readings[-1:])
        return np.array(readings, dtype=np.float64).ravel()

    @takes_arrays
    def measured(self, time: Float[np.ndarray, " n"], inputs: Float[np.ndarray, " _"]) -> _Weighed:
        """Return the samples of live inputs (a k n,), at times (n,) [s], as `measure` does.

        Raises:
            InputError: arrays of other shapes.
        """
        return self._weighed(time, inputs.reshape(len(time), *self._shape))

    def constants(self, placement: Placement) -> tuple[np.ndarray, ...]:
        """Return the constant arguments of the compiled `measure` and `place`, in their order, as a tuple of arrays."""
        return *self._measuring(), np.array([self._slow]), *self._placing(placement)

    @takes_arrays
    def place(
        self,
        measured: _Weighed,
        wrenches: Float[np.ndarray, "n 6"],
        share: Float[np.ndarray, " k"],
        placement: Placement,
    ) -> tuple[Float[np.ndarray, "n 6"], Float[np.ndarray, "n 6 6"]]:
        """Return wrenches (n, 6) [N, N m] in the surface's frame and covariances (n, 6, 6).

        A filter's share does not reduce the errors of zero, drift, calibration and mounting.

        Raises:
            InputError: arrays of other shapes.
        """
        located = np.empty_like(wrenches), np.empty((len(wrenches), 6, 6))
        known = measured.which, measured.extra, share, measured.slow
        self._place(wrenches, *known, *self._placing(placement), *located)
        return located

    def tare(self, recording: Recording) -> Tare:
        """Take the zero from a window in which nothing touches, use it from now on, and return a `Tare`.

        Raises:
            InputError: the window is not at rest, is too short, or has no voltages, or not as many as the cells have.
        """
        zero = self._take([self._voltages(recording)], recording.source)
        time = recording.time[np.isfinite(recording.time)]
        self._seconds, self._known = float(np.ptp(time)) if len(time) else START, True
        return Tare(zero.note, "" if zero.touch is not None else zero.warning, zero.touch)

    coefficients = np.zeros(0)

    def kept(self, recording: Recording) -> Float[np.ndarray, "n m"]:
        """Return a copy of the voltages (n, a k) [V] of a recording.

        Raises:
            InputError: there are none, or not as many as the cells have.
        """
        return self._voltages(recording)

    @takes_arrays
    def kept_of(self, inputs: Float[np.ndarray, " _"], count: int) -> Float[np.ndarray, "n m"]:
        """Return the voltages (n, a k) [V] from the live inputs (a k n,) of `count` = n samples.

        Raises:
            InputError: inputs has another shape.
        """
        return inputs.reshape(count, -1).copy()

    @takes_arrays
    def free(self, kept: Float[np.ndarray, "n m"]) -> Free:
        """Return a `Free` of voltages (n, a k) [V], rows NaN where a used channel is at its range or not finite.

        Raises:
            InputError: kept has another shape.
        """
        sound: Bool[np.ndarray, "n m"] = np.abs(kept) <= LARGEST
        beyond: Bool[np.ndarray, "n m"] = (kept <= self._channels[:, 1]) | (kept >= self._channels[:, 2])
        full = beyond & np.isfinite(self._channels[:, 1]) & sound
        usable: Bool[np.ndarray, " n"] = np.all(sound[:, self.sound] & ~full[:, self.sound], axis=1)
        values = np.where(usable[:, None], np.where(sound, kept, self.zero.voltage), np.nan)
        return Free(values, np.zeros((*kept.shape, 0)), bool(full.any()))

    @takes_arrays
    def window_noise(
        self, kept: Float[np.ndarray, "n m"], usable: Bool[np.ndarray, " n"]
    ) -> tuple[Float[np.ndarray, "m m"], Float[np.ndarray, "m m"]]:
        """Return covariances (a k, a k) [V^2] of a window's mean: by the noise of usable samples (n,), and zeros.

        Raises:
            InputError: arrays of other shapes.
        """
        count = max(1.0, float(np.count_nonzero(usable)) / self.cells.correlation)
        return self.cells.noise / count, np.zeros_like(self.cells.noise)

    @takes_arrays
    def as_wrench(
        self, change: Float[np.ndarray, "n m"], covariance: Float[np.ndarray, "m m"]
    ) -> tuple[Float[np.ndarray, "n 6"], Float[np.ndarray, "6 6"]]:
        """Return changes (n, a k) [V] as wrenches (n, 6) [N, N m], and the covariance (6, 6) of the last wrench.

        To the covariance (a k, a k) [V^2] of the change the calibration's error is added.

        Raises:
            InputError: arrays of other shapes.
        """
        wrenches = change @ self._inverse.T
        spread = self.cells.complete(self._inverse @ covariance @ self._inverse.T)
        return wrenches, spread + self.cells.calibration_covariance(wrenches[-1]) if len(wrenches) else spread

    def start(self) -> tuple[float, ZeroState, Float[np.ndarray, "m q"]]:
        """Return NaN for the time, the last zero taken as a `ZeroState` [V], and an empty regressor (a k, 0)."""
        spread = self.cells.noise * (self.zero.share + self.cells.drift**2)
        return np.nan, ZeroState(np.array(self.zero.voltage), np.zeros(0), spread), np.zeros((len(spread), 0))

    def follow(self, state: ZeroState | None) -> None:
        """Use a followed zero [V] and its covariance from now on; None: the zero that was taken."""
        voltage = self.zero.voltage if state is None else state.zero
        spread = np.zeros_like(self.cells.noise) if state is None else state.covariance
        slow = self.zero.share + self.cells.drift**2 if state is None else 0.0
        self._channels[:, 0], self._slow = voltage, float(slow)
        ways = self._inverse - np.einsum("sai,sak->sik", *self._corrections) @ self._rest
        ways = np.concatenate([self._inverse[None], ways])
        # a filter does not reduce the zero's error, which the loops scale by its share: before it settles, too much
        self._covariances = np.ascontiguousarray(self._noises + ways @ spread @ ways.swapaxes(1, 2) / self._settled)
        rest = float(np.trace(self._rest @ spread @ self._rest.T)) / max(1, len(self._rest))
        wanders = float(np.sqrt(self.cells.drift**2 + rest))
        self._settings[6, :3] = wanders, self.cells.misfit, 1.0 + self._slow
        self._placement, self.revision = None, self.revision + 1

    def reset(self) -> None:
        """Forget the samples so far, with the warnings of them; the zero is kept."""
        self._doubted, self._kept = list[str](), [np.empty((0, 1 + len(self.live_inputs)))]
        self._held, self._seen, self._stride, self._live = 0, 0, 1, 0
        self._start_anew()

    def _start_anew(self) -> None:
        """Forget how well the explanations fitted and the last voltages."""
        (channels,) = self._shape
        self.state[:] = 0.0
        self.state[-2 * channels : -channels] = np.nan

    def notes(self) -> tuple[str, ...]:
        """Return (): there are no notes."""
        return ()

    def warnings(self) -> tuple[str, ...]:
        """Return warnings, a sentence each: a missing zero, zeros of later starts, a fault, readings that repeat."""
        zero = () if self._known else ("no zero of the cells was taken: the zero of the calibration is used",)
        kept = self._all_kept
        same = np.append(False, (kept[1:, 1:] == kept[:-1, 1:]).all(axis=1))[: len(kept)]
        faults = (fault.text for fault in self.faults())
        return (*zero, *self._doubted, *faults, *hung(kept[:, 0], same), *self._pulled(kept[:, 1:]))

    def _pulled(self, voltages: Float[np.ndarray, "n m"]) -> list[str]:
        """Return a sentence if loads, voltages less the zero, pull at a plate, which nothing that lies on it does."""
        if len(self.cells.axes) > 1:
            return []
        along = self._inverse[:3].sum(axis=0)  # the axis of the cells; forces along the others are 0
        force: np.ndarray = voltages @ along
        noise = float(np.sqrt(along @ self.cells.noise @ along))
        least = max(PULLED * float(np.abs(force).max(initial=0.0)), 10.0 * noise)
        loaded: np.ndarray = force[np.abs(force) > least]
        share = float(np.mean(loaded > 0)) if len(loaded) else 0.0
        what = f"{share:.0%} of the loads pull at the plate: the voltages have another sign than in the calibration, or"
        return [f"{what} the zero was taken with a weight on it"] if share > PULLED else []

    def faults(self) -> list[CellFault]:
        """Return a list of at most one `CellFault`, from a part of the readings so far; [] where the cells agree."""
        kept = self._all_kept
        return find_faults(self.cells, kept[:, 1:], self.sound, self.names, kept[:, 0])

    @property
    def _all_kept(self) -> Float[np.ndarray, "n _"]:
        """Times and voltages less the zero of a part of the readings so far, joined once."""
        if len(self._kept) > 1:
            self._kept = [np.concatenate(self._kept)]
        return self._kept[0]

    def _seen_from(self, placement: Placement) -> tuple[Float[np.ndarray, "t 6 6"], Float[np.ndarray, "21 q"]]:
        """Return the noise's covariances in the surface's frame and the map to that of E w."""
        if placement is not self._seen_at:
            self._seen_at, self._unsure = placement, _unsure(self.cells, placement.matrix)
            self._placement = None
        if placement is not self._placement:
            self._placement = placement
            self._turned = placement.matrix @ self._covariances @ placement.matrix.T
        return self._turned, self._unsure

    def _measuring(self) -> tuple[np.ndarray, ...]:
        """Return the constant arguments of the compiled `measure`."""
        return self._channels, self._mapping, self._ways, self._covariances, self._bounds, self._settings

    def _placing(self, placement: Placement) -> tuple[np.ndarray, ...]:
        """Return the constant arguments of the compiled `place`."""
        return *self._seen_from(placement), placement.factor, placement.matrix

    def _weighed(self, time: Float[np.ndarray, " n"], voltages: Float[np.ndarray, "n m"]) -> _Weighed:
        n = len(time)
        made = np.empty((n, 6)), np.empty(n, np.int8), np.zeros(n, np.int64), np.zeros((n, 6, 6))
        self._measure(voltages, *self._measuring(), self.state, *made)
        return _Weighed(time, *made, self._slow)

    def _voltages(self, recording: Recording) -> Float[np.ndarray, "n m"]:
        found = recording.channels.get(VOLTAGE)
        if found is None:
            hint = "Name their columns or topic in [load_cells]."
            raise InputError("the log has no voltages.", where=recording.source, hint=hint)
        if found.shape[1:] != self._shape:
            raise InputError(_SHAPE.format(self.cells.cells, *self._shape, found.shape[1:]), where=recording.source)
        return np.array(found, dtype=np.float64, order="C")

    def _take(self, windows: list[np.ndarray], where: str) -> Zero:
        zero = take_zero(self.cells, np.concatenate(windows), where)
        self.set_zero(zero)
        self._start_anew()
        return zero

    def _restarted(self, waiting: list[Recording], begun: float) -> Iterator[Recording]:
        if not waiting:
            return
        rest = [self._voltages(part)[part.time <= begun + self._seconds] for part in waiting]
        try:
            doubt = self._take(rest, waiting[0].source).warning
        except InputError as problem:
            doubt = f"the start at {begun:.3f} s is not at rest, so the zero before it is kept ({problem.what})"
        self._doubted += [doubt] if doubt else []
        yield from waiting
        waiting.clear()

    def _keep(self, time: Float[np.ndarray, " n"], voltages: Float[np.ndarray, "n m"]) -> None:
        first = -self._seen % self._stride
        self._seen += len(voltages)
        if first >= len(voltages):
            return
        rows = np.column_stack([time, voltages - self._channels[:, 0]])
        self._kept.append(rows[first :: self._stride])
        self._held += len(self._kept[-1])
        while self._held > 2 * KEPT:  # every second one of those kept stays
            self._kept = [np.concatenate(self._kept)[::2]]
            self._held, self._stride = len(self._kept[0]), 2 * self._stride

    def __repr__(self) -> str:
        return f"LoadCellArray({self.cells!r}, {np.count_nonzero(self.sound)} of {len(self.sound)} channels sound)"


_SHAPE = "{} cells need {} voltages per sample, not voltages of shape {}."


def _padded(matrix: Float[np.ndarray, "n o"]) -> Float[np.ndarray, "n q"]:
    """Return the matrix with columns of zeros added up to a multiple of `LANES`."""
    return np.ascontiguousarray(np.pad(matrix, ((0, 0), (0, -matrix.shape[1] % LANES))))


def _unsure(cells: LoadCells, matrix: Float[np.ndarray, "6 6"]) -> Float[np.ndarray, "21 q"]:
    """Return the map from the upper triangle of w w' to the covariance of E w in the surface's frame."""
    whole = np.einsum("pi,iajb,qj->paqb", matrix, cells.errors.reshape(6, 6, 6, 6), matrix)
    both = whole + whole.transpose(0, 3, 2, 1)  # of w_a w_b and w_b w_a
    rows, columns = UPPER
    unsure = both[rows[None], rows[:, None], columns[None], columns[:, None]]  # [of w w', of the covariance]
    return _padded(unsure * np.where(rows == columns, 0.5, 1.0)[:, None])


def _parts(block: Recording, last: float) -> Iterator[tuple[Recording, bool]]:
    """Yield the parts of a block that is cut where the log begins anew, and whether each begins there."""
    steps = np.diff(block.time, prepend=last)
    fresh = np.flatnonzero((steps > RESTART) | (steps < 0))
    edges = np.unique(np.concatenate([[0], fresh, [len(block)]]))
    for begin, end in pairwise(edges.tolist()):
        yield block.picked(slice(begin, end)), begin in fresh
