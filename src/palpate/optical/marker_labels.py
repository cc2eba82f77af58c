"""Label blobs as markers of a ring: on the circle, against their places at rest, never by sorting alone."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from palpate.spatial.arguments import takes_arrays

AREA_RATIO = 1.7  # a marker's area is between rest / AREA_RATIO and rest * AREA_RATIO
_INWARD, _OUTWARD = 12e-3, 4e-3  # m: limits of a displacement along the radius
_MISSING = 6.0  # cost of leaving a marker out; other costs are half the square of errors in standard deviations
_STEADY = 0.3e-3  # m: standard deviation of a displacement along the radius where nothing is displaced
_SHARE = 1.2  # of the displacement nearby, by which a marker's own may vary
_REACH = 0.26  # rad: width of the skin's response to a press, from its middle
_JUMP = 1.5e-3  # m: standard deviation from a marker's expected place
_DOUBT = 3.7  # standard deviations from the neighbours' prediction: a marker farther off is left out
_AREA = 0.15  # standard deviation of the logarithm of an area from the neighbours'
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
) -> Int[np.ndarray, " m"]:
    """Return the index (m,) of every marker's blob, -1 where it is missing.

    A blob is a candidate for the marker whose sector it lies in, if its place and area are possible. Of all ways around
    the ring that take or leave candidates, the smoothest is taken; then candidates that contradict their neighbours
    are left out.

    Args:
        blobs: (k, 2) places in the ring's plane [m].
        areas: (k,) of the blobs, in the unit of `rest_areas`.
        rest: (m, 2) places at rest [m], by rising angle.
        rest_areas: (m,) at rest.
        expected: (m, 2) expected places of the markers [m]; NaN or None: not known.
        price: (k,) additional cost of each blob; None: 0.

    Raises:
        InputError: arrays of other shapes.
    """
    from palpate.optical._markers import label_path  # here: compiled loops load when first needed

    labels = np.full(len(rest), -1)
    marker, blob, moved = _candidates(blobs, areas, rest, rest_areas)
    if not len(blob):
        return labels
    size = np.log(areas[blob] / rest_areas[marker])
    usual = np.median(size)
    extra = np.zeros(len(blob))
    if expected is not None:
        off = np.sum((blobs[blob] - expected[marker]) ** 2, axis=-1) / _JUMP**2
        extra = np.minimum(np.nan_to_num(off), _CAP)
    own = 0.5 * (((size - usual) / _SIZE) ** 2 + extra)
    if price is not None:
        own += price[blob]
    first = np.searchsorted(marker, np.arange(len(rest) + 1))
    settings = np.array([_MISSING, 2 * _STEADY, 0.35, _LONGEST])
    label_path(first, moved, own, settings, labels)
    _settle(labels, np.column_stack([moved, size]), first, extra, _Neighbours(rest))
    return np.where(labels >= 0, blob[labels], -1)


@takes_arrays
def owed(
    blobs: Float[np.ndarray, "k 2"],
    areas: Float[np.ndarray, " k"],
    rest: Float[np.ndarray, "m 2"],
    rest_areas: Float[np.ndarray, " m"],
) -> Float[np.ndarray, " k"]:
    """Return the cost (k,) of taking blobs from this ring for the ring before it, as `label_ring`'s `price`.

    A pressed marker of that ring may stand where one of this ring rests; as the skin does not fold, this ring's own is
    the innermost of its candidates.

    Args:
        blobs: (k, 2) places in this ring's plane [m].
        areas: (k,) of the blobs, in the unit of `rest_areas`.
        rest: (m, 2) this ring's places at rest [m], by rising angle.
        rest_areas: (m,) at rest.

    Raises:
        InputError: arrays of other shapes.
    """
    marker, blob, moved = _candidates(blobs, areas, rest, rest_areas)
    cost, inmost = np.zeros(len(blobs)), np.full(len(rest), np.inf)
    np.minimum.at(inmost, marker, moved[:, 0])
    cost[blob[moved[:, 0] == inmost[marker]]] = _MISSING
    return cost


def _candidates(
    blobs: np.ndarray, areas: np.ndarray, rest: np.ndarray, rest_areas: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return markers (sorted) and blobs that may match, and the displacements [m]."""
    angle = np.arctan2(rest[:, 1], rest[:, 0])
    half = np.pi / len(rest)
    turn = np.arctan2(blobs[:, 1], blobs[:, 0])[None] - angle[:, None]
    turn = np.arctan2(np.sin(turn), np.cos(turn))
    radius = np.linalg.norm(rest, axis=1)[:, None]
    outward = np.linalg.norm(blobs, axis=1)[None] - radius
    with np.errstate(invalid="ignore"):
        ratio = np.abs(np.log(areas[None] / rest_areas[:, None]))
        near = (np.abs(turn) == np.abs(turn).min(axis=0)) & (np.abs(turn) < half)
        near &= (outward > -_INWARD) & (outward < _OUTWARD) & (ratio < np.log(AREA_RATIO))
    marker, blob = np.nonzero(near)
    moved = np.stack([outward[marker, blob], (radius * turn)[marker, blob]], axis=-1)
    return marker, blob, moved


class _Neighbours:
    """Prediction of a marker from its neighbours by a Gaussian process on the ring [Rasmussen and Williams 2006, 5.12].

    Displacements are correlated over `_REACH`; their variance is the square of the displacement nearby.
    """

    def __init__(self, rest: np.ndarray) -> None:
        angle = np.arctan2(rest[:, 1], rest[:, 0])
        apart = np.abs(np.arctan2(np.sin(angle[:, None] - angle), np.cos(angle[:, None] - angle)))
        wide = np.exp(-0.5 * (apart / (2.5 * _REACH)) ** 2)
        self.prior = np.exp(-0.5 * (apart / _REACH) ** 2) + 0.15 * wide + _EVEN * np.eye(len(rest))
        self.nearby = np.exp(-0.5 * (apart / (1.5 * _REACH)) ** 2) - np.eye(len(rest))
        self.radius = np.linalg.norm(rest, axis=1)

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
        spread[:, :2] = _SHARE * np.sqrt(variance)[:, None] * size[:, None] * (1.0, 0.5)
        spread[:, :2] = np.hypot(spread[:, :2], (_STEADY, 0.6 * _STEADY))
        spread[:, 2] = _AREA + size / self.radius
        total = nearby.sum(axis=1)
        mean[:, 2] = nearby @ np.where(known, values[:, 2], 0.0) / np.maximum(total, 1e-12)
        return mean, spread, total > 0.1


def _settle(labels: np.ndarray, values: np.ndarray, first: np.ndarray, extra: np.ndarray, judge: _Neighbours) -> None:
    """Remove labels that contradict their neighbours, worst first; then add candidates that agree."""
    while (known := labels >= 0).any():
        here = np.where(known[:, None], values[labels], 0.0)
        mean, spread, judged = judge.said(known, here)
        doubt = np.sum(((here - mean) / spread) ** 2, axis=1) + np.where(known, extra[labels], 0.0)
        doubt = np.where(known & judged, doubt, 0.0)
        worst = int(np.argmax(doubt))
        if doubt[worst] <= _DOUBT**2:
            break
        labels[worst] = -1
    else:
        return
    for i in np.flatnonzero(~known & judged):
        mine = np.arange(int(first[i]), int(first[i + 1]))
        doubt = np.sum(((values[mine] - mean[i]) / spread[i]) ** 2, axis=1) + extra[mine]
        if len(mine) and doubt.min() <= 0.5 * _DOUBT**2:
            labels[i] = mine[np.argmin(doubt)]
