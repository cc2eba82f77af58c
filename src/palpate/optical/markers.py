"""Find markers in images: their colour, their blobs, and their tracks from image to image."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from palpate.errors import InputError
from palpate.opencv import opencv
from palpate.optical.fisheye import RingView
from palpate.optical.marker_labels import AREA_RATIO, label_ring, owed
from palpate.spatial._arrays import Value, frozen, require_out, shaped
from palpate.spatial.arguments import frozen_value, takes_arrays

Image = UInt8[np.ndarray, "h w 3"]

SCORES = ("red", "green", "blue", "bright", "dark")
_PIXEL = np.dtype(np.uint8)
_GREY = (2, 9, 5)  # sixteenths of blue, green, red
_LEAST_CONTRAST = 8.0  # of 255: markers that differ less from the skin are none
_LIT = 0.002  # share of a frame's bytes: where fewer are lit, it is black but for hot pixels
_LEAST_AREA = 6.0  # px: a marker is 5 px large or larger
_AWAY = 3  # frames: from then on a missing marker may be anywhere, and must be seen twice
_FROZEN_AFTER = 5  # images in a row that repeat the one before them to the last bit
_LOOK = 10  # frames: while a marker is missing, the whole frame is searched that often
_EVERY = 32  # rows: one in so many is sampled to detect a black image and a frozen camera
_LONGEST = 12.0  # px: a step that a marker is expected to go on with
_AGAIN = 6.0  # px, of a marker that is back, from one frame to the next
_DISC = 1 / (2 * np.pi)  # trace of the second moments of a disc over its area


class FrameProblem(IntEnum):
    """Problem of an image."""

    OK = 0
    LOST = 1  # fewer than 60 % of the markers are found
    BLACK = 2
    FROZEN = 3  # the fifth in a row, or a later one, that repeats the one before it to the last bit
    WRONG_SIZE = 4


@dataclass(frozen=True)
class MarkerColour:
    """Colour of the markers, which distinguishes them from the skin.

    Args:
        score: of a pixel, 0 to 255: "red", "green", "blue" (that channel less a share of the others), "bright"
            (grey) or "dark" (255 less grey).
        threshold: share of the way from the skin's score to the markers' above which a pixel may be of a marker.
        coverage: share of the image that markers cover; the markers' score follows from it.
        background: side of the square [px] whose mean is subtracted first, for uneven light; 0: none.
        others: sixteenths of each of the other channels that are subtracted from a colour: 8 removes all grey, less
            leaves less noise.

    Raises:
        InputError: an unknown score, a share that is not between 0 and 1, a negative background, or `others` that are
            not 0 to 8.
    """

    score: str = "red"
    threshold: float = 0.5
    coverage: float = 0.01
    background: int = 0
    others: int = 6

    def __post_init__(self) -> None:
        if self.score not in SCORES:
            raise InputError(
                f"the score of a pixel {self.score!r} is unknown.", hint=f"Use one of {', '.join(SCORES)}."
            )
        for name in ("threshold", "coverage"):
            if not 0 < getattr(self, name) < 1:
                raise InputError(f"{name} must be between 0 and 1, not {getattr(self, name)}.")
        if self.background < 0:
            raise InputError(f"background must be 0 px or more, not {self.background} px.")
        if not 0 <= self.others <= 8:
            raise InputError(
                f"others, the sixteenths of each other channel to subtract, must be from 0 to 8, not {self.others}."
            )

    @property
    def weights(self) -> Int[np.ndarray, " 4"]:
        """Weights (4,) of blue, green, red and 1, in sixteenths, whose sum is the score."""
        if self.score == "bright":
            return np.array([*_GREY, 0], dtype=np.int32)
        if self.score == "dark":
            return np.array([*(-each for each in _GREY), 255 * 16], dtype=np.int32)
        weights = np.array([-self.others, -self.others, -self.others, 0], dtype=np.int32)
        weights[("blue", "green", "red").index(self.score)] = 16
        return weights


@frozen_value
class Blobs(Value):
    """Blobs that look like markers.

    Attributes:
        pixels: (k, 2) centroids x, y, weighted by the score above half of the blob's.
        areas: (k,) number of pixels above half of the blob's score.
        spreads: (k, 2, 2) second moments [px^2].
        peaks: (k,) mean score, above the skin's, of the pixels above half of the largest.
        cut: (k,) True where a blob touches the image's edge.
    """

    pixels: Float[np.ndarray, "k 2"]
    areas: Float[np.ndarray, " k"]
    spreads: Float[np.ndarray, "k 2 2"]
    peaks: Float[np.ndarray, " k"]
    cut: Bool[np.ndarray, " k"]

    def __post_init__(self) -> None:
        for name, tail in {"pixels": (2,), "areas": (), "spreads": (2, 2), "peaks": ()}.items():
            object.__setattr__(self, name, frozen(getattr(self, name), tail=tail, name=name))
        object.__setattr__(self, "cut", self.cut.copy())
        self.cut.flags.writeable = False

    def __getitem__(self, which: np.ndarray) -> Blobs:
        return Blobs(self.pixels[which], self.areas[which], self.spreads[which], self.peaks[which], self.cut[which])

    def __len__(self) -> int:
        return len(self.areas)


@takes_arrays
def find_blobs(image: Image, colour: MarkerColour) -> Blobs:
    """Find all `Blobs` of the markers' colour in an image (h, w, 3) uint8; blobs of fewer than 6 px are omitted.

    The threshold is relative to the image's scores: the skin's is their median, the markers' the score that the
    brightest half of `coverage` reaches.

    Raises:
        InputError: OpenCV is not installed.
    """
    score, base, top = _scored(image, colour)
    if top - base < _LEAST_CONTRAST:
        return _no_blobs()
    return _blobs(score, base, base + colour.threshold * (top - base))


@takes_arrays
def find_colour(image: Image, count: int) -> MarkerColour:
    """Find the `MarkerColour` in an image (h, w, 3) uint8 of `count` markers without contact.

    Raises:
        InputError: no score distinguishes `count` blobs of one kind from the rest, or OpenCV is missing.
    """
    best, merit, seen = None, -np.inf, 0
    for score in SCORES:
        for coverage in 1e-3 * 2.0 ** np.arange(7):
            colour = MarkerColour(score, 0.5, float(coverage))
            blobs = find_blobs(image, colour)
            alike = _alike(blobs)
            kept, n = blobs[alike], int(alike.sum())
            if n < 5:
                continue
            uneven = float(np.std(np.log(kept.areas))) + (len(blobs) - n) / n
            contrast = float(np.median(kept.peaks)) / 255
            this = contrast - uneven - 10 * abs(n - count) / count
            if this > merit:
                best, merit, seen = (score, float(kept.areas.sum()) / image[..., 0].size), this, n
    if best is None or seen != count:
        hint = "State the colour, or use a sharper, evenly lit frame in which nothing touches the skin."
        raise InputError(
            f"no colour distinguishes {count} markers from the skin; the best one finds {seen}.", hint=hint
        )
    return _quietest(image, MarkerColour(best[0], 0.5, min(best[1], 0.5)), seen)


def _quietest(image: Image, colour: MarkerColour, count: int) -> MarkerColour:
    """Return the colour with all markers and the most contrast for its noise.

    Noise is the usual difference of pixels 8 apart: a cheap camera's blotches are smaller.
    """
    best, merit = colour, -np.inf
    for others in (3, 4, 6, 8) if colour.score in ("red", "green", "blue") else ():
        this = replace(colour, others=others)
        blobs = find_blobs(image, this)
        if int(_alike(blobs).sum()) != count:
            continue
        score = image @ (this.weights[:3] / 16.0)
        noise = float(np.median(np.abs(score[:, 8:] - score[:, :-8]))) + 0.5  # 0.5: rounding
        if float(np.median(blobs.peaks)) / noise > merit:
            best, merit = this, float(np.median(blobs.peaks)) / noise
    return best


def _read(image: np.ndarray) -> np.ndarray:
    """Return the pixels, contiguous and read-only, so that loops are compiled once."""
    if type(image) is not np.ndarray or image.dtype != _PIXEL:
        image = shaped(image, (...,), "image", _PIXEL)
    view = np.ascontiguousarray(image).view()
    view.flags.writeable = False
    return view


def _alike(blobs: Blobs) -> Bool[np.ndarray, " k"]:
    """Return which blobs are of usual area, and not cut by the image's edge."""
    usual = np.median(blobs.areas) if len(blobs) else 0.0
    return (blobs.areas < 2.5 * usual) & (blobs.areas > usual / 2.5) & ~blobs.cut


