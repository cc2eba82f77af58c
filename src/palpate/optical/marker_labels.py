"""Label blobs as markers of a ring: on the circle, against their places at rest, never by sorting alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from palpate.spatial.arguments import takes_arrays

__all__ = ["USUAL_LIMITS", "LabelLimits", "label_ring", "owed"]


@dataclass(frozen=True)
class LabelLimits:
    """Limits of a marker's displacement from rest, and of the blobs that may pass for it.

    Args:
        inward, outward: displacement along the radius [m].
        size: a marker's area is between rest / size and rest * size.
        area: standard deviation of the logarithm of an area from the neighbours'.
        missing: cost of leaving a marker out; displacements and sizes cost half the square of their errors in standard
            deviations.
        steady: standard deviation of a displacement along the radius where nothing is displaced [m].
        share: of the displacement nearby, by which a marker's own may vary.
        reach: width of the skin's response to a press, from its middle [rad].
        jump: standard deviation from a marker's expected place, where that is known [m].
        doubt: a marker more than this many standard deviations from its neighbours' prediction is left out.
    """

    inward: float = 12e-3
    outward: float = 4e-3
    size: float = 1.7
    area: float = 0.15
    missing: float = 6.0
    steady: float = 0.3e-3
    share: float = 1.2
    reach: float = 0.26
    jump: float = 1.5e-3
    doubt: float = 3.7


USUAL_LIMITS = LabelLimits()
_SIZE = 0.2  # standard deviation of the logarithm of an area
_LONGEST = 4  # markers: over longer gaps neighbours predict nothing
_EVEN = 3e-3  # variance of what is uneven from marker to marker, of the variance of displacements
_CAP = 8.0  # of the cost of a jump: what moved faster than expected may still be found by its neighbours


@takes_arrays
def label_ring(
    blobs: Float[np.ndarray, "k 2"],
    areas: Float[np.ndarray, " k"],
    rest: Float[np.ndarray, "m 2"],
    rest_areas: Float[np.ndarray, " m"],
    *,
    expected: Float[np.ndarray, "m 2"] | None = None,
    price: Float[np.ndarray, " k"] | None = None,
    limits: LabelLimits = USUAL_LIMITS,
) -> Int[np.ndarray, " m"]:
    """Return the index of every marker's blob, (m,), -1 where it is missing.

    Each blob is a candidate for the marker whose sector it lies in, if its place and area are possible for that marker.
    Of all ways around the ring that take or leave candidates, the one whose displacements are smoothest is taken; then
    candidates that still contradict their neighbours are left out, worst first.

    Args:
        blobs: (k, 2) places in the ring's plane [m].
        areas: (k,) of the blobs, in the unit of `rest_areas`.
        rest: (m, 2) places at rest [m], by rising angle.
        rest_areas: (m,) at rest.
        expected: (m, 2) expected places of the markers [m]; NaN where nothing is known.
        price: (k,) additional cost of each blob; None: 0.
        limits: see `LabelLimits`.
    """
    from palpate.optical._markers import label_path  # here: compiled loops load when first needed

    labels = np.full(len(rest), -1)
    marker, blob, moved = _candidates(blobs, areas, rest, rest_areas, limits)
    if not len(blob):
        return labels
    size = np.log(areas[blob] / rest_areas[marker])
    usual = np.median(size)
    extra = np.zeros(len(blob))
    if expected is not None:
        off = np.sum((blobs[blob] - expected[marker]) ** 2, axis=-1) / limits.jump**2
        extra = np.minimum(np.nan_to_num(off), _CAP)
    own = 0.5 * (((size - usual) / _SIZE) ** 2 + extra)
    if price is not None:
        own += price[blob]
    first = np.searchsorted(marker, np.arange(len(rest) + 1))
    settings = np.array([limits.missing, 2 * limits.steady, 0.35, _LONGEST])
    label_path(first, moved, own, settings, labels)
    _settle(labels, np.column_stack([moved, size]), first, extra, _Neighbours(rest, limits))
    return np.where(labels >= 0, blob[labels], -1)


@takes_arrays
def owed(
    blobs: Float[np.ndarray, "k 2"],
    areas: Float[np.ndarray, " k"],
    rest: Float[np.ndarray, "m 2"],
    rest_areas: Float[np.ndarray, " m"],
    limits: LabelLimits = USUAL_LIMITS,
) -> Float[np.ndarray, " k"]:
    """Return the cost of taking blobs from this ring for the ring before it, (k,), as `label_ring`'s `price`.

    A marker of the ring before it, pressed in, may stand where one of this ring rests; the skin does not fold, so that
    this ring's own is the innermost of its candidates, and without that one it has none.
    """
    marker, blob, moved = _candidates(blobs, areas, rest, rest_areas, limits)
    cost, inmost = np.zeros(len(blobs)), np.full(len(rest), np.inf)
    np.minimum.at(inmost, marker, moved[:, 0])
    cost[blob[moved[:, 0] == inmost[marker]]] = limits.missing
    return cost


def _candidates(
    blobs: np.ndarray, areas: np.ndarray, rest: np.ndarray, rest_areas: np.ndarray, limits: LabelLimits
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return markers (sorted) and blobs that may match, and the displacements outward and anticlockwise [m]."""
    angle = np.arctan2(rest[:, 1], rest[:, 0])
    half = np.pi / len(rest)
    turn = np.arctan2(blobs[:, 1], blobs[:, 0])[None] - angle[:, None]
    turn = np.arctan2(np.sin(turn), np.cos(turn))
    radius = np.linalg.norm(rest, axis=1)[:, None]
    outward = np.linalg.norm(blobs, axis=1)[None] - radius
    with np.errstate(invalid="ignore"):
        ratio = np.abs(np.log(areas[None] / rest_areas[:, None]))
        near = (np.abs(turn) == np.abs(turn).min(axis=0)) & (np.abs(turn) < half)
        near &= (outward > -limits.inward) & (outward < limits.outward) & (ratio < np.log(limits.size))
    marker, blob = np.nonzero(near)
    moved = np.stack([outward[marker, blob], (radius * turn)[marker, blob]], axis=-1)
    return marker, blob, moved


