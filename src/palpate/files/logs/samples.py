"""Convert the raw numbers of a log to SI and the sensor's axes, with notes on irregularities."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from palpate.errors import InputError
from palpate.files.logs.joint_columns import JointColumns
from palpate.files.logs.layout import ArrayChannel, LogLayout, axis_matrix
from palpate.files.logs.orientation import SensorPose
from palpate.files.logs.stuck import StuckWrenches
from palpate.files.units import ACCELERATION_UNITS, FORCE_UNITS, TORQUE_UNITS, to_si
from palpate.signals.recording import (
    ACCELERATION,
    AVERAGED,
    CELLS,
    FORCE,
    IMAGE,
    LARGEST,
    ORIENTATION,
    POSITION,
    TORQUE,
    Recording,
    sealed,
)
from palpate.spatial.arguments import takes_arrays
from palpate.spatial.pose import rotation_from_quaternion

WRENCH = "wrench"  # (n, 6) force and torque as recorded
NUMBERS = 1 << 22  # numbers per block

GAP = 5.0  # median steps that make a gap
LONG_STEP = 0.5  # s: unusually long for a log of forces, unless the time has another unit
LATEST = 1e20  # s: beyond any clock, in nanoseconds too


@takes_arrays
class SampleReader:
    """Converter of the raw numbers of one log to recordings, which counts irregularities.

    Attributes:
        acceleration: m/s^2 in the log's unit of accelerations.

    Raises:
        InputError: axes or units of the layout are invalid.
    """

    def __init__(self, layout: LogLayout, path: Path) -> None:
        axes = axis_matrix(layout.axes, left_handed=layout.left_handed, where="axes")
        turning = axes
        if layout.torque_axes is not None:
            turning = axis_matrix(layout.torque_axes, left_handed=None, where="torque_axes")
        picked = np.argmax(np.abs([axes, turning]), axis=2)
        signs = np.take_along_axis(np.array([axes, turning]), picked[:, :, None], axis=2)[:, :, 0]
        force = to_si(layout.force_unit, FORCE_UNITS, where="units.force")
        torque = to_si(layout.torque_unit, TORQUE_UNITS, where="units.torque")
        sign = -1.0 if layout.acts_on == "environment" else 1.0
        self._picked = np.append(picked[0], 3 + picked[1])
        self._factors = sign * np.append(force * signs[0], torque * signs[1])
        self._as_it_is = bool(np.array_equal(self._picked, np.arange(6)) and (self._factors == 1.0).all())
        self.acceleration = to_si(layout.acceleration_unit, ACCELERATION_UNITS, where="acceleration.unit")
        self._layout, self._frame, self._source, self._arrays = layout, layout.frame, path.name, layout.arrays
        inverse, turned = layout.inverse, layout.sensor_rotation
        logged = SensorPose(layout.orientation_form, inverse=inverse, sensor_rotation=turned)
        self._pose = JointColumns(layout) if layout.joints else logged
        self._images, self._both = layout.images is not None, bool(layout.arrays) and layout.wrench is not None
        self._times = _Times()
        self._held: tuple[np.ndarray, dict[str, np.ndarray]] | None = None  # rows without an answer on `stuck`
        self._beyond = Counter[str]()  # name of a channel -> rows with a number that is a fault
        self._infinite = self._none = self._far = 0

    @cached_property
    def _stuck(self) -> StuckWrenches:
        limits = self._layout.wrench_range
        return StuckWrenches(None if limits is None else self.recorded(limits))

    def blocks(self, time: Float[np.ndarray, " n"], read: Mapping[str, np.ndarray]) -> Iterator[Recording]:
        """Yield the next samples in SI, at times (n,) [s], as far as later ones cannot show that they are stuck.

        `read` has the numbers as recorded: `WRENCH`, arrays and other channels, (n, k) each; or `IMAGE`, (n, height,
        width, 3). The caller must not use them afterwards.

        Raises:
            InputError: time has another shape.
            KeyError: an array of the layout is not in `read`.
        """
        time = np.where(np.abs(time) <= LATEST, time, np.nan)
        if WRENCH not in read:
            yield self._recording(time, read, None)
            return
        stuck = self._stuck.find(time, read[WRENCH])
        if self._held is not None:
            time = np.concatenate([self._held[0], time])
            read = {name: np.concatenate([self._held[1][name], values]) for name, values in read.items()}
        yield from self._answered(time, read, stuck)

    def rest(self) -> Iterator[Recording]:
        """Yield the last samples, after all blocks."""
        if self._held is not None:
            stuck = self._stuck.find(np.zeros(0), np.zeros((0, 6)), complete=True)
            yield from self._answered(*self._held, stuck)

    def _answered(
        self, time: np.ndarray, read: Mapping[str, np.ndarray], stuck: Bool[np.ndarray, " m"]
    ) -> Iterator[Recording]:
        """Yield the first samples, on which there is an answer, and hold the others."""
        ready = len(stuck)
        held = {name: values[ready:].copy() for name, values in read.items()}
        self._held = (time[ready:], held) if ready < len(time) else None
        if ready:
            yield self._recording(time[:ready].copy(), {name: values[:ready] for name, values in read.items()}, stuck)

    def _recording(
        self, time: Float[np.ndarray, " n"], read: Mapping[str, np.ndarray], stuck: Bool[np.ndarray, " n"] | None
    ) -> Recording:
        """Return samples in SI, without the wrenches that are stuck."""
        channels: dict[str, np.ndarray] = {}
        if stuck is not None:
            wrenches = np.where(stuck[:, None], np.nan, self._wrenches(read[WRENCH]))
            channels = {FORCE: wrenches[:, :3].copy(), TORQUE: wrenches[:, 3:].copy()}
            if self._both and AVERAGED not in read:
                channels[AVERAGED] = np.ones((len(time), 1))
        apart = (WRENCH, IMAGE, *(array.name for array in self._arrays))
        channels |= {name: self._bounded(name, values) for name, values in read.items() if name not in apart}
        if not self._times.count and {FORCE, ORIENTATION} <= channels.keys():
            self._require_one_stream(channels)
        if ORIENTATION in channels and not self._pose.plain:
            channels |= self._posed(channels)
        if ORIENTATION in channels:
            channels[ORIENTATION] = self._sound(channels[ORIENTATION])
        if self._layout.moves_torque and TORQUE in channels:
            channels[TORQUE] = self._torque(channels)
        if ACCELERATION in channels and self.acceleration != 1.0:
            channels[ACCELERATION] = self.acceleration * channels[ACCELERATION]
        channels |= {array.name: self._scaled(array, read[array.name]) for array in self._arrays}
        self._times.add(time)
        channels = {name: sealed(values, own=True) for name, values in channels.items()}
        if IMAGE in read:
            channels[IMAGE] = sealed(read[IMAGE], own=True, dtype=np.uint8)
        return Recording(sealed(time, own=True), channels, frame=self._frame, source=self._source)

    def readings(self, values: np.ndarray) -> np.ndarray:
        """Return readings of a stream, (n, k) as recorded, as the sensor's update takes them, (n, ...) in SI.

        The bits are those of `block`. If array and wrench are read, the wrench (6) follows the array, then the number
        of readings of which it is the mean.
        """
        if self._both:
            array = self._scaled(self._arrays[0], values[:, :-7].copy()).reshape(len(values), -1)
            wrench = values[:, -7:-1].take(self._picked, axis=1) * self._factors
            return np.concatenate([array, wrench, values[:, -1:]], axis=1)
        if not (self._images or self._arrays or self._as_it_is):
            return values.take(self._picked, axis=1) * self._factors  # what is infinite, its status says
        values = values.copy()  # a source fills its batch again
        return values if not self._arrays else self._scaled(self._arrays[0], values.reshape(len(values), -1))

    def recorded(self, limits: Sequence[float]) -> Float[np.ndarray, "6"]:
        """Return limits (6,) [N, N m] along the sensor's axes as magnitudes (6,) in the log's columns and units."""
        made = np.empty(6)
        made[self._picked] = np.abs(np.asarray(limits) / self._factors)
        return made

    def notes(self) -> tuple[str, ...]:
        """Return notes on the blocks so far, one sentence each: infinite numbers, odd times, bad quaternions."""
        infinite, none, far = self._infinite, self._none, self._far
        arrays = [(array.name, self._beyond[array.name]) for array in self._arrays]
        beyond = self._beyond.total() - sum(count for _, count in arrays)
        said = (
            (infinite, f"{infinite} of {self._times.count} rows have a force or torque that is infinite or beyond 1e9"),
            (beyond, f"{beyond} poses or accelerations are infinite or beyond 1e9 and were left out"),
            *((count, f"{count} rows have a {name} that is infinite or beyond 1e9") for name, count in arrays),
            *self._times.oddities(),
            (none, f"{none} {self._pose.named} and were left out"),
            (far, f"{far} quaternions are not unit (by more than 1 %) and were normalised"),
        )
        return (*self._stuck.notes(), *(sentence for count, sentence in said if count))

    def _scaled(self, array: ArrayChannel, values: Float[np.ndarray, "n k"]) -> Float[np.ndarray, "n ..."]:
        """Return an array channel in SI; counts of taxels may exceed `LARGEST`."""
        values = values if array.name == CELLS else self._bounded(array.name, values)
        if array.order == "columns":
            values = values.reshape(-1, *array.recorded).swapaxes(1, 2).reshape(-1, array.size)
        values = values if array.scale == 1.0 else values * np.array(array.scale)
        return values.reshape(-1, *array.shape)

    def _wrenches(self, wrench: Float[np.ndarray, "n 6"]) -> Float[np.ndarray, "n 6"]:
        """Return wrenches in SI along the sensor's axes; no infinite component spoils others."""
        with np.errstate(over="ignore"):
            made = wrench.take(self._picked, axis=1) * self._factors  # by rows: an index would leave columns
        if not np.abs(made).max(initial=0.0) <= LARGEST:  # NaN too
            self._infinite += int(np.count_nonzero((np.abs(made) > LARGEST).any(axis=1)))
        return made

    def _require_one_stream(self, channels: Mapping[str, np.ndarray]) -> None:
        """Raise an InputError where rows have either a wrench or an orientation: two streams, one below the other."""
        measured, posed = (np.isfinite(channels[name]).all(axis=1) for name in (FORCE, ORIENTATION))
        if measured.any() and posed.any() and not (measured & posed).any():
            raise InputError(
                "holds two streams: no row has both a wrench and an orientation.",
                where=self._source,
                hint=f'Write file = "{self._source}" in the rig\'s [orientation]: orientations are then interpolated.',
            )

    def _posed(self, channels: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Return the pose of the sensor in the base, as channels, from the logged one."""
        quaternion, position = self._pose.convert(channels[ORIENTATION], channels.get(POSITION))
        lost = np.isnan(quaternion).any(axis=1) & np.isfinite(channels[ORIENTATION]).all(axis=1)
        self._none += int(np.count_nonzero(lost))
        return {ORIENTATION: quaternion} | ({} if position is None else {POSITION: position})

    def _torque(self, channels: Mapping[str, np.ndarray]) -> Float[np.ndarray, "n 3"]:
        """Return the torque about the sensor's origin, in the frame of the force.

        Raises:
            InputError: it needs poses, and the log has none.
        """
        force, torque, reference = channels[FORCE], channels[TORQUE], self._layout.reference
        based = self._frame == "base"
        turned = self._layout.torque_frame not in (None, self._frame)
        needed = [ORIENTATION] if turned or based != (reference == "base") else []
        needed += [POSITION] if reference == "base" else []
        if missing := [name for name in needed if name not in channels]:
            raise InputError(
                "the torque is in another frame than the force, or not about the sensor's origin; to convert it, the "
                f"{missing[0]} is needed.",
                where=self._source,
                hint="Name its columns or topic in the rig's [orientation].",
            )
        rotation = rotation_from_quaternion(channels[ORIENTATION]) if ORIENTATION in needed else np.eye(3)[None]
        if turned:
            torque = np.einsum("nij,nj->ni" if based else "nji,nj->ni", rotation, torque)
        if reference == "sensor":
            return torque
        point = -channels[POSITION] if reference == "base" else np.array([reference])  # in the base, in the sensor
        if based != (reference == "base"):
            point = np.einsum("nij,nj->ni" if based else "nji,nj->ni", rotation, point)
        return torque + np.cross(point, force)

    def _bounded(self, name: str, values: Float[np.ndarray, "n k"]) -> Float[np.ndarray, "n k"]:
        """Replace numbers beyond `LARGEST` by NaN, and count their rows."""
        wrong = np.abs(values) > LARGEST
        self._beyond[name] += int(np.count_nonzero(wrong.any(axis=1)))
        return np.where(wrong, np.nan, values)

    def _sound(self, quaternion: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, "n 4"]:
        """Replace quaternions of lengths far from 1 by NaN, and count them."""
        length = np.linalg.norm(quaternion, axis=1)
        none = (length < 0.5) | (length > 2.0)
        self._none += int(np.count_nonzero(none))
        self._far += int(np.count_nonzero(~none & (np.abs(length - 1.0) > 0.01)))
        return np.where(none[:, None], np.nan, quaternion)


def rows_at_once(most: int, width: int, numbers: int = NUMBERS) -> int:
    """Return how many rows of `width` numbers to process at once: `most`, or at least 1 with `numbers` in all."""
    return max(1, min(most, numbers // max(width, 1)))


class _Times:
    """Counts of the times that are missing, repeat, run backwards or follow a gap."""

    def __init__(self) -> None:
        self.count = self.missing = self.backwards = self.repeated = self.gaps = 0
        self._last = np.empty(0)
        self._usual = np.inf  # s: the median step of the first block that has one
        self._longest = self._longest_at = 0.0

    def add(self, time: Float[np.ndarray, " n"]) -> None:
        known = np.concatenate([self._last, time[np.isfinite(time)]])
        steps = np.diff(known)
        forward = steps[steps > 0]
        if np.isinf(self._usual) and len(forward):
            self._usual = float(np.median(forward))
        self.count += len(time)
        self.missing += int(np.count_nonzero(~np.isfinite(time)))
        self.backwards += int(np.count_nonzero(steps < 0))
        self.repeated += int(np.count_nonzero(steps == 0))
        gaps = np.flatnonzero(steps > GAP * self._usual)
        self.gaps += len(gaps)
        if len(gaps) and (longest := steps[gaps].max()) > self._longest:
            self._longest, self._longest_at = float(longest), float(known[gaps[np.argmax(steps[gaps])]])
        self._last = known[-1:]

    def oddities(self) -> tuple[tuple[int, str], ...]:
        """Return pairs of a count and a sentence on it."""
        return (
            (self.missing, f"{self.missing} of {self.count} times are missing"),
            (self.backwards, f"times run backwards in {self.backwards} places (rows keep the order of the file)"),
            (self.repeated, f"{self.repeated} times repeat the one before"),
            (
                LONG_STEP <= self._usual < np.inf and self.count > 50,
                f"a step between samples is {self._usual:.4g} s: if times are not in s, set unit in the rig's [time]",
            ),
            (
                self.gaps,
                f"{self.gaps} gaps longer than {GAP:g} steps of {self._usual:.4g} s "
                f"(the longest {self._longest:.4g} s, at time {self._longest_at:.6f})",
            ),
        )
