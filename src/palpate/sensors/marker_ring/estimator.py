"""Estimate contacts from images of a soft ring's markers, each with angle, force, depth, width and shear."""

from __future__ import annotations

from dataclasses import replace
from math import nan

import numpy as np
from jaxtyping import Float, Int
from numpy.typing import ArrayLike

from palpate.calls import called_as
from palpate.contact.estimate import ROW, Status
from palpate.contact.estimator import Answered, Channels, ContactEstimator, Counts, Known, Rows, Times, instant, rows_of
from palpate.contact.plausibility import MANY, endless
from palpate.errors import InputError
from palpate.optical.markers import FrameProblem, MarkerTracker
from palpate.optical.ring_response import ring_basis
from palpate.sensors.marker_ring.locator import RingFound, RingLocator, RingSettings
from palpate.sensors.marker_ring.model import MarkerRing
from palpate.signals.recording import IMAGE, Recording
from palpate.signals.wrench_sensor import Tare
from palpate.spatial._arrays import shaped
from palpate.spatial.pose import Pose

UINT8 = np.dtype(np.uint8)
FEATURES = ("angle", "depth", "width", "shear", "angle_sd", "force_sd", "depth_sd", "shear_sd", "markers")
_SEEN = ROW.length + len(FEATURES) - 1  # the column of the number of markers seen
_UNBELIEVABLE = 4.0  # root of chi-square over its degrees of freedom above which contacts are implausible
_HEIGHT = 2e-3  # m: standard deviation along the barrel's axis, where contacts are placed at the ring's height
_CAUSE = "the camera or the barrel has moved since the calibration, or the model is that of another unit"
_STEADY = 3.0  # times the calibration's jitter: a tare in which markers move more is refused


