"""Turn a wrench sensor's readings into contacts: sensor, tare, filter, mounting, method."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from palpate.calls import called_as
from palpate.contact.drift_gate import ContactShape
from palpate.contact.drift_tracker import DriftTracker
from palpate.contact.estimator import Answered, Channels, ContactEstimator, Counts, Known, Rows, Times
from palpate.contact.live_loop import CompiledSensor, LiveLoop
from palpate.contact.locate import Locator
from palpate.contact.locating_threads import located_in_threads
from palpate.contact.plausibility import Plausibility
from palpate.contact.surface_wrenches import Piece, SurfaceWrenches, Wrenches
from palpate.contact.touch_smoothing import Located, rejoined, smooth_touches
from palpate.errors import InputError
from palpate.signals.drift import Drift
from palpate.signals.filters import Filter
from palpate.signals.recording import Recording
from palpate.signals.wrench_sensor import Placement, Tare, UnloadedSensor, WrenchSensor
from palpate.signals.zero_filter import ZeroHistory
from palpate.spatial.arguments import takes_arrays
from palpate.spatial.pose import Pose
from palpate.surfaces.surface import SurfaceLike


@called_as(
    "palpate.WrenchEstimator(mesh, palpate.ForceTorque(noise=(0.02, 0.001)))",
    update="estimator.update(time, [0, 0, -5, 0.02, 0, 0], "
    "palpate.Pose.from_quaternion(quaternion, [0, 0, 0]).rotation)",
    run='estimator.run(palpate.Recording(time, {"force": force, "torque": torque}))',
    tare='estimator.tare(palpate.Recording(time, {"force": force, "torque": torque}))',
    estimate='estimator.run(palpate.Recording(time, {"force": force, "torque": torque}))',
)
class WrenchEstimator(ContactEstimator):
    """Estimator of one contact, one row, per sample, for any wrench sensor on any surface.

    A reading is six numbers [N, N m] as measured, force first, in the frame that `ForceTorque.frame` names; or the
    voltages of load cells. The filter acts on the wrench in the sensor's frame; it reduces the noise in the covariance,
    but not the errors of sensor, tare and mounting. A sample with a status of the sensor bypasses it; gaps restart it.

    Args:
        locator: on the surface, in the surface's frame; or the surface, as `Locator` takes it. A locator without noise
            gets the sensor's, and thresholds from it if none were given.
        sensor: wrench sensor, such as a `Compensation`, a `LoadCellArray`, or a `ForceTorque` without payload.
        mount: T_sensor_surface.
        mount_covariance: (6, 6) of its (rotation vector [rad], translation [m]), perturbed on the left.
        filter: applied to the wrench; None: none. One of zero phase works in `pairs` and `stream` only.
        rate: [Hz] of the samples; required with a filter.
        mounted: wrenches are about the sensor's frame. False: they are calibrated about the surface's frame, and
            `mount` only transforms results to other frames.
        live: for a stream: the loop of single samples is compiled now, some seconds once per machine. False is for
            logs: `pairs` and `stream` decide on a touch when it has ended.
        placement: [m] standard deviation, along each tangent, of the error of points that the wrenches do not explain,
            as of a body that flattens. It widens the covariance of the point, and changes no status.
        drift: model of the bias's drift: the bias is followed while nothing touches, and its uncertainty widens the
            covariance and raises the force at which a contact begins. For logs the bias is smoothed by the samples
            after a touch, for which blocks wait 10 minutes at most.

    Attributes:
        kelvin: temperature of the sensor [K or degrees C] for `update` and `update_into`, if `drift` has a `thermal`.
        threads: number of threads in which `pairs` and `stream` locate, with identical results. 0: the caller's thread,
            which is also used if the bias is followed.

    Raises:
        InputError: a filter without a rate, or with one that is too low for it; a negative placement; a drift of other
            channels than the sensor's, or for a sensor whose bias cannot be followed or whose noise is not known; no
            surface, or a mesh file that cannot be read or has no unit.
        GeometryError: a mesh without usable facets.
    """

    @takes_arrays
    def __init__(
        self,
        locator: Locator | SurfaceLike,
        sensor: WrenchSensor | UnloadedSensor,
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
            raise InputError(f"placement must be a length of 0 m or more, not {placement:g} m.")
        self.sensor: WrenchSensor = sensor.unloaded() if isinstance(sensor, UnloadedSensor) else sensor
        super().__init__(self.sensor.channels, mount=mount, filter=filter)
        placed = Placement(self.mount, mount_covariance) if mounted else Placement(Pose.identity())
        locator = locator if isinstance(locator, Locator) else Locator(locator)
        matrix, noise = placed.matrix, self.sensor.noise
        lacks = locator.noise is None and noise is not None
        self.locator = locator.with_noise(matrix @ noise @ matrix.T) if lacks else locator
        self.placement, self._widen, self._whole = float(placement), widen, not live
        self.rate, self.drift, self.threads, self.kelvin = rate, drift, 0, np.nan
        shape = None if drift is None else ContactShape(self.locator, placed, self.placement)
        self._wrenches = SurfaceWrenches(self.sensor, placed, filter, rate, drift, shape, logs=not live)
        self.plausibility = Plausibility(self.locator, self.contact_wrenches, self.mount)
        self._live: LiveLoop | None = None
        self._compiled = self.sensor if isinstance(self.sensor, CompiledSensor) and self.sensor.loop else None
        if self._compiled is not None:
            self._live = LiveLoop(self._compiled, self.locator, placed, self._wrenches.smoothing)
            if live:
                self._live.run(np.zeros(1), self.empty(1))
        self._widened(self.empty(1))  # compiles
        self.reset()

    def empty(self, *batch: int) -> Float[np.ndarray, "*batch 22"]:
        """Return rows (*batch, 22) of NaN to write into, laid out as `ROW`; see `ContactEstimate.from_rows`."""
        return self.locator.empty(*batch)

    def reset(self) -> None:
        """Forget the state that samples left behind: filter, last contact, hysteresis; keep the tare."""
        super().reset()
        self._wrenches.reset()
        self.locator.reset()

    def tare(self, recording: Recording) -> Tare:
        """Subtract the mean of an untouched recording from now on, instead of an earlier tare; then `reset`.

        Returns:
            a `Tare`: a note, and a warning if a steady touch would read the same, else "".

        Raises:
            InputError: too few samples, or the sensor was not at rest; a channel is missing.
        """
        taken = self.sensor.tare(recording)
        self.reset()
        return Tare(taken.note, taken.warning or self._touched(taken))

    def answer(self, block: Recording, watched: bool = False) -> Answered:
        """Return a block with its contacts, one row per sample, as `Answered`; `watched` has no effect.

        Raises:
            InputError: a channel is missing or has another shape.
        """
        pieces = self._wrenches.forward(self._wrenches.pieces([block]))
        return self._answered(next(rejoined(self._located(pieces))))

    def answers(self, blocks: Iterable[Recording], watched: bool = False) -> Iterator[Answered]:
        """Yield each block of a log with its contacts as `Answered`, as soon as these are known.

        For logs (`live=False`) blocks wait until the touches in them end. A sensor may cut blocks where its log begins
        anew.

        Raises:
            InputError: a channel is missing or has another shape.
        """
        pieces = self._wrenches.of_log(self._wrenches.pieces(self.sensor.ready(blocks)))
        threaded = self.threads and self.drift is None
        located = located_in_threads(pieces, self.locator, self.threads) if threaded else self._located(pieces)
        blocks_located = rejoined(located)
        return map(self._answered, smooth_touches(blocks_located, self.locator) if self._whole else blocks_located)

    def contact_wrenches(self, recording: Recording) -> Wrenches:
        """Return the unfiltered `Wrenches` of a recording in the surface's frame, with covariances.

        Raises:
            InputError: a channel is missing or has another shape.
        """
        return self._wrenches.unfiltered(recording)

    def zero_history(self) -> ZeroHistory | None:
        """Return the bias over time since the last reset as a `ZeroHistory`; None if it is not followed."""
        return self._wrenches.history()

    def notes(self) -> tuple[str, ...]:
        """Return remarks on the sensor and the surface so far, a tuple of sentences."""
        return (*self.locator.surface.notes, *self._wrenches.notes())

    def warnings(self) -> tuple[str, ...]:
        """Return possible faults of the sensor, and of its bias if it is followed, a tuple of sentences or ()."""
        return self._wrenches.warnings()

    def _single(self, time: float, reading: ArrayLike, out: Rows, rotation: Known, acceleration: Known) -> int:
        rows = out if len(out) == 1 else out[:1]
        if self._live is None:
            given = self._wrenches.single(time, reading, rotation, acceleration, kelvin=self.kelvin)
            self.locator.run_into(*given, rows)
        else:
            follower = self._wrenches.entered(time, self.kelvin)
            self._live.single(time, reading, rotation, acceleration, rows)
            if follower is not None:
                follower.add(time, follower.sensor.kept_of(follower.sensor.live_inputs, 1))
        self._widened(rows)
        return 1

    def _arrays(self, time: Times, readings: np.ndarray, beside: Channels, out: Rows, counts: Counts) -> int:
        sensor, live = self._compiled, self._live
        if sensor is None or live is None:
            return super()._arrays(time, readings, beside, out, counts)
        count = min(len(time), len(out))
        given = time, readings, out, *beside.values()
        cuts = self._wrenches.cuts(time[:count]) if count else []
        for cut in cuts:
            everything = len(time) == len(out) == cut.stop - cut.start  # as a rule, live: no slices, which take time
            when, read, rows, *channels = given if everything else [each[cut] for each in given]
            known = dict(zip(beside, channels, strict=True))
            follower = self._wrenches.entered(float(when[0]), DriftTracker.kelvin(known))
            inputs = live.inputs(when, read, known)
            live.run(when, rows, inputs)
            if follower is not None:
                follower.add(when, follower.sensor.kept_of(inputs, len(when)))
        self._widened(out[:count])
        counts[:count] = 1
        return count

    def _located(self, pieces: Iterable[tuple[Piece, Wrenches]]) -> Iterator[tuple[Piece, Located]]:
        for piece, wrenches in pieces:
            rows = self.empty(len(piece.samples))
            self.locator.run_into(*wrenches, rows)
            yield piece, Located(piece.samples, *wrenches, rows)

    def _answered(self, located: Located) -> Answered:
        return Answered(located.block, self._widened(located.rows), np.ones(len(located.rows), dtype=np.int64))

    def _widened(self, rows: Float[np.ndarray, "n width"]) -> Float[np.ndarray, "n width"]:
        """Add the placement error to the covariances."""
        if self.placement > 0.0:
            self._widen(rows, self.placement**2)
        return rows

    def _touched(self, taken: Tare) -> str:
        """Return a warning of a steady touch that would read what a tare subtracted; "" if none can."""
        force = 0.0 if taken.touch is None else float(np.linalg.norm(taken.touch[:3]))
        if taken.touch is None or force <= max(self.locator.on, taken.least):
            return ""
        found = self.locator.candidates(self._wrenches.placement.matrix @ taken.touch)
        if not found.plausible.any():
            return ""
        x, y, z = 1e3 * found.point[0]
        return (
            f"the wrench that the tare removes could also be a steady touch of {force:.2g} N at "
            f"({x:.1f}, {y:.1f}, {z:.1f}) mm of the surface: make sure that nothing touched it during the tare"
        )
