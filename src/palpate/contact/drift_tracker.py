"""Follow the bias of a wrench sensor while nothing touches: windows, gate, filter, record."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from itertools import pairwise
from math import floor, isfinite
from typing import TypeVar

import numpy as np
from jaxtyping import Float

from palpate.contact.drift_gate import ContactShape, Decided, DriftGate
from palpate.contact.zero_record import ZeroRecord
from palpate.errors import InputError
from palpate.signals.drift import Drift
from palpate.signals.recording import TEMPERATURE, Recording
from palpate.signals.zero_filter import (
    FilterStep,
    FollowedSensor,
    Free,
    ZeroFilter,
    ZeroHistory,
    ZeroState,
    ZeroStatus,
    ZeroWindow,
    smoothed,
)
from palpate.spatial._arrays import shaped

__all__ = ["WINDOW"]

WINDOW = 0.1  # s: short beside a touch, long enough for some samples
AHEAD = 100  # free windows after one that are waited for on logs: more hardly change it
LONGEST = 6000  # windows that wait: ten minutes
T = TypeVar("T")


class DriftTracker:
    """Tracker of one sensor's bias, window by window on a grid of the clock, however blocks are cut.

    `enter` ends one window and begins the next, before its samples are measured; `add` takes their readings:

        for piece in follower.pieces(time):
            follower.enter(float(time[piece][0]), kelvin)   # the sensor's bias is now that of this window
            ...                                     # measure, place, locate
            follower.add(time[piece], sensor.kept(...))

    Args:
        sensor: wrench sensor.
        drift: model of the drift of its bias.
        shape: test of whether one contact of the body explains a wrench.
        alone: the body is never touched at two places at once (`DriftGate`).
        smooth: for logs: windows are kept until they are smoothed (`settled`), and the sensor is not changed.

    Attributes:
        count: number of windows that have ended, which is the number of the next.

    Raises:
        InputError: a drift of other channels than the sensor's, or a sensor whose noise is not known.
    """

    def __init__(
        self, sensor: FollowedSensor, drift: Drift, shape: ContactShape, alone: bool = False, smooth: bool = False
    ) -> None:
        _, begin, _ = sensor.start()
        if len(begin.zero) != len(drift.walk):
            raise InputError(
                f"must be stated for {len(begin.zero)} channels, as the sensor has, not for {len(drift.walk)}.",
                where="drift",
            )
        priors = sensor.coefficients.copy()
        priors[:1] = np.maximum(priors[:1], drift.weight)
        self._weighs = len(priors)
        self._warms = bool(drift.thermal.any() or drift.thermal_deviation.any())
        self.sensor, self.drift, self.smooth = sensor, drift, smooth
        slopes = drift.thermal_deviation if self._warms else np.empty(0)
        self._priors, self._shape = np.concatenate([priors, slopes]), (shape, alone)
        self.reset()

    def reset(self) -> None:
        """Begin anew from the sensor's tared bias, without windows, jumps and history."""
        self.filter = ZeroFilter(self.drift, self._priors)
        self.gate = DriftGate(self.filter, self.sensor, *self._shape)
        self._record: ZeroRecord = ZeroRecord(self.sensor)
        self.count: int = 0
        self._window: int | None = None
        self._parts, self._times = list[np.ndarray](), list[np.ndarray]()
        self._touched: bool | None = None
        self._waiting = dict[int, ZeroWindow]()
        self._nodes, self._ready = deque[FilterStep](), deque[ZeroState]()
        self._used = 0
        self._statuses = deque[tuple[float, ZeroStatus, float]]()
        self._kelvin = self._first_kelvin = np.nan  # of the window that was entered, and of the zero's start
        self._tared = np.nan
        self._taken = self.sensor.zeros_taken
        self.sensor.follow(None)

    @staticmethod
    def pieces(time: Float[np.ndarray, " n"]) -> Iterator[slice]:
        """Yield slices of a block's times (n,) [s], one for each window of 0.1 s; NaN belongs to the window before.

        Raises:
            InputError: the times have another shape.
        """
        time = shaped(time, (None,), "time")
        if not len(time):
            return
        windows = np.floor(time / WINDOW)
        windows = windows[np.maximum.accumulate(np.where(np.isfinite(windows), np.arange(len(time)), 0))]
        changes = np.flatnonzero((windows[1:] != windows[:-1]) & np.isfinite(windows[1:])) + 1
        for begin, end in pairwise([0, *changes.tolist(), len(time)]):
            yield slice(begin, end)

    @staticmethod
    def kelvin(channels: Mapping[str, np.ndarray]) -> float:
        """Return the first sample's temperature [K or degrees C]; NaN if the channels have none."""
        return float(channels[TEMPERATURE].flat[0]) if TEMPERATURE in channels else np.nan

    def enter(self, time: float, kelvin: float = np.nan) -> bool:
        """Announce the next samples; return whether another window begins, which ends the one before.

        Args:
            time: [s] of the first of them.
            kelvin: temperature of the sensor [K or degrees C]; NaN: unchanged.
        """
        if self.sensor.zeros_taken != self._taken:
            self.restart()
        window = self._window if not isfinite(time) else floor(time / WINDOW)
        if window == self._window or window is None:
            return False
        self.close()
        self._window = window
        middle = (window + 0.5) * WINDOW
        self._kelvin = kelvin if isfinite(kelvin) else self._kelvin
        self._first_kelvin = self._first_kelvin if isfinite(self._first_kelvin) else self._kelvin
        if np.isnan(self.filter.time):
            self._tared, state, regressor = self.sensor.start()
            begun = time if np.isnan(self._tared) else min(self._tared, time)
            during = 0.0 if np.isnan(self._tared) else self._tared - begun  # s: of a log, all of the tare is ahead
            wandered = self.drift.walk**2 * during + (self.drift.warm_up * during) ** 2
            spread = state.covariance + np.diag(wandered)
            self.filter.start(begun, state.zero, spread, self._regressor(regressor, self._warmer(self._kelvin)))
        if not self.smooth:
            self.sensor.follow(self.at(middle))
        return True

    def add(
        self, time: float | Float[np.ndarray, " n"], kept: Float[np.ndarray, "n k"], touched: bool | None = None
    ) -> None:
        """Add n samples to the window that was entered.

        Args:
            time: (n,) [s] of each sample, or a number for one.
            kept: (n, k) result of `FollowedSensor.kept` for them.
            touched: whether a skin over the complete body feels a touch; None: there is no skin.
        """
        self._times.append(np.array(time, dtype=np.float64, ndmin=1))
        self._parts.append(kept)
        if touched is not None:
            self._touched = touched or bool(self._touched)

    def close(self) -> None:
        """End the window that was entered; the gate decides on it."""
        if self._window is None or not self._parts:
            return
        time, kept = np.concatenate(self._times), np.concatenate(self._parts)
        touched, number = self._touched, self.count
        self._times, self._parts, self._touched = [], [], None
        self.count += 1
        free, warmer = self.sensor.free(kept), self._warmer(self._kelvin)
        if warmer:
            free = free._replace(value=free.value - self.drift.thermal * warmer)
        usable = np.isfinite(free.value).all(axis=1) & np.isfinite(free.regressor).all(axis=(1, 2)) & np.isfinite(time)
        middle = (self._window + 0.5) * WINDOW
        if not usable.any():
            self._waiting[number] = ZeroWindow(middle, *self._nothing())
            self._settle(Decided([*self.gate.finish(), number], [], None, ZeroStatus.LOST), middle)
            return
        noise, stays = self.sensor.window_noise(kept, usable)
        regressor = self._regressor(free.regressor[usable].mean(axis=0), warmer)
        window = ZeroWindow(float(time[usable].mean()), free.value[usable].mean(axis=0), regressor, noise, stays)
        self._waiting[number] = window
        if window.time <= self._tared:  # the tare has it already
            self._settle(Decided([number], [], None, ZeroStatus.FREE), middle)
            return
        strength = self._strength(window, free, usable, noise * np.count_nonzero(usable))
        self._settle(self.gate.judge(number, window, strength, free.full, touched), middle)

    def restart(self) -> None:
        """Decide on the windows so far, and begin anew after another tare of the sensor, with jumps and history."""
        self.finish()
        known = self._ready, self._record, self.count, self.gate.jumps
        self.reset()
        self._ready, self._record, self.count, self.gate.jumps = known

    def finish(self) -> None:
        """End the log: decide on all windows, so that `settled` yields their biases."""
        self.close()
        self._pass(self.gate.finish())
        if self.smooth:
            self._smooth(len(self._nodes))

    def at(self, time: float) -> ZeroState:
        """Return the bias at a time [s], as a `ZeroState`, if the sensor is as warm as in the entered window."""
        return self._warmed(self.filter.at(time), self._kelvin)

    def settled(self) -> Iterator[ZeroState]:
        """Yield the smoothed bias of each window with samples, a `ZeroState`, as far as they are known."""
        while self._ready:
            yield self._ready.popleft()

    def both_sides(self, pieces: Iterable[tuple[Recording, bool | None, T]]) -> Iterator[tuple[T, ZeroState | None]]:
        """Yield (item, smoothed bias) for each piece of a log, in order, once enough later samples are known.

        The bias is the `ZeroState` of the piece's window; None if no window has samples.

        Args:
            pieces: (samples of one window or a part of it, `touched` as in `add`, the item to yield).
        """
        waiting, zeros, done = deque[tuple[int, T]](), deque[ZeroState](), 0  # done: windows whose zeros were taken
        for samples, touched, what in pieces:
            if len(samples):
                self.enter(float(samples.time[0]), self.kelvin(samples.channels))
                self.add(samples.time, self.sensor.kept(samples), touched)
            waiting.append((self.count, what))
            zeros.extend(self.settled())
            while waiting and waiting[0][0] < done + len(zeros):
                number, known = waiting.popleft()
                while done < number:
                    zeros.popleft()
                    done += 1
                yield known, zeros[0]
        self.finish()
        zeros.extend(self.settled())
        last = zeros[0] if zeros else None
        for number, known in waiting:
            while done < number and zeros:
                last = zeros.popleft()
                done += 1
            yield known, zeros[0] if zeros else last

    def history(self) -> ZeroHistory:
        """Return the bias over the windows so far as a `ZeroHistory`, thinned if there are many."""
        return self._record.value()

    def notes(self) -> tuple[str, ...]:
        """Return how far the bias was followed, and the share of the time in which it was not, a tuple of sentences."""
        said = self._record.notes(self.gate.jumps)
        if self._warms and said and np.isnan(self._first_kelvin):
            return (
                *said,
                "no temperature was received, so its effect on the zero (thermal in [drift]) was not removed",
            )
        return said

    def warnings(self) -> tuple[str, ...]:
        """Return warnings of changes not followed and of a bias rarely followed, a tuple of sentences or ()."""
        return self._record.warnings(self.gate.jumps)

    def _nothing(self) -> tuple[np.ndarray, ...]:
        m, q = self.filter.channels, self.filter.known - self.filter.channels
        return np.zeros(m), np.zeros((m, q)), np.eye(m), np.zeros((m, m))

    def _warmer(self, kelvin: float) -> float:
        """Return the temperature [K] above that of the start; 0 if unknown."""
        passed = kelvin - self._first_kelvin if self._warms else 0.0
        return passed if isfinite(passed) else 0.0

    def _regressor(self, weights: Float[np.ndarray, "m q"], warmer: float) -> Float[np.ndarray, "m k"]:
        """Return slopes (m, k) of a window by each coefficient: weight of the payload, slope of each channel."""
        return np.concatenate([weights, warmer * np.eye(len(weights))], axis=1) if self._warms else weights

    def _warmed(self, state: ZeroState, kelvin: float) -> ZeroState:
        """Return the bias at a temperature, with the uncertainty of the slopes."""
        if not self._warms:
            return state
        warmer, kept = self._warmer(kelvin), len(state.zero) + self._weighs
        ways = np.concatenate([np.eye(kept), np.zeros((kept, len(state.zero)))], axis=1)
        ways[: len(state.zero), kept:] = warmer * np.eye(len(state.zero))
        zero = state.zero + warmer * (self.drift.thermal + state.coefficient[self._weighs :])
        return ZeroState(zero, state.coefficient[: self._weighs], ways @ state.covariance @ ways.T)

    def _strength(self, window: ZeroWindow, free: Free, usable: np.ndarray, noise: Float[np.ndarray, "m m"]) -> float:
        expected, spread = self.filter.expected(window.time, window.regressor)
        wrenches, _ = self.sensor.as_wrench(free.value[usable] - expected, noise)
        _, covariance = self.sensor.as_wrench(np.zeros((0, len(expected))), noise + spread + window.stays)
        forces = wrenches[:, :3]
        square = np.einsum("ni,ni->n", forces, np.linalg.solve(covariance[:3, :3], forces.T).T)
        return float(np.sqrt(square.max()))

    def _settle(self, decided: Decided, time: float) -> None:
        """Pass decided windows to the filter, or past it; record the status of the window at `time` [s]."""
        self._statuses.append((time, decided.status, self._kelvin))
        self._pass(decided.unused)
        if decided.jump is not None:
            self.filter.widen(np.outer(decided.jump, decided.jump))
        for number in decided.used:
            self._keep(self.filter.update(self._waiting.pop(number), number))
        if not self.smooth:
            self._record.add(time, self.at(time), decided.status)
            self._statuses.clear()

    def _pass(self, numbers: list[int]) -> None:
        for number in numbers:
            self._keep(self.filter.advance(self._waiting.pop(number).time, number))

    def _keep(self, node: FilterStep) -> None:
        """Keep a step for the smoother, and smooth those that enough free windows follow."""
        if not self.smooth:
            return
        self._nodes.append(node)
        self._used += node.gained is not None
        if self._used >= 2 * AHEAD:
            left, count = AHEAD, len(self._nodes)
            while left:
                count -= 1
                left -= self._nodes[count].gained is not None
            self._smooth(count)
        elif len(self._nodes) > LONGEST:
            self._smooth(len(self._nodes))

    def _smooth(self, count: int) -> None:
        found = [self.filter.known_of(*one) for one in smoothed(list(self._nodes), count)][::-1]
        for plain in found:
            time, status, kelvin = self._statuses.popleft()
            state = self._warmed(plain, kelvin)
            self._ready.append(state)
            self._record.add(time, state, status)
            self._used -= self._nodes.popleft().gained is not None
