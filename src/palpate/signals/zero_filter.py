"""Follow a sensor's drifting zero with a Kalman filter over windows without contact, and smooth it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from enum import IntEnum
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float, Int8

from palpate.errors import InputError
from palpate.signals.drift import Drift
from palpate.signals.recording import Recording
from palpate.spatial._arrays import Value, shaped
from palpate.spatial.arguments import frozen_value, takes_arrays


class ZeroStatus(IntEnum):
    """Use of a window by the filter of the zero."""

    FREE = 0  # nothing touched: used, or waiting to be
    HELD = 1  # withheld: touched
    CHANGED = 2  # withheld, though no contact of the body explains it
    LOST = 3  # no reading could be used
    FAINT = 4  # withheld: it changed by more than bias, noise and payload explain, and by less than a touch


@takes_arrays
class Free(NamedTuple):
    """Readings less payload and inertia, which without contact are the zero.

    Attributes:
        value: (n, m) in the channels' units; NaN where a reading is missing or saturated.
        regressor: (n, m, q) error of the channels where each of q coefficients is off by one.
        full: True if a channel was at its range.
    """

    value: Float[np.ndarray, "n m"]
    regressor: Float[np.ndarray, "n m q"]
    full: bool


@takes_arrays
class ZeroState(NamedTuple):
    """Estimate of the zero at a time.

    Attributes:
        zero: (m,) in the channels' units.
        coefficient: (q,), such as the payload's weight [N] beyond the one that is compensated, and its first moment.
        covariance: (m + q, m + q) of both.
    """

    zero: Float[np.ndarray, " m"]
    coefficient: Float[np.ndarray, " q"]
    covariance: Float[np.ndarray, "k k"]


@runtime_checkable
class FollowedSensor(Protocol):
    """A wrench sensor of m channels whose zero can be followed."""

    live_inputs: Float[np.ndarray, " _"]
    """Inputs of one live sample."""
    zeros_taken: int
    """Number that changes with every tare."""
    coefficients: Float[np.ndarray, " q"]
    """Prior standard deviations of what is followed with the m channels: weight [N] and first moment of a payload."""

    def kept(self, recording: Recording) -> Float[np.ndarray, "n k"]:
        """Return the rows (n, k) of a recording that `free` needs."""
        ...

    def kept_of(self, inputs: Float[np.ndarray, " _"], count: int) -> Float[np.ndarray, "n k"]:
        """Return the rows (count, k) that `free` needs from the live inputs of `count` samples."""
        ...

    def free(self, kept: Float[np.ndarray, "n k"]) -> Free:
        """Return the readings of kept rows less payload and inertia, as a `Free`."""
        ...

    def window_noise(
        self, kept: Float[np.ndarray, "n k"], usable: Bool[np.ndarray, " n"]
    ) -> tuple[Float[np.ndarray, "m m"], Float[np.ndarray, "m m"]]:
        """Return two covariances (m, m) of a window's mean: of noise, and of errors common to all windows."""
        ...

    def as_wrench(
        self, change: Float[np.ndarray, "n m"], covariance: Float[np.ndarray, "m m"]
    ) -> tuple[Float[np.ndarray, "n 6"], Float[np.ndarray, "6 6"]]:
        """Return channels' changes as wrenches (n, 6) in the sensor's frame, and the covariance (6, 6) of the last."""
        ...

    def start(self) -> tuple[float, ZeroState, Float[np.ndarray, "m q"]]:
        """Return the sensor's own zero: its time [s] (NaN: not known), its `ZeroState`, and its regressors (m, q)."""
        ...

    def follow(self, state: ZeroState | None) -> None:
        """Subtract a zero from now on, and add its covariance to that of every wrench; None: the sensor's own zero."""
        ...


class ZeroWindow(NamedTuple):
    """Mean of some 0.1 s of readings, which is the zero if there is no contact.

    Attributes:
        time: mean [s].
        value: (m,) in the channels' units.
        regressor: (m, q), see `Free`.
        noise: (m, m) covariance of the value, independent from window to window.
        stays: (m, m) covariance of the value that is common to all windows.
    """

    time: float
    value: Float[np.ndarray, " m"]
    regressor: Float[np.ndarray, "m q"]
    noise: Float[np.ndarray, "m m"]
    stays: Float[np.ndarray, "m m"]


class FilterStep(NamedTuple):
    """Step of the filter over a window, kept for `smoothed`.

    Attributes:
        number: of the window.
        state: (n,) predicted, before the window was used.
        covariance: (n, n) of this state.
        turn: (n, n) F, from the step before.
        gained: H' S^-1 y, H' S^-1 H and I - K H of a window that was used; None: it was not.
    """

    number: int
    state: Float[np.ndarray, " n"]
    covariance: Float[np.ndarray, "n n"]
    turn: Float[np.ndarray, "n n"]
    gained: tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n n"], Float[np.ndarray, "n n"]] | None