@called_as('palpate.load_rig("rig.toml").estimator()')
class RingEstimator(ContactEstimator):
    """An estimator of the contacts in each image of a marker ring.

    A reading is an image (height, width, 3), uint8. The contact point is the centre of pressure on the outer surface,
    at the height of the markers; the torque is NaN. IMPLAUSIBLE: a few contacts cannot move the markers like this.
    INVALID: a black, frozen or unfitting image, or fewer than 60 % of the markers.

    Features: `angle` [rad] about the ring's axis; `depth` [m] of the indenter's foremost point; `width` [m], half of
    the dent's width at half of its depth; `shear` [N] along rising angles, NaN where it was not calibrated; `angle_sd`
    [rad], `force_sd` [N], `depth_sd` [m], `shear_sd` [N] standard deviations; `markers`, the number of markers seen.

    Args:
        ring: calibrated ring.
        settings: of the search for contacts; None: the defaults.
        mount: T_sensor_surface; None: identity.
    """

    def __init__(self, ring: MarkerRing, settings: RingSettings | None = None, *, mount: Pose | None = None) -> None:
        from palpate.contact import _track  # compiled: loaded when first needed
        from palpate.sensors.marker_ring import _kernels as _ring

        super().__init__((IMAGE,), FEATURES, _ring.MOST, mount, dtype=UINT8)
        self.ring, self.settings = ring, settings or RingSettings()
        self._tared: Tare | None = None
        self._scratch, self._nothing = self.empty(_ring.MOST), self.empty()
        self._nothing[:_SEEN] = np.nan
        self._nothing[ROW.candidates] = 0.0
        self._tracks = np.full((_track.TRACKS, _track.TRACK), -1.0), np.ones(1, dtype=np.int64)
        self._know(ring)

    def _know(self, ring: MarkerRing) -> None:
        self.ring = ring
        skin = ring.radius, ring.view.radius
        self.locator = RingLocator(ring.response, ring.view.angles, ring.noise(), self.settings, skin)
        self.tracker = MarkerTracker(ring.view, ring.colour, ring.rest, ring.area)
        self._widths = _dent_widths(ring)
        self.reset()

    def reset(self) -> None:
        """Forget earlier images: places of markers, contacts and identities."""
        super().reset()
        self.locator.reset()
        self.tracker.reset()
        self._tracks[0][:], self._tracks[1][:] = -1.0, 1
        self._bad = dict.fromkeys(FrameProblem, 0)
        self._watch = _Watch()

    def tare(self, recording: Recording) -> Tare:
        """Use the markers' mean places in a recording as their rest from now on; return a `Tare`.

        Raises:
            InputError: the recording has no images, markers are not seen or not steady, or OpenCV is missing.
        """
        pixels, _ = self.markers(recording)
        self.reset()
        seen = np.count_nonzero(np.isfinite(pixels[..., 0]), axis=0)
        gone = np.flatnonzero(seen < max(1, 0.5 * len(recording))).tolist()
        if not len(recording) or gone:
            lost = ", ".join(map(str, gone[:5]))
            raise InputError(
                f"markers {lost or 'of no frame'} are not seen during the tare.",
                where=recording.source,
                hint="Keep the complete ring in view, untouched, at the start of the log.",
            )
        spread: np.ndarray = np.nanvar(pixels, axis=0)
        rest, jitter = np.nanmean(pixels, axis=0), float(np.sqrt(np.mean(spread)))
        if jitter > _STEADY * self.ring.jitter:
            raise InputError(
                f"the markers are not steady during the tare: they move by {jitter:.2g} px, "
                f"and by {self.ring.jitter:.2g} px in the calibration.",
                where=recording.source,
                hint="Tare while nothing touches the ring.",
            )
        moved = np.linalg.norm(rest - self.ring.rest, axis=1)
        off = np.abs(moved - np.median(moved)).max() > 5.0 * self.ring.jitter
        usual = f"markers rest {np.median(moved):.2g} px from where they were calibrated"
        doubt = (
            f"markers rest up to {moved.max():.1f} px from where they were calibrated, as under a touch: make sure "
            "that nothing touched them"
        )
        self._know(replace(self.ring, rest=rest))
        self._tared = Tare(f"tare over {len(recording)} frames: {usual}", doubt if off else "")
        return self._tared

    def markers(self, recording: Recording) -> tuple[Float[np.ndarray, "n m 2"], Int[np.ndarray, " n"]]:
        """Return the markers' places (n, m, 2) [px] in each image, NaN if not seen, and its `FrameProblem` (n,).

        Raises:
            InputError: the recording has no images, or OpenCV is missing.
        """
        if IMAGE not in recording.channels:
            raise InputError("has no images.", where=recording.source)
        frames = recording.channels[IMAGE]
        pixels, states = np.full((len(frames), len(self.ring), 2), np.nan), np.zeros(len(frames), dtype=np.int64)
        for n, frame in enumerate(frames):
            states[n] = self._track(frame, pixels[n])
        return pixels, states

    def _track(self, image: np.ndarray, pixels: Float[np.ndarray, "m 2"]) -> int:
        """Write the places of one image's markers into `pixels`; return the image's `FrameProblem`."""
        self.tracker.track(image, pixels)
        return int(self.tracker.frame)

    def answer(self, block: Recording, watched: bool = False) -> Answered:
        """Return the contacts of a block's images as `Answered`, with the markers' places (n, m, 2) [px].

        Raises:
            InputError: the block has no images, or OpenCV is missing.
        """
        pixels, states = self.markers(block)
        found, seen = self._found(pixels, states.tolist())
        counts = np.maximum(found.counts, 1)
        rows, first = self.empty(int(counts.sum())), 0
        for n, when in enumerate(block.time.tolist()):
            first += self._frame(when, found, n, seen[n], rows[first:])
        return Answered(block, rows, counts, pixels)

    def update_markers_into(
        self,
        time: ArrayLike,
        pixels: ArrayLike,
        out: Float[np.ndarray, "*rows width"],
        frame: FrameProblem = FrameProblem.OK,
    ) -> int:
        """Write contacts into rows from known places of the markers, as `update_into` does; return their number.

        Args:
            time: [s] of the image.
            pixels: (m, 2) of every marker, NaN where it is not seen.
            out: rows of `empty`.
            frame: problem of the image.

        Raises:
            InputError: an argument has another shape, or `frame` is not a `FrameProblem`.
        """
        pixels = shaped(pixels, (len(self.ring), 2), "pixels")
        if not any(frame is each for each in FrameProblem):
            known = ", ".join(FrameProblem.__members__)
            raise InputError(f"frame must be a FrameProblem ({known}), not {frame!r:.60}.")
        return self._write(instant(time), pixels, int(frame), rows_of(out, self._width))

    def _write(self, time: float, pixels: np.ndarray, state: int, rows: np.ndarray) -> int:
        """Write one image's contacts into rows; return the number written."""
        found, seen = self._found(pixels[None], [state])
        count = self._frame(float(time), found, 0, seen[0], self._scratch)
        fits = min(count, len(rows))
        rows[:fits] = self._scratch[:fits]
        return fits

    def _single(self, time: float, reading: ArrayLike, out: Rows, rotation: Known, acceleration: Known) -> int:
        image = reading if type(reading) is np.ndarray else shaped(reading, (..., 3), "reading", UINT8)
        pixels = np.empty((len(self.ring), 2))
        return self._write(time, pixels, self._track(image, pixels), out)

    def _arrays(self, time: Times, readings: np.ndarray, beside: Channels, out: Rows, counts: Counts) -> int:
        used = 0
        for n, (when, image) in enumerate(zip(time.tolist(), readings, strict=True)):
            if used + self.most > len(out):
                return n
            counts[n] = self._single(when, image, out[used:], None, None)
            used += int(counts[n])
        return len(time)

    def notes(self) -> tuple[str, ...]:
        """Return notes on the ring, the tare and the images that could not be used, one sentence each."""
        said = [*self.ring.notes, *([self._tared.note] if self._tared else [])]
        what = {
            FrameProblem.LOST: "show fewer than 60 % of the markers",
            FrameProblem.BLACK: "are black",
            FrameProblem.FROZEN: "repeat the one before",
            FrameProblem.WRONG_SIZE: "are not of the size of the calibration's",
        }
        said += [f"{count} frames {what[why]}" for why, count in self._bad.items() if count and why in what]
        return tuple(said)

    def warnings(self) -> tuple[str, ...]:
        """Return warnings on the tare, a contact without end, and images that contacts do not explain."""
        tared = [self._tared.warning] if self._tared and self._tared.warning else []
        return (*tared, *self._watch.warnings())

    def _found(self, pixels: np.ndarray, states: list[int]) -> tuple[RingFound, list[float]]:
        lost = [n for n, state in enumerate(states) if state != FrameProblem.OK]
        if lost:
            for n in lost:
                self._bad[FrameProblem(states[n])] += 1
            pixels = pixels.copy()
            pixels[lost] = np.nan
        found, seen = self.locator.run_pixels(pixels, self.ring)
        return found, seen.astype(np.float64).tolist()

    def _frame(self, time: float, found: RingFound, n: int, seen: float, rows: np.ndarray) -> int:
        """Write the rows of one image, at least one; return the number written."""
        count = int(found.counts[n])
        self._watch.add(time, count, float(found.residual[n]))
        if count < 1:
            rows[0] = self._nothing
            rows[0, ROW.status] = Status.INVALID if count < 0 else Status.NO_CONTACT
            rows[0, _SEEN] = seen
            return 1
        states, off = found.states[n, :count], float(found.residual[n])
        angle, z = states[:, 0], states[:, 2]
        columns = (np.cos(angle), np.sin(angle), self.locator.depth(states), np.interp(z, *self._widths))
        more = zip(*(each.tolist() for each in columns), strict=True)
        rows[:count] = [self._row(state, each, off, seen) for state, each in zip(states.tolist(), more, strict=True)]
        self._identify(time, rows[:count])
        return count

    def _row(self, state: list[float], more: tuple[float, ...], off: float, seen: float) -> list[float]:
        """Return a contact's row without its identity, as plain numbers, which are faster than small arrays.

        Args:
            state: (9,) of `RingFound.states`.
            more: cosine and sine of the angle, depth [m], width [m].
            off: residual of the image.
            seen: number of markers seen.
        """
        c, s, depth, width = more
        angle, force, _, t, angle_sd, force_sd, depth_sd, _, shear_sd = state
        radius, shears = self.ring.radius, self.ring.response.shears
        shear, off_side = force * t if shears else 0.0, radius * angle_sd
        out, along, sideways = (c, s, 0.0), (-s, c, 0.0), off_side * off_side
        covariance = [sideways * a * b for a in along for b in along]
        covariance[8] += _HEIGHT**2
        status = float(Status.IMPLAUSIBLE if off > _UNBELIEVABLE else Status.CONTACT)
        unsure = (angle_sd, force_sd, depth_sd, shear_sd if shears else nan)
        said = [angle, depth, width, shear if shears else nan, *unsure, seen]
        push = [-force * a + shear * b for a, b in zip(out, along, strict=True)]
        place = [radius * a for a in out]
        return [*place, *out, *push, nan, *covariance, off, 1.0, status, *said, 0.0]  # in the order of ROW, features

    def _identify(self, time: float, rows: np.ndarray) -> None:
        """Write the contacts' identities into the last column of the rows."""
        from palpate.contact import _track

        set_, count = self.settings, len(rows)
        identity, points = np.zeros(count, dtype=np.int64), np.ascontiguousarray(rows[:, ROW.point])
        reach, speed, patience = map(float, (set_.reach, set_.speed, set_.patience))
        _track.follow(time, points, count, *self._tracks, reach, speed, patience, identity)
        rows[:, -1] = identity