def _scored(image: Image, colour: MarkerColour) -> tuple[UInt8[np.ndarray, "h w"], float, float]:
    """Return the score of every pixel (h, w), of the skin and of the markers."""
    from palpate.optical._markers import score_image  # here: compiled loops load when first needed

    score, histogram = np.empty(image.shape[:2], np.uint8), np.empty(256, np.int64)
    score_image(_read(image), colour.weights, score, histogram)
    if colour.background:
        cv2 = opencv()
        score = cv2.subtract(score, cv2.blur(score, (colour.background, colour.background)))
        histogram = np.bincount(score.ravel(), minlength=256)
    below = np.cumsum(histogram) / histogram.sum()
    top = float(np.searchsorted(below, 1.0 - 0.5 * colour.coverage))
    return score, float(np.searchsorted(below, 0.5)), top


def _blobs(score: UInt8[np.ndarray, "h w"], base: float, threshold: float) -> Blobs:
    from palpate.optical._markers import blob_sums

    cv2 = opencv()
    mask = cv2.threshold(score, threshold, 255, cv2.THRESH_BINARY)[1]
    count, labels, boxes, _ = cv2.connectedComponentsWithStats(mask, connectivity=4, ltype=cv2.CV_32S)
    levels, sums = np.zeros(count), np.zeros((count, 7))
    blob_sums(score, labels, boxes, base, levels, sums)
    kept = np.flatnonzero(sums[:, 0] >= _LEAST_AREA)
    if not len(kept):
        return _no_blobs()
    n, w, sx, sy, sxx, sxy, syy = sums[kept].T
    x, y = sx / w, sy / w
    left, up, width, height, _ = boxes[kept].T
    spread = np.stack([sxx / w - x * x, sxy / w - x * y, sxy / w - x * y, syy / w - y * y], axis=-1).reshape(-1, 2, 2)
    cut = (left == 0) | (up == 0) | (left + width == score.shape[1]) | (up + height == score.shape[0])
    return Blobs(np.stack([x + left, y + up], axis=-1), n, spread, levels[kept] - base, cut)


