"""The tables of a marker ring and of a camera's lens in a file, and their summaries."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Float

from palpate.files.models.model import Lines, Model
from palpate.files.schema import Key, TableForm
from palpate.optical.fisheye import Fisheye, RingView
from palpate.optical.markers import MarkerColour
from palpate.optical.ring_response import RingResponse
from palpate.sensors.marker_ring.model import MarkerRing
from palpate.spatial.pose import Pose


def _marker_ring(
    radius: float,
    inner: float,
    camera: Fisheye,
    pose: Float[np.ndarray, "3 4"],
    markers: Float[np.ndarray, "m 4"],
    rings: tuple[float, ...] = (0.0,),
    **rest: Any,
) -> MarkerRing:
    view = RingView(camera, Pose(pose[:, :3], pose[:, 3]), inner, markers[:, 3].copy(), rings)
    return MarkerRing(radius, view, rest=markers[:, :2], area=markers[:, 2], **rest)


def _marker_ring_keys(ring: MarkerRing) -> dict[str, Any]:
    view = ring.view
    pose = np.concatenate([view.pose.rotation, view.pose.translation[:, None]], axis=1)
    table = np.concatenate([ring.rest, ring.area[:, None], view.angles[:, None]], axis=1)
    rings = tuple(view.rings.tolist()) if len(view.rings) > 1 else None
    return {"inner": view.radius, "camera": view.camera, "pose": pose, "markers": table, "rings": rings}


def _ring_response(shape: tuple[int, int, int], coefficients: Float[np.ndarray, "n k"], **rest: Any) -> RingResponse:
    if min(shape) < 1 or coefficients.shape[1] != shape[2] or len(coefficients) % (shape[0] * 2 * shape[1]):
        raise ValueError(f"coefficients must be {shape[0]} x 2 x {shape[1]} rows of {shape[2]} numbers for each ring")
    return RingResponse(coefficients.reshape(shape[0], -1, shape[1], shape[2]), **rest)


def _ring_response_keys(response: RingResponse) -> dict[str, Any]:
    b, _, k, m = response.coefficients.shape
    return {"shape": (b, k, m), "coefficients": response.coefficients.reshape(-1, m)}


def of_marker_ring(ring: MarkerRing) -> Lines:
    """Return (name, text) pairs on the model: ring, camera, noise, calibrated range and errors."""
    response, view = ring.response, ring.view
    outward, along = (1e6 * np.median(ring.noise(), axis=0)).tolist()
    tilt = np.degrees(np.arccos(np.clip(-view.pose.rotation[2, 2], -1.0, 1.0)))
    depth, force = response.largest.tolist()
    rings = f" in {response.rings} rings" if response.rings > 1 else ""
    angle, share = np.degrees(response.spread[0]), 100.0 * response.spread[1]
    off, expected, wrong, unsure = response.left_out.tolist()
    judged = (
        f"{np.degrees(off):.2g} deg and {100 * wrong:.2g} % of the force off (rms), where {np.degrees(expected):.2g} "
        f"deg and {100 * unsure:.2g} % are expected"
    )
    return [
        ("ring", f"{len(ring)} {ring.colour.score} markers{rings}, radius {1e3 * ring.radius:.1f} mm outside"),
        ("camera", f"{1e3 * view.pose.translation[2]:.1f} mm above the markers, tilted by {tilt:.1f} deg"),
        ("noise", f"{ring.jitter:.2g} px: {outward:.0f} um outwards, {along:.0f} um along"),
        ("calibrated", f"to {1e3 * depth:.3g} mm, {force:.3g} N{'; shear, too' if response.shears else ''}"),
        ("deviation", f"{angle:.2g} deg and {share:.2g} % of the force in addition to noise, on presses left out"),
        *([("left out", judged)] if np.isfinite(off) else []),
    ]


def of_camera(camera: Fisheye) -> Lines:
    """Return two (name, text) pairs: the lens's image size [px] and focal lengths [px/rad]."""
    return [
        ("image", f"{camera.width} x {camera.height}"),
        ("focal length", f"{camera.fx:.5g}, {camera.fy:.5g} px/rad"),
    ]


CAMERA = Model(
    Fisheye,
    "a camera's lens",
    "A fisheye lens, in OpenCV's model.",
    "palpate calibrate camera",
    of_camera,
    {
        Fisheye: TableForm(
            {
                "fx": Key("px/rad at the centre"),
                "cx": Key("px, of the principal point"),
                "k1": Key("of the angle's powers [Kannala-Brandt], as OpenCV's fisheye model has them"),
                "width": Key("px, of the image"),
            }
        ),
    },
)

MARKER_RING = Model(
    MarkerRing,
    "a model of a marker ring",
    "A soft ring of markers: the camera, the markers at rest, how they move.",
    "palpate calibrate marker-ring",
    of_marker_ring,
    {
        **CAMERA.forms,
        MarkerRing: TableForm(
            {
                "radius": Key("m, of the skin's outer surface at the markers"),
                "inner": Key("m, of the markers"),
                "jitter": Key("px, deviation of a marker's place from frame to frame"),
                "notes": Key(),
                "pose": Key("of the camera in the ring: rotation, and place [m] in the last column"),
                "markers": Key("a row a marker at rest: x y [px], area [px], angle [rad]"),
                "rings": Key("m, heights of the rings of markers, towards the camera; as many rows of markers each"),
                "colour": Key(),
                "camera": Key(),
                "response": Key(),
                "provenance": Key(),
            },
            _marker_ring,
            _marker_ring_keys,
        ),
        MarkerColour: TableForm(
            {
                "score": Key("of a pixel: red, green, blue, bright, dark"),
                "threshold": Key("share of the way from the skin's score to the markers'"),
                "coverage": Key("share of the image that markers cover"),
                "background": Key("px, side of the square whose mean is subtracted; 0: none"),
            }
        ),
        RingResponse: TableForm(
            {
                "width": Key("m/N, mean and deviation of the depth of a newton"),
                "misfit": Key("m/N, left unexplained outwards and along, in equal parts of a turn from the contact on"),
                "spread": Key("rad, share of the force: deviations on touches that were not fitted"),
                "largest": Key("m, N: up to which it was calibrated"),
                "usual": Key("before anything is known: mean and deviation of the width z, deviation of shear / force"),
                "grip": Key("shear / force up to which it was calibrated", least=0.0),
                "dragged": Key(
                    "share of dragged presses, deviations of shear / force of plain and of dragged; 0: one kind"
                ),
                "carried": Key(
                    "rad/N of shear, rad/m: by which the skin under a contact is carried along, see RingResponse"
                ),
                "sheared": Key(
                    "rad, shares of the force, a multiple: what a shear as large as the force adds to deviations of "
                    "angle, force and shear, and to the misfit",
                    least=0.0,
                ),
                "left_out": Key(
                    "rad, then shares of the force: rms error on presses that were left out, and the expected one",
                    unknown=True,
                ),
                "shape": Key(
                    "of the coefficients: v0 v1 v2 (s), terms of the angle from the contact, of the contact's"
                ),
                "coefficients": Key("m/N, rows: v0 v1 v2 (s), each outwards, then along"),
            },
            _ring_response,
            _ring_response_keys,
        ),
    },
)
