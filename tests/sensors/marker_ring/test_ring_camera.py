"""The camera of a marker ring, from boards and rings that a known camera sees."""

import cv2
import numpy as np
import pytest

from palpate.errors import InputError, NotIdentifiable
from palpate.optical.fisheye import Fisheye, RingView
from palpate.sensors.marker_ring.calibrate_camera import calibrate_board, fit_lens, fit_ring_view, fit_rings
from palpate.spatial.pose import Pose

LENS = Fisheye(205.0, 204.0, 321.5, 237.5, 0.02, -0.008, 0.002, -0.0003)
DOWN = np.diag([1.0, -1.0, -1.0])


def _boards(n: int, rng: np.random.Generator) -> list[Pose]:
    """T_camera_board: tilted up to 30 degrees, all over the image."""
    turns = rng.uniform(-0.5, 0.5, (n, 3))
    places = rng.uniform((-0.12, -0.09, 0.08), (0.04, 0.02, 0.14), (n, 3))
    return [Pose.from_rotation_vector(turn, place) for turn, place in zip(turns, places, strict=True)]


def test_a_lens_from_corners() -> None:
    """With 0.1 px of noise in 12 x 54 corners: focal length and middle within half a pixel."""
    rng, square = np.random.default_rng(0), 0.01
    x, y = np.meshgrid(np.arange(9), np.arange(6))
    grid = square * np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)
    seen = [LENS.project(pose.apply(grid)) + rng.normal(0, 0.1, (54, 2)) for pose in _boards(12, rng)]
    fit = fit_lens(seen, (9, 6), square, (640, 480))
    assert 0.1 <= fit.residual <= 0.17  # both coordinates together: 0.14
    assert _apart(fit.camera) <= 1.0


def _apart(camera: Fisheye) -> float:
    """Largest angle between the rays of both lenses within 150 px of the middle, in pixels."""
    x, y = np.meshgrid(np.arange(170.0, 480, 30), np.arange(90.0, 400, 30))
    pixels = np.stack([x, y], axis=-1)[np.hypot(x - 320, y - 240) < 150]
    cosine = np.sum(camera.rays(pixels) * LENS.rays(pixels), axis=-1)
    return float(204 * np.arccos(np.clip(cosine, -1, 1)).max())


@pytest.mark.parametrize(
    ("pattern", "board"), [("chessboard", (9, 6)), ("circles", (8, 5)), ("asymmetric-circles", (4, 7))]
)
def test_a_lens_from_drawn_boards(pattern: str, board: tuple[int, int]) -> None:
    rng = np.random.default_rng(1)
    pictures = [_drawn_board(pose, 0.012, pattern, board) for pose in _boards(5 if pattern == "chessboard" else 8, rng)]
    fit = calibrate_board([*pictures, np.zeros((480, 640, 3), np.uint8)], board, 0.012, pattern)
    assert 3 <= len(fit.used) <= 8
    assert fit.residual <= 0.25
    assert _apart(fit.camera) <= 3.0  # a turn of the camera and a shift of its middle look alike
    with pytest.raises(InputError, match=r"0 of 1 pictures.*Take"):
        calibrate_board([np.zeros((480, 640, 3), np.uint8)], board, 0.01, pattern)


def _drawn_board(pose: Pose, square: float, pattern: str, board: tuple[int, int]) -> np.ndarray:
    """Every pixel's ray meets the board's plane."""
    rows, columns = np.mgrid[0:480, 0:640]
    rays = LENS.rays(np.stack([columns, rows], axis=-1).astype(np.float64))
    back = pose.inverse()
    origin, ray = back.translation, back.rotate(rays)
    place = (origin[:2] - origin[2] / ray[..., 2:] * ray[..., :2]) / square
    if pattern == "chessboard":
        cell = np.floor(place).astype(int)
        dark = ((cell >= -1) & (cell < board)).all(axis=-1) & (cell.sum(axis=-1) % 2 == 0)
    else:
        near = np.round(place)
        dark = (np.linalg.norm(place - near, axis=-1) < 0.3) & (near >= 0).all(axis=-1)
        if pattern == "circles":
            dark &= (near < board).all(axis=-1)
        else:  # columns of every other row are shifted by one
            dark &= (near[..., 1] < board[1]) & (near[..., 0] < 2 * board[0]) & (near.sum(axis=-1) % 2 == 0)
    grey = np.where(dark, 30, 220).astype(np.uint8)
    return cv2.cvtColor(cv2.GaussianBlur(grey, (0, 0), 1.0), cv2.COLOR_GRAY2BGR)


def _ring(tilt: tuple[float, float], place: tuple[float, float, float], start: float, m: int = 24) -> RingView:
    turned = DOWN @ Pose.from_rotation_vector([*tilt, 0.0], np.zeros(3)).rotation
    return RingView(LENS, Pose(turned, place), 0.051, start + 2 * np.pi * np.arange(m) / m)


@pytest.mark.parametrize("start", [0.0, 0.11, -0.12])
def test_the_camera_s_place_from_the_ring(start: float) -> None:
    view, rng = _ring((0.06, -0.04), (0.002, -0.0015, 0.043), start), np.random.default_rng(2)
    order = rng.permutation(24)
    found, which = fit_ring_view(view.from_plane(view.rest)[order], 0.051, camera=LENS)
    assert np.array_equal(order[which], np.arange(24))
    assert np.abs(found.pose.translation - view.pose.translation).max() <= 1e-8
    assert np.abs(found.pose.rotation - view.pose.rotation).max() <= 1e-6
    assert np.abs(found.rest - view.rest).max() <= 1e-8


