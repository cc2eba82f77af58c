"""The zero of a sensor as it wanders: a Kalman filter over windows in which nothing touches, and its smoother."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float, Int8

from palpate.errors import InputError
from palpate.signals.drift import Drift
from palpate.signals.recording import Recording
from palpate.spatial._arrays import Value, shaped
from palpate.spatial.arguments import takes_arrays

__all__ = [
    "FilterStep",
    "FollowedSensor",
    "Free",
    "ZeroFilter",
    "ZeroHistory",
    "ZeroState",
    "ZeroStatus",
    "ZeroWindow",
    "smoothed",
]


class ZeroStatus(IntEnum):
    """What became of a window; stored as int8."""

    FREE = 0  # nothing touched: used, or waiting to be
    HELD = 1  # touched, or it may be
    CHANGED = 2  # held, though no contact of the body explains it
    LOST = 3  # no reading could be used


@takes_arrays
class Free(NamedTuple):
    """Readings less payload and inertia, as they are without contact: the zero.

    Attributes:
        value: (n, m) in the channels' units; NaN where a reading is none, or saturated.
        regressor: (n, m, q) by which channels err where each of q coefficients is one off.
        full: whether a channel was at its range.
    """

    value: Float[np.ndarray, "n m"]
    regressor: Float[np.ndarray, "n m q"]
    full: bool


@takes_arrays
class ZeroState(NamedTuple):
    """What is known of the zero at a time.

    Attributes:
        zero: (m,); coefficient: (q,), such as the payload's weight [N] beyond the one that is compensated.
        covariance: (m + q, m + q) of both.
    """

    zero: Float[np.ndarray, " m"]
    coefficient: Float[np.ndarray, " q"]
    covariance: Float[np.ndarray, "k k"]


@runtime_checkable
class FollowedSensor(Protocol):
    """A sensor of wrenches whose zero can be followed; readings of a window are kept as rows (n, k) of its own."""

    live_inputs: Float[np.ndarray, " _"]
    """Inputs of one live sample."""
    zeros_taken: int
    """Changes with every tare."""

    @property
    def coefficients(self) -> int:
        """q, what is followed beside the m channels: 1 where a payload weighs, else 0."""
        ...

    def kept(self, recording: Recording) -> Float[np.ndarray, "n k"]:
        """Of a recording, what `free` needs."""
        ...

    def kept_of(self, inputs: Float[np.ndarray, " _"], count: int) -> Float[np.ndarray, "n k"]:
        """The same of live inputs of so many samples, as `held` and `inputs` lay them out."""
        ...

    def free(self, kept: Float[np.ndarray, "n k"]) -> Free:
        """What the channels read, if nothing touches."""
        ...

    def window_noise(
        self, kept: Float[np.ndarray, "n k"], usable: Bool[np.ndarray, " n"]
    ) -> tuple[Float[np.ndarray, "m m"], Float[np.ndarray, "m m"]]:
        """Covariance of the mean of a window: of noise, which more windows average, and of what they do not."""
        ...

    def as_wrench(
        self, change: Float[np.ndarray, "n m"], covariance: Float[np.ndarray, "m m"]
    ) -> tuple[Float[np.ndarray, "n 6"], Float[np.ndarray, "6 6"]]:
        """Changes of the channels as wrenches in the sensor's frame, and the covariance of the last."""
        ...

    def start(self) -> tuple[float, ZeroState, Float[np.ndarray, "m q"]]:
        """When its own zero was taken [s] (NaN: not known), how well it is known, and the regressors of then."""
        ...

    def follow(self, state: ZeroState | None) -> None:
        """Take this zero off from now on, its covariance in every wrench; None: its own again."""
        ...


class ZeroWindow(NamedTuple):
    """The mean of some 0.1 s of readings, if nothing touches.

    Attributes:
        time: [s], the mean.
        value: (m,); regressor: (m, q).
        noise, stays: (m, m) covariance of the value: what more windows average, and what they do not.
    """

    time: float
    value: Float[np.ndarray, " m"]
    regressor: Float[np.ndarray, "m q"]
    noise: Float[np.ndarray, "m m"]
    stays: Float[np.ndarray, "m m"]


class FilterStep(NamedTuple):
    """A window as the filter passed it, for the smoother.

    Attributes:
        number: of the window.
        state, covariance: predicted, before it was used.
        turn: F, from the node before.
        gained: of a window that was used: H' S^-1 y, H' S^-1 H and I - K H; None: it was not.
    """

    number: int
    state: Float[np.ndarray, " n"]
    covariance: Float[np.ndarray, "n n"]
    turn: Float[np.ndarray, "n n"]
    gained: tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n n"], Float[np.ndarray, "n n"]] | None