def _no_blobs() -> Blobs:
    return Blobs(np.zeros((0, 2)), np.zeros(0), np.zeros((0, 2, 2)), np.zeros(0), np.zeros(0, dtype=bool))


def _pairs(ring: Int[np.ndarray, " m"], gaps: Float[np.ndarray, "m m"]) -> Int[np.ndarray, "p 2"]:
    """Return pairs of markers whose windows might share a blob."""
    m, each = len(ring), np.count_nonzero(ring == 0)
    first = np.arange(m)
    pairs = np.stack([first, ring * each + (first + 1) % each], axis=1)
    if m > each:
        nearest = np.where(ring[:, None] == ring, np.inf, gaps).argmin(axis=1)
        pairs = np.concatenate([pairs, np.stack([first, nearest], axis=1)])
    return pairs


class MarkerTracker:
    """Tracker of a ring's markers, image by image, in windows about their expected places.

    The entire image is searched where a marker is lost, of another area or shape, cut by its window's rim, or the same
    for two windows.

    Args:
        view: where the camera sees the ring.
        colour: of the markers.
        pixels: (m, 2) at rest, marker by marker.
        areas: (m,) [px] at rest.

    Attributes:
        frame: problem of the last image.
        searched: whether the last image was searched entirely.

    Raises:
        InputError: the number of pixels or areas is not that of the view's markers.
    """

    @takes_arrays
    def __init__(
        self,
        view: RingView,
        colour: MarkerColour,
        pixels: Float[np.ndarray, "m 2"],
        areas: Float[np.ndarray, " m"],
    ) -> None:
        m = len(view.angles)
        self.view, self.colour = view, colour
        self._rest, self._areas = frozen(pixels, tail=(2,)), frozen(areas)
        if len(self._areas) != m:
            raise InputError(f"pixels and areas must each have one row for each of the {m} markers.")
        self._weights, self._plane = colour.weights, view.to_plane(self._rest, view.heights)
        gaps = np.linalg.norm(self._rest[:, None] - self._rest[None], axis=-1) + np.diag(np.full(m, np.inf))
        gap, spreads = gaps.min(axis=1), self._areas * _DISC
        radius = 1.6 * np.sqrt(spreads) + 1.5
        reach = np.clip(0.45 * (gap - radius), 4.0, 10.0)
        self._halves = np.ceil(radius + reach).astype(np.int64)
        alone = gap > self._halves + radius  # no neighbour reaches into its window:
        alone &= len(view.rings) == 1  # of another ring one may, where the skin is pressed
        sizes = np.stack([self._areas, spreads], axis=-1)
        self._known = self._halves, sizes, alone, gap, _pairs(view.ring, gaps)
        self._out = np.zeros((m, 7))
        camera = view.camera
        self._sample = np.zeros((len(range(_EVERY // 2, camera.height, _EVERY)), 3 * camera.width), dtype=np.uint8)
        self.reset()

    def reset(self) -> None:
        """Forget every image: the next one is searched entirely."""
        m = len(self._areas)
        self.frame, self.searched = FrameProblem.OK, False
        self._last, self._step, self._expected = self._rest.copy(), np.zeros((m, 2)), np.zeros((m, 2))
        self._seen, self._count, self._size = np.zeros(m, dtype=bool), 0, self._areas.copy()
        self._age = np.full(m, _AWAY)  # frames since a marker was seen
        self._claimed = np.full((m, 2), np.nan)
        self._fresh, self._sampled, self._same, self._since = True, False, 0, 0

    def track(self, image: np.ndarray, out: Float[np.ndarray, "m 2"]) -> Bool[np.ndarray, " m"]:
        """Write the pixels x, y of every marker of an image into `out` (m, 2), NaN where not found.

        Return a mask (m,) of the markers found, and set `frame` and `searched`.

        Raises:
            InputError: `out` is not a writable float64 array (m, 2), `image` cannot be uint8, or OpenCV is missing.
        """
        require_out(out, (len(self._areas), 2))
        image, self.searched = _read(image), False
        self.frame = self._health(image)
        if self.frame in (FrameProblem.WRONG_SIZE, FrameProblem.BLACK):
            out[:] = np.nan
            return np.zeros(len(self._areas), dtype=bool)
        if self._follow(image, out):
            self._since += 1
        else:
            self.searched = True
            found = self._search(image)
            self._seen, self._count, self._since = found, int(np.count_nonzero(found)), 0
            self._age, self._fresh = np.where(found, 0, self._age + 1), not self._count
            out[:] = np.where(found[:, None], self._last, np.nan)
        if self.frame == FrameProblem.OK and self._count < 0.6 * len(self._seen):
            self.frame = FrameProblem.LOST
        return self._seen.copy()

    def _health(self, image: np.ndarray) -> FrameProblem:
        """Return the problem of an image, from every `_EVERY`th row."""
        camera = self.view.camera
        if image.dtype != np.uint8 or image.shape != (camera.height, camera.width, 3):
            return FrameProblem.WRONG_SIZE
        from palpate.optical._markers import sampled  # here: compiled loops load when first needed

        lit, same = sampled(image, _EVERY, int(2 * _LEAST_CONTRAST), self._sample)
        self._same = self._same + 1 if same and self._sampled else 0
        self._sampled = True
        if lit < _LIT * self._sample.size:
            return FrameProblem.BLACK
        return FrameProblem.FROZEN if self._same >= _FROZEN_AFTER else FrameProblem.OK

    def _guess(self) -> None:
        """Expect missing markers where their neighbours' displacement puts them."""
        for ring in range(len(self.view.rings)):
            own = self.view.ring == ring
            there, gone = np.flatnonzero(own & self._seen), np.flatnonzero(own & ~self._seen)
            moved = self._last[there] - self._rest[there]
            for axis in range(2):
                said = np.interp(gone, there, moved[:, axis], period=np.count_nonzero(own)) if len(there) else 0.0
                self._expected[gone, axis] = self._rest[gone, axis] + said

    def _follow(self, image: Image, out: Float[np.ndarray, "m 2"]) -> bool:
        """Measure the markers in their windows, and return True if no window is ambiguous."""
        from palpate.optical._markers import follow

        whole = self._count == len(self._seen)
        if self._fresh or (not whole and self._since >= _LOOK):
            return False
        if not whole:
            self._guess()
        limits = AREA_RATIO, _LEAST_CONTRAST, _LONGEST
        kept = self._seen, self._expected, self._last, self._step, self._size, self._age
        return follow(image, self._weights, self._known, limits, self._out, *kept, out)

    def _search(self, image: Image) -> Bool[np.ndarray, " m"]:
        """Find the markers in the entire image, and return which are found."""
        from palpate.optical._markers import measure_windows, plausible  # here: compiled loops load when first needed

        blobs = find_blobs(image, self.colour)
        blobs = blobs[~blobs.cut & np.isfinite(self.view.to_plane(blobs.pixels)).all(axis=-1)]
        known, ahead = (self._age < _AWAY)[:, None], self._last + np.clip(self._step, -_LONGEST, _LONGEST)
        expected = np.where(known, self.view.to_plane(ahead, self.view.heights), np.nan)
        labels = self._labels(blobs, expected)
        found = labels >= 0
        if not found.any():
            return found
        wanted = np.where(found[:, None], blobs.pixels[labels], np.nan)
        got, fits = self._out, np.empty(len(found), dtype=bool)
        measure_windows(image, self._weights, wanted, self._halves, got)
        away = np.hypot(*(got[:, :2] - wanted).T)
        found &= (got[:, 6] == 0.0) & (away < 1.0)
        plausible(got, self._known[1], found, AREA_RATIO, _LEAST_CONTRAST, fits)
        found &= fits
        found &= self._confirmed(got, found)
        again = found & self._seen
        self._step = np.where(again[:, None], got[:, :2] - self._last, 0.0)
        self._last = np.where(found[:, None], got[:, :2], self._last)
        self._size = np.where(found, got[:, 2], self._size)
        return found

    def _labels(self, blobs: Blobs, expected: Float[np.ndarray, "m 2"]) -> Int[np.ndarray, " m"]:
        """Return the blob of every marker, -1: missing, from the ring nearest to the camera on."""
        labels, free = np.full(len(self._areas), -1), np.arange(len(blobs))
        order: list[int] = np.argsort(-self.view.rings).tolist()
        for ring, behind in zip(order, [*order[1:], None], strict=True):
            own, left = self.view.ring == ring, blobs[free]
            price = None if behind is None else owed(*self._before(left, behind))
            found = label_ring(*self._before(left, ring), expected=expected[own], price=price)
            if len(free):
                labels[own] = np.where(found >= 0, free[found], -1)
            free = np.setdiff1d(free, labels)
        return labels

    def _before(self, blobs: Blobs, ring: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return places and areas of blobs, seen in a ring's plane, and of its markers at rest."""
        own = self.view.ring == ring
        places = self.view.to_plane(blobs.pixels, self.view.rings[ring : ring + 1])
        return places, blobs.areas, self._plane[own], self._areas[own]

    def _confirmed(self, got: Float[np.ndarray, "m 7"], found: Bool[np.ndarray, " m"]) -> Bool[np.ndarray, " m"]:
        """Return which markers are accepted: a missing one only twice in the same place, as a stray blob rarely is.

        In a first image this holds for a marker away from rest without neighbours, too.
        """
        back = found & (self._age >= _AWAY)
        if self._fresh:
            back &= self._alone_away(got, found)
        near = np.hypot(*(got[:, :2] - self._claimed).T) < _AGAIN
        self._claimed = np.where(back[:, None], got[:, :2], np.nan)
        return ~back | near

    def _alone_away(self, got: Float[np.ndarray, "m 7"], found: Bool[np.ndarray, " m"]) -> Bool[np.ndarray, " m"]:
        alone = np.zeros(len(found), dtype=bool)
        for ring in range(len(self.view.rings)):
            own = np.flatnonzero(self.view.ring == ring)
            alone[own] = ~(np.roll(found[own], 1) | np.roll(found[own], -1))
        return alone & (np.hypot(*(got[:, :2] - self._rest).T) > _AGAIN)
