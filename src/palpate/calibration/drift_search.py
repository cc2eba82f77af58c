"""Separate the drift of a bias from touches, choose the length of windows, and test for a warm-up."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy.optimize import minimize_scalar
from scipy.special import gammaincinv

from palpate.calibration.drift_windows import GAP, SHORTEST, Windows, first_guess, require_free, stretches, untouched
from palpate.calibration.random_walk import Steps, WalkFit, courses_of, fit_walk, innovations, steps_of
from palpate.calibration.validation import Validation
from palpate.errors import InputError
from palpate.spatial.arguments import takes_arrays

SURE = 0.99  # that there is a warm-up
LONGEST_WINDOW, FEWEST = 1.0, 100  # s; windows of a log in which noise is not white over shorter ones
LAGS, COLOURED, MOVING = 5, 0.1, 0.35  # correlation of what is left from window to window
WRONG = 3.0  # times the noise that is stated
DISTINCT = 1e-3  # of the variance of a coefficient, what is left where no other course is like it
ROUNDS = 4  # of leaving out what is touched
SETTLINGS = 9  # that are tried
SAID = 3  # touches in a note


@takes_arrays
class Search:
    """A joint search for touches, the length of windows and a warm-up.

    Args:
        windows: means of the log.
        groups: groups of channels that are alike.
        least: (m,) lower bound of a mean's variance, by the resolution of its readings.

    Attributes:
        found: `WalkFit` of largest likelihood.
        rate: (m,) of the warm-up at the start [unit/s]; rate_deviation: (m,) its standard deviation; settling: [s].
        warm: True if there is a significant warm-up.
        touched: stretches omitted as touched [s]; share: of the log.
        span: [s] of the log.
    """

    def __init__(self, windows: Windows, groups: list[list[int]], least: Float[np.ndarray, " m"]) -> None:
        self.windows, self._groups, self._least = windows, groups, least
        self.span = float(windows.middle[-1] - windows.middle[0]) + windows.length
        self.settling, self.warm, self.correlation, self.touched = np.inf, False, 0.0, list[tuple[float, float]]()

    def run(self) -> Search:
        """Run the search and return it, with the results in its attributes.

        Raises:
            InputError: the log is touched for long or often, or the readings swing.
        """
        self._leave_touches_out()
        self.correlation = self._correlation()
        self.first_window = self.windows.length
        while (
            self.correlation > COLOURED
            and 2.0 * self.windows.length <= LONGEST_WINDOW + 1e-9
            and len(self.windows.middle) >= 2 * FEWEST
        ):
            self.windows = self.windows.doubled()
            self._fit()
            self.correlation = self._correlation()
        if self.correlation > MOVING:
            raise InputError(
                "the readings swing instead of drifting: the arm moves, or something touches the sensor.",
                hint="Record the sensor at rest and untouched; if the arm moves, name the payload in the rig.",
            )
        return self

    def compare_halves(self) -> tuple[Validation, Float[np.ndarray, " m"]]:
        """Compare the walks of both halves of the log; return a `Validation`, and each channel's larger walk, (m,)."""
        steps, count = self._with(self.settling), len(self._steps.interval)
        if self.span < 2.0 * SHORTEST:
            return Validation(), self.found.walk
        halves = (0, count // 2), (count // 2, count)
        fits = [fit_walk(steps.part(*half), self._groups, start=self.found) for half in halves]
        larger = np.maximum(fits[0].walk, fits[1].walk)
        firsts = [group[0] for group in self._groups if all(fit.seen[group].all() for fit in fits)]
        if not firsts:
            return Validation(), larger
        off = np.log(fits[0].walk / fits[1].walk)[firsts]
        variance = sum(((fit.deviation / fit.walk)[firsts] ** 2 for fit in fits), np.zeros(len(firsts)))
        return Validation(float(np.mean(off**2 / variance)), 2, len(firsts)), larger

    def _leave_touches_out(self) -> None:
        """Omit touches and fit, until the same windows are omitted."""
        everything = self.windows
        walk, noise = first_guess(everything)
        noise = np.maximum(noise, self._least)
        free, course = untouched(everything, walk, noise), None
        for _ in range(ROUNDS):
            require_free(everything, free)
            self.windows = everything.picked(free)
            self._fit()
            course = self._courses(everything, self.settling) @ self.found.course
            noise = np.maximum(self.found.noise**2, self._least)
            now = untouched(everything, self.found.walk**2, noise, course)
            if np.array_equal(now, free):
                break
            free = now
        self.touched, self.share = stretches(everything, ~free), 1.0 - float(np.mean(free))

    def _fit(self) -> None:
        """Fit, with a warm-up where its likelihood justifies it."""
        steps = steps_of(self.windows.middle, self.windows.mean, self.windows.length, GAP)
        self._steps = steps
        without = self._given(None)
        steady = self._given(np.inf, without)
        settling, best = self._settled(steady)
        freedom: int = self.windows.mean.shape[1] + 1
        gain = 2.0 * (best.likelihood - without.likelihood)
        self.warm = bool(gain > 2.0 * gammaincinv(freedom / 2.0, SURE))  # by chi-square
        self.settling = settling if self.warm else np.inf
        self.found = fit_walk(self._with(self.settling), self._groups, start=best if self.warm else steady)
        self.rate, self.rate_deviation = self.found.course[-1], np.sqrt(self.found.covariance[:, -1, -1])

    def distinct(self, course: int) -> bool:
        """Return whether a known course of the windows, by its number, is distinct from the others and a warm-up."""
        found, alone = self.found, self._steps.with_shape(self._changes(self.settling)[:, course])
        _, covariance, _ = courses_of(alone, found.walk, found.noise)
        return bool(np.all(covariance[:, 0, 0] > DISTINCT * found.covariance[:, course, course]))

    def _given(self, settling: float | None, start: WalkFit | None = None) -> WalkFit:
        """Return the fit with a warm-up of a settling time, or without (None), alike channels together."""
        return fit_walk(self._with(settling), self._groups, together=np.inf, start=start)

    def _with(self, settling: float | None) -> Steps:
        return self._steps.with_shape(*self._changes(settling).T)

    def _changes(self, settling: float | None) -> Float[np.ndarray, "k p"]:
        """Return the change of each course from step to step."""
        courses = self._courses(self.windows, settling)
        kept = np.diff(self.windows.middle) <= GAP
        return np.diff(courses, axis=0)[kept]

    def _courses(self, windows: Windows, settling: float | None) -> Float[np.ndarray, "w p"]:
        """Return courses that the bias may follow, the last of them a warm-up of rate 1."""
        if settling is None:
            return windows.courses
        when = windows.middle
        warm = when if np.isinf(settling) else -settling * np.expm1(-when / settling)
        return np.column_stack([windows.courses, warm])

    def _settled(self, steady: WalkFit) -> tuple[float, WalkFit]:
        """Return the most likely settling time, and its fit."""
        fit = steady
        tried: Float[np.ndarray, " t"] = np.geomspace(self.span / 30.0, 3.0 * self.span, SETTLINGS)
        found = 0.0
        for _ in range(2):
            values = [self._likelihood(float(each), fit) for each in tried]
            k = int(np.argmax(values))
            low, high = np.log(tried[max(0, k - 1)]), np.log(tried[min(len(tried) - 1, k + 1)])
            loss = minimize_scalar(self._loss, args=(fit,), bounds=(low, high), method="bounded")
            found = float(np.exp(loss.x))
            fit = self._given(found, fit)
        if fit.likelihood < steady.likelihood or found > 2.5 * self.span:
            return np.inf, steady
        return found, fit

    def _loss(self, logarithm: float, fit: WalkFit) -> float:
        return -self._likelihood(float(np.exp(logarithm)), fit)

    def _likelihood(self, settling: float, fit: WalkFit) -> float:
        """Return the log-likelihood of a settling time."""
        return courses_of(self._with(settling), fit.walk, fit.noise)[2]

    def _correlation(self) -> float:
        """Return the residuals' largest correlation over some lags, in the mean of a group."""
        left = innovations(self._with(self.settling), self.found)
        each: list[Float[np.ndarray, " m"]] = [np.mean(left[lag:] * left[:-lag], axis=0) for lag in range(1, LAGS + 1)]
        return max(abs(float(one[group].mean())) for one in each for group in self._groups)

    def notes(self, noise: Float[np.ndarray, "..."] | None, step: float, names: Sequence[str]) -> list[str]:
        """Return notes on the search, one sentence each.

        Args:
            noise: (m,) standard deviations or (m, m) covariance of one reading, as stated; None: not stated.
            step: [s] from one reading to the next.
            names: names of the channels.

        Raises:
            InputError: noise has another shape.
        """
        said: list[str] = []
        if self.touched:
            when = ", ".join(f"{start:.1f} to {end:.1f} s" for start, end in self.touched[:SAID])
            more = f" and {len(self.touched) - SAID} more" if len(self.touched) > SAID else ""
            said.append(f"{self.share:.1%} of the log was left out as touched or disturbed: {when}{more}")
        if self.windows.length > 1.5 * self.first_window:
            said.append(
                f"means over {self.first_window:.2g} s have coloured noise: "
                f"means over {self.windows.length:.2g} s were taken instead"
            )
        if self.correlation > COLOURED:
            said.append("the noise of the means is not white: the error of the walk may be larger than stated")
        if noise is not None:
            said += _noise_said(np.asarray(noise), self.found.noise, self.windows.length / step, names)
        unseen = [name for name, seen in zip(names, self.found.seen, strict=True) if not seen]
        if unseen:
            said.append(f"no walk is seen in {', '.join(unseen)}: its upper bound (95 %) is written")
        if not self.warm:
            said.append(
                "no warm-up is seen: the largest steady rate that this log allows is written. Record a log that "
                "begins when the sensor is switched on to see its warm-up"
            )
        elif self.settling > 1.5 * self.span:
            said.append("the warm-up lasts longer than the log, so its duration is hardly known")
        return said


def _noise_said(
    stated: Float[np.ndarray, "..."], seen: Float[np.ndarray, " m"], count: float, names: Sequence[str]
) -> list[str]:
    """Return a note where windows are far noisier than the stated noise explains."""
    deviation = np.sqrt(np.diag(stated)) if stated.ndim == 2 else stated
    ratio = seen * np.sqrt(count) / deviation
    wrong = [f"{name} ({times:.2g} times)" for name, times in zip(names, ratio, strict=True) if times > WRONG]
    if not wrong:
        return []
    said = "means are noisier than the stated noise explains, as with a motor's hum or coloured noise"
    return [f"{said}: {', '.join(wrong)}"]
