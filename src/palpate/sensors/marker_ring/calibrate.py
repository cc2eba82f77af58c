"""Calibrate a marker ring from images of presses at known angles, depths and forces."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import chain

import numpy as np
from jaxtyping import Bool, Float, UInt8

from palpate.errors import InputError
from palpate.optical.markers import Blobs, FrameProblem, MarkerColour, MarkerTracker, find_blobs, find_colour
from palpate.optical.ring_response import RingResponse
from palpate.sensors.marker_ring.calibrate_camera import fit_rings
from palpate.sensors.marker_ring.model import MarkerRing, RingBody
from palpate.sensors.marker_ring.response_fit import RingPresses, fit_response
from palpate.signals.recording import IMAGE, Recording
from palpate.spatial.arguments import frozen_value
from palpate.spatial.pose import Pose

_TOUCHED = 0.02  # N: lighter presses have no information
_LOOKED = 60  # unloaded frames that the rest is taken from
_MIRRORED = 0.6  # rad: median error of angles that fall where the markers' rise


@frozen_value
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
        """Mask (n,) of the images with a known angle, a positive depth and a force above 0.02 N."""
        known = np.isfinite(self.angle) & np.isfinite(self.depth) & np.isfinite(self.force)
        return known & (self.force > _TOUCHED) & (self.depth > 0)

    @property
    def free(self) -> Bool[np.ndarray, " n"]:
        """Mask (n,) of the images in which nothing touches: force 0 or NaN."""
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
        blocks: recordings of images, the first ones untouched.
        truth: true contact of every image, in the same order.
        body: known dimensions of the unit.
        before: response of another unit, with which tens of presses are enough; None: not known.
        provenance: stored in the model's file.

    Raises:
        InputError: the markers are not found, the truth does not fit the images, the presses do not determine the
            response, or OpenCV is missing.
        NotIdentifiable: the markers at rest are no even ring about the middle of the image.
        KeyError: a recording has no images.
    """
    images, first = (block.channels[IMAGE] for block in blocks), list[np.ndarray]()
    free = truth.free[:0]
    for frames in images:
        first.append(frames)
        free = truth.free[: sum(map(len, first))]
        if not free.all() or len(free) >= _LOOKED:
            break
    start = np.concatenate(first) if first else np.zeros((0, 1, 1, 3), dtype=np.uint8)
    tracker, area = _at_rest(start[: min(_leading(free), _LOOKED)], body)
    pixels = np.concatenate([_tracked(tracker, frames) for frames in chain([start], images)])
    if len(pixels) != len(truth.angle):
        raise InputError(f"has {len(truth.angle)} rows, but needs one for each of {len(pixels)} frames.", where="truth")
    return _model(body.radius, tracker, area, pixels, truth, before, dict(provenance or {}))


def _at_rest(still: UInt8[np.ndarray, "n h w 3"], body: RingBody) -> tuple[MarkerTracker, Float[np.ndarray, " m"]]:
    """Return a tracker for the first image, and the markers' areas at rest."""
    if not len(still):
        raise InputError(
            "the log does not begin untouched: no frame shows where the markers rest.",
            hint="Let the log begin with a second in which nothing touches the ring.",
        )
    count = body.markers * len(body.rings)
    colour = body.colour or _colour(still, count)
    seen = [find_blobs(frame, colour) for frame in still]
    first = next((blobs for blobs in seen if len(blobs) == count), None)
    if first is None:
        raise InputError(
            f"{len(seen[0])} markers are found in the first frame, but the rig states {count}.",
            where="marker_ring.markers",
            hint="Correct it, or let the log begin with all markers visible and evenly lit.",
        )
    camera = {"camera": body.camera, "height": body.height, "size": (still.shape[2], still.shape[1])}
    view, order = fit_rings(first.pixels, body.radius - body.thickness, body.rings, **camera)
    rest, area = _usual(seen, first.pixels[order])
    return MarkerTracker(view, colour, rest, area), area


