"""Gravity and inertia compensation of a six-axis sensor: the payload's wrench, and its part of the covariance."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int8
from numpy.typing import ArrayLike

from palpate.calls import called_as
from palpate.errors import InputError
from palpate.sensors.force_torque.model import ForceTorque
from palpate.signals.filters import Filter
from palpate.signals.motion import Motion
from palpate.signals.payload import Payload
from palpate.signals.recording import ACCELERATION, FORCE, ORIENTATION, TORQUE, UNSTEADY, VIBRATION, Recording
from palpate.signals.rest import at_rest
from palpate.signals.vibration import Vibration
from palpate.signals.wrench_sensor import Placement, Tare, square_root
from palpate.signals.zero_filter import Free, ZeroState
from palpate.spatial._arrays import frozen, shaped
from palpate.spatial.arguments import number, takes_arrays
from palpate.spatial.pose import Pose, skew

EXPLAINED = 2.0  # residual over noise, squared, up to which the noise explains what a payload leaves
ITSELF = Placement(Pose.identity())
SATURATED = 6  # contact.Status.SATURATED, which this layer does not import
_UPRIGHT = frozen(np.eye(3)[None])
_NO_ROTATION, _NO_ACCELERATION, _NO_NUMBER = np.zeros((0, 4)), np.zeros((0, 3)), np.zeros((0, 1))
LEAST_ERROR = 0.02, 0.5e-3  # of the weight, and m of the centre: what a hose, a screw or a gain does to a payload
LEARNT = 0.8  # of the prior standard deviation of the payload's weight: below it, the weight was learnt
SURE = 5.0  # times its standard deviation: a smaller tare is no touch


class _Readings(NamedTuple):
    """Samples as the compiled loops take them, n rows or one for all; `unsteady` is the acceleration's deviation."""

    time: np.ndarray
    wrench: np.ndarray
    rotation: np.ndarray
    acceleration: np.ndarray
    unsteady: np.ndarray
    age: np.ndarray

    def picked(self, rows: Bool[np.ndarray, " n"]) -> _Readings:
        count = len(self.time)
        return _Readings(*(part[rows] if len(part) == count else part for part in self))

    def mean(self) -> _Readings:
        return _Readings(*(part.mean(axis=0, keepdims=True) for part in self))


class _Compensated(NamedTuple):
    """Samples as wrenches, like `Measured`, with the readings that they were computed from, and their `VIBRATION`."""

    time: Float[np.ndarray, " n"]
    wrench: Float[np.ndarray, "n 6"]
    status: Int8[np.ndarray, " n"]
    readings: _Readings
    vibration: Float[np.ndarray, "n 1"] | None = None