class _Watch:
    """Count the images that no contact explains, and note since when every image has a contact."""

    def __init__(self) -> None:
        self._first = self._since = self._last = nan  # s
        self._touched = self._odd = 0

    def add(self, time: float, contacts: int, residual: float) -> None:
        self._first, self._last = self._first if self._first <= time else time, time
        if contacts > 0:
            self._since = self._since if self._since <= time else time
            self._touched, self._odd = self._touched + 1, self._odd + (residual > _UNBELIEVABLE)
        elif contacts == 0:
            self._since = nan

    def warnings(self) -> list[str]:
        mend = f"{_CAUSE}: calibrate again, or write tare where it is untouched at first"
        said = endless(self._first, self._since, self._last, mend)
        if self._odd > MANY * self._touched:
            share = f"{self._odd / self._touched:.0%} of the images with a contact"
            said.append(f"no contact explains the markers in {share}: {_CAUSE}")
        return said


def _dent_widths(ring: MarkerRing) -> tuple[np.ndarray, np.ndarray]:
    """Return width coordinates z, and half of a dent's width [m] at half of its depth for each."""
    z, delta = np.linspace(-3.0, 3.0, 25), np.linspace(0.0, np.pi / 2, 181)
    mean = ring.response.coefficients[:3, 0, :, 0] @ ring_basis(delta, ring.response.orders[0]).T
    inward = -(mean[0] + np.multiply.outer(z, mean[1]) + np.multiply.outer(z * z, mean[2]))
    half = np.argmax(inward < 0.5 * inward[:, :1], axis=1)
    return z, ring.radius * delta[half]