class ZeroFilter:
    """Kalman filter of zero b, coefficients c and rate r of a `Drift`, whose windows read b + h c + noise.

    With e = s (1 - exp(-t/s)) and s = `settling` (e = t if s is infinite), predicted by t,

        b <- b + e r,    r <- exp(-t/s) r,    P_b <- P_b + e (P_br + P_rb) + e^2 P_r + walk^2 t.

    Args:
        drift: of the m channels.
        coefficients: (q,) prior standard deviations of c.

    Raises:
        InputError: `coefficients` is not an array of q numbers.
    """

    def __init__(self, drift: Drift, coefficients: Float[np.ndarray, " q"]) -> None:
        coefficients = shaped(coefficients, (None,), "coefficients")
        self.drift, self._deviation = drift, coefficients
        self.channels, self.known = len(drift.walk), len(drift.walk) + len(coefficients)
        self._rates = bool(drift.warm_up.any())
        size = self.known + self.channels * self._rates
        self.time = np.nan
        self.state: np.ndarray = np.zeros(size)
        self.covariance: np.ndarray = np.zeros((size, size))
        self._each, self._walks = np.arange(self.channels), drift.walk**2
        nothing = self.state, self.covariance, np.eye(size)
        self._asked: tuple[float, np.ndarray, tuple[np.ndarray, np.ndarray, np.ndarray]] = np.nan, nothing[1], nothing

    def start(
        self,
        time: float,
        zero: Float[np.ndarray, " m"],
        covariance: Float[np.ndarray, "m m"],
        regressor: Float[np.ndarray, "m q"] | None = None,
    ) -> None:
        """Set time, state and covariance to those of a tare, which determines b + h c only.

        Args:
            time: [s] of the tare.
            zero: (m,) in the channels' units.
            covariance: (m, m) of the zero.
            regressor: (m, q) h of the tare's pose; None: 0.
        """
        m, k = self.channels, self.known
        self.time = time
        self.state, self.covariance = np.zeros_like(self.state), np.zeros_like(self.covariance)
        self.state[:m], self.covariance[:m, :m] = zero, covariance
        rates = self.drift.warm_up if self._rates else np.empty(0)
        spread = np.concatenate([np.zeros(m), self._deviation, rates])
        self.covariance[np.diag_indices(len(spread))] += spread**2
        if regressor is not None:
            both = regressor * self._deviation**2
            self.covariance[:m, :m] += both @ regressor.T
            self.covariance[:m, m:k] = -both
            self.covariance[m:k, :m] = -both.T

    def predicted(self, time: float) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n n"]]:
        """Return state (n,) and covariance (n, n) predicted for a time [s]; unchanged if it is earlier than the last.

        The state is zero, coefficients and, if the sensor warms up, rates.
        """
        return self._predicted(time)[:2]

    def at(self, time: float) -> ZeroState:
        """Return the `ZeroState` predicted for a time [s]."""
        return self.known_of(*self.predicted(time))

    def known_of(self, state: Float[np.ndarray, " n"], covariance: Float[np.ndarray, "n n"]) -> ZeroState:
        """Return the `ZeroState` of a state (n,) and covariance (n, n) of the filter."""
        m, k = self.channels, self.known
        return ZeroState(state[:m].copy(), state[m:k].copy(), covariance[:k, :k].copy())

    def expected(
        self, time: float, regressor: Float[np.ndarray, "m q"]
    ) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, "m m"]]:
        """Return the predicted mean (m,) of a window at a time [s], and its covariance (m, m) without the noise.

        Raises:
            InputError: the regressors do not have shape (m, q).
        """
        state, covariance = self.predicted(time)
        m, k = self.channels, self.known
        return state[:m] + regressor @ state[m:k], self.spread(covariance, regressor)

    def spread(self, covariance: Float[np.ndarray, "n n"], regressor: Float[np.ndarray, "m q"]) -> np.ndarray:
        """Return the covariance (m, m) of a window's mean without noise, by that of the state (n, n).

        Raises:
            InputError: the regressors do not have shape (m, q).
        """
        seen, m = self._seen(regressor), self.channels
        return seen @ covariance @ seen.T if regressor.shape[1] else covariance[:m, :m]

    def spread_by(self, regressor: Float[np.ndarray, "m q"]) -> Float[np.ndarray, "m m"]:
        """Return the covariance (m, m) of coefficients that act by a change of regressors (m, q)."""
        m, k = self.channels, self.known
        return regressor @ self.covariance[m:k, m:k] @ regressor.T

    def advance(self, time: float, number: int = 0) -> FilterStep:
        """Move the filter to a window's time [s] without using the window; return the `FilterStep`."""
        state, covariance, turn = self._predicted(time)
        self.state, self.covariance, self.time = state, covariance, time
        return FilterStep(number, state, covariance, turn, None)

    def update(self, window: ZeroWindow, number: int = 0) -> FilterStep:
        """Move the filter to a window without contact and use it; return the `FilterStep`.

        Raises:
            InputError: the window's regressors do not have shape (m, q).
        """
        node = self.advance(window.time, number)
        seen = self._seen(window.regressor)
        noise = window.noise + window.stays
        inverse = np.linalg.inv(seen @ self.covariance @ seen.T + noise)
        back = seen.T @ inverse  # H' S^-1
        gain: np.ndarray = self.covariance @ back
        left: np.ndarray = window.value - seen @ self.state
        keeps = np.eye(len(self.state)) - gain @ seen
        whole = keeps @ self.covariance @ keeps.T + gain @ noise @ gain.T
        self.state, self.covariance = self.state + gain @ left, (whole + whole.T) / 2.0
        return node._replace(gained=(back @ left, back @ seen, keeps))

    def widen(self, covariance: Float[np.ndarray, "m m"]) -> None:
        """Add a covariance (m, m) to that of the zero, after a jump."""
        m = self.channels
        self.covariance = self.covariance.copy()
        self.covariance[:m, :m] += covariance

    def _predicted(self, time: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return state, covariance and F; the last result is cached."""
        if self._asked[0] == time and self._asked[1] is self.covariance:
            return self._asked[2]
        k = self.known
        passed, turn = max(time - self.time, 0.0), np.eye(len(self.state))
        covariance, state = self.covariance, self.state
        if self._rates:
            settling, each = self.drift.settling, self._each
            turn[each, k + each] = passed if np.isinf(settling) else -settling * np.expm1(-passed / settling)
            turn[k + each, k + each] = np.exp(-passed / settling)
            state, covariance = turn @ state, turn @ covariance @ turn.T
            covariance = (covariance + covariance.T) / 2.0
        else:
            covariance = covariance.copy()
        covariance[self._each, self._each] += self._walks * passed
        self._asked = time, self.covariance, (state, covariance, turn)
        return self._asked[2]

    def _seen(self, regressor: Float[np.ndarray, "m q"]) -> Float[np.ndarray, "m n"]:
        """Return H = (I, h, 0)."""
        m, k = self.channels, self.known
        if regressor.shape != (m, k - m):
            raise InputError(f"the regressors must have shape ({m}, {k - m}), not {regressor.shape}.")
        seen = np.zeros((m, len(self.state)))
        seen[:, :m], seen[:, m:k] = np.eye(m), regressor
        return seen


def smoothed(
    nodes: Sequence[FilterStep], count: int | None = None
) -> Iterator[tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n n"]]]:
    """Yield state (n,) and covariance (n, n) of each step given all later ones, from the last to the first.

    The modified Bryson-Frazier form of the fixed-interval smoother [Bierman 1977]:

        x_s = x - P l,    P_s = P - P L P,

    with l <- (I - K H)' l - H' S^-1 y and L <- (I - K H)' L (I - K H) + H' S^-1 H where a window was used, and
    l <- F' l, L <- F' L F from step to step backwards, from 0 after the last.

    Args:
        nodes: steps in the order of time.
        count: number of the first steps to yield; None: all.
    """
    wanted = len(nodes) if count is None else count
    size = len(nodes[-1].state) if nodes else 0
    pull: np.ndarray = np.zeros(size)
    weight: np.ndarray = np.zeros((size, size))
    for number in range(len(nodes) - 1, -1, -1):
        node = nodes[number]
        if node.gained is not None:
            residual, precision, keeps = node.gained
            pull = keeps.T @ pull - residual
            weight = keeps.T @ weight @ keeps + precision
        if number < wanted:
            spread = node.covariance - node.covariance @ weight @ node.covariance
            yield node.state - node.covariance @ pull, (spread + spread.T) / 2.0
        pull, weight = node.turn.T @ pull, node.turn.T @ weight @ node.turn
        weight = (weight + weight.T) / 2.0


@frozen_value
class ZeroHistory(Value):
    """The zero over time, at some of the windows, evenly spread.

    Attributes:
        time: (n,) [s].
        zero: (n, m) in the channels' units.
        deviation: (n, m) its standard deviation.
        coefficient: (n, q).
        status: (n,) `ZeroStatus` as int8.
    """

    time: Float[np.ndarray, " n"]
    zero: Float[np.ndarray, "n m"]
    deviation: Float[np.ndarray, "n m"]
    coefficient: Float[np.ndarray, "n q"]
    status: Int8[np.ndarray, " n"]

    def __post_init__(self) -> None:
        for value in vars(self).values():
            value.flags.writeable = False
