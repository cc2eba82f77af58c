"""Which blob is which marker of a ring: on the circle, against where the markers rest, never by sorting alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

__all__ = ["LabelLimits", "label_ring"]


@dataclass(frozen=True)
class LabelLimits:
    """How far a marker may be from where it rests, and what may pass for one.

    Args:
        inward, outward: displacement along the radius [m].
        size: a marker's area is between rest / size and rest * size.
        missing: what it costs to leave a marker out; displacements and sizes cost half their squared deviations.
        steady: deviation of a displacement from its neighbours' where nothing is displaced [m].
        share: the same as a share of the neighbours' displacement.
        jump: deviation from where a marker is expected, where that is known [m].
        doubt: a marker that deviates by more than this from what its neighbours say is left out.
    """

    inward: float = 12e-3
    outward: float = 4e-3
    size: float = 1.7
    missing: float = 6.0
    steady: float = 0.5e-3
    share: float = 0.35
    jump: float = 1.5e-3
    doubt: float = 3.3


_SIZE = 0.2  # deviation of the logarithm of an area
_LONGEST = 4  # markers: over longer gaps neighbours tell nothing
_CAP = 8.0  # of the cost of a jump: what moved faster than expected may still be found by its neighbours


def label_ring(
    blobs: Float[np.ndarray, "k 2"],
    areas: Float[np.ndarray, " k"],
    rest: Float[np.ndarray, "m 2"],
    rest_areas: Float[np.ndarray, " m"],
    *,
    expected: Float[np.ndarray, "m 2"] | None = None,
    limits: LabelLimits = LabelLimits(),
) -> Int[np.ndarray, " m"]:
    """The blob of every marker, -1 where it is missing.

    Each blob is a candidate for the marker whose sector it lies in, if it stands and measures as that marker may. Of
    all ways around the ring that take or leave candidates, the one whose displacements are smoothest is taken; then
    whatever contradicts its neighbours still is left out, worst first.

    Args:
        blobs: places in the ring's plane [m].
        areas: of the blobs, in the unit of `rest_areas`.
        rest: places at rest [m], by rising angle.
        rest_areas: at rest.
        expected: places where the markers are thought to be [m]; NaN where nothing is known.
        limits: see there.
    """
    from palpate.sensors._markers import label_path  # here: compiled loops load when first needed

    marker, blob, moved = _candidates(blobs, areas, rest, rest_areas, limits)
    own = 0.5 * (np.log(areas[blob] / rest_areas[marker]) / _SIZE) ** 2
    if expected is not None and len(blob):
        off = np.sum((blobs[blob] - expected[marker]) ** 2, axis=-1) / limits.jump**2
        own += np.minimum(0.5 * np.nan_to_num(off), _CAP)
    labels = np.full(len(rest), -1)
    if not len(blob):
        return labels
    first = np.searchsorted(marker, np.arange(len(rest) + 1))
    settings = np.array([limits.missing, limits.steady, limits.share, _LONGEST])
    label_path(first, moved, own, settings, labels)
    _leave_out(labels, moved, own, limits)
    return np.where(labels >= 0, blob[labels], -1)


def _candidates(
    blobs: np.ndarray, areas: np.ndarray, rest: np.ndarray, rest_areas: np.ndarray, limits: LabelLimits
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Markers (sorted) and blobs that may belong together, and the displacement outward and anticlockwise [m]."""
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


def _leave_out(labels: np.ndarray, moved: np.ndarray, own: np.ndarray, limits: LabelLimits) -> None:
    """Takes out, worst first, what deviates from a cubic through its neighbours (where they are there)."""
    weights = {-2: -1.0, -1: 4.0, 1: 4.0, 2: -1.0}
    while True:
        m = len(labels)
        known = labels >= 0
        place = np.where(known[:, None], moved[labels], 0.0)
        total, count, size = np.zeros((m, 2)), np.zeros(m), np.zeros(m)
        sides = np.zeros((m, 2), dtype=bool)
        for step, weight in weights.items():
            there = np.roll(known, -step)
            total += weight * np.where(there[:, None], np.roll(place, -step, axis=0), 0.0)
            count += weight * there
            size = np.maximum(size, np.where(there, np.linalg.norm(np.roll(place, -step, axis=0), axis=1), 0.0))
            sides[:, int(step > 0)] |= there & (abs(step) == 1)
        judged = known & (count > 0)
        said = total / np.where(count > 0, count, 1.0)[:, None]
        deviation = np.linalg.norm(place - said, axis=1) / (limits.steady + limits.share * size)
        deviation = np.where(sides.all(axis=1), deviation, 0.6 * deviation)  # one side tells less
        doubt = np.where(judged, np.sqrt(deviation**2 + np.where(known, own[labels], 0.0)), 0.0)
        worst = int(np.argmax(doubt))
        if not doubt[worst] > limits.doubt:
            return
        labels[worst] = -1
