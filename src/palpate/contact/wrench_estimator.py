"""From readings to contacts by way of the wrench: sensor, tare, filter, mounting, method."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int, Int8
from numpy.typing import ArrayLike

from palpate.calls import called_as
from palpate.contact.contacts import Contacts
from palpate.contact.estimate import ROW, ContactEstimate
from palpate.contact.estimator import NOTHING_BESIDE, instant, samples
from palpate.contact.locate import Locator
from palpate.contact.locating_threads import LocatingThreads, Pending
from palpate.contact.whole_touches import Located, joined, whole_touches
from palpate.contact.zero_follower import ZeroFollower
from palpate.contact.zero_gate import ContactShape
from palpate.errors import InputError
from palpate.sensors.compensation import Compensation
from palpate.sensors.drift import Drift
from palpate.sensors.filters import Filter
from palpate.sensors.force_torque import ForceTorque
from palpate.sensors.load_cell_array import LoadCellArray
from palpate.sensors.recording import Recording, apart
from palpate.sensors.smoothing import BothWays, Forward, known_rate, require_forward
from palpate.sensors.wrench_sensor import Measured, Placement, Tare, WrenchSensor
from palpate.sensors.zero_filter import FollowedSensor, ZeroHistory, ZeroState
from palpate.spatial._arrays import require_out
from palpate.spatial.arguments import takes_arrays
from palpate.spatial.pose import Pose
from palpate.surfaces.given import SurfaceLike

__all__ = ["WrenchEstimator"]

PIECE = 4096  # samples at a time: what lies between two steps stays in the cache
AHEAD = 4  # blocks that may wait for the threads that locate
ROW_SHAPE = (ROW.length,)
ALL = np.ones(1)  # of the noise is left


class _Piece(NamedTuple):
    """Samples of one window of the zero, or a whole block where none is followed.

    Attributes:
        samples: they.
        zero: of them, where it is followed.
        block: that they end; None: it goes on.
    """

    samples: Recording
    zero: ZeroState | None
    block: Recording | None


class _Waiting(NamedTuple):
    """A piece that a filter of zero phase keeps waiting."""

    piece: _Piece
    measured: Measured

    @property
    def usable(self) -> int:
        return int(np.count_nonzero(self.measured.status < 0))


class _Live:
    """One sample in one compiled call, of a sensor that such a loop is written for; bits as in blocks."""

    def __init__(self, sensor: Compensation | LoadCellArray, locator: Locator, placement: Placement) -> None:
        from palpate.contact import _live  # compiled: loaded when first needed

        self._given = sensor, locator, placement
        self._hold, self._pack, self._revision = sensor.hold, _live.packed, -1
        self._entry = _live.force_torque if isinstance(sensor, Compensation) else _live.load_cells
        self._compiled = locator.compiled(known=sensor.noise is not None)

    def __reduce__(self) -> tuple[Any, ...]:
        return _Live, self._given  # the surface prepares its tree anew

    def __call__(
        self,
        time: float,
        reading: ArrayLike,
        rotation: ArrayLike | None,
        acceleration: ArrayLike | None,
        rows: np.ndarray,
    ) -> None:
        self._hold(time, reading, rotation, acceleration)
        self.run(rows)

    def block(
        self, time: np.ndarray, readings: np.ndarray, beside: Mapping[str, np.ndarray], rows: np.ndarray
    ) -> np.ndarray:
        """The contacts of some samples; what the sensor made of them."""
        inputs = self._given[0].inputs(time, readings, beside)
        self.run(rows, inputs)
        return inputs

    def run(self, rows: np.ndarray, inputs: np.ndarray | None = None) -> None:
        """The contacts of inputs that the sensor made, or of the ones that it holds, into rows."""
        sensor, _, placement = self._given
        if self._revision != sensor.revision:
            packed = self._pack(sensor.constants(placement))
            self._arguments = *packed, sensor.state, *self._compiled
            self._revision = sensor.revision
            self._loop = self._entry.compiled_for(sensor.held, *self._arguments, np.empty((1, ROW.length)))
        self._loop(sensor.held if inputs is None else inputs, *self._arguments, rows)


@called_as(
    "palpate.WrenchEstimator(mesh, palpate.ForceTorque(noise=(0.02, 0.001)))",
    update="estimator.update(time, [0, 0, -5, 0.02, 0, 0], "
    "palpate.Pose.from_quaternion(quaternion, [0, 0, 0]).rotation)",
    run='estimator.run(palpate.Recording(time, {"force": force, "torque": torque}))',
    tare='estimator.tare(palpate.Recording(time, {"force": force, "torque": torque}))',
    estimate='estimator.run(palpate.Recording(time, {"force": force, "torque": torque}))',
)
class WrenchEstimator:
    """The `ContactEstimator` of every sensor of wrenches, on any surface.

    The filter acts on the wrench in the sensor's frame; its share of the noise goes into the covariance, and what
    sensor, tare and mounting add, the same in every sample, stays whole. A sample that the sensor gives a status passes
    the filter by; a gap starts the filter afresh (`sensors.smoothing`).

    Args:
        locator: on the surface, in the surface's frame; or the surface, as `Locator` takes it. One without noise takes
            the sensor's, and thresholds from it where none were given.
        sensor: of wrenches, such as a `Compensation` or a `LoadCellArray`; a `ForceTorque` stands for one that
            carries no payload.
        mount: T_sensor_surface.
        mount_covariance: (6, 6) of its (rotation vector [rad], translation [m]), perturbed on the left.
        filter: of the wrench; None: none. One of zero phase works in `pairs` and `stream` only.
        rate: [Hz] of the samples; a filter needs it.
        mounted: wrenches are about the sensor's frame. False: calibrated about the surface's, so that `mount` only
            says where results are in other frames.
        live: for samples as they come: the loop of single ones is compiled now, some seconds once a machine. False is
            for logs: `pairs` and `stream` decide a touch as a whole when it has ended (`whole_touches`).
        placement: [m] standard deviation, along each tangent, of where touches act beside what their wrenches explain:
            found by `palpate calibrate mounting`, or stated, as of a body that flattens. It widens the covariance of
            the point, and changes no status.
        drift: how the sensor's zero wanders: it is followed while nothing touches (`ZeroGate`), and what is not known
            of it widens the covariance, so that a contact begins where the force is more than that. For logs
            (`live=False`) the zero is smoothed by what comes after a touch, for which blocks wait 10 minutes at most.

    Attributes:
        kelvin: temperature of the sensor [K or degrees C] for `update` and `update_into`, which take no channels: to be
            set as it changes, where `drift` has a `thermal`. Blocks bring theirs (`TEMPERATURE`).
        threads: in which `pairs` and `stream` locate, two blocks behind what they take: sooner where there are cores to
            spare, the same bits. 0: in none but the caller's, as where the zero is followed or the filter looks ahead.

    Raises:
        InputError: a filter without a rate, or with one that is too low for it; or a negative placement; a drift of
            other channels than the sensor's, or of a sensor whose noise is not known.
    """

    features: tuple[str, ...] = ()
    most = 1

    @takes_arrays
    def __init__(
        self,
        locator: Locator | SurfaceLike,
        sensor: WrenchSensor | ForceTorque,
        mount: Pose | None = None,
        mount_covariance: Float[np.ndarray, "6 6"] | None = None,
        filter: Filter | None = None,
        rate: float | None = None,
        mounted: bool = True,
        live: bool = True,
        placement: float = 0.0,
        drift: Drift | None = None,
    ) -> None:
        from palpate.contact._widen import widen  # compiled: loaded when first needed

        if not 0 <= placement < np.inf:  # NaN too
            raise InputError(f"placement must be a length [m] that is not negative, not {placement:g}.")
        locator = locator if isinstance(locator, Locator) else Locator(locator)
        self.placement, self._widen = float(placement), widen
        self.sensor: WrenchSensor = Compensation(sensor) if isinstance(sensor, ForceTorque) else sensor
        self.mount = Pose.identity() if mount is None else mount
        self._placement = Placement(self.mount, mount_covariance) if mounted else Placement(Pose.identity())
        matrix, noise = self._placement.matrix, self.sensor.noise
        lacks = locator.noise is None and noise is not None
        self.locator = locator.with_noise(matrix @ noise @ matrix.T) if lacks else locator
        self.filter, self.rate = filter, rate
        self._zero_phase = filter is not None and filter.zero_phase
        self._recursion = None if filter is None else filter.recursion(known_rate(rate, "samples"))
        self._forward = None if self._recursion is None else Forward(self._recursion, known_rate(rate, "samples"))
        if self._forward is not None:
            self._forward(np.zeros(1), np.zeros(1, np.int8), np.zeros((1, 6)))  # compiles
        if isinstance(self.sensor, Compensation):
            self.sensor.smoothed_by(filter, rate, self._settled())
        elif isinstance(self.sensor, LoadCellArray):
            self.sensor.settled = self._settled()
        self._whole, self.drift, self.threads, self.kelvin = not live, drift, 0, np.nan
        self._shape = None if drift is None else ContactShape(self.locator, self._placement, self.placement)
        self._follower = self._told = self._follows()
        self._live: _Live | None = None
        if filter is None and isinstance(self.sensor, Compensation | LoadCellArray):
            self._live = _Live(self.sensor, self.locator, self._placement)
            if live:
                self._live.run(self.empty(1))
        self._placed(self.empty(1))  # compiles
        self.reset()

    @property
    def channels(self) -> tuple[str, ...]:
        """Of the sensor."""
        return self.sensor.channels

    @staticmethod
    def empty(*batch: int) -> Float[np.ndarray, "*batch 22"]:
        """Rows to write into; `ContactEstimate.from_rows` names what is in them, `ROW` where."""
        return Locator.empty(*batch)

    def reset(self) -> None:
        """Forget what samples left: filter, last contact, hysteresis; not the tare."""
        self.sensor.reset()
        self.locator.reset()
        if self._forward is not None:
            self._forward.reset()
        if self._follower is not None:
            self._follower.reset()
        self._samples = 0

    def update(
        self,
        time: ArrayLike,
        reading: ArrayLike,
        rotation: ArrayLike | None = None,
        acceleration: ArrayLike | None = None,
    ) -> Contacts:
        """The contact of one sample, in the surface's frame.

        Args:
            time: [s] on a clock that only a filter reads.
            reading: as measured: six numbers [N, N m], force first, in the frame that `ForceTorque.frame` names; or
                voltages.
            rotation: (3, 3) sensor in base, where payload or frame need it; NaN: not known now.
            acceleration: (3,) [m/s^2] of the sensor's origin in the sensor's frame; None: at rest.

        Raises:
            InputError: the reading has another shape; the rotation is needed and there is none; the filter looks ahead.
        """
        rows, time = self.empty(1), instant(time)
        self.update_into(time, reading, rows, rotation, acceleration)
        return Contacts.single(np.array([time], dtype=np.float64), ContactEstimate.from_rows(rows), self._samples - 1)

    def update_into(
        self,
        time: ArrayLike,
        reading: ArrayLike,
        out: Float[np.ndarray, "*rows width"],
        rotation: ArrayLike | None = None,
        acceleration: ArrayLike | None = None,
    ) -> int:
        """`update` into a row of `empty()`, or the first of some, for a control loop; `ROW` says what stands where."""
        if self._zero_phase:
            require_forward(self.filter)
        row = out
        if getattr(out, "ndim", 1) != 1:
            require_out(out, (..., ROW.length))
            if not out.size:
                raise InputError("out must have a row to write into.")
            row = out.reshape(-1, ROW.length)[0]
        require_out(row, ROW_SHAPE)
        time = instant(time)
        rows, follower = row[None], self._forwards(time, self.kelvin)
        if self._live is None:
            measured = self.sensor.single(time, reading, rotation, acceleration)
            located, covariances = self.sensor.place(measured, *self._filtered(measured), self._placement)
            self.locator.run_into(located, covariances, measured.status, rows)
        else:
            self._live(time, reading, rotation, acceleration, rows)
        if follower is not None:
            follower.add(time, follower.sensor.kept_of(follower.sensor.held, 1))
        self._placed(rows)
        self._samples += 1
        return 1

    def run_into(
        self,
        time: ArrayLike,
        readings: ArrayLike,
        out: Float[np.ndarray, "rows width"],
        counts: Int[np.ndarray, " n"],
        beside: Mapping[str, ArrayLike] = NOTHING_BESIDE,
    ) -> int:
        """`run` of arrays, one row a sample; see `ContactEstimator`."""
        require_forward(self.filter)
        require_out(out, (None, ROW.length))
        time, readings, beside = samples(time, readings, counts, beside)
        count = min(len(time), len(out))
        rows, kept = out[:count], {name: values[:count] for name, values in beside.items()}
        if self._live is None:
            channels = apart(self.channels, readings[:count])
            rows[:] = self._block(Recording(time[:count], {**channels, **kept}, source="the stream")).rows
        else:
            self._run_live(self._live, time[:count], readings[:count], kept, rows)
        if self.placement:
            self._placed(rows)
        counts[:count] = 1
        self._samples += count
        return count

    def run(self, recording: Recording) -> Contacts:
        """Contacts of a block, one a sample, in the surface's frame.

        Raises:
            InputError: a channel is missing, or has another shape; or the filter looks ahead.
        """
        require_forward(self.filter)
        rows = self._placed(self._block(recording).rows)
        return Contacts.single(recording.time, ContactEstimate.from_rows(rows))

    def pairs(self, blocks: Iterable[Recording]) -> Iterator[tuple[Recording, Contacts]]:
        """Each block with its contacts, in order, as soon as they are known.

        A filter of zero phase looks ahead, and for logs (`live=False`) blocks wait until the touches in them end.
        Samples are counted from the first block on. A sensor may cut blocks where its log begins anew.

        Raises:
            InputError: as `run`, but for that filter.
        """
        ready, looks_ahead = self.sensor.ready(blocks), self._zero_phase
        if self.drift is not None and (self._whole or looks_ahead):
            pieces = self._smoothed(ready)
            parts = self._look_ahead(pieces) if looks_ahead else map(self._piece, pieces)
            located = self._rejoined(parts)
        elif looks_ahead:
            located = (part for part, _ in self._look_ahead(_Piece(block, None, block) for block in ready))
        elif self.threads and self.drift is None:
            located = self._located_beside(ready)
        else:
            located = map(self._block, ready)
        first = 0
        for part in whole_touches(located, self.locator) if self._whole else located:
            yield (
                part.block,
                Contacts.single(part.block.time, ContactEstimate.from_rows(self._placed(part.rows)), first),
            )
            first += len(part.rows)

    def stream(self, blocks: Iterable[Recording]) -> Iterator[Contacts]:
        """The contacts of `pairs` alone."""
        return (contacts for _, contacts in self.pairs(blocks))

    def tare(self, recording: Recording) -> Tare:
        """Take the mean of a window off from now on, in place of an earlier tare; then `reset`.

        Args:
            recording: steady and untouched.

        Returns:
            how much it is, and a doubt where it could be a touch, each as a sentence.

        Raises:
            InputError: too few samples, or not steady: what was seen.
        """
        taken = self.sensor.tare(recording)
        self.reset()
        return Tare(taken.said, taken.doubt or self._touched(taken))

    def contact_wrenches(
        self, recording: Recording
    ) -> tuple[Float[np.ndarray, "n 6"], Float[np.ndarray, "n 6 6"] | None, Int8[np.ndarray, " n"]]:
        """Wrenches in the surface's frame, not filtered, with covariances and statuses (-1: to locate)."""
        measured = self.sensor.measure(recording)
        return *self.sensor.place(measured, measured.wrench, ALL, self._placement), measured.status

    def notes(self) -> tuple[str, ...]:
        """What was met so far: by the sensor, and on the surface."""
        followed = () if self._told is None else self._told.notes()
        return (*self.locator.surface.notes, *self.sensor.notes(), *followed)

    def doubts(self) -> tuple[str, ...]:
        """Of the sensor, and of its zero where it is followed."""
        return (*self.sensor.doubts(), *(() if self._told is None else self._told.doubts()))

    def zero_history(self) -> ZeroHistory | None:
        """How the zero went, in live samples or in the log that was streamed last; None where it is not followed."""
        return None if self._told is None else self._told.history()

    def _touched(self, taken: Tare) -> str:
        """Where a steady touch would be that reads what a tare took off, if the surface can be touched like that."""
        force = 0.0 if taken.touch is None else float(np.linalg.norm(taken.touch[:3]))
        if taken.touch is None or force <= max(self.locator.on, taken.least):
            return ""
        found = self.locator.candidates(self._placement.matrix @ taken.touch)
        if not found.plausible.any():
            return ""
        x, y, z = 1e3 * found.point[0]
        return (
            f"what the tare takes off is also what a steady touch of {force:.2g} N at ({x:.1f}, {y:.1f}, {z:.1f}) mm "
            "of the surface would read: make sure that nothing touched it"
        )

    def _block(self, block: Recording) -> Located:
        """All samples of a block, so many at a time."""
        return self._joined(block, [self._located(*each) for each in self._measured(block)])

    def _measured(self, block: Recording) -> Iterator[tuple[Recording, Measured, np.ndarray, np.ndarray]]:
        """What `_located` takes, so many samples of a block at a time."""
        for cut in self._cuts(block.time):
            piece = block.picked(cut)
            follower = self._forwards(float(piece.time[0]), ZeroFollower.kelvin(piece.channels)) if len(piece) else None
            measured = self.sensor.measure(piece)
            if follower is not None:
                follower.add(piece.time, follower.sensor.kept(piece))
            yield piece, measured, *self._filtered(measured)

    def _located_beside(self, blocks: Iterable[Recording]) -> Iterator[Located]:
        """`_block` of each, located in threads of their own while the next ones are read, compensated and placed."""
        waiting: deque[tuple[Recording, list[Pending]]] = deque()
        with LocatingThreads(self.locator, self.threads) as threads:
            for block in blocks:
                parts = [
                    threads.put(piece, *self.sensor.place(measured, wrenches, share, self._placement), measured.status)
                    for piece, measured, wrenches, share in self._measured(block)
                ]
                waiting.append((block, parts))
                if len(waiting) > AHEAD:
                    first, parts = waiting.popleft()
                    yield self._joined(first, [part.result() for part in parts])
            threads.finish()
            for block, parts in waiting:
                yield self._joined(block, [part.result() for part in parts])

    @staticmethod
    def _joined(block: Recording, pieces: list[Located]) -> Located:
        return pieces[0]._replace(block=block) if len(pieces) == 1 else joined(block, pieces)

    def _cuts(self, time: Float[np.ndarray, " n"]) -> list[slice]:
        """Of a block: where the zero may change, or where there are too many samples."""
        if self._follower is not None:
            return list(self._follower.pieces(time)) or [slice(0, 0)]
        return [slice(start, start + PIECE) for start in range(0, max(1, len(time)), PIECE)]

    def _forwards(self, time: float, kelvin: float = np.nan) -> ZeroFollower | None:
        """What follows the zero of samples as they come, told that those of this time come next."""
        if self._follower is not None:
            self._follower.enter(time, kelvin)
            self._told = self._follower
        return self._follower

    def _run_live(
        self, live: _Live, time: np.ndarray, readings: np.ndarray, beside: Mapping[str, np.ndarray], rows: np.ndarray
    ) -> None:
        """A block by the compiled loop, in pieces where the zero is followed."""
        if self._follower is None:
            live.block(time, readings, beside, rows)
            return
        for cut in self._follower.pieces(time):
            known = {name: part[cut] for name, part in beside.items()}
            follower = self._forwards(float(time[cut.start]), ZeroFollower.kelvin(known))
            inputs = live.block(time[cut], readings[cut], known, rows[cut])
            if follower is not None:
                follower.add(time[cut], follower.sensor.kept_of(inputs, cut.stop - cut.start))

    def _follows(self, smooth: bool = False) -> ZeroFollower | None:
        """What follows the zero from its tare on."""
        if self.drift is None or self._shape is None:
            return None
        if not isinstance(self.sensor, FollowedSensor):
            raise InputError("the zero of this sensor cannot be followed.", where="drift")
        return ZeroFollower(self.sensor, self.drift, self._shape, smooth=smooth)

    def _smoothed(self, blocks: Iterable[Recording]) -> Iterator[_Piece]:
        """The pieces of blocks with the zero that was found from both sides."""
        follower = self._follows(smooth=True)
        if follower is None:
            return
        self._told = follower
        pieces = (
            _Piece(block.picked(cut), None, block if cut is cuts[-1] else None)
            for block in blocks
            for cuts in [list(follower.pieces(block.time)) or [slice(0, 0)]]
            for cut in cuts
        )
        for piece, zero in follower.both_sides((piece.samples, None, piece) for piece in pieces):
            yield piece._replace(zero=zero)

    def _piece(self, piece: _Piece) -> tuple[Located, Recording | None]:
        """Located with its own zero, and the block that it ends."""
        self._follow(piece.zero)
        measured = self.sensor.measure(piece.samples)
        return self._located(piece.samples, measured, *self._filtered(measured)), piece.block

    def _follow(self, zero: ZeroState | None) -> None:
        if zero is not None and isinstance(self.sensor, FollowedSensor):
            self.sensor.follow(zero)

    @staticmethod
    def _rejoined(parts: Iterable[tuple[Located, Recording | None]]) -> Iterator[Located]:
        """Blocks again."""
        pieces: list[Located] = []
        for part, block in parts:
            pieces.append(part)
            if block is not None:
                yield joined(block, pieces)
                pieces = []

    def _filtered(self, measured: Measured) -> tuple[Float[np.ndarray, "n 6"], Float[np.ndarray, " k"]]:
        """Wrenches by way of the filter, and the share of the noise that it leaves."""
        if self._forward is None:
            return measured.wrench, ALL
        wrenches = measured.wrench
        return wrenches, self._forward.share(self._forward(measured.time, measured.status, wrenches))

    def _located(
        self, block: Recording, measured: Measured, wrenches: Float[np.ndarray, "n 6"], share: Float[np.ndarray, " k"]
    ) -> Located:
        located, covariances = self.sensor.place(measured, wrenches, share, self._placement)
        rows = self.empty(len(located))
        self.locator.run_into(located, covariances, measured.status, rows)
        return Located(block, located, covariances, measured.status, rows)

    def _placed(self, rows: Float[np.ndarray, "n width"]) -> Float[np.ndarray, "n width"]:
        """With what touches err by beside their wrenches; after a touch was decided."""
        if self.placement > 0.0:
            self._widen(rows, self.placement**2)
        return rows

    def _look_ahead(self, pieces: Iterable[_Piece]) -> Iterator[tuple[Located, Recording | None]]:
        """Pieces wait until all of their samples are filtered."""
        if self._recursion is None:
            return
        both = BothWays(self._recursion, known_rate(self.rate, "samples"))
        waiting: deque[_Waiting] = deque()
        for piece in pieces:
            self._follow(piece.zero)
            measured = self.sensor.measure(piece.samples)
            both.push(measured.time, measured.status, measured.wrench)
            waiting.append(_Waiting(piece, measured))
            yield from self._served(waiting, both)
        both.finish()
        yield from self._served(waiting, both)

    def _served(self, waiting: deque[_Waiting], both: BothWays) -> Iterator[tuple[Located, Recording | None]]:
        """Those whose samples are all filtered."""
        while waiting and both.ready >= waiting[0].usable:
            piece, measured = waiting.popleft()
            wrenches, good = measured.wrench, measured.status < 0
            share = np.ones(len(good))
            wrenches[good], share[good] = both.take(int(np.count_nonzero(good)))
            self._follow(piece.zero)
            yield self._located(piece.samples, measured, wrenches, share), piece.block

    def _settled(self) -> float:
        """Of white noise, what the filter leaves at least."""
        if self._recursion is None:
            return 1.0
        return (
            BothWays(self._recursion, known_rate(self.rate, "samples")).least
            if self._zero_phase
            else self._recursion.share.min()
        )
