"""The paper's whole way, from a frame to contacts [marker ring, III.C]: colour filter, labels by sorting, a cubic."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, UInt8

from palpate.opencv import opencv
from palpate.sensors.marker_ring.locator import turned
from palpate_lab.papers.ring import PaperForce, paper_contacts

DEEP = 4.0  # px, of a press from which is learned what moves beside it
LEAST_AREA = 20  # px: a marker has 30 to 75, grains of noise in the skin up to 10


def spots(frame: UInt8[np.ndarray, "h w 3"]) -> Float[np.ndarray, "k 2"]:
    """Centres [px] of the white areas that a filter of hue, saturation and value leaves of the red markers."""
    cv2 = opencv()
    hsv = cv2.cvtColor(frame, cv2.COLOR_BGR2HSV)
    white = cv2.inRange(hsv, (0, 110, 80), (12, 255, 255)) | cv2.inRange(hsv, (168, 110, 80), (180, 255, 255))
    _, _, stats, centres = cv2.connectedComponentsWithStats(white)
    return np.asarray(centres[1:][stats[1:, cv2.CC_STAT_AREA] >= LEAST_AREA])


def sorted_markers(found: Float[np.ndarray, "k 2"], count: int, cut: float = 0.0) -> Float[np.ndarray, "m 2"]:
    """(1), (2): numbered anticlockwise about their mean, from the angle `cut` [rad] on; NaN where not `count` are seen.

    The paper is silent on missing markers and on the cut.
    """
    if len(found) != count:
        return np.full((count, 2), np.nan)
    x, y = (found - found.mean(axis=0)).T
    return found[np.argsort(np.mod(np.arctan2(-y, x) - cut, 2.0 * np.pi))]


class Theirs:
    """Calibrated on a log's frames as the paper does: markers at rest, and the cubic of the presses.

    What the paper leaves open is settled in its favour: the rest is a mean of unloaded frames, numbers begin midway
    between two markers, the angle's zero is the presses' median, and no contact is what moves outwards, as the skin
    does beside every dent, or so much less than the most that single presses show the same.

    Args:
        count: of the markers.
    """

    def __init__(self, count: int) -> None:
        self.count, self.cut = count, 0.0
        self._seen = list[np.ndarray]()

    def look(self, frames: Sequence[UInt8[np.ndarray, "h w 3"]] | UInt8[np.ndarray, "n h w 3"]) -> None:
        self._seen += [spots(frame) for frame in frames]

    def fit(
        self,
        rest: Bool[np.ndarray, " n"],
        pressed: Bool[np.ndarray, " n"],
        angle: Float[np.ndarray, " n"],
        force: Float[np.ndarray, " n"],
    ) -> None:
        """After all frames were looked at: which are unloaded, which are presses of the plate, and their truth."""
        first = self._numbered(self._seen[int(np.argmax(rest))])
        x, y = (first[0] - first.mean(axis=0)) * (1.0, -1.0)
        self.cut = float(np.arctan2(y, x)) - np.pi / self.count
        numbered = np.stack([self._numbered(found) for found in self._seen])
        self.rest: np.ndarray = np.nanmean(numbered[rest], axis=0)
        self.zero, self.share, self._force = 0.0, 0.0, None
        rows = np.flatnonzero(pressed).tolist()
        made = [(n, *found[0]) for n in rows if len(found := self._located(numbered[n]))]
        second = [
            found[1, 1] / found[0, 1]
            for n in rows
            if len(found := self._located(numbered[n])) > 1 and found[0, 1] > DEEP
        ]
        self.share = float(np.quantile(second, 0.98)) if second else 0.0
        which = np.array([each[0] for each in made])
        at, moved = np.array([each[1:] for each in made]).T
        self.zero = float(np.median(turned(angle[which] - at)))
        self._force = PaperForce(moved, at + self.zero, force[which])
        self._seen.clear()

    def __call__(self, frame: UInt8[np.ndarray, "h w 3"]) -> Float[np.ndarray, "k 2"]:
        """Angle [rad] and force [N] of each contact; none where not all markers are seen."""
        found = self._located(self._numbered(spots(frame)))
        angle = found[:, 0] + self.zero
        return np.stack([angle, self._force(found[:, 1], angle) if self._force else found[:, 1]], axis=1)

    def labelled(self, frame: UInt8[np.ndarray, "h w 3"]) -> Float[np.ndarray, "m 2"]:
        """Markers [px] by their numbers."""
        return self._numbered(spots(frame))

    def _numbered(self, found: Float[np.ndarray, "k 2"]) -> Float[np.ndarray, "m 2"]:
        return sorted_markers(found, self.count, self.cut)

    def _located(self, numbered: Float[np.ndarray, "m 2"]) -> Float[np.ndarray, "k 2"]:
        if not np.isfinite(numbered).all():
            return np.zeros((0, 2))
        before, after = (each - each.mean(axis=0) for each in (self.rest, numbered))
        nearer = np.linalg.norm(after, axis=1) < np.linalg.norm(before, axis=1)
        found = paper_contacts(self.rest, numbered)
        own = np.arctan2(-before[:, 1], before[:, 0])
        middle = np.abs(turned(found[:, :1] - own)).argmin(axis=1)
        found = found[nearer[middle]]
        return found[found[:, 1] >= self.share * found[:1, 1]]
