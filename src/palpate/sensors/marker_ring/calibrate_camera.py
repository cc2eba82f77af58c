"""Calibrate the camera of a marker ring: its lens from pictures of a board, its pose from the ring."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from palpate.calibration.validation import Validation, cross_validate, pseudo_inverse
from palpate.errors import InputError, NotIdentifiable
from palpate.opencv import opencv
from palpate.optical.fisheye import Fisheye, RingView
from palpate.spatial._arrays import shaped
from palpate.spatial.arguments import takes_arrays
from palpate.spatial.pose import Pose

Pattern = Literal["chessboard", "circles", "asymmetric-circles"]
_FACING = np.diag([1.0, -1.0, -1.0])  # x_c = x, y_c = -y, z_c = -z
_FEWEST_BOARDS = 3
_FAR, _FAR_PIXELS = 4.0, 1.0  # times the usual rms of a picture, and px: one with a larger rms is omitted
_LEAST_INFORMATION = 1e-9  # smallest eigenvalue of the scaled information of a lens that is determined
_UNSURE = 0.02  # of the focal length: a lens with a larger standard deviation is not determined


@dataclass(frozen=True)
class BoardFit:
    """A lens and the pictures that it comes from.

    Attributes:
        camera: the lens.
        residual: rms of the corners' residuals [px].
        used: numbers of the pictures that were used.
        far: numbers of the pictures that contradict the others.
        deviation: standard deviation of the focal length [px/rad], the larger one of the picture's axes.
        validation: errors of corners in pictures that a fit did not use.
    """

    camera: Fisheye
    residual: float
    used: tuple[int, ...]
    far: tuple[int, ...]
    deviation: float
    validation: Validation


@takes_arrays
def calibrate_board(
    images: Sequence[UInt8[np.ndarray, "h w 3"]], board: tuple[int, int], square: float, pattern: Pattern = "chessboard"
) -> BoardFit:
    """Fit a lens to pictures of a chessboard or of a grid of circles; return a `BoardFit`.

    Args:
        images: (h, w, 3) uint8 of one size; those that do not show the complete board are skipped.
        board: inner corners or circles, columns and rows.
        square: side of a square, distance of neighbouring circles, or of a circle from the next row of asymmetric
            circles [m].
        pattern: of the board, as OpenCV draws them.

    Raises:
        InputError: the pattern is unknown, fewer than three pictures show the board, they do not determine a lens, or
            OpenCV is missing.
    """
    cv2 = opencv()
    if pattern not in get_args(Pattern):
        raise InputError(f"must be one of {', '.join(get_args(Pattern))}, not {pattern!r}.", where="pattern")
    corners, shown, size = list[np.ndarray](), list[int](), (0, 0)
    for number, image in enumerate(images):
        grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        size = grey.shape[::-1]
        found, pixels = _found(grey, board, pattern)
        if found:
            corners.append(pixels.reshape(-1, 2).astype(np.float64))
            shown.append(number)
    if len(corners) < _FEWEST_BOARDS:
        what = "inner corners" if pattern == "chessboard" else "circles"
        hint = f"Take at least {_FEWEST_BOARDS} pictures that show all {board[0]} x {board[1]} {what}."
        raise InputError(f"only {len(corners)} of {len(images)} pictures show the complete board.", hint=hint)
    fit = fit_lens(corners, board, square, size, pattern)
    return replace(fit, used=tuple(shown[k] for k in fit.used), far=tuple(shown[k] for k in fit.far))


def _found(grey: np.ndarray, board: tuple[int, int], pattern: Pattern) -> tuple[bool, np.ndarray]:
    """Return whether a picture shows the complete board, and its corners or circles [px], row by row."""
    cv2 = opencv()
    if pattern == "chessboard":
        return cv2.findChessboardCornersSB(grey, board)
    grid = cv2.CALIB_CB_SYMMETRIC_GRID if pattern == "circles" else cv2.CALIB_CB_ASYMMETRIC_GRID
    return cv2.findCirclesGrid(grey, board, flags=grid | cv2.CALIB_CB_CLUSTERING)


@takes_arrays
def fit_lens(
    corners: Sequence[Float[np.ndarray, "c 2"]],
    board: tuple[int, int],
    square: float,
    size: tuple[int, int],
    pattern: Pattern = "chessboard",
) -> BoardFit:
    """Fit a lens to the inner corners or circles of a board in several pictures; return a `BoardFit`.

    Pictures whose corners lie far from the fit are omitted.

    Args:
        corners: (c, 2) [px] for each picture, row by row of the board.
        board: number of inner corners or circles, columns and rows.
        square: side of a square, or distance of circles [m], as for `calibrate_board`.
        pattern: of the board.
        size: width and height of the pictures [px].

    Raises:
        InputError: the corners do not determine a lens; OpenCV is missing.
    """
    columns, rows = np.meshgrid(np.arange(board[0]), np.arange(board[1]))
    columns = 2 * columns + rows % 2 if pattern == "asymmetric-circles" else columns
    grid = square * np.stack([columns, rows, 0 * rows], axis=-1).reshape(1, -1, 3).astype(np.float64)
    seen = [np.asarray(each, dtype=np.float64).reshape(1, -1, 2) for each in corners]
    used, lens = list(range(len(seen))), _Lens.fitted(grid, seen, size)
    while len(used) > _FEWEST_BOARDS:
        off = np.array([np.sqrt(np.mean(lens.residual(k) ** 2)) for k in range(len(used))])
        sound = off <= max(_FAR * float(np.median(off)), _FAR_PIXELS)
        if sound.all() or np.count_nonzero(sound) < _FEWEST_BOARDS:
            break
        used = [number for number, kept in zip(used, sound, strict=True) if kept]
        lens = _Lens.fitted(grid, [seen[number] for number in used], size)
    every = np.concatenate([lens.residual(k) for k in range(len(used))])
    variance = float(np.sum(every**2)) / max(2 * len(every) - 8 - 6 * len(used), 1)
    normals = [lens.normal(k) for k in range(len(used))]
    squares, rights = (np.stack(each) for each in zip(*normals, strict=True))
    unit = np.sqrt(np.diag(squares.sum(axis=0)))
    focal, deviation = lens.camera[:2], np.inf
    if unit.all() and np.linalg.eigvalsh(scaled := squares.sum(axis=0) / np.outer(unit, unit))[0] > _LEAST_INFORMATION:
        spread: Float[np.ndarray, "8"] = np.diag(pseudo_inverse(scaled)) * variance
        deviation = float(np.max(np.sqrt(spread[:2]) / unit[:2]))
    if not (focal.min() > 0 and deviation < _UNSURE * focal.min()):
        raise _undetermined(f": the focal length is {focal[0]:.4g} +- {deviation:.2g} px/rad")

    def predict(left: Bool[np.ndarray, " n"]) -> tuple[np.ndarray, np.ndarray]:
        rest = _Lens.fitted(grid, [seen[number] for number, out in zip(used, left, strict=True) if not out], size)
        own, others = squares[left].sum(axis=0), squares[~left].sum(axis=0)
        error = rights[left].sum(axis=0) - own @ (rest.camera - lens.camera)
        return error, variance * (own + own @ pseudo_inverse(others) @ own)

    left = cross_validate(len(used), predict)
    far = tuple(number for number in range(len(seen)) if number not in used)
    fx, fy, cx, cy, k1, k2, k3, k4 = lens.camera.tolist()
    camera = Fisheye(fx, fy, cx, cy, k1, k2, k3, k4, *size)
    return BoardFit(camera, float(np.sqrt(2.0 * np.mean(every**2))), tuple(used), far, deviation, left)


@dataclass(frozen=True)
class _Lens:
    """A lens (fx, fy, cx, cy, k1 to k4) with the pose of the board in each picture."""

    camera: Float[np.ndarray, "8"]
    grid: Float[np.ndarray, "1 c 3"]
    seen: Sequence[Float[np.ndarray, "1 c 2"]]
    poses: Sequence[tuple[np.ndarray, np.ndarray]]

    @staticmethod
    def fitted(grid: np.ndarray, seen: Sequence[np.ndarray], size: tuple[int, int]) -> _Lens:
        """Fit the lens and the boards' poses by OpenCV."""
        cv2, start = opencv(), Fisheye.equidistant(*size)
        matrix = np.array([[start.fx, 0.0, start.cx], [0.0, start.fy, start.cy], [0.0, 0.0, 1.0]])
        names = cv2 if hasattr(cv2, "CALIB_RECOMPUTE_EXTRINSIC") else cv2.fisheye  # OpenCV 5, 4
        flags = names.CALIB_RECOMPUTE_EXTRINSIC | names.CALIB_FIX_SKEW | names.CALIB_USE_INTRINSIC_GUESS
        try:
            grids = [grid] * len(seen)
            _, matrix, bent, turns, places = cv2.fisheye.calibrate(grids, seen, size, matrix, np.zeros(4), flags=flags)
        except cv2.error as problem:
            raise _undetermined() from problem
        camera = np.array([matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], *bent.ravel()[:4]])
        if not np.isfinite(camera).all():
            raise _undetermined()
        return _Lens(camera, grid, seen, list(zip(turns, places, strict=True)))

    def _projected(self, k: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the corners of picture k [px], and their derivatives by the lens and the pose."""
        fx, fy, cx, cy, *bent = self.camera.tolist()
        matrix = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
        turn, place = (np.asarray(each, dtype=np.float64).reshape(3, 1) for each in self.poses[k])
        pixels, slopes = opencv().fisheye.projectPoints(self.grid, turn, place, matrix, np.array(bent))[:2]
        return pixels.reshape(-1, 2), slopes

    def residual(self, k: int) -> Float[np.ndarray, "c 2"]:
        """Return the residuals (c, 2) of the corners of picture k [px]."""
        return self.seen[k].reshape(-1, 2) - self._projected(k)[0]

    def normal(self, k: int) -> tuple[Float[np.ndarray, "8 8"], Float[np.ndarray, "8"]]:
        """Return J^T J and J^T r of picture k for the lens, with the board's pose eliminated."""
        slopes = self._projected(k)[1]
        of_lens, of_pose = slopes[:, :8], slopes[:, 8:14]
        across = of_lens - of_pose @ np.linalg.lstsq(of_pose, of_lens, rcond=None)[0]
        return across.T @ across, across.T @ self.residual(k).ravel()


def _undetermined(found: str = "") -> InputError:
    hint = "Tilt the board to all sides, and bring it to the edges of the picture."
    return InputError(f"the pictures of the board do not determine a lens{found}.", hint=hint)


@takes_arrays
def fit_ring_view(
    rest_pixels: Float[np.ndarray, "m 2"],
    radius: float,
    *,
    camera: Fisheye | None = None,
    height: float = 0.04,
    size: tuple[int, int] = (640, 480),
) -> tuple[RingView, Int[np.ndarray, " m"]]:
    """Fit the camera's pose to the markers of one even ring at rest; return the `RingView` and an index.

    The index (m,) is that of each marker of the view in `rest_pixels`, from the one nearest to angle 0. The view's
    angles are measured. One flat ring does not separate the focal length from the height: without a `camera`, the
    focal length of an equidistant lens about the picture's middle is fitted, and `height` is kept.

    Args:
        rest_pixels: (m, 2) all markers of the ring, in any order.
        radius: of the ring of markers [m].
        camera: the calibrated lens; None: not known.
        height: of the camera above the ring [m]: a guess, or kept without a `camera`.
        size: width and height of the picture [px], used without a `camera`.

    Raises:
        InputError: `rest_pixels` are not six or more finite pixels, the radius or the size is not positive, or the
            height is 0.
        NotIdentifiable: the pixels are not those of an even ring about the picture's middle.
    """
    if len(rest_pixels) < 6 or not np.isfinite(rest_pixels).all():
        raise InputError("rest_pixels must be six or more finite pixels (m, 2).")
    lens, focal_fitted = camera or Fisheye.equidistant(*size), camera is None
    even = 2 * np.pi * np.arange(len(rest_pixels)) / len(rest_pixels)
    order, start = _around(rest_pixels, even)
    seen = rest_pixels[order]

    def view(x: np.ndarray) -> RingView:
        tilt = Pose.from_rotation_vector([x[0], x[1], 0.0], np.zeros(3)).rotation
        focal = np.exp(x[4]) if focal_fitted else 1.0
        place = [x[2] * height, x[3] * height, height if focal_fitted else height * np.exp(x[4])]
        bent = replace(lens, fx=lens.fx * focal, fy=lens.fy * focal)
        return RingView(bent, Pose(_FACING @ tilt, place), radius, even + start + x[5])

    fitted = view(_solved(view, seen))
    x, y = fitted.to_plane(seen).T
    return RingView(fitted.camera, fitted.pose, radius, np.arctan2(y, x)), order


@takes_arrays
def fit_rings(
    rest_pixels: Float[np.ndarray, "m 2"], radius: float, rings: Sequence[float], **camera: Any
) -> tuple[RingView, Int[np.ndarray, " m"]]:
    """Fit the camera's pose to the first of several rings; return the `RingView` of all, and an index.

    The index (m,) is that of each marker of the view, ring by ring, in `rest_pixels`.

    Args:
        rest_pixels: (m, 2) markers, the same number of each ring, in any order.
        radius: of the rings [m].
        rings: heights of the rings [m]; the first is 0.
        camera: camera, height and size, see `fit_ring_view`.

    Raises:
        InputError: a ring has fewer than six markers, pixels are not finite, or the rings have different numbers of
            markers or do not lie one around the other.
        NotIdentifiable: the first ring is no even ring about the picture's middle.
    """
    pixels, heights = rest_pixels, shaped(rings, (None,), "rings")
    if not len(heights) or len(pixels) % len(heights):
        raise InputError(f"{len(pixels)} markers cannot be divided equally among {len(heights)} rings.")
    if len(heights) == 1:
        return fit_ring_view(pixels, radius, **camera)
    inmost = np.split(np.argsort(np.linalg.norm(pixels - pixels.mean(axis=0), axis=1)), len(heights))
    owned = dict(zip(np.argsort(heights).tolist(), inmost, strict=True))  # the nearer, the larger in the picture
    view, first = fit_ring_view(pixels[owned[0]], radius, **camera)
    order, angles = [owned[0][first]], [view.angles]
    for ring in range(1, len(heights)):
        x, y = view.to_plane(pixels[owned[ring]], heights[ring : ring + 1]).T
        turn: Float[np.ndarray, " m"] = np.sort(np.arctan2(y, x))
        gaps: Float[np.ndarray, " m"] = np.append(turn[1:], turn[0] + 2.0 * np.pi) - turn
        usual = 2.0 * np.pi / len(turn)
        if not (gaps.min() > 0.5 * usual and gaps.max() < 1.5 * usual):
            said = "the rings of markers are not one around the other in the picture."
            hint = "Write in rings the height of each ring above the first."
            raise InputError(said, where="marker_ring.rings", hint=hint)
        order.append(owned[ring][np.argsort(np.arctan2(y, x))])
        angles.append(turn)
    return RingView(view.camera, view.pose, radius, np.concatenate(angles), heights), np.concatenate(order)


def _around(pixels: np.ndarray, even: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the order of the pixels by rising angle about their mean, from 0, and the start angle of the even ring."""
    middle = pixels.mean(axis=0)
    angle = np.arctan2(middle[1] - pixels[:, 1], pixels[:, 0] - middle[0])
    order = np.argsort(angle)
    first = int(np.argmin(np.abs(angle[order])))
    order = np.roll(order, -first)
    gap = angle[order] - even
    return order, float(np.arctan2(np.sin(gap).mean(), np.cos(gap).mean()))


def _solved(view: Callable[[np.ndarray], RingView], seen: np.ndarray) -> np.ndarray:
    """Return the parameters of the view that fits the markers best."""
    from scipy.optimize import least_squares  # here: it takes a while to import

    def residual(x: np.ndarray) -> np.ndarray:
        this = view(x)
        return np.nan_to_num(this.from_plane(this.rest) - seen, nan=1e3).ravel()

    bounds = np.array([0.6, 0.6, 0.8, 0.8, 1.2, np.inf])
    solution: Any = least_squares(residual, np.zeros(6), bounds=(-bounds, bounds), x_scale=[0.1] * 6)
    gap = np.linalg.norm(seen - np.roll(seen, 1, axis=0), axis=1)
    if not np.sqrt(2 * solution.cost / len(seen)) < 0.25 * np.median(gap):
        said = (
            "the markers are not an even ring about the middle of the picture: write radius, thickness, height in m, "
            "state the lens in camera, and let the whole ring be in view."
        )
        raise NotIdentifiable(said, rank=0, missing=("the camera's place",))
    return solution.x