class _Neighbours:
    """Prediction of a marker from its neighbours by a Gaussian process on the ring [Rasmussen and Williams 2006, 5.12].

    The skin's response to a press is `reach` wide, so that displacements have that correlation; their variance is the
    square of the displacement nearby.
    """

    def __init__(self, rest: np.ndarray, limits: LabelLimits) -> None:
        angle = np.arctan2(rest[:, 1], rest[:, 0])
        apart = np.abs(np.arctan2(np.sin(angle[:, None] - angle), np.cos(angle[:, None] - angle)))
        wide = np.exp(-0.5 * (apart / (2.5 * limits.reach)) ** 2)
        self.prior = np.exp(-0.5 * (apart / limits.reach) ** 2) + 0.15 * wide + _EVEN * np.eye(len(rest))
        self.nearby = np.exp(-0.5 * (apart / (1.5 * limits.reach)) ** 2) - np.eye(len(rest))
        self.radius, self.limits = np.linalg.norm(rest, axis=1), limits

    def said(self, known: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Predict every marker from the others: (m, 3) mean, (m, 3) standard deviation, and (m,) any neighbours.

        Values are the displacement outward and anticlockwise [m] and the logarithm of the area over that at rest.
        """
        there = np.flatnonzero(known)
        inverse = np.linalg.inv(self.prior[np.ix_(there, there)])
        weight = self.prior[:, there] @ inverse  # of the missing ones
        variance = np.diag(self.prior) - np.sum(weight * self.prior[:, there], axis=1)
        mean = weight @ values[there]
        own = np.diag(inverse)
        mean[there] = values[there] - inverse @ values[there] / own[:, None]
        variance[there] = 1.0 / own
        nearby = self.nearby * known
        moved = np.linalg.norm(values[:, :2], axis=1)
        size = np.maximum(np.max(nearby * moved, axis=1, initial=0.0), 0.3 * moved)
        spread = np.empty_like(mean)
        spread[:, :2] = self.limits.share * np.sqrt(variance)[:, None] * size[:, None] * (1.0, 0.5)
        spread[:, :2] = np.hypot(spread[:, :2], (self.limits.steady, 0.6 * self.limits.steady))
        spread[:, 2] = self.limits.area + size / self.radius
        total = nearby.sum(axis=1)
        mean[:, 2] = nearby @ np.where(known, values[:, 2], 0.0) / np.maximum(total, 1e-12)
        return mean, spread, total > 0.1


def _settle(labels: np.ndarray, values: np.ndarray, first: np.ndarray, extra: np.ndarray, judge: _Neighbours) -> None:
    """Remove, worst first, the labels that contradict their neighbours; then add candidates that agree with them."""
    limit = judge.limits.doubt**2
    while (labels >= 0).any():
        known = labels >= 0
        here = np.where(known[:, None], values[labels], 0.0)
        mean, spread, judged = judge.said(known, here)
        doubt = np.sum(((here - mean) / spread) ** 2, axis=1) + np.where(known, extra[labels], 0.0)
        doubt = np.where(known & judged, doubt, 0.0)
        worst = int(np.argmax(doubt))
        if doubt[worst] <= limit:
            break
        labels[worst] = -1
    if not (labels >= 0).any():
        return
    known = labels >= 0
    mean, spread, judged = judge.said(known, np.where(known[:, None], values[labels], 0.0))
    for i in np.flatnonzero(~known & judged):
        mine = np.arange(int(first[i]), int(first[i + 1]))
        doubt = np.sum(((values[mine] - mean[i]) / spread[i]) ** 2, axis=1) + extra[mine]
        if len(mine) and doubt.min() <= 0.5 * limit:
            labels[i] = mine[np.argmin(doubt)]
