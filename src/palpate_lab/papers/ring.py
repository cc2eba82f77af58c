"""The marker ring paper's own method [marker ring, III.C], as a baseline: windows of markers, two lines, a cubic."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from palpate.spatial._arrays import require_finite
from palpate.spatial.arguments import takes_arrays

_LEAST = 1.0  # px: a middle marker that moved less is no contact


@takes_arrays
def paper_contacts(
    rest: Float[np.ndarray, "m 2"], now: Float[np.ndarray, "m 2"], least: float = _LEAST
) -> Float[np.ndarray, "k 2"]:
    """Return angle [rad, as in the image, y up] and largest displacement [px] of each contact, (k, 2), largest first.

    This is equation (1) of the `marker ring` paper, with angles about the mean of the markers of each image. A marker
    is the middle of a contact where it moved more than its two neighbours. Draw a line through its positions at rest
    and now, and another through those of the neighbour that moved more: the angle of their intersection G is the
    contact's angle. The angle of the middle marker at rest replaces it where the lines are parallel, or where the two
    differ by more than the spacing of the markers (as where G lies beyond the centre): cases that the paper does not
    treat.

    Args:
        rest: (m, 2) [px] positions of the markers at rest, in their order round the ring.
        now: (m, 2) [px] positions in an image.
        least: displacement [px] up to which a marker counts as still.

    Raises:
        InputError: arrays of other shapes.
    """
    flip = np.array([1.0, -1.0])
    before, after = (rest - rest.mean(axis=0)) * flip, (now - now.mean(axis=0)) * flip
    moved = np.linalg.norm(after - before, axis=1)
    left, right = np.roll(moved, 1), np.roll(moved, -1)
    middles = np.flatnonzero((moved > least) & (moved >= left) & (moved > right))
    found = [(_angle(before, after, moved, int(k)), moved[k]) for k in middles[np.argsort(-moved[middles])]]
    return np.array(found, dtype=np.float64).reshape(-1, 2)


def _angle(before: np.ndarray, after: np.ndarray, moved: np.ndarray, middle: int) -> float:
    """Return the angle of the point G where the lines of the middle and of its neighbour that moved more meet."""
    count = len(before)
    one = max((middle - 1) % count, (middle + 1) % count, key=lambda k: float(moved[k]))
    lines = np.stack([after[middle] - before[middle], before[one] - after[one]], axis=1)
    own = float(np.arctan2(before[middle, 1], before[middle, 0]))
    if abs(np.linalg.det(lines)) < 1e-9 * np.prod(np.linalg.norm(lines, axis=0) + 1e-12):
        return own
    along = np.asarray(np.linalg.solve(lines, before[one] - before[middle]), dtype=np.float64)
    g: np.ndarray = before[middle] + along[0] * lines[:, 0]
    angle = float(np.arctan2(g[1], g[0]))
    off = abs((angle - own + np.pi) % (2.0 * np.pi) - np.pi)
    return angle if off < 2.0 * np.pi / count else own


@takes_arrays
class PaperForce:
    """The force as a cubic F = f(displacement, angle) [marker ring, Fig. 3], fitted to presses as the paper does.

    Args:
        moved: (n,) displacements [px].
        angle: (n,) angles [rad].
        force: (n,) forces [N].

    Raises:
        InputError: a number is not finite.
    """

    def __init__(
        self, moved: Float[np.ndarray, " n"], angle: Float[np.ndarray, " n"], force: Float[np.ndarray, " n"]
    ) -> None:
        design = self._design(moved, angle)
        require_finite(design, "moved and angle")
        require_finite(force, "force")
        self._coefficients: np.ndarray = np.linalg.lstsq(design, force, rcond=None)[0]

    def __call__(self, moved: Float[np.ndarray, " n"], angle: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Return the force (n,) [N] at displacements [px] and angles [rad]."""
        return self._design(moved, angle) @ self._coefficients

    @staticmethod
    def _design(moved: Float[np.ndarray, " n"], angle: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 10"]:
        """Return all products up to third order, (n, 10); the angle is in turns, so that both factors are about 1."""
        turns = np.mod(angle, 2.0 * np.pi) / (2.0 * np.pi)
        size = np.asarray(moved) / 10.0
        return np.stack([size**a * turns**b for a in range(4) for b in range(4 - a)], axis=1)
