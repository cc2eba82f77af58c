"""Model a robot's motion by its servo, and fit delay and lag to it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float

from palpate.control.servo import FAINT
from palpate.spatial.arguments import takes_arrays

GRID, GRAIN = 1e-3, 1e-4  # s of the modelled motion, and the deviation of what it makes of times between
SEARCH = (-0.3, 1.0)  # s: delays that are tried
LONGEST = 0.5  # s, of a lag
CAUCHY = 4.0  # standard deviations of a residual
STEP = 2e-4  # s, of finite differences
Pair = Float[np.ndarray, "2"]


@dataclass(frozen=True, eq=False)
class ServoMotion:
    """Commands `targets` (m, n) that the robot took when `sent`, and what it did, `seen` (k, n)."""

    time: Float[np.ndarray, " k"]
    seen: Float[np.ndarray, "k n"]
    sent: Float[np.ndarray, " m"]
    targets: Float[np.ndarray, "m n"]
    period: float
    unsure: float  # s: deviation of the phase in which commands are sent
    ramp: float = 0.0
    order: int = 2

    def part(self, rows: Bool[np.ndarray, " k"]) -> ServoMotion:
        """Return the motion with these positions only, rows (k,)."""
        return replace(self, time=self.time[rows], seen=self.seen[rows])

    @cached_property
    def line(self) -> tuple[Float[np.ndarray, " g"], Float[np.ndarray, "g n"]]:
        """The line that joints follow without delay and lag, from the first command on, on a grid of times."""
        ramp, ends = max(self.ramp, 1e-6), np.append(self.sent[1:], np.inf)
        bends, places = np.empty(2 * len(self.sent)), np.empty((2 * len(self.sent), self.targets.shape[1]))
        place = np.zeros(self.targets.shape[1])
        bends[::2], bends[1::2] = self.sent, np.minimum(self.sent + ramp, ends - 1e-9)
        shares = np.minimum(1.0, (bends[1::2] - self.sent) / ramp).tolist()
        for k, (share, target) in enumerate(zip(shares, self.targets - self.targets[0], strict=True)):
            places[2 * k] = place
            place = places[2 * k + 1] = place + share * (target - place)
        grid = np.arange(self.sent[0], max(self.time[-1], self.sent[-1]) - SEARCH[0], GRID)
        return grid, np.stack([np.interp(grid, bends, each) for each in places.T], axis=1)

    def model(self, delay: float, lag: float) -> Float[np.ndarray, "k n"]:
        """Return the positions (k, n) by a servo's delay and lag [s], but for an offset and gains."""
        grid, line = self.line
        followed = lagging(line, lag, self.order)
        time, columns = np.asarray(self.time - delay, dtype=np.float64), range(line.shape[1])
        return np.stack([np.interp(time, grid, followed[:, k]) for k in columns], axis=1)

    def compared(self, delay: float, lag: float) -> tuple[Float[np.ndarray, "k n"], Float[np.ndarray, " n"]]:
        """Return the residuals of positions, by the best offset and gain of each joint, and these gains."""
        model, seen = self.model(delay, lag), self.seen - self.seen.mean(axis=0)
        model -= model.mean(axis=0)
        gains = np.sum(model * seen, axis=0) / np.maximum(np.sum(model**2, axis=0), 1e-12)
        return seen - gains * model, gains

    def fitted(self, start: Pair) -> Pair:
        """Return the best delay and lag near others [s]."""
        from scipy.optimize import least_squares  # here: it takes 0.2 s to import

        values, bounds = start, ([SEARCH[0], 0.0], [SEARCH[1], LONGEST])
        for _ in range(2):
            scale = CAUCHY * spread_of(self.compared(*values)[0])
            values = least_squares(
                lambda at: self.compared(*at)[0].ravel(), values, bounds=bounds, x_scale=[1e-2, 1e-2], loss="cauchy",
                f_scale=scale, diff_step=[1e-3, 1e-3], xtol=1e-7,
            ).x  # fmt: skip
        return values

    def costs(self, values: Pair, scale: float) -> Float[np.ndarray, " s"]:
        """Return the robust cost of each stretch of a quarter of a second, with residuals of this scale."""
        cost = np.log1p((self.compared(*values)[0] / (CAUCHY * scale)) ** 2).sum(axis=1)
        return np.bincount((4.0 * (self.time - self.time[0])).astype(np.int64), cost)

    def spread(self, values: Pair) -> tuple[Float[np.ndarray, "2 2"], float]:
        """Return the covariance of delay and lag, and the residuals' robust deviation.

        A jitter of commands that explains the residuals may change both by as much.
        """
        residual, _ = self.compared(*values)
        scale = spread_of(residual)
        slopes = np.stack([(self.compared(*(values + STEP * way))[0] - residual) / STEP for way in np.eye(2)])
        weights = 1.0 / (1.0 + (residual / (CAUCHY * scale)) ** 2)
        information = np.einsum("akj,bkj,kj->ab", slopes, slopes, weights)
        scores = np.einsum("akj,kj,kj->ak", slopes, residual, weights)
        stretch = (self.time - self.time[0]).astype(np.int64)
        sums = np.stack([np.bincount(stretch, each) for each in scores], axis=1)
        inverse = np.asarray(np.linalg.inv(information), dtype=np.float64)
        jitter = scale / float(np.std(slopes[0]))
        return inverse @ (sums.T @ sums) @ inverse + (GRAIN**2 + jitter**2) * np.eye(2), scale


@takes_arrays
def lagging(line: Float[np.ndarray, "g n"], lag: float, order: int) -> Float[np.ndarray, "g n"]:
    """Return what follows a line on the grid: a first-order lag, once or twice, exact for ramps from point to point."""
    from scipy.signal import lfilter  # here: it takes 0.3 s to import

    step = GRID * order / max(lag, 1e-6)
    decay = np.exp(-step)
    share = (1.0 - decay) / step
    for _ in range(order):
        line = np.asarray(lfilter([1.0 - share, share - decay], [1.0, -decay], line, axis=0))
    return line


@takes_arrays
def spread_of(residual: Float[np.ndarray, "k n"]) -> float:
    """Return the robust standard deviation of residuals (k, n), at least that of encoders [rad, m]."""
    return max(float(np.median(np.abs(residual))) / 0.6745, FAINT)
