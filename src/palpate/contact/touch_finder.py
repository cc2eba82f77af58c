"""Find touches in contacts, which may come block by block."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float, Int

from palpate.contact.contacts import Contacts
from palpate.contact.estimate import Status
from palpate.contact.events import Events
from palpate.signals.recording import LARGEST

__all__ = ["TouchFinder", "find_touches"]

WINDOW = 0.1  # s over which points are averaged before it is asked how far they moved
LATEST = 1e20  # s: beyond any clock, in nanoseconds too
LEAST = 1e-24  # m^2: below any spread of a point
FAINT = 0.1  # of the heaviest window's weight: what weighs less has no say in that


def find_touches(contacts: Contacts, *, gap: float = 0.05, shortest: float = 0.02) -> Events:
    """Return the touches among contacts as `Events`.

    Args:
        contacts: of any sensor.
        gap: [s]; answered samples of one identity closer than this plus 1.5 sample steps are one touch.
        shortest: [s]; a touch that lasts less is left out.
    """
    finder = TouchFinder(gap=gap, shortest=shortest)
    finder.add(contacts)
    return finder.touches()


class _Span:
    """Columns of the times of a sample, window or touch."""

    start = 0
    end = 1
    peak = 2  # the largest force
    at = 3  # when that was
    identity = 4
    row = 5  # of the first, among all rows
    length = 6


class _Sum:
    """Columns of sums, before the sum of each feature and the number of samples that have it."""

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
    """Finder of touches in contacts that come block by block; ten rows of sums per second and identity are kept.

    Args:
        gap: [s]; answered samples of one identity closer than this plus 1.5 sample steps are one touch.
        shortest: [s]; a touch that lasts less is left out.
    """

    def __init__(self, *, gap: float = 0.05, shortest: float = 0.02) -> None:
        self._gap, self._shortest = gap, shortest
        self._last = np.empty(0)
        self._steps: list[float] = []
        self._rows, self._features = 0, dict[str, None]()
        self._windows: list[tuple[np.ndarray, np.ndarray]] = []

    def add(self, contacts: Contacts) -> None:
        """Add the next contacts; numbers whose sums would overflow are left out."""
        time, estimate = contacts.time, contacts.estimate
        known = np.abs(time) <= LATEST  # not NaN
        steps = np.diff(np.concatenate([self._last, time[known]]))
        if (steps > 0).any():
            self._steps.append(float(np.median(steps[steps > 0])))
        self._last = time[known][-1:]
        self._features |= dict.fromkeys(contacts.features)
        numbers = np.concatenate([estimate.point, estimate.normal, estimate.force], axis=1)
        rows = np.flatnonzero(known & estimate.answered & ~(np.abs(numbers) > LARGEST).any(axis=1))
        if len(rows):
            rows = rows[np.argsort(contacts.identity[rows], kind="stable")]
            spans, sums = _samples(contacts[rows], tuple(self._features))
            spans[:, _Span.row] = self._rows + rows
            firsts = _firsts(_changes(spans) | (np.abs(np.diff(spans[:, _Span.start])) >= self._gap), len(spans))
            self._windows.append((_merged(spans, firsts), _added(sums, firsts)))
        self._rows += len(time)

    def touches(self) -> Events:
        """Return the touches of all samples so far as `Events`."""
        width = _Sum.length + 2 * len(self._features)
        spans = np.concatenate([np.empty((0, _Span.length)), *(spans for spans, _ in self._windows)])
        sums = np.concatenate([np.empty((0, width)), *(_widened(sums, width) for _, sums in self._windows)])
        order = np.argsort(spans[:, _Span.identity], kind="stable")
        spans, sums = spans[order], sums[order]
        step = float(np.median(self._steps)) if self._steps else 0.0
        ends = np.abs(spans[1:, _Span.start] - spans[:-1, _Span.end]) >= self._gap + 1.5 * step
        ends |= np.diff(spans[:, _Span.identity]) != 0
        windows = _firsts(ends | _changes(spans), len(spans))  # blocks cut some in two
        touches = _firsts(ends, len(spans))
        spans, sums, firsts = _merged(spans, windows), _added(sums, windows), np.searchsorted(windows, touches)
        slid = _reach(sums, firsts)
        spans, sums = _merged(spans, firsts), _added(sums, firsts)
        order = np.argsort(spans[:, _Span.row])
        long = order[(spans[:, _Span.end] - spans[:, _Span.start] >= self._shortest)[order]]
        return _events(spans[long], sums[long], slid[long], tuple(self._features))


def _firsts(ends: Bool[np.ndarray, " m"], count: int) -> Int[np.ndarray, " k"]:
    """Return the first row of each group of `count` rows; `ends` masks the rows after which a group ends."""
    return np.flatnonzero(np.concatenate([[True], ends])[:count])


def _changes(spans: Float[np.ndarray, "n s"]) -> Bool[np.ndarray, " m"]:
    """Return a mask of the rows after which another window of time or identity begins."""
    later = np.diff(np.floor(spans[:, _Span.start] / WINDOW)) != 0
    return later | (np.diff(spans[:, _Span.identity]) != 0)


def _widened(sums: Float[np.ndarray, "n w"], width: int) -> Float[np.ndarray, "n v"]:
    """Return sums with zeros for features that came later."""
    had, have = (sums.shape[1] - _Sum.length) // 2, (width - _Sum.length) // 2
    if had == have:
        return sums
    wide = np.zeros((len(sums), width))
    wide[:, : _Sum.length + had] = sums[:, : _Sum.length + had]
    wide[:, _Sum.length + have : _Sum.length + have + had] = sums[:, _Sum.length + had :]
    return wide


def _samples(
    contacts: Contacts, features: tuple[str, ...]
) -> tuple[Float[np.ndarray, "n s"], Float[np.ndarray, "n w"]]:
    """Return the times of each answered contact, and its terms in the sums."""
    estimate, count = contacts.estimate, len(contacts)
    strength = np.linalg.norm(estimate.force, axis=1)
    spans = np.stack([contacts.time] * 2 + [strength, contacts.time, contacts.identity, np.zeros(count)], axis=1)
    covariance = estimate.covariance.reshape(-1, 9)
    trace = covariance[:, ::4].sum(axis=1, where=np.abs(covariance[:, ::4]) <= LARGEST)
    known = (np.abs(covariance) <= LARGEST).all(axis=1) & (trace > LEAST)
    weight = np.where(known, 1 / np.where(known, trace, 1.0), 0.0)
    added = np.full((count, len(features)), np.nan)
    for column, name in enumerate(features):
        added[:, column] = contacts.features.get(name, np.nan)
    felt = np.abs(added) <= LARGEST
    numbers = np.stack([np.ones(count), estimate.status == Status.AMBIGUOUS, strength, weight], axis=1)
    weighted, plain, normal = weight[:, None] * estimate.point, estimate.point, estimate.normal
    spreads = weight[:, None] * np.where(known[:, None], covariance, 0.0)
    # in the order of `_Sum`
    return spans, np.concatenate([numbers, weighted, plain, spreads, normal, np.where(felt, added, 0.0), felt], axis=1)


def _merged(spans: Float[np.ndarray, "n s"], firsts: Int[np.ndarray, " k"]) -> Float[np.ndarray, "k s"]:
    """Return start, end, largest force and its time, identity and first row of each group."""
    if not len(firsts):
        return np.empty((0, _Span.length))
    group = np.repeat(np.arange(len(firsts)), np.diff(np.append(firsts, len(spans))))
    order = np.lexsort((-spans[:, _Span.peak], group))  # the strongest of each group comes where the group begins
    peaks = [_Span.peak, _Span.at]
    lasts = np.append(firsts[1:], len(spans)) - 1
    merged = spans[firsts]
    merged[:, _Span.end] = spans[lasts, _Span.end]
    merged[:, peaks] = spans[order[firsts]][:, peaks]
    return merged


def _added(sums: Float[np.ndarray, "n w"], firsts: Int[np.ndarray, " k"]) -> Float[np.ndarray, "k w"]:
    return np.add.reduceat(sums, firsts, axis=0) if len(firsts) else np.empty((0, sums.shape[1]))


def _place(sums: Float[np.ndarray, "n w"]) -> Float[np.ndarray, "n 3"]:
    """Return mean points (n, 3) [m], weighted if there are weights."""
    weight, count = sums[:, _Sum.weight, None], sums[:, _Sum.count, None]
    weighed = sums[:, _Sum.weighted] / np.where(weight > 0, weight, 1.0)
    return np.where(weight > 0, weighed, sums[:, _Sum.plain] / count)


def _reach(sums: Float[np.ndarray, "n w"], firsts: Int[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
    """Return the largest distance [m] of the mean points of windows from the first; light windows do not count."""
    place = _place(sums)
    weight = np.where(sums[:, _Sum.weight] > 0, sums[:, _Sum.weight], sums[:, _Sum.count])
    reach = np.zeros(len(firsts))
    for k, (first, end) in enumerate(pairwise([*firsts, len(sums)])):
        heavy = weight[first:end] >= FAINT * weight[first:end].max()
        clear = place[first:end][heavy]
        reach[k] = np.linalg.norm(clear - clear[0], axis=1).max()
    return reach


def _events(
    spans: Float[np.ndarray, "k s"],
    sums: Float[np.ndarray, "k w"],
    slid: Float[np.ndarray, " k"],
    names: tuple[str, ...],
) -> Events:
    weight, count = sums[:, _Sum.weight, None], sums[:, _Sum.count]
    covariance = np.where(weight > 0, sums[:, _Sum.covariance], np.nan) / np.where(weight > 0, weight, 1.0)
    normal = sums[:, _Sum.normal]
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    added, felt = np.split(sums[:, _Sum.length :], 2, axis=1)
    means = np.where(felt > 0, added, np.nan) / np.where(felt > 0, felt, 1.0)
    return Events(
        start=spans[:, _Span.start],
        end=spans[:, _Span.end],
        point=_place(sums),
        covariance=covariance.reshape(-1, 3, 3),
        normal=np.where(length > 0, normal, np.nan) / np.where(length > 0, length, 1.0),
        peak_force=spans[:, _Span.peak],
        peak_time=spans[:, _Span.at],
        mean_force=sums[:, _Sum.force] / count,
        slid=slid,
        samples=count.astype(np.int64),
        ambiguous=sums[:, _Sum.ambiguous] / count,
        identity=spans[:, _Span.identity].astype(np.int64),
        features=dict(zip(names, means.T, strict=True)),
    )
