"""Compute second derivatives of sampled paths, and their noise, with a parabola through the parts of a window.

The path is averaged over nine parts of the window, and a parabola goes through the averages by least squares
[Savitzky and Golay 1964]. Parts are longer than the period of slower poses that rows repeat or interpolate.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

PARTS = 9
LONGEST = 1.0  # s: windows are not made longer than this for slow poses
EVEN = 0.2  # share by which a window's duration may differ from what its rows should take
ROUNDING = 1e-12  # of the largest value: smaller changes of slope are none

_PLACES = np.arange(PARTS) - (PARTS - 1) / 2
_BASIS = np.stack([np.ones(PARTS), _PLACES, _PLACES**2 / 2], axis=1)
_FIT = np.linalg.pinv(_BASIS)
_LEFT = np.linalg.qr(np.hstack([_BASIS, np.eye(PARTS)]))[0][:, 3:].T  # across every parabola, orthonormal
_BOTH = np.vstack([_FIT[2], _LEFT])


@dataclass(frozen=True)
class WindowSettings:
    """Window settings that are fixed for a log.

    Attributes:
        step: usual time from row to row [s].
        part: rows of a part.
        longest: rows of the longest part.
    """

    step: float
    part: int
    longest: int

    @property
    def reach(self) -> int:
        """Number of rows before and after a row on which its answer may depend."""
        return PARTS * self.longest


@dataclass(frozen=True)
class Curvature:
    """Second derivatives of a path, row by row.

    Attributes:
        value: (n, k) second derivative [unit of the path/s^2]; NaN where no window is near.
        noise: (n,) standard deviation of its norm over the columns, from the residuals of the parabola.
        usual: median of `noise`.
        borrowed: (n,) True where a row's window is incomplete and the nearest complete one answers.
        half: rows to either side of a window's middle.
    """

    value: Float[np.ndarray, "n k"]
    noise: Float[np.ndarray, " n"]
    usual: float
    borrowed: Bool[np.ndarray, " n"]
    half: int


def settings_of(time: Float[np.ndarray, " n"], window: float, scale: float, most: int) -> WindowSettings:
    """Return the `WindowSettings` of a log, from its first rows.

    Args:
        time: (n,) [s] of the first rows.
        window: [s] of the usual window.
        scale: longest window over the usual one, unless 1 s is longer.
        most: rows that a window may have.
    """
    steps = np.diff(time)
    steps = steps[np.isfinite(steps) & (steps > 0)]
    step = float(np.median(steps)) if len(steps) else 1.0
    largest = float(most // PARTS - 1)
    part, longest = (_odd(min(seconds / step / PARTS, largest)) for seconds in (window, max(scale * window, LONGEST)))
    return WindowSettings(step, part, longest)


def curvature(
    time: Float[np.ndarray, " n"],
    path: Float[np.ndarray, "n k"],
    settings: WindowSettings,
    part: int,
    factor: float = 1.0,
) -> Curvature:
    """Compute the second derivatives of the columns of `path` at each row's time, as a `Curvature`.

    Args:
        time: (n,) [s]; an uneven window gives no answer.
        path: (n, k); NaN where it is not known.
        settings: from `settings_of`.
        part: rows of a part, odd, from `part_of`.
        factor: of the noise, from `part_of`.
    """
    half = (PARTS * part - 1) // 2
    value, noise = np.full(path.shape, np.nan), np.full(len(path), np.nan)
    if len(path) > 2 * half:
        value[half : len(path) - half], noise[half : len(path) - half] = _parabola(time, path, part, settings.step)
    noise *= factor
    whole = np.isfinite(noise)
    usual = float(np.median(noise[whole])) if whole.any() else 0.0
    nearest = _nearest(whole)
    reached = np.abs(time - time[nearest]) <= (1 + EVEN) * half * settings.step  # not NaN
    known = (whole | reached) & np.isfinite(path).all(axis=1)
    value = np.where(known[:, None], value[nearest], np.nan)
    return Curvature(value, np.where(known, noise[nearest], 0.0), usual, known & ~whole, half)


def _parabola(
    time: np.ndarray, path: np.ndarray, part: int, step: float
) -> tuple[Float[np.ndarray, "m k"], Float[np.ndarray, " m"]]:
    """Return value and noise at the centres of all windows; NaN where rows are missing or uneven."""
    span = PARTS * part - 1
    bad = ~(np.isfinite(path).all(axis=1) & np.isfinite(time))
    clean = np.where(bad[:, None], 0.0, path)
    clean = np.where(bad[:, None], 0.0, clean - np.sum(clean, axis=0) / max(np.count_nonzero(~bad), 1))  # for the sums
    sums = np.concatenate([np.zeros((1, path.shape[1])), np.cumsum(clean, axis=0)])
    averages = (sums[part:] - sums[:-part]) / part
    count = len(path) - span
    parts = np.stack([averages[k * part : k * part + count] for k in range(PARTS)])
    lasting = time[span:] - time[:count]
    duration = np.abs(lasting - span * step) <= EVEN * span * step
    missing = np.cumsum(np.append(0, bad))
    good = duration & (missing[span + 1 :] == missing[:count])
    scale = np.where(good, (part * lasting / span) ** 2, np.nan)
    found = np.einsum("pq,qnk->pnk", _BOTH, parts)  # not BLAS: its threads take longer than the sums
    value, left = found[0] / scale[:, None], np.sum(found[1:] ** 2, axis=0)
    variance = np.sum(left, axis=1) / (PARTS - 3) * float(_FIT[2] @ _FIT[2])
    return value, np.sqrt(variance) / scale


def _nearest(whole: Bool[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
    """Return for each row the nearest row in `whole`, or the row itself if there is none."""
    rows = np.arange(len(whole))
    if not whole.any():
        return rows
    marked = np.flatnonzero(whole)
    after = np.minimum(np.searchsorted(marked, rows), len(marked) - 1)
    before = np.maximum(after - 1, 0)
    return np.where(np.abs(marked[before] - rows) < np.abs(marked[after] - rows), marked[before], marked[after])


def part_of(period: float, settings: WindowSettings, scale: float = 1.0, periods: float = 2.0) -> tuple[int, float]:
    """Return the rows of a part, odd, and the factor of the noise, 1 or more.

    With fewer than two periods of interpolated poses in a part, the parabola fits some of their noise.

    Args:
        period: rows from pose to pose, from `pose_period`.
        settings: from `settings_of`.
        scale: factor of the settings' window.
        periods: least number of periods in a part.
    """
    part = min(_odd(max(scale * settings.part, periods * period)), settings.longest)
    return part, max(1.0, 2.0 * period / part) ** 0.5


def pose_period(poses: Float[np.ndarray, "n 8"], settings: WindowSettings) -> float:
    """Return the number of rows from pose to pose, by the kinks of rows that interpolate or repeat slower poses.

    It is 0 where every row is a pose, or nothing moves.

    Args:
        poses: (n, 8) time, quaternion and position, row by row.
        settings: from `settings_of`.
    """
    time, quaternion, position = poses[:, 0], poses[:, 1:5], poses[:, 5:]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        rates = np.hstack([turns(quaternion), np.diff(position, axis=0)]) / np.diff(time)[:, None]
        change = np.abs(np.diff(rates, axis=0)) * settings.step
        largest = max(1.0, float(np.max(np.abs(position), initial=0.0, where=np.isfinite(position))))
        kinked: Bool[np.ndarray, " m"] = np.any(change > ROUNDING * largest, axis=1)
    return _period(np.flatnonzero(kinked))


def _period(kinked: Int[np.ndarray, " k"]) -> float:
    """Return the rows from pose to pose; a kink between rows shows in both, but counts once."""
    steps = np.diff(kinked, prepend=-2, append=kinked[-1:] + 2) if len(kinked) else kinked
    pairs = (steps[1:-1] == 1) & (steps[:-2] != 1) & (steps[2:] != 1)
    poses = kinked[np.append(True, ~pairs)] if len(kinked) > 1 else kinked
    return float(np.median(np.diff(poses))) if len(poses) > 3 else 0.0


def turns(quaternion: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, "m 3"]:
    """Return the rotation vectors [rad], in the base, from each row to the next."""
    unit = quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True)
    v, w, u, s = unit[:-1, :3], unit[:-1, 3:], unit[1:, :3], unit[1:, 3:]
    vector = w * u - s * v - np.cross(u, v)
    cosine = w * s + np.sum(v * u, axis=1, keepdims=True)
    sine = np.linalg.norm(vector, axis=1, keepdims=True)
    angle = 2.0 * np.arctan2(sine, np.abs(cosine))
    scale = np.divide(angle, sine, out=np.full_like(sine, 2.0), where=sine > 0)
    return scale * np.sign(cosine) * vector


def _odd(rows: float) -> int:
    return int(rows / 2) * 2 + 1
