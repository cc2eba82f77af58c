"""Filters of a signal, and the meaning of their settings in Hz and ms."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from palpate.calls import called_as
from palpate.errors import InputError
from palpate.spatial._arrays import frozen
from palpate.spatial.arguments import frozen_value

SETTLED = 1e-12  # of a step: the rest at which a response counts as settled
SLOWEST = 1e-5  # of the rate: a lower cut-off needs tables that do not fit
LEAST_RATIO = 1e-8  # of q and r: as slow
MOST_SECTIONS = 4  # second order each


@frozen_value
class Recursion:
    """A filter at a rate, as the compiled loop runs it; ages of samples count from 0 where the filter starts.

    Args:
        sections: (s, 6) second-order sections b0 b1 b2 1 a1 a2; empty for a filter of gains.
        start: (s, 2) state of the sections after an endless input of 1.
        gains: (m,) y += gain (x - y), by age; the last one stays.
        share: (k,) of white noise's variance that remains, by age; the last one stays.
        response: (l,) to an impulse, until it has settled; empty for a filter that cannot run backward.
    """

    sections: Float[np.ndarray, "s 6"]
    start: Float[np.ndarray, "s 2"]
    gains: Float[np.ndarray, " m"]
    share: Float[np.ndarray, " k"]
    response: Float[np.ndarray, " l"]


@called_as("palpate.Kalman()")
@frozen_value(eq=True)
class Kalman:
    """A Kalman filter of a random walk, each axis separately, as `probe` has it.

    With rho = q/r and P_0 = 1 at the first sample, the prior P' = P + rho, the gain K = P'/(P' + 1) and

        y_k = y_{k-1} + K (x_k - y_{k-1}),   P = (1 - K)^2 P' + K^2 = K   (Joseph's form)

    settle at K = (sqrt(rho^2 + 4 rho) - rho)/2: a first-order low-pass. P times the noise of a reading is the
    covariance carried on.

    Args:
        q: variance of one step of the contact.
        r: variance of one reading, in the same unit; only q/r matters.

    Raises:
        InputError: q or r is not positive and finite, or q is less than 1e-8 r.
    """

    q: float = 1e-6
    r: float = 2e-4
    zero_phase = False

    def __post_init__(self) -> None:
        if not (0 < self.q < np.inf and 0 < self.r < np.inf and LEAST_RATIO <= self.q / self.r < np.inf):  # NaN too
            raise InputError(f"q ({self.q}) and r ({self.r}) must be positive, and q at least {LEAST_RATIO:g} times r.")

    @property
    def steady_gain(self) -> float:
        """Gain K, from 0 to 1, long after the start."""
        rho = self.q / self.r
        return 2.0 / (1.0 + float(np.sqrt(1.0 + 4.0 / rho)))  # the same without a difference of near equals

    def gain(self, frequency: ArrayLike, rate: float) -> Float[np.ndarray, "..."]:
        """Return the steady filter's gain, at most 1, at frequencies [Hz], in their shape, for samples at `rate` [Hz].

        Raises:
            InputError: `rate` is not positive and finite.
        """
        k, w = self.steady_gain, _angle(frequency, rate)
        return np.asarray(k / np.sqrt(k * k + 2.0 * (1.0 - k) * (1.0 - np.cos(w))))

    def delay(self, frequency: ArrayLike, rate: float) -> Float[np.ndarray, "..."]:
        """Return the steady filter's group delay [s] at frequencies [Hz], in their shape, for samples at `rate` [Hz].

        Raises:
            InputError: `rate` is not positive and finite.
        """
        k, w = self.steady_gain, _angle(frequency, rate)
        fall = 1.0 - np.cos(w)
        return np.asarray((1.0 - k) * (k - fall) / (k * k + 2.0 * (1.0 - k) * fall) / rate)

    def bandwidth(self, rate: float) -> float:
        """Return the frequency [Hz] at which the steady filter's gain is -3 dB: 2 (1 - cos w) = rho.

        It is half the `rate` [Hz] if the gain is larger everywhere.

        Raises:
            InputError: `rate` is not positive and finite.
        """
        half_sine = np.sqrt(self.q / self.r) / 2.0
        return _known(rate) * float(np.arcsin(min(1.0, half_sine))) / np.pi

    def describe(self, rate: float) -> str:
        """Return a sentence with the filter's settings, and its cut-off [Hz] and delay [ms] at `rate` [Hz].

        Raises:
            InputError: `rate` is not positive and finite.
        """
        return f"Kalman, q {self.q:.3g}, r {self.r:.3g}: at {rate:.6g} Hz a low-pass at {_says(self, rate)}"

    def recursion(self, rate: float) -> Recursion:
        """Return the `Recursion` that runs this filter; it is the same at every `rate` [Hz].

        Raises:
            InputError: `rate` is not positive and finite.
        """
        _known(rate)
        rho, gains = self.q / self.r, [1.0]
        while len(gains) < 2 or gains[-2] - gains[-1] > SETTLED * gains[-1]:
            prior = gains[-1] + rho
            gains.append(prior / (prior + 1.0))
        table = frozen(gains)
        return Recursion(np.zeros((0, 6)), np.zeros((0, 2)), table, table, np.zeros(0))


@called_as("palpate.Butterworth(cutoff=10.0)")
@frozen_value(eq=True)
class Butterworth:
    """A low-pass, flat in its band; it starts as if the first sample had been there for ever.

    With the bilinear transform u = tan(pi f/rate)/tan(pi cutoff/rate), the gain is (1 + u^(2 order))^(-1/2).

    Args:
        cutoff: [Hz] where the gain of one pass is -3 dB.
        order: 1 to 8.
        zero_phase: filter forward and backward, for a recorded log only: no delay, the gain squared.

    Raises:
        InputError: a cut-off that is not positive and finite, or an order that is not 1 to 8.
    """

    cutoff: float
    order: int = 2
    zero_phase: bool = False

    def __post_init__(self) -> None:
        if not 0 < self.cutoff < np.inf:  # NaN too
            raise InputError(f"the cut-off must be positive, not {self.cutoff} Hz.")
        if not 1 <= self.order <= 2 * MOST_SECTIONS:
            raise InputError(f"the order must be from 1 to {2 * MOST_SECTIONS}, not {self.order}.")

    def gain(self, frequency: ArrayLike, rate: float) -> Float[np.ndarray, "..."]:
        """Return the gain, at most 1, at frequencies [Hz] up to half the `rate` [Hz], in their shape.

        Raises:
            InputError: the cut-off is not from 1e-5 to below half of the rate, or the rate is not positive.
        """
        u = np.tan(_angle(frequency, rate) / 2) / np.tan(np.pi * self._checked(rate))
        return np.asarray((1.0 + u ** (2 * self.order)) ** (-1.0 if self.zero_phase else -0.5))

    def delay(self, frequency: ArrayLike, rate: float) -> Float[np.ndarray, "..."]:
        """Return the group delay [s], -d(phase)/dw, at frequencies [Hz], in their shape; 0 for zero phase.

        Raises:
            InputError: the cut-off is not from 1e-5 to below half of the `rate` [Hz], or the rate is not positive.
        """
        w = _angle(frequency, rate)
        if self.zero_phase:
            return np.zeros_like(w)
        turned = self._poles(rate) * np.exp(-1j * w[..., None])
        return np.asarray((self.order / 2 + np.sum((turned / (1 - turned)).real, axis=-1)) / rate)

    def bandwidth(self, rate: float) -> float:
        """Return the frequency [Hz] of -3 dB: the cut-off, or less for zero phase.

        Raises:
            InputError: the cut-off is not from 1e-5 to below half of the `rate` [Hz], or the rate is not positive.
        """
        cutoff = self._checked(rate)
        u = (2**0.5 - 1) ** (0.5 / self.order) if self.zero_phase else 1.0
        return rate / np.pi * float(np.arctan(u * np.tan(np.pi * cutoff)))

    def describe(self, rate: float) -> str:
        """Return a sentence with the filter's settings, and its cut-off [Hz] and delay [ms] at `rate` [Hz].

        Raises:
            InputError: the cut-off is not from 1e-5 to below half of the rate, or the rate is not positive.
        """
        settings = f"order {self.order}, {self.cutoff:.3g} Hz{', forward and backward' if self.zero_phase else ''}"
        return f"Butterworth, {settings}: at {rate:.6g} Hz a low-pass at {_says(self, rate)}"

    def recursion(self, rate: float) -> Recursion:
        """Return the `Recursion` that runs this filter at a `rate` [Hz].

        Raises:
            InputError: the cut-off is not from 1e-5 to below half of the rate, or the rate is not positive.
        """
        sections = self._sections(rate)
        start = np.stack([1.0 - sections[:, 0], sections[:, 2] - sections[:, 5]], axis=1)  # 1 in, 1 out, for ever
        slowest = float(np.abs(self._poles(rate)).max())
        response = _response(sections, start, int(np.ceil(np.log(SETTLED) / np.log(slowest))) + 8 * self.order)
        # y_k = sum over j < k of h_j x_{k-j}, and all the rest of the weight, which sums to 1, on x_0
        newer = np.concatenate([[0.0], np.cumsum(response)[:-1]])
        squares = np.concatenate([[0.0], np.cumsum(response**2)[:-1]])
        share = squares + (1.0 - newer) ** 2
        return Recursion(frozen(sections), frozen(start), np.zeros(0), frozen(share), frozen(response))

    def _sections(self, rate: float) -> Float[np.ndarray, "s 6"]:
        """Return b0 b1 b2 1 a1 a2 of each pair of poles, as scipy.signal.butter does, without importing SciPy."""
        sections: list[list[float]] = []
        for pole in self._poles(rate)[: (self.order + 1) // 2]:  # the others are their conjugates
            alone = 2 * len(sections) + 1 == self.order
            a1, a2 = (-pole.real, 0.0) if alone else (-2 * pole.real, abs(pole) ** 2)
            zeros = np.array([1.0, 1.0, 0.0] if alone else [1.0, 2.0, 1.0])
            sections.append([*((1 + a1 + a2) / zeros.sum() * zeros).tolist(), 1.0, a1, a2])
        return np.array(sections)

    def _poles(self, rate: float) -> np.ndarray:
        """Return the digital poles, by the bilinear transform."""
        angles = np.pi * (np.arange(self.order) + 0.5) / self.order + np.pi / 2
        analogue = np.tan(np.pi * self._checked(rate)) * np.exp(1j * angles)
        return (1 + analogue) / (1 - analogue)

    def _checked(self, rate: float) -> float:
        """Return the cut-off over the rate, if it is in range."""
        share = self.cutoff / _known(rate)
        if not share < 0.5:
            raise InputError(
                f"a cut-off of {self.cutoff:g} Hz is not below half the rate of the samples ({rate:.6g} Hz).",
                hint=f"Choose less than {rate / 2:.4g} Hz, or no filter.",
            )
        if share < SLOWEST:
            raise InputError(
                f"a cut-off of {self.cutoff:g} Hz is too low for samples at {rate:.6g} Hz.",
                hint=f"Choose at least {SLOWEST * rate:.2g} Hz.",
            )
        return share


Filter = Kalman | Butterworth


def _response(
    sections: Float[np.ndarray, "s 6"], start: Float[np.ndarray, "s 2"], length: int
) -> Float[np.ndarray, " l"]:
    """Return the response to an impulse that follows a first sample of 0."""
    from palpate.signals._filters import smooth  # compiled: loaded when first needed

    values = np.zeros((length + 1, 6))
    values[1] = 1.0
    clock, state, age = np.array([-1.0, np.nan]), np.zeros((2 * len(sections), 6)), np.empty(length + 1, dtype=np.int64)
    status = np.full(length + 1, -1, dtype=np.int8)
    smooth(np.zeros(length + 1), status, values, sections, start, np.zeros(0), np.inf, clock, state, age)
    return values[1:, 0].copy()


def _known(rate: float) -> float:
    if not 0 < rate < np.inf:  # NaN too
        raise InputError(f"the rate of the samples must be positive, not {rate} Hz.", hint="State the rate in Hz.")
    return rate


def _angle(frequency: ArrayLike, rate: float) -> Float[np.ndarray, "..."]:
    """Return the angle per sample [rad] of frequencies [Hz]."""
    return np.asarray(2.0 * np.pi / _known(rate) * np.asarray(frequency, dtype=np.float64))


def _says(made: Filter, rate: float) -> str:
    """Return the cut-off and the delay in words, to two digits."""
    lag = 1e3 * float(made.delay(0.0, rate))
    late = f"{_two(lag)} ms of lag" if lag else "no lag"
    return f"{_two(made.bandwidth(rate))} Hz with {late}"


def _two(value: float) -> str:
    """Format a value with two digits, without an exponent from 100 on."""
    return f"{value:.2g}" if value < 100 else f"{value:.0f}"
