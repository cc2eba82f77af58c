"""Real images of markers: pins of a TacTip, rings of a barrel skin through a fisheye, dots of a gel.

Every image goes through `find_blobs` with settings that are stated here once per camera, never per frame.
"""

import csv
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from claims.row import Row, shared, skipped
from palpate.opencv import opencv
from palpate.optical.markers import MarkerColour, find_blobs

PINS = MarkerColour("bright", 0.4, 0.06, background=31)
RING = MarkerColour("bright", 0.4, 0.06, background=31)
DOTS = MarkerColour("dark", 0.4, 0.06, background=31)
FAR = 120.0  # px of a gel's image 427 wide: the press dents about 40 px around its middle
# Counted by eye in the fisheye frame, enlarged five times: 16 spokes, each with 16 markers that come out of the glare
# around the dark hole in the middle; the outermost of the upright spoke, above and below, is cut by the frame's edge.
SPOKES, MIDDLE = 16, (324.0, 241.0)
RADII = (245, 197, 164, 141, 123, 109, 97, 87, 78, 70, 63, 56, 50, 44.5, 39, 33.7)  # px, each of its ring's 16


def rows(small: bool) -> Iterator[Row]:
    folder = shared()
    if folder is None:
        yield from skipped("pins, rings and dots", "")
        return
    yield from _tactip(folder / "data" / "tactip")
    yield _barrel(folder / "data" / "barrel" / "real_up.jpg")
    yield _dots(folder / "data" / "dots")


def _read(path: Path) -> np.ndarray:
    image = opencv().imread(str(path))
    if image is None:
        raise FileNotFoundError(path)
    return image


def _tactip(folder: Path) -> Iterator[Row]:
    with (folder / "targets.csv").open() as file:
        table = [row for row in csv.DictReader(file) if (folder / "images" / row["sensor_image"]).exists()]
    pins = [_pins(_read(folder / "images" / row["sensor_image"])) for row in table]
    counts = [len(each) for each in pins]
    what = f"pins of a TacTip found in each of {len(pins)} frames, one call"
    off = max(abs(count - 331) for count in counts)
    yield Row(what, "331 +- 1", f"{min(counts)} to {max(counts)}", off <= 1)
    moved = _followed(pins)
    truth = np.array([[float(row[f"pose_{k}"]) for k in (3, 4, 5)] for row in table])
    first = np.arange(len(pins)) < len(pins) // 2
    for fit, called in ((first, "fitted to the first half, judged on the second"), (~first, "the other way round")):
        for axis, (name, unit, most) in enumerate((("depth", "mm", 0.2), ("roll", "deg", 3.0), ("pitch", "deg", 3.0))):
            off = _regressed(moved[fit], truth[fit, axis], moved[~fit]) - truth[~fit, axis]
            mean, rms = np.abs(off).mean(), np.sqrt(np.mean(off**2))
            what = f"TacTip, {name} by ridge regression on the pins' displacements, {called}: mean absolute error"
            text = f"{mean:.2f} {unit} (rms {rms:.2f}; the targets spread by {truth[:, axis].std():.2f})"
            yield Row(what, f"<= {most} {unit}", text, mean <= most)


def _pins(image: np.ndarray) -> np.ndarray:
    """Pins are bright, blue, and of one size: lamps and their reflections are white or of another."""
    blobs = find_blobs(image, PINS)
    blue, green, red = np.moveaxis(opencv().blur(image, (5, 5)).astype(np.float64), -1, 0)
    x, y = np.rint(blobs.pixels).astype(int).T
    hue = np.maximum(blue - np.maximum(green, red), 0.0)[y, x]
    area = blobs.areas / np.median(blobs.areas)
    return blobs.pixels[(hue > 0.3 * np.median(hue)) & (area > 0.4) & (area < 2.5)]


def _followed(frames: list[np.ndarray]) -> np.ndarray:
    """Displacement of every pin in every frame from where one frame has it: always on to the frame most alike."""
    start = int(np.argmin([abs(len(each) - 331) for each in frames]))
    places = {start: frames[start]}
    nearest = {k: (np.inf, start) for k in range(len(frames)) if k != start}
    new = start
    while nearest:
        for k, (least, _) in nearest.items():
            gap = float(np.mean(cKDTree(frames[k]).query(places[new])[0]))
            if gap < least:
                nearest[k] = (gap, new)
        new = min(nearest, key=lambda k: nearest[k][0])
        places[new] = _matched(places[nearest.pop(new)[1]], frames[new])
    return np.array([places[k] - places[start] for k in range(len(frames))]).reshape(len(frames), -1)


