"""Identify the delay between the clocks of poses and wrenches from how the payload's weight turns."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Bool, Float

from palpate.calibration.validation import Validation, cross_validate
from palpate.errors import InputError, NotIdentifiable
from palpate.signals.noise import estimate_noise
from palpate.signals.payload import Payload
from palpate.spatial.arguments import takes_arrays
from palpate.spatial.pose import rotation_from_quaternion
from palpate.spatial.pose_track import PoseTrack

AVERAGE = 0.01  # s of wrenches averaged into one: nothing turns far in it
COARSE, FINE = 2000, 40_000  # averages used for the search, and for the answer
GRID = 0.02  # s of the search
STEP = 0.01  # s at most of a step from there, and over which the poses' turning is taken
LEAST = 30  # averages without which there is no point
CAUCHY = 4.0  # standard deviations of a component, some 2.4 of the length: keeps 95 % of the efficiency
CLUSTER = 1.0  # s within which residuals may be alike (interpolated poses, a sensor's own filter)
SURE = 30.0  # gain in log-likelihood over the middle of the search that noise alone does not make
WIDEST = 4.0  # s: a search of more is not made wider
SUSPECTED, FEW = 1.6, 400  # s and averages of the search that suggests a calibration
TURNING = np.radians(5.0)  # rad/s
CLEARLY, LEAST_OFFSET = 0.5, 0.05  # share of the residual at 0, and s, that suggest one
FLAT = 0.03  # s: an offset that is not known better is no answer


@dataclass(frozen=True)
class ClockOffset:
    """Offset that is added to the stamps of poses, or of forces, to put them on the clock of the readings.

    Attributes:
        offset: [s].
        deviation: its standard deviation [s].
        residual: of the fit: robust standard deviation along each axis [N], or rms [counts] of a taxel.
        samples: number of readings used.
        validation: agreement of the offsets of parts of the log with those of the rest.
        notes: messages for the user, one sentence each.
    """

    offset: float
    deviation: float
    residual: float
    samples: int
    validation: Validation = field(default_factory=Validation)
    notes: tuple[str, ...] = ()


@takes_arrays
def identify_offset(
    time: Float[np.ndarray, " n"],
    wrenches: Float[np.ndarray, "n 6"],
    pose_time: Float[np.ndarray, " k"],
    quaternions: Float[np.ndarray, "k 4"],
    *,
    payload: Payload | None = None,
    search: tuple[float, float] = (-0.5, 0.5),
    max_gap: float = 0.25,
    noise: Float[np.ndarray, "6"] | None = None,
) -> ClockOffset:
    """Find the offset d at which the force is F(t) = R(t - d)^T w + f0, and return a `ClockOffset`.

    Weight w and bias f0 are fitted for each d of a grid; the sum of log(1 + r^2 / s^2) over the residuals r (Cauchy's
    likelihood) is least at the true d. Gauss-Newton steps follow, weighted 1 / (1 + r^2 / s^2). The standard deviation
    is the sandwich of these equations over stretches of 1 s.

    Args:
        time: (n,) [s] of the wrenches, on their clock.
        wrenches: (n, 6) [N, N m] in the sensor frame, as logged; only the forces are used.
        pose_time: (k,) [s] of the poses, on their clock.
        quaternions: (k, 4) x, y, z, w: sensor in base.
        payload: weight and bias; touches may then fill most of the log. None: they are fitted, and the sensor must be
            free in most of the log.
        search: lowest and highest offset [s] of the search. While the best one is at the edge, it is made twice as
            wide, up to 8 s.
        max_gap: [s] between poses, beyond which there is no orientation.
        noise: (6,) standard deviations of one reading; None: from the log.

    Raises:
        NotIdentifiable: the arm hardly turns, or the sensor has no payload.
        InputError: wrenches and poses do not overlap, times do not increase, `search` is not a range, or the best
            offset lies at its edge; or arrays of other shapes.
    """
    track = PoseTrack(max_gap=max_gap)
    track.add(pose_time, quaternions)
    low, high = search
    if not (np.isfinite([low, high]).all() and low < high):
        raise InputError(f"the search must go from a lower to a higher offset, not from {low} to {high}.")
    known = None if payload is None else np.concatenate([payload.weight, payload.force_bias])
    whole = _averaged(track, time, wrenches, known, noise)
    grid, costs = _searched(whole, low, high)
    while np.argmin(costs) in (0, len(grid) - 1) and high - low <= WIDEST:
        low, high = 1.5 * low - 0.5 * high, 1.5 * high - 0.5 * low
        grid, costs = _searched(whole, low, high)
    best = int(np.argmin(costs))
    gain = (np.median(costs) - costs[best]) / 2
    if not gain > SURE:  # NaN too
        raise _hardly_turns()
    if best in (0, len(grid) - 1):
        raise InputError(
            f"the best offset, {grid[best]:.3g} s, is at the edge of the search from {low:g} to {high:g} s.",
            hint="Search a wider range, or check that both clocks count from the same moment.",
        )
    return _judged(whole.usable(grid[best - 1 : best + 2], FINE), float(grid[best]))


@takes_arrays
def suspected_offset(
    time: Float[np.ndarray, " n"],
    wrenches: Float[np.ndarray, "n 6"],
    quaternions: Float[np.ndarray, "n 4"],
    payload: Payload,
) -> float:
    """Return an offset [s] of the poses' clock that explains the forces far better than 0; 0 if none does.

    It is the one of -1.6 to 1.6 s at which the median residual while the poses turn is least, if that is less than half
    of the one at 0 and the offset is 50 ms or more.

    Args:
        time: (n,) [s].
        wrenches: (n, 6) [N, N m] in the sensor frame, as logged.
        quaternions: (n, 4) x, y, z, w: sensor in base, on the clock of the poses.
        payload: weight and bias.

    Raises:
        InputError: arrays of other shapes.
    """
    track = PoseTrack()
    track.add(time, quaternions)
    grid = np.linspace(-SUSPECTED, SUSPECTED, 2 * round(SUSPECTED / GRID) + 1)
    try:
        whole = _averaged(track, time, wrenches, np.concatenate([payload.weight, payload.force_bias]), None)
        problem = _turning(whole).usable(grid[[0, -1, len(grid) // 2]], FEW)
    except InputError:  # too short, or no poses
        return 0.0
    residuals = [np.nanmedian(np.linalg.norm(problem.fit(problem.columns(each))[1], axis=1)) for each in grid]
    best = int(np.nanargmin(residuals))
    clear = residuals[best] < CLEARLY * residuals[len(grid) // 2] and abs(grid[best]) >= LEAST_OFFSET
    return float(grid[best]) if clear and 0 < best < len(grid) - 1 else 0.0


def _turning(whole: _Problem) -> _Problem:
    """Return the problem with the averages during which the poses turn."""
    before, after = (whole.track.at(whole.time + span)[0] for span in (-STEP, STEP))
    cosine = np.abs(np.sum(before * after, axis=1))
    turning = cosine < np.cos(TURNING * STEP)  # not NaN; half of the angle over two steps
    return replace(whole, time=whole.time[turning], force=whole.force[turning])


def _searched(whole: _Problem, low: float, high: float) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """Return a grid of offsets and their costs."""
    grid = np.linspace(low, high, int(np.clip(np.ceil((high - low) / GRID), 20, 2000)) + 1)
    problem = whole.usable(grid, COARSE)
    return grid, np.array([problem.cost(offset) for offset in grid])


@dataclass(frozen=True)
class _Problem:
    """Averages of `each` readings of force, of a noise `floor` [N], and the poses that explain them.

    `known` are weight and bias; None: they are fitted.
    """

    track: PoseTrack
    time: Float[np.ndarray, " n"]
    force: Float[np.ndarray, "n 3"]
    known: Float[np.ndarray, "6"] | None
    each: int
    floor: float

    def usable(self, offsets: Float[np.ndarray, " k"], most: int) -> _Problem:
        """Return the problem with at most `most` averages, those with a pose at every offset: all use the same ones."""
        every = max(1, -(-len(self.time) // most))
        time, force = self.time[::every], self.force[::every]
        known: Bool[np.ndarray, " n"] = np.ones(len(time), dtype=bool)
        for offset in offsets:
            known &= np.isfinite(self.track.at(time - offset)[0][:, 0])
        if np.count_nonzero(known) < LEAST:
            raise InputError(
                "hardly any wrench has a pose at every offset of the search.",
                hint="Check that poses and wrenches overlap in time, search a narrower range, or raise max_gap "
                "in [orientation].",
            )
        return replace(self, time=time[known], force=force[known])

    def columns(self, offset: float) -> Float[np.ndarray, "n 3 6"]:
        """Return the matrices that multiply (w, f0), (n, 3, 6)."""
        rotations = rotation_from_quaternion(self.track.at(self.time - offset)[0])
        identity = np.broadcast_to(np.eye(3), rotations.shape)
        return np.concatenate([rotations.swapaxes(-1, -2), identity], axis=-1)

    def fit(self, columns: np.ndarray) -> tuple[Float[np.ndarray, "6"], Float[np.ndarray, "n 3"]]:
        """Return (w, f0) and the residuals, by weights that narrow from the spread of all to that of the inliers."""
        if self.known is not None:
            return self.known, self.force - columns @ self.known
        weights = np.ones(len(self.force))
        solution, residual = np.zeros(6), self.force
        for _ in range(8):
            solution = _solve(columns, self.force, weights)
            residual = self.force - columns @ solution
            weights = _weights(residual, _scale(residual, self.floor))
        return solution, residual

    def cost(self, offset: float) -> float:
        """Return twice the negative log-likelihood, up to a constant, with `floor` as the scale."""
        squares = np.sum(self.fit(self.columns(offset))[1] ** 2, axis=1)
        return float(np.sum(np.log(squares + (CAUCHY * self.floor) ** 2)))

    def linearised(self, offset: float, solution: Float[np.ndarray, "6"]) -> tuple[np.ndarray, np.ndarray, float]:
        """Return the matrices of (w, f0), the modelled force's slope in the offset [N/s], and the residuals' scale.

        The slope is a difference over a step, as poses have kinks.
        """
        columns, span = self.columns(offset), STEP / 2
        slope = (self.columns(offset + span) - self.columns(offset - span)) @ solution / (2 * span)
        return columns, slope, _scale(self.force - columns @ solution, self.floor, touched=self.known is not None)


def _averaged(
    track: PoseTrack,
    time: Float[np.ndarray, " n"],
    wrenches: Float[np.ndarray, "n 6"],
    known: Float[np.ndarray, "6"] | None,
    noise: Float[np.ndarray, "6"] | None,
) -> _Problem:
    """Average times and forces over `AVERAGE`, without gaps."""
    steps = np.diff(time[np.isfinite(time)])
    steps = steps[steps > 0]
    if not len(steps):
        raise InputError(
            "the times of the wrenches never increase, so their clock cannot be compared.",
            hint="Correct the time's column and unit in the rig's [time].",
        )
    usual = float(np.median(steps))
    each = max(1, int(min(AVERAGE / usual, len(time))))
    count = len(time) // each
    times = time[: count * each].reshape(count, each)
    forces = wrenches[: count * each, :3].reshape(count, each, 3)
    whole = np.isfinite(forces).all(axis=(1, 2)) & (np.abs(times[:, -1] - times[:, 0]) <= 2 * each * usual)
    seen = estimate_noise(wrenches) if noise is None else None
    deviation = noise if seen is None else seen.deviation
    floor = 0.0 if deviation is None else float(np.mean(deviation[:3])) / each**0.5
    floor = max(floor, 1e-6) if noise is None else floor
    return _Problem(track, times[whole].mean(axis=1), forces[whole].mean(axis=1), known, each, floor)


def _refined(problem: _Problem, offset: float) -> tuple[ClockOffset, Float[np.ndarray, "6"]]:
    """Return the best offset near another, with weight and bias."""
    free = problem.known is None
    solution, _ = problem.fit(problem.columns(offset))
    columns, slope, spread = problem.linearised(offset, solution)
    for _ in range(30):
        jacobian = np.concatenate([slope[..., None], columns], axis=-1) if free else slope[..., None]
        residual = problem.force - columns @ solution
        step = _solve(jacobian, residual, _weights(residual, spread))
        offset += float(np.clip(step[0], -STEP, STEP))
        solution = solution + step[1:] if free else solution
        columns, slope, spread = problem.linearised(offset, solution)
        if abs(step[0]) < 1e-7:
            break
    residual = problem.force - columns @ solution
    _, information, variance = _score(problem, offset, solution, spread)
    deviation = variance**0.5 / information if information > 0 else np.inf
    if not deviation < FLAT:  # NaN too
        raise _hardly_turns(deviation)
    far = np.count_nonzero(np.linalg.norm(residual, axis=1) > 5.0 * spread) / len(residual)
    cause = "something touched, or the arm accelerated, whose inertia is not modelled"
    said = (f"{far:.0%} of the samples are far from the fit ({cause}) and hardly count.",) if far > 0.02 else ()
    return ClockOffset(offset, deviation, spread, len(residual) * problem.each, notes=said), solution


def _judged(problem: _Problem, offset: float) -> ClockOffset:
    """Return the offset, its deviation widened where parts of the log differ from the rest."""
    found, _ = _refined(problem, offset)

    def predict(left: Bool[np.ndarray, " n"]) -> tuple[np.ndarray, np.ndarray]:
        part, others = (replace(problem, time=problem.time[rows], force=problem.force[rows]) for rows in (left, ~left))
        rest, solution = _refined(others, found.offset)
        seen = part.usable(rest.offset + GRID * np.arange(-1, 2), FINE)  # the rest may fit best elsewhere
        gradient, information, variance = _score(seen, rest.offset, solution, found.residual)
        return np.array([gradient]), np.array([[variance + (information * rest.deviation) ** 2]])

    left = cross_validate(len(problem.time), predict)
    widened = found.deviation * left.widening**0.5
    return replace(found, deviation=widened, validation=left, notes=(*found.notes, *left.notes))


def _score(
    problem: _Problem, offset: float, solution: Float[np.ndarray, "6"], spread: float
) -> tuple[float, float, float]:
    """Return the sums of `_sums` for an offset, weight and bias."""
    columns, slope, _ = problem.linearised(offset, solution)
    residual = problem.force - columns @ solution
    across = slope - columns @ _solve(columns, slope, _weights(residual, spread)) if problem.known is None else slope
    return _sums(problem.time, across, residual, spread)


def _sums(time: np.ndarray, across: np.ndarray, residual: np.ndarray, spread: float) -> tuple[float, float, float]:
    """Return the sum of psi, one equation for the offset, with its slope and its variance.

    The variance is that of sums over stretches, about their mean, or of independent residuals where that is larger.
    """
    weights = _weights(residual, spread)
    along = np.sum(across * residual, axis=1)
    lost = 2.0 * (weights * along / (CAUCHY * spread)) ** 2  # a far residual pulls less the further it is
    information = float(np.sum(weights * np.sum(across**2, axis=1) - lost))
    stretch = np.unique(np.floor((time - time[0]) / CLUSTER), return_inverse=True)[1]
    sums = np.bincount(stretch.reshape(-1), weights * along)
    alike = float(np.sum((sums - sums.mean()) ** 2)) * len(sums) / max(len(sums) - 1, 1)
    return float(sums.sum()), information, max(alike, float(np.sum((weights * along) ** 2)))


def _solve(columns: Float[np.ndarray, "n 3 p"], target: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Solve weighted least squares; with least length where weight and bias are not separated."""
    weighted = (columns * weights[:, None, None]).reshape(-1, columns.shape[-1])
    matrix = weighted.T @ columns.reshape(-1, columns.shape[-1])
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    inverse = np.linalg.pinv(matrix / np.outer(scale, scale), rcond=1e-10, hermitian=True)
    return inverse @ (weighted.T @ target.reshape(-1) / scale) / scale


def _weights(residual: Float[np.ndarray, "n 3"], scale: float) -> Float[np.ndarray, " n"]:
    return 1.0 / (1.0 + np.sum(residual**2, axis=1) / (CAUCHY * scale) ** 2)


def _scale(residual: Float[np.ndarray, "n 3"], floor: float, *, touched: bool = False) -> float:
    """Return a robust standard deviation along an axis, at least that of the noise.

    It is from the lowest quarter of residuals where touches may fill more than half of the log.
    """
    share, of_normal = (0.25, 0.3186) if touched else (0.5, 0.6745)
    return max(float(np.quantile(np.abs(residual), share)) / of_normal, floor)


def _hardly_turns(deviation: float = np.inf) -> NotIdentifiable:
    sure = f": the offset would be known only to {deviation:.2g} s" if np.isfinite(deviation) else ""
    return NotIdentifiable(
        f"the wrenches do not show when the arm turns, so its clock cannot be compared{sure}. "
        "Turn the loaded sensor by 30 degrees or more, to and fro, with nothing touching it.",
        rank=0,
        missing=("clock offset",),
    )
