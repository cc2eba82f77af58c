"""Compiled: draw markers seen by a fisheye camera into the windows of an image around them.

The drawing is a closed form: with q a pixel in the axes of an ellipse, rho = |q| and h = rho / |grad (rho^2 / 2)|, the
edge is (rho - 1) h away to first order. Its curvature is h^3 / det^2, and a blur of standard deviation sigma moves a
curved edge inwards by half of sigma^2 times it; what remains is a normal distribution function of the distance.
"""

# pyright: basic
from __future__ import annotations

import numpy as np

from palpate.surfaces._jit import inner, released

TURNS = 6  # points of an outline: they tell its first and second harmonics
WIDE = 2.6  # standard deviations, beyond which a pixel is all marker or all skin
PER = 128  # values of the normal distribution function per standard deviation, from -4 to 4
GROWN = 0.05  # px: OpenCV's filled polygons are larger by this all round, drawn eight times as fine
LARGEST = 64  # px: a marker's window is no wider


@inner
def _project(x, y, z, lens, pixel):
    """Project a point in the ring's frame [m] to a pixel, as `RingCamera.project` does."""
    x, y, z = x - lens[8], y - lens[9], z - lens[10]
    a = lens[11] * x + lens[12] * y + lens[13] * z
    b = lens[14] * x + lens[15] * y + lens[16] * z
    c = lens[17] * x + lens[18] * y + lens[19] * z
    off = np.sqrt(a * a + b * b)
    angle = np.arctan2(off, c)
    square = angle * angle
    bent = angle * (1.0 + square * (lens[4] + square * (lens[5] + square * (lens[6] + square * lens[7]))))
    scale = bent / max(off, 1e-12)
    pixel[0], pixel[1] = a * scale * lens[0] + lens[2], b * scale * lens[1] + lens[3]


@inner
def _harmonics(points, lens, pixel, waves):
    """Compute mean, cosine, sine, and cosine and sine of twice the angle of a disc's image outline, into (5, 2)."""
    for k in range(5):
        waves[k, 0] = waves[k, 1] = 0.0
    for k in range(TURNS):
        c, s = np.cos(2.0 * np.pi / TURNS * k), np.sin(2.0 * np.pi / TURNS * k)
        rest = 1.0 - c - s
        x = rest * points[0, 0] + c * points[1, 0] + s * points[2, 0]
        y = rest * points[0, 1] + c * points[1, 1] + s * points[2, 1]
        z = rest * points[0, 2] + c * points[1, 2] + s * points[2, 2]
        _project(x, y, z, lens, pixel)
        for a in range(2):
            part = pixel[a] * (2.0 / TURNS)
            waves[0, a] += 0.5 * part
            waves[1, a] += c * part
            waves[2, a] += s * part
            waves[3, a] += (c * c - s * s) * part
            waves[4, a] += 2.0 * c * s * part


@released("points m 3 3, lens 20, shape float, out out m 6")
def ellipses(points, lens, shape, out):
    """Compute the images of discs: each one's centroid, and two conjugate half axes of an ellipse.

    The lens bends the outline, p0 + U cos t + V sin t + A cos 2t + B sin 2t: its area's centroid is at
    p0 + ((A_u + B_v) U + (B_u - A_v) V) / 2.

    Args:
        points: (m, 3, 3) [m] middle, edge around the ring, edge along its axis.
        lens: (20,) focal lengths, middle, k1 to k4, position, rows of the rotation.
        shape: factor of the half axes: an outline of few corners has a smaller area than an ellipse.
        out: (m, 6) is filled [px].
    """
    pixel, waves = np.empty(2), np.empty((5, 2))
    for m in range(len(points)):
        _harmonics(points[m], lens, pixel, waves)
        ux, uy, vx, vy = waves[1, 0], waves[1, 1], waves[2, 0], waves[2, 1]
        det = ux * vy - uy * vx
        au, av = (waves[3, 0] * vy - waves[3, 1] * vx) / det, (waves[3, 1] * ux - waves[3, 0] * uy) / det
        bu, bv = (waves[4, 0] * vy - waves[4, 1] * vx) / det, (waves[4, 1] * ux - waves[4, 0] * uy) / det
        out[m, 0] = waves[0, 0] + 0.5 * ((au + bv) * ux + (bu - av) * vx)
        out[m, 1] = waves[0, 1] + 0.5 * ((au + bv) * uy + (bu - av) * vy)
        out[m, 2], out[m, 3], out[m, 4], out[m, 5] = shape * ux, shape * uy, shape * vx, shape * vy


@inner
def _window(ellipse, blur, width, height, window):
    """Compute the pixels that a blurred ellipse reaches: left, top, right, bottom."""
    wide = np.sqrt(ellipse[2] ** 2 + ellipse[4] ** 2) + WIDE * blur
    tall = np.sqrt(ellipse[3] ** 2 + ellipse[5] ** 2) + WIDE * blur
    wide, tall = min(wide, 0.5 * LARGEST - 1.0), min(tall, 0.5 * LARGEST - 1.0)
    window[0] = min(max(int(np.ceil(ellipse[0] - wide)), 0), width)
    window[1] = min(max(int(np.ceil(ellipse[1] - tall)), 0), height)
    window[2] = min(max(int(np.floor(ellipse[0] + wide)) + 1, window[0]), width)
    window[3] = min(max(int(np.floor(ellipse[1] + tall)) + 1, window[1]), height)


