"""The fisheye camera against OpenCV's, by round trips and by finite differences."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from palpate.errors import InputError
from palpate.files.schema import parse
from palpate.optical.fisheye import Fisheye, RingView
from palpate.sensors.marker_ring.files import CAMERA
from palpate.spatial.pose import Pose

LENS = Fisheye(204.0, 203.0, 318.7, 241.3, 0.03, -0.01, 0.002, -0.0005)
DOWN = np.diag([1.0, -1.0, -1.0])


def _view() -> RingView:
    tilt = Pose.from_rotation_vector([0.05, -0.03, 0.2], np.zeros(3)).rotation
    return RingView(LENS, Pose(DOWN @ tilt, [0.002, -0.001, 0.04]), 0.051, 2 * np.pi * np.arange(24) / 24)


def _directions(farthest: float, n: int = 400) -> np.ndarray:
    rng = np.random.default_rng(3)
    theta, phi = rng.uniform(0, farthest, n), rng.uniform(-np.pi, np.pi, n)
    return np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)


def _slope(function: Callable[[np.ndarray], np.ndarray], pixels: np.ndarray) -> np.ndarray:
    """By central differences of a thousandth of a pixel."""
    steps = 1e-3 * np.eye(2)
    return np.stack([(function(pixels + step) - function(pixels - step)) / 2e-3 for step in steps], axis=-1)


def test_projects_as_opencv_does() -> None:
    cv2 = pytest.importorskip("cv2")
    points = 0.05 * _directions(np.radians(85.0))
    matrix = np.array([[LENS.fx, 0, LENS.cx], [0, LENS.fy, LENS.cy], [0, 0, 1.0]])
    bent = np.array([LENS.k1, LENS.k2, LENS.k3, LENS.k4])
    theirs, _ = cv2.fisheye.projectPoints(points[:, None], np.zeros(3), np.zeros(3), matrix, bent)
    assert np.abs(LENS.project(points) - theirs[:, 0]).max() <= 1e-6
    # back: OpenCV iterates to 1e-6 of its own, so that its rays are compared nearer to the axis, and less strictly
    near = 0.05 * _directions(np.radians(60.0))
    pixels = LENS.project(near)
    flat = cv2.fisheye.undistortPoints(pixels[:, None], matrix, bent)[:, 0]
    rays = LENS.rays(pixels)
    assert np.abs(rays[:, :2] / rays[:, 2:] - flat).max() <= 1e-6


@pytest.mark.parametrize("camera", [LENS, Fisheye.equidistant(), Fisheye(200.0, 200.0, 320.0, 240.0, -0.05)])
def test_a_pixel_of_a_ray_has_that_ray(camera: Fisheye) -> None:
    """Beyond 90 degrees too, as far as the lens sees."""
    rays = _directions(min(camera.reach, 2.6) - 1e-3)
    assert np.abs(camera.rays(camera.project(rays)) - rays).max() <= 1e-11
    assert np.array_equal(camera.project(np.array([0.0, 0, 1])), [camera.cx, camera.cy])


def test_what_the_lens_cannot_see_is_nan() -> None:
    camera = Fisheye(200.0, 200.0, 320.0, 240.0, -0.2)  # theta_d turns at 1 / sqrt(0.6)
    assert camera.reach == pytest.approx(np.sqrt(1 / 0.6))
    assert np.isnan(camera.project(np.array([1.0, 0, 0]))).all()
    assert np.isnan(camera.rays(np.array([320 + 200 * 0.9, 240.0]))).all()
    assert np.isnan(camera.project(np.array([0.0, 0, -1.0]))).all()


def test_rays_have_unit_length_and_the_slope_of_differences() -> None:
    pixels = np.random.default_rng(0).uniform((120, 40), (520, 440), (200, 2))
    rays, slope = LENS.rays_with_slope(pixels)
    assert np.allclose(np.linalg.norm(rays, axis=1), 1.0, atol=1e-14)
    assert np.abs(_slope(LENS.rays, pixels) - slope).max() <= 1e-9
    assert np.isfinite(LENS.rays_with_slope(np.array([LENS.cx, LENS.cy]))[1]).all()


def test_the_plane_of_a_ring_and_back() -> None:
    view = _view()
    points = np.random.default_rng(1).uniform(-0.05, 0.05, (100, 2))
    pixels = view.from_plane(points)
    assert np.abs(view.to_plane(pixels) - points).max() <= 1e-13
    _, slope = view.to_plane_with_slope(pixels)
    assert np.abs(_slope(view.to_plane, pixels) - slope).max() <= 1e-9
    assert view.to_plane(pixels.reshape(4, 25, 2)).shape == (4, 25, 2)


def test_the_plane_s_kernel_is_its_plain_twin() -> None:
    view, rng = _view(), np.random.default_rng(5)
    pixels = np.concatenate([rng.uniform((-300, -300), (940, 780), (300, 2)), [[np.nan, 3.0], [LENS.cx, LENS.cy]]])
    ray = view.pose.rotate(view.camera.rays(pixels))
    length = -view.pose.translation[2] / ray[:, 2:]
    plain = np.where(length > 0, view.pose.translation[:2] + length * ray[:, :2], np.nan)
    assert np.array_equal(np.isnan(plain), np.isnan(view.to_plane(pixels)))
    np.testing.assert_allclose(view.to_plane(pixels), plain, rtol=1e-12, atol=1e-15)


def test_a_camera_at_its_nominal_place_sees_x_right_and_y_up() -> None:
    view = RingView(Fisheye.equidistant(), Pose(DOWN, [0, 0, 0.04]), 0.051, np.arange(24) * np.pi / 12)
    right, up = view.from_plane(np.array([[0.01, 0.0], [0.0, 0.01]])) - (319.5, 239.5)
    assert right[0] > 40
    assert up[1] < -40
    assert np.array_equal(view.to_plane(np.array([319.5, 239.5])), [0, 0])
    # a ray above the plane never meets it
    assert np.isnan(view.to_plane(np.array([660.0, 239.5]))).all()


@pytest.mark.parametrize("wrong", [{"fx": 0.0}, {"fy": -1.0}, {"cx": np.nan}, {"k2": np.inf}, {"width": 0}])
def test_numbers_that_are_no_camera_are_said(wrong: dict[str, float]) -> None:
    with pytest.raises(InputError, match=next(iter(wrong))):
        replace(LENS, **wrong)


def test_a_view_is_frozen_and_says_what_is_wrong() -> None:
    view = _view()
    with pytest.raises(ValueError, match="read-only"):
        view.rest[0, 0] = 1.0
    with pytest.raises(InputError, match="radius"):
        RingView(LENS, view.pose, -1.0, view.angles)
    with pytest.raises(InputError, match="plane of the ring"):
        RingView(LENS, Pose.identity(), 0.05, view.angles)
    with pytest.raises(InputError, match="angles"):
        RingView(LENS, view.pose, 0.05, np.zeros(2))


def test_a_camera_is_read_from_a_file() -> None:
    said = {name: getattr(LENS, name) for name in ("fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4", "width", "height")}
    assert parse(said, Fisheye, file="camera.toml", forms=CAMERA.forms) == LENS
    with pytest.raises(InputError, match=r"toml: fx"):
        parse(said | {"fx": -1.0}, Fisheye, file="camera.toml", forms=CAMERA.forms)
    with pytest.raises(InputError, match=r"focal.*Available"):
        parse(said | {"focal": 3.0}, Fisheye, file="camera.toml", forms=CAMERA.forms)
