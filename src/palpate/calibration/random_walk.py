"""Compute the exact likelihood of a bias in a random walk with white noise, from window means, in linear time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float
from scipy.linalg import lapack, solve_banded
from scipy.optimize import minimize

from palpate.spatial._arrays import Value
from palpate.spatial.arguments import frozen_value, takes_arrays

SEEN = 2.71  # twice the log-likelihood by which a walk that is seen beats none, one-sided 5 %
LOWEST = -16.0  # log of the least variance of a walk, over that of the noise in a window
# of a tridiagonal matrix, L D L^T: D, L below its ones, and whether it is not positive definite
_factored: Callable[..., tuple[np.ndarray, np.ndarray, int]] = vars(lapack)["dpttrf"]  # they have no types
_solve: Callable[..., tuple[np.ndarray, int]] = vars(lapack)["dpttrs"]
_TINY = 1e-300
_UNKNOWN = 1e-8  # of a course alone, what is known at least when others are like it
_SHIFT, _SLOPE = 0.02, 1e-4  # of logarithms, for second differences and for slopes
_FAR = 1e30  # where there is no likelihood


@frozen_value
class Steps(Value):
    """Differences of consecutive window means.

    Attributes:
        change: (k, m) of m channels.
        interval: (k,) [s] from the middle of one window to that of the next.
        joined: (k - 1,) True where a step begins in the window in which the one before ends.
        shape: (k, p) changes of p known courses, such as a temperature.
        window: length of a window [s].
    """

    change: Float[np.ndarray, "k m"]
    interval: Float[np.ndarray, " k"]
    joined: Bool[np.ndarray, " j"]
    shape: Float[np.ndarray, "k p"]
    window: float

    def with_shape(self, *courses: Float[np.ndarray, " k"]) -> Steps:
        """Return `Steps` with other known courses, each (k,)."""
        shape = np.column_stack(courses) if courses else np.zeros((len(self.change), 0))
        return replace(self, shape=shape)

    def part(self, first: int, last: int) -> Steps:
        """Return the `Steps` from `first` to before `last`."""
        rows, joined = slice(first, last), self.joined[first : last - 1]
        return Steps(self.change[rows], self.interval[rows], joined, self.shape[rows], self.window)


@frozen_value
class WalkFit(Value):
    """The most likely random walk, noise and courses of m channels.

    Attributes:
        walk: (m,) [unit/sqrt(s)].
        deviation: (m,) standard deviation of `walk`; NaN: not computed.
        noise: (m,) standard deviation of a window's mean.
        course: (p, m) coefficients of the known courses.
        covariance: (m, p, p) of the coefficients.
        likelihood: log-likelihood, not restricted.
        seen: (m,) True where the walk is significant; else `walk` is its upper bound (95 %).
    """

    walk: Float[np.ndarray, " m"]
    deviation: Float[np.ndarray, " m"]
    noise: Float[np.ndarray, " m"]
    course: Float[np.ndarray, "p m"]
    covariance: Float[np.ndarray, "m p p"]
    likelihood: float
    seen: Bool[np.ndarray, " m"]


@takes_arrays
def steps_of(
    middle: Float[np.ndarray, " w"], mean: Float[np.ndarray, "w m"], window: float, longest: float = np.inf
) -> Steps:
    """Return the `Steps` from window to window; a step over a gap longer than `longest` [s] is omitted.

    Raises:
        InputError: arrays of other shapes.
    """
    apart = np.diff(middle)
    kept = np.flatnonzero(apart <= longest)
    return Steps(np.diff(mean, axis=0)[kept], apart[kept], np.diff(kept) == 1, np.zeros((len(kept), 0)), window)


def fit_walk(
    steps: Steps, groups: Sequence[Sequence[int]], together: float = 14.0, start: WalkFit | None = None
) -> WalkFit:
    """Fit walk and noise by restricted likelihood, and return a `WalkFit`.

    For a Wiener process with noise of variance R in means over a window w, a step between windows whose middles are D
    apart has the variance q^2 (D - w/3) + 2 R, and two steps that share a window the covariance q^2 w/6 - R.

    Args:
        steps: of m channels.
        groups: channels that are alike, such as the forces, and have one walk unless they clearly differ.
        together: twice the log-likelihood that separate walks must gain; inf: groups stay together, and the walk gets
            no standard deviation.
        start: initial values; None: a guess.
    """
    channels, last = steps.change.shape[1], np.isinf(together)
    walk, spread, noise = np.empty(channels), np.full(channels, np.nan), np.empty(channels)
    seen = np.ones(channels, dtype=np.bool_)
    for group in groups:
        chosen = [_Group(steps, list(group), start)]
        if not last and len(group) > 1:
            each = [_Group(steps, [channel], start) for channel in group]
            differ = 2.0 * (sum(alone.value for alone in each) - chosen[0].value) > together
            chosen = each if differ else chosen
        for part in chosen:
            found = part.picked
            walk[found], noise[found] = part.walk, part.noise
            if not last:
                walk[found], relative, seen[found] = part.judged()
                spread[found] = walk[found] * relative
    return WalkFit(walk, spread, noise, *courses_of(steps, walk, noise), seen)


def innovations(steps: Steps, fit: WalkFit) -> Float[np.ndarray, "k m"]:
    """Return each step's difference from its prediction by those before, (k, m), over its standard deviation."""
    each = [_Solved(steps, k, fit.walk[k] ** 2, fit.noise[k] ** 2) for k in range(len(fit.walk))]
    return np.column_stack([one.innovations() for one in each])


