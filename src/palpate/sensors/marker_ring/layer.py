"""Draw a marker ring on the page: the camera's image with its markers, and the markers in the scene."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Float32, UInt8

from palpate.errors import InputError
from palpate.opencv import opencv
from palpate.sensors.marker_ring.model import MarkerRing
from palpate.spatial.arguments import takes_arrays
from palpate.viewer.legend import dot

if TYPE_CHECKING:
    from viser import ClientHandle, GuiApi, GuiImageHandle, PointCloudHandle, ViserServer

    from palpate.viewer.scene import Scene

_REST, _NOW, _MOVED = (150, 150, 150), (0, 235, 255), (255, 160, 0)  # blue, green, red
_MAGNIFIED = 4  # factor by which drawn displacements are longer than they are
_FARTHEST = 1e6  # px: OpenCV counts sixteenths in 32 bits
_COLOUR = (190, 60, 150)
_ABOVE = 1.03  # radii of the skin


@takes_arrays
def annotated(
    frame: UInt8[np.ndarray, "h w 3"], rest: Float[np.ndarray, "m 2"], pixels: Float[np.ndarray, "m 2"]
) -> UInt8[np.ndarray, "h w 3"]:
    """Return an RGB copy (h, w, 3) uint8 of a BGR image, with each marker's place and four times its displacement.

    Args:
        frame: (h, w, 3) blue, green, red.
        rest: (m, 2) markers at rest [px].
        pixels: (m, 2) markers now [px]; NaN: not drawn.

    Raises:
        InputError: `rest` is not finite or beyond 1e6, `frame` is empty, an array has another shape, or OpenCV is
            missing.
    """
    if not (np.abs(rest) < _FARTHEST).all():
        raise InputError(f"rest must be finite pixels below {_FARTHEST:g}.")
    if not frame.size:
        raise InputError("frame must have pixels, and is empty.")
    cv2 = opencv()
    picture, fine = frame.copy(), 8.0
    for before, now in zip(rest, pixels, strict=True):
        start = tuple((fine * before).round().astype(int).tolist())
        cv2.circle(picture, start, int(3 * fine), _REST, 1, cv2.LINE_AA, 3)
        if (np.abs(now) < _FARTHEST).all():
            end = tuple((fine * (before + _MAGNIFIED * (now - before))).round().astype(int).tolist())
            cv2.line(picture, start, end, _MOVED, 2, cv2.LINE_AA, 3)
            middle = tuple((fine * now).round().astype(int).tolist())
            cv2.circle(picture, middle, int(6 * fine), _NOW, 1, cv2.LINE_AA, 3)
    return picture[..., ::-1].copy()


@takes_arrays
class RingLayer:
    """A layer with the ring's markers in the scene, and the camera's image in the panel.

    Args:
        ring: calibrated ring.
        frames: JPEG images, one per sample of the log; empty: not known.
        pixels: (n, m, 2) of the markers in each; NaN: not seen; None: not known.
        size: height and width of the images of a stream [px]; None: no stream.
    """

    def __init__(
        self,
        ring: MarkerRing,
        frames: Sequence[bytes] = (),
        pixels: Float32[np.ndarray, "n m 2"] | None = None,
        size: tuple[int, int] | None = None,
    ) -> None:
        self._ring, self._frames = ring, frames
        self._fed = None if size is None else (np.zeros((*size, 3), dtype=np.uint8), ring.rest)
        self._pixels = np.zeros((0, len(ring), 2), np.float32) if pixels is None else pixels
        self._image: GuiImageHandle | None = None

    @property
    def covers(self) -> bool:
        """False, as markers do not cover the skin."""
        return False

    @property
    def places(self) -> Float[np.ndarray, "k 3"]:
        """Points (m, 3) [m] of the skin's outer surface at the markers, in the ring's frame."""
        angles = self._ring.view.angles
        place = [self._ring.radius * np.cos(angles), self._ring.radius * np.sin(angles), self._ring.view.heights]
        return np.stack(place, axis=1)

    def draw(self, server: ViserServer | ClientHandle, scene: Scene) -> None:
        """Draw the markers as points on the skin."""
        self._scene = scene
        colours = np.tile(np.array(_COLOUR, np.uint8), (len(self._ring), 1))
        points = self._points(self._ring.rest)
        self._markers: PointCloudHandle = server.scene.add_point_cloud(
            "/markers", points, colours, point_size=0.007, point_shape="circle"
        )

    def panel(self, gui: GuiApi) -> None:
        """Add the camera's image to the panel, if there are images.

        Raises:
            InputError: OpenCV is missing.
        """
        if self._frames or self._fed is not None:
            label = f"camera; yellow: markers; blue: ways from rest, \u00d7 {_MAGNIFIED}"
            self._image = gui.add_image(self._picture(0), label=label, format="jpeg")

    def feed(self, frame: UInt8[np.ndarray, "h w 3"], pixels: Float[np.ndarray, "m 2"]) -> None:
        """Set the present image (h, w, 3) of a stream, and the markers (m, 2) [px] in it.

        Raises:
            InputError: pixels has another shape.
        """
        self._fed = frame, pixels

    def show(self, scene: Scene, index: int) -> None:
        """Move the drawn markers to a sample, and show its image; change nothing if the sample has none.

        Raises:
            InputError: OpenCV is missing.
        """
        sample = int(scene.contacts.sample[scene.starts[index]])
        if self._fed is None and sample >= len(self._pixels):
            return
        self._markers.points = self._points(self._seen(sample))
        if self._image is not None:
            self._image.image = self._picture(sample)

    def rows(self, scene: Scene, index: int) -> list[tuple[str, str]]:
        """Return []."""
        return []

    def legend(self) -> list[str]:
        """Return the legend's entry for the markers, one HTML string."""
        return [dot(_COLOUR, "marker, below the skin")]

    def _seen(self, sample: int) -> Float[np.ndarray, "m 2"]:
        """Return the markers' places (m, 2) [px] in a sample, or in the present image of a stream."""
        return self._pixels[sample].astype(np.float64) if self._fed is None else self._fed[1]

    def _points(self, pixels: Float[np.ndarray, "m 2"]) -> Float32[np.ndarray, "m 3"]:
        """Return points above the markers in the scene's units; at rest for a marker not seen."""
        view = self._ring.view
        plane = view.to_plane(np.where(np.isfinite(pixels), pixels, self._ring.rest), view.heights)
        plane *= _ABOVE * self._ring.radius / np.linalg.norm(plane, axis=1, keepdims=True)
        return self._scene.placed(np.concatenate([plane, view.heights[:, None]], axis=1)).astype(np.float32)

    def _picture(self, sample: int) -> UInt8[np.ndarray, "h w 3"]:
        if self._fed is not None:
            return annotated(self._fed[0], self._ring.rest, self._fed[1])
        cv2 = opencv()
        frame = cv2.imdecode(np.frombuffer(self._frames[sample], np.uint8), cv2.IMREAD_COLOR)
        return annotated(frame, self._ring.rest, self._seen(sample))
