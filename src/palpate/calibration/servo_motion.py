"""Model a robot's motion by its servo, and fit delay and lag to it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from palpate.control.servo import FAINT
from palpate.spatial.arguments import takes_arrays

GRID, GRAIN = 1e-3, 1e-4  # s of the modelled motion, and the deviation of what it makes of times between
SEARCH = (-0.3, 1.0)  # s: delays that are tried
LONGEST = 0.5  # s, of a lag
BOUNDS = [SEARCH[0], 0.0], [SEARCH[1], LONGEST]  # of delay and lag
CAUCHY = 4.0  # standard deviations of a residual
STEP = 2e-4  # s, of finite differences
DECAYED = 6.0  # lags
LEAST_JITTER = 1e-6  # s
ANY = 1.0  # s: deviation of delay and lag before the log is seen
ROUNDS, CLOSE, FAR = 20, 1e-5, 0.02  # of Gauss-Newton, s of its last step, and of one that is not near any more
Pair = Float[np.ndarray, "2"]


@takes_arrays
@dataclass(frozen=True, eq=False)
class ServoMotion:
    """Commands `targets` (m, n) that the robot took `late` [s] after they were `sent`, and what it did, `seen` (k, n).

    How late is another time for each command, with mean 0: jitter of sending, of the network and of the robot's clock.
    """

    time: Float[np.ndarray, " k"]
    seen: Float[np.ndarray, "k n"]
    sent: Float[np.ndarray, " m"]
    targets: Float[np.ndarray, "m n"]
    period: float
    unsure: float  # s: deviation of the phase in which commands are sent
    late: Float[np.ndarray, " m"]
    ramp: float = 0.0
    order: int = 2

    def part(self, rows: Bool[np.ndarray, " k"]) -> ServoMotion:
        """Return the motion with these positions only, rows (k,)."""
        return replace(self, time=self.time[rows], seen=self.seen[rows])

    @cached_property
    def begins(self) -> Float[np.ndarray, " m"]:
        """Times [s] at which a robot without delay begins to follow the commands, in their order."""
        return np.maximum.accumulate(self.sent + self.late) - 0.5 * (self.taken - self.ramp)

    @property
    def taken(self) -> float:
        """Time [s] in which a command is reached on the grid, where a step is a ramp about its time."""
        return max(self.ramp, GRID)

    @cached_property
    def line(self) -> tuple[Float[np.ndarray, " g"], Float[np.ndarray, "g n"]]:
        """The line that joints follow without delay and lag, from the first command on, on a grid of times."""
        begins, ramp = self.begins, self.taken
        ends = np.append(begins[1:], np.inf)
        bends, places = np.empty(2 * len(self.sent)), np.empty((2 * len(self.sent), self.targets.shape[1]))
        place = np.zeros(self.targets.shape[1])
        bends[::2], bends[1::2] = begins, np.minimum(begins + ramp, ends - 1e-9)
        shares = np.minimum(1.0, (bends[1::2] - begins) / ramp).tolist()
        for k, (share, target) in enumerate(zip(shares, self.targets - self.targets[0], strict=True)):
            places[2 * k] = place
            place = places[2 * k + 1] = place + share * (target - place)
        grid = np.arange(begins[0], max(self.time[-1], begins[-1]) - SEARCH[0], GRID)
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
        """Return the best delay and lag near others [s], with commands as late as they are."""
        from scipy.optimize import least_squares  # here: it takes 0.2 s to import

        values = start
        for _ in range(2):
            scale = CAUCHY * spread_of(self.compared(*values)[0])
            values = least_squares(
                lambda at: self.compared(*at)[0].ravel(), values, bounds=BOUNDS, x_scale=[1e-2, 1e-2], loss="cauchy",
                f_scale=scale, diff_step=[1e-3, 1e-3], xtol=1e-7,
            ).x  # fmt: skip
        return values

    def refined(self, values: Pair) -> tuple[ServoMotion, Pair]:
        """Return the motion with the lateness of commands that explains it best, and the best delay and lag [s].

        Args:
            values: delay and lag [s] near the best.
        """
        motion = self
        for _ in range(ROUNDS):
            step, late = _Linearised(motion, values).best()
            if np.abs(step).max() > FAR:
                break
            motion, values = replace(motion, late=late), np.clip(values + step, *BOUNDS)
            if np.abs(step).max() < CLOSE:
                break
        return motion, values

    def costs(self, values: Pair, scale: float, jitter: float) -> Float[np.ndarray, " s"]:
        """Return the robust cost of each stretch of a quarter of a second, by residuals and lateness of this scale."""
        cost = np.log1p((self.compared(*values)[0] / (CAUCHY * scale)) ** 2).sum(axis=1)
        begin, count = self.time[0], int(4.0 * (self.time[-1] - self.time[0])) + 1
        when = np.clip(4.0 * (self.sent - begin), 0, count - 1).astype(np.int64)
        late = np.log1p((self.late / (CAUCHY * jitter)) ** 2)
        return np.bincount((4.0 * (self.time - begin)).astype(np.int64), cost, count) + np.bincount(when, late, count)

    def spread(self, values: Pair) -> tuple[Float[np.ndarray, "2 2"], float]:
        """Return the covariance of delay and lag, and the residuals' robust deviation."""
        near = _Linearised(self, values)
        sound = np.stack([near.unexplained(slope) for slope in near.slopes])
        information, prior = np.einsum("akj,bkj->ab", sound, near.slopes), (near.scale / ANY) ** 2 * np.eye(2)
        scores = np.einsum("akj,kj->ak", sound, near.residual)
        stretch = (self.time - self.time[0]).astype(np.int64)
        sums = np.stack([np.bincount(stretch, each) for each in scores], axis=1)
        inverse = np.asarray(np.linalg.inv(information + prior), dtype=np.float64)
        return inverse @ (sums.T @ sums + prior) @ inverse + GRAIN**2 * np.eye(2), near.scale


