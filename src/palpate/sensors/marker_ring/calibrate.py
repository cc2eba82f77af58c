"""Calibrate a marker ring from images of presses at known angles, depths and forces."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float, UInt8

from palpate.errors import InputError
from palpate.optical.fisheye import RingView
from palpate.optical.markers import Blobs, FrameProblem, MarkerColour, MarkerTracker, find_blobs, find_colour
from palpate.optical.ring_response import RingResponse
from palpate.sensors.marker_ring.calibrate_camera import fit_rings
from palpate.sensors.marker_ring.model import MarkerRing, RingBody
from palpate.sensors.marker_ring.response_fit import RingPresses, fit_response
from palpate.signals.recording import IMAGE, Recording
from palpate.spatial.arguments import takes_arrays
from palpate.spatial.pose import Pose

__all__ = ["RingTruth", "calibrate_marker_ring"]

_TOUCHED = 0.02  # N: lighter presses have no information
_LOOKED = 60  # unloaded frames that the rest is taken from
_MIRRORED = 0.6  # rad: median error of angles that fall where the markers' rise


@takes_arrays
@dataclass(frozen=True, eq=False)
class RingTruth:
    """True contacts of n images, one each; NaN: untouched, or not known.

    Attributes:
        angle: (n,) [rad].
        depth: (n,) [m].
        force: (n,) [N], positive inwards.
        shear: (n,) [N] along rising angles.
    """

    angle: Float[np.ndarray, " n"]
    depth: Float[np.ndarray, " n"]
    force: Float[np.ndarray, " n"]
    shear: Float[np.ndarray, " n"]

    @property
    def pressed(self) -> Bool[np.ndarray, " n"]:
        """Bool mask (n,) of the images that a fit can use: pressed with a known angle, depth and force."""
        known = np.isfinite(self.angle) & np.isfinite(self.depth) & np.isfinite(self.force)
        return known & (self.force > _TOUCHED) & (self.depth > 0)

    @property
    def free(self) -> Bool[np.ndarray, " n"]:
        """Bool mask (n,) of the images in which nothing touches: force 0 or NaN."""
        return ~np.isfinite(self.force) | (self.force == 0)


def calibrate_marker_ring(
    blocks: Iterable[Recording],
    truth: RingTruth,
    body: RingBody,
    before: RingResponse | None = None,
    provenance: Mapping[str, str] | None = None,
) -> MarkerRing:
    """Calibrate a `MarkerRing`: camera, markers at rest, noise of their places, response.

    Args:
        blocks: recordings of images, from the start of the log, which begins untouched.
        truth: true contact of every image, in the same order.
        body: known dimensions of the unit.
        before: response of another unit: tens of presses are then enough.
        provenance: stored in the model's file.

    Raises:
        InputError: the markers are not found, the truth does not fit the images, the presses do not determine the
            response, or OpenCV is missing.
        NotIdentifiable: the markers at rest are no even ring about the middle of the image.
    """
    looking, kept = _Rest(body), list[np.ndarray]()
    tracker: MarkerTracker | None = None
    first = 0
    for block in blocks:
        frames, free = block.channels[IMAGE], truth.free[first : first + len(block)]
        first += len(block)
        if tracker is None:
            ended = looking.add(frames, free)
            if not ended:
                continue
            tracker = looking.tracker()
            frames = np.concatenate(looking.frames)
        kept.append(_tracked(tracker, frames))
    if tracker is None:
        tracker = looking.tracker()
        kept.append(_tracked(tracker, np.concatenate(looking.frames)))
    pixels = np.concatenate(kept)
    if len(pixels) != len(truth.angle):
        raise InputError(f"has {len(truth.angle)} rows, but needs one for each of {len(pixels)} frames.", where="truth")
    return _model(looking, pixels, truth, before, dict(provenance or {}))


@dataclass
class _Rest:
    """The first images, collected until enough untouched ones show where the markers rest."""

    body: RingBody
    frames: list[UInt8[np.ndarray, "n h w 3"]] = field(default_factory=list[np.ndarray])
    free: list[np.ndarray] = field(default_factory=list[np.ndarray])
    colour: MarkerColour | None = None
    view: RingView | None = None
    rest: np.ndarray = field(default_factory=lambda: np.zeros((0, 2)))
    area: np.ndarray = field(default_factory=lambda: np.zeros(0))

    def add(self, frames: np.ndarray, free: np.ndarray) -> bool:
        """Add images with the mask of untouched ones; return whether the untouched start is over, or long enough."""
        self.frames.append(frames)
        self.free.append(free)
        known = np.concatenate(self.free)
        return bool(np.count_nonzero(known[: _leading(known)]) >= _LOOKED or not known.all())

    def tracker(self) -> MarkerTracker:
        """Return a tracker that is ready for the first image; raise InputError if the markers at rest are not found."""
        known = np.concatenate(self.free)
        count = _leading(known)
        if not count:
            raise InputError(
                "the log does not begin untouched: no frame shows where the markers rest.",
                hint="Let the log begin with a second in which nothing touches the ring.",
            )
        still = np.concatenate(self.frames)[: min(count, _LOOKED)]
        count = self.body.markers * len(self.body.rings)
        self.colour = self.body.colour or _colour(still, count)
        seen = [find_blobs(frame, self.colour) for frame in still]
        first = next((blobs for blobs in seen if len(blobs) == count), None)
        if first is None:
            raise InputError(
                f"{len(seen[0])} markers are found in the first frame, but the rig states {count}.",
                where="marker_ring.markers",
            )
        size = (still.shape[2], still.shape[1])
        inner = self.body.radius - self.body.thickness
        camera = {"camera": self.body.camera, "height": self.body.height, "size": size}
        self.view, order = fit_rings(first.pixels, inner, self.body.rings, **camera)
        self.rest, self.area = _usual(seen, first.pixels[order])
        return MarkerTracker(self.view, self.colour, self.rest, self.area)


def _colour(still: UInt8[np.ndarray, "n h w 3"], markers: int) -> MarkerColour:
    """Return the markers' colour from one of the first images; one image of a noisy camera may lack a marker."""
    for frame in still[1:10]:
        try:
            return find_colour(frame, markers)
        except InputError:
            continue
    return find_colour(still[0], markers)


