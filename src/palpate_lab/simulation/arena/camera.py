"""Draw images of the camera in a barrel quickly: only the windows around the markers are drawn anew.

An image that `RenderedCamera` draws in milliseconds with OpenCV takes a tenth of one here, with the same colours,
light, blur and noise. A few backgrounds are rendered once and shown in turns; light and shadow stand still, and nothing
is compressed as JPEG.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float, UInt8
from scipy.special import ndtr

from palpate_lab.simulation.ring_camera import HEIGHT, READ, SHOT, Look, RenderedCamera, RingCamera

BACKGROUNDS = 4
GRAIN = 256  # px: side of the piece of noise that windows are cut from
AHEAD = 300  # frames whose noise is drawn at once: a call of the generator costs more than its numbers
OUTLINE = 12  # corners of the discs of `Barrel`
SHAPE = float(np.sqrt(OUTLINE / (2.0 * np.pi) * np.sin(2.0 * np.pi / OUTLINE)))  # of an ellipse of the same area
PIXEL = 1.0 / 12.0  # px^2: variance of a pixel's own width


class TableCamera:
    """A quick renderer of images of one camera and one look.

    Args:
        camera: camera that sees the scene.
        look: look of the scene; its `quality` makes no difference.
        rng: random numbers of the noise, drawn for many images at a time.

    Raises:
        InputError: OpenCV is not installed.
    """

    def __init__(self, camera: RingCamera, look: Look, rng: np.random.Generator) -> None:
        from palpate_lab.simulation.arena._camera import PER

        self.camera, self.look, self.rng = camera, look, rng
        photographer = RenderedCamera(camera, replace(look, quality=None), rng)
        self._behind = [photographer.background(0.0) for _ in range(BACKGROUNDS)]
        self._frames = [each.copy() for each in self._behind]
        self._windows: list[np.ndarray] = [np.zeros((0, 4), dtype=np.int64)] * BACKGROUNDS
        self._turn, self._drawn = 0, iter(())
        self._grain, self._blur = photographer.grain(GRAIN), float(np.sqrt(look.blur**2 + PIXEL))
        skin, red = look.colours()
        noise = look.noise**2 * np.array([SHOT, READ**2])
        phi = ndtr(np.arange(8 * PER + 1) / PER - 4.0)
        scene = (photographer.light(0.0), np.stack([skin, red - skin]), noise, phi)
        self._scene = tuple(np.ascontiguousarray(each, dtype=np.float32) for each in scene)
        place, turn = np.array([0.0, 0.0, HEIGHT]) + camera.offset, camera.turn() * [1.0, -1.0, -1.0]
        self._lens = np.concatenate([camera.focal, camera.middle, camera.distortion, place, turn.ravel()])

    def frame(self, points: Float[np.ndarray, "m 3 3"], hidden: Sequence[int] = ()) -> UInt8[np.ndarray, "h w 3"]:
        """Draw an image (h, w, 3), blue first, in a buffer that the fourth call from this one draws over.

        Args:
            points: (m, 3, 3) middle of each marker's disc and two points of its edge, around the ring and along its
                axis, as `RingSkin.markers` returns them [m].
            hidden: numbers of markers behind something dark.
        """
        from palpate_lab.simulation.arena._camera import LARGEST, draw  # compiled: loaded when first needed

        at = self._turn = (self._turn + 1) % BACKGROUNDS
        if len(self._windows[at]) != len(points):
            self._frames[at][:], self._windows[at] = self._behind[at], np.zeros((len(points), 4), dtype=np.int64)
        shown = self._ellipses(points)
        if len(hidden):
            shown[list(hidden)] = np.nan
        offsets = next(self._drawn, None)
        if offsets is None or len(offsets) != len(points):
            self._drawn = iter(self.rng.integers(0, GRAIN - LARGEST, (AHEAD, len(points), 2)))
            offsets = next(self._drawn)
        buffers = (self._frames[at], self._behind[at], self._windows[at])
        draw(*buffers, shown, self._blur, self._scene, self._grain, offsets)
        return self._frames[at]

    def black(self) -> UInt8[np.ndarray, "h w 3"]:
        """Return an image without light, (h, w, 3), all zeros."""
        return np.zeros((self.camera.height, self.camera.width, 3), dtype=np.uint8)

    def places(self, points: Float[np.ndarray, "m 3 3"]) -> Float[np.ndarray, "m 2"]:
        """Return the centroids (m, 2) [px] of the markers' images, without drawing them."""
        return self._ellipses(points)[:, :2].copy()

    def _ellipses(self, points: Float[np.ndarray, "m 3 3"]) -> Float[np.ndarray, "m 6"]:
        from palpate_lab.simulation.arena._camera import ellipses

        out = np.empty((len(points), 6))
        ellipses(np.ascontiguousarray(points, dtype=np.float64), self._lens, SHAPE, out)
        return out