@inner
def _distances(ellipse, blur, left, y, count, far):
    """Compute the distances of a row's pixels outside the blurred edge, in standard deviations of the blur."""
    det = ellipse[2] * ellipse[5] - ellipse[3] * ellipse[4]
    a, b = np.float32(ellipse[5] / det), np.float32(-ellipse[4] / det)
    c, d = np.float32(-ellipse[3] / det), np.float32(ellipse[2] / det)
    bend = np.float32(0.5 * blur * blur / (det * det))
    start, dy, grown = np.float32(left - ellipse[0]), np.float32(y - ellipse[1]), np.float32(GROWN)
    one, least, scale = np.float32(1.0), np.float32(1e-6), np.float32(1.0 / blur)
    for x in range(count):
        dx = start + np.float32(x)
        s, t = a * dx + b * dy, c * dx + d * dy
        u, v = a * s + c * t, b * s + d * t
        rho = np.sqrt(s * s + t * t)
        h = rho / np.sqrt(u * u + v * v + least)
        far[x] = ((rho - one) * h + bend * h * h * h - grown) * scale


@inner
def _coloured(far, phi, colours, noise, light, grain, pixels):
    """Fill a row's pixels (n, 3): colours by the share of marker, times light (n,), and noise by the grain (n, 3)."""
    skin0, skin1, skin2 = colours[0, 0], colours[0, 1], colours[0, 2]
    more0, more1, more2 = colours[1, 0], colours[1, 1], colours[1, 2]
    shot, read = noise[0], noise[1]
    wide, four, per = np.float32(WIDE), np.float32(4.0), np.float32(PER)
    half, most = np.float32(0.5), np.float32(255.0)
    for x in range(len(pixels)):
        if far[x] > wide:
            continue
        share, lit = phi[int((four - max(far[x], -four)) * per + half)], light[x]
        level0, level1, level2 = (
            lit * (skin0 + share * more0),
            lit * (skin1 + share * more1),
            lit * (skin2 + share * more2),
        )
        value0 = level0 + np.sqrt(shot * level0 + read) * grain[x, 0]
        value1 = level1 + np.sqrt(shot * level1 + read) * grain[x, 1]
        value2 = level2 + np.sqrt(shot * level2 + read) * grain[x, 2]
        pixels[x, 0] = np.uint8(np.int32(min(abs(value0) + half, most)))
        pixels[x, 1] = np.uint8(np.int32(min(abs(value1) + half, most)))
        pixels[x, 2] = np.uint8(np.int32(min(abs(value2) + half, most)))


@inner
def _fetched(every, clean, light, grain, width, windows, offsets):
    """Read a pixel of each cache line that an image's windows cover, to load them; the returned sum has no meaning.

    Independent reads run in parallel, and drawing that waits for memory line by line takes 50 % longer: the buffer
    to draw in was last used four images ago.
    """
    total, some = 0, np.float32(0.0)
    lit, noise, row = light.reshape(-1), grain.reshape(-1), 3 * grain.shape[1]
    for m in range(len(windows)):
        left, top, right, bottom = windows[m]
        for y in range(top, bottom):
            first, last = y * width + left, y * width + right - 1
            for k in range(3 * first, 3 * last, 64):
                total += every[k] + clean[k]
            total += every[3 * last + 2] + clean[3 * last + 2]
            some += lit[first] + lit[last]
            first = (offsets[m, 0] + y - top) * row + 3 * offsets[m, 1]
            for k in range(first, first + 3 * (right - left), 16):
                some += noise[k]
    return total + some


@released(
    """
    frame out uint8 h w 3, behind uint8 h w 3, windows out int64 m 4, shown m 6, blur float, scene (float32 h w,
    float32 2 3, float32 2, float32 p), grain float32 s s 3, offsets int64 m 2
    """
)
def draw(frame, behind, windows, shown, blur, scene, grain, offsets):
    """Draw markers over an image's background; markers drawn in it earlier are erased.

    Args:
        frame: (h, w, 3) uint8 image, changed.
        behind: (h, w, 3) uint8, its background.
        windows: (m, 4) int64, windows in which markers were drawn: left, top, right, bottom; changed.
        shown: (m, 6) of `ellipses`; NaN: not drawn.
        blur: standard deviation [px].
        scene: float32: light (h, w); colours (2, 3) of skin, and of markers less skin; noise (2,), variance per unit
            of light and in the dark; the normal distribution function (8 PER + 1,).
        grain: (s, s, 3) float32, noise of standard deviation 1.
        offsets: (m, 2) int64, row and column of `grain` at which each window begins.
    """
    light, colours, noise, phi = scene
    height, width = light.shape
    far = np.empty(LARGEST, np.float32)
    every, clean = frame.reshape(-1), behind.reshape(-1)
    far[0] = _fetched(every, clean, light, grain, width, windows, offsets)  # about where markers are now
    for m in range(len(windows)):
        left, top, right, bottom = windows[m]
        for y in range(top, bottom):
            first = 3 * (y * width + left)
            last = min(first + (3 * (right - left) + 31) // 32 * 32, len(every))  # rounded up to vectors; all clean
            now, before = every[first:last], clean[first:last]
            for k in range(len(now)):
                now[k] = before[k]
        for k in range(4):
            windows[m, k] = 0
    for m in range(len(windows)):
        if not np.isfinite(shown[m, 0]):
            continue
        _window(shown[m], blur, width, height, windows[m])
        left, top, right, bottom = windows[m]
        row, column = offsets[m]
        for y in range(top, bottom):
            _distances(shown[m], blur, left, y, right - left, far)
            noisy = grain[row + y - top, column : column + right - left]
            _coloured(far, phi, colours, noise, light[y, left:right], noisy, frame[y, left:right])
