"""The chain from readings to contacts: sensor, payload, tare, filter, mounting, method."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int8
from numpy.typing import ArrayLike

from palpate.contact.chain import Chain, Readings
from palpate.contact.estimate import ContactEstimate
from palpate.contact.locate import Locator
from palpate.contact.tare import Tare, rest
from palpate.errors import InputError
from palpate.sensors.filters import Filter
from palpate.sensors.force_torque import ForceTorque, Payload
from palpate.sensors.recording import Recording
from palpate.sensors.smoothing import BothWays, Forward
from palpate.spatial.pose import Pose

__all__ = ["Estimator"]

PIECE = 4096  # samples at a time: what lies between two steps stays in the cache
ALL = np.ones(1)  # of the noise is left


class _Waiting(NamedTuple):
    """A block that a filter of zero phase keeps waiting."""

    block: Recording
    readings: Readings
    wrenches: Float[np.ndarray, "n 6"]
    statuses: Int8[np.ndarray, " n"]

    @property
    def usable(self) -> int:
        return int(np.count_nonzero(self.statuses < 0))


class Estimator:
    """Pure and streaming: each sample is answered with what those before it left (filter, last contact, hysteresis).

    The answers are the same to the last bit whether samples come one by one or in blocks of any size. The filter acts
    on the compensated wrench in the sensor's frame; its share of the sensor's noise goes into the covariance, and
    what payload, tare and mounting add, the same in every sample, stays whole. A sample that is invalid, saturated or
    without pose gets its status and passes the filter by; a gap starts the filter afresh (`sensors.smoothing`).

    Args:
        locator: on the surface, in the surface's frame.
        sensor: noise, range and frame of the wrenches.
        payload: what hangs on the sensor; None leaves the wrenches as they are.
        mount: T_sensor_surface.
        mount_covariance: (6, 6) of its (rotation vector [rad], translation [m]), perturbed on the left.
        filter: of the compensated wrench; None: none. One of zero phase works in `stream` only.
        rate: [Hz] of the samples; a filter needs it.

    Raises:
        InputError: a filter without a rate, or with one that is too low for it.
    """

    def __init__(
        self,
        locator: Locator,
        sensor: ForceTorque,
        payload: Payload | None = None,
        mount: Pose | None = None,
        mount_covariance: Float[np.ndarray, "6 6"] | None = None,
        filter: Filter | None = None,
        rate: float | None = None,
    ) -> None:
        self.locator, self.sensor, self.payload = locator, sensor, payload
        self.mount = Pose.identity() if mount is None else mount
        self.filter, self.rate = filter, rate
        self._chain = Chain(sensor, payload, self.mount, mount_covariance)
        self._zero_phase = filter is not None and filter.zero_phase
        self._recursion = None if filter is None else filter.recursion(_known(rate))
        self._forward = None if self._recursion is None else Forward(self._recursion, _known(rate))
        nothing = Readings(np.zeros(1), np.zeros((1, 6)), np.eye(3)[None], np.zeros((1, 3)), np.zeros((1, 1)))
        self._answer(nothing, locator.empty(1))  # compiles, before anything is in a hurry
        self.reset()

    def reset(self) -> None:
        """Forget what samples left: filter, last contact, hysteresis; not the tare."""
        self.locator.reset()
        if self._forward is not None:
            self._forward.reset()

    def update(
        self,
        time: float,
        wrench: ArrayLike,
        rotation: ArrayLike | None = None,
        acceleration: ArrayLike | None = None,
    ) -> ContactEstimate:
        """The contact of one sample, in the surface's frame.

        Args:
            time: [s] on a clock that only a filter reads.
            wrench: (6,) as measured [N, N m], force first, in the frame that `ForceTorque.frame` names.
            rotation: (3, 3) sensor in base, where payload or frame need it; NaN: not known now.
            acceleration: (3,) [m/s^2] of the sensor's origin in the sensor's frame; None: at rest.

        Raises:
            InputError: the rotation is needed and there is none; or the filter looks ahead.
        """
        row = self.locator.empty()
        self.update_into(row, time, wrench, rotation, acceleration)
        return ContactEstimate.from_rows(row)

    def update_into(
        self,
        row: Float[np.ndarray, "22"],
        time: float,
        wrench: ArrayLike,
        rotation: ArrayLike | None = None,
        acceleration: ArrayLike | None = None,
    ) -> None:
        """`update` into a row of `Locator.empty()`, for a control loop; `ROW` says what stands where."""
        self._require_forward()
        why = self._chain.needs_orientation
        if rotation is None and why:
            raise InputError(f"update needs the orientation of the sensor: {why}.")
        turn = np.eye(3) if rotation is None or not why else rotation
        pushed = np.zeros(3) if acceleration is None else acceleration
        readings = Readings(
            np.array([time], dtype=np.float64),
            _one(wrench, (1, 6)),
            _one(turn, (1, 3, 3)),
            _one(pushed, (1, 3)),
            np.zeros((1, 1)),
        )
        self._answer(readings, row[None])

    def run(self, recording: Recording) -> ContactEstimate:
        """Contacts of a block, one a sample, in the surface's frame.

        Raises:
            InputError: an orientation is needed (payload with weight, wrenches in the base frame) and there is none; or
                the filter looks ahead.
        """
        self._require_forward()
        rows = self.locator.empty(len(recording))
        for start in range(0, len(recording), PIECE):
            piece = slice(start, start + PIECE)
            self._answer(self._chain.readings(recording.picked(piece)), rows[piece])
        return ContactEstimate.from_rows(rows)

    def stream(self, blocks: Iterable[Recording]) -> Iterator[tuple[Recording, ContactEstimate]]:
        """Each block with its contacts, in order, as soon as they are known; a filter of zero phase looks ahead.

        Raises:
            InputError: as `run`, but for that filter.
        """
        if self._zero_phase:
            yield from self._look_ahead(blocks)
        else:
            for block in blocks:
                yield block, self.run(block)

    def tare(self, recording: Recording) -> Tare:
        """Take the mean compensated wrench of a window off from now on, in place of an earlier tare; then `reset`.

        Args:
            recording: steady and untouched.

        Returns:
            how much it is, and a doubt where it could be a touch, each as a sentence.

        Raises:
            InputError: too few samples, or not steady: what was seen.
        """
        chain = self._chain
        readings = chain.readings(recording)
        wrenches, statuses = chain.compensated(readings, tared=False)
        usable = statuses < 0
        found = rest(wrenches[usable], self.sensor.noise, recording.source)
        chain.untare()
        middle = readings.picked(usable).mean()
        mean, covariance = chain.in_surface(found.mean[None], middle, np.array([1.0 / found.samples]))
        judged = found.judged(mean[0], None if covariance is None else covariance[0], self.locator)
        chain.tare(found.mean, middle, found.samples)
        self.reset()
        return judged

    def contact_wrenches(
        self, recording: Recording
    ) -> tuple[Float[np.ndarray, "n 6"], Float[np.ndarray, "n 6 6"] | None, Int8[np.ndarray, " n"]]:
        """Compensated wrenches in the surface's frame, not filtered, with covariances and statuses (-1: to locate)."""
        readings = self._chain.readings(recording)
        wrenches, statuses = self._chain.compensated(readings)
        return *self._chain.in_surface(wrenches, readings, ALL), statuses

    def _answer(self, readings: Readings, rows: Float[np.ndarray, "n 22"]) -> None:
        """Samples through the whole chain into rows of estimates."""
        wrenches, statuses = self._chain.compensated(readings)
        share = ALL
        if self._forward is not None:
            share = self._forward.share(self._forward(readings.time, statuses, wrenches))
        self._locate(wrenches, statuses, readings, share, rows)

    def _locate(
        self,
        wrenches: Float[np.ndarray, "n 6"],
        statuses: Int8[np.ndarray, " n"],
        readings: Readings,
        share: Float[np.ndarray, " k"],
        rows: Float[np.ndarray, "n 22"],
    ) -> None:
        located, covariances = self._chain.in_surface(wrenches, readings, share)
        self.locator.run_into(located, covariances, statuses, rows)

    def _look_ahead(self, blocks: Iterable[Recording]) -> Iterator[tuple[Recording, ContactEstimate]]:
        """Blocks wait until all of their samples are filtered."""
        if self._recursion is None:
            return
        both = BothWays(self._recursion, _known(self.rate))
        waiting: deque[_Waiting] = deque()
        for block in blocks:
            readings = self._chain.readings(block)
            wrenches, statuses = self._chain.compensated(readings)
            both.push(readings.time, statuses, wrenches)
            waiting.append(_Waiting(block, readings, wrenches, statuses))
            yield from self._served(waiting, both)
        both.finish()
        yield from self._served(waiting, both)

    def _served(self, waiting: deque[_Waiting], both: BothWays) -> Iterator[tuple[Recording, ContactEstimate]]:
        """Those whose samples are all filtered."""
        while waiting and both.ready >= waiting[0].usable:
            block, readings, wrenches, statuses = waiting.popleft()
            good, share = statuses < 0, np.ones(len(statuses))
            wrenches[good], share[good] = both.take(int(np.count_nonzero(good)))
            rows = self.locator.empty(len(block))
            self._locate(wrenches, statuses, readings, share, rows)
            yield block, ContactEstimate.from_rows(rows)

    def _require_forward(self) -> None:
        if self._zero_phase:
            raise InputError(
                "a filter of zero phase looks ahead, so it cannot answer sample by sample.",
                mend="Use Estimator.stream on a log, or a Butterworth filter without zero_phase.",
            )


def _one(values: ArrayLike, shape: tuple[int, ...]) -> np.ndarray:
    """A copy of one sample's values, contiguous and writable, as the loops were compiled for."""
    return np.array(values, dtype=np.float64, order="C").reshape(shape)


def _known(rate: float | None) -> float:
    if rate is None:
        raise InputError("a filter needs the rate of the samples.", mend="Give rate in Hz.")
    return rate