@takes_arrays
def courses_of(
    steps: Steps, walk: Float[np.ndarray, " m"], noise: Float[np.ndarray, " m"]
) -> tuple[Float[np.ndarray, "p m"], Float[np.ndarray, "m p p"], float]:
    """Return `course`, `covariance` and `likelihood` of a `WalkFit` with a given walk and noise (m,).

    Raises:
        InputError: arrays of other shapes.
    """
    variances: list[list[float]] = (np.stack([walk, noise], axis=1) ** 2).tolist()
    each = [_Solved(steps, k, *pair) for k, pair in enumerate(variances)]
    course = np.stack([one.course for one in each], axis=1)
    return course, np.stack([one.covariance for one in each]), sum(one.likelihood(restricted=False) for one in each)


class _Solved:
    """The best courses and the likelihood of one channel under given variances."""

    def __init__(self, steps: Steps, channel: int, walk: float, noise: float) -> None:
        change, shape, window = steps.change[:, channel], steps.shape, steps.window
        diagonal = walk * (steps.interval - window / 3.0) + 2.0 * noise
        beside = np.where(steps.joined, walk * window / 6.0 - noise, 0.0)
        self.pivots, self.factors, failed = _factored(diagonal, beside)
        both = np.column_stack([change, shape])
        product: Float[np.ndarray, "q q"] = both.T @ _solve(self.pivots, self.factors, both)[0]
        self.covariance = _inverse(product[1:, 1:])
        self.course: Float[np.ndarray, " p"] = self.covariance @ product[1:, 0]
        self._square = float(product[0, 0] - product[0, 1:] @ self.course)
        self._failed = bool(failed)
        self._left = change - shape @ self.course

    def likelihood(self, *, restricted: bool) -> float:
        """Return the log-likelihood up to a constant; restricted: of the residuals from the courses [Patterson]."""
        if self._failed:
            return -np.inf
        total = float(np.sum(np.log(self.pivots))) + self._square
        if restricted and len(self.course):
            total -= float(np.linalg.slogdet(self.covariance)[1])
        return -0.5 * total

    def best(self) -> float:
        """Return the restricted log-likelihood with both variances multiplied by the best factor."""
        count = len(self.pivots) - len(self.course)
        factor = self._square / count
        return self.likelihood(restricted=True) + 0.5 * (self._square - count - count * np.log(factor))

    def innovations(self) -> Float[np.ndarray, " k"]:
        """Return the innovations, white and of variance 1 if the model holds."""
        bands = np.stack([np.ones(len(self.pivots)), np.append(self.factors, 0.0)])
        return solve_banded((1, 0), bands, self._left) / np.sqrt(self.pivots)


def _inverse(information: Float[np.ndarray, "p p"]) -> Float[np.ndarray, "p p"]:
    """Invert an information of courses; alike ones get 10,000 times the deviation of a single one."""
    alone = np.sqrt(np.diag(information))
    alone = np.where(alone > 0.0, alone, 1.0)
    correlation = information / alone / alone[:, None]
    return np.linalg.inv(correlation + _UNKNOWN * np.eye(len(alone))) / alone / alone[:, None]