def _matched(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Where pins went: nearest both ways, about a polynomial of the place that rises from a shift to degree 4."""
    x, y = ((before - before.mean(axis=0)) / 200.0).T
    field, pair, mutual = np.zeros_like(before), np.zeros(len(before), int), np.zeros(len(before), bool)
    for degree in (0, 0, 1, 1, 2, 2, 3, 4, 4, 4):
        gap, pair = cKDTree(after).query(before + field)
        mutual = cKDTree(before + field).query(after)[1][pair] == np.arange(len(before))
        mutual &= gap < max(3.0, 2.5 * float(np.median(gap[mutual])))
        basis = np.stack([x**i * y**j for i in range(degree + 1) for j in range(degree + 1 - i)], axis=1)
        weights = np.linalg.lstsq(basis[mutual], (after[pair] - before)[mutual], rcond=None)[0]
        field = basis @ weights
    return np.where(mutual[:, None], after[pair], before + field)


def _regressed(x: np.ndarray, y: np.ndarray, asked: np.ndarray) -> np.ndarray:
    """Kernel ridge, linear and a little quadratic; both strengths by leaving out one frame of the fitted half."""
    middle, scale = x.mean(axis=0), np.mean(np.sum((x - x.mean(axis=0)) ** 2, axis=1))
    x, asked, level = x - middle, asked - middle, y.mean()
    best, answer = np.inf, np.zeros(len(asked))
    for bend in (0.0, 0.1, 0.3, 1.0):
        ours, theirs = x @ x.T / scale, asked @ x.T / scale
        ours, theirs = ours + bend * ours**2 + 100.0, theirs + bend * theirs**2 + 100.0  # 100: a free constant
        for ridge in 10.0 ** np.arange(-6.0, 1.0, 0.5):
            inverse = np.linalg.inv(ours + ridge * np.eye(len(x)))
            weights = inverse @ (y - level)
            left_out = float(np.mean((weights / np.diag(inverse)) ** 2))
            if left_out < best:
                best, answer = left_out, theirs @ weights + level
    return answer


def _barrel(path: Path) -> Row:
    blobs = find_blobs(_read(path), RING)
    x, y = (blobs.pixels - MIDDLE).T
    ring = np.abs(np.log(np.hypot(x, y)[:, None] / np.array(RADII))).argmin(axis=1)
    far = np.abs(np.hypot(x, y) / np.array(RADII)[ring] - 1) > 0.06
    turn = np.degrees(np.arctan2(-y, x)) * SPOKES / 360
    stray = far | (np.abs(turn - np.rint(turn) - 0.05) > 0.2)
    found = len(set(zip(ring[~stray], np.rint(turn[~stray]) % SPOKES, strict=True)))
    counted = SPOKES * len(RADII)
    text = (
        f"{found} of {counted} ({found / counted:.1%}); {len(blobs) - found} others, most in the glare about the middle"
    )
    what = "barrel skin, real fisheye frame: markers of the 16 rings found, of those counted by eye"
    return Row(what, ">= 95 %", text, found >= 0.95 * counted)


def _dots(folder: Path) -> Row:
    rest = find_blobs(_read(folder / "ref.jpg"), DOTS)
    rest, told, worst = rest[~rest.cut].pixels, list[str](), 0.0
    for name in ("sample_34", "sample_38"):
        blobs = find_blobs(_read(folder / f"{name}.jpg"), DOTS)
        seen = blobs[~blobs.cut].pixels
        gap, pair = cKDTree(seen).query(rest)
        mutual = (cKDTree(rest).query(seen)[1][pair] == np.arange(len(rest))) & (gap < 9.0)
        size = gap[mutual]
        press = np.median(rest[mutual][np.argsort(size)[-8:]], axis=0)
        far = size[np.hypot(*(rest[mutual] - press).T) > FAR]
        worst = max(worst, float(far.mean()))
        told.append(
            f"{far.mean():.2f} (95 % within {np.percentile(far, 95):.2f}, {len(far)} dots; press {size.max():.1f})"
        )
    what = f"dotted gel, two presses: mean displacement of dots more than {FAR:.0f} px from the press"
    return Row(what, "<= 0.3 px", " and ".join(told) + " px", worst <= 0.3)