class ZeroFilter:
    """Zero b, coefficients c and rate r of a `Drift`, by a Kalman filter whose windows read b + h c + noise.

    Ahead by t, with e = s (1 - exp(-t/s)) and s = `settling` (e = t for one that does not end),

        b <- b + e r,    r <- exp(-t/s) r,    P_b <- P_b + e (P_br + P_rb) + e^2 P_r + walk^2 t.

    Args:
        drift: of the m channels.
        coefficients: (q,) deviations, before anything was seen, of what is wrong by the same in every window.
    """

    def __init__(self, drift: Drift, coefficients: Float[np.ndarray, " q"]) -> None:
        coefficients = shaped(coefficients, (None,), "coefficients")
        self.drift, self._deviation = drift, coefficients
        self.channels, self.known = len(drift.walk), len(drift.walk) + len(coefficients)
        self._rates = bool(drift.warm_up.any())
        size = self.known + self.channels * self._rates
        self.time, self.state, self.covariance = np.nan, np.zeros(size), np.zeros((size, size))
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
        """From the zero of a tare, b + h c with the h of its pose, which tells neither c nor rates."""
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
        """State and covariance then; where time runs back, as they stand."""
        state, covariance, _ = self._predicted(time)
        return state, covariance

    def at(self, time: float) -> ZeroState:
        """Of the zero alone, then."""
        return self.known_of(*self.predicted(time))

    def known_of(self, state: Float[np.ndarray, " n"], covariance: Float[np.ndarray, "n n"]) -> ZeroState:
        """Without the rates."""
        m, k = self.channels, self.known
        return ZeroState(state[:m].copy(), state[m:k].copy(), covariance[:k, :k].copy())

    def expected(
        self, time: float, regressor: Float[np.ndarray, "m q"]
    ) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, "m m"]]:
        """What a window then would read, and the covariance of that."""
        state, covariance = self.predicted(time)
        seen = self._seen(regressor)
        if not regressor.shape[1]:
            m = self.channels
            return state[:m], covariance[:m, :m]
        return seen @ state, seen @ covariance @ seen.T

    def advance(self, time: float, number: int = 0) -> FilterStep:
        """On to a window, which is not used."""
        state, covariance, turn = self._predicted(time)
        self.state, self.covariance, self.time = state, covariance, time
        return FilterStep(number, state, covariance, turn, None)

    def update(self, window: ZeroWindow, number: int = 0) -> FilterStep:
        """On to a window in which nothing touched, which is used."""
        node = self.advance(window.time, number)
        seen = self._seen(window.regressor)
        noise = window.noise + window.stays
        inverse = np.linalg.inv(seen @ self.covariance @ seen.T + noise)
        back = seen.T @ inverse  # H' S^-1
        gain, left = self.covariance @ back, window.value - seen @ self.state
        keeps = np.eye(len(self.state)) - gain @ seen
        whole = keeps @ self.covariance @ keeps.T + gain @ noise @ gain.T
        self.state, self.covariance = self.state + gain @ left, (whole + whole.T) / 2.0
        return node._replace(gained=(back @ left, back @ seen, keeps))

    def widen(self, covariance: Float[np.ndarray, "m m"]) -> None:
        """The zero jumped: so much less is known of it."""
        m = self.channels
        self.covariance = self.covariance.copy()
        self.covariance[:m, :m] += covariance

    def _predicted(self, time: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """State, covariance and F; the last one is remembered, as it is asked for more than once."""
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
        """H = (I, h, 0)."""
        m, k = self.channels, self.known
        if regressor.shape != (m, k - m):
            raise InputError(f"the regressors must have shape ({m}, {k - m}), not {regressor.shape}.")
        seen = np.zeros((m, len(self.state)))
        seen[:, :m], seen[:, m:k] = np.eye(m), regressor
        return seen


def smoothed(
    nodes: Sequence[FilterStep], count: int | None = None
) -> Iterator[tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n n"]]]:
    """States and covariances of nodes by all that came after them too, from the last of `count` to the first.

    The modified Bryson-Frazier form of the fixed-interval smoother [Bierman 1977], which inverts no covariance of the
    state, so that one that is known exactly does no harm:

        x_s = x - P l,    P_s = P - P L P,

    with l <- (I - K H)' l - H' S^-1 y and L <- (I - K H)' L (I - K H) + H' S^-1 H where a window was used, and
    l <- F' l, L <- F' L F from node to node backwards, from 0 after the last.
    """
    wanted = len(nodes) if count is None else count
    size = len(nodes[-1].state) if nodes else 0
    pull, weight = np.zeros(size), np.zeros((size, size))
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


@takes_arrays
@dataclass(frozen=True, eq=False)
class ZeroHistory(Value):
    """How the zero went, some windows of all, evenly spread.

    Attributes:
        time: (n,) [s]; zero, deviation: (n, m) in the channels' units; coefficient: (n, q).
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