def _colour(still: UInt8[np.ndarray, "n h w 3"], markers: int) -> MarkerColour:
    """Return the markers' colour from the first of ten images that shows all of them."""
    for frame in still[1:10]:
        try:
            return find_colour(frame, markers)
        except InputError:
            continue
    return find_colour(still[0], markers)


def _usual(seen: Sequence[Blobs], places: Float[np.ndarray, "m 2"]) -> tuple[np.ndarray, np.ndarray]:
    """Return median places (m, 2) and areas (m,) of markers."""
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
    """Return the markers' places (n, m, 2) [px]; NaN where they cannot be used."""
    pixels = np.full((len(frames), len(tracker.view.angles), 2), np.nan)
    for frame, row in zip(frames, pixels, strict=True):
        tracker.track(frame, row)
        if tracker.frame != FrameProblem.OK:
            row[:] = np.nan
    return pixels


def _model(
    radius: float,
    tracker: MarkerTracker,
    area: Float[np.ndarray, " m"],
    pixels: Float[np.ndarray, "n m 2"],
    truth: RingTruth,
    before: RingResponse | None,
    provenance: dict[str, str],
) -> MarkerRing:
    still = pixels[: _leading(truth.free)]
    spread: np.ndarray = np.nanvar(still, axis=0)
    rest, jitter = np.nanmean(still, axis=0), float(np.sqrt(np.mean(spread)))
    seen = np.count_nonzero(np.isfinite(pixels[..., 0]), axis=1)
    rows = np.asarray(truth.pressed & (seen >= 0.6 * len(rest)), dtype=bool)
    if not rows.any():
        raise InputError("no frame shows the markers and has an angle, depth and force: check the times of the truth.")
    rings = len(tracker.view.rings)
    nothing = RingResponse(
        np.zeros((3, 2 * rings, 1, 1)), np.ones(2), np.zeros((2 * rings, 1)), np.zeros(2), np.zeros(2)
    )
    plain = MarkerRing(radius, tracker.view, tracker.colour, rest, area, max(jitter, 1e-3), nothing)
    angle, depth, force, shear = (each[rows] for each in (truth.angle, truth.depth, truth.force, truth.shear))
    turned = _turned(plain, pixels[rows], angle)
    moved = turned.displacements(pixels[rows])
    presses = RingPresses(angle, depth, force, shear, moved, turned.view.angles, turned.noise(), rings)
    used = f"{np.count_nonzero(rows)} of {np.count_nonzero(truth.pressed)} pressed frames of the calibration were used"
    return replace(turned, response=fit_response(presses, before), notes=(used,), provenance=provenance)


def _turned(ring: MarkerRing, pixels: np.ndarray, angle: np.ndarray) -> MarkerRing:
    """Return the ring turned into the frame of the truth's angles."""
    inward = np.maximum(-np.nan_to_num(ring.displacements(pixels)[..., 0]), 0.0) ** 2
    seen = np.angle((inward * np.exp(1j * ring.view.angles)).sum(axis=1))
    offset = float(np.angle(np.exp(1j * (angle - seen)).sum()))
    off, mirrored = (_median_off(sign * angle - seen) for sign in (1.0, -1.0))
    if off > _MIRRORED:
        hint = "Check that angle_deg is in degrees, and that each row belongs to its frame."
        if mirrored < 0.5 * off:
            hint = "Count them anticlockwise as the camera sees the ring."
        raise InputError("the angles of the truth are not those at which the markers move.", where="truth", hint=hint)
    c, s = np.cos(offset), np.sin(offset)
    turn = Pose(np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]), np.zeros(3))
    view = replace(ring.view, pose=turn @ ring.view.pose, angles=ring.view.angles + offset)
    return replace(ring, view=view)


def _median_off(angles: np.ndarray) -> float:
    """Return the median distance [rad] of angles from their circular mean."""
    middle = np.angle(np.exp(1j * angles).sum())
    return float(np.median(np.abs(np.angle(np.exp(1j * (angles - middle))))))