def _usual(seen: Sequence[Blobs], places: Float[np.ndarray, "m 2"]) -> tuple[np.ndarray, np.ndarray]:
    """Return median places (m, 2) and areas (m,) of markers; areas of one image are wrong by a tenth and more."""
    near = 0.3 * np.linalg.norm(places - np.roll(places, 1, axis=0), axis=1).min()
    found = np.full((len(seen), len(places), 3), np.nan)
    for k, blobs in enumerate(seen):
        away = np.linalg.norm(blobs.pixels[:, None] - places[None], axis=2)
        if len(blobs):
            which = away.argmin(axis=0)
            kept = away.min(axis=0) < near
            found[k, kept] = np.column_stack([blobs.pixels, blobs.areas])[which[kept]]
    usual: np.ndarray = np.nanmedian(found, axis=0)
    return usual[:, :2].copy(), usual[:, 2].copy()


def _leading(free: np.ndarray) -> int:
    """Return the number of untouched images at the start."""
    return int(len(free) if free.all() else np.argmin(free))


def _tracked(tracker: MarkerTracker, frames: np.ndarray) -> np.ndarray:
    """Return the markers' places (n, m, 2) [px]; NaN where a marker or the entire image cannot be used."""
    pixels = np.full((len(frames), len(tracker.view.angles), 2), np.nan)
    for frame, row in zip(frames, pixels, strict=True):
        tracker.track(frame, row)
        if tracker.frame != FrameProblem.OK:
            row[:] = np.nan
    return pixels


def _model(
    looking: _Rest, pixels: np.ndarray, truth: RingTruth, before: RingResponse | None, provenance: dict[str, str]
) -> MarkerRing:
    view, colour = looking.view, looking.colour
    if view is None or colour is None:
        raise InputError("no frame shows where the markers rest: an untouched frame is needed.")
    still = pixels[: _leading(truth.free)]
    spread: np.ndarray = np.nanvar(still, axis=0)
    rest, jitter = np.nanmean(still, axis=0), float(np.sqrt(np.mean(spread)))
    seen = np.count_nonzero(np.isfinite(pixels[..., 0]), axis=1)
    rows = np.asarray(truth.pressed & (seen >= 0.6 * len(rest)), dtype=bool)
    if not rows.any():
        raise InputError("no frame shows the markers and has an angle, depth and force: check the times of the truth.")
    body = looking.body
    each = 2 * len(view.rings)
    nothing = RingResponse(np.zeros((3, each, 1, 1)), np.ones(2), np.zeros((each, 1)), np.zeros(2), np.zeros(2))
    plain = MarkerRing(body.radius, view, colour, rest, looking.area, max(jitter, 1e-3), nothing)
    turned = _turned(plain, pixels[rows], truth.angle[rows])
    presses = RingPresses(
        truth.angle[rows],
        truth.depth[rows],
        truth.force[rows],
        truth.shear[rows],
        turned.displacements(pixels[rows]),
        turned.view.angles,
        turned.noise(),
        len(view.rings),
    )
    response = fit_response(presses, before)
    used = f"{np.count_nonzero(rows)} of {np.count_nonzero(truth.pressed)} pressed frames were used"
    return MarkerRing(body.radius, turned.view, colour, rest, looking.area, plain.jitter, response, (used,), provenance)


def _turned(ring: MarkerRing, pixels: np.ndarray, angle: np.ndarray) -> MarkerRing:
    """Return the ring turned into the frame of the truth's angles, whose origin a camera cannot see.

    Raises:
        InputError: the markers do not move at the truth's angles.
    """
    inward = np.maximum(-np.nan_to_num(ring.displacements(pixels)[..., 0]), 0.0) ** 2
    seen = np.angle((inward * np.exp(1j * ring.view.angles)).sum(axis=1))
    offset = float(np.angle(np.exp(1j * (angle - seen)).sum()))
    off, mirrored = (_median_off(sign * angle - seen) for sign in (1.0, -1.0))
    if off > _MIRRORED:
        hint = "Count them anticlockwise as the camera sees the ring." if mirrored < 0.5 * off else "Correct them."
        raise InputError("the angles of the truth are not those at which the markers move.", where="truth", hint=hint)
    c, s = np.cos(offset), np.sin(offset)
    turn = Pose(np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]), np.zeros(3))
    view = RingView(
        ring.view.camera, turn @ ring.view.pose, ring.view.radius, ring.view.angles + offset, ring.view.rings
    )
    return MarkerRing(ring.radius, view, ring.colour, ring.rest, ring.area, ring.jitter, ring.response)


def _median_off(angles: np.ndarray) -> float:
    """Return the median distance [rad] of angles from their circular mean."""
    middle = np.angle(np.exp(1j * angles).sum())
    return float(np.median(np.abs(np.angle(np.exp(1j * (angles - middle))))))
