"""Touches in a series of estimates: when each began and ended, how hard, and where it was."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float, Int

from palpate.contact.estimate import ContactEstimate, Status
from palpate.sensors.recording import LARGEST

__all__ = ["Events", "TouchFinder", "find_touches"]

WINDOW = 0.1  # s over which points are averaged before it is asked how far they moved
LATEST = 1e20  # s: beyond any clock, in nanoseconds too
LEAST = 1e-24  # m^2: below any spread of a point
FAINT = 0.1  # of the heaviest window's weight: what weighs less has no say in that


@dataclass(frozen=True, eq=False)
class Events:
    """Touches, in the order of the file.

    Attributes:
        start: (k,) [s] of the first answered sample.
        end: (k,) [s] of the last.
        point: (k, 3) [m] mean of the answered points, each weighted by one over the trace of its covariance; equally
            where none has one. Of a touch that slid far on a curved body it lies off the surface.
        covariance: (k, 3, 3) [m^2] the same mean of the covariances: that of one sample, not divided by their number,
            because what is systematic (payload, mounting, filter) does not average out.
        normal: (k, 3) outward unit normal: direction of the mean.
        peak_force: (k,) [N] largest length of the force.
        peak_time: (k,) [s] when.
        mean_force: (k,) [N] mean length of the force.
        slid: (k,) [m] how far the point, averaged over 0.1 s, got from where it was first.
        samples: (k,) that were answered.
        ambiguous: (k,) share of these whose status is AMBIGUOUS.
    """

    start: Float[np.ndarray, " k"]
    end: Float[np.ndarray, " k"]
    point: Float[np.ndarray, "k 3"]
    covariance: Float[np.ndarray, "k 3 3"]
    normal: Float[np.ndarray, "k 3"]
    peak_force: Float[np.ndarray, " k"]
    peak_time: Float[np.ndarray, " k"]
    mean_force: Float[np.ndarray, " k"]
    slid: Float[np.ndarray, " k"]
    samples: Int[np.ndarray, " k"]
    ambiguous: Float[np.ndarray, " k"]

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            copy = np.array(value)
            copy.flags.writeable = False
            object.__setattr__(self, name, copy)

    def __len__(self) -> int:
        return len(self.start)

    @property
    def deviation(self) -> Float[np.ndarray, " k"]:
        """(k,) [m] standard deviation of the point in the direction in which it is largest; NaN where not known."""
        known = np.isfinite(self.covariance).all(axis=(1, 2))
        largest = np.full(len(self), np.nan)
        largest[known] = np.sqrt(np.linalg.eigvalsh(self.covariance[known])[:, -1].clip(min=0))
        return largest


def find_touches(
    time: Float[np.ndarray, " n"], estimate: ContactEstimate, *, gap: float = 0.05, shortest: float = 0.02
) -> Events:
    """Touches among estimates, one contact a sample; see `TouchFinder`.

    Args:
        time: (n,) [s].
        estimate: batch of n.
        gap: [s]; answered samples that are closer belong to one touch, whatever lies between them.
        shortest: [s]; a touch that lasts less is left out.
    """
    finder = TouchFinder(gap=gap, shortest=shortest)
    finder.add(time, estimate)
    return finder.touches()


class _Sum:
    """Columns of what is added up: of a sample, of a window, of a touch."""

    count = 0
    ambiguous = 1
    force = 2
    weight = 3
    weighted = slice(4, 7)  # point
    plain = slice(7, 10)  # point
    covariance = slice(10, 19)  # weighted
    normal = slice(19, 22)
    length = 22


class TouchFinder:
    """Finds touches in estimates that come block by block; of each block it keeps ten rows of sums a second of contact.

    Args:
        gap: [s]; answered samples that are closer, beyond one and a half steps of the samples, belong to one touch.
        shortest: [s]; a touch that lasts less is left out.
    """

    def __init__(self, *, gap: float = 0.05, shortest: float = 0.02) -> None:
        self._gap, self._shortest = gap, shortest
        self._last = np.empty(0)
        self._steps: list[float] = []
        self._windows: list[tuple[np.ndarray, np.ndarray]] = []

    def add(self, time: Float[np.ndarray, " n"], estimate: ContactEstimate) -> None:
        """The next samples, one contact each; what no sensor gives is left out, as its sums would overflow."""
        known = np.abs(time) <= LATEST  # not NaN
        steps = np.diff(np.concatenate([self._last, time[known]]))
        if (steps > 0).any():
            self._steps.append(float(np.median(steps[steps > 0])))
        self._last = time[known][-1:]
        numbers = np.concatenate([estimate.point, estimate.normal, estimate.force], axis=1)
        wanted = known & estimate.answered & ~(np.abs(numbers) > LARGEST).any(axis=1)
        if wanted.any():
            self._windows.append(_windows(time[wanted], estimate[wanted], self._gap))

    def touches(self) -> Events:
        """Those of all samples so far."""
        spans = np.concatenate([np.empty((0, 4)), *(spans for spans, _ in self._windows)])
        sums = np.concatenate([np.empty((0, _Sum.length)), *(sums for _, sums in self._windows)])
        step = float(np.median(self._steps)) if self._steps else 0.0
        ends = np.abs(spans[1:, 0] - spans[:-1, 1]) >= self._gap + 1.5 * step
        windows = _firsts(ends | (np.diff(np.floor(spans[:, 0] / WINDOW)) != 0), len(spans))  # blocks cut some in two
        touches = _firsts(ends, len(spans))
        spans, sums, firsts = _merged(spans, windows), _added(sums, windows), np.searchsorted(windows, touches)
        slid = _reach(sums, firsts)
        spans, sums = _merged(spans, firsts), _added(sums, firsts)
        long = spans[:, 1] - spans[:, 0] >= self._shortest
        return _events(spans[long], sums[long], slid[long])


def _firsts(ends: Bool[np.ndarray, " m"], count: int) -> Int[np.ndarray, " k"]:
    """Where the groups of `count` rows begin, if some of them end before the next row."""
    return np.flatnonzero(np.concatenate([[True], ends])[:count])


def _windows(
    time: Float[np.ndarray, " n"], estimate: ContactEstimate, gap: float
) -> tuple[Float[np.ndarray, "w 4"], Float[np.ndarray, "w 22"]]:
    """Answered samples, together as long as neither a window of time nor a touch ends: their spans and their sums."""
    strength = np.linalg.norm(estimate.force, axis=1)
    ends = (np.diff(np.floor(time / WINDOW)) != 0) | (np.abs(np.diff(time)) >= gap)
    firsts = _firsts(ends, len(time))
    spans = np.stack([time, time, strength, time], axis=1)
    return _merged(spans, firsts), _added(_samples(estimate, strength), firsts)


def _samples(estimate: ContactEstimate, strength: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 22"]:
    """What each sample adds."""
    covariance = estimate.covariance.reshape(-1, 9)
    trace = covariance[:, ::4].sum(axis=1, where=np.abs(covariance[:, ::4]) <= LARGEST)
    known = (np.abs(covariance) <= LARGEST).all(axis=1) & (trace > LEAST)
    weight = np.where(known, 1 / np.where(known, trace, 1.0), 0.0)
    table = np.empty((len(strength), _Sum.length))
    table[:, _Sum.count] = 1.0
    table[:, _Sum.ambiguous] = estimate.status == Status.AMBIGUOUS
    table[:, _Sum.force] = strength
    table[:, _Sum.weight] = weight
    table[:, _Sum.weighted] = weight[:, None] * estimate.point
    table[:, _Sum.plain] = estimate.point
    table[:, _Sum.covariance] = weight[:, None] * np.where(known[:, None], covariance, 0.0)
    table[:, _Sum.normal] = estimate.normal
    return table


def _merged(spans: Float[np.ndarray, "n 4"], firsts: Int[np.ndarray, " k"]) -> Float[np.ndarray, "k 4"]:
    """Start, end, largest force and its time, of all from each first to the next."""
    if not len(firsts):
        return np.empty((0, 4))
    group = np.repeat(np.arange(len(firsts)), np.diff(np.append(firsts, len(spans))))
    order = np.lexsort((-spans[:, 2], group))  # the strongest of each group comes where the group begins
    peaks = spans[order[firsts]]
    lasts = np.append(firsts[1:], len(spans)) - 1
    return np.column_stack([spans[firsts, 0], spans[lasts, 1], peaks[:, 2], peaks[:, 3]])


def _added(sums: Float[np.ndarray, "n 22"], firsts: Int[np.ndarray, " k"]) -> Float[np.ndarray, "k 22"]:
    return np.add.reduceat(sums, firsts, axis=0) if len(firsts) else np.empty((0, _Sum.length))


def _place(sums: Float[np.ndarray, "n 22"]) -> Float[np.ndarray, "n 3"]:
    """Mean point."""
    weight, count = sums[:, _Sum.weight, None], sums[:, _Sum.count, None]
    weighed = sums[:, _Sum.weighted] / np.where(weight > 0, weight, 1.0)
    return np.where(weight > 0, weighed, sums[:, _Sum.plain] / count)


def _reach(sums: Float[np.ndarray, "w 22"], firsts: Int[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
    """How far the means of windows lie from the first one, without those in which it was felt faintly."""
    place = _place(sums)
    weight = np.where(sums[:, _Sum.weight] > 0, sums[:, _Sum.weight], sums[:, _Sum.count])
    reach = np.zeros(len(firsts))
    for k, (first, end) in enumerate(pairwise([*firsts, len(sums)])):
        heavy = weight[first:end] >= FAINT * weight[first:end].max()
        clear = place[first:end][heavy]
        reach[k] = np.linalg.norm(clear - clear[0], axis=1).max()
    return reach


def _events(spans: Float[np.ndarray, "k 4"], sums: Float[np.ndarray, "k 22"], slid: Float[np.ndarray, " k"]) -> Events:
    weight, count = sums[:, _Sum.weight, None], sums[:, _Sum.count]
    covariance = np.where(weight > 0, sums[:, _Sum.covariance], np.nan) / np.where(weight > 0, weight, 1.0)
    normal = sums[:, _Sum.normal]
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    return Events(
        start=spans[:, 0],
        end=spans[:, 1],
        point=_place(sums),
        covariance=covariance.reshape(-1, 3, 3),
        normal=np.where(length > 0, normal, np.nan) / np.where(length > 0, length, 1.0),
        peak_force=spans[:, 2],
        peak_time=spans[:, 3],
        mean_force=sums[:, _Sum.force] / count,
        slid=slid,
        samples=count.astype(np.int64),
        ambiguous=sums[:, _Sum.ambiguous] / count,
    )