@called_as("palpate.Compensation(palpate.ForceTorque(noise=(0.02, 0.001)), palpate.Payload(mass=0.4))")
class Compensation:
    """The `WrenchSensor` of a force/torque sensor and its payload; see `Payload`.

    Args:
        sensor: noise, range and frame of the wrenches.
        payload: payload to compensate; None: none. With an `Imu`, gravity and acceleration are those of its readings,
            the `ACCELERATION` of recordings, and orientations and `motion` are not used.
        motion: source of accelerations in a stream; None: only those of the recordings.

    Raises:
        InputError: the payload has an IMU, and the wrenches are in the base frame.
    """

    channels = (FORCE, TORQUE)
    loop = "palpate.sensors.force_torque._live.locate"

    def __init__(self, sensor: ForceTorque, payload: Payload | None = None, motion: Motion | None = None) -> None:
        from palpate.sensors.force_torque import _kernels as _compensation  # compiled: loaded when first needed

        self.sensor, self.payload, self.motion = sensor, payload, motion
        self._compensate, self._place = _compensation.compensate, _compensation.place
        self._rotate, self._gather = _compensation.rotate, _compensation.gather
        load = Payload() if payload is None else payload
        self._weighs = bool(load.weight.any() or load.covariance[:3, :3].any())
        self._turned, self._drifts = sensor.frame == "base", bool(sensor.drift.any())
        self._imu = load.imu if self._weighs else None
        if self._imu is not None:
            if self._turned:
                what = "wrenches in the base frame need orientations, which a payload with an IMU does not have."
                raise InputError(what, where="force_torque.frame")
            self.loop = ""  # the compiled one knows nothing of an IMU's errors
            self.motion, self._tilts = None, square_root(load.load_covariance)
        self._limits = np.full(6, np.inf) if sensor.limits is None else sensor.limits.copy()
        slope = load.gravity / load.magnitude**2 if load.weight.any() else np.zeros(3)
        self._newtons = float(np.linalg.norm(load.weight))
        self._down = load.weight / self._newtons if self._newtons else np.zeros(3)
        self._load: Float[np.ndarray, "11"] = np.concatenate(
            [load.weight, load.center_of_mass, slope, [load.mass, sensor.lever**-2]]
        )
        self.coefficients, self._heavier = _heavier(load, self._down)
        self._gains = np.repeat([1.0, sensor.lever**2], 3)
        self._bias = np.concatenate([load.force_bias, load.torque_bias])
        self._doubts = square_root(load.covariance if self._imu is None else np.zeros((12, 12)))
        self._turns, self.revision = bool(self.needs_orientation), 0
        self._smoothing: tuple[float, Filter | None, float | None] = (1.0, None, None)
        self._vibration: Vibration | None = None
        self._kept, self._means = (1.0, np.ones(6)), dict[int, Float[np.ndarray, "6 6"]]()
        self._stated, self.zeros_taken = self._load.copy(), 0
        self._untare()
        self.state, self.live_inputs = np.empty(0), np.concatenate([np.zeros(6), np.eye(3).ravel(), np.zeros(5)])
        made = self.measured(np.zeros(1), self.live_inputs)  # compiles, before anything is in a hurry
        self.place(made, made.wrench, np.ones(1), ITSELF)

    @property
    def noise(self) -> Float[np.ndarray, "6 6"] | None:
        """Covariance (6, 6) of the sensor's noise, force first [N, N m]; None where it is not known."""
        return self.sensor.noise

    @property
    def needs_orientation(self) -> str:
        """Reason why samples need the sensor's orientation; "" where they do not."""
        if self._weighs and self._imu is None:
            return "the payload's weight turns with the sensor"
        return "the wrenches are in the base frame" if self._turned else ""

    def ready(self, blocks: Iterable[Recording]) -> Iterator[Recording]:
        """Yield the same samples, with the channels `ACCELERATION` and `UNSTEADY` where `motion` provides them.

        With an orientation and a known noise they have `VIBRATION`, too.

        Raises:
            InputError: channels that the source of accelerations needs are missing.
        """
        if self.motion is None:
            return iter(blocks)
        moved = self.motion.stream(iter(blocks))
        if self.noise is None:
            return moved
        if self._vibration is None:  # blocks of an earlier log keep their numbers
            share, filter, rate = self._smoothing
            self._vibration = Vibration(share * self.noise, filter, rate)
        return self._vibration.stream(moved, self._vibrating)

    def moved(self, channels: Mapping[str, np.ndarray]) -> Mapping[str, np.ndarray]:
        """Return the channels of live samples with accelerations as `single` takes them, as `Motion.live` does."""
        return channels if self.motion is None else self.motion.live(channels)

    def measure(self, recording: Recording) -> _Compensated:
        """Return a recording as `Measured`: contacts' wrenches (n, 6) [N, N m] in the sensor's frame, with statuses.

        Raises:
            InputError: forces or torques are missing, or an orientation is needed (payload with weight, wrenches in the
                base frame) and there is none.
        """
        made = self._compensated(self._readings(recording), self._zero)
        return made._replace(vibration=recording.channels.get(VIBRATION))

    def single(
        self, time: float, reading: ArrayLike, rotation: ArrayLike | None, acceleration: ArrayLike | None
    ) -> _Compensated:
        """Return one sample (see `hold`) as `Measured`: the contact's wrench (1, 6) [N, N m] and its status.

        Raises:
            InputError: the rotation is needed and None, an argument has another shape, or the time is no number.
        """
        if type(time) is not float:
            time = number(time, "time")
        self.hold(time, reading, rotation, acceleration)
        return self.measured(np.array([time], dtype=np.float64), self.live_inputs)

    def hold(self, time: float, reading: ArrayLike, rotation: ArrayLike | None, acceleration: ArrayLike | None) -> None:
        """Write one sample into `live_inputs`.

        Args:
            time: [s].
            reading: (6,) [N, N m] as measured.
            rotation: (3, 3) sensor in base, where it is needed.
            acceleration: (3,) [m/s^2] in the sensor's frame, without gravity; None: 0. Of a payload with an IMU its
                reading, which is needed.

        Raises:
            InputError: the rotation or the IMU's reading is needed and None, or an argument has another shape.
        """
        if self._imu is not None:
            beside = {} if acceleration is None else {ACCELERATION: shaped(acceleration, (3,), "acceleration")[None]}
            rotations, accelerations, unsteady = self._moves(beside, "update")
            self.live_inputs[6:15], self.live_inputs[18] = rotations.ravel(), unsteady[0, 0]
            acceleration = accelerations[0]
        if self._turns:
            if rotation is None:
                raise InputError(f"update needs the orientation of the sensor: {self.needs_orientation}.")
            self.live_inputs[6:15].reshape(3, 3)[:] = shaped(rotation, (3, 3), "rotation")
        self.live_inputs[:6] = shaped(reading, (6,), "reading")
        self.live_inputs[15:18] = 0.0 if acceleration is None else shaped(acceleration, (3,), "acceleration")
        if self._drifts:
            self.live_inputs[19] = self._aged(np.array([time], dtype=np.float64))[0, 0]

    @takes_arrays
    def inputs(
        self,
        time: Float[np.ndarray, " n"],
        readings: Float[np.ndarray, "n 6"],
        extra_channels: Mapping[str, np.ndarray],
    ) -> Float[np.ndarray, " _"]:
        """Return the live inputs (20 n,) of n samples: their readings (n, 6), rotations (n, 3, 3), and so on.

        Then follow accelerations (n, 3), their standard deviations (n,), and ages of the zero (n,) [s].

        Args:
            time: (n,) [s].
            readings: (n, 6) [N, N m] as measured.
            extra_channels: `ORIENTATION`, `ACCELERATION`, `UNSTEADY`, as far as they are known.

        Raises:
            InputError: an array has another shape, or the orientation is needed and there is none.
        """
        count = len(time)
        if readings.shape != (count, 6):
            raise InputError(f"the readings of {count} samples must have shape ({count}, 6), not {readings.shape}.")
        made, ages = np.empty(20 * count), self._aged(time) if self._drifts else _NO_NUMBER
        if self._imu is not None:
            rotations, *moves = self._moves(extra_channels, "the stream")
            self._gather(readings, _NO_ROTATION, moves[0], moves[1].repeat(count, axis=0), ages, made)
            made[6 * count : 15 * count] = rotations.ravel()
            return made
        quaternions = self._quaternions(extra_channels, "the stream") if self._turns else _NO_ROTATION
        known: Mapping[str, np.ndarray] = extra_channels if self._weighs else {}
        moves = known.get(ACCELERATION, _NO_ACCELERATION), known.get(UNSTEADY, _NO_NUMBER)
        self._gather(readings, quaternions, *moves, ages, made)
        return made

    @takes_arrays
    def measured(self, time: Float[np.ndarray, " n"], inputs: Float[np.ndarray, " _"]) -> _Compensated:
        """Return the samples of live inputs (20 n,), at times (n,) [s], as `measure` does.

        Raises:
            InputError: arrays of other shapes.
        """
        n, made = len(time), inputs.copy()
        if len(made) != 20 * n:
            raise InputError(f"inputs of {n} samples must have shape ({20 * n},), not {inputs.shape}.")
        rotations, accelerations = made[6 * n : 15 * n].reshape(n, 3, 3), made[15 * n : 18 * n].reshape(n, 3)
        errors = made[18 * n : 19 * n, None], made[19 * n :, None]
        readings = _Readings(time, made[: 6 * n].reshape(n, 6), rotations, accelerations, *errors)
        return self._compensated(readings, self._zero)

    def constants(self, placement: Placement) -> tuple[np.ndarray, ...]:
        """Return the constant arguments of the compiled `compensate` and `place`, in their order, as arrays."""
        return self._limits, self._load, self._zero, np.array([float(self._turned)]), *self._placing(placement)

    @takes_arrays
    def place(
        self,
        measured: _Compensated,
        wrenches: Float[np.ndarray, "n 6"],
        share: Float[np.ndarray, " k"],
        placement: Placement,
    ) -> tuple[Float[np.ndarray, "n 6"], Float[np.ndarray, "n 6 6"] | None]:
        """Return wrenches (n, 6) [N, N m] in the surface's frame and covariances (n, 6, 6), None if noise is unknown.

        A filter's share does not reduce the errors of payload, tare and mounting.

        Raises:
            InputError: arrays of other shapes.
        """
        located, covariances = np.empty_like(wrenches), np.empty((len(wrenches), 6, 6))
        constant = self._load, *self._placing(placement)
        self._place(wrenches, *measured.readings[2:], share, *constant, located, covariances)
        if self._imu is not None:
            untared = self._unsure is self._doubts
            factor = self._tilts if untared else self._unknown(self._tilts, followed=self._load is not self._stated)
            covariances += self._tilted(measured.readings, placement.matrix, factor)
        if measured.vibration is not None and measured.vibration.any():
            covariances += self._shaken(measured.vibration, placement.matrix)
        return located, None if self.noise is None else covariances

    def smoothed_by(self, filter: Filter | None, rate: float | None, share: float) -> None:
        """Set the filter that wrenches pass before `place`, for covariances of the noise that remains after it.

        Args:
            filter: filter of the wrenches; None: none.
            rate: [Hz] of the samples; None: not known.
            share: least share of white noise's variance that remains after the filter, up to 1.

        Raises:
            InputError: the filter's cut-off does not fit the rate.
        """
        spectrum = self.sensor.spectrum
        self._smoothing, self._vibration = (share, filter, rate), None
        self._kept = 1.0, np.ones(6)
        if filter is not None and rate is not None and spectrum is not None and share < 1.0:
            self._kept = share, spectrum.kept(filter, rate)
        self._placement = None
        self.revision += 1

    def tare(self, recording: Recording) -> Tare:
        """Subtract the mean compensated wrench of a window from now on, and return it as a `Tare`.

        Later covariances contain the mean's error, and the payload's less that in the window.

        Raises:
            InputError: the window has too few samples, is not steady, or lacks forces, torques or an orientation that
                is needed.
        """
        made = self._compensated(self._readings(recording), self._bias, self._stated)
        usable = made.status < 0
        found = at_rest(made.wrench[usable], self.noise, recording.source)
        middle = made.readings.picked(usable).mean()
        self._untare()
        white, _ = self._kept  # below the share after the filter, w A + B of `_constant_in` is no covariance
        share = np.array([1.0 / found.samples if white == 1.0 else max(1.0 / found.samples, white)])
        _, spread = self.place(made._replace(readings=middle), found.mean[None], share, ITSELF)
        largest = found.deviation[:3].max() ** 2 / found.samples if spread is None else spread[0, :3, :3].max()
        rotation, acceleration = middle.rotation[0], middle.acceleration[0]
        weight, slope, mass = self._load[:3], self._load[6:9], self._load[9]
        turn, hanging = rotation.T - np.outer(acceleration, slope), rotation.T @ weight - mass * acceleration
        self._mean = np.concatenate([turn, hanging[None]])
        self._zero = self._bias + found.mean
        self._unsure = self._unknown(self._doubts)
        self._own = self._zero, self._unsure
        self._samples, self._placement = found.samples, None
        self._tared = self._since = float(np.nanmax(made.time))
        self.zeros_taken += 1
        self.revision += 1
        return Tare(found.sentence, touch=found.mean, least=SURE * float(np.sqrt(largest)))

    def reset(self) -> None:
        """Forget the samples so far; the age of the zero counts from the tare, or else from the next sample."""
        self._since = self._tared
        for each in (self.motion, self._vibration):
            if each is not None:
                each.reset()

    def kept(self, recording: Recording) -> Float[np.ndarray, "n 19"]:
        """Return (n, 19): readings (6) [N, N m], rotations by rows (9), accelerations (3), their deviation [m/s^2].

        Raises:
            InputError: forces or torques are missing, or an orientation is needed and there is none.
        """
        inputs = self.inputs(recording.time, recording.wrenches(), recording.channels)
        return self.kept_of(inputs, len(recording))

    @takes_arrays
    def kept_of(self, inputs: Float[np.ndarray, " _"], count: int) -> Float[np.ndarray, "n 19"]:
        """Return the columns (n, 19) of `kept` from the live inputs (20 n,) of `count` samples.

        Raises:
            InputError: inputs has another shape.
        """
        if count == 1:
            return inputs[None, :19].copy()
        parts = np.split(inputs[: 19 * count], [6 * count, 15 * count, 18 * count])
        return np.concatenate([part.reshape(count, -1) for part in parts], axis=1)

    @takes_arrays
    def free(self, kept: Float[np.ndarray, "n 19"]) -> Free:
        """Return a `Free` of readings less the stated payload, NaN if unusable, and how `coefficients` change them.

        Raises:
            InputError: kept has another shape.
        """
        readings = _kept(kept)
        made = self._compensated(readings, np.zeros(6), self._stated)
        usable = made.status < 0
        made.wrench[~usable] = np.nan
        regressor = self._hung(readings.rotation.swapaxes(1, 2) - readings.acceleration[:, :, None] * self._stated[6:9])
        return Free(made.wrench, regressor, bool(np.any(made.status == SATURATED)))

    @takes_arrays
    def window_noise(
        self, kept: Float[np.ndarray, "n 19"], usable: Bool[np.ndarray, " n"]
    ) -> tuple[Float[np.ndarray, "6 6"], Float[np.ndarray, "6 6"]]:
        """Return covariances (6, 6) of a window's mean: the noise's, and that of acceleration and payload.

        The payload's is that of the difference to the pose of the tare.

        Raises:
            InputError: the noise is not known, or arrays have other shapes.
        """
        noise = self._of_mean(int(np.count_nonzero(usable)))
        if self.payload is None:
            return noise, np.zeros((6, 6))
        constant = np.zeros((5, 6, 6))
        push = np.concatenate([np.eye(3), skew(self._load[3:6])])
        constant[1], constant[2] = self._misfit(), self._load[9] ** 2 * push @ push.T
        middle = _kept(kept).picked(usable).mean()
        located, spread = np.empty((1, 6)), np.empty((1, 6, 6))
        unknown = self._unknown(self._doubts, followed=True)
        rest = self._mean, unknown, ITSELF.factor, ITSELF.matrix, constant, located, spread
        self._place(np.zeros((1, 6)), *middle[2:], np.zeros(1), self._stated, *rest)
        if self._imu is not None:
            spread += self._tilted(middle, ITSELF.matrix, self._unknown(self._tilts, followed=True))
        return noise, spread[0]

    @takes_arrays
    def as_wrench(
        self, change: Float[np.ndarray, "n 6"], covariance: Float[np.ndarray, "6 6"]
    ) -> tuple[Float[np.ndarray, "n 6"], Float[np.ndarray, "6 6"]]:
        """Return the changes (n, 6) [N, N m] unchanged, and their covariance (6, 6) plus the last gain error.

        Raises:
            InputError: arrays of other shapes.
        """
        square = float(change[-1] ** 2 @ np.repeat([1.0, self._load[10]], 3)) if len(change) else 0.0
        return change, covariance + self.sensor.gain_error**2 * square * np.diag(self._gains)

    def start(self) -> tuple[float, ZeroState, Float[np.ndarray, "6 q"]]:
        """Return time [s], `ZeroState` and regressor (6, q) of the tare; without one NaN and the payload's biases.

        Raises:
            InputError: the noise is not known.
        """
        spread = self._of_mean(self._samples)
        if self._samples is None and self.payload is not None:
            biases = np.r_[3:6, 9:12]
            spread = self.payload.load_covariance[np.ix_(biases, biases)]
        return self._tared, ZeroState(self._own[0].copy(), np.zeros(0), spread), self._hung(self._mean[:3])

    def follow(self, state: ZeroState | None) -> None:
        """Use a zero [N, N m], a payload's error and their covariance from now on; None: those of the tare."""
        if (state is None) != (self._followed is None):
            self._placement = None
        self._followed, self.revision = state, self.revision + 1
        (self._zero, self._unsure), self._load = self._own, self._stated
        if state is None:
            return
        self._zero, turn = state.zero.copy(), np.eye(len(state.covariance))
        count = len(state.coefficient)
        turn[:6, 6:] = self._hung(self._mean[:3])[:, :count]  # the loops count from the tare's pose
        root = square_root(turn @ state.covariance @ turn.T)
        more = np.zeros((len(root), 12))
        more[:, 3:6], more[:, 9:] = root[:, :3], root[:, 3:6]
        if count:
            newtons = self._newtons + float(state.coefficient[0])
            self._load = self._stated.copy()
            self._load[[0, 1, 2, 9]] *= newtons / self._newtons
            self._load[3:6] += state.coefficient[1:] / newtons
            more[:, :3], more[:, 6:9] = root[:, 6:7] * self._down, root[:, 7:] / newtons
        self._unsure = np.concatenate([self._unknown(self._doubts, followed=count > 0), more])

    def notes(self) -> tuple[str, ...]:
        """Return notes on the motion and on the payload's error where it is followed, a tuple of sentences."""
        if self.payload is None:
            return ()
        moved = () if self.motion is None else self.motion.notes(self.payload.mass)
        vibrating = () if self._vibration is None else self._vibration.notes()
        found, large = self._payload_error()
        return (*moved, *vibrating, *([found] if found and not large else []))

    def warnings(self) -> tuple[str, ...]:
        """Return a sentence, in a tuple, if the payload is further off than its calibration allows; else ()."""
        found, large = self._payload_error()
        return (f"{found}: run `palpate calibrate payload` again",) if large else ()

    def _payload_error(self) -> tuple[str, bool]:
        """Return a sentence on the followed payload's error, "" until it is learnt, and whether it is large."""
        if self._followed is None or not len(self._followed.coefficient):
            return "", False
        off, sure = self._followed.coefficient, np.sqrt(np.diag(self._followed.covariance)[6:])
        if sure[0] > LEARNT * self.coefficients[0]:
            return "", False
        away, known = (1e3 * float(np.linalg.norm(part[1:])) / self._newtons for part in (off, sure))
        return (
            f"the payload weighs {off[0]:+.2g} N ({off[0] / self._newtons:+.1%}) more than stated, known to "
            f"{sure[0]:.1g} N, and its centre is {away:.2g} mm off, known to {known:.1g} mm",
            bool(np.any(np.abs(off) > np.maximum(self.coefficients, 3.0 * sure))),
        )

    def _hung(self, turn: Float[np.ndarray, "*n 3 3"]) -> Float[np.ndarray, "*n 6 q"]:
        """Return the wrench of one more newton of weight, and of each first moment; `turn` is `place`'s A."""
        return (turn @ self._down @ self._heavier.reshape(-1, 3).T).reshape(*turn.shape[:-2], *self._heavier.shape[:2])

    def _unknown(self, factor: Float[np.ndarray, "r p"], *, followed: bool = False) -> Float[np.ndarray, "r p"]:
        """Return a factor of the payload's covariance without its biases, which are in the zero.

        Where weight and centre are followed with the zero, only the weight's direction remains.
        """
        left = factor.copy()
        left[:, 3:6] = left[:, 9:12] = 0.0
        if followed and self._newtons:
            left[:, 6:9] = 0.0
            left[:, :3] -= np.outer(left[:, :3] @ self._down, self._down)
        return left

    def _of_mean(self, count: int | None) -> Float[np.ndarray, "6 6"]:
        """Return the noise's covariance of the mean of `count` readings, 0 for None; raise InputError without noise."""
        if self.noise is None:
            hint = "State noise = { force = ..., torque = ... } in [force_torque]."
            raise InputError("tracking the bias needs the noise of the sensor.", hint=hint)
        if count is None:
            return np.zeros((6, 6))
        if count not in self._means:
            spectrum = self.sensor.spectrum
            shares = np.full(6, 1.0 / count) if spectrum is None else spectrum.of_mean(count)
            self._means[count] = self.noise * _both(shares)
        return self._means[count]

    def _untare(self) -> None:
        self._zero, self._unsure, self._mean = self._bias.copy(), self._doubts, np.zeros((4, 3))
        self._own, self._load = (self._zero, self._unsure), self._stated
        self._followed: ZeroState | None = None
        self._samples: int | None = None
        self._tared = self._since = np.nan  # [s]
        self._placement: Placement | None = None

    def _placing(self, placement: Placement) -> tuple[np.ndarray, ...]:
        """Return the constant arguments of the compiled `place` after the load."""
        return self._mean, self._unsure, placement.factor, placement.matrix, self._constant_in(placement)

    def _constant_in(self, placement: Placement) -> Float[np.ndarray, "5 6 6"]:
        """Return the constant covariances in the surface's frame that the compiled `place` takes.

        With w(t) the share of white noise that remains after a filter and s those of the noise N of each channel,
        w A + B is N at a start, and N s when the filter has settled.
        """
        if placement is self._placement:
            return self._constant
        made, matrix, mass = np.zeros((5, 6, 6)), placement.matrix, float(self._load[9])
        if self.noise is not None:
            push = matrix[:, :3] + matrix[:, 3:] @ skew(self._load[3:6])  # of a force at the payload's centre
            white, kept = self._kept
            shrinks = 1.0 if white == 1.0 else (1.0 - _both(kept)) / (1.0 - white)
            taken = self.noise * shrinks
            made[0] = matrix @ taken @ matrix.T
            stays = self.noise - taken
            if self._followed is None:
                stays = stays + self._of_mean(self._samples)
            made[1] = matrix @ (stays + self._misfit()) @ matrix.T
            made[2] = mass**2 * push @ push.T
            if self._followed is None:
                made[4] = matrix @ np.diag(self.sensor.drift**2) @ matrix.T
            made[3] = self.sensor.gain_error**2 * (matrix * self._gains) @ matrix.T
        self._placement, self._constant = placement, made
        return made

    def _aged(self, time: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 1"]:
        """Return the seconds since the tare or the log's begin; 0 where the time is not known."""
        known = time[np.isfinite(time)]
        if np.isnan(self._since) and len(known):
            self._since = float(known[0])
        return np.nan_to_num(np.maximum(time - self._since, 0.0))[:, None]

    def _misfit(self) -> Float[np.ndarray, "6 6"]:
        """Return the covariance of the payload's residual beyond the noise: gains, cables, a load that moves."""
        if self.payload is None or self.noise is None:
            return np.zeros((6, 6))
        seen, stated = self.payload.residual**2, np.diag(self.noise).reshape(2, 3).mean(axis=1)
        return np.diag(np.repeat(np.where(seen > EXPLAINED * stated, seen - stated, 0.0), 3))

    def _readings(self, recording: Recording) -> _Readings:
        return _Readings(
            recording.time.copy(),
            recording.wrenches(),
            *self._moves(recording.channels, recording.source),
            self._aged(recording.time) if self._drifts else np.zeros((1, 1)),
        )

    def _moves(self, channels: Mapping[str, np.ndarray], source: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return rotations, accelerations and their standard deviation, n rows or one, from poses or from an IMU."""
        if self._imu is None or self.payload is None:
            known: Mapping[str, np.ndarray] = channels if self._weighs else {}
            return (
                self._rotations(channels, source),
                known[ACCELERATION].copy() if ACCELERATION in known else np.zeros((1, 3)),
                known[UNSTEADY].copy() if UNSTEADY in known else np.zeros((1, 1)),
            )
        if ACCELERATION not in channels:
            raise InputError(
                "the payload takes gravity from an IMU, and there are no accelerations.",
                where=source,
                hint='Name the columns or the topic of the IMU in the rig\'s [acceleration], with kind = "imu".',
            )
        return *self._imu.upright(channels[ACCELERATION], self.payload.magnitude), np.full((1, 1), self._imu.noise)

    def _tilted(
        self, readings: _Readings, matrix: Float[np.ndarray, "6 6"], factor: Float[np.ndarray, "r 15"]
    ) -> Float[np.ndarray, "n 6 6"]:
        """Return the covariances of a payload with an IMU in the frame of `matrix`; `factor` is of its parameters."""
        load, payload = self._load, self.payload or Payload()
        inside = readings.rotation.swapaxes(1, 2)
        turn = inside - readings.acceleration[:, :, None] * load[6:9]
        hangs = inside @ load[:3] - load[9] * readings.acceleration
        errors = matrix @ payload.load_jacobian(turn - self._mean[:3], hangs - self._mean[3]) @ factor.T
        return errors @ errors.swapaxes(1, 2)

    def _vibrating(self, recording: Recording) -> Float[np.ndarray, "n 6"]:
        """Return wrenches (n, 6) in the sensor's frame; without the payload only where accelerations are known."""
        if self._turned or ACCELERATION in recording.channels:
            return self.measure(recording).wrench
        return recording.wrenches()

    def _shaken(self, numbers: Float[np.ndarray, "n 1"], matrix: Float[np.ndarray, "6 6"]) -> np.ndarray:
        """Return the covariances (n, 6, 6) of the vibration, in the frame of `matrix`."""
        known = [] if self._vibration is None else self._vibration.covariances
        starts, none = np.flatnonzero(np.diff(numbers[:, 0], prepend=-1.0)), np.zeros((6, 6))
        each = np.stack([known[int(k)] if k < len(known) else none for k in numbers[starts, 0]])
        return np.repeat(matrix @ each @ matrix.T, np.diff(starts, append=len(numbers)), axis=0)

    def _compensated(
        self, readings: _Readings, zero: Float[np.ndarray, "6"], load: Float[np.ndarray, "11"] | None = None
    ) -> _Compensated:
        wrenches, statuses = np.empty_like(readings.wrench), np.empty(len(readings.wrench), np.int8)
        load = self._load if load is None else load
        self._compensate(*readings[1:4], self._limits, load, zero, self._turned, wrenches, statuses)
        return _Compensated(readings.time, wrenches, statuses, readings)

    def _rotations(self, channels: Mapping[str, np.ndarray], source: str) -> Float[np.ndarray, "_ 3 3"]:
        """Return sensor in base, NaN for an invalid quaternion; one identity where it is not needed."""
        if not self.needs_orientation:
            return _UPRIGHT
        quaternions = self._quaternions(channels, source)
        rotations = np.empty((len(quaternions), 3, 3))
        self._rotate(quaternions, rotations)
        return rotations

    def _quaternions(self, channels: Mapping[str, np.ndarray], source: str) -> Float[np.ndarray, "n 4"]:
        quaternions = channels.get(ORIENTATION)
        if quaternions is None:
            raise InputError(
                f"the log has no orientation, and {self.needs_orientation}.",
                where=source,
                hint="Add columns qx, qy, qz, qw (sensor in base), or name them, a topic of poses, or two frames of /tf"
                " (base, sensor) in [orientation].",
            )
        return shaped(quaternions, (None, 4), "the orientation")

    def __repr__(self) -> str:
        return f"Compensation({self.sensor!r}, {self.payload!r})"


def _heavier(load: Payload, down: Float[np.ndarray, "3"]) -> tuple[Float[np.ndarray, " q"], Float[np.ndarray, "6 q 3"]]:
    """Return prior standard deviations of the weight [N] and first moment [N m], and how they act; () without weight.

    With one of them larger by 1, and with u the direction of the weight in the sensor's frame, the payload's wrench is
    larger by (u, c x u) for the weight, and by (0, e x u) for the first moment along each axis e: (6, q, 3) times u.
    """
    if not down.any():
        return np.zeros(0), np.zeros((6, 0, 3))
    newtons, spread = float(np.linalg.norm(load.weight)), load.covariance
    stated = np.sqrt([down @ spread[:3, :3] @ down, *(newtons**2 * np.diag(spread)[6:9])])
    acts = np.zeros((6, 4, 3))
    acts[:3, 0], acts[3:, 0] = np.eye(3), skew(load.center_of_mass)
    acts[3:, 1:] = skew(np.eye(3)).swapaxes(0, 1)
    return np.maximum(stated, newtons * np.repeat(LEAST_ERROR, [1, 3])), acts


def _kept(kept: Float[np.ndarray, "n 19"]) -> _Readings:
    count = len(kept)
    parts = (np.ascontiguousarray(part) for part in np.split(kept, [6, 15, 18], axis=1))
    reading, rotation, acceleration, unsteady = parts
    turned = rotation.reshape(count, 3, 3)
    return _Readings(np.zeros(count), reading, turned, acceleration, unsteady, np.zeros((count, 1)))


def _both(shares: Float[np.ndarray, "6"]) -> Float[np.ndarray, "6 6"]:
    """Return the factors of a covariance's entries for shares of the channels' variances."""
    root = np.sqrt(shares)
    return np.outer(root, root)