class _Group:
    """A common walk of some channels with separate noises."""

    def __init__(self, steps: Steps, picked: list[int], start: WalkFit | None) -> None:
        self._steps, self.picked = steps, picked
        guess = np.array([_first_guess(steps, channel) for channel in picked])
        self._lowest = LOWEST + float(np.mean(guess[:, 1]))
        first = np.append(np.mean(guess[:, 0]), guess[:, 1])
        if start is not None:
            first = 2.0 * np.log(np.append(np.mean(start.walk[picked]), start.noise[picked]))
        limits = [(self._lowest, None), *((noise - 12.0, noise + 12.0) for noise in guess[:, 1].tolist())]
        found = minimize(self._sloped, first, jac=True, method="L-BFGS-B", bounds=limits)
        self._best = np.array(list(found.x))
        self.value, self.noise = -float(found.fun), np.exp(self._best[1:] / 2.0)
        self.walk = float(np.exp(self._best[0] / 2.0))

    def judged(self) -> tuple[float, float, bool]:
        """Return the walk, its relative standard deviation, and whether it is significant; else it is a bound."""
        none = sum(_Solved(self._steps, channel, np.exp(LOWEST), 1.0).best() for channel in self.picked)
        seen = bool(2.0 * (self.value - none) > SEEN)
        walk = self._best[0] if seen else self._most(self._best)
        return float(np.exp(walk / 2.0)), self._deviation(self._best), seen

    def _loss(self, logarithms: Float[np.ndarray, " _"]) -> float:
        """Return the negative log-likelihood for the logarithms of the variances: walk, then noises."""
        return float(sum(self._each(logarithms)))

    def _sloped(self, logarithms: Float[np.ndarray, " v"]) -> tuple[float, Float[np.ndarray, " v"]]:
        """Return the loss and its slope."""
        here = self._each(logarithms)
        walked = self._each(logarithms + _SLOPE * np.eye(len(logarithms))[0])
        noisier = self._each(logarithms + _SLOPE * (np.arange(len(logarithms)) > 0))
        slope = np.append(np.sum(walked - here), noisier - here) / _SLOPE
        return float(np.sum(here)), slope

    def _each(self, logarithms: Float[np.ndarray, " v"]) -> Float[np.ndarray, " k"]:
        walk, *noise = np.exp(logarithms).tolist()
        return np.array(
            [
                min(-_Solved(self._steps, channel, walk, noise[k]).likelihood(restricted=True), _FAR)
                for k, channel in enumerate(self.picked)
            ]
        )

    def _deviation(self, best: Float[np.ndarray, " v"]) -> float:
        """Return the relative standard deviation of the walk, from the likelihood's curvature."""
        size = len(best)
        ways = _SHIFT * np.eye(size)
        bend = np.empty((size, size))
        for i in range(size):
            for j in range(i + 1):
                corners = [best + s * ways[i] + t * ways[j] for s in (1, -1) for t in (1, -1)]
                a, b, c, d = (self._loss(corner) for corner in corners)
                bend[i, j] = bend[j, i] = (a - b - c + d) / (4.0 * _SHIFT**2)
        if np.linalg.eigvalsh(bend).min() <= 0.0:  # at the edge, where there is no walk
            return 1.0
        return float(np.sqrt(np.linalg.inv(bend)[0, 0])) / 2.0  # of a variance's logarithm, half is the deviation's

    def _most(self, best: Float[np.ndarray, " v"]) -> float:
        """Return the logarithm of the walk's largest variance (95 %, one-sided)."""
        low, high = float(best[0]), float(best[1:].max()) + 5.0
        for _ in range(30):
            middle = (low + high) / 2.0
            against = 2.0 * (self.value + self._loss(np.append(middle, best[1:])))
            low, high = (middle, high) if against < SEEN else (low, middle)
        return high


def _first_guess(steps: Steps, channel: int) -> tuple[float, float]:
    """Return guesses of the logarithms of walk and noise variance."""
    change = steps.change[:, channel]
    square = float(np.var(change))
    pairs = np.flatnonzero(steps.joined)
    beside = float(np.mean(change[pairs] * change[pairs + 1])) if len(pairs) else 0.0
    noise = max(-beside, 0.05 * square, _TINY)
    walk = max(square + 2.0 * beside, 0.01 * square, _TINY) / float(np.mean(steps.interval))
    return float(np.log(walk)), float(np.log(noise))