def test_without_a_lens_the_focal_length_is_fitted_and_the_height_held() -> None:
    even = Fisheye(230.0, 230.0, 319.5, 239.5)
    view = RingView(even, Pose(DOWN, [0.001, -0.002, 0.04]), 0.051, 2 * np.pi * np.arange(24) / 24)
    found, _ = fit_ring_view(view.from_plane(view.rest), 0.051)
    assert found.camera.fx == pytest.approx(230.0, rel=1e-6)
    assert found.pose.translation[2] == 0.04


def test_uneven_markers_stay_where_they_were_measured() -> None:
    view, rng = _ring((0.0, 0.0), (0.0, 0.0, 0.04), 0.0), np.random.default_rng(4)
    pixels = view.from_plane(view.rest * (1 + rng.normal(0, 0.004, (24, 1))))
    found, which = fit_ring_view(pixels, 0.051, camera=LENS)
    x, y = found.to_plane(pixels[which]).T
    assert np.abs(found.angles - np.arctan2(y, x)).max() <= 1e-9


def test_what_is_no_ring_is_said() -> None:
    with pytest.raises(NotIdentifiable, match="even ring"):
        fit_ring_view(np.random.default_rng(5).uniform((0, 0), (640, 480), (24, 2)), 0.051, camera=LENS)
    with pytest.raises(InputError, match="six or more"):
        fit_ring_view(np.zeros((3, 2)), 0.051)


def test_several_rings_are_told_apart_by_their_heights() -> None:
    """The camera's place is the first ring's fit, and every marker stands where it was put."""
    rings, rng = (0.0, 0.01, -0.008), np.random.default_rng(6)
    plain = _ring((0.03, -0.02), (0.001, -0.001, 0.041), 0.05)
    stagger = np.concatenate([plain.angles, plain.angles + 0.1, plain.angles])
    view = RingView(LENS, plain.pose, 0.051, stagger, rings)
    pixels, order = view.from_plane(view.rest, view.heights), rng.permutation(72)
    found, which = fit_rings(pixels[order], 0.051, rings, camera=LENS)
    alone, _ = fit_ring_view(pixels[:24], 0.051, camera=LENS)
    np.testing.assert_allclose(found.pose.translation, alone.pose.translation, rtol=0, atol=1e-9)
    turn = found.angles - stagger[order[which]]
    assert np.array_equal(order[which] // 24, np.repeat([0, 1, 2], 24))
    assert np.abs(np.arctan2(np.sin(turn), np.cos(turn))).max() <= 1e-6
    places = found.to_plane(pixels[order[which]], found.heights)
    assert np.abs(np.hypot(*places.T) - 0.051).max() <= 1e-7


def test_rings_that_do_not_lie_one_round_the_other_are_said() -> None:
    view = _ring((0.0, 0.0), (0.0, 0.0, 0.04), 0.0)
    outer = view.from_plane(view.rest)
    pairs = outer.mean(axis=0) + 0.8 * (np.repeat(outer[::2], 2, axis=0) - outer.mean(axis=0))
    with pytest.raises(InputError, match=r"one around the other.*Write"):
        fit_rings(np.concatenate([outer, pairs]), 0.051, (0.0, -0.01), camera=LENS)


def _corners(poses: list[Pose], rng: np.random.Generator) -> list[np.ndarray]:
    """(54, 2) [px] of each board, with 0.1 px of noise."""
    x, y = np.meshgrid(np.arange(9), np.arange(6))
    grid = 0.01 * np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)
    return [LENS.project(pose.apply(grid)) + rng.normal(0, 0.1, (54, 2)) for pose in poses]


def test_a_board_held_flat_determines_no_lens() -> None:
    rng = np.random.default_rng(2)
    flat = [Pose(np.eye(3), np.array([-0.04, -0.025, 0.1 + 0.01 * k])) for k in range(6)]
    with pytest.raises(InputError, match=r"do not determine a lens.*Tilt"):
        fit_lens(_corners(flat, rng), (9, 6), 0.01, (640, 480))


def test_pictures_that_contradict_the_others_are_left_out_and_named() -> None:
    rng = np.random.default_rng(3)
    seen = _corners(_boards(12, rng), rng)
    seen[4] = seen[4][::-1] + rng.normal(0, 8.0, (54, 2))
    fit = fit_lens(seen, (9, 6), 0.01, (640, 480))
    assert fit.far == (4,)
    assert _apart(fit.camera) <= 1.0
    assert fit.validation.parts == 4


def test_the_deviation_of_the_focal_length_holds() -> None:
    """Over 12 sets of boards: the rms of z has a deviation of 0.2."""
    off = list[float]()
    for seed in range(12):
        rng = np.random.default_rng(seed)
        fit = fit_lens(_corners(_boards(12, rng), rng), (9, 6), 0.01, (640, 480))
        off.append((fit.camera.fx - LENS.fx) / fit.deviation)
    assert 0.4 < np.sqrt(np.mean(np.square(off))) < 1.6