@takes_arrays
class CommandChanges:
    """Changes of positions by commands that the robot takes later, fitted together with a ridge.

    A share of 1 is a command that is taken at its end instead of its begin. That its ramp may then be cut short by the
    next command is left to the residuals.

    Args:
        motion: commands and positions.
        values: delay and lag [s].
        ends: (m,) [s] of the commands, as `ServoMotion.begins`.
        ridge: squared ratio of the deviations of residuals [rad, m] and shares.
    """

    def __init__(self, motion: ServoMotion, values: Pair, ends: Float[np.ndarray, " m"], ridge: float) -> None:
        from scipy.sparse import csc_matrix, diags_array  # here: it takes 0.2 s to import
        from scipy.sparse.linalg import splu

        delay, lag = values.tolist()
        grid = np.arange(0.0, motion.taken + DECAYED * lag + GRID, GRID)
        answer = lagging(np.clip(grid / motion.taken, 0.0, 1.0)[:, None], lag, motion.order)[:, 0]
        at, begins = motion.time - delay, motion.begins
        first = np.asarray(np.searchsorted(at, begins), dtype=np.int64)
        counts = np.asarray(np.searchsorted(at, ends + float(grid[-1])), dtype=np.int64) - first
        starts = np.append(0, np.cumsum(counts)).astype(np.int64)
        rows = np.asarray(np.arange(starts[-1]) + np.repeat(first - starts[:-1], counts), dtype=np.int64)
        passed = np.asarray(at[rows] - np.repeat(begins, counts), dtype=np.float64)
        after = np.asarray(at[rows] - np.repeat(ends, counts), dtype=np.float64)
        waits = np.interp(passed, grid, answer) - np.where(after > 0.0, np.interp(after, grid, answer), 0.0)
        self._steps = np.diff(motion.targets, axis=0, prepend=motion.targets[:1])
        self._waits: Any = csc_matrix((waits, rows, starts), (len(at), len(counts)))
        pairs = (self._waits.T @ self._waits).tocoo()
        size = np.sum(self._steps[pairs.row] * self._steps[pairs.col], axis=1) * pairs.data
        matrix: Any = csc_matrix((size, (pairs.row, pairs.col)), shape=pairs.shape)
        self.sizes: Float[np.ndarray, " m"] = matrix.diagonal()  # squared, of each change
        self._factor: Any = splu(matrix + diags_array(np.full(len(counts), ridge)).tocsc())

    def shares(self, residual: Float[np.ndarray, "k n"]) -> Float[np.ndarray, " m"]:
        """Return the shares (m,) that explain residuals (k, n) best."""
        return self._factor.solve(-np.sum(self._steps * (self._waits.T @ residual), axis=1))

    def change(self, shares: Float[np.ndarray, " m"]) -> Float[np.ndarray, "k n"]:
        """Return what shares (m,) change of positions (k, n) [rad, m]."""
        return -(self._waits @ (self._steps * shares[:, None]))


class _Linearised:
    """Residuals as a linear function of delay, lag and the lateness of each command, all but delay and lag normal.

    The best delay and lag are those of largest likelihood with lateness integrated out.

    Args:
        motion: commands, how late they were taken, and positions.
        values: delay and lag [s].
    """

    def __init__(self, motion: ServoMotion, values: Pair) -> None:
        residual, _ = motion.compared(*values.tolist())
        self.slopes = np.stack([(motion.compared(*(values + STEP * way))[0] - residual) / STEP for way in np.eye(2)])
        scale, size, count = spread_of(residual), residual.size, len(motion.sent)
        if motion.late.any():
            self.scale = scale * np.sqrt(size / max(size - count, 0.2 * size))  # each lateness explains one of them
            jitter = max(float(np.sqrt(np.mean(motion.late**2))), LEAST_JITTER)
        else:
            self.scale, jitter = 0.5 * scale, scale / float(np.std(self.slopes[0]))
        self._late = CommandChanges(motion, values, motion.begins + GRID, (self.scale * GRID / jitter) ** 2)
        limit = CAUCHY * self.scale
        self.residual = np.clip(residual, -limit, limit) + self._late.change(motion.late / GRID)

    def unexplained(self, residual: Float[np.ndarray, "k n"]) -> Float[np.ndarray, "k n"]:
        """Return residuals (k, n) without what lateness explains of them."""
        return residual - self._late.change(self._late.shares(residual))

    def best(self) -> tuple[Pair, Float[np.ndarray, " m"]]:
        """Return the best step of delay and lag [s], and how late (m,) [s] commands were then taken."""
        sound = np.stack([self.unexplained(slope) for slope in self.slopes])
        information = np.einsum("akj,bkj->ab", sound, self.slopes) + (self.scale / ANY) ** 2 * np.eye(2)
        pull = np.einsum("akj,kj->a", sound, self.residual)
        step = -np.asarray(np.linalg.solve(information, pull), dtype=np.float64)
        late = GRID * self._late.shares(self.residual + np.einsum("akj,a->kj", self.slopes, step))
        mean = float(late.mean())  # is a delay
        return np.add(step, (mean, 0.0)), late - mean


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
