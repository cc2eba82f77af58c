"""Draw images of a fisheye camera inside the barrel: red markers on dark skin, with a cheap sensor's noise and JPEG.

Nominally it stands 40 mm above the ring and looks down the axis (x_c = x, y_c = -y, z_c = -z); a unit's camera is
tilted and offset by a little. Projection after Kannala and Brandt, as OpenCV's fisheye model has it:
r = f (t + k1 t^3 + k2 t^5 + k3 t^7 + k4 t^9), t the angle from the optical axis.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float, UInt8

from palpate.opencv import opencv

HEIGHT = 0.040  # m above the ring
FINE = 8  # a marker's edge is drawn this much finer: its centroid is right to 0.01 px
SKIN, RED = np.array([34.0, 30.0, 32.0]), np.array([40.0, 36.0, 190.0])  # blue, green, red of 255
READ, SHOT = 4.9, 2.4  # of 255: standard deviation in the dark, and variance per unit of light, at noise 1
GRAIN = 1.6  # px: a cheap camera's own smoothing leaves noise in blotches
POOL = 512  # px: a sheet of noise larger than a frame by this is drawn once, and every frame cut out elsewhere


@dataclass(frozen=True)
class RingCamera:
    """A camera in the barrel.

    Attributes:
        focal, middle: (fx, fy), (cx, cy) [px].
        distortion: k1 to k4.
        tilt: angles [rad] about the nominal camera's x and y.
        offset: offset of its position from the nominal one [m], in the ring's frame.
        width, height: size of an image [px].
    """

    focal: tuple[float, float] = (204.0, 204.0)
    middle: tuple[float, float] = (319.5, 239.5)
    distortion: tuple[float, float, float, float] = (-0.012, 0.004, -0.0015, 0.0002)
    tilt: tuple[float, float] = (0.0, 0.0)
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    width: int = 640
    height: int = 480

    @staticmethod
    def drawn(rng: np.random.Generator) -> RingCamera:
        """Draw one unit's `RingCamera`: about 1.5 degrees and 1 mm off, with a slightly different lens."""
        tilt = np.radians(1.5) * rng.uniform(0.6, 1.3) * _unit(rng, 2)
        offset = 1e-3 * rng.uniform(0.6, 1.3) * _unit(rng, 3)
        focal = 204.0 * (1.0 + 0.01 * rng.standard_normal())
        middle = np.array([319.5, 239.5]) + rng.normal(0.0, 3.0, 2)
        distortion = np.array([-0.012, 0.004, -0.0015, 0.0002]) * rng.uniform(0.5, 1.5, 4)
        return RingCamera(
            (focal, focal * (1.0 + 0.002 * rng.standard_normal())),
            (float(middle[0]), float(middle[1])),
            (float(distortion[0]), float(distortion[1]), float(distortion[2]), float(distortion[3])),
            (float(tilt[0]), float(tilt[1])),
            (float(offset[0]), float(offset[1]), float(offset[2])),
        )

    def project(self, points: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 2"]:
        """Return the pixels (*n, 2) of points (*n, 3) [m] in the ring's frame.

        They are column and row; the middle of the first pixel is 0, 0.
        """
        seen = (points - [0.0, 0.0, HEIGHT] - np.asarray(self.offset)) * [1.0, -1.0, -1.0] @ self.turn().T
        off = np.hypot(seen[..., 0], seen[..., 1])
        angle = np.arctan2(off, seen[..., 2])
        k1, k2, k3, k4 = self.distortion
        square = angle**2
        bent = angle * (1 + square * (k1 + square * (k2 + square * (k3 + square * k4))))
        scale = bent / np.maximum(off, 1e-12)
        return seen[..., :2] * scale[..., None] * self.focal + self.middle

    def turn(self) -> Float[np.ndarray, "3 3"]:
        """Return the rotation (3, 3) from the nominal camera's axes to this one's."""
        a, b = self.tilt
        about_x = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
        about_y = np.array([[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]])
        return about_y @ about_x


def _unit(rng: np.random.Generator, size: int) -> Float[np.ndarray, " d"]:
    way = rng.standard_normal(size)
    return way / np.linalg.norm(way)


@dataclass(frozen=True)
class Look:
    """The look of the scene.

    Attributes:
        noise: factor of the noise; at 1 a plain threshold and centroid have 0.3 px of noise an axis.
        blur: standard deviation of the lens's blur [px].
        vignette: share of the light lost at the corners.
        shadow: share of the light lost in the middle of a soft shadow that moves.
        brightness: factor of the light.
        hue: angle by which colours turn [deg].
        balance: gains of blue, green and red.
        quality: quality of JPEG (4:2:0); None: not compressed.
    """

    noise: float = 1.0
    blur: float = 0.9
    vignette: float = 0.35
    shadow: float = 0.25
    brightness: float = 1.0
    hue: float = 0.0
    balance: tuple[float, float, float] = (1.0, 1.0, 1.0)
    quality: int | None = 85

    def colours(self) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
        """Return the colours of the skin and of the markers, two arrays (3,): blue, green, red of 255."""
        gain, turn = np.asarray(self.balance), _hue_turn(self.hue)
        return gain * (turn @ SKIN), gain * (turn @ RED)


@dataclass(frozen=True, eq=False)
class RenderedCamera:
    """A renderer of images of one camera and one look.

    Attributes:
        camera: camera that sees the scene.
        look: look of the scene.
        rng: random numbers of noise and of spurious blobs, drawn for every image.

    Raises:
        InputError: OpenCV is not installed.
    """

    camera: RingCamera
    look: Look
    rng: np.random.Generator
    _pool: Float[np.ndarray, "r c 3"] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        size = (self.camera.height + POOL, self.camera.width + POOL, 3)
        sheet = opencv().GaussianBlur(self.rng.standard_normal(size, dtype=np.float32), (0, 0), GRAIN)
        object.__setattr__(self, "_pool", sheet / sheet.std())

    def frame(
        self,
        instants: Sequence[Float[np.ndarray, "m p 3"]],
        time: float,
        *,
        hidden: Sequence[int] = (),
        blobs: int | Float[np.ndarray, "b 3"] = 0,
    ) -> UInt8[np.ndarray, "h w 3"]:
        """Draw an image (h, w, 3), blue first.

        Args:
            instants: the markers' outlines [m] at instants while the shutter is open; the mean of several is seen.
            time: time [s], which determines the place of the shadow.
            hidden: numbers of markers behind something dark.
            blobs: number of spurious red blobs, anywhere and of 2 to 10 px; or column, row and radius of each [px].
        """
        shown = np.setdiff1d(np.arange(len(instants[0])), hidden)
        cover = np.zeros((self.camera.height, self.camera.width), dtype=np.float32)
        for discs in instants:
            _paint(cover, self.camera.project(discs[shown]), 1.0 / len(instants))
        _paint(cover, _round(self._blobs(blobs)), 1.0)
        return self._developed(np.minimum(cover, 1.0), time)

    def black(self) -> UInt8[np.ndarray, "h w 3"]:
        """Return an image without light, (h, w, 3), all zeros."""
        return np.zeros((self.camera.height, self.camera.width, 3), dtype=np.uint8)

    def background(self, time: float) -> UInt8[np.ndarray, "h w 3"]:
        """Return an image (h, w, 3), blue first, of skin alone, at a time [s]."""
        return self._developed(np.zeros((self.camera.height, self.camera.width), dtype=np.float32), time)

    def grain(self, size: int) -> Float[np.ndarray, "s s 3"]:
        """Return a piece of the sheet of noise, (size, size, 3), of standard deviation 1."""
        return np.ascontiguousarray(self._pool[:size, :size])

    def _blobs(self, blobs: int | Float[np.ndarray, "b 3"]) -> Float[np.ndarray, "b 3"]:
        if not isinstance(blobs, int):
            return blobs
        return self.rng.uniform((0.0, 0.0, 2.0), (self.camera.width, self.camera.height, 10.0), (blobs, 3))

    def _developed(self, cover: Float[np.ndarray, "h w"], time: float) -> UInt8[np.ndarray, "h w 3"]:
        """Apply colours, light, noise and compression to the share of red in every pixel."""
        cv2, look = opencv(), self.look
        if look.blur > 0.0:
            cover = cv2.GaussianBlur(cover, (0, 0), look.blur)
        skin, red = look.colours()
        light = self.light(time)
        image = cv2.merge([light * (np.float32(red[c] - skin[c]) * cover + np.float32(skin[c])) for c in range(3)])
        if look.noise > 0.0:
            row, column = self.rng.integers(POOL, size=2).tolist()
            grain = self._pool[row : row + cover.shape[0], column : column + cover.shape[1]]
            strength = cv2.LUT(cv2.convertScaleAbs(image), np.sqrt(SHOT * np.arange(256) + READ**2).astype(np.float32))
            image = cv2.scaleAdd(cv2.multiply(strength, grain), look.noise, image)
        frame = cv2.convertScaleAbs(image)
        if look.quality is None:
            return frame
        return cv2.imdecode(cv2.imencode(".jpg", frame, [cv2.IMWRITE_JPEG_QUALITY, look.quality])[1], cv2.IMREAD_COLOR)

    def light(self, time: float) -> Float[np.ndarray, "h w"]:
        """Return the light at every pixel, (h, w), as a factor: less in the corners and in the shadow, which moves."""
        width, height = self.camera.width, self.camera.height
        column, row = np.meshgrid(np.linspace(-1, 1, 41) * width / height, np.linspace(-1, 1, 31))
        far = (column**2 + row**2) / (1 + (width / height) ** 2)
        x, y = 0.8 * np.cos(0.7 * time), 0.8 * np.sin(1.1 * time + 0.5)
        shade = self.look.shadow * np.exp(-((column - x) ** 2 + (row - y) ** 2) / 0.5)
        light = self.look.brightness * (1 - self.look.vignette * far) * (1 - shade)
        return opencv().resize(light.astype(np.float32), (width, height), interpolation=opencv().INTER_LINEAR)


def _hue_turn(degrees: float) -> Float[np.ndarray, "3 3"]:
    """Return the matrix that turns colours (blue, green, red) about grey."""
    angle, axis = np.radians(degrees), np.ones(3) / np.sqrt(3.0)
    cross = np.array([[0, -1, 1], [1, 0, -1], [-1, 1, 0]]) / np.sqrt(3.0)
    turned = np.cos(angle) * np.eye(3) - np.sin(angle) * cross + (1 - np.cos(angle)) * np.outer(axis, axis)
    return turned


def _round(blobs: Float[np.ndarray, "b 3"]) -> Float[np.ndarray, "b 16 2"]:
    turn = 2.0 * np.pi * np.arange(16) / 16
    return blobs[:, None, :2] + blobs[:, None, 2:] * np.stack([np.cos(turn), np.sin(turn)], axis=-1)


def _paint(cover: Float[np.ndarray, "h w"], outlines: Float[np.ndarray, "m p 2"], share: float) -> None:
    """Add to every pixel the share of its area inside outlines [px]."""
    cv2 = opencv()
    height, width = cover.shape
    for outline in outlines:
        low = np.maximum(np.floor(outline.min(axis=0)).astype(int) - 1, 0)
        high = np.minimum(np.ceil(outline.max(axis=0)).astype(int) + 2, (width, height))
        size = high - low
        if (size <= 0).any():
            continue
        mask = np.zeros((FINE * size[1], FINE * size[0]), dtype=np.uint8)
        corner = (outline - low + 0.5) * FINE - 0.5
        cv2.fillPoly(mask, [np.rint(corner * 256).astype(np.int32)], 255, shift=8)
        part = mask.reshape(size[1], FINE, size[0], FINE).mean(axis=(1, 3), dtype=np.float32)
        cover[low[1] : high[1], low[0] : high[0]] += part * np.float32(share / 255)
